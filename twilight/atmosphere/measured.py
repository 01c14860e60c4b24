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

One profile from a measured column of air and the air of a climate around it.  Within the measured column pressure goes
hydrostatically between its altitudes (the integral of 1 / T_v, stretched to meet both ends), temperature linearly.
Mixing ratios of water and ozone are the climate's times a factor whose logarithm is linear between the measured
altitudes, so that few of them still make a profile with a climate's bends.  At the program's levels all are polygons of
least squares through the column: what is finer than the levels is smoothed, what is linear between them is kept
exactly.  Above its top the difference of temperature to the climate's air fades out over FADE_KM, as do the factors.
Pressure goes on from the measured one:

    d ln p / dz = (d ln p / dz of the climate) T_v(climate) / T_v,

which is the hydrostatic equation with whatever gravity and molar mass the climate's air has, so that p is continuous
and the climate's own column joined onto itself stays as it is.  Gases that were not measured keep their number density.
Below the lowest altitude temperature goes on by 6.5 K/km, the factors stay.  Between levels the program goes by
monotone cubics with continuous slope, so that no kink is left in the refractive index.

Layers of cloud from the cloud water of an analysis: where at least OVERCAST of the sky is covered, neighbouring
altitudes with water (or with ice) are one homogeneous layer over the whole sky, the only clouds that the program knows.
Its optical depth is that of particles that are large against the wavelength, whose extinction is twice their area
(Stephens 1978, J. Atmos. Sci. 35, 2123, eq. 7):

    tau = 3 W / (2 rho r_e),   W the water [kg m^-2], rho its density as liquid or ice, r_e the effective radius.
"""

from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import lru_cache

import numpy as np

from twilight.atmosphere.clouds import KINDS, CloudLayer
from twilight.atmosphere.profiles import BOLTZMANN_J_PER_K, AirProfile, magnus_hpa
from twilight.atmosphere.profiles import GAS_CONSTANT as GAS_CONSTANT
from twilight.atmosphere.profiles import MOLAR_MASS_DRY as MOLAR_MASS_DRY
from twilight.atmosphere.profiles import MOLAR_MASS_WATER as MOLAR_MASS_WATER
from twilight.atmosphere.profiles import STANDARD_GRAVITY as STANDARD_GRAVITY
from twilight.base.errors import TwilightError
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
    where = f"{abs(latitude_deg):.4g} {'S' if latitude_deg < 0.0 else 'N'}"
    return f"zonal mean (McPeters et al. 2007), {where}, day {day_of_year:g}"


YEAR: tuple[float, ...] = tuple(MIDDLE_OF_MONTH)
"""Days over which what has no season is the mean."""
OF_PROFILES: dict[str, tuple[float, tuple[float, ...]]] = {
    "tropical": (15.0, YEAR),
    "midlatitude_summer": (45.0, (197.0,)),
    "midlatitude_winter": (45.0, (16.0,)),
    "subarctic_summer": (60.0, (197.0,)),
    "subarctic_winter": (60.0, (16.0,)),
    "us_standard": (45.0, YEAR),
}
"""Latitude [deg] and days of the year for which the AFGL profiles stand (Anderson et al. 1986)."""


def profile_column_du(profile: str) -> tuple[float, str]:
    """The usual ozone column [DU] of an AFGL profile's latitude and season, and its source in words."""
    latitude, days = OF_PROFILES[profile]
    column = float(np.mean([climatological_column_du(latitude, day) for day in days]))
    season = f"day {days[0]:g}" if len(days) == 1 else "the year"
    return column, f"zonal mean (McPeters et al. 2007), {latitude:g} N, {season}, as {profile}"


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


OVERCAST = 0.5
"""Covered fraction of an altitude from which it counts as covered."""
LEAST_DEPTH = 0.05
"""Thinner layers are left out: they cannot be told from the analysis' noise."""
MIDDLE_KM = 2.0
"""From this base on droplets are altostratus (International Cloud Atlas, WMO)."""
KG_PER_M3 = {"water": 1000.0, "ice": 917.0}


def optical_depth(kg_per_m2: float, substance: str, effective_radius_um: float) -> float:
    """Optical depth of large particles of `water` or `ice`."""
    return 1.5 * kg_per_m2 / (KG_PER_M3[substance] * effective_radius_um * 1e-6)


def decks(water: CloudWater) -> list[CloudLayer]:
    """The layers of cloud, from the lowest up, liquid before ice."""
    return [
        layer
        for substance, amount in (("water", water.liquid_kg_per_m2), ("ice", water.ice_kg_per_m2))
        for layer in _layers(water, substance, amount)
    ]


