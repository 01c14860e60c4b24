"""The six AFGL model atmospheres: pressure, temperature and number densities against altitude.

Source: Anderson et al. 1986, AFGL-TR-86-0110, 0 to 120 km.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from twilight.atmosphere.levels import interpolate_coefficient, layer_mean, monotone_cubic
from twilight.base.conventions import ROUNDING
from twilight.base.errors import TwilightError
from twilight.base.shipped_data import data_numbers

PROFILES = (
    "tropical",
    "midlatitude_summer",
    "midlatitude_winter",
    "subarctic_summer",
    "subarctic_winter",
    "us_standard",
)
"""Names of the profiles."""

WHERE_AND_WHEN = {
    "tropical": "15 N, mean of the year",
    "midlatitude_summer": "45 N, July",
    "midlatitude_winter": "45 N, January",
    "subarctic_summer": "60 N, July",
    "subarctic_winter": "60 N, January",
    "us_standard": "US Standard Atmosphere 1976",
}
"""What each profile stands for (Anderson et al. 1986)."""

PROFILE_TOP_KM = 120.0
"""Altitude at which the profiles end [km]."""

MOLAR_MASS_DRY = 28.9647e-3
"""Dry air [kg mol^-1] (Picard et al. 2008, Metrologia 45, 149, with 400 ppm of carbon dioxide: 28.9655)."""

MOLAR_MASS_WATER = 18.01528e-3
"""[kg mol^-1]."""

GAS_CONSTANT = 8.314462618
"""J mol^-1 K^-1, exact (SI 2019)."""

STANDARD_GRAVITY = 9.80665
"""m s^-2: geopotential height is geopotential over this."""

BOLTZMANN_J_PER_K = 1.380649e-23
"""Exact (SI 2019)."""

MOLECULES_PER_CM2_PER_DU = 2.686780e16
"""One Dobson unit: 10 um of gas at 273.15 K and 101325 Pa; Loschmidt constant 2.686780e25 m^-3 (CODATA 2018)."""


def magnus_hpa(celsius: np.ndarray) -> np.ndarray:
    """Pressure of water vapour over water at temperatures [C]: Magnus' formula, WMO-No. 8 (2018), annex 4.B."""
    return 6.112 * np.exp(17.62 * celsius / (243.12 + celsius))


