"""Seconds to 1 % standard error with the Monte-Carlo solver: one direction, one wavelength, one thread.

    python benchmarks/montecarlo_speed.py [CLIMATE]      writes montecarlo_speed.csv

The solver runs a fixed number of samples; the time to 1 % is time x (relative error / 1 %)^2, in processor time.
"""

from __future__ import annotations

import sys
import time
from dataclasses import replace

import numba
import numpy as np
import results

from twilight.config.load import load_climate
from twilight.scene.medium import climate_medium
from twilight.solvers.montecarlo import MonteCarloSettings, prepare

WAVELENGTH_NM = 550.0
SUNS_DEG = (30.0, 10.0, 0.0, -4.0, -6.0, -9.0, -12.0, -15.0, -18.0)
VIEWS = {
    "zenith": (90.0, 0.0),
    "10 deg sunward": (10.0, 0.0),
    "10 deg antisolar": (10.0, 180.0),
    "(45, 90)": (45.0, 90.0),
}
SAMPLES = 400
"""Samples of a run, each of 8 paths."""
SEEDS = (1, 2, 3, 4)


def seconds(field, sun: float, settings) -> tuple[list[float], float]:
    """(seconds to 1 % in every view, seconds of a sample)."""
    found, cost = [], []
    for elevation, azimuth in VIEWS.values():
        runs = []
        for seed in SEEDS:
            begin = time.process_time()
            r = replace(field, settings=replace(settings, seed=seed)).radiance_with_error(sun, elevation, azimuth)
            cost.append((time.process_time() - begin) / r.samples[0])
            runs.append((r.standard_error[0] / r.radiance[0]) ** 2 * r.samples[0] / 0.01**2)
        found.append(float(np.mean(runs)))
    return [x * float(np.median(cost)) for x in found], float(np.median(cost))


def compiled_medium(climate: str):
    """The air at one wavelength, after a run that compiles."""
    numba.set_num_threads(1)
    medium = climate_medium(load_climate(climate), np.array([WAVELENGTH_NM]))
    prepare(medium, MonteCarloSettings(target_stderr=None, samples=8)).radiance(1.0, 1.0, 1.0)
    return medium


def main(climate: str) -> None:
    medium = compiled_medium(climate)
    settings = MonteCarloSettings(target_stderr=None, samples=SAMPLES)
    started = time.process_time()
    field = prepare(medium, settings)
    notes = [f"{climate}, {WAVELENGTH_NM:g} nm; prepare {time.process_time() - started:.1f} s"]
    rows = []
    for sun in SUNS_DEG:
        found, cost = seconds(field, sun, settings)
        rows.append([f"{sun:g}", *(f"{s:.4f}" for s in (*found, np.median(found))), f"{1e6 * cost:.0f}"])
        print(*rows[-1], sep="\t", flush=True)
    columns = ["sun_elevation_deg", *(f"{name} [s]" for name in VIEWS), "median [s]", "microseconds per sample"]
    results.write(results.FOLDER / "montecarlo_speed.csv", columns, rows, notes=notes)


if __name__ == "__main__":
    main(sys.argv[1] if len(sys.argv) > 1 else "continental-average")
