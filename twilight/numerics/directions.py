"""Directions in the world: how a camera is turned, and the grids of directions that whole skies are computed on.

World axes are east, north, up.  A camera's own axes are right, forward (the optical axis) and up (of the picture): the
same as the world's for a level camera that looks north.
"""

from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike

HEMISPHERE_ROWS = 12
"""Nodes of `whole_hemisphere` below the sun's elevation, and as many above it (uniform skies: test_light.py)."""
HEMISPHERE_COLUMNS = 20
"""Nodes over the azimuths of either half of `whole_hemisphere`."""
LOWEST_NODE_DEG = 6.0
"""Least elevation of the sun [deg] that parts the hemisphere's nodes in two: for lower suns the nodes stand still."""
HIGHEST_NODE_DEG = 84.0
"""Greatest elevation of the sun [deg] that parts them: for higher suns they stand still too."""


def direction(azimuth_deg: np.ndarray | float, elevation_deg: np.ndarray | float) -> np.ndarray:
    """Unit vectors (..., 3) east, north, up; azimuth clockwise from north."""
    azimuth, elevation = np.radians(azimuth_deg), np.radians(elevation_deg)
    flat = np.cos(elevation)
    parts = (np.sin(azimuth) * flat, np.cos(azimuth) * flat, np.sin(elevation))
    return np.stack(np.broadcast_arrays(*parts), axis=-1)


