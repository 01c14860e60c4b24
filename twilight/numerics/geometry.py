"""Lines and spheres: distances to spheres and altitudes along a line, without cancellation."""

from __future__ import annotations

import math

from twilight.jit.kernels import njit


@njit(cache=True, inline="always")
def altitude_along(altitude_km, cos_zenith, distance_km, earth_radius_km):
    """Altitude [km] after `distance_km` along a straight line that starts at `altitude_km`.

    `cos_zenith`: of the line at its start; `earth_radius_km`: R.  (R + z)^2 = (R + h)^2 + 2 (R + h) s mu + s^2, solved
    for z - h without subtracting two large numbers.
    """
    r = earth_radius_km + altitude_km
    d = distance_km * (2.0 * r * cos_zenith + distance_km)
    return altitude_km + d / (math.sqrt(max(r * r + d, 0.0)) + r)


@njit(cache=True, inline="always")
def distance_to_sphere(altitude_km, cos_zenith, target_altitude_km, earth_radius_km):
    """Distance [km] along a line to the sphere at `target_altitude_km`, or -1 where the line does not meet it ahead.

    The line starts at `altitude_km` under `cos_zenith`; `earth_radius_km`: of the altitude 0.  From below the sphere
    the one crossing is given; from above the nearer one.
    """
    r = earth_radius_km + altitude_km
    h = target_altitude_km - altitude_km
    # s^2 + 2 r mu s - h (2 r + h) = 0
    c = -h * (2.0 * r + h)
    b = r * cos_zenith
    disc = b * b - c
    if disc < 0.0:
        return -1.0
    root = math.sqrt(disc)
    if c <= 0.0:  # start inside or on the sphere: the positive root, written so that b > 0 does not cancel
        return -c / (b + root) if b > 0.0 else root - b
    if b >= 0.0:  # outside, moving away
        return -1.0
    return c / (root - b)
