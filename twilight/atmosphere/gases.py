"""Absorption by ozone, nitrogen dioxide and pairs of oxygen molecules.

Cross sections are means over 1 nm at 301 to 899 nm (vacuum), tabulated at several temperatures:
ozone Serdyuchenko et al. 2014 (193 to 293 K), NO2 Vandaele et al. 1998 (220 and 294 K), O2-O2 HITRAN 2016 collision
induced absorption (200 to 293 K).  They are linear in wavelength and in temperature, and keep the edge value outside
the tabulated temperatures.  From 301 down to 280 nm ozone is that of Malicet et al. 1995 (218 to 295 K), scaled at
every temperature to meet the other table at 301 nm (by 0.97 to 1.01), and the others keep the row of 301 nm, where they
are far weaker than ozone (vertical optical depth of O2-O2 0, of NO2 6e-4); 900 to 1000 nm take the row of 899 nm, where
all three are weak (vertical optical depth of ozone 5e-4, of O2-O2 2e-4, of NO2 0).
"""

from __future__ import annotations

import math
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from twilight.atmosphere.levels import vertical_integral
from twilight.atmosphere.profiles import AirProfile
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
    return column_du / profile.ozone_column_du


def overhead_ozone_optical_depth(profile: AirProfile, wavelength_nm, factor: float = 1.0) -> np.ndarray:
    """Vertical optical depth (W,) of all the ozone of a profile, at the temperatures of its altitudes."""
    return vertical_integral(absorption_per_km("o3", profile, wavelength_nm, factor), profile.altitude_km)
