"""What bending does to the sky: python benchmarks/zones_bending.py writes benchmarks/zones_bending.csv.

Change of the radiance in per cent (median, 5th and 95th percentile over 42 directions, three wavelengths) when light is
bent on its paths between scattering events, and when lines of sight are bent as well as straight ones; the sunbeam is
refracted in all.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import results

from twilight.config.load import load_climate
from twilight.scene.medium import climate_medium
from twilight.solvers import zones

HERE = Path(__file__).parent
SUNS_DEG = (30.0, 5.0, 0.0, -4.0, -6.0, -9.0, -12.0, -15.0, -18.0)


def sky(medium, **change) -> np.ndarray:
    """Radiance (suns, directions, W)."""
    elevation, azimuth = np.meshgrid([1.5, 4.0, 10.0, 25.0, 45.0, 70.0], [0.0, 10.0, 40.0, 75.0, 110.0, 150.0, 180.0])
    field = zones.prepare(medium, replace(zones.QUALITIES["standard"], **change))
    return np.stack([field.radiance(sun, elevation.ravel(), azimuth.ravel()) for sun in SUNS_DEG])


def main() -> None:
    rows = []
    for climate in ("pure-air", "continental-average"):
        medium = climate_medium(load_climate(climate), np.array([450.0, 550.0, 680.0]))
        straight = sky(medium, bent_lines_of_sight=False, bent_paths=False)
        sight = sky(medium, bent_lines_of_sight=True, bent_paths=False)
        both = sky(medium)
        for name, one, other in (("paths", both, sight), ("lines of sight", sight, straight)):
            change = 100.0 * (one / other - 1.0)
            for sun, values in zip(SUNS_DEG, change, strict=True):
                numbers = (np.median(values), *np.percentile(values, [5, 95]))
                rows.append([climate, name, f"{sun:g}", *(f"{x:.2f}" for x in numbers)])
                print(*rows[-1], sep="\t", flush=True)
    results.write(
        HERE / "zones_bending.csv",
        ["climate", "bent", "sun_elevation_deg", "median_percent", "p5_percent", "p95_percent"],
        rows,
    )


if __name__ == "__main__":
    main()
