"""One leg of a path: cut into pieces, sunlight scattered on the way gathered, weights for the next event.

A leg starts at a point and runs against the light until it leaves the air or meets the ground, along the chords of the
refracted ray (:mod:`twilight.solvers.montecarlo.lines`).  Light that arrives at its start, tau being the optical depth
from there and n the index,

    L = integral over s of (n_start / n)^2 exp(-tau(s)) [ sum over species of beta_s P_s(Theta) E (1, 0, 0) + J(s) ] ds,

where E is the sunlight at the point, unpolarised, Theta the angle to the sun as it is seen there, and J the light
scattered once more, which the next event of the path stands for.  Every piece lies in one layer or, close to the
horizontal, in one shell; see :mod:`twilight.solvers.montecarlo.air` for how its optical depth follows.  One point per
piece, drawn uniformly, carries its sunlight, so the estimate is unbiased whatever the length of the pieces.  Arguments
that kernels share: `kernel`.

The sun is looked up roughly at every piece (quick table; phase functions linear in the sun's bending).  With the
probability check_rate the exact value is asked for too, and the difference, divided by that probability, is added: the
mean is the exact one, whatever the table.

The referee keeps its own walk through the air and its own incidence on the ground, in place of those of
:mod:`twilight.transport` that all other solvers share: a mistake there would otherwise be made here too.
"""

from __future__ import annotations

import math

import numpy as np

from twilight.kernels import njit
from twilight.solvers.montecarlo.air import EVENT, EXTINCTION, air_at, column, depth_from_ground, place_in
from twilight.solvers.montecarlo.ground import ground_share
from twilight.solvers.montecarlo.kernel import INNER
from twilight.solvers.montecarlo.lines import (
    DIRECTION,
    LONGEST_KM,
    ORIGIN,
    REFERENCE_RADIUS_KM,
    altitude_at,
    begin_chord,
    distance_down,
    end_chord,
    first_shell,
    refractivity_on_ray,
    relative_index,
    step_through,
)
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
    PLAIN,
    START,
    STEERED,
    UPPER,
    Found,
    depth_within,
    growth,
    keep_chord,
    no_room,
    secant_parabola,
    without_ground,
)
from twilight.solvers.montecarlo.random import uniform
from twilight.solvers.montecarlo.steering import log_ground_light, log_source_light
from twilight.solvers.montecarlo.sunlight import fill_phases, ground_sunlight, quick_sunlight, sunlight
from twilight.solvers.montecarlo.suntable import BLACK, quick_sun

TURNED = 2e-6
"""1 - cosine of the angle by which a leg may turn before the phase functions towards the sun are taken anew."""


@njit(inner=True, **INNER)
def enter_air(air, ray):
    """Move the start of a ray (9,) from space to the top of the air along a line; False if it misses the air."""
    r = math.sqrt(ray[ORIGIN] * ray[ORIGIN] + ray[ORIGIN + 1] * ray[ORIGIN + 1] + ray[ORIGIN + 2] * ray[ORIGIN + 2])
    top = air.shell_km[air.shell_km.size - 1]
    z = r - air.earth_radius_km
    if z < top - 1e-9:
        return True
    mu = (
        ray[ORIGIN] * ray[DIRECTION] + ray[ORIGIN + 1] * ray[DIRECTION + 1] + ray[ORIGIN + 2] * ray[DIRECTION + 2]
    ) / r
    if mu >= 0.0:
        return False
    s = distance_down(z, r, mu, top - 1e-9)
    if s < 0.0:
        return False
    for m in range(3):
        ray[ORIGIN + m] += s * ray[DIRECTION + m]
    return True


