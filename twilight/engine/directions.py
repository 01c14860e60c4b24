"""The directions of a scene's plain samples."""

from __future__ import annotations

import numpy as np

from twilight.engine.table import HIGH_FROM_KM
from twilight.numerics.grids import texture_centres
from twilight.scene.scene import Scene
from twilight.transport.apparent_rays import horizon_dip_deg

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
