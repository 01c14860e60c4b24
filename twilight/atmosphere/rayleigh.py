"""Scattering by air molecules after Bodhaine, Wood, Dutton & Slusser 1999, J. Atmos. Oceanic Technol. 16, 1854."""

from __future__ import annotations

import numpy as np

REFERENCE_DENSITY_PER_CM3 = 2.546899e19
"""Number density of air at 288.15 K and 1013.25 hPa, where the refractive index below holds (their eq. 3)."""


def standard_refractivity(wavelength_nm, co2_ppm: float = 420.0) -> np.ndarray:
    """n - 1 of dry air at 288.15 K and 1013.25 hPa (Peck & Reeder 1972, CO2 after Edlen 1966; eq. 18 and 19).

    wavelength_nm: any shape, vacuum, 230 to 1700 nm.
    """
    inverse_um2 = (1e3 / np.asarray(wavelength_nm, dtype=float)) ** 2
    at_300_ppm = 1e-8 * (8060.51 + 2480990.0 / (132.274 - inverse_um2) + 17455.7 / (39.32957 - inverse_um2))
    return at_300_ppm * (1.0 + 0.54 * (co2_ppm * 1e-6 - 0.0003))


def king_factor(wavelength_nm, co2_ppm: float = 420.0) -> np.ndarray:
    """King factor (6 + 3 rho)/(6 - 7 rho) of dry air, by volume over N2, O2, Ar and CO2 (eq. 5, 6 and 23)."""
    inverse_um2 = (1e3 / np.asarray(wavelength_nm, dtype=float)) ** 2
    nitrogen = 1.034 + 3.17e-4 * inverse_um2
    oxygen = 1.096 + 1.385e-3 * inverse_um2 + 1.448e-4 * inverse_um2**2
    argon = 1.00
    carbon_dioxide = 1.15
    co2_percent = co2_ppm * 1e-4
    total = 78.084 * nitrogen + 20.946 * oxygen + 0.934 * argon + co2_percent * carbon_dioxide
    return total / (78.084 + 20.946 + 0.934 + co2_percent)


def depolarisation(wavelength_nm, co2_ppm: float = 420.0) -> np.ndarray:
    """Depolarisation factor rho of natural light from the King factor F: rho = 6 (F - 1)/(3 + 7 F)."""
    f = king_factor(wavelength_nm, co2_ppm)
    return 6.0 * (f - 1.0) / (3.0 + 7.0 * f)


def cross_section_cm2(wavelength_nm, co2_ppm: float = 420.0) -> np.ndarray:
    """Scattering cross section of one molecule of air [cm^2] (eq. 22), same shape as the wavelength.

    sigma = 24 pi^3 (n^2 - 1)^2 / (lambda^4 N^2 (n^2 + 2)^2) F.  It does not depend on temperature and pressure.
    """
    wavelength_cm = np.asarray(wavelength_nm, dtype=float) * 1e-7
    n2 = (1.0 + standard_refractivity(wavelength_nm, co2_ppm)) ** 2
    polarisability = ((n2 - 1.0) / (n2 + 2.0)) ** 2
    shape = 24.0 * np.pi**3 / (wavelength_cm**4 * REFERENCE_DENSITY_PER_CM3**2)
    return shape * polarisability * king_factor(wavelength_nm, co2_ppm)
