"""What a file can hold of the air, one class for each kind of measurement; conversions of humidity; the usual ozone.

Humidity, virtual temperature, geopotential height: e is the partial pressure of water vapour, p the pressure, epsilon
the ratio of the molar masses of water and dry air.

The usual ozone column of a latitude and day: zonal means of sondes and satellites.

Linear in latitude between bands of 10 deg and in time between the middles of the months, constant poleward of 85 deg.
Columns of single days differ from the mean by 20 to 40 DU (the weather of the stratosphere) and, in the north, by up to
20 DU with longitude.

References
----------
McPeters, Labow and Logan 2007, J. Geophys. Res. 112, D05308.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import lru_cache

import numpy as np

from twilight.atmosphere.profiles import GAS_CONSTANT as GAS_CONSTANT
from twilight.atmosphere.profiles import MOLAR_MASS_DRY as MOLAR_MASS_DRY
from twilight.atmosphere.profiles import MOLAR_MASS_WATER as MOLAR_MASS_WATER
from twilight.atmosphere.profiles import STANDARD_GRAVITY as STANDARD_GRAVITY
from twilight.atmosphere.profiles import magnus_hpa
from twilight.base.shipped_data import data_numbers

MOLAR_MASS_OZONE = 47.9982e-3
"""[kg mol^-1]."""
EPSILON = MOLAR_MASS_WATER / MOLAR_MASS_DRY
COLDEST_C = -100.0
"""Temperature from which on Magnus' formula is used [C]; its source says -45, below which water hardly matters."""
WARMEST_C = 60.0
"""Temperature up to which its source states it [C]."""


def saturation_pressure_hpa(temperature_k):
    """Pressure of water vapour in equilibrium with (supercooled) water: Magnus' formula, WMO-No. 8 (2018), annex 4.B.

    Sondes report their relative humidity and dew point over water at all temperatures.
    """
    celsius = np.clip(np.asarray(temperature_k, dtype=float) - 273.15, COLDEST_C, WARMEST_C)
    return magnus_hpa(celsius)


def from_dew_point(dew_point_k, pressure_hpa):
    """Molecules of water per molecule of moist air, e / p, of a dew point."""
    return saturation_pressure_hpa(dew_point_k) / pressure_hpa


def from_relative_humidity(percent, temperature_k, pressure_hpa):
    """Molecules of water per molecule of moist air, e / p, of a relative humidity over water [%]."""
    return 0.01 * np.asarray(percent, dtype=float) * saturation_pressure_hpa(temperature_k) / pressure_hpa


def from_specific_humidity(kg_per_kg):
    """Molecules of water per molecule of moist air, q / (epsilon + (1 - epsilon) q), from kg per kg of moist air."""
    q = np.asarray(kg_per_kg, dtype=float)
    return q / (EPSILON + (1.0 - EPSILON) * q)


def ozone_from_mass_mixing_ratio(kg_per_kg, water_vapour):
    """Molecules of ozone per molecule of moist air from kg of ozone per kg of moist air."""
    molar_mass = MOLAR_MASS_DRY * (1.0 - (1.0 - EPSILON) * water_vapour)
    return np.asarray(kg_per_kg, dtype=float) * molar_mass / MOLAR_MASS_OZONE


def virtual_temperature_k(temperature_k, water_vapour):
    """Temperature of dry air of the same density, T / (1 - (1 - epsilon) x), x the molecules of water per molecule."""
    return temperature_k / (1.0 - (1.0 - EPSILON) * water_vapour)


def gravity_at_sea_level(latitude_deg):
    """Normal gravity [m s^-2] on the ellipsoid, Somigliana's formula with WGS 84 (NIMA TR8350.2, eq. 4-1)."""
    s2 = np.sin(np.radians(latitude_deg)) ** 2
    return 9.7803253359 * (1.0 + 0.00193185265241 * s2) / np.sqrt(1.0 - 0.00669437999013 * s2)


def geometric_km(geopotential_km, latitude_deg):
    """Geometric altitude [km] of a geopotential height [km] at a latitude: z = R H / (g R / g0 - H).

    R = 6378.137 km / (1.006803 - 0.006706 sin^2(latitude)) is the radius with which gravity falls off.
    Source: Mahoney 2001, A discussion of various measures of altitude (NASA JPL); good to metres up to 80 km.
    """
    height = np.asarray(geopotential_km, dtype=float)
    radius = 6378.137 / (1.006803 - 0.006706 * np.sin(np.radians(latitude_deg)) ** 2)
    ratio = gravity_at_sea_level(latitude_deg) / STANDARD_GRAVITY
    return radius * height / (ratio * radius - height)


