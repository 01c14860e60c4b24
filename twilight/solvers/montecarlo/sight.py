"""The first leg, the same for all samples of a pixel: its single scattering by quadrature, its pieces for later draws.

The line of sight is a chain of chords.  With bent lines of sight it follows the ray that arrives in the apparent
direction, d psi / ds = -(dn/dr) sin(i) / n (psi: angle of the ray in its plane, i: local zenith angle), by the midpoint
rule; a chord leaves the ray by less than SAG_KM.  The radiance L / n^2 is constant along a ray, so light from where
the index is n counts (n_observer / n)^2.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from twilight.solvers.montecarlo.air import EVENT, EXTINCTION, locate, locate_level, shell_of
from twilight.solvers.montecarlo.kernel import INNER
from twilight.solvers.montecarlo.leg import (
    BASE,
    BUFFER_COLUMNS,
    DEPTH,
    FIRST,
    IN_SHELL,
    LAST,
    LENGTH,
    LOWER,
    MIDDLE,
    OPAQUE_DEPTH,
    PLAIN,
    REFERENCE_RADIUS_KM,
    START,
    STEERED,
    UPPER,
    altitude_at,
    column,
    depth_within,
    distance_down,
    distance_up,
    ground_sunlight,
    sunlight,
)
from twilight.solvers.montecarlo.steering import log_ground_light, log_source_light

# columns after those of a leg: start of the chord and its direction
ORIGIN, DIRECTION = BUFFER_COLUMNS, BUFFER_COLUMNS + 3
SIGHT_COLUMNS = BUFFER_COLUMNS + 6
SIGHT_PIECES = 8192
# places in the summary: light scattered once in the air and on the ground, distance to the ground or -1, transmittance,
# steering's estimate of the light scattered again on the ground, point and direction there
SINGLE, GROUND_SINGLE, GROUND, THROUGH, GROUND_STEERED, LANDING = range(6)
N_SUMMARY = LANDING + 6
SAG_KM = 1e-4
CHORD_KM = 40.0
CHORD_RISE_KM = 4.0
LONGEST_KM = 2e4
RISE = 0.15
CUTS, EDGE_CUTS = 6, 40
STEEP = 1.5
"""A piece over which the scattered sunlight changes by more than this factor is cut into CUTS parts, and one that the
edge of the shadow crosses into EDGE_CUTS."""
_NODE, _WEIGHT = np.polynomial.legendre.leggauss(3)
GAUSS_NODE, GAUSS_WEIGHT = 0.5 * (_NODE + 1.0), 0.5 * _WEIGHT


@njit(**INNER)
def curvature(air, w, x, z, psi):
    """d psi / ds [rad km^-1] of a ray at the point (x, z) of its plane, the centre of the Earth being (0, 0)."""
    r = math.sqrt(x * x + z * z)
    altitude = r - air.earth_radius_km
    n_levels = air.level_km.size
    if altitude >= air.level_km[n_levels - 1]:
        return 0.0
    i, f = locate(air, altitude, 0, n_levels - 1)
    lower = air.refractivity[w, i]
    change = air.refractivity[w, i + 1] - lower
    sine = (math.sin(psi) * z - math.cos(psi) * x) / r
    return -change * air.per_km[i] * sine / (1.0 + lower + f * change)


@njit(**INNER)
def observer_refractivity(air, w, altitude):
    """n - 1 at the altitude [km] of the observer, 0 above the air."""
    last = air.level_km.size - 1
    if altitude >= air.level_km[last]:
        return 0.0
    i, f = locate(air, altitude, 0, last)
    return air.refractivity[w, i] * (1.0 - f) + air.refractivity[w, i + 1] * f


@njit(**INNER)
def relative_index(air, w, i, f, at_observer):
    """(n_observer / n)^2 at a point of the air."""
    nu = air.refractivity[w, i] * (1.0 - f) + air.refractivity[w, i + 1] * f
    ratio = (1.0 + at_observer) / (1.0 + nu)
    return ratio * ratio


@njit(**INNER)
def look(air, sun, steering, w, bent, point, direction, to_sun, max_length, max_depth, pieces, summary):
    """Follow the line of sight from `point` in the apparent `direction`; returns the number of pieces, -1 if too many.

    bent: follow the refracted ray.  pieces (SIGHT_PIECES, SIGHT_COLUMNS), summary (N_SUMMARY,) are filled.
    """
    summary[:] = 0.0
    summary[GROUND] = -1.0
    summary[THROUGH] = 1.0
    sx, sy, sz = to_sun[0], to_sun[1], to_sun[2]
    bottom = air.shell_km[0]
    n_shells = air.shell_first.size
    top = air.shell_km[n_shells]
    per_depth = 1.0 / (top - bottom)
    levels = air.level_km
    table = air.table[w]
    sources = steering.log_source[w]
    nodes = steering.cos_sun
    hint = steering.hint
    scale = air.earth_radius_km / REFERENCE_RADIUS_KM
    level = math.sqrt(direction[0] * direction[0] + direction[1] * direction[1])
    hx = direction[0] / level if level > 0.0 else 1.0
    hy = direction[1] / level if level > 0.0 else 0.0
    # the observer stands on the axis of z; x is along the horizontal direction of view
    x = 0.0
    z = point[2]
    psi = math.atan2(level, direction[2])
    altitude = max(z - air.earth_radius_km, bottom)
    at_observer = observer_refractivity(air, w, altitude)
    n = 0
    depth = 0.0
    plain = 0.0
    steered = 0.0
    travelled = 0.0
    outside = altitude >= top
    while travelled < LONGEST_KM * scale or outside:
        r = math.sqrt(x * x + z * z)
        altitude = max(r - air.earth_radius_km, bottom)
        mu = (math.sin(psi) * x + math.cos(psi) * z) / r
        if altitude >= top - 1e-9:
            if mu >= 0.0:
                summary[THROUGH] = math.exp(-depth)
                return n
            s = distance_down(altitude, r, mu, top - 1e-9) if outside else 0.0
            if s < 0.0:
                return n
            if outside:
                x += s * math.sin(psi)
                z += s * math.cos(psi)
                outside = False
                continue
        chord = 1e9
        heading = psi
        if bent:
            k0 = curvature(air, w, x, z, psi)
            chord = CHORD_KM * scale
            if abs(mu) * chord > CHORD_RISE_KM * scale:
                chord = CHORD_RISE_KM * scale / abs(mu)
            if abs(k0) * chord * chord > 8.0 * SAG_KM:
                chord = math.sqrt(8.0 * SAG_KM / abs(k0))
            half = 0.5 * chord
            k1 = curvature(air, w, x + half * math.sin(psi), z + half * math.cos(psi), psi + half * k0)
            heading = psi + 0.5 * k1 * chord
            psi += k1 * chord
            mu = (math.sin(heading) * x + math.cos(heading) * z) / r
        dx = math.sin(heading) * hx
        dy = math.sin(heading) * hy
        dz = math.cos(heading)
        px = x * hx
        py = x * hy
        cos_sun_start = px * sx + py * sy + z * sz
        cos_sun_slope = dx * sx + dy * sy + dz * sz
        k = shell_of(air, altitude)
        falling = mu < 0.0
        if falling and altitude <= air.shell_km[k] + 1e-12 and k > 0:
            k -= 1
        s = 0.0
        s_lowest = -r * mu
        done = False
        while not done:
            lands = False
            still_falling = False
            next_k = k + 1
            if falling:
                end = distance_down(altitude, r, mu, air.shell_km[k])
                if end < 0.0:
                    end = s_lowest
                    next_k = k
                else:
                    next_k = k - 1
                    still_falling = True
                    lands = next_k < 0
            else:
                end = distance_up(altitude, r, mu, air.shell_km[k + 1])
            if end >= chord:
                end = chord
                lands = False
                done = True
            if end > s:
                stretch = end - s
                first = air.shell_first[k]
                last = air.shell_last[k]
                z_enter = altitude_at(altitude, r, mu, s)
                z_leave = altitude_at(altitude, r, mu, end)
                i, f = locate(air, z_enter, first, last)
                after = column(table, i, f, EXTINCTION)
                dense = stretch * max(after, table[first, EXTINCTION], table[last, EXTINCTION])
                parts = max(
                    stretch / (max_length * scale),
                    dense / max_depth,
                    abs(z_leave - z_enter) / (RISE * max_length * scale),
                )
                parts = int(max(1.0, min(math.ceil(parts), 100000.0)))
                length = stretch / parts
                for part in range(parts):
                    if n >= pieces.shape[0]:
                        return -1
                    start = s + part * length
                    lower = after
                    zp = altitude_at(altitude, r, mu, start + 0.5 * length)
                    i, f = locate(air, zp, first, last)
                    middle = column(table, i, f, EXTINCTION)
                    zp = altitude_at(altitude, r, mu, start + length)
                    i, f = locate(air, zp, first, last)
                    upper = column(table, i, f, EXTINCTION)
                    after = upper
                    single = 0.0
                    again = 0.0
                    free = 0.0
                    cuts = 1
                    for _ in range(2):
                        single = 0.0
                        again = 0.0
                        free = 0.0
                        brightest = 0.0
                        darkest = math.inf
                        for m in range(3 * cuts):
                            t = (m // 3 + GAUSS_NODE[m % 3]) / cuts
                            weight = GAUSS_WEIGHT[m % 3] / cuts
                            here = start + t * length
                            zp = altitude_at(altitude, r, mu, here)
                            i, f = locate_level(levels, air.bin_start, air.bins_per_km, air.per_km, zp, first, last)
                            weight *= length * math.exp(-depth - depth_within(lower, middle, upper, length, t))
                            if bent:
                                weight *= relative_index(air, w, i, f, at_observer)
                            mu_sun = (cos_sun_start + here * cos_sun_slope) / (air.earth_radius_km + zp)
                            mu_sun = min(1.0, max(-1.0, mu_sun))
                            scattering = column(table, i, f, EVENT)
                            source = sunlight(
                                air, sun.beam, w, zp, mu_sun, dx, dy, dz,
                                px + here * dx, py + here * dy, z + here * dz, sx, sy, sz, i, f,
                            )  # fmt: skip
                            brightest = max(brightest, source)
                            darkest = min(darkest, source)
                            root = math.sqrt(max(0.0, (zp - bottom) * per_depth))
                            single += weight * source
                            free += weight * scattering
                            up = (here - s_lowest) / (air.earth_radius_km + zp)
                            light = log_source_light(sources, nodes, hint, root, mu_sun, up, cos_sun_slope)
                            again += weight * scattering * math.exp(light)
                        # where the limb's shadow falls on the piece, three nodes are too few
                        if brightest <= STEEP * darkest:
                            break
                        cuts = EDGE_CUTS if darkest == 0.0 else CUTS
                    summary[SINGLE] += single
                    plain += free
                    steered += again
                    row = pieces[n]
                    row[START] = start
                    row[LENGTH] = length
                    row[DEPTH] = depth
                    row[LOWER] = lower
                    row[MIDDLE] = middle
                    row[UPPER] = upper
                    row[BASE] = IN_SHELL
                    row[FIRST] = first
                    row[LAST] = last
                    row[STEERED] = steered
                    row[PLAIN] = plain
                    row[ORIGIN] = px
                    row[ORIGIN + 1] = py
                    row[ORIGIN + 2] = z
                    row[DIRECTION] = dx
                    row[DIRECTION + 1] = dy
                    row[DIRECTION + 2] = dz
                    depth += length * (lower + 4.0 * middle + upper) / 6.0
                    n += 1
                    if depth > OPAQUE_DEPTH:
                        summary[THROUGH] = 0.0
                        return n
                s = end
            if lands:
                factor = math.exp(-depth)
                if bent:
                    factor *= relative_index(air, w, 0, 0.0, at_observer)
                summary[GROUND] = end
                summary[THROUGH] = factor
                mu_sun = (cos_sun_start + end * cos_sun_slope) / (air.earth_radius_km + bottom)
                mu_sun = min(1.0, max(-1.0, mu_sun))
                reflected = factor * air.ground_albedo[w] / math.pi
                if reflected > 0.0:
                    summary[GROUND_SINGLE] = reflected * ground_sunlight(air, sun.beam, w, mu_sun)
                    summary[GROUND_STEERED] = reflected * math.exp(log_ground_light(steering, w, mu_sun))
                summary[LANDING] = px + end * dx
                summary[LANDING + 1] = py + end * dy
                summary[LANDING + 2] = z + end * dz
                summary[LANDING + 3] = dx
                summary[LANDING + 4] = dy
                summary[LANDING + 5] = dz
                return n
            if not done:
                k = next_k
                falling = still_falling
                if k >= n_shells:
                    summary[THROUGH] = math.exp(-depth)
                    return n
        travelled += chord
        x += chord * math.sin(heading)
        z += chord * math.cos(heading)
    return -1