def _layers(water: CloudWater, substance: str, kg_per_m2: np.ndarray) -> Iterator[CloudLayer]:
    covered = np.concatenate([[False], (water.cover >= OVERCAST) & (kg_per_m2 > 0.0), [False]])
    first = np.flatnonzero(covered[1:] & ~covered[:-1])
    last = np.flatnonzero(covered[:-1] & ~covered[1:])
    for a, b in zip(first, last, strict=True):
        base, top = float(water.base_km[a]), float(water.top_km[b - 1])
        kind = "cirrus" if substance == "ice" else "stratus" if base < MIDDLE_KM else "altostratus"
        radius = KINDS[kind].effective_radius_um
        depth = optical_depth(float(np.sum(kg_per_m2[a:b])), substance, radius)
        if depth >= LEAST_DEPTH:
            yield CloudLayer(kind, max(0.0, base), top, depth, radius)


def most_cover(water: CloudWater) -> float:
    """Largest covered fraction of any altitude with water or ice; 0 where there are none."""
    wet = water.liquid_kg_per_m2 + water.ice_kg_per_m2 > 0.0
    return float(np.max(water.cover[wet], initial=0.0))


FADE_KM = 10.0
"""Over so much air above the top of a measurement the climate's own air takes over [km]."""
LAPSE_K_PER_KM = 6.5
"""Below the lowest measured altitude temperature rises so much downwards (US Standard Atmosphere 1976) [K/km]."""
FINE_KM = 0.02
"""Step of integrals and of the polygon's fit [km]."""
LOW_LEVELS_KM = (0.0, 0.25, 0.5, 0.75, 1.0, 1.25, 1.5, 1.75, 2.0, 2.5, 3.0, 3.5)
"""Levels below the climate's of 4 km: the boundary layer and its inversion."""
LEAST_SPAN_KM = 2.0
"""A column that reaches over less is no profile."""
LEAST_FRACTION = 1e-12
"""Smallest mixing ratio that is kept: 0 has no logarithm."""


def join(column: AirColumn, around: AirProfile) -> AirProfile:
    """A column of air inside the air of a climate, at levels from 0 km to the top of that air.

    Errors: TwilightError for a column that is not in order, or not possible.
    """
    z, pressure, temperature = column.altitude_km, column.pressure_hpa, column.temperature_k
    _check(column)
    bottom, top = float(z[0]), float(min(z[-1], around.altitude_km[-1]))
    low = np.array(LOW_LEVELS_KM)
    levels = np.unique(np.concatenate([low, around.altitude_km[around.altitude_km > low[-1]]]))
    fine = np.unique(np.concatenate([np.arange(0.0, levels[-1], FINE_KM), levels, [bottom, top]]))
    outer = around.at(fine)
    inside = fine <= top

    outer_water = outer.h2o_per_cm3 / outer.air_per_cm3
    of_water = _gas(column.water_vapour, z, fine, levels, outer_water, top)
    of_temperature = _continued(fine, levels, z, temperature, top, outer.temperature_k)
    below = fine < bottom
    of_temperature[below] = np.interp(bottom, fine, of_temperature) + LAPSE_K_PER_KM * (bottom - fine[below])

    virtual = virtual_temperature_k(of_temperature, outer_water if of_water is None else of_water)
    outer_virtual = virtual_temperature_k(outer.temperature_k, outer_water)
    # ln p from one fine altitude to the next, were it for the temperatures alone
    step = (
        np.diff(np.log(outer.pressure_hpa))
        * 0.5
        * (outer_virtual[1:] / virtual[1:] + outer_virtual[:-1] / virtual[:-1])
    )
    course = np.concatenate([[0.0], np.cumsum(step)])
    at_points = np.interp(z, fine, course)
    log_pressure = np.interp(-course, -at_points, np.log(pressure))
    log_pressure[~inside] = np.interp(top, z, np.log(pressure)) + course[~inside] - np.interp(top, fine, course)
    log_pressure[below] = np.log(pressure[0]) + course[below] - at_points[0]

    at = np.searchsorted(fine, levels)
    p, t = np.exp(log_pressure[at]), of_temperature[at]
    air = p * 100.0 / (BOLTZMANN_J_PER_K * t) * 1e-6
    there = around.at(levels)
    h2o = there.h2o_per_cm3 if of_water is None else of_water[at] * air
    of_ozone = _gas(column.ozone, z, fine, levels, outer.o3_per_cm3 / outer.air_per_cm3, top)
    o3, source = there.o3_per_cm3, around.source
    if of_ozone is not None:
        o3, source = of_ozone[at] * air, column.source
    if np.any(np.diff(p) >= 0.0) or not np.all(np.isfinite(p) & np.isfinite(t) & (t > 0.0)):
        raise TwilightError(f"{column.source}: pressure does not fall with altitude")
    return AirProfile(around.name, levels, p, t, air, o3, np.minimum(h2o, 0.2 * air), there.no2_per_cm3, source)


