"""Equivalent media for light that has been scattered: the forward peak of the aerosol counts as not scattered.

Delta-M scaling (Wiscombe 1977): with f = chi_{M+1} the moment after the last one that is not cut,
    extinction' = (1 - albedo f) extinction,  albedo' = (1 - f) albedo / (1 - albedo f),  chi'_l = (chi_l - f)/(1 - f).
A degree between M and M + 1 takes f between chi_{M+1} and chi_{M+2}: moment M + 1 comes in from 0, and what is
scattered follows the degree without steps.
With M = 0 this is f = g: Haber's similarity-reduced isotropic aerosol (eq. 2), in which extinction falls with
scattering, so that light scattered forward stays on its way instead of being lost.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from twilight.atmosphere.medium import Medium
from twilight.numerics.phase import rayleigh_matrix, rayleigh_phase


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
