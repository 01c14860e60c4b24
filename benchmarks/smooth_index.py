"""How smooth the refracted sunbeam is: python benchmarks/smooth_index.py

Writes benchmarks/smooth_index.csv, at 550 nm: the spreading of the beam behind the limb, 1 + L d(bending)/dp, L = 500
km from the lowest point, of rays traced without any table 0.1 km apart, against their lowest altitude; its roughness is
the difference from the mean of the two neighbours.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import results

from twilight.config.load import load_climate
from twilight.scene.medium import climate_medium
from twilight.transport.beam_tables import full_bending
from twilight.transport.ray_profile import ray_profile

HERE = Path(__file__).parent
CLIMATES = ("pure-air", "continental-average")
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


def main() -> None:
    lowest = np.arange(1.0, 60.0, STEP_KM)
    beams = []
    for climate in CLIMATES:
        medium = climate_medium(load_climate(climate), np.array([550.0]))
        wide = spreading(medium, lowest)
        rough = np.abs(wide[1:-1] / (0.5 * (wide[2:] + wide[:-2])) - 1.0)
        rms = 100.0 * np.sqrt(np.mean(rough**2))
        print(f"{climate}: roughness of the spreading {rms:.3g} % rms, {100.0 * rough.max():.3g} % at most")
        rows = zip(lowest[1:-1], wide[1:-1], 100.0 * rough, strict=True)
        beams += [[climate, f"{z:.1f}", f"{s:.4f}", f"{r:.3f}"] for z, s, r in rows]
    results.write(HERE / "smooth_index.csv", ["climate", "lowest_altitude_km", "spreading", "roughness_percent"], beams)


if __name__ == "__main__":
    main()
