"""One leg of a path: cut into pieces, sunlight scattered on the way gathered, weights for the next event.

A leg starts at a point and runs against the light until it leaves the air or meets the ground, along the chords of the
refracted ray (:mod:`twilight.solvers.montecarlo.lines`).  Light that arrives at its start, tau being the optical depth
from there and n the index,

    L = integral over s of (n_start / n)^2 exp(-tau(s)) [ sum over species of beta_s P_s(Theta) E (1, 0, 0) + J(s) ] ds,

where E is the sunlight at the point, unpolarised, Theta the angle to the sun as it is seen there, and J the light
scattered once more, which the next event of the path stands for.  Every piece lies in one layer or, close to the
horizontal, in one shell; see :mod:`twilight.solvers.montecarlo.air` for how its optical depth follows.  One point per
piece, drawn uniformly, carries its sunlight, so the estimate is unbiased whatever the length of the pieces.

The sun is looked up roughly at every piece (quick table; phase functions linear in the sun's bending).  With the
probability check_rate the exact value is asked for too, and the difference, divided by that probability, is added: the
mean is the exact one, whatever the table.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit

from twilight.solvers.montecarlo.air import (
    EVENT,
    EXTINCTION,
    SPECIES,
    interpolate,
    locate_level,
    weighted_depth,
)
from twilight.solvers.montecarlo.ground import ground_matrix, ground_share
from twilight.solvers.montecarlo.kernel import INNER
from twilight.solvers.montecarlo.lines import (
    CHORD_COLUMNS,
    DIRECTION,
    LONGEST_KM,
    ORIGIN,
    REFERENCE,
    REFERENCE_RADIUS_KM,
    altitude_at,
    begin_chord,
    distance_down,
    end_chord,
    first_shell,
    refractivity_at,
    relative_index,
    step_through,
)
from twilight.solvers.montecarlo.matrix import components, double_angle, species_polarising
from twilight.solvers.montecarlo.random import uniform
from twilight.solvers.montecarlo.steering import log_ground_light, log_source_light
from twilight.solvers.montecarlo.suntable import BLACK, SunTable, quick_sun
from twilight.transport.beam import Beam, beam_at_one

# columns of a piece of a leg; a piece is one row, which keeps it in one or two cache lines
START, LENGTH, DEPTH, LOWER, MIDDLE, UPPER, BASE, FIRST, LAST, CHORD, STEERED, PLAIN = range(12)
PIECE_COLUMNS = 12
"""START, LENGTH [km] along the chord of the number CHORD; DEPTH: optical depth from the start of the leg to the piece;
LOWER .. BASE: how it grows inside, see `depth_inside`; FIRST, LAST: levels around; STEERED, PLAIN: running sums of the
weights of the next event, with the coarse field's light and without."""
IN_SHELL = -1.0
"""In BASE: the piece lies in a shell, LOWER, MIDDLE, UPPER are extinctions; else they are c0, c1, c2 of the secant."""
LEG_PIECES, LEG_CHORDS = 4096, 2048
OPAQUE_DEPTH = 60.0
BENDING_STEP_RAD = 0.01
TURNED = 2e-6
"""1 - cosine of the angle by which a leg may turn before the phase functions towards the sun are taken anew."""


class Sun(NamedTuple):
    """The direct beam twice: exact (slow) and quick (rough); check_rate: how often the difference is asked for."""

    beam: Beam
    table: SunTable
    check_rate: float


class Cuts(NamedTuple):
    """How a leg is cut, and what is asked of it.

    max_length [km, for the Earth], max_depth: longest piece in length and in optical depth; sag_km: how far chords may
    leave the ray; bent: follow the refracted ray; polarised: gather Q and U as well; random: draw the point of each
    piece and check the sun (otherwise take its middle and the quick look-up alone).
    """

    max_length: float
    max_depth: float
    sag_km: float
    bent: bool
    polarised: bool
    random: bool


class Leg(NamedTuple):
    """Memory of one leg, filled by `trace` or `look`: pieces (M, PIECE_COLUMNS) and chords (K, CHORD_COLUMNS), see the
    names of the columns; phases (C, 3, 2) [sr^-1]: I, Q, U of sunlight that a species scatters towards the start, and
    their slopes in the sun's bending [rad^-1]."""

    pieces: np.ndarray
    chords: np.ndarray
    phases: np.ndarray