def geopotential_km(geometric_altitude_km, latitude_deg):
    """The inverse of `geometric_km`."""
    z = np.asarray(geometric_altitude_km, dtype=float)
    radius = 6378.137 / (1.006803 - 0.006706 * np.sin(np.radians(latitude_deg)) ** 2)
    return gravity_at_sea_level(latitude_deg) / STANDARD_GRAVITY * radius * z / (radius + z)


MIDDLE_OF_MONTH = np.array([16.0, 45.0, 75.0, 105.5, 136.0, 166.5, 197.0, 228.0, 258.5, 289.0, 319.5, 350.0])
"""Day of the year."""
DAYS = 365.25


@lru_cache(maxsize=1)
def _table() -> tuple[np.ndarray, np.ndarray]:
    names, rows = data_numbers("gases/ozone_columns_mcpeters2007.csv")
    return np.array([float(name) for name in names[1:]]), rows[:, 1:]


def climatological_column_du(latitude_deg: float, day_of_year: float) -> float:
    """The usual ozone column [DU]; latitude north positive, day 1 to 366."""
    latitude, months = _table()
    at_latitude = np.array([np.interp(latitude_deg, latitude, row) for row in months])
    return float(np.interp(day_of_year, MIDDLE_OF_MONTH, at_latitude, period=DAYS))


def climatology_source(latitude_deg: float, day_of_year: float) -> str:
    """The climatology, its latitude and its day, in words."""
    return f"zonal mean (McPeters, Labow and Logan 2007), {latitude_deg:.4g} N, day {day_of_year:g}"


@dataclass(frozen=True)
class AirColumn:
    """Air above a place, at Z altitudes from the lowest up; all arrays have shape (Z,).

    altitude_km: geometric, above sea level, increasing.  pressure_hpa decreases.
    water_vapour, ozone: molecules per molecule of moist air; NaN at altitudes without, None where the file has none.
    source: the file and what it measured where and when, in words.
    """

    source: str
    altitude_km: np.ndarray
    pressure_hpa: np.ndarray
    temperature_k: np.ndarray
    water_vapour: np.ndarray | None = None
    ozone: np.ndarray | None = None


@dataclass(frozen=True)
class OzoneColumn:
    """Ozone above the ground [DU]."""

    source: str
    column_du: float


@dataclass(frozen=True)
class WaterColumn:
    """Precipitable water [mm]."""

    source: str
    column_mm: float


@dataclass(frozen=True)
class AerosolDepth:
    """Optical depth (C,) of all aerosol at wavelengths (C,) [nm], increasing; one or more."""

    source: str
    wavelength_nm: np.ndarray
    optical_depth: np.ndarray


@dataclass(frozen=True)
class SizeDistribution:
    """Sizes and refractive index of the aerosol of a column.

    radius_um: (R,), equidistant in ln r; volume_um3_per_um2: (R,), dV/dln r of the column.
    wavelength_nm: (C,), of the index n - ik (C,) and of the extinction's optical_depth (C,).
    """

    source: str
    radius_um: np.ndarray
    volume_um3_per_um2: np.ndarray
    wavelength_nm: np.ndarray
    index: np.ndarray
    optical_depth: np.ndarray


@dataclass(frozen=True)
class CloudWater:
    """Clouds above a place at Z altitudes from the lowest up; all arrays have shape (Z,).

    cover: fraction of the sky.  liquid_kg_per_m2, ice_kg_per_m2: of the air that each altitude stands for, the mean
    over cloud and clear.  base_km, top_km: of that air.
    """

    source: str
    base_km: np.ndarray
    top_km: np.ndarray
    cover: np.ndarray
    liquid_kg_per_m2: np.ndarray
    ice_kg_per_m2: np.ndarray


Part = AirColumn | OzoneColumn | WaterColumn | AerosolDepth | SizeDistribution | CloudWater


@dataclass(frozen=True)
class Reading:
    """The parts that were taken from one file, and what it holds besides that is not used, in words.

    warnings: sentences on what lies far from the place and time that were asked for.
    """

    kind: str
    parts: tuple[Part, ...]
    not_used: tuple[str, ...] = field(default=())
    warnings: tuple[str, ...] = field(default=())
