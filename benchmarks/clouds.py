"""`zones` below clouds beside the reference solution, and what a cloud costs.

    python benchmarks/clouds.py reference [SECONDS]     clouds_reference.csv
    python benchmarks/clouds.py                         clouds.csv
    python benchmarks/clouds.py times                   clouds_times.csv

Average land air with a deck of stratus from 0.5 to 1 km, or noctilucent clouds, at 550 nm.  `reference` samples every
sun for SECONDS (20).  `clouds.csv` has the difference of each quality from it in per cent; `times` the processor
seconds of fields for all suns at the placed wavelengths.  Under decks of depth 10 and more the reference solution needs
hours: there doubling and adding judges (tests/test_clouds.py, tests/test_zones_thick.py).
"""

from __future__ import annotations

import sys
import time
import warnings
from dataclasses import replace
from pathlib import Path

import numpy as np
import results

from twilight.atmosphere.medium import Medium
from twilight.base.errors import TwilightWarning
from twilight.config.load import load_climate
from twilight.config.scene import Wavelengths
from twilight.scene.medium import climate_medium
from twilight.solvers import montecarlo, zones

HERE = Path(__file__).parent
DEPTHS = (0.1, 1.0)
SUNS_DEG = (60.0, 10.0, -4.0, -12.0)
BELOW = ((90.0, 0.0), (30.0, 0.0), (30.0, 180.0), (10.0, 90.0))
"""Elevation and azimuth [deg] of views from the ground."""
REFERENCE_COLUMNS = "case,sun_elevation_deg,elevation_deg,azimuth_deg,reference_per_sr,reference_percent,untrusted"
QUALITIES = ("draft", "standard")


def medium_of(cloud: dict | None, wavelength_nm: np.ndarray) -> Medium:
    clouds = {"clouds": [cloud]} if cloud else {}
    climate = load_climate("continental-average")
    return climate_medium(type(climate).model_validate(climate.model_dump(exclude_unset=True) | clouds), wavelength_nm)


CASES: dict[str, tuple[dict, tuple[float, ...]]] = {
    **{f"stratus of depth {depth:g}": ({"kind": "stratus", "optical_depth": depth}, SUNS_DEG) for depth in DEPTHS},
    "noctilucent clouds": ({"kind": "noctilucent"}, (-10.0,)),
}


def reference(seconds: float) -> None:
    rows = []
    for case, (cloud, suns) in CASES.items():
        medium = medium_of(cloud, np.array([550.0]))
        elevation, azimuth = np.array(BELOW).T
        settings = montecarlo.MonteCarloSettings(target_stderr=0.005, time_limit_s=seconds)
        field = montecarlo.prepare(medium, settings)
        for sun in suns:
            found = field.radiance_with_error(sun, elevation, azimuth)
            for d in range(elevation.size):
                value, error = found.radiance[d, 0], found.standard_error[d, 0]
                where = (sun, elevation[d], azimuth[d])
                row = [case, *(f"{x:g}" for x in where), f"{value:.5g}", f"{100.0 * error / value:.2f}"]
                rows.append([*row, int(found.untrusted[d, 0])])
                print(*rows[-1], sep="\t", flush=True)
    results.write(HERE / "clouds_reference.csv", REFERENCE_COLUMNS.split(","), rows)


def compare() -> None:
    truth = results.read_rows(HERE / "clouds_reference.csv")
    rows = []
    for case, (cloud, suns) in CASES.items():
        medium = medium_of(cloud, np.array([550.0]))
        own = [row for row in truth if row["case"] == case]
        off = {}
        for quality in QUALITIES:
            settings = zones.QUALITIES[quality]
            field = zones.prepare(medium, settings, sun_elevations_deg=suns)
            off[quality] = []
            for row in own:
                sun, elevation, azimuth = (
                    float(row[key]) for key in ("sun_elevation_deg", "elevation_deg", "azimuth_deg")
                )
                value = field.radiance(sun, elevation, azimuth)[0]
                off[quality].append(100.0 * (value / float(row["reference_per_sr"]) - 1.0))
        for k, row in enumerate(own):
            rows.append([*row.values(), *(f"{off[quality][k]:.2f}" for quality in QUALITIES)])
            print(*rows[-1], sep="\t", flush=True)
    columns = [*REFERENCE_COLUMNS.split(","), *(f"{quality}_percent" for quality in QUALITIES)]
    results.write(HERE / "clouds.csv", columns, rows)


def times() -> None:
    wavelength_nm = np.array(Wavelengths().wavelength_nm)
    rows = []
    for quality in QUALITIES:
        clear = 0.0
        for depth in (None, 1.0, 25.0):
            cloud = None if depth is None else {"kind": "stratus", "optical_depth": depth}
            medium = medium_of(cloud, wavelength_nm)
            zones.prepare(medium, replace(zones.QUALITIES[quality], max_orders=8), sun_elevations_deg=(60.0,))
            start = time.process_time()
            field = zones.prepare(medium, zones.QUALITIES[quality])
            seconds = time.process_time() - start
            clear = clear or seconds
            size = field.grids.nodes.altitude_km.size
            rows.append([quality, depth or 0, f"{seconds:.1f}", f"{seconds / clear:.1f}", size])
            print(*rows[-1], sep="\t", flush=True)
    results.write(
        HERE / "clouds_times.csv", ["quality", "optical_depth", "processor_s", "over_clear", "altitudes"], rows
    )


def main(arguments: list[str]) -> None:
    warnings.simplefilter("ignore", TwilightWarning)
    if arguments[:1] == ["reference"]:
        reference(float(arguments[1]) if len(arguments) > 1 else 20.0)
    elif arguments[:1] == ["times"]:
        times()
    else:
        compare()


if __name__ == "__main__":
    main(sys.argv[1:])
