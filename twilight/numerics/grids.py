"""Grids of directions that whole skies are computed on."""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from twilight.base.errors import TwilightError

HEMISPHERE_ROWS = 12
"""Nodes of `whole_hemisphere` below the sun's elevation, and as many above it (uniform skies: test_light.py)."""
HEMISPHERE_COLUMNS = 20
"""Nodes over the azimuths of either half of `whole_hemisphere`."""
LOWEST_NODE_DEG = 6.0
"""Least elevation of the sun [deg] that parts the hemisphere's nodes in two: for lower suns the nodes stand still."""
HIGHEST_NODE_DEG = 84.0
"""Greatest elevation of the sun [deg] that parts them: for higher suns they stand still too."""


def texture_centres(shape: tuple[int, int]) -> tuple[np.ndarray, np.ndarray]:
    """Row and column centres (elevation_deg, azimuth_deg) of a hemisphere texture of (rows, columns)."""
    rows, columns = shape
    return (np.arange(rows) + 0.5) * (90.0 / rows), np.arange(columns) * (360.0 / columns)


def texture_grid(step_deg: float = 3.0) -> tuple[np.ndarray, np.ndarray]:
    """Row and column centres (elevation_deg, azimuth_deg) of the hemisphere texture: 30 x 120 at the default 3 deg.

    Raises TwilightError unless the step divides 90 deg.
    """
    rows = round(90.0 / step_deg) if step_deg > 0 else 0
    if rows < 1 or abs(rows * step_deg - 90.0) > 1e-9:
        raise TwilightError(f"step_deg: {step_deg:g} deg must be positive and divide 90 deg")
    return texture_centres((rows, 4 * rows))


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