class Found(NamedTuple):
    """What a leg brings: the number of its pieces, or -1 if there was no room; its last chord; I of sunlight scattered
    once in the air, Q and U of that and of the ground's [sr^-1]; I of the ground's; distance to the ground from the
    start of the last chord [km], or -1; transmittance of the whole leg; and the coarse field's estimate of the light
    scattered again at the ground [sr^-1]."""

    pieces: int
    chord: int
    sun_i: float
    sun_q: float
    sun_u: float
    sun_ground: float
    ground: float
    transmittance: float
    steered_ground: float


@njit(cache=True)
def new_leg(n_species, pieces, chords):
    """Memory for one leg of so many pieces and chords."""
    return Leg(np.empty((pieces, PIECE_COLUMNS)), np.empty((chords, CHORD_COLUMNS)), np.empty((n_species, 3, 2)))


@njit(inline="always", **INNER)
def depth_within(lower, middle, upper, length, f):
    """Optical depth from the start of a piece in a shell to its fraction f: Simpson's parabola, integrated.

    lower, middle, upper [km^-1]: extinction at its start, middle and end; length [km].
    """
    return (
        length
        * f
        * (lower + f * (0.5 * (4.0 * middle - 3.0 * lower - upper) + f * (2.0 / 3.0) * (lower + upper - 2.0 * middle)))
    )


@njit(inline="always", **INNER)
def depth_inside(air, w, piece, t, i, f):
    """Optical depth from the start of a piece (a row of `pieces`) to its fraction t, the place (i, f) of the levels."""
    if piece[BASE] == IN_SHELL:
        return depth_within(piece[LOWER], piece[MIDDLE], piece[UPPER], piece[LENGTH], t)
    h = air.level_km[i] - air.shell_km[0]
    return abs(
        weighted_depth(
            air.table[w], air.moment[w], h, 1.0 / air.per_km[i], i, f, piece[LOWER], piece[MIDDLE], piece[UPPER]
        )
        - piece[BASE]
    )


@njit(inline="always", **INNER)
def secant_parabola(radius, bottom, enter_km, leave_km, u):
    """(c0, c1, c2): secant of a line as c0 + c1 h + c2 h^2 of the height h above `bottom`, exact at three points.

    radius [km] of the Earth; the line crosses the altitude enter_km at the distance u [km] from its lowest point.
    """
    r = radius + enter_km
    rise = leave_km - enter_km
    half = 0.5 * rise
    f0 = r / u
    f1 = (r + half) / math.sqrt(u * u + half * (half + 2.0 * r))
    f2 = (r + rise) / math.sqrt(u * u + rise * (rise + 2.0 * r))
    h = enter_km - bottom
    c2 = 2.0 * (f0 + f2 - 2.0 * f1) / (rise * rise)
    slope = (4.0 * f1 - 3.0 * f0 - f2) / rise
    return f0 - slope * h + c2 * h * h, slope - 2.0 * c2 * h, c2


@njit(inline="always", **INNER)
def column(table, i, f, c):
    """One coefficient [km^-1] of the table (N, 2 + C) of one wavelength."""
    return table[i, c] * (1.0 - f) + table[i + 1, c] * f


@njit(inline="always", **INNER)
def lifted_sun(x, y, z, to_sun, mu_sun, bending):
    """The apparent direction of the sun at a point (x, y, z), lifted by `bending` [rad] towards the vertical.

    to_sun (3,): unit vector to the true sun; mu_sun: cosine of its zenith angle there.
    """
    if bending == 0.0:
        return to_sun[0], to_sun[1], to_sun[2]
    per = 1.0 / math.sqrt(x * x + y * y + z * z)
    sine = math.sqrt(max(1e-300, (1.0 - mu_sun) * (1.0 + mu_sun)))
    a = math.cos(bending) - mu_sun * math.sin(bending) / sine
    b = math.sin(bending) / sine * per
    return a * to_sun[0] + b * x, a * to_sun[1] + b * y, a * to_sun[2] + b * z


