"""Bent rays one by one: the refracted path to the sun and bent lines of sight, from `twilight.transport.rays`.

The tests compare the tables and the marched lines of the program with these.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit

from twilight.atmosphere.medium import Medium
from twilight.base.errors import TwilightError
from twilight.transport.ray_profile import ray_profile, refractivity_at
from twilight.transport.rays import GROUND, OUTSIDE, TRAPPED, lowest_point, outward, sun_ray

_MAX_ITERATIONS = 80


class SunPath(NamedTuple):
    """The refracted path from a point to the sun at each wavelength; every array has shape (W,).

    apparent_zenith_deg: direction in which the sun is seen; bending_deg: true minus apparent zenith angle;
    optical_depth: along the bent path, infinite in the shadow; iterations: steps of the bisection;
    bounded: the search ended without a bracket (a duct): the nearest free direction is given;
    in_shadow: no ray from the sun reaches the point.
    """

    apparent_zenith_deg: np.ndarray
    bending_deg: np.ndarray
    optical_depth: np.ndarray
    iterations: np.ndarray
    bounded: np.ndarray
    in_shadow: np.ndarray


@njit(cache=True)
def _search(profile, w, altitude_km, chi, tolerance, first_bound):
    """Bisection for the bending: (apparent, bending, optical depth, iterations, bounded, in shadow)."""
    x = (profile.radius_km + altitude_km) * (1.0 + refractivity_at(profile, w, altitude_km))
    # without bending: the answer in vacuum, and the end of the bracket with the lowest ray
    bending, tau, status = sun_ray(profile, w, altitude_km, x * math.cos(chi), False)
    if status == OUTSIDE and bending == 0.0:
        return chi, 0.0, tau, 0, False, False
    # a higher apparent sun is bent less: the bound grows until the ray there is free and bent too little
    high = min(first_bound, chi)
    bracketed = False
    for _ in range(8):
        bending, tau, status = sun_ray(profile, w, altitude_km, x * math.cos(chi - high), False)
        if status == OUTSIDE and bending <= high:
            bracketed = True
            break
        if high >= chi:
            break
        high = min(2.0 * high, chi)
    if not bracketed:
        shadow = status != OUTSIDE
        return chi - high, bending, tau, 0, not shadow, shadow
    low = 0.0
    n = 0
    best_bending = bending
    best_tau = tau
    while high - low > tolerance and n < _MAX_ITERATIONS:
        middle = 0.5 * (low + high)
        bending, tau, status = sun_ray(profile, w, altitude_km, x * math.cos(chi - middle), False)
        n += 1
        if status == OUTSIDE and bending <= middle:
            high = middle
            best_bending = bending
            best_tau = tau
        else:
            low = middle
    # where the ray next below is blocked, is the sun between the two, or lower than any free ray?
    _, _, status = sun_ray(profile, w, altitude_km, x * math.cos(chi - low), False)
    blocked = False
    if status != OUTSIDE:
        width = high - low
        above, _, _ = sun_ray(profile, w, altitude_km, x * math.cos(chi - high - width), False)
        blocked = high - best_bending > 2.0 * max(width, width + best_bending - above) + 1e-12
    shadow = blocked and status == GROUND
    return chi - high, best_bending, best_tau, n, blocked and status == TRAPPED, shadow


def find_sun_path(
    medium: Medium,
    altitude_km: float,
    sun_zenith_deg: float,
    *,
    tolerance_deg: float = 1e-6,
    first_bound_deg: float = 2.0,
    refraction: bool = True,
) -> SunPath:
    """Direction in which the sun is seen from a point, by the binary search of Haber 2005 sec. 4.4.

    altitude_km: of the point, at or above the ground; sun_zenith_deg: true zenith angle of the sun there, 0..180.
    The bending is searched between 0 and `first_bound_deg` (Haber's 2 deg, doubled until it brackets the answer) to
    `tolerance_deg` (he reports 5-15 steps for 0.1 deg); no more than 80 steps are taken.

    A point in the shadow of the refracted limb has `in_shadow` and infinite optical depth; a sun that only rays caught
    in a duct could reach is reported with `bounded`, in the nearest direction that is free.
    """
    if not (np.isfinite(altitude_km) and altitude_km >= medium.bottom_km):
        raise TwilightError(
            f"find_sun_path: altitude_km {altitude_km} must not be below the ground ({medium.bottom_km})"
        )
    if not 0.0 <= sun_zenith_deg <= 180.0:
        raise TwilightError(f"find_sun_path: sun_zenith_deg {sun_zenith_deg} must be between 0 and 180")
    if not tolerance_deg > 0.0 or not first_bound_deg > 0.0:
        raise TwilightError("find_sun_path: tolerance_deg and first_bound_deg must be positive")
    profile = ray_profile(medium, refraction=refraction)
    rows = [
        _search(
            profile,
            w,
            float(altitude_km),
            math.radians(sun_zenith_deg),
            math.radians(tolerance_deg),
            math.radians(first_bound_deg),
        )
        for w in range(medium.n_wavelengths)
    ]
    apparent, bending, tau, iterations, bounded, shadow = (np.array(column) for column in zip(*rows, strict=True))
    return SunPath(
        np.degrees(apparent),
        np.degrees(bending),
        np.where(shadow, np.inf, tau),
        iterations.astype(np.int64),
        bounded.astype(bool),
        shadow.astype(bool),
    )


class RayPath(NamedTuple):
    """Points along a bent line of sight, from the observer outwards; every array has shape (N,).

    geocentric_angle_deg: between the verticals of the observer and of the point; zenith_deg: local zenith angle of the
    ray's direction; length_km and optical_depth: from the observer; hits_ground: the last point is on the ground.
    """

    altitude_km: np.ndarray
    geocentric_angle_deg: np.ndarray
    zenith_deg: np.ndarray
    length_km: np.ndarray
    optical_depth: np.ndarray
    hits_ground: bool


@njit(cache=True)
def _leg(profile, w, low, u_low, stops, out):
    """bending, optical depth, length and u at ascending `stops` (N, 4) of a ray that rises from `low`; all free?"""
    for k in range(stops.size):
        out[k, 0], out[k, 1], out[k, 2], out[k, 3], ok = outward(profile, w, low, u_low, stops[k])
        if not ok:
            return False
    return True


def trace_ray(
    medium: Medium,
    altitude_km: float,
    zenith_deg: float,
    *,
    wavelength: int = 0,
    n_points: int = 101,
    refraction: bool = True,
) -> RayPath:
    """Follow a line of sight from a point of the air to the top or to the ground.

    altitude_km: of the observer, inside the air; zenith_deg: apparent zenith angle of the direction, 0..180;
    wavelength: index; n_points: points on each leg (down to the lowest point, and up), dense near the lowest point.
    Raises TwilightError for a ray that a duct does not let out.
    """
    if not medium.bottom_km <= altitude_km < medium.top_km:
        raise TwilightError(f"trace_ray: altitude_km {altitude_km} must lie in {medium.bottom_km}..{medium.top_km}")
    if not 0.0 <= zenith_deg <= 180.0:
        raise TwilightError(f"trace_ray: zenith_deg {zenith_deg} must be between 0 and 180")
    profile = ray_profile(medium, refraction=refraction)
    angle = math.radians(zenith_deg)
    x = (profile.radius_km + altitude_km) * (1.0 + refractivity_at(profile, wavelength, altitude_km))
    u, p = x * math.cos(angle), x * math.sin(angle)
    low, u_low, ground = float(altitude_km), u, False
    if u < 0.0:
        low, status = lowest_point(profile, wavelength, altitude_km, -u, False)
        ground = status == GROUND
        x_low = (profile.radius_km + low) * (1.0 + refractivity_at(profile, wavelength, low))
        u_low = math.sqrt(max(0.0, (x_low - p) * (x_low + p))) if ground else 0.0
    t = np.linspace(0.0, 1.0, n_points) ** 2
    top = profile.top_km[-1]
    # stay below the top, so that the direction is the one inside the air
    stops = np.minimum(low + (top - low) * t, np.nextafter(top, 0.0))
    down = np.unique(np.append(low + (altitude_km - low) * t, altitude_km)) if u < 0.0 else np.array([altitude_km])
    rising, falling = np.zeros((stops.size, 4)), np.zeros((down.size, 4))
    ok = _leg(profile, wavelength, low, u_low, down, falling)
    if not ground:
        ok = _leg(profile, wavelength, low, u_low, stops, rising) and ok
    if not ok:
        raise TwilightError(f"trace_ray: the ray at zenith_deg {zenith_deg} is trapped in a duct")
    rising[0, 3], falling[0, 3] = u_low, u_low if u < 0.0 else u
    start = falling[-1]
    legs_z, legs = [], []
    if u < 0.0:
        inward = np.stack(
            [start[0] - falling[:, 0], start[1] - falling[:, 1], start[2] - falling[:, 2], -falling[:, 3]], axis=1
        )
        legs_z.append(down[::-1])
        legs.append(inward[::-1])
    if not ground:
        whole = start if u < 0.0 else np.zeros(4)
        skip = 1 if u < 0.0 else 0
        legs_z.append(stops[skip:])
        legs.append(np.column_stack([rising[skip:, :3] + whole[:3], rising[skip:, 3]]))
    z, q = np.concatenate(legs_z), np.concatenate(legs)
    local = np.arctan2(p, q[:, 3])
    return RayPath(z, np.degrees(angle + q[:, 0] - local), np.degrees(local), q[:, 2], q[:, 1], bool(ground))
