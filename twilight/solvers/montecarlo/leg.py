"""One leg of a path: cut into pieces, single scattering estimated along it, weights for the next event.

A leg starts at a point and runs against the light until it leaves the air or meets the ground, along the chords of the
refracted ray (:mod:`twilight.solvers.montecarlo.rays`).  Light that arrives at its start, tau being the optical depth
from there and n the refractive index,

    L = integral over s of (n_start / n)^2 exp(-tau(s)) [ sum over species of beta_s P_s(Theta) E (1, 0, 0) + J(s) ] ds,

where E is the sunlight at the point, unpolarised, Theta the angle to the sun as it is seen there, and J the source
function of light scattered before, which the next event of the path samples.  Every piece lies in one layer or, close
to the horizontal, in one shell; see :mod:`twilight.solvers.montecarlo.air` for how its optical depth follows.  One
point per piece, drawn uniformly, carries its sunlight, so the estimate is unbiased whatever the length of the pieces.
Arguments that kernels share: `kernel`.

Sunlight is looked up in a table at every piece (phase functions linear in the sun's bending).  With the probability
exact_beam_fraction the exact value is asked for too, and the difference, divided by that probability, is added: the
mean is the exact one, whatever the table.

The walk through the air and the incidence on the ground are not those of :mod:`twilight.transport` that all other
solvers share: the reference solution would otherwise repeat a mistake made there.
"""

from __future__ import annotations

import math

import numpy as np

from twilight.jit.kernels import njit
from twilight.solvers.montecarlo.air import EXTINCTION, SCATTERING, air_at, column, depth_from_ground, place_in
from twilight.solvers.montecarlo.beam_table import BLACK, tabulated_beam
from twilight.solvers.montecarlo.importance import log_ground_light, log_source_light
from twilight.solvers.montecarlo.kernel import INNER
from twilight.solvers.montecarlo.pieces import (
    BASE,
    CHORD,
    DEPTH,
    FIRST,
    IN_SHELL,
    LAST,
    LENGTH,
    LOWER,
    MIDDLE,
    MOST_PARTS,
    OPAQUE_DEPTH,
    RESCATTERED,
    SCATTERED,
    START,
    UPPER,
    LegTotals,
    depth_or_extinction,
    depth_within,
    no_room,
    secant_parabola,
    without_ground,
)
from twilight.solvers.montecarlo.random import uniform
from twilight.solvers.montecarlo.rays import (
    DIRECTION,
    NO_ROOM,
    ON,
    ORIGIN,
    REFERENCE_RADIUS_KM,
    TO_SPACE,
    altitude_at,
    before_leg,
    distance_down,
    next_stretch,
    radius_and_cosine,
    refractivity_on_ray,
    relative_index,
)
from twilight.solvers.montecarlo.sunlight import fill_phases, ground_sunlight, sunlight, tabulated_sunlight

PHASE_BENDING = 2e-6
"""1 - cosine of the angle by which a leg may bend before the phase functions towards the sun are computed anew."""


@njit(inner=True, **INNER)
def enter_air(air, ray):
    """Move the start of a ray (9,) from space to the top of the air along a line; False if it misses the air."""
    r, mu = radius_and_cosine(ray)
    top = air.shell_km[air.shell_km.size - 1]
    z = r - air.earth_radius_km
    if z < top - 1e-9:
        return True
    if mu >= 0.0:
        return False
    s = distance_down(z, r, mu, top - 1e-9)
    if s < 0.0:
        return False
    for m in range(3):
        ray[ORIGIN + m] += s * ray[DIRECTION + m]
    return True


@njit(inner=True, **INNER)
def ground_point(air, chord, distance, to_sun):
    """(x, y, z, mu_sun): the point [km] of the ground at a distance [km] of a chord (9,), and its `mu_sun`."""
    x = chord[ORIGIN] + distance * chord[DIRECTION]
    y = chord[ORIGIN + 1] + distance * chord[DIRECTION + 1]
    z = chord[ORIGIN + 2] + distance * chord[DIRECTION + 2]
    radius = air.earth_radius_km + air.shell_km[0]
    return x, y, z, min(1.0, max(-1.0, (x * to_sun[0] + y * to_sun[1] + z * to_sun[2]) / radius))