@njit(**INNER)
def sunlight(air, beam, w, z, mu_sun, chord, s, to_sun, i, f, polarised):
    """(I, Q, U) of sunlight scattered at a point against a chord: sum over species of beta_s P_s E / F0 [sr^-1 km^-1].

    chord (9,): its start, direction and reference; s [km]: the point's distance; z [km] its altitude; mu_sun: cosine of
    the true sun's zenith angle there; (i, f): its place among the levels; to_sun (3,).
    """
    irradiance, bending = beam_at_one(beam, z, mu_sun, w)
    if irradiance <= 0.0:
        return 0.0, 0.0, 0.0
    d = chord[DIRECTION:REFERENCE]
    e = chord[REFERENCE:CHORD_COLUMNS]
    x, y, h = lifted_sun(
        chord[ORIGIN] + s * d[0], chord[ORIGIN + 1] + s * d[1], chord[ORIGIN + 2] + s * d[2], to_sun, mu_sun, bending
    )
    cosine = min(1.0, max(-1.0, d[0] * x + d[1] * y + d[2] * h))
    total = 0.0
    polarising = 0.0
    for c in range(air.table.shape[2] - SPECIES):
        beta = interpolate(air, w, i, f, SPECIES + c)
        if beta > 0.0:
            p11, p12 = species_polarising(air, w, c, cosine)
            total += beta * p11
            polarising += beta * p12
    total *= irradiance
    if not polarised:
        return total, 0.0, 0.0
    polarising *= irradiance
    a, b = components(e, d, x, y, h)
    cos_2phi, sin_2phi = double_angle(a, b)
    return total, polarising * cos_2phi, polarising * sin_2phi


@njit(**INNER)
def ground_sunlight(air, beam, w, x, y, z, mu_sun, chord, to_sun, polarised):
    """(I, Q, U) [sr^-1] of sunlight that the ground at a point (x, y, z) [km] sends back along a chord (9,).

    mu_sun: cosine of the true sun's zenith angle there.
    """
    irradiance, bending = beam_at_one(beam, air.shell_km[0], mu_sun, w)
    if irradiance <= 0.0:
        return 0.0, 0.0, 0.0
    d = chord[DIRECTION:REFERENCE]
    sx, sy, sz = lifted_sun(x, y, z, to_sun, mu_sun, bending)
    r = math.sqrt(x * x + y * y + z * z)
    # the sun stands higher by its bending
    mu_in = math.cos(math.acos(min(1.0, max(-1.0, mu_sun))) - bending)
    mu_out = -(x * d[0] + y * d[1] + z * d[2]) / r
    p11, p12, _, _ = ground_matrix(air, w, mu_in, mu_out, d[0] * sx + d[1] * sy + d[2] * sz)
    if not polarised or p12 == 0.0:
        return irradiance * p11, 0.0, 0.0
    a, b = components(chord[REFERENCE:CHORD_COLUMNS], d, sx, sy, sz)
    cos_2phi, sin_2phi = double_angle(a, b)
    return irradiance * p11, irradiance * p12 * cos_2phi, irradiance * p12 * sin_2phi


@njit(**INNER)
def fill_phases(air, w, ray, to_sun, polarised, phases):
    """Fill the phases of a `Leg` for the direction of a ray (9,): without bending, and with BENDING_STEP_RAD of it."""
    x, y, z = ray[ORIGIN], ray[ORIGIN + 1], ray[ORIGIN + 2]
    d = ray[DIRECTION:REFERENCE]
    e = ray[REFERENCE:CHORD_COLUMNS]
    mu_sun = (x * to_sun[0] + y * to_sun[1] + z * to_sun[2]) / math.sqrt(x * x + y * y + z * z)
    for m in range(2):
        lx, ly, lz = lifted_sun(x, y, z, to_sun, mu_sun, m * BENDING_STEP_RAD)
        cosine = min(1.0, max(-1.0, d[0] * lx + d[1] * ly + d[2] * lz))
        a, b = components(e, d, lx, ly, lz)
        cos_2phi, sin_2phi = double_angle(a, b)
        for c in range(phases.shape[0]):
            p11, p12 = species_polarising(air, w, c, cosine)
            phases[c, 0, m] = p11
            if polarised:
                phases[c, 1, m] = p12 * cos_2phi
                phases[c, 2, m] = p12 * sin_2phi
    for c in range(phases.shape[0]):
        for k in range(3 if polarised else 1):
            phases[c, k, 1] = (phases[c, k, 1] - phases[c, k, 0]) / BENDING_STEP_RAD


