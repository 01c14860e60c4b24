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


def sky_and_ground(
    sky: Callable[[np.ndarray, np.ndarray], np.ndarray],
    sunlight: Callable[[], np.ndarray],
    sun_elevation_deg: float,
    albedo: np.ndarray,
    elevation_deg,
    azimuth_deg,
) -> np.ndarray:
    """Sun-normalised radiance [sr^-1], shape of the directions plus (W,), of the sky and, below the horizon, of the
    ground: albedo / pi times the irradiance of sky and sun.

    sky(elevation_deg, azimuth_deg) gives (N, W); sunlight() the direct sunlight at normal incidence over F0, (W,).
    """
    elevation, azimuth = np.broadcast_arrays(np.asarray(elevation_deg, float), np.asarray(azimuth_deg, float))
    e, a = elevation.ravel(), azimuth.ravel()
    out = np.empty((e.size, albedo.size))
    up = e >= 0.0
    out[up] = sky(e[up], a[up])
    if not up.all():
        sky_e, sky_a, solid = hemisphere()
        sine = np.sin(np.radians(sky_e))
        direct = sunlight() * max(np.sin(np.radians(sun_elevation_deg)), 0.0)
        out[~up] = albedo / np.pi * ((solid * sine) @ sky(sky_e, sky_a) + direct)
    return out.reshape(*elevation.shape, albedo.size)
