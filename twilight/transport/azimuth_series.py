"""Light along one ray as a Fourier series in azimuth, from its values at a few azimuths.

Along one ray light is a smooth function of the azimuth a from the sun, the same on both sides of it:
    f(a) = sum_m c_m cos(m a),   m = 0..N,   c_m = 2/N sum_j f(a_j) cos(m a_j),   a_j = pi j / N,
where j = 0, j = N, m = 0 and m = N each take a factor 1/2 (that of m is stored in c_m).  U takes sines instead.  Every
second azimuth of N is an azimuth of N/2: the values in between show how good the series of N/2 is.
"""

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from twilight.jit.kernels import njit

MOST = 32
"""Most intervals N of half a turn."""

SMOOTH = 16
"""Intervals N for light that was scattered more than once."""

CHECKED = 1e-3
"""Largest relative error of the series of SMOOTH/2 with which that of SMOOTH is taken; its own error is far smaller."""

FAINT = 1e-16
"""Radiance over F0 that does not count [sr^-1]."""

LOG_OF_NO_LIGHT = -300.0
"""Logarithm that stands for no light."""


class RayDirections(NamedTuple):
    """D directions, sorted by the ray (elevation) they belong to; R rays.

    first (R + 1,): where the directions of each ray start; cos_azimuth (D,): of the azimuth from the sun;
    zenith_rad: solar zenith angle at the observer [rad]
    """

    first: np.ndarray
    cos_azimuth: np.ndarray
    zenith_rad: float


