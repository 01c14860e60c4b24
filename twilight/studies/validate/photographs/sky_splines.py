"""Cubic B-splines over the sky: their sums on a grid, and the sums that come nearest to given values.

For the sun at elevation s, of which 20 are not 0 in a direction at elevation e and azimuth a from the sun:

    (n_e + 3) x (n_a + 1)  products of splines over (e / 90)^(1 / p) n_e and over a / 180 n_a, even in a at both ends
    n_t + 3                splines over ln(1 + T / t0) / ln(1 + 180 / t0) n_t, T the angle from the sun [deg]
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

SMOOTH = 1e-3
"""Weight of the curvature of the splines' coefficients: it decides only where data do not."""

TIE = 1e-5
"""Weight of the size of the coefficients, which decides how light is divided between the splines over elevation and
azimuth and those around the sun."""


@dataclass(frozen=True)
class SkySplines:
    """The splines over the sky: n_e, n_a, n_t, p and t0 of the module's docstring."""

    elevation_intervals: int
    azimuth_intervals: int
    angle_intervals: int
    elevation_power: float
    angle_scale_deg: float

    @property
    def size(self) -> int:
        """K, the number of splines."""
        return (self.elevation_intervals + 3) * (self.azimuth_intervals + 1) + self.angle_intervals + 3

    def splines(self, sun_elevation_deg: float, elevation_deg, azimuth_deg) -> tuple[np.ndarray, np.ndarray]:
        """(index (20, D), value (20, D)) of the splines that are not 0, for directions (D,) [deg]."""
        n_e, n_a = self.elevation_intervals, self.azimuth_intervals
        (row, of_row), (column, of_column) = self._rows(elevation_deg), self._columns(azimuth_deg)
        ring, of_ring = self._rings(sun_elevation_deg, elevation_deg, azimuth_deg)
        index = np.concatenate(
            [(row[:, None] * (n_a + 1) + column[None]).reshape(16, -1), (n_e + 3) * (n_a + 1) + ring]
        )
        value = np.concatenate([(of_row[:, None] * of_column[None]).reshape(16, -1), of_ring])
        return index, value

    def on_rows_and_columns(
        self, sun_elevation_deg: float, elevation_deg: np.ndarray, azimuth_deg: np.ndarray, coefficients: np.ndarray
    ) -> np.ndarray:
        """The sums (E, A, V) of coefficients (K, V) times splines on a grid of elevations (E,) and azimuths (A,) [deg].

        The products of splines are two multiplications of matrices there.
        """
        n_rows, n_columns = self.elevation_intervals + 3, self.azimuth_intervals + 1
        over_e = _dense(*self._rows(elevation_deg), n_rows)
        over_a = _dense(*self._columns(azimuth_deg), n_columns)
        of_sky = coefficients[: n_rows * n_columns].reshape(n_rows, n_columns, -1)
        half = np.tensordot(over_a, of_sky, (1, 1))  # (A, rows, V)
        out = np.ascontiguousarray(np.tensordot(over_e, half, (1, 1)))
        e, a = np.meshgrid(elevation_deg, azimuth_deg, indexing="ij")
        ring, of_ring = self._rings(sun_elevation_deg, e.ravel(), a.ravel())
        around = coefficients[n_rows * n_columns :]
        flat = out.reshape(-1, out.shape[-1])
        for rows, weight in zip(ring, of_ring, strict=True):
            flat += weight[:, None] * around[rows]
        return out

    def _rows(self, elevation_deg) -> tuple[np.ndarray, np.ndarray]:
        """Index and value (4, D) of the splines over elevations (D,) [deg] that are not 0."""
        e, n_e = np.asarray(elevation_deg, float), self.elevation_intervals
        return _bspline((np.clip(e, 0.0, 90.0) / 90.0) ** (1.0 / self.elevation_power) * n_e, n_e)

    def _columns(self, azimuth_deg) -> tuple[np.ndarray, np.ndarray]:
        """Index and value (4, D) over azimuths (D,) [deg], which are mirrored at 0 and 180 deg."""
        n_a = self.azimuth_intervals
        column, of_column = _bspline(_folded(azimuth_deg) / 180.0 * n_a, n_a)
        column = np.abs(column - 1)
        return np.where(column > n_a, 2 * n_a - column, column), of_column

    def _rings(self, sun_elevation_deg: float, elevation_deg, azimuth_deg) -> tuple[np.ndarray, np.ndarray]:
        """Index and value (4, D) over the angle from the sun, of directions (D,)."""
        e, n_t = np.asarray(elevation_deg, float), self.angle_intervals
        half_e, half_a = np.radians(0.5 * (e - sun_elevation_deg)), np.radians(0.5 * _folded(azimuth_deg))
        cosines = np.cos(np.radians(e)) * np.cos(np.radians(sun_elevation_deg))
        haversine = np.sin(half_e) ** 2 + cosines * np.sin(half_a) ** 2
        angle = np.degrees(2.0 * np.arcsin(np.sqrt(np.clip(haversine, 0.0, 1.0))))
        return _bspline(np.log1p(angle / self.angle_scale_deg) / np.log1p(180.0 / self.angle_scale_deg) * n_t, n_t)


def _folded(azimuth_deg) -> np.ndarray:
    """Azimuths from the sun within 0 to 180 deg."""
    return np.abs(np.mod(np.asarray(azimuth_deg, float) + 180.0, 360.0) - 180.0)


def _dense(index: np.ndarray, value: np.ndarray, n: int) -> np.ndarray:
    """Splines (4, D) as a matrix (D, n); two of them may be the same one, mirrored."""
    out = np.zeros((index.shape[1], n))
    for column, one in zip(index, value, strict=True):
        out[np.arange(index.shape[1]), column] += one
    return out


def _bspline(x: np.ndarray, n: int) -> tuple[np.ndarray, np.ndarray]:
    """Index (4, D) and value (4, D) of the uniform cubic B-splines at x from 0 to n."""
    first = np.minimum(x.astype(np.int64), n - 1)
    u = x - first
    v = 1.0 - u
    value = np.stack([v**3, 3.0 * u**3 - 6.0 * u**2 + 4.0, 3.0 * v**3 - 6.0 * v**2 + 4.0, u**3]) / 6.0
    return first + np.arange(4)[:, None], value


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
