"""Refractivity n - 1 of air: Ciddor 1996 in full, and the closed form of Haber 2005."""

from __future__ import annotations

import numpy as np

from twilight.base.errors import TwilightError

_GAS_CONSTANT = 8.314510
"""J mol^-1 K^-1, the value on which Ciddor's densities rest (Ciddor 1996, appendix A)."""

_MOLAR_MASS_WATER = 0.018015
"""kg mol^-1 (Ciddor 1996, appendix A)."""

_ZERO_CELSIUS = 273.15
"""K."""


def _standard_refractivities(wavelength_nm) -> tuple[np.ndarray, np.ndarray]:
    """n - 1 of standard dry air (15 C, 101325 Pa, 450 ppm CO2) and of pure water vapour (20 C, 1333 Pa).

    Ciddor 1996 eqs. (1) and (3).  Errors: TwilightError outside 200-2000 nm, where resonances begin.
    """
    wavelength = np.asarray(wavelength_nm, dtype=float)
    if not np.all((wavelength >= 200.0) & (wavelength <= 2000.0)):
        raise TwilightError("refraction: wavelength_nm must be between 200 and 2000 nm")
    s = (1e3 / wavelength) ** 2  # um^-2
    dry = 1e-8 * (5792105.0 / (238.0185 - s) + 167917.0 / (57.362 - s))
    return dry, 1.022e-8 * (295.235 + 2.6422 * s - 0.032380 * s**2 + 0.004028 * s**3)


def _compressibility(temperature_k, pressure_pa, water_fraction):
    """Z of moist air, Ciddor 1996 eq. (12) with the constants of Davis 1992 (BIPM)."""
    t = temperature_k - _ZERO_CELSIUS
    x = water_fraction
    per_t = pressure_pa / temperature_k
    first = 1.58123e-6 - 2.9331e-8 * t + 1.1043e-10 * t**2
    first = first + (5.707e-6 - 2.051e-8 * t) * x + (1.9898e-4 - 2.376e-6 * t) * x**2
    return 1.0 - per_t * first + per_t**2 * (1.83e-11 - 0.765e-8 * x**2)


def ciddor_refractivity(
    wavelength_nm, temperature_k, pressure_hpa, water_vapour_pressure_hpa=0.0, co2_ppm: float = 420.0
) -> np.ndarray:
    """Phase refractivity n - 1 of moist air.

    n - 1 = (rho_a/rho_axs)(n_axs - 1) + (rho_w/rho_ws)(n_ws - 1), densities with the compressibility of moist air.

    wavelength_nm: vacuum wavelength [nm]; temperature_k [K], pressure_hpa: total pressure [hPa];
    water_vapour_pressure_hpa: partial pressure of water vapour [hPa]; co2_ppm: mole fraction of CO2 [1e-6].
    Arrays broadcast; the result has the broadcast shape.

    The mole fraction of water is f(p, t) e/p with the enhancement factor f, as if e came from a relative humidity.
    Valid for 300-1690 nm, -40..100 C, 800-1200 hPa, 0-100 % humidity to 2-5e-8; below 800 hPa the densities tend to
    those of an ideal gas, so the error stays below that.  Outside 200-2000 nm it is refused (resonances).

    Source: Ciddor 1996, Appl. Opt. 35, 1566, eqs. (1)-(5), (12) and appendix B.
    """
    t_k = np.asarray(temperature_k, dtype=float)
    p = np.asarray(pressure_hpa, dtype=float) * 100.0
    e = np.asarray(water_vapour_pressure_hpa, dtype=float) * 100.0
    dry_standard, water_standard = _standard_refractivities(wavelength_nm)
    if not np.all((t_k > 100.0) & (t_k < 1500.0)):
        raise TwilightError("refraction: temperature_k must be between 100 and 1500 K")
    if not (np.all((p >= 0.0) & np.isfinite(p)) and np.all((e >= 0.0) & (e <= np.maximum(p, 0.0)))):
        raise TwilightError("refraction: pressure_hpa must not be negative, nor water_vapour_pressure_hpa exceed it")
    if not 0.0 <= co2_ppm < 1e6:
        raise TwilightError("refraction: co2_ppm must be between 0 and 1e6")
    dry_standard = dry_standard * (1.0 + 0.534e-6 * (co2_ppm - 450.0))  # eq. (2)
    molar_mass_dry = 1e-3 * (28.9635 + 12.011e-6 * (co2_ppm - 400.0))
    t = t_k - _ZERO_CELSIUS
    enhancement = 1.00062 + 3.14e-8 * p + 5.6e-7 * t**2
    with np.errstate(invalid="ignore", divide="ignore"):
        x = np.where(p > 0.0, np.minimum(1.0, enhancement * e / np.where(p > 0.0, p, 1.0)), 0.0)
    z = _compressibility(t_k, p, x)
    moles = p / (z * _GAS_CONSTANT * t_k)
    dry_density = moles * molar_mass_dry * (1.0 - x)
    water_density = moles * _MOLAR_MASS_WATER * x
    dry_reference = 101325.0 * molar_mass_dry / (_compressibility(288.15, 101325.0, 0.0) * _GAS_CONSTANT * 288.15)
    water_reference = 1333.0 * _MOLAR_MASS_WATER / (_compressibility(293.15, 1333.0, 1.0) * _GAS_CONSTANT * 293.15)
    return dry_density / dry_reference * dry_standard + water_density / water_reference * water_standard


def haber_refractivity(wavelength_nm, altitude_km, relative_humidity=0.0) -> np.ndarray:
    """Refractivity n - 1 of air as Haber 2005 sec. 4.4 uses it.

    n - 1 = exp(-h / 8 km) ((1 - w) dry + w wet), with Ciddor's dispersion formulas of standard dry air (15 C, 1013.25
    hPa) and of pure water vapour at 13.33 hPa.

    wavelength_nm [nm], altitude_km [km], relative_humidity w: 0 (dry) to 1 (saturated).  Arrays broadcast.
    The formula mixes n - 1 of both, so that saturated air refracts like vapour at 13 hPa.  It is here as Haber has it;
    :func:`ciddor_refractivity` is physical.
    """
    w = np.asarray(relative_humidity, dtype=float)
    dry, wet = _standard_refractivities(wavelength_nm)
    if not np.all((w >= 0.0) & (w <= 1.0)):
        raise TwilightError("refraction: relative_humidity must be between 0 and 1")
    return np.exp(-np.asarray(altitude_km, dtype=float) / 8.0) * ((1.0 - w) * dry + w * wet)
