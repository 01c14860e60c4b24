"""How smooth the refracted sunbeam is: python benchmarks/smooth_index.py

Writes two tables, both at 550 nm.  benchmarks/smooth_index.csv: the spreading of the beam behind the limb, 1 + L
d(bending)/dp, L = 500 km from the lowest point, of rays traced without any table 0.1 km apart, against their lowest
altitude; its roughness is the difference from the mean of the two neighbours.  benchmarks/smooth_index_tables.csv: how
much the sky of single scattering moves under finer tables of the beam, in per cent over 42 directions
that have light.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import results

from twilight.config.load import load_climate
from twilight.scene.medium import climate_medium
from twilight.solvers import zones
from twilight.transport.beam_tables import full_bending
from twilight.transport.ray_profile import ray_profile

HERE = Path(__file__).parent
CLIMATES = ("pure-air", "continental-average")
SUNS_DEG = (0.0, -4.0, -6.0, -9.0, -12.0)
DENSITIES = (1.0, 1.5, 2.0, 3.0, 4.0)
STEP_KM = 0.1
"""Between the lowest points of the rays [km]."""
BEHIND_KM = 500.0
"""From the lowest point of a ray to where its beam's width is asked for [km]."""


def spreading(medium, lowest_km: np.ndarray) -> np.ndarray:
    """Widening of the beam at BEHIND_KM behind the lowest points of rays, by differences over STEP_KM / 10."""
    profile = ray_profile(medium)
    half = STEP_KM / 20.0
    rays = [(full_bending(profile, 0, z - half), full_bending(profile, 0, z + half)) for z in lowest_km]
    return np.array([1.0 - BEHIND_KM * (b[1] - a[1]) / (b[0] - a[0]) for a, b in rays])


def sky(medium, density: float) -> np.ndarray:
    """Radiance (suns, directions) of light that was scattered once."""
    elevation, azimuth = np.meshgrid([1.5, 4.0, 10.0, 25.0, 45.0, 70.0], [0.0, 10.0, 40.0, 75.0, 110.0, 150.0, 180.0])
    settings = replace(zones.QUALITIES["standard"], max_orders=1, beam_density=density)
    field = zones.prepare(medium, settings)
    return np.stack([field.radiance(sun, elevation.ravel(), azimuth.ravel())[:, 0] for sun in SUNS_DEG])


def main() -> None:
    lowest = np.arange(1.0, 60.0, STEP_KM)
    beams, tables = [], []
    for climate in CLIMATES:
        medium = climate_medium(load_climate(climate), np.array([550.0]))
        wide = spreading(medium, lowest)
        rough = np.abs(wide[1:-1] / (0.5 * (wide[2:] + wide[:-2])) - 1.0)
        print(
            climate,
            "roughness of the spreading, percent: rms",
            100 * np.sqrt(np.mean(rough**2)),
            "max",
            100 * rough.max(),
        )
        rows = zip(lowest[1:-1], wide[1:-1], 100.0 * rough, strict=True)
        beams += [[climate, f"{z:.1f}", f"{s:.4f}", f"{r:.3f}"] for z, s, r in rows]
        skies = [sky(medium, density) for density in DENSITIES]
        for k, density in enumerate(DENSITIES[:-1]):
            for sun, here, finest in zip(SUNS_DEG, skies[k], skies[-1], strict=True):
                lit = finest > 1e-3 * finest.max()
                row = 100.0 * np.abs(here[lit] / finest[lit] - 1.0)
                tables.append([climate, f"{density:g}", f"{sun:g}", *(f"{x:.3f}" for x in (np.median(row), row.max()))])
                print(*tables[-1], sep="\t", flush=True)
    results.write(HERE / "smooth_index.csv", ["climate", "lowest_altitude_km", "spreading", "roughness_percent"], beams)
    results.write(
        HERE / "smooth_index_tables.csv",
        ["climate", "beam_density", "sun_elevation_deg", "median_percent", "max_percent"],
        tables,
    )


if __name__ == "__main__":
    main()
