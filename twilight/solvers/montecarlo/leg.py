"""One leg of a path: cut into pieces, single scattering estimated along it, weights for the next event.

A leg starts at a point and runs against the light until it leaves the air or meets the ground, along the chords of the
refracted ray (:mod:`twilight.solvers.montecarlo.rays`).  Light that arrives at its start, tau being the optical depth
from there and n the refractive index,

    L = integral over s of (n_start / n)^2 exp(-tau(s)) [ sum over species of beta_s P_s(Theta) E (1, 0, 0) + J(s) ] ds,

where E is the sunlight at the point, unpolarised, Theta the angle to the sun as it is seen there, and J the source
function of light scattered before, which the next event of the path samples.  Every piece lies in one layer or, close
to the horizontal, in one shell; see :mod:`twilight.solvers.montecarlo.air` for how its optical depth follows.  One
point per piece, drawn uniformly, carries its sunlight, so the estimate is unbiased whatever the length of the pieces.

A `Leg` holds pieces with their optical depth, chords and phase functions: `trace` and
`line_of_sight.integrate_line_of_sight` fill it, and `events` draws points from its pieces.  Both are marched by
`rays.next_stretch`.  Arguments that kernels share: `kernel`.

Sunlight is looked up in a table at every piece (phase functions linear in the sun's bending).  With the probability
exact_beam_fraction the exact value is asked for too, and the difference, divided by that probability, is added: the
mean is the exact one, whatever the table.

The walk through the air and the incidence on the ground are not those of :mod:`twilight.transport` that all other
solvers share: the reference solution would otherwise repeat a mistake made there.
"""

import math
from typing import NamedTuple

import numpy as np