def azimuth_elevation(directions: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(azimuth_deg in [0, 360), elevation_deg) of vectors (..., 3) east, north, up of any length."""
    east, north, up = np.moveaxis(np.asarray(directions, dtype=float), -1, 0)
    azimuth = np.mod(np.degrees(np.arctan2(east, north)), 360.0)
    return np.where(azimuth >= 360.0, 0.0, azimuth), np.degrees(np.arctan2(up, np.hypot(east, north)))


def camera_axes(azimuth_deg: float, elevation_deg: float, roll_deg: float) -> np.ndarray:
    """Rotation (3, 3) from the world to the camera: its rows are the camera's right, forward and up in the world.

    azimuth_deg, elevation_deg: of the optical axis.  roll_deg: the camera is turned clockwise about its axis as its
    photographer sees it, so that the horizon in the picture turns anticlockwise.  Towards the zenith (90 deg) with
    roll 0 the bottom of the picture lies towards ``azimuth_deg``.
    """
    forward = direction(azimuth_deg, elevation_deg)
    azimuth, roll = np.radians(azimuth_deg), np.radians(roll_deg)
    level_right = np.array([np.cos(azimuth), -np.sin(azimuth), 0.0])
    level_up = np.cross(level_right, forward)
    right = np.cos(roll) * level_right - np.sin(roll) * level_up
    up = np.sin(roll) * level_right + np.cos(roll) * level_up
    return np.stack([right, forward, up])


def orientation_angles(axes: np.ndarray) -> tuple[float, float, float]:
    """(azimuth_deg in [0, 360), elevation_deg, roll_deg in -180..180) of `camera_axes`; a matrix (3, 3).

    At the zenith and the nadir, where azimuth and roll cannot be told apart, roll is 0.
    """
    right, forward, up = np.asarray(axes, dtype=float)
    elevation = np.degrees(np.arctan2(forward[2], np.hypot(forward[0], forward[1])))
    if np.hypot(forward[0], forward[1]) < 1e-12:
        return float(np.mod(np.degrees(np.arctan2(-right[1], right[0])), 360.0)), float(elevation), 0.0
    azimuth = np.mod(np.degrees(np.arctan2(forward[0], forward[1])), 360.0)
    roll = np.degrees(np.arctan2(-right[2], up[2]))
    return float(azimuth % 360.0), float(elevation), float(roll)


PHASE_COUNT = 1024
"""Angles at which the phase function of a column is tabulated: pi u^2 with u = 0 to 1, closest at the sun."""

PHASE_ANGLE_RAD = np.pi * np.linspace(0.0, 1.0, PHASE_COUNT) ** 2
"""Scattering angles at which the phase function of a column is tabulated [rad]."""


def scattering_angle_rad(sun_deg: ArrayLike, elevation_deg: ArrayLike, azimuth_deg: ArrayLike) -> np.ndarray:
    """Angle between directions and a sun in azimuth 0 [rad]; all broadcast.  Precise at small angles (haversine)."""
    e, s, a = (np.radians(np.asarray(x, float)) for x in (elevation_deg, sun_deg, azimuth_deg))
    chord = np.sin((e - s) / 2) ** 2 + np.cos(e) * np.cos(s) * np.sin(a / 2) ** 2
    return 2.0 * np.arcsin(np.sqrt(np.clip(chord, 0.0, 1.0)))


def texture_centres(shape: tuple[int, int]) -> tuple[np.ndarray, np.ndarray]:
    """Row and column centres (elevation_deg, azimuth_deg) of a hemisphere texture of (rows, columns)."""
    rows, columns = shape
    return (np.arange(rows) + 0.5) * (90.0 / rows), np.arange(columns) * (360.0 / columns)


def half_of(azimuth_deg: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The columns on one side of the sun's vertical that stand for all: a sky is its own mirror image about it.

    Returns (columns with azimuths from 0 to 180 deg, in this order (H,); for every column the place among them (A,)).
    """
    folded = np.round(np.minimum(azimuth_deg, 360.0 - azimuth_deg), 9)
    _, column, back = np.unique(folded, return_index=True, return_inverse=True)
    return column, back


def hemisphere(
    sun_elevation_deg: float, rows: int = 24, columns: int = 20
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Directions (elevation, azimuth) [deg] and weights whose sum over radiance is horizontal irradiance, each (D,).

    Gauss-Legendre in sin^2 of the elevation, with the sun's elevation as an edge, and in the root of the azimuth: dense
    about the sun; 2e-4 in continental air.  The other half of the sky is the mirror image.
    """
    edge = float(np.sin(np.radians(min(max(sun_elevation_deg, 0.0), 90.0))) ** 2)
    edges = [0.0, edge, 1.0] if 0.01 < edge < 0.99 else [0.0, 1.0]
    x, w = np.polynomial.legendre.leggauss(rows // (len(edges) - 1))
    square, row_weight = [], []
    for low, high in pairwise(edges):
        square.append(low + 0.5 * (high - low) * (x + 1))
        row_weight.append(0.5 * (high - low) * w)
    s, sw = np.concatenate(square), np.concatenate(row_weight)
    u, uw = np.polynomial.legendre.leggauss(columns)
    root = 0.5 * (u + 1)
    azimuth, aw = np.pi * root**2, np.pi * root * uw
    grid = np.meshgrid(np.degrees(np.arcsin(np.sqrt(s))), np.degrees(azimuth), indexing="ij")
    # cos dOmega = d(sin^2)/2 dA, both halves
    return grid[0].ravel(), grid[1].ravel(), np.outer(sw, aw).ravel()


def whole_hemisphere(sun_elevation_deg: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Elevations, azimuths from the sun [deg] and solid angles [sr] of both halves of the upper hemisphere.

    Gauss-Legendre in the sine of the elevation, below and above the sun, and in the root of the azimuth.
    """
    edge = np.sin(np.radians(np.clip(sun_elevation_deg, LOWEST_NODE_DEG, HIGHEST_NODE_DEG)))
    x, w = np.polynomial.legendre.leggauss(HEMISPHERE_ROWS)
    sine = np.concatenate([0.5 * edge * (x + 1.0), edge + 0.5 * (1.0 - edge) * (x + 1.0)])
    height = np.concatenate([0.5 * edge * w, 0.5 * (1.0 - edge) * w])
    u, uw = np.polynomial.legendre.leggauss(HEMISPHERE_COLUMNS)
    root = 0.5 * (u + 1.0)
    grid = np.meshgrid(np.degrees(np.arcsin(sine)), np.degrees(np.pi * root**2), indexing="ij")
    elevation, azimuth = grid[0].ravel(), grid[1].ravel()
    solid = np.outer(height, np.pi * root * uw).ravel()
    return np.tile(elevation, 2), np.concatenate([azimuth, -azimuth]), np.tile(solid, 2)
