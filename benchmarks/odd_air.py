"""Odd air against the reference solution: python benchmarks/odd_air.py [odd] [layers] [SECONDS | keep]

Scalar theory, one wavelength, no refraction.  `odd` writes results/odd_air.csv: air that ends at 20 km, ozone of 20
times the usual depth, aerosol of asymmetry 0.99, haze in stripes; `layers` writes results/sharp_layers.csv: single
layers from 10 m to 1 km seen from below, from inside and from above.  Each row has the reference's radiance, its
standard error, and what `zones` at draft and standard differ by, in per cent of the reference solution.

The reference samples until 0.5 % (layers: 1 %) or for SECONDS for each sun and observer (60); with `keep` its columns
stay as the table has them, and only `zones` is solved anew.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
import results

sys.path.insert(0, str(results.ROOT / "tests"))

from layered_sky import layered
from stability_media import LEVELS_KM, Air, medium_of

from twilight.atmosphere.medium import Medium
from twilight.solvers import montecarlo, zones

SUNS_DEG = (30.0, -6.0)
ELEVATION_DEG = np.array([1.0, 1.0, 5.0, 20.0, 90.0])
AZIMUTH_DEG = np.array([0.0, 180.0, 0.0, 90.0, 0.0])
COLUMNS = (
    "case,sun_elevation_deg,observer_km,elevation_deg,azimuth_deg,reference_per_sr,reference_percent,untrusted,"
    "draft_percent,standard_percent"
)
STORED_REFERENCE = ("the reference solution's columns are those of an earlier run, whose solver has not changed since",)
"""Note of a table that is made with `keep`."""


def air(levels_km: np.ndarray = LEVELS_KM, **depths: float) -> Medium:
    return medium_of(Air(**depths), levels_km=levels_km, refractivity=0.0)  # type: ignore[arg-type]


def striped() -> Medium:
    """Ten stripes of haze, 100 m each with edges, 100 m apart from 1 km on, optical depth 0.05 each."""
    edges = 1.0 + 0.1 * np.arange(20)
    levels = np.sort(np.concatenate([[0.0, 0.5], edges, edges, [4.0, 6.0, 8.0, 10.0, 15.0, 20.0, 30.0, 50.0, 80.0]]))
    medium = air(levels, aerosol=0.0)
    aerosol = np.zeros_like(medium.aerosol_extinction_per_km)
    for base in edges[::2]:
        first = np.flatnonzero(levels == base)[-1]
        aerosol[first : first + 2] = 0.05 / 0.1
    return replace(medium, aerosol_extinction_per_km=aerosol)


ODD: dict[str, Callable[[], Medium]] = {
    "top at 20 km": lambda: air(np.concatenate([np.arange(0.0, 10.0), np.linspace(10.0, 20.0, 6)])),
    "ozone 20 times": lambda: air(ozone=0.6),
    "asymmetry 0.99": lambda: air(aerosol=0.5, asymmetry=0.99),
    "striped haze": striped,
}

LAYERS: dict[str, tuple[float, float, float, float]] = {
    "jump, 10 m at 3 km, depth 2": (3.0, 0.01, 2.0, 0.0),
    "jump, 1 km at 3 km, depth 10": (3.0, 1.0, 10.0, 0.0),
    "ramps of 1 m, 200 m at 3 km, depth 0.5": (3.0, 0.2, 0.5, 1e-3),
    "jump, 1 km at 10 km, depth 0.01": (10.0, 1.0, 0.01, 0.0),
    "jump, 500 m at 1 km, depth 50": (1.0, 0.5, 50.0, 0.0),
    "jump, 1 km at 50 km, depth 1": (50.0, 1.0, 1.0, 0.0),
}
"""base [km], thickness [km], optical depth, ramps [km]"""


class Place(NamedTuple):
    """An observer and his directions (D,) [deg]."""

    altitude_km: float
    elevation_deg: np.ndarray
    azimuth_deg: np.ndarray


def compare(case: str, medium: Medium, places: Sequence[Place], reference: Callable[..., list]) -> list[list]:
    """Rows of the table.  reference: its columns for (case, medium, place), a row for each sun and direction."""
    fields = [
        zones.prepare(
            medium,
            replace(zones.QUALITIES[quality], polarisation=False),
            observer_altitude_km=max(place.altitude_km for place in places),
            sun_elevations_deg=SUNS_DEG,
        )
        for quality in ("draft", "standard")
    ]
    rows = []
    for place in places:
        at = {"observer_altitude_km": place.altitude_km}
        own = iter(reference(case, medium, place))
        for sun in SUNS_DEG:
            skies = [field.radiance(sun, place.elevation_deg, place.azimuth_deg, **at)[:, 0] for field in fields]
            for d in range(place.elevation_deg.size):
                value, percent, untrusted = next(own)
                where = [sun, place.altitude_km, place.elevation_deg[d], place.azimuth_deg[d]]
                off = [f"{100.0 * (sky[d] / float(value) - 1.0):.2f}" for sky in skies]
                rows.append([case, *(f"{number:g}" for number in where), value, percent, untrusted, *off])
                print(*rows[-1], sep="\t", flush=True)
    return rows


def sampled(error: float, seconds: float) -> Callable[..., list]:
    """The reference solution, that samples until this relative error or for so long for each sun and observer."""

    def of(case: str, medium: Medium, place: Place) -> list:
        settings = montecarlo.MonteCarloSettings(target_stderr=error, time_limit_s=seconds, polarisation=False)
        field = montecarlo.prepare(medium, settings, observer_altitude_km=place.altitude_km)
        rows = []
        for sun in SUNS_DEG:
            found = field.radiance_with_error(sun, place.elevation_deg, place.azimuth_deg)
            for value, own, untrusted in zip(
                found.radiance[:, 0], found.standard_error[:, 0], found.untrusted[:, 0], strict=True
            ):
                rows.append([f"{value:.5g}", f"{100.0 * own / value:.2f}", int(untrusted)])
        return rows

    return of


def stored(table: Path) -> Callable[..., list]:
    """The reference solution as it is in a table."""
    rows = results.read_rows(table)

    def of(case: str, medium: Medium, place: Place) -> list:
        there = [row for row in rows if row["case"] == case and row["observer_km"] == f"{place.altitude_km:g}"]
        return [[row["reference_per_sr"], row["reference_percent"], row["untrusted"]] for row in there]

    return of


def compile_first() -> None:
    """The reference solution's time is not that of its compilation."""
    settings = montecarlo.MonteCarloSettings(target_stderr=None, samples=2, polarisation=False)
    field = montecarlo.prepare(air(), settings, observer_altitude_km=0.0)
    for sun in SUNS_DEG:
        field.radiance(sun, ELEVATION_DEG, AZIMUTH_DEG)


