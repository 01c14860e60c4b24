"""Equivalent media for light that has been scattered: the forward peak of the aerosol counts as not scattered.

Delta-M scaling (Wiscombe 1977): with f = chi_{M+1} the moment after the last one that is not cut,
    extinction' = (1 - albedo f) extinction,  albedo' = (1 - f) albedo / (1 - albedo f),  chi'_l = (chi_l - f)/(1 - f).
A degree between M and M + 1 takes f between chi_{M+1} and chi_{M+2}: moment M + 1 comes in from 0, and what is
scattered follows the degree without steps.
With M = 0 this is f = g: Haber's similarity-reduced isotropic aerosol (eq. 2), in which extinction falls with
scattering, so that light scattered forward stays on its way instead of being lost.

Polarised light has moments of the phase matrix over generalised spherical functions, one scattering of each degree:
    b_l = 2 pi int P12 d^l_02 dmu,     even_l +- odd_l = 2 pi int (P22 +- P33) d^l_2,+-2 dmu,
with Wigner's functions d of the scattering angle.  Reference: Hovenier, van der Mee & Domke 2004, Transfer of Polarized
Light in Planetary Atmospheres, appendix B.
"""

import math
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from twilight.atmosphere.medium import Medium
from twilight.numerics.phase import rayleigh_matrix, rayleigh_phase, table_angles_rad


@dataclass(frozen=True)
class ScaledMedium:
    """A delta-scaled medium.

    medium: the scaled one; moments (1 + K, L, W): Legendre moments of its phase functions, air first, up to the next
    whole degree; forward_fraction (K, W): f of each aerosol phase function; degree: that they were asked for, None for
    none
    """

    medium: Medium
    moments: np.ndarray
    forward_fraction: np.ndarray
    degree: float | None


def delta_scaled(medium: Medium, degree: float | None) -> ScaledMedium:
    """The medium with the aerosol scaled so that Legendre moments up to `degree` describe it.

    degree None leaves the aerosol as it is, without moments.
    """
    n_phase, n_wavelengths = len(medium.phase_functions), medium.n_wavelengths
    if degree is None:
        return ScaledMedium(medium, np.zeros((1 + n_phase, 0, n_wavelengths)), np.zeros((n_phase, n_wavelengths)), None)
    whole = math.floor(degree)
    part, highest = degree - whole, math.ceil(degree)
    chi = np.zeros((n_phase, highest + 2, n_wavelengths))
    for k, phase in enumerate(medium.phase_functions):
        chi[k] = phase.legendre_moments(highest + 1).T
    f = np.clip((1.0 - part) * chi[:, whole + 1] + part * chi[:, highest + 1], 0.0, 0.999)
    moments = np.zeros((1 + n_phase, highest + 1, n_wavelengths))
    moments[0, 0] = 1.0
    if highest >= 2:
        moments[0, 2] = (1.0 - medium.depolarisation) / (5.0 * (2.0 + medium.depolarisation))
    moments[1:] = (chi[:, : highest + 1] - f[:, None]) / (1.0 - f[:, None])
    mixed = np.einsum("klw,kw->lw", medium.aerosol_phase_fraction, f)
    albedo = medium.aerosol_single_scattering_albedo
    scaled = replace(
        medium,
        aerosol_extinction_per_km=medium.aerosol_extinction_per_km * (1.0 - albedo * mixed),
        aerosol_single_scattering_albedo=np.clip(albedo * (1.0 - mixed) / (1.0 - albedo * mixed), 0.0, 1.0),
        aerosol_phase_fraction=medium.aerosol_phase_fraction * (1.0 - f[:, None]) / (1.0 - mixed),
    )
    return ScaledMedium(scaled, moments, f, degree)


def with_light_in_peak(
    light: np.ndarray, whole: np.ndarray, scaled_passed: np.ndarray, passed: np.ndarray
) -> np.ndarray:
    """L_s + (1 - T / T_s) (L - L_s): light that a segment of air brings, forward peak and all, [sr^-1].

    Scaled air counts light in the forward peak as passed: what the segment scatters on within the peak of the light
    from behind, taken as even across the peak, is missing in L_s.

    light: L_s, of the segment in scaled air; whole: L, of the whole line; scaled_passed, passed: transmittance T_s of
    the scaled and T of the true air of the segment; all of one shape.
    """
    lost = np.where(scaled_passed > 0.0, 1.0 - passed / np.where(scaled_passed > 0.0, scaled_passed, 1.0), 0.0)
    return light + np.maximum(lost, 0.0) * np.maximum(whole - light, 0.0)


def species_phase(medium: Medium, forward_fraction: np.ndarray, cos_angle: np.ndarray) -> np.ndarray:
    """Exact phase functions of air and of each aerosol at scattering angles (D,), shape (D, 1 + K, W) [sr^-1].

    Those of the aerosol are divided by 1 - f, so that they multiply the scaled scattering coefficient.
    """
    air = rayleigh_phase_array(cos_angle, medium.depolarisation)
    return _species(air, [phase(cos_angle) for phase in medium.phase_functions], forward_fraction)


def species_polarising_phase(medium: Medium, forward_fraction: np.ndarray, cos_angle: np.ndarray) -> np.ndarray:
    """P12 of air and of each aerosol at scattering angles (D,), shape (D, 1 + K, W) [sr^-1]; aerosol over 1 - f.

    Light in the forward peak is not polarised by it: all of P12 is in what is scattered.
    """
    air = rayleigh_matrix.py_func(cos_angle[:, None], medium.depolarisation[None, :])[1]
    return _species(air, [phase.matrix(cos_angle)[1] for phase in medium.phase_functions], forward_fraction)


def _species(air: np.ndarray, aerosol: list[np.ndarray], forward_fraction: np.ndarray) -> np.ndarray:
    """Air (D, W) and each aerosol (W, D), over 1 - f: (D, 1 + K, W)."""
    rows = [air, *(values.T / (1.0 - f) for values, f in zip(aerosol, forward_fraction, strict=True))]
    return np.ascontiguousarray(np.stack(rows, axis=1))


def rayleigh_phase_array(cos_angle: np.ndarray, depolarisation: np.ndarray) -> np.ndarray:
    """Rayleigh phase function [sr^-1] at scattering angles (D,) for depolarisation factors (W,), (D, W)."""
    return rayleigh_phase.py_func(cos_angle[:, None], depolarisation[None, :])


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
