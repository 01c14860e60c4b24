"""The sun's disc for an observer: the rows of `twilight.sky.disc.Disc` from the refracted paths of a medium."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from twilight.sky.disc import SOLAR_RADIUS_DEG, Disc
from twilight.transport.ray_profile import passing_at, ray_profile, refractivity_at
from twilight.transport.rays import ApparentRays

if TYPE_CHECKING:
    from twilight.atmosphere.bands import GasBands
    from twilight.atmosphere.medium import Medium
    from twilight.atmosphere.screen import Screen

ROW_DEG = 1.0 / 1200.0
"""Distance of rows: 3 arc seconds, a tenth of what the eye resolves."""
_SEARCH_DEG = 0.01
"""Distance of the elevations among which the disc's upper and lower edge are sought [deg]."""
_LIFTED_DEG = 5.0
"""Largest refraction of the sun that is looked for [deg]: no air of a climate lifts the sun by more."""


def make_disc(
    medium: Medium,
    sun_elevation_deg: float,
    altitude_km: float,
    distance_au: float = 1.0,
    bands: GasBands | None = None,
    radius_deg: float | None = None,
) -> Disc:
    """The disc of a sun at a true elevation [deg], seen from an altitude [km], at the wavelengths of a medium.

    bands: of gases, which take from its light too.  radius_deg: angular, of another body; None: the sun's.
    All images count: where layers of air bend several lines of sight to one point of the disc it is seen several times.
    """
    rays = ApparentRays(medium)
    radius = radius_deg
    if radius is None:
        radius = float(np.degrees(np.arcsin(np.sin(np.radians(SOLAR_RADIUS_DEG)) / distance_au)))
    low, high = sun_elevation_deg - radius - 0.1, min(90.0, sun_elevation_deg + radius + _LIFTED_DEG)
    scan = np.arange(max(low, -90.0), high + _SEARCH_DEG, _SEARCH_DEG)
    scan = scan[scan <= 90.0]
    n = medium.refractivity[0]
    extremes = np.unique([int(np.argmin(n)), int(np.argmax(n))])
    true, passed = rays.follow(altitude_km, scan, extremes)
    hits = ((np.abs(true - sun_elevation_deg) < radius + 5 * _SEARCH_DEG) & (passed > 0.0)).any(axis=1)
    if hits.any():
        first, last = scan[hits][[0, -1]] + np.array([-2.0, 2.0]) * _SEARCH_DEG
    else:  # below the horizon: rows that hold nothing
        first, last = sun_elevation_deg, sun_elevation_deg + 2 * ROW_DEG
    count = int(np.ceil((last - first) / ROW_DEG))
    rows = np.minimum(first + (np.arange(count) + 0.5) * ROW_DEG, 90.0)
    true, passed = follow_rows(medium, altitude_km, rows, bands)
    if not hits.any():
        passed[:] = 0.0
    return Disc(medium.wavelength_nm, rows, true, passed, float(sun_elevation_deg), radius)


def follow_rows(
    medium: Medium, altitude_km: float, rows_deg: np.ndarray, bands: GasBands | None = None
) -> tuple[np.ndarray, np.ndarray]:
    """True elevations [deg] and transmittances (H, W) of rays that arrive under apparent elevations (H,) [deg]."""
    if bands is None:
        true, passed = ApparentRays(medium).follow(altitude_km, rows_deg, np.arange(medium.n_wavelengths))
    else:
        true, passed = ApparentRays(bands.expand(medium)).follow(
            altitude_km, rows_deg, np.arange(bands.wavelength_index.size)
        )
        true, passed = true[:, np.unique(bands.wavelength_index, return_index=True)[1]], bands.sum_terms(passed)
    if medium.screen is not None:
        passed *= _screened(medium, medium.screen, max(altitude_km, medium.bottom_km), rows_deg)
    return true, passed


def _screened(medium: Medium, screen: Screen, altitude_km: float, rows_deg: np.ndarray) -> np.ndarray:
    """What a screen beyond the horizon lets pass (H, W) of rays that arrive under apparent elevations (H,) [deg]."""
    profile, elevation = ray_profile(medium), np.radians(rows_deg)
    found = []
    for w in range(medium.n_wavelengths):
        x = (profile.radius_km + altitude_km) * (1.0 + refractivity_at(profile, w, altitude_km))
        nm = medium.wavelength_nm[w]
        found.append(passing_at(screen, profile, w, nm, x * np.cos(elevation), x * np.sin(elevation)))
    return np.stack(found, axis=1)
