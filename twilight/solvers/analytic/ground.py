"""The Lambertian ground below an observer who stands on it, for skies that are formulae."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np


def hemisphere(elevations: int = 12, azimuths: int = 24) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Elevation [deg], azimuth [deg] and solid angle [sr] of a product quadrature over the upper hemisphere, (N,).

    Gauss-Legendre in sin(elevation), midpoints in azimuth; exact for polynomials in the sine.
    """
    x, w = np.polynomial.legendre.leggauss(elevations)
    sine, weight = 0.5 * (x + 1.0), 0.5 * w
    azimuth = (np.arange(azimuths) + 0.5) * 360.0 / azimuths
    e, a = np.meshgrid(np.degrees(np.arcsin(sine)), azimuth, indexing="ij")
    solid = np.repeat(weight * 2.0 * np.pi / azimuths, azimuths)
    return e.ravel(), a.ravel(), solid


def ground_radiance(
    sky: Callable[[np.ndarray, np.ndarray], np.ndarray],
    direct: np.ndarray,
    sun_elevation_deg: float,
    albedo: np.ndarray,
) -> np.ndarray:
    """Sun-normalised radiance [sr^-1], (W,), of the ground: albedo / pi times the irradiance of sky and sun.

    sky(elevation_deg, azimuth_deg) gives (N, W); direct (W,) is the sun at normal incidence over F0.
    """
    elevation, azimuth, solid = hemisphere()
    sine = np.sin(np.radians(elevation))
    irradiance = (solid * sine) @ sky(elevation, azimuth) + direct * max(np.sin(np.radians(sun_elevation_deg)), 0.0)
    return albedo / np.pi * irradiance
