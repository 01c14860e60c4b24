"""Grids of directions that whole skies are computed on."""

from __future__ import annotations

import numpy as np

from twilight.base.errors import TwilightError


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
