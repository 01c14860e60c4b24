"""Cubic splines as matrices."""

from __future__ import annotations

import numpy as np


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