def _check(column: AirColumn) -> None:
    z, pressure, temperature = column.altitude_km, column.pressure_hpa, column.temperature_k
    if z.size < 3 or z[-1] - z[0] < LEAST_SPAN_KM:
        span = f"{z[0]:.3g} to {z[-1]:.3g} km" if z.size else "no altitude"
        raise TwilightError(
            f"{column.source}: has {z.size} altitudes with pressure and temperature ({span}); a profile needs 3 or "
            f"more over at least {LEAST_SPAN_KM:g} km"
        )
    if np.any(np.diff(z) <= 0.0) or np.any(np.diff(pressure) >= 0.0):
        raise TwilightError(f"{column.source}: altitude must increase and pressure fall from one row to the next")
    # the hypsometric equation between the ends: a column of another unit, or rows of two columns mixed
    slope = -np.diff(np.log(pressure)) / np.diff(z)  # 1 / km
    kelvin = 1e3 * STANDARD_GRAVITY * MOLAR_MASS_DRY / (GAS_CONSTANT * slope)
    mean = np.sum(kelvin * np.diff(z)) / (z[-1] - z[0])
    own = np.trapezoid(temperature, z) / (z[-1] - z[0])
    if abs(mean / own - 1.0) > 0.05:
        raise TwilightError(
            f"{column.source}: its altitudes and pressures mean {mean:.0f} K and its temperatures {own:.0f} K: they do "
            "not belong together (units?)"
        )


def _gas(
    measured: np.ndarray | None, z: np.ndarray, fine: np.ndarray, levels: np.ndarray, outer: np.ndarray, top_km: float
) -> np.ndarray | None:
    """Mixing ratio (F,) at the fine altitudes; None where less than two altitudes have one.

    measured (Z,) at altitudes z (Z,), NaN where there is none; outer (F,): the climate's.
    """
    known = np.zeros(0, dtype=bool) if measured is None else np.isfinite(measured)
    if measured is None or np.count_nonzero(known) < 2 or z[known][0] >= top_km:
        return None
    outer = np.maximum(outer, LEAST_FRACTION)
    own = np.interp(z[known], fine, np.log(outer))
    factor = np.log(np.maximum(measured[known], LEAST_FRACTION)) - own
    return outer * np.exp(_continued(fine, levels, z[known], factor, top_km, np.zeros_like(outer)))


def _continued(
    fine: np.ndarray, levels: np.ndarray, z: np.ndarray, y: np.ndarray, top_km: float, outer: np.ndarray
) -> np.ndarray:
    """A measured quantity y (N,) at z (N,) [km] and the climate's above it, at the fine altitudes (F,).

    Up to its top the polygon over the levels that is nearest (least squares) to the one through y, constant below its
    bottom; above it outer (F,), with the difference at the top fading out.
    """
    bottom, top = float(z[0]), min(float(z[-1]), top_km)
    inner = levels[(levels > bottom) & (levels < top)]
    corner = np.concatenate([[bottom], inner, [top]])
    if corner.size > 2:  # a corner at less than a third of a step from an end says nothing of its own
        gaps = np.diff(corner)
        keep = np.ones(corner.size, dtype=bool)
        if gaps[0] < gaps[1] / 3.0:
            keep[1] = False
        if corner.size > 3 and gaps[-1] < gaps[-2] / 3.0:
            keep[-2] = False
        corner = corner[keep]
    x = fine[(fine >= bottom) & (fine <= top)]
    hats = np.stack([np.interp(x, corner, unit) for unit in np.eye(corner.size)], axis=1)
    value, *_ = np.linalg.lstsq(hats, np.interp(x, z, y), rcond=None)
    out = np.interp(fine, corner, value)
    above = fine > top
    part = np.clip((fine[above] - top) / FADE_KM, 0.0, 1.0)
    fade = 1.0 - part * part * (3.0 - 2.0 * part)  # 1 to 0 with slope 0 at both ends
    out[above] = outer[above] + (out[above] - np.interp(top, fine, outer)) * fade
    return out
