"""Cubic interpolation between four nodes of tables that lie in one array, within kernels.

along, across: weights of four nodes each, as of `weights`; pool: the array; at: place in it.
"""

import numpy as np

from twilight.jit.kernels import njit


@njit(inner=True, cache=True, inline=True, makes_arrays=False)
def weights(f):
    """Cubic Lagrange weights for nodes 0, 1, 2, 3.

    f: the position among them, 0 to 3.
    """
    a = f - 1.0
    b = f - 2.0
    c = f - 3.0
    bc = b * c
    fa = f * a
    return a * bc * (-1.0 / 6.0), 0.5 * f * bc, -0.5 * fa * c, fa * b * (1.0 / 6.0)


@njit(inner=True, cache=True, inline=True, makes_arrays=False)
def even_nodes(position, n):
    """First of four nodes and the position behind it.

    position: 0 to n, among n + 1 nodes; n: number of intervals, 3 or more.
    """
    first = min(n - 3, max(0, int(position) - 1))
    return first, position - first


@njit(inner=True, cache=True, inline=True, makes_arrays=False)
def cubic(pool, at, along):
    """Four values of the pool from the place `at` on, weighted."""
    return along[0] * pool[at] + along[1] * pool[at + 1] + along[2] * pool[at + 2] + along[3] * pool[at + 3]


@njit(inner=True, cache=True, inline=True, makes_arrays=False)
def bicubic(pool, at, step, row, across, along):
    """Sixteen values of the pool at `at` + i row + k step, weighted with across_i along_k, i and k being 0 to 3.

    row, step: distances in the pool between nodes of the coordinates of `across` and of `along`.  Unsigned offsets save
    the inner loop a test for negative indices.
    """
    w0, w1, w2, w3 = across
    v0, v1, v2, v3 = along
    k0 = np.uint64(at)
    s1 = np.uint64(step)
    s2 = s1 + s1
    s3 = s2 + s1
    k1 = k0 + np.uint64(row)
    k2 = k1 + np.uint64(row)
    k3 = k2 + np.uint64(row)
    return (
        w0 * (v0 * pool[k0] + v1 * pool[k0 + s1] + v2 * pool[k0 + s2] + v3 * pool[k0 + s3])
        + w1 * (v0 * pool[k1] + v1 * pool[k1 + s1] + v2 * pool[k1 + s2] + v3 * pool[k1 + s3])
        + w2 * (v0 * pool[k2] + v1 * pool[k2 + s1] + v2 * pool[k2 + s2] + v3 * pool[k2 + s3])
        + w3 * (v0 * pool[k3] + v1 * pool[k3 + s1] + v2 * pool[k3 + s2] + v3 * pool[k3 + s3])
    )
