"""Steps along a ray that is straight or bent by refraction, and the optical depth of a straight piece of air.

A ray is followed by fourth-order Runge-Kutta steps in altitude z, geocentric angle psi and the elevation a of the ray
above the local horizontal,
    dz/ds = sin a,   dpsi/ds = cos a / (R + z),   da/ds = cos a (1/(R + z) + d ln n/dz),
which pass a lowest point without a singularity; with n = 1 the ray is straight.

A step is never longer than about 0.7 optical depths.  It ends where the ray turns (sin a = 0), so that the altitude
goes one way within it, and at every one of the profile's `stop_km`, between which the air changes smoothly: a step
whose end lies beyond a stop is shortened to end on it.  So no layer, however thin, is stepped over.

The altitude along a straight line is known in closed form.  Where its optical depth alone is asked (`chord_depth`) no
ray is followed, and without light to collect a step may be as long as the air allows.

Arguments that the kernels share: profile: `Profile`; z, altitude_km [km]: altitude of the point; psi [rad]: geocentric
angle from the start of the ray; a [rad]: elevation of the ray at the point; h [km]: length of the step.
"""

import math

import numpy as np

from twilight.jit.kernels import njit
from twilight.transport.profile import SMOOTH_STEP_GROWTH, SMOOTH_STEP_KM, locate

DEEP = 8.0
"""Optical depth at the clearest of the wavelengths that steps are made for, behind which steps in thick air grow."""

DEEP_GROWTH = 5.0
"""Largest factor by which steps grow behind DEEP, with the square of the optical depth."""

BLACK = 30.0
"""Optical depth by which the largest extinction counts as black: it then shortens no step of the other wavelengths."""

GAUSS_LOW = 0.5 - 0.5 / math.sqrt(3.0)
"""The nearer of the two Gauss points of a step, as a fraction of it."""

GAUSS_HIGH = 0.5 + 0.5 / math.sqrt(3.0)
"""The farther of the two Gauss points of a step, as a fraction of it."""

INSIDE_KM = 1e-9
"""Coefficients at a stop are those this far inside the interval that the step is in [km]."""

LONGEST_STEP_KM = 30.0
"""Longest step at fineness 1 [km]."""

STEP_DEPTH = 0.7
"""Optical depth of a step at fineness 1, at the extinction that steps are made for."""

SHORTEST_KM = 1e-6
"""Optical depth shortens no step to less [km]."""

CHORD_STEP_KM = 0.8
"""Altitude that a step of a chord may cross at the ground [km]."""

CHORD_STEP_GROWTH = 0.1
"""By how much of the height above the ground CHORD_STEP_KM grows."""


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


@njit(inner=True, cache=True, inline=True, makes_arrays=False)
def _ray_curvature(profile, z):
    """da/ds over cos a of a level ray, 1/(R + z) + d ln n/dz, and dpsi/ds over cos a, 1/(R + z), at altitude z."""
    i, f = locate(profile, z)
    flat = 1.0 / (profile.earth_radius_km + z)
    gradient = profile.gradient_per_km
    return flat + gradient[i] * (1.0 - f) + gradient[i + 1] * f, flat


@njit(inner=True, cache=True, makes_arrays=False)
def advance(profile, z, psi, a, h):
    """One Runge-Kutta step of length h [km]: altitude z [km], geocentric angle psi and elevation a [rad] at its end."""
    k1, f1 = _ray_curvature(profile, z)
    c1, s1 = math.cos(a), math.sin(a)
    a2 = a + 0.5 * h * c1 * k1
    k2, f2 = _ray_curvature(profile, z + 0.5 * h * s1)
    c2, s2 = math.cos(a2), math.sin(a2)
    a3 = a + 0.5 * h * c2 * k2
    k3, f3 = _ray_curvature(profile, z + 0.5 * h * s2)
    c3, s3 = math.cos(a3), math.sin(a3)
    a4 = a + h * c3 * k3
    k4, f4 = _ray_curvature(profile, z + h * s3)
    c4, s4 = math.cos(a4), math.sin(a4)
    return (
        z + h / 6.0 * (s1 + 2.0 * s2 + 2.0 * s3 + s4),
        psi + h / 6.0 * (c1 * f1 + 2.0 * c2 * f2 + 2.0 * c3 * f3 + c4 * f4),
        a + h / 6.0 * (c1 * k1 + 2.0 * c2 * k2 + 2.0 * c3 * k3 + c4 * k4),
    )


