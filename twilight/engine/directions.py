"""Directions: those of a scene's plain samples, and whether those that are asked for can be."""

from __future__ import annotations

from typing import Any

import numpy as np

from twilight.base.errors import TwilightError
from twilight.engine.table import HIGH_FROM_KM
from twilight.numerics.directions import texture_centres
from twilight.scene.scene import Scene
from twilight.transport.rays import horizon_dip_deg

_NEAR_HORIZON_DEG = np.array([0.04, 0.15, 0.4, 0.9, 1.8, 3.5, 7.0, 14.0, 28.0, 56.0])
"""Distances of rows from the horizon: there the light changes at once, and radiance is evaluated on both sides."""


def equal_grid(scene: Scene) -> tuple[np.ndarray, np.ndarray] | None:
    """Rows (E,) and columns (A,) [deg] of plain samples, where they were asked for or light has noise; else None."""
    texture = scene.configuration.texture
    if not (texture.plain or scene.capabilities.standard_error):
        return None
    return texture_rows(scene), texture_centres(texture.shape)[1]


def texture_rows(scene: Scene) -> np.ndarray:
    """Elevations [deg] of equal rows: those of the sky, and from high up more, to the horizon and the nadir.

    Rows below 0 deg need a solver that serves every observer; they bracket the horizon, whose dip is that of the
    refracted ray that touches the ground.
    """
    rows, _ = texture_centres(scene.configuration.texture.shape)
    above_ground_km = scene.altitude_km - scene.medium.bottom_km
    if above_ground_km <= HIGH_FROM_KM or not scene.capabilities.every_observer:
        return rows
    dip = horizon_dip_deg(scene.medium, scene.altitude_km)
    upper = np.concatenate([-dip + _NEAR_HORIZON_DEG, [0.0]])
    upper = upper[(upper <= 0.0) & (upper < rows[0] - 1e-6)]
    lower = np.append(-dip - _NEAR_HORIZON_DEG, -90.0)
    lower = lower[lower >= -90.0]
    found = np.unique(np.concatenate([lower, upper, rows]))
    return found[np.concatenate([[True], np.diff(found) > 0.02])]


def check_question(sun_elevation_deg: Any, elevation_deg: Any, azimuth_deg: Any) -> None:
    """TwilightError for a sun or directions [deg] that are none."""
    if not _within(sun_elevation_deg, 90.0) or np.ndim(sun_elevation_deg):
        raise TwilightError(f"sun_elevation_deg: must be a number between -90 and 90, got {sun_elevation_deg!r}")
    if not _within(elevation_deg, 90.0 + 1e-9):
        raise TwilightError("elevation_deg: must be numbers between -90 and 90")
    if not _within(azimuth_deg, np.inf):
        raise TwilightError("azimuth_deg: must be finite numbers")


def _within(angle_deg: Any, limit_deg: float) -> bool:
    """Whether all of some angles are finite numbers within -limit_deg to limit_deg."""
    try:
        angle = np.asarray(angle_deg, float)
    except (TypeError, ValueError):
        return False
    return bool((np.isfinite(angle) & (np.abs(angle) <= limit_deg)).all())
