"""From the air of a medium to the turbidity of the analytic skies."""

from __future__ import annotations

import numpy as np

from twilight.atmosphere.medium import Medium
from twilight.base.errors import TwilightError
from twilight.solvers.analytic.sunlight import ANGSTROM_EXPONENT, RAYLEIGH_EXPONENT

REFERENCE_NM = 550.0
"""Wavelength of the turbidity [nm]."""


def turbidity_of(medium: Medium) -> float:
    """T = (tau_air + tau_aerosol) / tau_air at 550 nm, vertical optical depths (Preetham 1999 sec. 2.1).

    Absorbing gases do not count; the aerosol counts with its extinction, stratospheric aerosol included.  Between
    sampled wavelengths ln tau goes linearly with ln wavelength; where 550 nm is not between samples the nearest is
    taken there by wavelength^-1.3 (aerosol) and wavelength^-4.08 (air).  Raises TwilightError for a medium without air.
    """
    air = _at_reference(medium.wavelength_nm, medium.optical_depth("air"), RAYLEIGH_EXPONENT)
    if not air > 0:
        raise TwilightError(
            f"{medium.name or 'the medium'}: its air does not scatter, so it has no turbidity; set solver.turbidity"
        )
    return 1.0 + _at_reference(medium.wavelength_nm, medium.optical_depth("aerosol"), ANGSTROM_EXPONENT) / air


def _at_reference(wavelength_nm: np.ndarray, depth: np.ndarray, exponent: float) -> float:
    """Optical depth at 550 nm."""
    inside = wavelength_nm[0] <= REFERENCE_NM <= wavelength_nm[-1]
    if inside and (depth > 0).all():
        return float(np.exp(np.interp(np.log(REFERENCE_NM), np.log(wavelength_nm), np.log(depth))))
    nearest = int(np.argmin(np.abs(wavelength_nm - REFERENCE_NM)))
    return float(depth[nearest] * (wavelength_nm[nearest] / REFERENCE_NM) ** exponent)