@njit(inner=True, cache=True, makes_arrays=False)
def step_length(profile, z, slope, travelled, fineness, thick_fineness, depth, darkest):
    """Length [km] that a step at altitude z may have, for a ray whose altitude changes by `slope` per length.

    z [km]: inside the interval between stops that the step is in; travelled [km]; fineness: of the steps, 1 is usual;
    thick_fineness: of steps that follow the extinction; depth: optical depth so far at the clearest wavelength that
    steps are made for; darkest: optical depth so far of air whose extinction the steps follow
    """
    height = max(z - profile.altitude_km[0], 0.0)
    ds = min(LONGEST_STEP_KM, max(0.4, 0.25 * travelled + 0.02 * height)) / fineness
    dz = (SMOOTH_STEP_KM + SMOOTH_STEP_GROWTH * height) / fineness
    # |slope| ds + ds^2 / 2R is the change of altitude
    ds = min(ds, 2.0 * dz / (abs(slope) + math.sqrt(slope * slope + 2.0 * dz / profile.earth_radius_km)))
    i, f = locate(profile, z)
    k_max = profile.thickest_per_km[i] * (1.0 - f) + profile.thickest_per_km[i + 1] * f
    if k_max * ds * fineness > STEP_DEPTH:
        followed = profile.guide_per_km[i] * (1.0 - f) + profile.guide_per_km[i + 1] * f >= k_max
        limit = STEP_DEPTH * min(DEEP_GROWTH, max(1.0, (depth / DEEP) ** 2))
        shortest = max(limit / (k_max * (thick_fineness if followed else fineness)), SHORTEST_KM)
        if darkest > BLACK:
            # a wavelength that is black by now must not use up the steps of the others
            shortest = max(shortest, 0.25 * travelled / fineness)
        ds = min(ds, shortest)
    return ds


@njit(inner=True, cache=True, makes_arrays=False)
def step(profile, j, z, psi, a, h):
    """A step of at most h [km] from (z, psi, a) in the interval stop_km[j]..stop_km[j + 1].

    Returns (h, z, psi, a, j) at its end, on a stop with the interval behind it.
    """
    stop = profile.stop_km
    z_end, psi_end, a_end = advance(profile, z, psi, a, h)
    if a * a_end < 0.0:
        curvature = (a_end - a) / h
        s = h * a / (a - a_end)
        for _ in range(3):
            z_end, psi_end, a_end = advance(profile, z, psi, a, s)
            s = min(h, max(0.0, s - a_end / curvature))
        h = s
        z_end, psi_end, _ = advance(profile, z, psi, a, h)
        a_end = 0.0
    beyond = 0
    if z_end > stop[j + 1]:
        beyond = 1
    elif z_end < stop[j]:
        beyond = -1
    if beyond != 0:
        target = stop[j + 1] if beyond > 0 else stop[j]
        low, high = 0.0, h
        # the altitude is a parabola but for parts in a thousand: its root, then Newton steps kept between bounds
        b, c = math.sin(a), z - target
        mean = (z_end - z) / h
        q = (mean - b) / h
        root = math.sqrt(max(0.0, b * b - 4.0 * q * c))
        s = -2.0 * c / (b + beyond * root) if b + beyond * root != 0.0 else 0.0
        for _ in range(12):
            if not low <= s <= high:
                s = 0.5 * (low + high)
            z_end, psi_end, a_end = advance(profile, z, psi, a, s)
            miss = z_end - target
            if abs(miss) < 1e-12 * (1.0 + target):
                break
            if miss * beyond > 0.0:
                high = s
            else:
                low = s
            slope = math.sin(a_end)
            s = s - miss / slope if abs(slope) > 1e-9 else -1.0
        h = s if low <= s <= high else 0.5 * (low + high)
        z_end = target
        j += beyond
    return h, z_end, psi_end, a_end, j


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
        dz = CHORD_STEP_KM + CHORD_STEP_GROWTH * max(z - bottom, 0.0)
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
            i, f = locate(profile, max(lowest + INSIDE_KM, min(highest - INSIDE_KM, middle)))
            for w in range(out.size):
                out[w] += 0.5 * ds * (k[i, w] * (1.0 - f) + k[i + 1, w] * f)
        j += move
        s += ds
        if s >= length:
            break
    return True
