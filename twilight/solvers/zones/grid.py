"""Nodes of the field: altitude x solar zenith angle x direction.

Directions are in the local frame of a node: cosine of the zenith angle, azimuth from the sun.  Left and right of the
sun's vertical are alike: azimuths go from 0 to 180 deg and harmonics are even.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

POLAR_POWER = 1.5
"""Gauss points in u = cosine^(1/1.5): closer to the horizon, where the light of twilight comes from."""


@dataclass(frozen=True)
class Angles:
    """Directions of a node and the even harmonics that describe radiance there.

    cosine (M,), azimuth (F,) [rad], weight (M,): of a polar angle over the sphere, sum 1
    degree, order (C,): of each harmonic, sorted by order; harmonics are normalised to a mean square of 1
    analysis (C, M, F): moments from radiances, by weighted least squares: exact for what the harmonics span
    """

    cosine: np.ndarray
    azimuth: np.ndarray
    weight: np.ndarray
    degree: np.ndarray
    order: np.ndarray
    analysis: np.ndarray


def make_angles(per_hemisphere: int, around: int, degree: int) -> Angles:
    """2 x `per_hemisphere` polar angles times `around` azimuths, harmonics up to `degree`."""
    x, w = np.polynomial.legendre.leggauss(per_hemisphere)
    u = 0.5 * (x + 1.0)
    w = w * u ** (POLAR_POWER - 1.0)
    w *= 0.5 / w.sum()
    cosine = np.concatenate([-(u[::-1] ** POLAR_POWER), u**POLAR_POWER])
    weight = np.concatenate([w[::-1], w])
    azimuth = (np.arange(around) + 0.5) * np.pi / around
    orders, degrees = [], []
    for m in range(degree + 1):
        for n in range(m, degree + 1):
            orders.append(m)
            degrees.append(n)
    order, deg = np.array(orders), np.array(degrees)
    polar = even_harmonics(cosine, degree)  # (M, C)
    basis = polar[:, None, :] * np.cos(order * azimuth[:, None])[None]
    flat = basis.reshape(-1, order.size)
    weighted = (flat * np.repeat(weight / around, around)[:, None]).T
    analysis = np.linalg.solve(weighted @ flat, weighted).reshape(order.size, cosine.size, around)
    return Angles(cosine, azimuth, weight, deg, order, analysis)


def even_harmonics(cosine: np.ndarray, degree: int) -> np.ndarray:
    """Polar parts (P, C) of the harmonics P_lm(cosine) cos(m azimuth), mean square 1 over the sphere, sorted by m."""
    x = np.asarray(cosine, dtype=float)
    s = np.sqrt(np.maximum(0.0, 1.0 - x * x))
    columns = []
    diagonal = np.ones_like(x)
    for m in range(degree + 1):
        if m > 0:
            diagonal = diagonal * s * np.sqrt((2.0 * m + 1.0) / (2.0 * m))
        factor = 1.0 if m == 0 else np.sqrt(2.0)
        before, here = np.zeros_like(x), diagonal
        columns.append(factor * here)
        for n in range(m + 1, degree + 1):
            a = np.sqrt((4.0 * n * n - 1.0) / (n * n - m * m))
            b = np.sqrt(((n - 1.0) ** 2 - m * m) / (4.0 * (n - 1.0) ** 2 - 1.0))
            before, here = here, a * (x * here - b * before)
            columns.append(factor * here)
    return np.stack(columns, axis=-1)


def altitude_nodes(bottom_km: float, top_km: float, jumps_km: np.ndarray, density: float) -> np.ndarray:
    """Altitudes [km] with spacing (0.6 + 0.14 height)/density, and one at every jump of the medium."""
    edges = [bottom_km, *jumps_km, top_km]
    out = [bottom_km]
    for a, b in zip(edges[:-1], edges[1:], strict=True):
        rough = [a]
        while rough[-1] < b:
            rough.append(rough[-1] + (0.6 + 0.14 * (rough[-1] - bottom_km)) / density)
        n = max(1, len(rough) - 1)
        # the same grading, stretched to end at b
        out.extend(a + (np.array(rough[1:]) - a) * (b - a) / (rough[-1] - a))
        assert n
    return np.array(out)


def zenith_nodes(first_deg: float, last_deg: float, density: float) -> np.ndarray:
    """Solar zenith angles [deg]: close together from 84 deg on, where the field falls by e within a degree."""
    out = [0.0]
    while out[-1] < 180.0:
        x = out[-1]
        if x < 84.0:
            step = min(12.0, 1.5 + 0.17 * (84.0 - x))
        elif x < 112.0:
            step = 1.25
        else:
            step = min(6.0, 1.25 + 0.15 * (x - 112.0))
        out.append(x + step / density)
    nodes = np.array(out)
    first = max(0, int(np.searchsorted(nodes, first_deg, side="right")) - 1)
    last = min(nodes.size - 1, int(np.searchsorted(nodes, last_deg)))
    return nodes[first : last + 1]


def lagrange_refinement(coarse: np.ndarray, per_interval: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """A grid with `per_interval` steps in every interval of `coarse`, and cubic interpolation to it.

    Returns (fine (n,), first (n,), weight (n, 4)): value = sum_j weight[j] coarse_value[first + j].
    """
    n = coarse.size
    t = np.arange(per_interval) / per_interval
    fine = np.append((coarse[:-1, None] + np.diff(coarse)[:, None] * t[None]).ravel(), coarse[-1])
    interval = np.clip(np.searchsorted(coarse, fine, side="right") - 1, 0, n - 2)
    width = min(4, n)
    first = np.clip(interval - 1, 0, n - width)
    weight = np.zeros((fine.size, 4))
    for j in range(width):
        w = np.ones(fine.size)
        for k in range(width):
            if k != j:
                xj, xk = coarse[first + j], coarse[first + k]
                w *= (fine - xk) / (xj - xk)
        weight[:, j] = w
    return fine, np.minimum(first, max(0, n - 4)), weight
