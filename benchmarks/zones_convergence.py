"""How the zones solver converges, one setting at a time: python benchmarks/zones_convergence.py

Writes benchmarks/zones_convergence.csv: the difference of the radiance from a solution in which this setting alone is
finest, all others being those of `standard`; 95th percentile over 42 directions (down to 1.5 deg) and three wavelengths
of the hazy air of benchmarks/reference, in per cent.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import results

from twilight.atmosphere.table import medium_from_table
from twilight.solvers import zones

HERE = Path(__file__).parent
SUNS_DEG = (30.0, 5.0, 0.0, -4.0, -6.0, -9.0, -12.0, -15.0, -18.0)
LADDERS: dict[str, tuple[float, ...]] = {
    "altitude_density": (0.4, 0.7, 1.0, 1.4, 2.0, 2.8),
    "zenith_density": (0.4, 0.7, 1.0, 1.4, 2.0, 2.8),
    "step_density": (0.35, 0.5, 0.7, 1.0, 2.0),
    "polar_directions": (6, 8, 10, 14, 18, 24),
    "azimuth_directions": (7, 9, 11, 15),
    "degree": (6, 8, 12, 16, 20, 28),
    "tolerance": (1e-1, 1e-2, 2e-3, 1e-5),
}
BASE = zones.QUALITIES["standard"]


def sky(medium, setting: str, value: float) -> np.ndarray:
    """Radiance (suns, directions, W)."""
    elevation, azimuth = np.meshgrid([1.5, 4.0, 10.0, 25.0, 45.0, 70.0], [0.0, 10.0, 40.0, 75.0, 110.0, 150.0, 180.0])
    field = zones.prepare(medium, replace(BASE, **{setting: value}))
    return np.stack([field.radiance(sun, elevation.ravel(), azimuth.ravel()) for sun in SUNS_DEG])


def main() -> None:
    medium = medium_from_table(HERE / "reference" / "hazy-air.csv")
    rows = []
    for setting, values in LADDERS.items():
        skies = {value: sky(medium, setting, value) for value in values}
        finest = skies[values[-1]]
        for value in values[:-1]:
            error = 100.0 * np.percentile(np.abs(skies[value] / finest - 1.0), 95, axis=(1, 2))
            rows.append([setting, f"{value:g}", *(f"{x:.3f}" for x in error)])
            print(*rows[-1], sep="\t", flush=True)
    results.write(
        HERE / "zones_convergence.csv", ["setting", "value", *(f"p95_percent_at_{sun:g}" for sun in SUNS_DEG)], rows
    )


if __name__ == "__main__":
    main()
