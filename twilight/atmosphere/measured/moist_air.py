"""Humidity in its several measures, virtual temperature, and geopotential height: arrays of any shape.

e is the partial pressure of water vapour, p the pressure, epsilon the ratio of the molar masses of water and dry air.
"""

from __future__ import annotations

import numpy as np

from twilight.atmosphere.profiles import GAS_CONSTANT as GAS_CONSTANT
from twilight.atmosphere.profiles import MOLAR_MASS_DRY as MOLAR_MASS_DRY
from twilight.atmosphere.profiles import MOLAR_MASS_WATER as MOLAR_MASS_WATER
from twilight.atmosphere.profiles import STANDARD_GRAVITY as STANDARD_GRAVITY
from twilight.atmosphere.profiles import magnus_hpa

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
