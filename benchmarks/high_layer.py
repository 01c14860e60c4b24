"""Light that leaks along a thin layer high up after sunset: python benchmarks/high_layer.py [referee|causes ...]

A white layer of HG 0.7, 1 km thick, of optical depth 1, at 50 km, above air of optical depth 0.1 and black ground;
scalar theory, no refraction, sun at -6 deg, seen from the ground.

`referee [SECONDS [SEEDS]]` writes benchmarks/high_layer_referee.csv: the referee's radiance at each of SEEDS seeds (4)
that sample for SECONDS each (110), and its standard error.  Without a word benchmarks/high_layer.csv is written: the
mean of the seeds, its standard error, the chi square of the seeds about it, and what `zones` at draft and standard
differ by, in per cent.  `causes` writes benchmarks/high_layer_causes.csv: what standard differs by where one thing is
as it is in air without thin layers, or all of them are.
"""

from __future__ import annotations

import sys
import warnings
from contextlib import ExitStack
from dataclasses import replace
from importlib import import_module
from pathlib import Path
from unittest.mock import patch

import numpy as np
import results

HERE = Path(__file__).parent
sys.path.insert(0, str(HERE.parent / "tests"))

from layered_sky import layered  # noqa: E402

from twilight.errors import TwilightWarning  # noqa: E402
from twilight.solvers import montecarlo, zones  # noqa: E402
from twilight.solvers.zones import directions  # noqa: E402

BASE_KM, THICKNESS_KM, DEPTH = 50.0, 1.0, 1.0
SUN_DEG = -6.0
ELEVATION_DEG, AZIMUTH_DEG = np.array([20.0, 90.0]), np.array([40.0, 40.0])
SEEDS_TABLE = HERE / "high_layer_referee.csv"


def referee(seconds: float, seeds: int) -> None:
    medium, rows = layered(BASE_KM, THICKNESS_KM, DEPTH), []
    for seed in range(1, seeds + 1):
        settings = montecarlo.MonteCarloSettings(
            target_stderr=1e-3, time_limit_s=seconds, polarisation=False, seed=seed
        )
        field = montecarlo.prepare(medium, settings, observer_altitude_km=0.0)
        found = field.radiance_with_error(SUN_DEG, ELEVATION_DEG, AZIMUTH_DEG)
        for d, elevation in enumerate(ELEVATION_DEG):
            value, own = found.radiance[d, 0], found.standard_error[d, 0]
            rows.append(
                [seed, f"{elevation:g}", f"{value:.5g}", f"{100.0 * own / value:.2f}", int(found.untrusted[d, 0])]
            )
            print(*rows[-1], sep="\t", flush=True)
    columns = "seed,elevation_deg,radiance_per_sr,standard_error_percent,untrusted"
    results.write(SEEDS_TABLE, columns.split(","), rows)


def standing(elevation: float) -> tuple[float, float, float, int]:
    """Mean of the seeds [sr^-1], its standard error, their chi square about it, degrees of freedom."""
    of = [row for row in results.read_rows(SEEDS_TABLE) if float(row["elevation_deg"]) == elevation]
    value = np.array([float(row["radiance_per_sr"]) for row in of])
    own = 0.01 * value * np.array([float(row["standard_error_percent"]) for row in of])
    mean = float(value.mean())
    error = float(np.sqrt(np.sum(own**2))) / value.size
    return mean, error, float(np.sum(((value - mean) / own) ** 2)), value.size - 1


def sky(quality: str, points_as_elsewhere: bool = False) -> np.ndarray:
    settings = replace(zones.QUALITIES[quality], polarisation=False)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", TwilightWarning)
        field = zones.prepare(layered(BASE_KM, THICKNESS_KM, DEPTH), settings, sun_elevations_deg=[SUN_DEG])
    if points_as_elsewhere:
        field._thin_layer = False
    return field.radiance(SUN_DEG, ELEVATION_DEG, AZIMUTH_DEG)[:, 0]


def compare() -> None:
    skies, rows = [sky("draft"), sky("standard")], []
    for d, elevation in enumerate(ELEVATION_DEG):
        mean, error, chi_square, freedom = standing(elevation)
        off = [f"{100.0 * (found[d] / mean - 1.0):.1f}" for found in skies]
        rows.append(
            [f"{elevation:g}", f"{mean:.4g}", f"{100.0 * error / mean:.2f}", f"{chi_square:.1f}", freedom, *off]
        )
        print(*rows[-1], sep="\t", flush=True)
    columns = "elevation_deg,referee_per_sr,referee_percent,chi_square,freedom,draft_percent,standard_percent"
    results.write(HERE / "high_layer.csv", columns.split(","), rows)


def causes() -> None:
    steps = patch.object(import_module("twilight.solvers.zones.alike"), "near_edges", lambda profile, of: profile)
    moments = patch.object(directions, "THIN_MOMENT", directions.LATE_MOMENT)
    rows = []
    for name, patches, points in (
        ("nothing", (), False),
        ("steps along rays and lines of sight", (steps,), False),
        ("degree of the later events", (moments,), False),
        ("both", (steps, moments), False),
        ("both, and one point a step on lines of sight", (steps, moments), True),
    ):
        with ExitStack() as stack:
            for one in patches:
                stack.enter_context(one)
            found = sky("standard", points)
        off = [f"{100.0 * (found[d] / standing(up)[0] - 1.0):.1f}" for d, up in enumerate(ELEVATION_DEG)]
        rows.append([name, *off])
        print(*rows[-1], sep="\t", flush=True)
    columns = ["as_elsewhere", *(f"at_{up:g}_deg_percent" for up in ELEVATION_DEG)]
    results.write(HERE / "high_layer_causes.csv", columns, rows)


if __name__ == "__main__":
    if sys.argv[1:2] == ["referee"]:
        seconds, seeds = [*sys.argv[2:], *("110", "4")[len(sys.argv) - 2 :]][:2]
        referee(float(seconds), int(seeds))
    elif sys.argv[1:2] == ["causes"]:
        causes()
    else:
        compare()
