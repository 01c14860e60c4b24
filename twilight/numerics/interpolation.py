"""Interpolation on a grid of directions: rows of elevations, columns of azimuths uniform over the circle; a spline.

Functions of a grid take elevations of rows (E,), increasing, azimuths of columns (A,), values on it, and directions.
"""

from __future__ import annotations

import numpy as np

from twilight.numerics.spectrum import hermite_matrix, hermite_weights

_CHUNK_VALUES = 8_000_000
"""Values of a temporary array handled at once, so that large pictures need little memory."""


def interpolate_bilinear(
    row_deg: np.ndarray, column_deg: np.ndarray, values: np.ndarray, elevation_deg: np.ndarray, azimuth_deg: np.ndarray
) -> np.ndarray:
    """Values (E, A, W) >= 0 in any direction, (..., W) for broadcast elevation and azimuth.

    Bilinear in the logarithm (linear where a neighbour is 0); wraps in azimuth; above the last row it goes to one
    value in the zenith, the mean of that row; below the first row it is continued by at most half a row, then held.
    """
    elevation, azimuth = np.broadcast_arrays(elevation_deg, azimuth_deg)
    shape, n_w = elevation.shape, values.shape[2]
    elevation, azimuth = elevation.ravel(), azimuth.ravel()
    rows, values = _to_zenith(row_deg, values)
    with np.errstate(divide="ignore"):
        logarithm = np.log(values)
    out = np.empty((elevation.size, n_w), dtype=values.dtype)
    chunk = max(1, _CHUNK_VALUES // (4 * n_w))
    for start in range(0, elevation.size, chunk):
        part = slice(start, start + chunk)
        low, high, left, right, u, v = _place(rows, column_deg, elevation[part], azimuth[part], -0.5)
        result = _mix(logarithm, low, high, left, right, u, v)
        exact = np.isfinite(result)
        result = np.exp(result)
        if not exact.all():
            # A neighbour is 0: linear there (held, not continued, below the first row).
            linear = _mix(values, low, high, left, right, np.maximum(u, 0.0), v)
            result = np.where(exact, result, linear)
        out[part] = result
    return out.reshape(*shape, n_w)


def interpolate_stokes(
    row_deg: np.ndarray, column_deg: np.ndarray, values: np.ndarray, elevation_deg: np.ndarray, azimuth_deg: np.ndarray
) -> np.ndarray:
    """Q and U (E, A, 2, W), relative to the vertical plane, in any direction, (..., 2, W).

    Bilinear, held below the first row.  In the zenith the vertical plane turns with the azimuth, and Q + iU with twice
    its angle: there the mean of the last row, each column turned to azimuth 0, is turned to every column.
    """
    elevation, azimuth = np.broadcast_arrays(np.asarray(elevation_deg, float), np.asarray(azimuth_deg, float))
    q, u = np.moveaxis(values, 2, 0)
    linear, rows = q + 1j * u, row_deg
    turn = np.exp(2j * np.radians(column_deg))[:, None]
    zenith = (linear[-1] / turn).mean(axis=0) * turn
    if rows[-1] < 90.0 - 1e-9:
        linear, rows = np.concatenate([linear, zenith[None]]), np.append(rows, 90.0)
    else:
        linear[-1] = zenith
    found = _mix(linear, *_place(rows, column_deg, elevation.ravel(), azimuth.ravel(), 0.0))
    found = found.reshape(*elevation.shape, -1)
    return np.stack([found.real, found.imag], axis=-2)


def _to_zenith(row_deg: np.ndarray, values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Elevations and values of the rows, with a row in the zenith added where there is none."""
    top = values[-1]
    with np.errstate(divide="ignore"):
        zenith = np.where((top > 0).all(axis=0), np.exp(np.log(top).mean(axis=0)), top.mean(axis=0))
    if row_deg[-1] >= 90 - 1e-9:
        values = values.copy()
        values[-1] = zenith.astype(values.dtype)
        return row_deg, values
    zenith = np.broadcast_to(zenith.astype(values.dtype), (1, *top.shape))
    return np.append(row_deg, 90.0), np.concatenate([values, zenith])


def _place(rows, column_deg, elevation, azimuth, least):
    """(row below, row above, column left, column right) of directions (N,), and fractions (N, 1) u, v of the way.

    u between the rows is at least `least`, v between the columns.
    """
    n = column_deg.size
    position = np.mod(azimuth - column_deg[0], 360.0) * (n / 360.0)
    left = np.floor(position)
    v = (position - left)[:, None]
    left = left.astype(int) % n
    right = (left + 1) % n
    if rows.size == 1:
        low = high = np.zeros(elevation.size, int)
        return low, high, left, right, np.zeros((elevation.size, 1)), v
    low = np.clip(np.searchsorted(rows, elevation, side="right") - 1, 0, rows.size - 2)
    u = (elevation - rows[low]) / (rows[low + 1] - rows[low])
    return low, low + 1, left, right, np.clip(u, least, 1.0)[:, None], v


def _mix(table, low, high, left, right, u, v):
    """Bilinear mixture of four values of a table (E, A, ...), with the indices and fractions of `_place`."""
    with np.errstate(invalid="ignore"):
        bottom = (1 - v) * table[low, left] + v * table[low, right]
        top = (1 - v) * table[high, left] + v * table[high, right]
        return (1 - u) * bottom + u * top


def interpolate_cubic(
    row_deg: np.ndarray, column_deg: np.ndarray, values: np.ndarray, elevation_deg: np.ndarray, azimuth_deg: np.ndarray
) -> np.ndarray:
    """Interpolate values (E, A, K) >= 0 smoothly to broadcast directions, (..., K).

    For pictures: a local cubic of the logarithm in both angles (``spectrum.hermite_matrix``), continued across the
    zenith, wrapped in azimuth, continued below the first row by at most half a row.  Reproduces the grid.  Where any
    value is 0 the logarithm does not exist and all is interpolated by ``interpolate_bilinear``.  Elevations (n, 1)
    with azimuths (1, m), the rows and columns of a picture, are fastest.
    """
    values, k = np.asarray(values), np.shape(values)[2]
    elevation, azimuth = np.asarray(elevation_deg, float), np.asarray(azimuth_deg, float)
    shape = np.broadcast_shapes(elevation.shape, azimuth.shape)
    if not (values > 0).all():
        return interpolate_bilinear(row_deg, column_deg, values, elevation, azimuth)
    rows, columns, table = _padded(row_deg, column_deg, np.log(values))
    elevation = np.maximum(elevation, 0.5 * (rows[0] + row_deg[0]))
    azimuth = column_deg[0] + np.mod(azimuth - column_deg[0], 360.0)
    if elevation.ndim == azimuth.ndim == 2 and elevation.shape[1] == azimuth.shape[0] == 1:
        along = hermite_matrix(rows, elevation[:, 0]) @ table.reshape(rows.size, -1)
        along = np.moveaxis(along.reshape(-1, columns.size, k), 1, 0).reshape(columns.size, -1)
        both = (hermite_matrix(columns, azimuth[0]) @ along).reshape(azimuth.size, -1, k)
        return np.exp(np.swapaxes(both, 0, 1)).astype(values.dtype, copy=False)
    elevation, azimuth = (x.ravel() for x in np.broadcast_arrays(elevation, azimuth))
    row, row_weight = hermite_weights(rows, elevation)
    column, column_weight = hermite_weights(columns, azimuth)
    out = np.zeros((elevation.size, k))
    for i in range(4):
        for j in range(4):
            out += (row_weight[:, i] * column_weight[:, j])[:, None] * table[row[:, i], column[:, j]]
    return np.exp(out).astype(values.dtype, copy=False).reshape(*shape, k)


def _padded(elevation: np.ndarray, azimuth: np.ndarray, table: np.ndarray):
    """Rows, columns and values with neighbours added: two rows beyond the zenith, one below, two columns each side."""
    n = azimuth.size
    opposite = np.roll(table, -(n // 2), axis=1)
    if n % 2:
        opposite = 0.5 * (opposite + np.roll(table, -(n // 2) - 1, axis=1))
    beyond = [i for i in range(elevation.size - 1, -1, -1) if elevation[i] < 90 - 1e-9][:2]
    rows = np.concatenate([elevation, 180.0 - elevation[beyond]])
    table = np.concatenate([table, opposite[beyond]])
    if elevation.size > 1:
        rows = np.concatenate([[2 * elevation[0] - elevation[1]], rows])
        table = np.concatenate([2 * table[:1] - table[1:2], table])
    around = np.arange(-2, n + 3)
    columns = azimuth[0] + around * (360.0 / n)
    return rows, columns, table[:, around % n]


def spline_matrix(nodes: np.ndarray, x: np.ndarray) -> np.ndarray:
    """The cubic spline (not-a-knot) through values at the nodes (N,), as a matrix (X, N) that gives its values at x.

    Two nodes make a line, three a parabola.
    """
    nodes, x = np.asarray(nodes, float), np.asarray(x, float)
    n = nodes.size
    if n < 4:
        powers = np.arange(n)
        shift, scale = nodes[0], max(float(np.ptp(nodes)), 1e-300)
        to_powers = np.linalg.inv(((nodes[:, None] - shift) / scale) ** powers)
        return ((x[:, None] - shift) / scale) ** powers @ to_powers
    h = np.diff(nodes)
    left, right = np.zeros((n, n)), np.zeros((n, n))  # left @ (second derivatives) = right @ (values)
    for i in range(1, n - 1):
        left[i, i - 1 : i + 2] = h[i - 1], 2.0 * (h[i - 1] + h[i]), h[i]
        right[i, i - 1 : i + 2] = 6.0 / h[i - 1], -6.0 / h[i - 1] - 6.0 / h[i], 6.0 / h[i]
    left[0, :3] = h[1], -(h[0] + h[1]), h[0]  # one cubic across the second and the last but one node
    left[-1, -3:] = h[-1], -(h[-2] + h[-1]), h[-2]
    second = np.linalg.solve(left, right)
    j = np.clip(np.searchsorted(nodes, x, side="right") - 1, 0, n - 2)
    b = (x - nodes[j]) / h[j]
    a = 1.0 - b
    out = ((a**3 - a) * h[j] ** 2 / 6.0)[:, None] * second[j] + ((b**3 - b) * h[j] ** 2 / 6.0)[:, None] * second[j + 1]
    rows = np.arange(x.size)
    out[rows, j] += a
    out[rows, j + 1] += b
    return out
