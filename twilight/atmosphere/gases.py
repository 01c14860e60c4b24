"""Absorption by ozone, nitrogen dioxide and pairs of oxygen molecules.

Cross sections are means over 1 nm at 301 to 899 nm (vacuum), tabulated at several temperatures:
ozone Serdyuchenko et al. 2014 (193 to 293 K), NO2 Vandaele et al. 1998 (220 and 294 K), O2-O2 HITRAN 2016 collision
induced absorption (200 to 293 K).  They are linear in wavelength and in temperature, and keep the edge value outside
the tabulated temperatures.  From 301 down to 280 nm ozone is that of Malicet et al. 1995 (218 to 295 K), scaled at
every temperature to meet the other table at 301 nm (by 0.97 to 1.01), and the others keep the row of 301 nm, where they
are far weaker than ozone (vertical optical depth of O2-O2 0, of NO2 6e-4); 900 to 1000 nm take the row of 899 nm, where
all three are weak (vertical optical depth of ozone 5e-4, of O2-O2 2e-4, of NO2 0).

Scattering by air molecules after Bodhaine, Wood, Dutton & Slusser 1999, J. Atmos. Oceanic Technol. 16, 1854.

Refractivity n - 1 of air: Ciddor 1996 in full, and the closed form of Haber 2005.
"""

from __future__ import annotations

import math
from functools import lru_cache
from pathlib import Path
from typing import NamedTuple

import numpy as np

from twilight.atmosphere.csv_columns import Columns, read_columns
from twilight.atmosphere.levels import vertical_integral
from twilight.atmosphere.profiles import MOLECULES_PER_CM2_PER_DU, AirProfile
from twilight.base.errors import TwilightError
from twilight.base.shipped_data import data_numbers

OXYGEN_FRACTION = 0.2095
"""Volume of O2 in dry air, constant up to about 85 km; above, pairs of molecules do not matter."""
MIN_WAVELENGTH_NM = 280.0
"""Where the optical data begin [nm]."""
MAX_WAVELENGTH_NM = 1000.0
"""Where the optical data end [nm]."""
_TABLES = {"o3": "o3_serdyuchenko2014", "no2": "no2_vandaele1998", "o4": "o2o2_hitran2016"}
"""File of each gas in data/gases."""
OWN_COLUMNS: Columns = {"wavelength_nm": (100.0, 2e4, "100 to 20000"), "cross_section_cm2": (0.0, 1e-10, "0 to 1e-10")}
"""Columns of the file of a gas of one's own, with the range that is allowed."""
_OZONE_BELOW_301_NM = "o3_malicet1995"
"""Of ozone at 279 to 301 nm."""


def check_wavelengths(wavelength_nm) -> np.ndarray:
    """The wavelengths as a 1-D array of floats; raises TwilightError where the program has no optical data for one."""
    w = np.atleast_1d(np.asarray(wavelength_nm, dtype=float))
    if w.ndim != 1 or w.size == 0 or not np.all(np.isfinite(w)):
        raise TwilightError("wavelength_nm must be a list of one or more numbers")
    if np.min(w) < MIN_WAVELENGTH_NM or np.max(w) > MAX_WAVELENGTH_NM:
        bad = w[(w < MIN_WAVELENGTH_NM) | (w > MAX_WAVELENGTH_NM)][0]
        raise TwilightError(
            f"wavelength_nm: {bad:g} is outside the optical data, allowed is "
            f"{MIN_WAVELENGTH_NM:g} to {MAX_WAVELENGTH_NM:g} nm"
        )
    if w.size > 1 and np.any(np.diff(w) <= 0):
        raise TwilightError("wavelength_nm must increase from one wavelength to the next")
    return w


class TemperatureTable(NamedTuple):
    """Values (W, T) at wavelengths (W,) [nm] and temperatures (T,) [K]."""

    wavelength_nm: np.ndarray
    temperature_k: np.ndarray
    values: np.ndarray

    @staticmethod
    def read(path: str) -> TemperatureTable:
        """A file of twilight/data, with a column for each temperature."""
        names, rows = data_numbers(path)
        return TemperatureTable(rows[:, 0], np.array([float(name[1:-1]) for name in names[1:]]), rows[:, 1:])

    def at(
        self, nm: np.ndarray, kelvin: np.ndarray, left: float | None = None, right: float | None = None
    ) -> np.ndarray:
        """Linear in wavelength and temperature, (Z, W), with the edge value outside the temperatures.

        left, right: values below the first and above the last wavelength; None: those at the edge.
        """
        at_nm = np.stack([np.interp(nm, self.wavelength_nm, column, left, right) for column in self.values.T])
        return np.stack([np.interp(kelvin, self.temperature_k, column) for column in at_nm.T], axis=1)


