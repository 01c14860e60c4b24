"""Sunlight at the ground through the constituents of the air, Preetham 1999, appendix A.1 (after Iqbal 1983)."""

from __future__ import annotations

import numpy as np

from twilight.base.errors import TwilightError
from twilight.solvers.analytic.shipped_tables import column

ANGSTROM_EXPONENT = 1.3
"""Exponent of the aerosol's optical depth in wavelength."""

RAYLEIGH_EXPONENT = 4.08
"""Exponent of the air's optical depth in wavelength."""


def relative_optical_mass(sun_zenith_deg) -> np.ndarray:
    """m = 1 / (cos z + 0.15 (93.885 - z)^-1.253), z the sun's zenith angle [deg], 0 to 90 (Kasten 1966)."""
    z = np.asarray(sun_zenith_deg, float)
    if not ((z >= 0) & (z <= 90)).all():
        raise TwilightError("sun_zenith_deg must be from 0 to 90: the optical mass is not defined below the horizon")
    return 1.0 / (np.cos(np.radians(z)) + 0.15 * (93.885 - z) ** -1.253)


def angstrom_turbidity(turbidity) -> np.ndarray:
    """Angstrom's beta = 0.04608 T - 0.04586, the optical depth of the aerosol at 1 um; not below 0."""
    return np.maximum(0.04608 * np.asarray(turbidity, float) - 0.04586, 0.0)


def transmittances(
    wavelength_nm,
    sun_zenith_deg: float,
    turbidity: float,
    *,
    ozone_cm: float = 0.35,
    precipitable_water_cm: float = 2.0,
) -> dict[str, np.ndarray]:
    """Transmittance of `air`, `aerosol`, `ozone`, `mixed_gases` and `water` towards the sun, each (W,).

    ozone_cm: column at NTP [cm]; precipitable_water_cm [cm].  The absorption spectra are tabulated from 380 to 780
    nm and taken as 0 beyond, which leaves out the ozone of the ultraviolet and the water of the infrared.
    """
    wavelength = np.atleast_1d(np.asarray(wavelength_nm, float))
    micrometre = wavelength / 1000.0
    m = float(relative_optical_mass(sun_zenith_deg))

    def k(gas: str) -> np.ndarray:
        grid = column("preetham1999_spectra", "wavelength_nm")
        return np.interp(wavelength, grid, column("preetham1999_spectra", gas), left=0.0, right=0.0)

    water = k("water") * precipitable_water_cm * m
    mixed = k("mixed") * m
    return {
        "air": np.exp(-0.008735 * micrometre**-RAYLEIGH_EXPONENT * m),
        "aerosol": np.exp(-angstrom_turbidity(turbidity) * micrometre**-ANGSTROM_EXPONENT * m),
        "ozone": np.exp(-k("ozone") * ozone_cm * m),
        "mixed_gases": np.exp(-1.41 * mixed / (1.0 + 118.93 * mixed) ** 0.45),
        "water": np.exp(-0.2385 * water / (1.0 + 20.07 * water) ** 0.45),
    }


def direct_transmittance(wavelength_nm, sun_zenith_deg: float, turbidity: float, **amounts: float) -> np.ndarray:
    """Product of all ``transmittances``: direct sunlight at the ground at normal incidence over F0, (W,)."""
    return np.prod(list(transmittances(wavelength_nm, sun_zenith_deg, turbidity, **amounts).values()), axis=0)
