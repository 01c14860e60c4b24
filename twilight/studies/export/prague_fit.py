"""Skies as sums of few products, by alternating least squares.

A sky is sum_r f_r(gamma) g_r(alpha), each f and g linear between its breaks.  With the g known, the best values of the
f at their breaks solve linear equations in which only neighbouring breaks meet: blocks of R x R along a diagonal and
beside it.  Weights of one over the squared radiance make the sum of squared relative errors least.  What few directions
decide is held near the step before.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy import sparse

HOLD = 1e-6
"""Weight of the step before, beside the mean weight of a break."""
SLOPE = 1e-5
"""Weight of the difference between neighbouring breaks."""


class LinearBasis(NamedTuple):
    """Linear basis functions ("hats") of a number of breaks, 1 at their own and 0 at all others, at N directions.

    below, fraction (N,): the break below a direction, and the fraction of the way to the next; matrices (breaks, N):
    value of each function, square of it, and product with the next break's function.
    """

    breaks: int
    below: np.ndarray
    fraction: np.ndarray
    value: sparse.csr_array
    square: sparse.csr_array
    product: sparse.csr_array


def linear_basis(index: np.ndarray, fraction: np.ndarray, count: int) -> LinearBasis:
    """Of N directions, of which each lies a fraction behind the break of that index."""
    rows_of = np.arange(index.size)

    def matrix(low: np.ndarray, high: np.ndarray | None) -> sparse.csr_array:
        if high is None:
            return sparse.csr_array((low, (index, rows_of)), shape=(count, index.size))
        places = (np.concatenate([index, index + 1]), np.concatenate([rows_of, rows_of]))
        return sparse.csr_array((np.concatenate([low, high]), places), shape=(count, index.size))

    low, high = 1.0 - fraction, fraction
    return LinearBasis(count, index, fraction, matrix(low, high), matrix(low**2, high**2), matrix(low * high, None))


def at_directions(of: LinearBasis, values: np.ndarray) -> np.ndarray:
    """Functions with values (C, breaks, R), at the directions: (C, N, R)."""
    f = of.fraction[:, None]
    return values[:, of.below] * (1.0 - f) + values[:, np.minimum(of.below + 1, of.breaks - 1)] * f


def solve_half(
    of: LinearBasis, others: np.ndarray, target: np.ndarray, weight: np.ndarray, before: np.ndarray
) -> np.ndarray:
    """The best values (C, breaks, R) of one of the two functions.

    others (C, N, R): the other one at the directions; target, weight (C, N); before (C, breaks, R).
    """
    channels, n, rank = others.shape
    weighted = others * weight[..., None]
    outer = (weighted[..., :, None] * others[..., None, :]).transpose(1, 0, 2, 3).reshape(n, -1)
    shape = (of.breaks, channels, rank, rank)
    diagonal = (of.square @ outer).reshape(shape)
    beside = (of.product @ outer).reshape(shape)
    right = (of.value @ (weighted * target[..., None]).transpose(1, 0, 2).reshape(n, -1)).reshape(shape[:3])
    hold = HOLD * np.einsum("bcrr->c", diagonal) / (of.breaks * rank)
    diagonal += hold[:, None, None] * np.eye(rank)
    right += hold[:, None] * before.transpose(1, 0, 2)
    slope = SLOPE * np.einsum("bcrr->c", diagonal) / (of.breaks * rank)
    ends = np.full(of.breaks, 2.0)
    ends[[0, -1]] = 1.0
    diagonal += slope[:, None, None] * ends[:, None, None, None] * np.eye(rank)
    beside -= slope[:, None, None] * np.eye(rank)
    # forward: each break without the one before it; then back
    follow = np.empty(shape)
    solved = np.empty((of.breaks, channels, rank))
    for b in range(of.breaks):
        block, side = diagonal[b], right[b]
        if b > 0:
            turned = beside[b - 1].swapaxes(-1, -2)
            block = block - turned @ follow[b - 1]
            side = side - (turned @ solved[b - 1][..., None])[..., 0]
        both = np.linalg.solve(block, np.concatenate([beside[b], side[..., None]], axis=-1))
        follow[b], solved[b] = both[..., :-1], both[..., -1]
    for b in range(of.breaks - 2, -1, -1):
        solved[b] -= (follow[b] @ solved[b + 1][..., None])[..., 0]
    return solved.transpose(1, 0, 2)


def first_guess(sun_breaks: int, zenith_breaks: int, channels: int, rank: int) -> tuple[np.ndarray, np.ndarray]:
    """Term r is cos(pi r u), with u from 0 to 1 over the breaks: (C, G, R) and (C, A, R)."""

    def cosines(count: int) -> np.ndarray:
        basis = np.cos(np.pi * np.arange(rank) * np.linspace(0.0, 1.0, count)[:, None])
        return np.repeat(basis[None], channels, axis=0)

    return cosines(sun_breaks), cosines(zenith_breaks)


def alternate(
    gamma: LinearBasis,
    alpha: LinearBasis,
    target: np.ndarray,
    weight: np.ndarray,
    start: tuple[np.ndarray, np.ndarray],
    steps: int,
) -> tuple[np.ndarray, np.ndarray]:
    """Values (C, G, R) and (C, A, R) after `steps` rounds from `start`; each f has 1 as its largest absolute value."""
    sun, zenith = start
    for _ in range(steps):
        sun = solve_half(gamma, at_directions(alpha, zenith), target, weight, sun)
        size = np.maximum(np.abs(sun).max(axis=1, keepdims=True), 1e-300)
        sun, zenith = sun / size, zenith * size
        zenith = solve_half(alpha, at_directions(gamma, sun), target, weight, zenith)
    return sun, zenith
