"""One profile from a measured column of air and the air of a climate around it.

Within the measured column pressure goes hydrostatically between its altitudes (the integral of 1 / T_v, stretched to
meet both ends), temperature linearly.  Mixing ratios of water and ozone are the climate's times a factor whose
logarithm is linear between the measured altitudes, so that few of them still make a profile with a climate's bends.  At
the program's levels all are polygons of least squares through the column: what is finer than the levels is smoothed,
what is linear between them is kept exactly.

Above its top the difference of temperature to the climate's air fades out over FADE_KM, as do the factors.  Pressure
goes on from the measured one:

    d ln p / dz = (d ln p / dz of the climate) T_v(climate) / T_v,

which is the hydrostatic equation with whatever gravity and molar mass the climate's air has, so that p is continuous
and the climate's own column joined onto itself stays as it is.  Gases that were not measured keep their number density.
Below the lowest altitude temperature goes on by 6.5 K/km, the factors stay.  Between levels the program goes by
monotone cubics with continuous slope, so that no kink is left in the refractive index.

Layers of cloud from the cloud water of an analysis.

Where at least OVERCAST of the sky is covered, neighbouring altitudes with water (or with ice) are one homogeneous layer
over the whole sky, the only clouds that the program knows.  Its optical depth is that of particles that are large
against the wavelength, whose extinction is twice their area (Stephens 1978, J. Atmos. Sci. 35, 2123, eq. 7):

    tau = 3 W / (2 rho r_e),   W the water [kg m^-2], rho its density as liquid or ice, r_e the effective radius.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from twilight.atmosphere.clouds import KINDS, CloudLayer
from twilight.atmosphere.measured import parts
from twilight.atmosphere.measured.parts import AirColumn, CloudWater
from twilight.atmosphere.profiles import BOLTZMANN_J_PER_K, AirProfile
from twilight.base.errors import TwilightError

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

    virtual = parts.virtual_temperature_k(of_temperature, outer_water if of_water is None else of_water)
    outer_virtual = parts.virtual_temperature_k(outer.temperature_k, outer_water)
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
    kelvin = 1e3 * parts.STANDARD_GRAVITY * parts.MOLAR_MASS_DRY / (parts.GAS_CONSTANT * slope)
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
