"""Light that leaks along a thin layer high up after sunset: python benchmarks/high_layer.py [referee [SECONDS [SEEDS]]]

A white layer of HG 0.7, 1 km thick, of optical depth 1, at 50 km, above air of optical depth 0.1 and black ground;
scalar theory, no refraction, sun at -6 deg, seen from the ground.

`referee` writes benchmarks/high_layer_referee.csv: the referee's radiance at each of SEEDS seeds (4) that sample for
SECONDS each (110), and its standard error.  Without it benchmarks/high_layer.csv is written: the mean of the seeds, its
standard error, the chi square of the seeds about it, and what `zones` at draft and standard differ by, in per cent.
"""

from __future__ import annotations

import sys
import warnings
from dataclasses import replace
from pathlib import Path

import numpy as np
import results

HERE = Path(__file__).parent
sys.path.insert(0, str(HERE.parent / "tests"))

from layered_sky import layered  # noqa: E402

from twilight.errors import TwilightWarning  # noqa: E402
from twilight.solvers import montecarlo, zones  # noqa: E402

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


def compare() -> None:
    medium, seeds = layered(BASE_KM, THICKNESS_KM, DEPTH), results.read_rows(SEEDS_TABLE)
    skies = []
    for quality in ("draft", "standard"):
        settings = replace(zones.QUALITIES[quality], polarisation=False)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", TwilightWarning)
            field = zones.prepare(medium, settings, sun_elevations_deg=[SUN_DEG])
        skies.append(field.radiance(SUN_DEG, ELEVATION_DEG, AZIMUTH_DEG)[:, 0])
    rows = []
    for d, elevation in enumerate(ELEVATION_DEG):
        of = [row for row in seeds if float(row["elevation_deg"]) == elevation]
        value = np.array([float(row["radiance_per_sr"]) for row in of])
        own = 0.01 * value * np.array([float(row["standard_error_percent"]) for row in of])
        mean = value.mean()
        error = np.sqrt(np.sum(own**2)) / value.size
        chi_square = np.sum(((value - mean) / own) ** 2)
        off = [f"{100.0 * (sky[d] / mean - 1.0):.1f}" for sky in skies]
        rows.append(
            [f"{elevation:g}", f"{mean:.4g}", f"{100.0 * error / mean:.2f}", f"{chi_square:.1f}", value.size - 1, *off]
        )
        print(*rows[-1], sep="\t", flush=True)
    columns = "elevation_deg,referee_per_sr,referee_percent,chi_square,freedom,draft_percent,standard_percent"
    results.write(HERE / "high_layer.csv", columns.split(","), rows)


if __name__ == "__main__":
    if sys.argv[1:2] == ["referee"]:
        seconds, seeds = [*sys.argv[2:], *("110", "4")[len(sys.argv) - 2 :]][:2]
        referee(float(seconds), int(seeds))
    else:
        compare()
