"""Lifting of stars by the refraction of the air, for a camera near the ground."""

from __future__ import annotations

import numpy as np

STANDARD_PRESSURE_HPA = 1010.0
STANDARD_TEMPERATURE_C = 10.0
"""Air for which Bennett's coefficients hold."""
LOWEST_DEG = -1.0
_STEPS = 6
"""Steps of the iteration from true to apparent elevations, whose error falls to a sixth or less with each."""


def refraction_rad(true_elevation_rad: np.ndarray, pressure_hpa: float, temperature_c: float) -> np.ndarray:
    """How much higher than its true elevation a star appears [rad], by Bennett (1982, Journal of Navigation 35, 255).

    R = 1 / tan(h + 7.31 / (h + 4.4)), R - 0.06 sin(14.7 R + 13), in arcmin with h the apparent elevation in deg and the
    sine's argument in deg, times P / 1010 hPa * 283 K / T; good to 0.015' in that air, from the zenith to the horizon.
    Below -1 deg, where no star is seen, the value at -1 deg is taken.
    """
    true = np.maximum(np.degrees(true_elevation_rad), LOWEST_DEG)
    air = pressure_hpa / STANDARD_PRESSURE_HPA * (273.15 + STANDARD_TEMPERATURE_C) / (273.15 + temperature_c)
    lift = np.zeros_like(true)
    for _ in range(_STEPS):
        h = true + lift
        r = 1.0 / np.tan(np.radians(h + 7.31 / (h + 4.4)))
        lift = np.maximum(r - 0.06 * np.sin(np.radians(14.7 * r + 13.0)), 0.0) * air / 60.0
    return np.radians(lift)


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
