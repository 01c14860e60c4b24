"""Moments of phase matrices over generalised spherical functions: one scattering of each degree of polarised light.

    b_l = 2 pi int P12 d^l_02 dmu,     even_l +- odd_l = 2 pi int (P22 +- P33) d^l_2,+-2 dmu,
with Wigner's functions d of the scattering angle.  Reference: Hovenier, van der Mee & Domke 2004, Transfer of Polarized
Light in Planetary Atmospheres, appendix B.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from twilight.atmosphere.medium import Medium
from twilight.numerics.phase import table_angles_rad


def wigner_d(highest: int, m: int, n: int, cosine: np.ndarray) -> np.ndarray:
    """d^l_mn at cosines of any shape for l = 0..highest, shape (highest + 1, ...); 0 where l < max(|m|, |n|)."""
    x = np.asarray(cosine, dtype=float)
    out = np.zeros((highest + 1, *x.shape))
    first = max(abs(m), abs(n))
    if first > highest:
        return out
    minus, plus = abs(m - n), abs(m + n)
    scale = math.sqrt(math.factorial(2 * first) / (math.factorial(minus) * math.factorial(plus))) / 2.0**first
    sign = 1.0 if n >= m else (-1.0) ** (m - n)
    out[first] = sign * scale * (1.0 - x) ** (0.5 * minus) * (1.0 + x) ** (0.5 * plus)
    for k in range(first, highest):
        before = out[k - 1] if k > first else 0.0
        if k == 0:
            out[1] = x
            continue
        up = k * math.sqrt(((k + 1) ** 2 - m * m) * ((k + 1) ** 2 - n * n))
        down = (k + 1) * math.sqrt((k * k - m * m) * (k * k - n * n))
        out[k + 1] = ((2 * k + 1) * (k * (k + 1) * x - m * n) * out[k] - down * before) / up
    return out


class MatrixMoments(NamedTuple):
    """What scattering does to each degree: b, even and odd (1 + K, degree + 1, W), of air and of K scaled aerosols."""

    b: np.ndarray
    even: np.ndarray
    odd: np.ndarray


def matrix_moments(medium: Medium, forward_fraction: np.ndarray, degree: int) -> MatrixMoments:
    """Moments of the phase matrices; light in the forward peak, forward_fraction (K, W), keeps its polarisation."""
    n_w = medium.n_wavelengths
    out = np.zeros((3, 1 + len(medium.phase_functions), degree + 1, n_w))
    delta = (1.0 - medium.depolarisation) / (1.0 + 0.5 * medium.depolarisation)
    out[0, 0, 2] = -3.0 / (5.0 * math.sqrt(6.0)) * delta
    out[1, 0, 2] = 0.6 * delta
    # as for Legendre moments: Gauss points on the table's own mesh
    edges = np.sqrt(table_angles_rad() / np.pi)
    x, w = np.polynomial.legendre.leggauss(4)
    u = (0.5 * (edges[1:] + edges[:-1])[:, None] + 0.5 * np.diff(edges)[:, None] * x).ravel()
    angle = np.pi * u**2
    weight = 2.0 * np.pi * np.sin(angle) * 2.0 * np.pi * u * (0.5 * np.diff(edges)[:, None] * w).ravel()
    mu = np.cos(angle)
    across, same, opposite = (wigner_d(degree, m, n, mu) * weight for m, n in ((0, 2), (2, 2), (2, -2)))
    for k, (phase, f) in enumerate(zip(medium.phase_functions, forward_fraction, strict=True)):
        _, p12, p22, p33 = phase.matrix(mu)
        total, difference = same @ (p22 + p33).T, opposite @ (p22 - p33).T
        out[0, 1 + k] = (across @ p12.T) / (1.0 - f)
        out[1, 1 + k] = (0.5 * (total + difference) - f) / (1.0 - f)
        out[2, 1 + k] = (0.5 * (total - difference) - f) / (1.0 - f)
    out[:, :, :2] = 0.0
    return MatrixMoments(*out)
