"""Whether the stated errors of the Monte-Carlo solver are its scatter: python benchmarks/montecarlo_zscores.py

Writes benchmarks/montecarlo_zscores.csv.  Each of RUNS runs of 26 directions, five suns and three wavelengths (390
pixels) asks for TARGET and differs from the others by its seed.  z is a run's difference from the mean of the others
over the standard error of that difference as both state it: its rms is 1 and 0.27 % lie beyond 3 where errors are
normal and right.  Then: the largest stated error over the one asked for; the scatter of the runs of a pixel over the
stated errors, root mean square over pixels; the percentage of values whose error the result itself calls untrusted.
"""

from __future__ import annotations

import sys
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import results
from montecarlo_reference import CLIMATE_DIRECTIONS_DEG

from twilight.config.load import load_climate
from twilight.scene.medium import climate_medium
from twilight.solvers.montecarlo import MonteCarloSettings, prepare

HERE = Path(__file__).parent
SUNS_DEG = (10.0, 0.0, -4.0, -6.0, -12.0)
WAVELENGTHS_NM = (420.0, 550.0, 680.0)
RUNS = 8
TARGET = 0.02
"""Relative standard error asked for."""


def z_scores(value: np.ndarray, error: np.ndarray) -> np.ndarray:
    """Of runs (R, ...) against the mean of the other runs."""
    n = len(value)
    others = (value.sum(axis=0) - value) / (n - 1)
    other_error = np.sqrt((error**2).sum(axis=0) - error**2) / (n - 1)
    return (value - others) / np.sqrt(error**2 + other_error**2)


def main(climates: list[str]) -> None:
    elevation, azimuth = np.array(CLIMATE_DIRECTIONS_DEG).T
    rows = []
    for climate in climates:
        medium = climate_medium(load_climate(climate), np.array(WAVELENGTHS_NM))
        field = prepare(medium, MonteCarloSettings(target_stderr=TARGET))
        by_sun = []
        for sun in SUNS_DEG:
            start = time.process_time()
            found = [
                replace(field, settings=replace(field.settings, seed=100 + run)).radiance_with_error(
                    sun, elevation, azimuth
                )
                for run in range(RUNS)
            ]
            value, error = (np.stack([getattr(f, key) for f in found]) for key in ("radiance", "standard_error"))
            by_sun.append((z_scores(value, error), value, error, np.stack([f.untrusted for f in found])))
            rows.append([climate, f"{sun:g}", *figures(*by_sun[-1]), f"{time.process_time() - start:.1f}"])
            print(*rows[-1], sep="\t", flush=True)
        everything = [np.concatenate(part, axis=1) for part in zip(*by_sun, strict=True)]
        rows.append(
            [climate, "all", *figures(*everything), f"{sum(float(row[-1]) for row in rows[-len(SUNS_DEG) :]):.1f}"]
        )
        print(*rows[-1], sep="\t", flush=True)
    results.write(
        HERE / "montecarlo_zscores.csv",
        [
            "climate",
            "sun_elevation_deg",
            "values",
            "rms_z",
            "beyond_3_percent",
            "largest_z",
            "largest_error_over_asked",
            "true_over_stated_error",
            "untrusted_percent",
            "processor_s",
        ],
        rows,
    )


def figures(z: np.ndarray, value: np.ndarray, error: np.ndarray, untrusted: np.ndarray) -> list[str]:
    """The columns from `values` to `untrusted_percent`."""
    asked = TARGET * value.mean(axis=0)
    scatter = np.sqrt(np.mean(value.var(axis=0, ddof=1) / np.mean(error**2, axis=0)))
    return [
        str(z.size),
        f"{np.sqrt(np.mean(z**2)):.3f}",
        f"{100 * np.mean(np.abs(z) > 3):.2f}",
        f"{np.abs(z).max():.2f}",
        f"{(error / asked).max():.2f}",
        f"{scatter:.3f}",
        f"{100 * untrusted.mean():.2f}",
    ]


if __name__ == "__main__":
    main(sys.argv[1:] or ["continental-average", "desert"])