@njit(**INNER)
def meet_ground(air, sun, importance, w, options, leg, stretch, n, depth, at_start, to_sun, light):
    """`LegTotals` of a leg that meets the ground at the end of a stretch, its last `Stretch`.

    n: number of its pieces; depth: its optical depth; at_start: n - 1 where it begins; light: I, Q, U of sunlight
    scattered on the way [sr^-1].
    """
    sun_i, sun_q, sun_u = light
    factor = math.exp(-depth)
    if options.bent:
        factor *= relative_index(air.refractivity[w], 0, 0.0, at_start)
    chord = leg.chords[stretch.number]
    x, y, z, mu_sun = ground_point(air, chord, stretch.end, to_sun)
    reflected = factor * air.ground_albedo[w]
    direct = 0.0
    diffuse = 0.0
    if reflected > 0.0:
        direct = factor * ground_sunlight(air, sun, w, x, y, z, mu_sun, to_sun)
        diffuse = reflected / math.pi * math.exp(log_ground_light(importance, w, mu_sun))
    return LegTotals(n, stretch.number, sun_i, sun_q, sun_u, direct, stretch.end, factor, diffuse)


@njit(**INNER)
def trace(air, sun, importance, w, ray, to_sun, options, stream, leg):
    """Follow one leg at wavelength w from a ray (9,): start [km], direction and reference; the ray is used up.

    to_sun (3,): unit vector to the true sun; stream (1,): random numbers; options: `LegOptions`; leg: `Leg`, filled.
    Returns `LegTotals`.
    """
    at = air_at(air, w)
    radius = air.earth_radius_km
    edge_km = sun.table.edge_km[w]
    high = sun.table.high[w]
    low = sun.table.low[w]
    source = importance.log_source[w]
    places = importance.place_of_root
    nodes = importance.cos_sun
    hint = importance.hint
    pieces = leg.pieces
    phases = leg.phases
    per_depth = 1.0 / (air.shell_km[air.shell_first.size] - at.bottom_km)
    longest = options.max_length_km * (radius / REFERENCE_RADIUS_KM)
    sun_i, sun_q, sun_u = 0.0, 0.0, 0.0
    n = np.int64(0)
    depth = 0.0
    rescattered = 0.0
    scattered = 0.0
    phase_x, phase_y, phase_z = 0.0, 0.0, 0.0
    if not enter_air(air, ray):
        return without_ground(0, -1, 0.0, 0.0, 0.0, 1.0)
    at_start = refractivity_on_ray(air, w, ray) if options.bent else 0.0
    row = leg.chords[0]
    cos_sun_start, cos_sun_slope, s_lowest = 0.0, 0.0, 0.0
    stretch = before_leg()
    while stretch.then == ON:
        stretch = next_stretch(air, w, options.bent, options.sag_km, True, stretch, ray, leg.chords)
        if stretch.then == NO_ROOM:
            return no_room(sun_i, sun_q, sun_u)
        chord = stretch.chord
        if stretch.begins_chord:
            row = leg.chords[stretch.number]
            dx, dy, dz = ray[DIRECTION], ray[DIRECTION + 1], ray[DIRECTION + 2]
            if stretch.number == 0 or dx * phase_x + dy * phase_y + dz * phase_z < 1.0 - PHASE_BENDING:
                fill_phases(air, w, ray, to_sun, options.polarised, phases)
                phase_x, phase_y, phase_z = dx, dy, dz
            cos_sun_start = ray[ORIGIN] * to_sun[0] + ray[ORIGIN + 1] * to_sun[1] + ray[ORIGIN + 2] * to_sun[2]
            cos_sun_slope = dx * to_sun[0] + dy * to_sun[1] + dz * to_sun[2]
            s_lowest = -chord.radius * chord.mu
        s, whole = stretch.start, stretch.end - stretch.start
        if whole <= 0.0:
            continue
        z_enter = stretch.enter_km
        by_layer = stretch.by_layer
        first = stretch.first
        last = stretch.last
        # of a layer the secant's parabola, of a shell the extinction at three points
        lower, middle, upper = 0.0, 0.0, 0.0
        if by_layer:
            lower, middle, upper = secant_parabola(radius, at.bottom_km, z_enter, stretch.leave_km, abs(s - s_lowest))
        after = depth_or_extinction(at, by_layer, z_enter, first, last, lower, middle, upper)
        leave = depth_or_extinction(at, by_layer, stretch.leave_km, first, last, lower, middle, upper)
        base = IN_SHELL
        if by_layer:
            base = after
            dense = abs(leave - base)
        else:
            z = altitude_at(chord.altitude, chord.radius, chord.mu, s + 0.5 * whole)
            i, f = place_in(at, z, first, last)
            middle = column(at.table, i, f, EXTINCTION)
            dense = whole * max(after, middle, leave)
        parts = int(max(1.0, min(math.ceil(max(whole / longest, dense / options.max_depth)), MOST_PARTS)))
        length = whole / parts
        for part in range(parts):
            if n >= pieces.shape[0]:
                return no_room(sun_i, sun_q, sun_u)
            start = s + part * length
            if not by_layer:
                lower = after
                if parts > 1:
                    z = altitude_at(chord.altitude, chord.radius, chord.mu, start + 0.5 * length)
                    i, f = place_in(at, z, first, last)
                    middle = column(at.table, i, f, EXTINCTION)
            if part == parts - 1:
                after = leave
            else:
                z = altitude_at(chord.altitude, chord.radius, chord.mu, start + length)
                after = depth_or_extinction(at, by_layer, z, first, last, lower, middle, upper)
            if by_layer:
                through = abs(after - base)
            else:
                upper = after
                through = length * (lower + 4.0 * middle + upper) / 6.0
            t = uniform(stream) if options.random else 0.5
            here = start + t * length
            z = altitude_at(chord.altitude, chord.radius, chord.mu, here)
            i, f = place_in(at, z, first, last)
            scattering = column(at.table, i, f, SCATTERING)
            if scattering > 0.0:
                mu_sun = min(1.0, max(-1.0, (cos_sun_start + here * cos_sun_slope) / (radius + z)))
                if by_layer:
                    within = abs(depth_from_ground(at, i, f, lower, middle, upper) - base)
                else:
                    within = depth_within(lower, middle, upper, length, t)
                weight = length * math.exp(-depth - within)
                if options.bent:
                    weight *= relative_index(at.refractivity, i, f, at_start)
                root = math.sqrt(max(0.0, (z - at.bottom_km) * per_depth))
                log_light, bending = tabulated_beam(edge_km, high, low, radius, z, root, mu_sun)
                light_i, light_q, light_u = 0.0, 0.0, 0.0
                if log_light > BLACK:
                    light_i, light_q, light_u = tabulated_sunlight(
                        at.table, i, f, phases, math.exp(log_light), bending, options.polarised
                    )
                if options.random and uniform(stream) < sun.exact_beam_fraction:
                    exact_i, exact_q, exact_u = sunlight(
                        air, sun, w, z, mu_sun, row, here, to_sun, i, f, options.polarised
                    )
                    light_i += (exact_i - light_i) / sun.exact_beam_fraction
                    light_q += (exact_q - light_q) / sun.exact_beam_fraction
                    light_u += (exact_u - light_u) / sun.exact_beam_fraction
                sun_i += weight * light_i
                sun_q += weight * light_q
                sun_u += weight * light_u
                scattered += weight * scattering
                up = (here - s_lowest) / (radius + z)
                again = math.exp(log_source_light(source, places, nodes, hint, root, mu_sun, up, cos_sun_slope))
                rescattered += weight * scattering * again
            piece = pieces[n]
            piece[START] = start
            piece[LENGTH] = length
            piece[DEPTH] = depth
            piece[LOWER] = lower
            piece[MIDDLE] = middle
            piece[UPPER] = upper
            piece[BASE] = base
            piece[FIRST] = first
            piece[LAST] = last
            piece[CHORD] = stretch.number
            piece[RESCATTERED] = rescattered
            piece[SCATTERED] = scattered
            depth += through
            if by_layer:
                base = after
            n += 1
            if depth > OPAQUE_DEPTH:
                return without_ground(n, stretch.number, sun_i, sun_q, sun_u, 0.0)
    if stretch.then == TO_SPACE:
        return without_ground(n, stretch.number, sun_i, sun_q, sun_u, math.exp(-depth))
    light = (sun_i, sun_q, sun_u)
    return meet_ground(air, sun, importance, w, options, leg, stretch, n, depth, at_start, to_sun, light)
