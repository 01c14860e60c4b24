"""The splines of `twilight.solvers.compact.compact_sky` over the sky that come nearest to given values."""

from __future__ import annotations

import numpy as np

from twilight.solvers.compact.compact_sky import SkySplines

SMOOTH = 1e-3
"""Weight of the curvature of the splines' coefficients: it decides only where data do not."""

TIE = 1e-5
"""Weight of the size of the coefficients, which decides how light is divided between the splines over elevation and
azimuth and those around the sun."""


def spline_coefficients(
    grid: SkySplines,
    sun_elevation_deg: float,
    elevation_deg: np.ndarray,
    azimuth_deg: np.ndarray,
    logarithm: np.ndarray,
) -> np.ndarray:
    """Coefficients (K, N) of the splines over the sky that come nearest to logarithms (D, N) in directions (D,)."""
    index, value = grid.splines(sun_elevation_deg, elevation_deg, azimuth_deg)
    n = elevation_deg.size
    design = np.zeros((n, grid.size))
    np.add.at(design, (np.arange(n), index), value)
    return np.linalg.solve(design.T @ design / n + _penalty(grid), design.T @ logarithm / n)


def _penalty(grid: SkySplines) -> np.ndarray:
    """Quadratic form (K, K) of curvature and size of the coefficients."""
    rows, columns, rings = grid.elevation_intervals + 3, grid.azimuth_intervals + 1, grid.angle_intervals + 3
    curved = [_second_differences(n) for n in (rows, columns, rings)]
    split = rows * columns
    out = np.zeros((grid.size, grid.size))
    out[:split, :split] = np.kron(curved[0], np.eye(columns)) + np.kron(np.eye(rows), curved[1])
    out[:split, :split] *= SMOOTH / split
    out[split:, split:] = SMOOTH / rings * curved[2]
    return out + TIE / grid.size * np.eye(grid.size)


def _second_differences(n: int) -> np.ndarray:
    d = np.diff(np.eye(n), 2, axis=0)
    return d.T @ d