@dataclass(frozen=True)
class AirProfile:
    """State of the air at Z altitudes; all arrays have shape (Z,).

    Between two altitudes temperature and the logarithms of pressure and of the densities of air and water vapour are
    monotone cubics with continuous slopes (:mod:`twilight.atmosphere.levels`); ozone and nitrogen dioxide go
    exponentially, as water vapour does where some level has none; a gas goes linearly to a level without it.
    source: where they come from, in words.
    """

    name: str
    altitude_km: np.ndarray
    pressure_hpa: np.ndarray
    temperature_k: np.ndarray
    air_per_cm3: np.ndarray
    o3_per_cm3: np.ndarray
    h2o_per_cm3: np.ndarray
    no2_per_cm3: np.ndarray
    source: str = ""

    def at(self, altitude_km) -> AirProfile:
        """The same profile at other altitudes, 0 to 120 km."""
        z = np.atleast_1d(np.asarray(altitude_km, dtype=float))
        if z.size and (np.min(z) < self.altitude_km[0] or np.max(z) > self.altitude_km[-1]):
            raise TwilightError(
                f"profile {self.name}: altitude {z.min():g} to {z.max():g} km is outside the table, "
                f"{self.altitude_km[0]:g} to {self.altitude_km[-1]:g} km"
            )

        def exponential(a):
            if np.all(a > 0.0):
                return np.exp(np.interp(z, self.altitude_km, np.log(a)))
            place = np.interp(z, self.altitude_km, np.arange(a.size))
            below = np.minimum(place.astype(int), a.size - 2)
            return interpolate_coefficient(a[below], a[below + 1], place - below)

        def smooth(a):
            return np.exp(monotone_cubic(z, self.altitude_km, np.log(a))) if np.all(a > 0.0) else exponential(a)

        return AirProfile(
            self.name,
            z,
            smooth(self.pressure_hpa),
            monotone_cubic(z, self.altitude_km, self.temperature_k),
            smooth(self.air_per_cm3),
            exponential(self.o3_per_cm3),
            smooth(self.h2o_per_cm3),
            exponential(self.no2_per_cm3),
            self.source,
        )

    def above(self, altitude_km: float) -> AirProfile:
        """The part of the profile from an altitude up; below its first level as it goes on there."""
        if altitude_km < self.altitude_km[0]:
            return self._down_to(altitude_km)
        return self.at(np.concatenate([[altitude_km], self.altitude_km[self.altitude_km > altitude_km]]))

    def _down_to(self, altitude_km: float) -> AirProfile:
        """The profile with a level below its first one: temperature goes on as between its first two, pressure is
        hydrostatic, fractions of water vapour, ozone and nitrogen dioxide stay.

        With T = T0 + L (z - z0), p = p0 (T / T0)^(-g / (R L)), R that of the air's molar mass with its water.
        """
        z, t = self.altitude_km, self.temperature_k
        lapse = (t[1] - t[0]) / (z[1] - z[0])
        below = float(t[0] + lapse * (altitude_km - z[0]))
        molar = MOLAR_MASS_DRY * (
            1.0 - (1.0 - MOLAR_MASS_WATER / MOLAR_MASS_DRY) * self.h2o_per_cm3[0] / self.air_per_cm3[0]
        )
        fall_per_km = 1e3 * STANDARD_GRAVITY * molar / GAS_CONSTANT  # K / km
        depth = fall_per_km * (z[0] - altitude_km)
        log_ratio = depth / t[0] if abs(below - t[0]) < ROUNDING else depth * np.log(below / t[0]) / (below - t[0])
        pressure = self.pressure_hpa[0] * np.exp(log_ratio)
        denser = pressure / self.pressure_hpa[0] * t[0] / below

        def first(values: np.ndarray, value: float) -> np.ndarray:
            return np.concatenate([[value], values])

        return AirProfile(
            self.name,
            first(z, altitude_km),
            first(self.pressure_hpa, pressure),
            first(t, below),
            first(self.air_per_cm3, self.air_per_cm3[0] * denser),
            first(self.o3_per_cm3, self.o3_per_cm3[0] * denser),
            first(self.h2o_per_cm3, self.h2o_per_cm3[0] * denser),
            first(self.no2_per_cm3, self.no2_per_cm3[0] * denser),
            self.source,
        )

    @property
    def water_vapour_pressure_hpa(self) -> np.ndarray:
        """Partial pressure of water vapour n k T [hPa]; number density in cm^-3."""
        return self.h2o_per_cm3 * 1e6 * BOLTZMANN_J_PER_K * self.temperature_k * 1e-2

    @property
    def relative_humidity(self) -> np.ndarray:
        """Water vapour pressure over saturation pressure, 0..1 (Magnus formula over water, WMO 2018 annex 4.B)."""
        celsius = np.clip(self.temperature_k - 273.15, -80.0, 60.0)
        saturation_hpa = magnus_hpa(celsius)
        return np.clip(self.water_vapour_pressure_hpa / saturation_hpa, 0.0, 1.0)

    def column_per_cm2(self, density_per_cm3: np.ndarray) -> float:
        """Vertical column [cm^-2] of one of the densities, exact for the exponential between altitudes."""
        thickness_cm = np.diff(self.altitude_km) * 1e5
        return float(np.sum(layer_mean(density_per_cm3[:-1], density_per_cm3[1:]) * thickness_cm))

    @property
    def ozone_column_du(self) -> float:
        return self.column_per_cm2(self.o3_per_cm3) / MOLECULES_PER_CM2_PER_DU


def profile_of_levels(
    name: str, altitude_km, pressure_hpa, temperature_k, water_vapour_ppm, ozone_ppm, source: str = "atmosphere.levels"
) -> AirProfile:
    """The air of someone's own levels (Z,), n = p / (k T), with the nitrogen dioxide of the AFGL atmosphere `name`.

    water_vapour_ppm, ozone_ppm: molecules per million molecules of moist air.
    """
    z = np.asarray(altitude_km, dtype=float)
    pressure, temperature = np.asarray(pressure_hpa, dtype=float), np.asarray(temperature_k, dtype=float)
    air = pressure * 100.0 / (BOLTZMANN_J_PER_K * temperature) * 1e-6
    o3, h2o = (1e-6 * np.asarray(ppm, dtype=float) * air for ppm in (ozone_ppm, water_vapour_ppm))
    no2 = load_profile(name).above(min(0.0, float(z[0]))).at(z).no2_per_cm3
    return AirProfile(name, z, pressure, temperature, air, o3, h2o, no2, source)


def profile_name(name: str) -> str:
    """The canonical spelling of a profile's name: `Midlatitude summer` and `midlatitude-summer` are the same."""
    canonical = name.strip().lower().replace("-", "_").replace(" ", "_")
    if canonical not in PROFILES:
        raise TwilightError(f"profile: `{name}` is not known; allowed are {', '.join(PROFILES)}")
    return canonical


@lru_cache(maxsize=len(PROFILES))
def _load(name: str) -> AirProfile:
    z, pressure, temperature, air, o3, h2o, no2 = data_numbers(f"atmosphere/afgl_{name}.csv")[1].T
    return AirProfile(name, z, pressure, temperature, air, o3, h2o, no2, f"AFGL 1986, {WHERE_AND_WHEN[name]}")


def load_profile(name: str) -> AirProfile:
    """One of the six AFGL atmospheres on its own 51 altitudes, 0 to 120 km; see ``PROFILES`` for the names."""
    return _load(profile_name(name))
