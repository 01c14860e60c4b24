"""What depends on the azimuth alone, from its values at a few azimuths.

Along one ray the light is a smooth function of the azimuth a from the sun, the same on both sides of it:
    f(a) = sum_m c_m cos(m a),   m = 0..N,   c_m = 2/N sum_j f(a_j) cos(m a_j),   a_j = pi j / N,
with the first and last term of both sums halved (the first one of the series not, once c is stored).  Every second
azimuth of a set is one of the set before: what a set adds shows how good the one before was.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from twilight.kernels import njit

MOST = 32
"""Most intervals N of half a turn."""
SMOOTH, CHECKED = 16, 1e-3
"""Intervals that light scattered more than once takes, and how wrong half as many may be: 16 are then far better."""
FAINT, DARK = 1e-16, -300.0
"""Radiance over F0 that does not count, and the logarithm of none."""


class Directions(NamedTuple):
    """D directions that one looks in, sorted by the ray (elevation) they belong to; R rays.

    first (R + 1,): where those of each ray start; cos_azimuth (D,): of the azimuth from the sun.
    zenith_rad: solar zenith angle at the observer
    """

    first: np.ndarray
    cos_azimuth: np.ndarray
    zenith_rad: float


def once_each(row: np.ndarray, azimuth_deg: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Directions that differ by more than the side of the sun: their row (N,), sorted, their azimuth from the sun
    (N,), 0 to 180 deg, and which of them each of row (D,), azimuth_deg (D,) is (D,)."""
    around = np.round(np.abs((azimuth_deg + 180.0) % 360.0 - 180.0), 9)
    order = np.lexsort((around, row))
    row, around = row[order], around[order]
    new = np.ones(row.size, bool)
    new[1:] = (np.diff(row) > 0) | (np.diff(around) > 0.0)
    which = np.empty(row.size, np.int64)
    which[order] = np.cumsum(new) - 1
    return row[new], around[new], which


@njit(cache=True)
def cosine_series(values, n, out):
    """Coefficients out[: n + 1] of values (n + 1, M) at n + 1 azimuths.

    n: number of intervals; out (MOST + 1, M).
    """
    for m in range(n + 1):
        out[m, :] = 0.0
        for j in range(n + 1):
            factor = 2.0 / n * math.cos(math.pi * ((m * j) % (2 * n)) / n)
            if j == 0 or j == n:
                factor *= 0.5
            if m == 0 or m == n:
                factor *= 0.5
            for i in range(out.shape[1]):
                out[m, i] += factor * values[j, i]


@njit(cache=True)
def at_azimuth(series, n, cos_azimuth, out):
    """The sum of a series of n + 1 coefficients at one azimuth, into out (M,).

    series (., M): of `cosine_series`; n: its intervals; cos_azimuth: of the azimuth from the sun.
    """
    out[:] = 0.0
    before, here = cos_azimuth, 1.0
    for m in range(n + 1):
        for i in range(out.size):
            out[i] += here * series[m, i]
        before, here = here, 2.0 * cos_azimuth * here - before


@njit(cache=True)
def nearest(cos_azimuth, first, end, wanted):
    """Which of the directions first..end has the azimuth nearest to that of cosine `wanted`.

    cos_azimuth (D,): of the directions.
    """
    best = first
    for d in range(first + 1, end):
        if abs(cos_azimuth[d] - wanted) < abs(cos_azimuth[best] - wanted):
            best = d
    return best


