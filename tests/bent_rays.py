"""Bent lines of sight one by one, from `twilight.transport.rays`, with which tests compare those of solvers."""

import math
from typing import NamedTuple

import numpy as np
from numba import njit

from twilight.atmosphere.medium import Medium
from twilight.transport.ray_profile import ray_profile, refractivity_at
from twilight.transport.rays import GROUND, lowest_point, outward


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
    medium: Medium, altitude_km: float, zenith_deg: float, *, wavelength: int = 0, n_points: int = 101
) -> RayPath:
    """Follow a line of sight from a point of the air to the top or to the ground.

    altitude_km: of the observer, inside the air; zenith_deg: apparent zenith angle of the direction, 0..180;
    wavelength: index; n_points: points on each leg (down to the lowest point, and up), dense near the lowest point.
    """
    profile = ray_profile(medium)
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
    assert ok, f"the ray at zenith_deg {zenith_deg} is trapped in a duct"
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
