"""A target error: the cheapest quality that has it, from errors measured beforehand."""

import csv
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hazy_zones import SMALL

from twilight.base.errors import TwilightWarning
from twilight.config import load_climate
from twilight.scene.medium import climate_medium
from twilight.solvers import zones
from twilight.solvers.zones import solver
from twilight.solvers.zones.solver import MEASURED_ERRORS, Errors, expected_error, kind_of, quality_for

TABLE = Path(__file__).parents[2] / "benchmarks" / "results" / "zones_error.csv"
KINDS = {
    "fine": ("pure-air", "continental-average", "continental-clean", "continental-polluted", "urban"),
    "coarse": ("desert", "maritime-clean", "maritime-polluted", "maritime-tropical"),
    "aloft": ("volcanic-extreme", "volcanic-stratosphere"),
}
NM = np.array([450.0, 550.0, 680.0])


def air(climate):
    return climate_medium(load_climate(climate), NM)


@pytest.mark.parametrize(("kind", "climate"), [(k, c) for k, some in KINDS.items() for c in some])
def test_kinds_of_air(kind, climate):
    """An error would be promised of another kind of air."""
    assert kind_of(air(climate)) == kind


def kind_among(climate):
    return next((kind for kind, some in KINDS.items() if climate in some), "fine")


def errors_of_climates():
    """Largest errors [%] of each range of suns by (quality, climate)."""
    found = {}
    with open(TABLE, newline="", encoding="utf-8") as file:
        for r in csv.DictReader(line for line in file if line[0] != "#"):
            sun = float(r["sun_elevation_deg"])
            place = 0 if sun >= solver.LAST_DAY_DEG else 1 if sun >= solver.LAST_TWILIGHT_DEG else 2
            errors = found.setdefault((r["quality"], r["climate"]), [0.0, 0.0, 0.0])
            errors[place] = max(errors[place], float(r["excess_percent"]))
    return found


@pytest.mark.parametrize("quality", ["draft", "standard"])
def test_the_errors_are_those_of_the_table(quality):
    """A promise would rest on figures that nobody measured."""
    some = {climate: e for (q, climate), e in errors_of_climates().items() if q == quality}
    assert len(some) >= 12
    found = {}
    for climate, errors in some.items():
        kind = kind_among(climate)
        found[kind] = [max(pair) for pair in zip(errors, found.get(kind, errors), strict=True)]
    rounded = {kind: Errors(*(math.ceil(10 * v - 1e-9) / 10 for v in errors)) for kind, errors in found.items()}
    assert rounded == MEASURED_ERRORS[quality]


def test_the_errors_hold_in_air_that_the_rule_does_not_know():
    """Each climate left out, its errors are within what the others of its kind promise (benchmarks/target_error.py)."""
    measured = errors_of_climates()
    with open(TABLE.with_name("target_error.csv"), newline="", encoding="utf-8") as file:
        rows = list(csv.DictReader(line for line in file if line[0] != "#"))
    drawn = [r for r in rows if r["beside"] != "montecarlo"]
    assert drawn and all(float(r["got_percent"]) <= float(r["promised_percent"]) for r in drawn)
    left_out = [r for r in rows if r["beside"] == "montecarlo"]
    assert {r["climate"] for r in left_out} == {climate for _, climate in measured}
    for r in left_out:
        place = ("day", "twilight", "deep").index(r["suns"])
        others = [
            max(e[: place + 1])
            for (quality, climate), e in measured.items()
            if quality == r["quality"] and kind_among(climate) == r["kind"] and climate != r["climate"]
        ]
        assert float(r["got_percent"]) == measured[r["quality"], r["climate"]][place]
        assert float(r["promised_percent"]) == pytest.approx(solver.SAFETY_FACTORS[r["kind"]] * max(others), abs=0.01)
        assert float(r["got_percent"]) <= float(r["promised_percent"]), r


def test_the_cheapest_quality_that_is_good_enough():
    """`--target-error` would cost too much, or not be met."""
    fine, coarse = air("continental-average"), air("desert")
    asked = {e: quality_for(replace(SMALL, target_error=e), fine, [-4.0])[0] for e in (0.2, 0.03, 0.014, 1e-9)}
    assert list(asked.values()) == ["draft", "draft", "standard", "reference"]
    for quality in MEASURED_ERRORS:
        assert expected_error(quality, fine, [10.0]) <= expected_error(quality, fine, [10.0, -12.0])
        assert expected_error(quality, fine, [-18.0]) == expected_error(quality, fine, None)
    assert quality_for(replace(SMALL, target_error=1e-3), coarse, None) == ("reference", math.inf)


def test_a_field_is_solved_once_at_the_quality_that_was_chosen(monkeypatch):
    """The chosen quality would not be the one that is solved."""
    fine = air("continental-average")
    few = replace(SMALL, altitude_density=0.5)
    monkeypatch.setattr(solver, "QUALITIES", {"draft": SMALL, "standard": few, "reference": SMALL})
    settings = replace(zones.QUALITIES["standard"], target_error=0.014, max_orders=2, tolerance=0.0)
    field = zones.prepare(fine, settings, sun_elevations_deg=[10.0])
    assert field.settings == replace(few, target_error=0.014, max_orders=2)
    assert field.convergence.error == expected_error("standard", fine, [10.0]) <= 0.014
    alone = zones.prepare(fine, replace(few, max_orders=2), sun_elevations_deg=[10.0])
    where = 10.0, [2.0, 30.0, 80.0], [0.0, 60.0, 180.0]
    np.testing.assert_array_equal(field.radiance(*where), alone.radiance(*where))
    with pytest.warns(TwilightWarning, match=r"solver\.target_error 1e-09 is not known to be reached"):
        zones.prepare(fine, replace(settings, target_error=1e-9), sun_elevations_deg=[10.0])