def smooth_around(evaluate: Callable[[Directions], np.ndarray], directions: Directions) -> np.ndarray:
    """Stokes parameters (D, S, W), U as to the right of the sun, of light that is smooth in azimuth.

    evaluate: gives them in other directions on the same rays.  Rays with many directions are followed in SMOOTH + 1 of
    them, and in all where these do not tell the rest.
    """
    counts = np.diff(directions.first)
    many = counts > SMOOTH + 1
    if not many.any():
        return evaluate(directions)
    nodes = np.pi * np.arange(SMOOTH + 1) / SMOOTH
    own = [directions.cos_azimuth[a:b] for a, b in zip(directions.first[:-1], directions.first[1:], strict=True)]
    found = _split(evaluate, directions, [np.cos(nodes) if m else c for c, m in zip(own, many, strict=True)])
    whole, half = _series(nodes), _series(nodes[::2])
    between = _waves(np.cos(nodes[1::2]), SMOOTH // 2)
    cosines, waves = np.empty(0), _waves(np.empty(0), SMOOTH)
    for r in np.flatnonzero(many):
        form = _smooth_form(found[r])
        guess = _from_smooth_form(_summed(between, _coefficients(half, form[::2])))
        there = found[r][1::2]
        wrong = np.abs(guess - there).sum(axis=1) - FAINT
        if np.any(wrong > CHECKED * there[:, 0]):
            many[r] = False
            continue
        if not np.array_equal(cosines, own[r]):
            cosines, waves = own[r], _waves(own[r], SMOOTH)
        found[r] = _from_smooth_form(_summed(waves, _coefficients(whole, form)))
    again = ~many & (counts > SMOOTH + 1)
    if again.any():
        rest = _split(evaluate, directions, [c if a else c[:0] for c, a in zip(own, again, strict=True)])
        found = [new if a else old for new, old, a in zip(rest, found, again, strict=True)]
    return np.concatenate(found)


def _split(evaluate: Callable[[Directions], np.ndarray], directions: Directions, cosines: list) -> list[np.ndarray]:
    """What `evaluate` gives at other azimuths of each ray, ray by ray."""
    first = np.concatenate([[0], np.cumsum([c.size for c in cosines])])
    found = evaluate(directions._replace(first=first, cos_azimuth=np.concatenate(cosines)))
    return np.split(found, first[1:-1])


def _smooth_form(stokes: np.ndarray) -> np.ndarray:
    """Logarithm of I, Q/I and U/I (N, S, W)."""
    form = np.array(stokes, dtype=float)
    intensity = np.where(form[:, :1] > 0.0, form[:, :1], np.exp(2.0 * DARK))
    form[:, 1:] /= intensity
    form[:, :1] = np.log(intensity)
    return form


def _from_smooth_form(form: np.ndarray) -> np.ndarray:
    intensity = np.where(form[:, :1] > DARK, np.exp(form[:, :1]), 0.0)
    return np.concatenate([intensity, form[:, 1:] * intensity], axis=1)


def _series(azimuth: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Matrices (N + 1, N + 1) from values at N + 1 azimuths to coefficients of cosines, and of sines."""
    n = azimuth.size - 1
    ends = np.where((np.arange(n + 1) == 0) | (np.arange(n + 1) == n), 0.5, 1.0)
    cosines = 2.0 / n * np.cos(np.outer(np.arange(n + 1), azimuth)) * ends * ends[:, None]
    return cosines, 2.0 / n * np.sin(np.outer(np.arange(n + 1), azimuth)) * (ends == 1.0)


def _waves(cos_azimuth: np.ndarray, n: int) -> tuple[np.ndarray, np.ndarray]:
    """cos(m a) and sin(m a), (D, n + 1)."""
    angle = np.outer(np.arccos(np.clip(cos_azimuth, -1.0, 1.0)), np.arange(n + 1))
    return np.cos(angle), np.sin(angle)


def _coefficients(matrices: tuple[np.ndarray, np.ndarray], form: np.ndarray) -> np.ndarray:
    cosines, sines = matrices
    even = np.tensordot(cosines, form[:, :2], 1)
    return np.concatenate([even, np.tensordot(sines, form[:, 2:], 1)], axis=1)


def _summed(waves: tuple[np.ndarray, np.ndarray], coefficients: np.ndarray) -> np.ndarray:
    cosines, sines = waves
    even = np.tensordot(cosines, coefficients[:, :2], 1)
    return np.concatenate([even, np.tensordot(sines, coefficients[:, 2:], 1)], axis=1)
