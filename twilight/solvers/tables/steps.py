"""Steps along a straight ray of the tables: short where the air changes, never across a jump of the medium."""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from twilight.geometry import altitude_along, distance_to_sphere
from twilight.transport.profile import Profile, locate

MAX_STEPS = 512
GAUSS_LOW = 0.5 - 0.5 / math.sqrt(3.0)
GAUSS_HIGH = 0.5 + 0.5 / math.sqrt(3.0)


def jump_altitudes(profile: Profile) -> np.ndarray:
    """Altitudes [km] at which a coefficient jumps, without the ground and the top."""
    z = profile.altitude_km
    jumps = z[1:][np.diff(z) <= 0]
    return np.unique(jumps[(jumps > z[0]) & (jumps < z[-1])])


@njit(cache=True)
def march(profile, jumps, altitude_km, cos_zenith, fineness, edges):
    """Fill `edges` with the ends of steps [km] along a line; returns (number of steps, does it end on the ground).

    A step changes the altitude by a fraction of the scale height, is at most 0.7/fineness optical depths long at any
    wavelength that is still seen through the air behind it, and ends where the medium jumps.  A line that starts above
    the top begins where it enters; one that misses the air has 0 steps.  At most MAX_STEPS steps are made: the rest of
    the line is cut into equal ones.
    """
    radius = profile.earth_radius_km
    levels = profile.altitude_km
    bottom = levels[0]
    top = levels[levels.size - 1]
    n_wavelengths = profile.extinction.shape[1]
    start = 0.0
    if altitude_km > top:
        start = distance_to_sphere(altitude_km, cos_zenith, top, radius)
        if start < 0.0:
            return 0, False
    edges[0] = start
    end = -1.0
    hits_ground = False
    if cos_zenith < 0.0:
        if altitude_km <= bottom:  # on the ground, looking down
            return 0, True
        end = distance_to_sphere(altitude_km, cos_zenith, bottom, radius)
        if end >= 0.0:
            hits_ground = True
    if not hits_ground:
        if start > 0.0:
            # symmetric about the tangent point
            end = -2.0 * (radius + altitude_km) * cos_zenith - start
        else:
            end = distance_to_sphere(altitude_km, cos_zenith, top, radius)
    if end <= start:
        return 0, hits_ground
    s = start
    n = 0
    depth = 0.0
    depth_max = 0.0
    while n < MAX_STEPS - 1:
        z = altitude_along(altitude_km, cos_zenith, s, radius)
        slope = ((radius + altitude_km) * cos_zenith + s) / (radius + z)
        ds = min(30.0, max(0.4, 0.25 * (s - start) + 0.02 * max(z - bottom, 0.0))) / fineness
        dz = (0.5 + 0.08 * max(z - bottom, 0.0)) / fineness
        # |slope| ds + ds^2 / 2R is the change of altitude
        ds = min(ds, 2.0 * dz / (abs(slope) + math.sqrt(slope * slope + 2.0 * dz / radius)))
        i, f = locate(profile, z)
        k_max = 0.0
        k_min = 1e300
        for w in range(n_wavelengths):
            k = profile.extinction[i, w] * (1.0 - f) + profile.extinction[i + 1, w] * f
            k_max = max(k_max, k)
            k_min = min(k_min, k)
        if k_max * ds * fineness > 0.7:
            # wavelengths that are dark by now may be stepped over coarsely
            limit = 0.7 if depth < 12.0 else 3.0
            shortest = max(limit / (k_max * fineness), 1e-4)
            if depth_max > 30.0:
                # a wavelength that is black by now must not use up the steps of the others
                shortest = max(shortest, 0.25 * (s - start) / fineness)
            ds = min(ds, shortest)
        for j in range(jumps.size):
            if abs(jumps[j] - z) > 1e-9:
                mu = min(1.0, max(-1.0, slope))
                d = distance_to_sphere(z, mu, jumps[j], radius)
                if 0.0 <= d < 1.0000001 * ds:
                    ds = d + 1e-9 * (1.0 + d)
        if s + 1.2 * ds >= end:
            ds = end - s
        s += ds
        depth += k_min * ds
        depth_max += k_max * ds
        n += 1
        edges[n] = s
        if s >= end or depth > 25.0:
            return n, hits_ground and s >= end
    edges[n + 1] = end
    return n + 1, hits_ground


@njit(cache=True)
def step_transmission(profile, z_low, z_high, length, i_low_high, f_low_high, depth):
    """Optical depth of one step per wavelength (2-point Gauss) into `depth`; the two levels and fractions too."""
    for g in range(2):
        i, f = locate(profile, z_low if g == 0 else z_high)
        i_low_high[g] = i
        f_low_high[g] = f
    i0 = i_low_high[0]
    f0 = f_low_high[0]
    i1 = i_low_high[1]
    f1 = f_low_high[1]
    k = profile.extinction
    for w in range(depth.size):
        depth[w] = 0.5 * length * (k[i0, w] * (1 - f0) + k[i0 + 1, w] * f0 + k[i1, w] * (1 - f1) + k[i1 + 1, w] * f1)