@lru_cache(maxsize=len(_TABLES))
def _table(gas: str) -> TemperatureTable:
    nm, temperature_k, values = TemperatureTable.read(f"gases/{_TABLES[gas]}.csv")
    if gas == "o3":
        below_nm, below_k, below = TemperatureTable.read(f"gases/{_OZONE_BELOW_301_NM}.csv")
        below = np.stack([np.interp(temperature_k, below_k, row) for row in below])
        below *= values[0] / below[-1]
        nm, values = np.concatenate([below_nm[:-1], nm]), np.concatenate([below[:-1], values])
    return TemperatureTable(nm, temperature_k, values)


def cross_section(gas: str, wavelength_nm, temperature_k) -> np.ndarray:
    """Absorption cross section at each temperature and wavelength, shape (Z, W).

    gas: `o3` or `no2` [cm^2 per molecule], `o4` [cm^5 per molecule^2, to multiply the square of the O2 density].
    """
    wavelength = np.atleast_1d(np.asarray(wavelength_nm, dtype=float))
    temperature = np.atleast_1d(np.asarray(temperature_k, dtype=float))
    return _table(gas).at(wavelength, temperature)


def absorption_per_km(gas: str, profile: AirProfile, wavelength_nm, factor: float = 1.0) -> np.ndarray:
    """Absorption coefficient [km^-1] of `o3`, `no2` or `o4` in a profile, (Z, W); `factor` multiplies the density."""
    density = {
        "o3": profile.o3_per_cm3 * factor,
        "no2": profile.no2_per_cm3 * factor,
        "o4": (OXYGEN_FRACTION * profile.air_per_cm3 * factor) ** 2,
    }[gas]
    return density[:, None] * cross_section(gas, wavelength_nm, profile.temperature_k) * 1e5


def own_absorption_per_km(
    file: str, column_du: float, full: AirProfile, state: AirProfile, wavelength_nm: np.ndarray
) -> np.ndarray:
    """Absorption coefficient [km^-1] of a gas that is mixed evenly into the air, (Z, W).

    file: CSV of wavelength_nm and cross_section_cm2, linear between them; full: the profile whose column it has.
    Errors: TwilightError for a table that is none, or does not reach as far as the wavelengths.
    """
    names, rows, _ = read_columns(Path(file), OWN_COLUMNS)
    nm, section = rows[np.argsort(rows[:, names.index("wavelength_nm")])].T[:: 1 if names[0] == "wavelength_nm" else -1]
    if wavelength_nm[0] < nm[0] or wavelength_nm[-1] > nm[-1]:
        raise TwilightError(
            f"{file}: has {nm[0]:g} to {nm[-1]:g} nm, asked for are {wavelength_nm[0]:g} to {wavelength_nm[-1]:g} nm; "
            "give 0 where it absorbs nothing"
        )
    part = column_du * MOLECULES_PER_CM2_PER_DU / full.column_per_cm2(full.air_per_cm3)
    return part * state.air_per_cm3[:, None] * np.interp(wavelength_nm, nm, section) * 1e5


def seasonal_ozone_column_du(day_of_year: float) -> float:
    """Ozone column [DU] over the year: the range 260 to 370 DU of Haber 2005 sec. 4.3 as a sinusoid.

    U = 315 + 55 cos(2 pi (d - 95)/365.25): largest in early April, smallest in early October, as in northern
    midlatitudes (Haber gives the range, the phase is that of the mean annual course there).
    """
    if not (math.isfinite(day_of_year) and 1 <= day_of_year < 367):
        raise TwilightError(f"ozone_day_of_year: {day_of_year} is not a day of the year, allowed is 1 to 366")
    return 315.0 + 55.0 * math.cos(2.0 * math.pi * (day_of_year - 95.0) / 365.25)


def ozone_factor(profile: AirProfile, column_du: float | None) -> float:
    """Factor on the ozone densities of a whole profile (0 to 120 km) that gives it the column; 1 for None."""
    if column_du is None:
        return 1.0
    if not (math.isfinite(column_du) and 0.0 <= column_du <= 2000.0):
        raise TwilightError(f"ozone_column_du: {column_du} is not possible, allowed is 0 to 2000 DU")
    own = profile.ozone_column_du
    if own == 0.0 and column_du > 0.0:
        raise TwilightError(
            f"gases.ozone.column_du is {column_du:g}, but the levels have no ozone at any altitude; allowed is 0"
        )
    return column_du / own if own > 0.0 else 1.0


def overhead_ozone_optical_depth(profile: AirProfile, wavelength_nm, factor: float = 1.0) -> np.ndarray:
    """Vertical optical depth (W,) of all the ozone of a profile, at the temperatures of its altitudes."""
    return vertical_integral(absorption_per_km("o3", profile, wavelength_nm, factor), profile.altitude_km)


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