def unique_directions(row: np.ndarray, azimuth_deg: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Directions that differ by more than the side of the sun that they are on.

    row (D,): of each direction, the index of its elevation; azimuth_deg (D,): from the sun.  Returns row (N,), sorted,
    azimuth from the sun (N,) [deg], 0 to 180, and which of the N each of the D directions is (D,).
    """
    around = np.round(np.abs((azimuth_deg + 180.0) % 360.0 - 180.0), 9)
    order = np.lexsort((around, row))
    row, around = row[order], around[order]
    new = np.ones(row.size, bool)
    new[1:] = (np.diff(row) > 0) | (np.diff(around) > 0.0)
    which = np.empty(row.size, np.int64)
    which[order] = np.cumsum(new) - 1
    return row[new], around[new], which


@njit(inner=True, cache=True, makes_arrays=False)
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


@njit(inner=True, cache=True, makes_arrays=False)
def at_azimuth(series, n, cos_azimuth, out):
    """The sum of a series of n + 1 coefficients at one azimuth, into out (M,).

    series (., M): of `cosine_series`; n: its intervals; cos_azimuth: of the azimuth from the sun.
    """
    out[:] = 0.0
    before, current = cos_azimuth, 1.0
    for m in range(n + 1):
        for i in range(out.size):
            out[i] += current * series[m, i]
        before, current = current, 2.0 * cos_azimuth * current - before


@njit(inner=True, cache=True, makes_arrays=False)
def nearest(cos_azimuth, first, end, wanted):
    """Which of the directions first..end has the azimuth nearest to that of cosine `wanted`.

    cos_azimuth (D,): of the directions.
    """
    best = first
    for d in range(first + 1, end):
        if abs(cos_azimuth[d] - wanted) < abs(cos_azimuth[best] - wanted):
            best = d
    return best


def interpolate_azimuth(evaluate: Callable[[RayDirections], np.ndarray], directions: RayDirections) -> np.ndarray:
    """Stokes parameters (D, S, W), U as to the right of the sun, of light that is smooth in azimuth.

    evaluate: gives Stokes parameters in other directions on the same rays.  Rays with many directions are evaluated in
    SMOOTH + 1 azimuths, and in all of their directions where the series does not hold (CHECKED).
    """
    counts = np.diff(directions.first)
    many = counts > SMOOTH + 1
    if not many.any():
        return evaluate(directions)
    nodes = np.pi * np.arange(SMOOTH + 1) / SMOOTH
    own = [directions.cos_azimuth[a:b] for a, b in zip(directions.first[:-1], directions.first[1:], strict=True)]
    by_ray = _split(evaluate, directions, [np.cos(nodes) if m else c for c, m in zip(own, many, strict=True)])
    rays = np.flatnonzero(many)
    at_nodes = np.stack([by_ray[r] for r in rays])
    form = _smooth_form(at_nodes)
    guess = _summed(_azimuthal_harmonics(np.cos(nodes[1::2]), SMOOTH // 2), _summed(_series(nodes[::2]), form[:, ::2]))
    between = at_nodes[:, 1::2]
    wrong = np.abs(_from_smooth_form(guess) - between).sum(axis=2) - FAINT
    smooth = ~np.any(wrong > CHECKED * between[:, :, 0], axis=(1, 2))
    coefficients = _summed(_series(nodes), form[smooth])
    # a picture has the same azimuths in all its rows
    same_azimuths: dict[bytes, list[int]] = {}
    for place, r in enumerate(rays[smooth]):
        same_azimuths.setdefault(own[r].tobytes(), []).append(place)
    for places in same_azimuths.values():
        same = rays[smooth][places]
        lights = _from_smooth_form(_summed(_azimuthal_harmonics(own[same[0]], SMOOTH), coefficients[places]))
        for r, light in zip(same, lights, strict=True):
            by_ray[r] = light
    rough = set(rays[~smooth].tolist())
    if rough:
        rest = _split(evaluate, directions, [c if r in rough else c[:0] for r, c in enumerate(own)])
        by_ray = [rest[r] if r in rough else light for r, light in enumerate(by_ray)]
    return np.concatenate(by_ray)


def _split(
    evaluate: Callable[[RayDirections], np.ndarray], directions: RayDirections, cosines: list
) -> list[np.ndarray]:
    """What `evaluate` gives at other azimuths of each ray, ray by ray."""
    first = np.concatenate([[0], np.cumsum([c.size for c in cosines])])
    stokes = evaluate(directions._replace(first=first, cos_azimuth=np.concatenate(cosines)))
    return np.split(stokes, first[1:-1])


def _smooth_form(stokes: np.ndarray) -> np.ndarray:
    """Logarithm of I, Q/I and U/I (..., S, W)."""
    form = np.array(stokes, dtype=float)
    intensity = np.where(form[..., :1, :] > 0.0, form[..., :1, :], np.exp(2.0 * LOG_OF_NO_LIGHT))
    form[..., 1:, :] /= intensity
    form[..., :1, :] = np.log(intensity)
    return form


def _from_smooth_form(form: np.ndarray) -> np.ndarray:
    intensity = np.where(form[..., :1, :] > LOG_OF_NO_LIGHT, np.exp(form[..., :1, :]), 0.0)
    return np.concatenate([intensity, form[..., 1:, :] * intensity], axis=-2)


def _series(azimuth: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Matrices (N + 1, N + 1) from values at N + 1 azimuths to coefficients of cosines, and of sines."""
    n = azimuth.size - 1
    ends = np.where((np.arange(n + 1) == 0) | (np.arange(n + 1) == n), 0.5, 1.0)
    cosines = 2.0 / n * np.cos(np.outer(np.arange(n + 1), azimuth)) * ends * ends[:, None]
    return cosines, 2.0 / n * np.sin(np.outer(np.arange(n + 1), azimuth)) * (ends == 1.0)


def _azimuthal_harmonics(cos_azimuth: np.ndarray, n: int) -> tuple[np.ndarray, np.ndarray]:
    """cos(m a) and sin(m a), (D, n + 1)."""
    angle = np.outer(np.arccos(np.clip(cos_azimuth, -1.0, 1.0)), np.arange(n + 1))
    return np.cos(angle), np.sin(angle)


def _summed(matrices: tuple[np.ndarray, np.ndarray], form: np.ndarray) -> np.ndarray:
    """Matrices (K, N) of cosines, for I and Q, and of sines, for U, times form (R, N, S, W): (R, K, S, W)."""
    cosines, sines = matrices
    parts = []
    for matrix, part in ((cosines, form[:, :, :2]), (sines, form[:, :, 2:])):
        rays, n, n_stokes, n_w = part.shape
        product = matrix @ part.reshape(rays, n, n_stokes * n_w)
        parts.append(product.reshape(rays, matrix.shape[0], n_stokes, n_w))
    return np.concatenate(parts, axis=2)
