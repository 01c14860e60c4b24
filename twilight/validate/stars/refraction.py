"""Lifting of stars by the refraction of the air, for a camera near the ground."""

from __future__ import annotations

import numpy as np

STANDARD_PRESSURE_HPA = 1010.0
STANDARD_TEMPERATURE_C = 10.0
"""Air for which Saemundsson's coefficients hold."""


def refraction_rad(true_elevation_rad: np.ndarray, pressure_hpa: float, temperature_c: float) -> np.ndarray:
    """How much higher than its true elevation a star appears [rad], by Saemundsson (1986, Sky & Telescope 72, 70).

    R = 1.02' / tan(h + 10.3 / (h + 5.11)), h in deg, times P / 1010 hPa * 283 K / T; good to 0.1' down to the
    horizon.  Below -1 deg, where no star is seen, the value at -1 deg is taken.
    """
    h = np.maximum(np.degrees(true_elevation_rad), -1.0)
    standard = 1.02 / np.tan(np.radians(h + 10.3 / (h + 5.11)))
    air = pressure_hpa / STANDARD_PRESSURE_HPA * (273.15 + STANDARD_TEMPERATURE_C) / (273.15 + temperature_c)
    return np.radians(np.maximum(standard, 0.0) * air / 60.0)


def lifted(directions: np.ndarray, zenith: np.ndarray, pressure_hpa: float, temperature_c: float) -> np.ndarray:
    """Unit vectors (..., 3) turned towards the zenith (3,), a unit vector in the same frame, by the refraction."""
    height = directions @ zenith
    flat = directions - height[..., None] * zenith
    across = np.linalg.norm(flat, axis=-1)
    elevation = np.arctan2(height, across)
    apparent = elevation + refraction_rad(elevation, pressure_hpa, temperature_c)
    with np.errstate(divide="ignore", invalid="ignore"):
        unit = np.where(across[..., None] > 0, flat / across[..., None], 0.0)
    return np.cos(apparent)[..., None] * unit + np.sin(apparent)[..., None] * zenith


def pressure_at_hpa(altitude_km: float) -> float:
    """Pressure of the standard atmosphere near the ground, 1013.25 exp(-h / 8.4 km)."""
    return float(1013.25 * np.exp(-altitude_km / 8.4))