def main(arguments: list[str]) -> None:
    seconds = next((float(a) for a in arguments if a.replace(".", "").isdigit()), 60.0)
    kinds = [a for a in arguments if a in ("odd", "layers")] or ["odd", "layers"]
    keep = "keep" in arguments
    notes = STORED_REFERENCE if keep else ()
    if not keep:
        compile_first()
    if "odd" in kinds:
        table = results.FOLDER / "odd_air.csv"
        reference = stored(table) if keep else sampled(0.005, seconds)
        ground = [Place(0.0, ELEVATION_DEG, AZIMUTH_DEG)]
        rows = [row for case, medium in ODD.items() for row in compare(case, medium(), ground, reference)]
        results.write(table, COLUMNS.split(","), rows, notes=notes)
    if "layers" in kinds:
        table = results.FOLDER / "sharp_layers.csv"
        reference = stored(table) if keep else sampled(0.01, seconds)
        rows = []
        for case, (base, thickness, depth, ramp) in LAYERS.items():
            below, inside, above = (3.0, 20.0, 90.0), (-20.0, 0.5, 20.0), (-90.0, -20.0, 10.0)
            altitudes = 0.0, base + 0.5 * thickness, base + thickness + 5.0
            places = [
                Place(altitude, np.array(views), np.full(len(views), 40.0))
                for altitude, views in zip(altitudes, (below, inside, above), strict=True)
            ]
            rows += compare(case, layered(base, thickness, depth, ramp), places, reference)
        results.write(table, COLUMNS.split(","), rows, notes=notes)


if __name__ == "__main__":
    results.say_help(__doc__)
    main(sys.argv[1:])