@njit(**INNER)
def land(air, sun, steering, w, chord, distance, factor, n, last_chord, to_sun, polarised, light):
    """`Found` for a leg that meets the ground at a distance [km] of a chord (9,), `factor` being its transmittance.

    light: I, Q, U of sunlight scattered on the way [sr^-1].
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
def trace(air, sun, steering, w, ray, to_sun, cuts, stream, leg):
    """Walk one leg at wavelength w from a ray (9,): start [km], direction and reference, which it uses up.

    to_sun (3,): unit vector to the true sun; cuts: :class:`Cuts`; stream (1,): random numbers; leg: :class:`Leg`,
    filled.  Returns :class:`Found`.
    """
    levels = air.level_km
    bin_start = air.bin_start
    bins_per_km = air.bins_per_km
    per_km = air.per_km
    table = air.table[w]
    moment = air.moment[w]
    refractivity = air.refractivity[w]
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
    bottom = air.shell_km[0]
    n_shells = air.shell_first.size
    per_depth = 1.0 / (air.shell_km[n_shells] - bottom)
    n_species = phases.shape[0]
    scale = radius / REFERENCE_RADIUS_KM
    longest = cuts.max_length * scale
    sun_i = 0.0
    sun_q = 0.0
    sun_u = 0.0
    n = 0
    n_chords = 0
    depth = 0.0
    steered = 0.0
    plain = 0.0
    travelled = 0.0
    turn_x, turn_y, turn_z = 0.0, 0.0, 0.0
    if not enter_air(air, ray):
        return Found(0, -1, 0.0, 0.0, 0.0, 0.0, -1.0, 1.0, 0.0)
    at_start = 0.0
    if cuts.bent:
        x, y, z = ray[ORIGIN], ray[ORIGIN + 1], ray[ORIGIN + 2]
        at_start = refractivity_at(air, w, max(bottom, math.sqrt(x * x + y * y + z * z) - radius))
    while True:
        chord = begin_chord(air, w, cuts.bent, cuts.sag_km, ray)
        if n_chords >= leg.chords.shape[0] or travelled > LONGEST_KM * scale:
            return Found(-1, -1, sun_i, sun_q, sun_u, 0.0, -1.0, 0.0, 0.0)
        row = leg.chords[n_chords]
        for m in range(CHORD_COLUMNS):
            row[m] = ray[m]
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
                first = step.first
                last = step.last
                lower = 0.0
                middle = 0.0
                upper = 0.0
                leave = 0.0
                base = IN_SHELL
                i, f = locate_level(levels, bin_start, bins_per_km, per_km, z_enter, first, last)
                if step.by_layer:
                    lower, middle, upper = secant_parabola(radius, bottom, z_enter, step.leave_km, abs(s - s_lowest))
                    after = weighted_depth(
                        table, moment, levels[i] - bottom, 1.0 / per_km[i], i, f, lower, middle, upper
                    )
                    base = after
                    i, f = locate_level(levels, bin_start, bins_per_km, per_km, step.leave_km, first, last)
                    leave = weighted_depth(
                        table, moment, levels[i] - bottom, 1.0 / per_km[i], i, f, lower, middle, upper
                    )
                    dense = abs(leave - base)
                else:
                    after = column(table, i, f, EXTINCTION)
                    i, f = locate_level(levels, bin_start, bins_per_km, per_km, step.leave_km, first, last)
                    leave = column(table, i, f, EXTINCTION)
                    z = altitude_at(chord.altitude, chord.radius, chord.mu, s + 0.5 * stretch)
                    i, f = locate_level(levels, bin_start, bins_per_km, per_km, z, first, last)
                    middle = column(table, i, f, EXTINCTION)
                    dense = stretch * max(after, middle, leave)
                parts = int(max(1.0, min(math.ceil(max(stretch / longest, dense / cuts.max_depth)), 100000.0)))
                length = stretch / parts
                for part in range(parts):
                    if n >= pieces.shape[0]:
                        return Found(-1, -1, sun_i, sun_q, sun_u, 0.0, -1.0, 0.0, 0.0)
                    start = s + part * length
                    if not step.by_layer:
                        lower = after
                        if parts > 1:
                            z = altitude_at(chord.altitude, chord.radius, chord.mu, start + 0.5 * length)
                            i, f = locate_level(levels, bin_start, bins_per_km, per_km, z, first, last)
                            middle = column(table, i, f, EXTINCTION)
                    if part == parts - 1:
                        after = leave
                    else:
                        z = altitude_at(chord.altitude, chord.radius, chord.mu, start + length)
                        i, f = locate_level(levels, bin_start, bins_per_km, per_km, z, first, last)
                        if step.by_layer:
                            after = weighted_depth(
                                table, moment, levels[i] - bottom, 1.0 / per_km[i], i, f, lower, middle, upper
                            )
                        else:
                            after = column(table, i, f, EXTINCTION)
                    if step.by_layer:
                        through = abs(after - base)
                    else:
                        upper = after
                        through = length * (lower + 4.0 * middle + upper) / 6.0
                    t = uniform(stream) if cuts.random else 0.5
                    here = start + t * length
                    z = altitude_at(chord.altitude, chord.radius, chord.mu, here)
                    i, f = locate_level(levels, bin_start, bins_per_km, per_km, z, first, last)
                    scattering = column(table, i, f, EVENT)
                    if scattering > 0.0:
                        mu_sun = min(1.0, max(-1.0, (cos_sun_start + here * cos_sun_slope) / (radius + z)))
                        if step.by_layer:
                            within = abs(
                                weighted_depth(
                                    table, moment, levels[i] - bottom, 1.0 / per_km[i], i, f, lower, middle, upper
                                )
                                - base
                            )
                        else:
                            within = depth_within(lower, middle, upper, length, t)
                        weight = length * math.exp(-depth - within)
                        if cuts.bent:
                            weight *= relative_index(refractivity, i, f, at_start)
                        root = math.sqrt(max(0.0, (z - bottom) * per_depth))
                        light, bending = quick_sun(edge_km, high, low, radius, z, root, mu_sun)
                        quick_i = 0.0
                        quick_q = 0.0
                        quick_u = 0.0
                        if light > BLACK:
                            for c in range(n_species):
                                beta = column(table, i, f, SPECIES + c)
                                quick_i += beta * max(0.0, phases[c, 0, 0] + bending * phases[c, 0, 1])
                                if cuts.polarised:
                                    quick_q += beta * (phases[c, 1, 0] + bending * phases[c, 1, 1])
                                    quick_u += beta * (phases[c, 2, 0] + bending * phases[c, 2, 1])
                            light = math.exp(light)
                            quick_i *= light
                            quick_q *= light
                            quick_u *= light
                        if cuts.random and uniform(stream) < sun.check_rate:
                            exact_i, exact_q, exact_u = sunlight(
                                air, sun.beam, w, z, mu_sun, row, here, to_sun, i, f, cuts.polarised
                            )
                            quick_i += (exact_i - quick_i) / sun.check_rate
                            quick_q += (exact_q - quick_q) / sun.check_rate
                            quick_u += (exact_u - quick_u) / sun.check_rate
                        sun_i += weight * quick_i
                        sun_q += weight * quick_q
                        sun_u += weight * quick_u
                        plain += weight * scattering
                        up = (here - s_lowest) / (radius + z)
                        steered += (
                            weight
                            * scattering
                            * math.exp(log_source_light(source, places, nodes, hint, root, mu_sun, up, cos_sun_slope))
                        )
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
                    if step.by_layer:
                        base = after
                    n += 1
                    if depth > OPAQUE_DEPTH:
                        return Found(n, n_chords, sun_i, sun_q, sun_u, 0.0, -1.0, 0.0, 0.0)
            s = step.end
            z_enter = step.leave_km
            if step.ends_chord:
                break
            k = step.next_shell
            falling = step.falling
            if k < 0:
                factor = math.exp(-depth)
                if cuts.bent:
                    factor *= relative_index(refractivity, 0, 0.0, at_start)
                light = (sun_i, sun_q, sun_u)
                return land(air, sun, steering, w, row, s, factor, n, n_chords, to_sun, cuts.polarised, light)
            if k >= n_shells:
                return Found(n, n_chords, sun_i, sun_q, sun_u, 0.0, -1.0, math.exp(-depth), 0.0)
        n_chords += 1
        travelled += chord.length
        end_chord(chord, ray)
