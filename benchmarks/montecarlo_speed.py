"""Seconds to 1 % standard error with the Monte-Carlo solver: one direction, one wavelength, one thread.

    python benchmarks/montecarlo_speed.py [CLIMATE]

The solver runs a fixed number of samples; the time to 1 % is time x (relative error / 1 %)^2.  Prints a CSV table
(committed as benchmarks/montecarlo_speed.csv).
"""

from __future__ import annotations

import sys
import time
from dataclasses import replace

import numba
import numpy as np

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


def main(climate: str) -> None:
    """Print the table."""
    numba.set_num_threads(1)
    medium = climate_medium(load_climate(climate), np.array([WAVELENGTH_NM]))
    settings = MonteCarloSettings(target_stderr=None, samples=SAMPLES)
    started = time.process_time()
    prepare(medium, settings).radiance(1.0, 1.0, 1.0)
    compiled = time.process_time() - started
    started = time.process_time()
    field = prepare(medium, settings)
    print(
        f"# {climate}, {WAVELENGTH_NM:g} nm; first call {compiled:.0f} s, prepare {time.process_time() - started:.1f} s"
    )
    print("sun_elevation_deg," + ",".join(f"{name} [s]" for name in VIEWS) + ",median [s],microseconds per sample")
    for sun in SUNS_DEG:
        seconds, cost = [], []
        for elevation, azimuth in VIEWS.values():
            runs = []
            for seed in (1, 2, 3):
                begin = time.process_time()
                r = replace(field, settings=replace(settings, seed=seed)).radiance_with_error(sun, elevation, azimuth)
                cost.append((time.process_time() - begin) / r.samples[0])
                runs.append((r.standard_error[0] / r.radiance[0]) ** 2 * r.samples[0] / 0.01**2)
            seconds.append(np.mean(runs) * np.median(cost))
        row = ",".join(f"{s:.4f}" for s in (*seconds, np.median(seconds)))
        print(f"{sun:g},{row},{1e6 * np.median(cost):.0f}", flush=True)


if __name__ == "__main__":
    main(sys.argv[1] if len(sys.argv) > 1 else "continental-average")
