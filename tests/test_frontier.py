"""`twilight frontier`: what it searches, when it gives points up, and what it writes."""

from __future__ import annotations

import csv
from dataclasses import fields

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from typer.testing import CliRunner

from twilight.base.errors import TwilightError
from twilight.cli.app import app
from twilight.solvers.zones.settings import QUALITIES, ZonesSettings
from twilight.studies.compare.reference_solution import ReferenceSolution
from twilight.studies.frontier import report, search
from twilight.studies.frontier.measure import Measurement, excess_percent
from twilight.studies.frontier.search import Point, frontier
from twilight.studies.frontier.space import ZONES, SearchedOption, Space

NOT_SEARCHED = {
    *("max_orders", "polarisation", "refraction", "bent_lines_of_sight", "bent_paths", "target_error", "field_file"),
    "spectral_interpolation",
}


def test_every_option_is_searched_or_physics():
    assert {d.key for d in ZONES.dimensions} | NOT_SEARCHED == {f.name for f in fields(ZonesSettings)}


@given(st.fixed_dictionaries({d.key: st.floats(-100.0, 100.0) for d in ZONES.dimensions}))
def test_every_point_of_the_space_is_allowed(values):
    ZONES.settings_at(values, ZonesSettings())  # raises for what the solver refuses
    assert ZONES.within(ZONES.within(values)) == ZONES.within(values)


@pytest.mark.parametrize("settings", [*QUALITIES.values(), *ZONES.starts.values()])
def test_qualities_and_starts_lie_in_the_space(settings):
    assert ZONES.settings_at(ZONES.values_of(settings), settings) == settings


def test_neighbours_take_what_the_solver_takes():
    """A switch goes to the other side, a choice to another one of its kind."""
    space = Space((SearchedOption("on", 0, 1), SearchedOption("rule", 6, 110, choices=(6, 26, 110))), {})
    rng = np.random.default_rng(2)
    found = [space.neighbour({"on": 1, "rule": 26}, rng) for _ in range(300)]
    assert {p["on"] for p in found} == {0, 1} and {p["rule"] for p in found} <= {6, 26, 110}
    assert space.within({"on": 7.0, "rule": 1e9}) == {"on": 1, "rule": 110}


def test_the_frontier_is_what_nothing_beats():
    rng = np.random.default_rng(3)
    points = [
        Point({}, "search", {"a": Measurement(t, {0.0: e})}, complete=True) for t, e in rng.uniform(0.1, 9.0, (60, 2))
    ]
    best = frontier(points)
    for p in points:
        others = (q for q in points if q is not p)
        beaten = any(q.processor_s <= p.processor_s and q.error_percent <= p.error_percent for q in others)
        assert beaten != any(p is b for b in best)


def test_the_noise_of_the_reference_is_no_error():
    rng = np.random.default_rng(1)
    right = rng.uniform(1.0, 3.0, (4000, 2))
    noise = 0.02 * right
    radiance = right + noise * rng.normal(size=right.shape)
    reference = ReferenceSolution(np.zeros(4000), np.zeros(4000), np.array([450.0, 550.0]), radiance, noise)
    assert excess_percent(right, reference) < 0.6
    assert excess_percent(1.05 * right, reference) == pytest.approx(1.96 * 5.0, rel=0.03)


class Air:
    """A scene whose error and time follow from two options by a formula; cost: factor on the time."""

    def __init__(self, name, cost):
        self.name, self.cost, self.physics, self.measured = name, cost, ZonesSettings(), 0

    def warm_up(self):
        pass

    def measure(self, settings):
        self.measured += 1
        size = settings.degree * settings.altitude_density
        return Measurement(self.cost * size, {30.0: 1.0 / size, -6.0: 90.0 / size * settings.beam_density**2})