from twilight.jit.kernels import njit
from twilight.solvers.montecarlo.air import EXTINCTION, SCATTERING, air_at, column, depth_from_ground, place_in
from twilight.solvers.montecarlo.importance import log_ground_light, log_source_light
from twilight.solvers.montecarlo.kernel import INNER, uniform
from twilight.solvers.montecarlo.rays import (
    CHORD_COLUMNS,
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
from twilight.solvers.montecarlo.sunlight import (
    BLACK,
    ChordPoint,
    fill_phases,
    ground_sunlight,
    sunlight,
    tabulated_beam,
    tabulated_sunlight,
)

# Columns of a piece; one row per piece keeps it in one or two cache lines.
# START, LENGTH [km]: along the chord in the row CHORD of `Leg.chords`.
# DEPTH: optical depth from the start of the leg to the piece.
# BASE: IN_SHELL, or of a piece in a layer the optical depth from the ground to its start along the line's secant.
# LOWER, MIDDLE, UPPER: in a shell extinction [km^-1] at start, middle and end; in a layer c0, c1 [km^-1], c2 [km^-2] of
#   the secant c0 + c1 h + c2 h^2, h [km] above the ground.
# FIRST, LAST: levels that bound the shell or layer.
# SCATTERED: sum up to and with the piece of transmittance x scattering coefficient x length.
# RESCATTERED: the same sum times the approximate source function: light scattered again [sr^-1].
START, LENGTH, DEPTH, LOWER, MIDDLE, UPPER, BASE, FIRST, LAST, CHORD, RESCATTERED, SCATTERED = range(12)
PIECE_COLUMNS = 12
IN_SHELL = -1.0
"""In the column BASE: the piece lies in a shell, not in a layer."""
LEG_PIECES = 4096
"""Most pieces of a later leg; `LegTotals.n_pieces` is -1 where a leg needs more."""
LEG_CHORDS = 2048
"""Most chords of a later leg."""
OPAQUE_DEPTH = 60.0
"""Optical depth at which a leg ends: exp(-60) of the light is behind it."""
MOST_PARTS = 100000.0
"""Most pieces of one stretch, so that no medium asks for more than an integer holds."""
PHASE_BENDING = 2e-6
"""1 - cosine of the angle by which a leg may bend before the phase functions towards the sun are computed anew."""


class LegOptions(NamedTuple):
    """How a leg is cut, and what is asked of it.

    max_length_km [km, for the Earth's radius], max_depth: longest piece in length and in optical depth; sag_km [km]:
    how far chords may leave the ray; bent: follow the refracted ray; polarised: gather Q and U as well; random: draw
    the point of each piece and correct the tabulated sunlight (otherwise take its middle and the table alone).
    """

    max_length_km: float
    max_depth: float
    sag_km: float
    bent: bool
    polarised: bool
    random: bool


class Leg(NamedTuple):
    """Memory of one leg: pieces (M, PIECE_COLUMNS) and chords (K, CHORD_COLUMNS) with named columns.

    phases (C, 3, 2) [sr^-1]: I, Q, U of sunlight that a species scatters towards the start, and their slopes in the
    bending of sunlight [rad^-1].
    """

    pieces: np.ndarray
    chords: np.ndarray
    phases: np.ndarray


class LegTotals(NamedTuple):
    """What a leg brings.

    n_pieces: how many pieces it has, -1 where there was no room; last_chord: row of its last chord.
    sun_i [sr^-1]: I of sunlight scattered once in the air; sun_ground [sr^-1]: I of sunlight that the ground reflects;
        sun_q, sun_u [sr^-1]: Q and U of both.
    ground_km [km]: distance to the ground from the start of the last chord, -1 where the leg misses the ground.
    transmittance: of the whole leg.
    ground_rescattered [sr^-1]: diffuse light that the ground reflects, by the importance function.
    """

    n_pieces: int
    last_chord: int
    sun_i: float
    sun_q: float
    sun_u: float
    sun_ground: float
    ground_km: float
    transmittance: float
    ground_rescattered: float


@njit(cache=True)
def new_leg(n_species, pieces, chords):
    """Memory for one leg: n_species, pieces, chords: how many of each."""
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
    """Optical depth from the start of a piece (a row of `pieces`) to its fraction t, the place (i, f) of the levels.

    t: of the length, 0 to 1.
    """
    if piece[BASE] == IN_SHELL:
        return depth_within(piece[LOWER], piece[MIDDLE], piece[UPPER], piece[LENGTH], t)
    depth = depth_from_ground(air_at(air, w), i, f, piece[LOWER], piece[MIDDLE], piece[UPPER])
    return abs(depth - piece[BASE])


@njit(inline="always", **INNER)
def secant_parabola(radius, bottom, enter_km, leave_km, u):
    """(c0, c1, c2): secant of a line as c0 + c1 h + c2 h^2 of the height h above the ground, exact at three points.

    radius [km]: of the Earth; bottom [km]: altitude of the ground; enter_km, leave_km: altitudes between which the line
    crosses; u [km]: distance of enter_km from its lowest point.
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
def depth_or_extinction(at, by_layer, z, first, last, c0, c1, c2):
    """Optical depth from the ground (`by_layer`), else extinction [km^-1], at an altitude z [km] between two levels.

    first, last: the levels; the line has the secant c0 + c1 h + c2 h^2, (c0, c1, c2) [1, km^-1, km^-2].
    """
    i, f = place_in(at, z, first, last)
    if by_layer:
        return depth_from_ground(at, i, f, c0, c1, c2)
    return column(at.table, i, f, EXTINCTION)


@njit(inline="always", **INNER)
def without_ground(n, chord, light_i, light_q, light_u, transmittance):
    """`LegTotals` of a leg that ends in the air or in space.

    n: number of its pieces; chord: number of the chord it ends on; light_i, light_q, light_u [sr^-1]: sunlight
    scattered on the way; transmittance: of the whole leg.
    """
    return LegTotals(n, chord, light_i, light_q, light_u, 0.0, -1.0, transmittance, 0.0)


@njit(inline="always", **INNER)
def no_room(light_i, light_q, light_u):
    """`LegTotals` of a leg that needs more pieces or chords than there is memory for.

    light_i, light_q, light_u [sr^-1]: so far.
    """
    return LegTotals(-1, -1, light_i, light_q, light_u, 0.0, -1.0, 0.0, 0.0)


@njit(inner=True, **INNER)
def rescattered_light(leg, totals):
    """Light [sr^-1] that is scattered again along a leg, by the importance function."""
    if totals.n_pieces > 0:
        return totals.ground_rescattered + leg.pieces[totals.n_pieces - 1, RESCATTERED]
    return totals.ground_rescattered


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
def meet_ground(air, sun, importance, w, leg, stretch, to_sun, totals):
    """`LegTotals` of a leg that meets the ground at the end of a stretch, its last `Stretch`.

    totals: those without the ground, whose transmittance counts (n_start / n)^2 at the ground.
    """
    factor = totals.transmittance
    x, y, z, mu_sun = ground_point(air, leg.chords[stretch.number], stretch.end, to_sun)
    reflected = factor * air.ground_albedo[w]
    direct = 0.0
    diffuse = 0.0
    if reflected > 0.0:
        direct = factor * ground_sunlight(air, sun, w, x, y, z, mu_sun, to_sun)
        diffuse = reflected / math.pi * math.exp(log_ground_light(importance, w, mu_sun))
    n, last, sun_i, sun_q, sun_u = totals[:5]
    return LegTotals(n, last, sun_i, sun_q, sun_u, direct, stretch.end, factor, diffuse)


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
            s_point = start + t * length
            z = altitude_at(chord.altitude, chord.radius, chord.mu, s_point)
            i, f = place_in(at, z, first, last)
            scattering = column(at.table, i, f, SCATTERING)
            if scattering > 0.0:
                mu_sun = min(1.0, max(-1.0, (cos_sun_start + s_point * cos_sun_slope) / (radius + z)))
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
                    point = ChordPoint(s_point, z, mu_sun, i, f)
                    exact_i, exact_q, exact_u = sunlight(air, sun, w, point, row, to_sun, options.polarised)
                    light_i += (exact_i - light_i) / sun.exact_beam_fraction
                    light_q += (exact_q - light_q) / sun.exact_beam_fraction
                    light_u += (exact_u - light_u) / sun.exact_beam_fraction
                sun_i += weight * light_i
                sun_q += weight * light_q
                sun_u += weight * light_u
                scattered += weight * scattering
                up = (s_point - s_lowest) / (radius + z)
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
    transmittance = math.exp(-depth)
    if stretch.then == TO_SPACE:
        return without_ground(n, stretch.number, sun_i, sun_q, sun_u, transmittance)
    if options.bent:
        transmittance *= relative_index(air.refractivity[w], 0, 0.0, at_start)
    totals = without_ground(n, stretch.number, sun_i, sun_q, sun_u, transmittance)
    return meet_ground(air, sun, importance, w, leg, stretch, to_sun, totals)