@njit(**INNER)
def land(air, sun, steering, w, chord, distance, factor, n, last_chord, to_sun, polarised, light):
    """`Found` for a leg that meets the ground at a distance [km] of a chord (9,), `factor` being its transmittance.

    n: its pieces; last_chord: number of the chord; light: I, Q, U of sunlight scattered on the way [sr^-1].
    """
    sun_i, sun_q, sun_u = light
    x = chord[ORIGIN] + distance * chord[DIRECTION]
    y = chord[ORIGIN + 1] + distance * chord[DIRECTION + 1]
    z = chord[ORIGIN + 2] + distance * chord[DIRECTION + 2]
    radius = air.earth_radius_km + air.shell_km[0]
    mu_sun = min(1.0, max(-1.0, (x * to_sun[0] + y * to_sun[1] + z * to_sun[2]) / radius))
    down = -(x * chord[DIRECTION] + y * chord[DIRECTION + 1] + z * chord[DIRECTION + 2]) / radius
    share = factor * ground_share(air, w, down)
    direct = 0.0
    diffuse = 0.0
    if share > 0.0:
        of_i, of_q, of_u = ground_sunlight(air, sun.beam, w, x, y, z, mu_sun, chord, to_sun, polarised)
        direct = factor * of_i
        sun_q += factor * of_q
        sun_u += factor * of_u
        diffuse = share / math.pi * math.exp(log_ground_light(steering, w, mu_sun))
    return Found(n, last_chord, sun_i, sun_q, sun_u, direct, distance, factor, diffuse)


