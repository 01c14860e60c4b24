"""Optical depth of a straight piece of air: the steps of :mod:`twilight.transport.lines` where only that is asked.

Without light to collect a step may be as long as the air allows; like those it ends at the lowest point and at every
`stop_km`.  The altitude along a chord is known in closed form, so that no ray has to be followed.
"""

from __future__ import annotations

import math

import numpy as np

from twilight.jit.kernels import njit
from twilight.numerics.geometry import altitude_along, distance_to_sphere
from twilight.transport.lines import GAUSS_HIGH, GAUSS_LOW
from twilight.transport.profile import locate

STEP_KM = 0.8
"""Altitude that a step may cross at the ground [km]."""

STEP_GROWTH = 0.1
"""By how much of the height above the ground STEP_KM grows."""

_INSIDE_KM = 1e-9
"""Coefficients at a stop are those this far inside the interval that the step is in [km]."""


@njit(cache=True, makes_arrays=False)
def chord_depth(profile, altitude_km, cos_zenith, length, out):
    """Optical depth (W,) into `out`, of a chord of `length` [km] that starts inside the air under `cos_zenith`.

    profile: `Profile`; altitude_km: of its start.  Returns False, with `out` unset, where the ground is in between;
    what is above the top counts as its last level.
    """
    radius = profile.earth_radius_km
    stop = profile.stop_km
    bottom = stop[0]
    closest = -(radius + altitude_km) * cos_zenith
    if 0.0 < closest < length and altitude_along(altitude_km, cos_zenith, closest, radius) < bottom:
        return False
    out[:] = 0.0
    k = profile.extinction
    j = min(max(np.searchsorted(stop, altitude_km, side="right") - 1, 0), stop.size - 2)
    s = 0.0
    for _ in range(512 + 4 * stop.size):
        z = altitude_along(altitude_km, cos_zenith, s, radius)
        slope = ((radius + altitude_km) * cos_zenith + s) / (radius + z)
        dz = STEP_KM + STEP_GROWTH * max(z - bottom, 0.0)
        ds = 2.0 * dz / (abs(slope) + math.sqrt(slope * slope + 2.0 * dz / radius))
        if s + 1.3 * ds >= length:
            ds = length - s
        lowest, highest = stop[j], stop[j + 1]
        move = 0
        if s < closest:
            ds = min(ds, closest - s)
            to_stop = 0.0
            if z > lowest:
                to_stop = distance_to_sphere(z, max(-1.0, slope), lowest, radius)
            if 0.0 <= to_stop <= ds and j > 0:
                ds, move = to_stop, -1
        else:
            to_stop = 0.0
            if z < highest:
                to_stop = distance_to_sphere(z, min(1.0, slope), highest, radius)
            if 0.0 <= to_stop <= ds and j < stop.size - 2:
                ds, move = to_stop, 1
        for g in range(2):
            part = GAUSS_LOW if g == 0 else GAUSS_HIGH
            middle = altitude_along(altitude_km, cos_zenith, s + part * ds, radius)
            i, f = locate(profile, max(lowest + _INSIDE_KM, min(highest - _INSIDE_KM, middle)))
            for w in range(out.size):
                out[w] += 0.5 * ds * (k[i, w] * (1.0 - f) + k[i + 1, w] * f)
        j += move
        s += ds
        if s >= length:
            break
    return True
