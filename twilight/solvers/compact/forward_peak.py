"""The sky near the sun: light that the forward peaks of the aerosol have scattered more than once.

What the optical depths of lines and sunbeams leave out as not scattered, the peak of a phase function, widens the glow
around the sun each time.  With f the fraction of the scattering in the peak, p_l its Legendre moments (1 up to the
degree that is followed, chi_l / f beyond) and x the optical depth of scattering in peaks on the way of the light, the
phase function P of light that is scattered once becomes

    exp(-x) P  +  sum_l (2 l + 1)/(4 pi) P_l(cos angle) [f p_l g_l + (1 - exp(-x)) (chi_l - f)],

    g_l = [exp(-x (1 - m_l)) - exp(-x)] / (x m_l) - exp(-x),

m_l being p_l of the mixture and the second term in brackets only up to that degree: all convolutions of the peak with
itself (the correction of Nakajima and Tanaka 1988, J. Quant. Spectrosc. Radiat. Transfer 40, 51, to all orders).
"""

from __future__ import annotations

import functools
from typing import NamedTuple

import numpy as np

from twilight.numerics.phase import PhaseFunction, table_angles_rad

HIGHEST_DEGREE = 400
"""Degree to which convolutions of a peak are followed."""

ANGLES = 161
"""Scattering angles of the tables, closer together near the sun."""

LEAST_FRACTION = 1e-6
"""Fraction in a peak below which there is none."""

STRONG_FRACTION = 0.01
"""Fraction from which on moments of a peak may be negative or above 1: those of a smaller one are errors of
quadrature."""

LEAST_DEPTH = 1e-4
"""Optical depth of scattering in peaks below which peaks are not widened."""


class ForwardPeaks(NamedTuple):
    """Of K phase functions: fraction (K, W); moments p_l (K, W, N); followed (K, W, N): chi_l - f up to the degree that
    is followed, 0 beyond."""

    fraction: np.ndarray
    moments: np.ndarray
    followed: np.ndarray


class WidenedPeaks(NamedTuple):
    """For elevations (E,) under one sun: depth x (E, W), and what is added to exp(-x) P at the angles of the tables,
    (K, E, ANGLES, W) [sr^-1]."""

    depth: np.ndarray
    added: np.ndarray


def forward_peaks(phases: tuple[PhaseFunction, ...], fraction: np.ndarray, degree: int) -> ForwardPeaks:
    """Peaks beyond a degree, of which fraction (K, W) is given."""
    chi = np.array([phase.legendre_moments(HIGHEST_DEGREE) for phase in phases])
    f = fraction[..., None]
    strong = f > STRONG_FRACTION
    moments = np.clip(chi / np.maximum(f, LEAST_FRACTION), np.where(strong, -2.0, 0.0), np.where(strong, 2.0, 1.0))
    moments[..., : degree + 1] = 1.0
    followed = chi - f
    followed[..., degree + 1 :] = 0.0
    return ForwardPeaks(np.where(fraction > LEAST_FRACTION, fraction, 0.0), moments, followed)


def widened(peaks: ForwardPeaks, depth: np.ndarray, by_kind: np.ndarray) -> WidenedPeaks:
    """The widened peaks; depth (E, W): optical depth x in peaks; by_kind (K, E, W): light that each aerosol scatters in
    its peak, which weighs the mixture."""
    total = by_kind.sum(axis=0)
    x = np.where((total > 0.0) & (depth >= LEAST_DEPTH), depth, 0.0)
    part = by_kind / np.where(total > 0.0, total, 1.0)
    mixed = np.einsum("kew,kwl->ewl", part, peaks.moments)
    xs = x[..., None]
    none = np.exp(-xs)
    small = np.abs(mixed) * xs < 1e-6
    safe = np.where(small, 1.0, mixed * xs)
    g = np.where(small, 0.5 * none * xs * mixed, (np.exp(-xs * (1.0 - mixed)) - none) / safe - none)
    peak = (peaks.fraction[..., None] * peaks.moments)[:, None]
    series = peak * g + (1.0 - none) * peaks.followed[:, None]  # 2 E W N
    return WidenedPeaks(x, np.einsum("kewl,al->keaw", series, _legendre_terms(), optimize=True))


@functools.cache
def _legendre_terms() -> np.ndarray:
    """(2 l + 1)/(4 pi) P_l at the angles of the tables, (ANGLES, N)."""
    legendre = np.polynomial.legendre.legvander(np.cos(table_angles_rad(ANGLES)), HIGHEST_DEGREE)
    return legendre * (2 * np.arange(HIGHEST_DEGREE + 1) + 1) / (4.0 * np.pi)


def place_of_angle(cosine: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Index into the angles of the tables, and the fraction on the way to the next."""
    where = np.sqrt(np.arccos(cosine) / np.pi) * (ANGLES - 1)
    index = np.minimum(where.astype(int), ANGLES - 2)
    return index, where - index