def test_the_search_goes_beyond_its_starts_and_gives_up_early(tmp_path):
    airs = [Air("dear", 5.0), Air("cheap", 1.0)]
    points = list(search.search(airs, QUALITIES, budget_s=1e9, most_points=60, seed=1))
    assert [p.origin for p in points[:4]] == [*QUALITIES, "search"]
    assert all(p.complete for p in points[:3])
    assert airs[0].measured < airs[1].measured == 60  # the cheap one first, and some never reach the dear one
    best = frontier(points)
    assert any(p.origin == "search" for p in best)
    again = list(search.search([Air("dear", 5.0), Air("cheap", 1.0)], QUALITIES, budget_s=1e9, most_points=8, seed=1))
    assert [p.values for p in again] == [p.values for p in points[:8]]
    report.write_tables(points, tmp_path)
    report.draw(points, tmp_path / "frontier.png", "two airs")
    assert (tmp_path / "frontier.png").stat().st_size > 10_000
    with open(tmp_path / "points.csv") as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == sum(len(p.found) for p in points)
    assert {r["scene"] for r in rows} == {"dear", "cheap"} and "error_percent_sun_-6" in rows[0]
    with open(tmp_path / "frontier.csv") as file:
        assert len(list(csv.DictReader(file))) == len(best)


def test_a_low_sun_is_allowed_more():
    by_sun = {30.0: 1.0, -9.0: 5.0 / 3.0, -18.0: 2.5}
    for sun, error in by_sun.items():
        assert Measurement(1.0, {sun: error}).worst_percent == pytest.approx(1.0)
    assert Measurement(1.0, {**by_sun, -6.0: 1.2}).worst_percent == pytest.approx(1.2)


def test_a_search_goes_on_from_its_table(tmp_path):
    airs = [Air("dear", 5.0), Air("cheap", 1.0)]
    first = list(search.search(airs, QUALITIES, budget_s=1e9, most_points=20, seed=1))
    report.write_tables(first, tmp_path)
    known = report.read_points(tmp_path / "points.csv", ["cheap", "dear"])
    assert [(p.values, p.origin, p.complete) for p in known] == [(p.values, p.origin, p.complete) for p in first]
    again = [Air("dear", 5.0), Air("cheap", 1.0)]
    more = list(search.search(again, QUALITIES, budget_s=1e9, most_points=30, known=known, seed=1))
    assert len(more) == 10 and {p.origin for p in more} == {"search"} and again[1].measured == 10
    (tmp_path / "other.csv").write_text("a,b\n1,2\n")
    wrong = {"points": "is not of the same scenes: dear", "other": "is no table of points", "none": "cannot be read"}
    for name, words in wrong.items():
        with pytest.raises(TwilightError, match=rf"{name}\.csv: {words}"):
            report.read_points(tmp_path / f"{name}.csv", ["cheap"])


def test_slow_settings_are_given_up():
    airs = [Air("a", 1.0), Air("b", 1.0)]
    points = list(search.search(airs, QUALITIES, budget_s=1e9, most_points=40, longest_s=8.0, seed=2))
    assert [p.complete for p in points[:3]] == [True, False, False]
    assert all(p.processor_s > 8.0 for p in points[1:3]) and len(points[2].found) == 1


def test_the_budget_ends_the_search():
    points = list(search.search([Air("a", 1.0)], {"draft": QUALITIES["draft"]}, budget_s=1e-9, most_points=60))
    assert len(points) == 1


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["urban", "--set", "solver.name=cells"], "frontier searches the settings of zones"),
        (["urban", "desert", "--reference", "a.csv"], "--reference: is given 1 times for 2 scenes"),
        (["humidity"], "is a series of"),
        (["urban", "--minutes", "-1"], "--minutes"),
    ],
)
def test_bad_input_is_one_sentence(arguments, said):
    result = CliRunner().invoke(app, ["frontier", *arguments])
    assert result.exit_code == 2 and said in result.output and len(result.output.splitlines()) == 1


def test_without_optuna_one_sentence_says_how_to_install_it(monkeypatch):
    import sys

    monkeypatch.setitem(sys.modules, "optuna", None)
    result = CliRunner().invoke(app, ["frontier", "urban"])
    assert result.exit_code == 2 and "install 'optuna>=" in result.output and len(result.output.splitlines()) == 1