@njit(**INNER)
def trace(air, sun, steering, w, ray, to_sun, cuts, stream, leg):
    """Walk one leg at wavelength w from a ray (9,): start [km], direction and reference, which it uses up.

    to_sun (3,): unit vector to the true sun; stream (1,): random numbers; cuts, leg: `Cuts` and `Leg` of
    :mod:`~twilight.solvers.montecarlo.pieces`, the leg being filled.  Returns its `Found`.
    """
    at = air_at(air, w)
    radius = air.earth_radius_km
    edge_km = sun.table.edge_km[w]
    high = sun.table.high[w]
    low = sun.table.low[w]
    source = steering.log_source[w]
    places = steering.place_of_root
    nodes = steering.cos_sun
    hint = steering.hint
    pieces = leg.pieces
    phases = leg.phases
    n_shells = air.shell_first.size
    per_depth = 1.0 / (air.shell_km[n_shells] - at.bottom_km)
    scale = radius / REFERENCE_RADIUS_KM
    longest = cuts.max_length * scale
    sun_i, sun_q, sun_u = 0.0, 0.0, 0.0
    n = np.int64(0)
    n_chords = np.int64(0)
    depth = 0.0
    steered = 0.0
    plain = 0.0
    travelled = 0.0
    turn_x, turn_y, turn_z = 0.0, 0.0, 0.0
    if not enter_air(air, ray):
        return without_ground(0, -1, 0.0, 0.0, 0.0, 1.0)
    at_start = refractivity_on_ray(air, w, ray) if cuts.bent else 0.0
    while True:
        chord = begin_chord(air, w, cuts.bent, cuts.sag_km, ray)
        if n_chords >= leg.chords.shape[0] or travelled > LONGEST_KM * scale:
            return no_room(sun_i, sun_q, sun_u)
        row = keep_chord(ray, leg.chords, n_chords)
        dx, dy, dz = ray[DIRECTION], ray[DIRECTION + 1], ray[DIRECTION + 2]
        if n_chords == 0 or dx * turn_x + dy * turn_y + dz * turn_z < 1.0 - TURNED:
            fill_phases(air, w, ray, to_sun, cuts.polarised, phases)
            turn_x, turn_y, turn_z = dx, dy, dz
        cos_sun_start = ray[ORIGIN] * to_sun[0] + ray[ORIGIN + 1] * to_sun[1] + ray[ORIGIN + 2] * to_sun[2]
        cos_sun_slope = dx * to_sun[0] + dy * to_sun[1] + dz * to_sun[2]
        s = 0.0
        s_lowest = -chord.radius * chord.mu
        z_enter = chord.altitude
        falling = chord.mu < 0.0
        k = first_shell(air, z_enter, chord.mu)
        while True:
            step = step_through(air, chord, s, z_enter, k, falling, True)
            stretch = step.end - s
            if stretch > 0.0:
                by_layer = step.by_layer
                first = step.first
                last = step.last
                # of a layer the secant's parabola, of a shell the extinction at three points
                lower, middle, upper = 0.0, 0.0, 0.0
                if by_layer:
                    lower, middle, upper = secant_parabola(
                        radius, at.bottom_km, z_enter, step.leave_km, abs(s - s_lowest)
                    )
                after = growth(at, by_layer, z_enter, first, last, lower, middle, upper)
                leave = growth(at, by_layer, step.leave_km, first, last, lower, middle, upper)
                base = IN_SHELL
                if by_layer:
                    base = after
                    dense = abs(leave - base)
                else:
                    z = altitude_at(chord.altitude, chord.radius, chord.mu, s + 0.5 * stretch)
                    i, f = place_in(at, z, first, last)
                    middle = column(at.table, i, f, EXTINCTION)
                    dense = stretch * max(after, middle, leave)
                parts = int(max(1.0, min(math.ceil(max(stretch / longest, dense / cuts.max_depth)), MOST_PARTS)))
                length = stretch / parts
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
                        after = growth(at, by_layer, z, first, last, lower, middle, upper)
                    if by_layer:
                        through = abs(after - base)
                    else:
                        upper = after
                        through = length * (lower + 4.0 * middle + upper) / 6.0
                    t = uniform(stream) if cuts.random else 0.5
                    here = start + t * length
                    z = altitude_at(chord.altitude, chord.radius, chord.mu, here)
                    i, f = place_in(at, z, first, last)
                    scattering = column(at.table, i, f, EVENT)
                    if scattering > 0.0:
                        mu_sun = min(1.0, max(-1.0, (cos_sun_start + here * cos_sun_slope) / (radius + z)))
                        if by_layer:
                            within = abs(depth_from_ground(at, i, f, lower, middle, upper) - base)
                        else:
                            within = depth_within(lower, middle, upper, length, t)
                        weight = length * math.exp(-depth - within)
                        if cuts.bent:
                            weight *= relative_index(at.refractivity, i, f, at_start)
                        root = math.sqrt(max(0.0, (z - at.bottom_km) * per_depth))
                        log_light, bending = quick_sun(edge_km, high, low, radius, z, root, mu_sun)
                        light_i, light_q, light_u = 0.0, 0.0, 0.0
                        if log_light > BLACK:
                            light_i, light_q, light_u = quick_sunlight(
                                at.table, i, f, phases, math.exp(log_light), bending, cuts.polarised
                            )
                        if cuts.random and uniform(stream) < sun.check_rate:
                            exact_i, exact_q, exact_u = sunlight(
                                air, sun.beam, w, z, mu_sun, row, here, to_sun, i, f, cuts.polarised
                            )
                            light_i += (exact_i - light_i) / sun.check_rate
                            light_q += (exact_q - light_q) / sun.check_rate
                            light_u += (exact_u - light_u) / sun.check_rate
                        sun_i += weight * light_i
                        sun_q += weight * light_q
                        sun_u += weight * light_u
                        plain += weight * scattering
                        up = (here - s_lowest) / (radius + z)
                        again = math.exp(log_source_light(source, places, nodes, hint, root, mu_sun, up, cos_sun_slope))
                        steered += weight * scattering * again
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
                    piece[CHORD] = n_chords
                    piece[STEERED] = steered
                    piece[PLAIN] = plain
                    depth += through
                    if by_layer:
                        base = after
                    n += 1
                    if depth > OPAQUE_DEPTH:
                        return without_ground(n, n_chords, sun_i, sun_q, sun_u, 0.0)
            s = step.end
            z_enter = step.leave_km
            if step.ends_chord:
                break
            k = step.next_shell
            falling = step.falling
            if k < 0:
                factor = math.exp(-depth)
                if cuts.bent:
                    factor *= relative_index(at.refractivity, 0, 0.0, at_start)
                light = (sun_i, sun_q, sun_u)
                return land(air, sun, steering, w, row, s, factor, n, n_chords, to_sun, cuts.polarised, light)
            if k >= n_shells:
                return without_ground(n, n_chords, sun_i, sun_q, sun_u, math.exp(-depth))
        n_chords += 1
        travelled += chord.length
        end_chord(chord, ray)
