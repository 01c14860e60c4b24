"""The line of sight, the same for all samples of a pixel: its single scattering by quadrature, its pieces for events.

The integral is that of :mod:`twilight.solvers.montecarlo.leg`.  Each piece has three Gauss nodes; where sunlight
changes steeply along a piece, the piece is cut.  Where the edge of the shadow crosses a part, the edge is found by
bisection and the nodes lie on the lit side, so that no node can stand now on one side of the edge and now on the other.
Arguments that kernels share: `kernel`.
"""

import math
from typing import NamedTuple

import numpy as np

from twilight.jit.kernels import njit
from twilight.solvers.montecarlo.air import EXTINCTION, SCATTERING, column, locate
from twilight.solvers.montecarlo.importance import log_source_light
from twilight.solvers.montecarlo.kernel import INNER
from twilight.solvers.montecarlo.leg import (
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
    depth_within,
    enter_air,
    meet_ground,
    no_room,
    without_ground,
)
from twilight.solvers.montecarlo.rays import (
    DIRECTION,
    NO_ROOM,
    ON,
    ORIGIN,
    REFERENCE_RADIUS_KM,
    TO_GROUND,
    Chord,
    altitude_at,
    before_leg,
    next_stretch,
    refractivity_on_ray,
    relative_index,
)
from twilight.solvers.montecarlo.sunlight import ChordPoint, sunlight
from twilight.transport.beam import beam_at_one

LINE_OF_SIGHT_PIECES = 8192
"""Most pieces of a line of sight."""
LINE_OF_SIGHT_CHORDS = 8192
"""Most chords of a line of sight."""
RISE_PER_LENGTH = 0.15
"""Largest change of altitude along a piece over the largest length of a piece."""
STEEP_RATIO = 1.5
"""A piece over which the scattered sunlight changes by more than this factor is cut into STEEP_PARTS."""
STEEP_PARTS = 6
"""Parts of such a piece."""
EDGE_PARTS = 40
"""Parts of a piece that the edge of the shadow crosses."""
BISECTIONS = 40
"""Halvings by which the edge of the shadow is found in a part."""
_NODE, _WEIGHT = np.polynomial.legendre.leggauss(3)
GAUSS_NODE, GAUSS_WEIGHT = 0.5 * (_NODE + 1.0), 0.5 * _WEIGHT


class SunlitChord(NamedTuple):
    """A chord and the sun: chord, its scalars; row (9,), the same chord in `Leg.chords`; to_sun (3,)."""

    chord: Chord
    row: np.ndarray
    to_sun: np.ndarray


class PieceSums(NamedTuple):
    """Integrals over one piece.

    light_i, light_q, light_u: I, Q, U of sunlight scattered towards the observer [sr^-1]; rescattered, scattered: the
    piece's part of the columns RESCATTERED and SCATTERED; darkest, brightest: the least and the most sunlight scattered
    at a node [sr^-1 km^-1].
    """

    light_i: float
    light_q: float
    light_u: float
    rescattered: float
    scattered: float
    darkest: float
    brightest: float


@njit(inner=True, **INNER)
def local_sun(line, earth_radius, s):
    """(altitude [km], cosine of the true sun's zenith angle) at the distance s [km] of a chord.

    line: `SunlitChord`; earth_radius [km].
    """
    z = altitude_at(line.chord.altitude, line.chord.radius, line.chord.mu, s)
    along = 0.0
    for m in range(3):
        along += (line.row[ORIGIN + m] + s * line.row[DIRECTION + m]) * line.to_sun[m]
    return z, min(1.0, max(-1.0, along / (earth_radius + z)))


@njit(inner=True, **INNER)
def is_lit(air, beam, w, line, s):
    """Whether any sunlight reaches the point at the distance s [km] of a chord; line: `SunlitChord`."""
    z, mu_sun = local_sun(line, air.earth_radius_km, s)
    irradiance, _ = beam_at_one(beam, z, mu_sun, w)
    return irradiance > 0.0


@njit(inner=True, **INNER)
def lit_part(air, beam, w, line, a, b):
    """(a, b) [km]: the lit side of a part of a chord that the shadow's edge crosses; all of it if both ends agree.

    line: `SunlitChord`.
    """
    at_a = is_lit(air, beam, w, line, a)
    if at_a == is_lit(air, beam, w, line, b):
        return a, b
    low, high = a, b
    for _ in range(BISECTIONS):
        middle = 0.5 * (low + high)
        if is_lit(air, beam, w, line, middle) == at_a:
            low = middle
        else:
            high = middle
    return (a, low) if at_a else (high, b)


@njit(inner=True, **INNER)
def gauss_node(air, w, options, line, piece, at_observer, a, b, k):
    """(s, z, mu_sun, i, f, weight) of a node, number `k`, of the Gauss quadrature over the part a..b [km] of a piece.

    s [km]: the distance on the chord; z, mu_sun, (i, f): as usual; weight [km]: of what is scattered there, the length
    that the node stands for x transmittance x (n_observer / n)^2.  line, at_observer: as in `quadrature`.
    """
    s = a + (b - a) * GAUSS_NODE[k]
    z, mu_sun = local_sun(line, air.earth_radius_km, s)
    i, f = locate(air, z, int(piece[FIRST]), int(piece[LAST]))
    t = (s - piece[START]) / piece[LENGTH]
    within = depth_within(piece[LOWER], piece[MIDDLE], piece[UPPER], piece[LENGTH], t)
    weight = GAUSS_WEIGHT[k] * (b - a) * math.exp(-piece[DEPTH] - within)
    if options.bent:
        weight *= relative_index(air.refractivity[w], i, f, at_observer)
    return s, z, mu_sun, i, f, weight


@njit(inner=True, **INNER)
def finer_parts(sums, lit_begin, lit_end):
    """(number of parts that a piece is cut into, whether the shadow's edge is looked for in them).

    sums: `PieceSums` of the whole piece; lit_begin, lit_end: whether sunlight reaches its two ends.
    """
    if lit_begin != lit_end or (sums.darkest == 0.0 and sums.brightest > 0.0):
        return EDGE_PARTS, True
    return (STEEP_PARTS if sums.brightest > STEEP_RATIO * sums.darkest else 1), False


@njit(**INNER)
def quadrature(air, sun, importance, w, options, line, piece, at_observer, cut):
    """`PieceSums` of one piece (a row of `pieces`, filled up to CHORD).

    line: `SunlitChord` that the piece lies on; at_observer: n - 1 where the line begins; cut: number of parts that the
    piece is cut into, and whether the edge of the shadow is looked for in every part, as of `finer_parts`.
    """
    parts, edge = cut
    bottom = air.shell_km[0]
    per_depth = 1.0 / (air.shell_km[air.shell_km.size - 1] - bottom)
    chord, row, to_sun = line.chord, line.row, line.to_sun
    slope = row[DIRECTION] * to_sun[0] + row[DIRECTION + 1] * to_sun[1] + row[DIRECTION + 2] * to_sun[2]
    light_i, light_q, light_u, rescattered, scattered = 0.0, 0.0, 0.0, 0.0, 0.0
    darkest, brightest = math.inf, 0.0
    for part in range(parts):
        begin = piece[START] + piece[LENGTH] * part / parts
        end = piece[START] + piece[LENGTH] * (part + 1) / parts
        lit_begin, lit_end = begin, end
        if edge:
            lit_begin, lit_end = lit_part(air, sun.beam, w, line, begin, end)
        split = lit_begin > begin or lit_end < end
        # the dark side carries no sunlight, but events: it has nodes of its own
        for side in range(2 if split else 1):
            a, b = lit_begin, lit_end
            if side == 1:
                a, b = (begin, lit_begin) if lit_begin > begin else (lit_end, end)
            for k in range(3):
                s, z, mu_sun, i, f, weight = gauss_node(air, w, options, line, piece, at_observer, a, b, k)
                scattering = column(air.table[w], i, f, SCATTERING)
                if side == 0:
                    point = ChordPoint(s, z, mu_sun, i, f)
                    source_i, source_q, source_u = sunlight(air, sun, w, point, row, to_sun, options.polarised)
                    darkest = min(darkest, source_i)
                    brightest = max(brightest, source_i)
                    light_i += weight * source_i
                    light_q += weight * source_q
                    light_u += weight * source_u
                root = math.sqrt(max(0.0, (z - bottom) * per_depth))
                up = (s + chord.radius * chord.mu) / (air.earth_radius_km + z)
                light = log_source_light(
                    importance.log_source[w],
                    importance.place_of_root,
                    importance.cos_sun,
                    importance.hint,
                    root,
                    mu_sun,
                    up,
                    slope,
                )
                scattered += weight * scattering
                rescattered += weight * scattering * math.exp(light)
    return PieceSums(light_i, light_q, light_u, rescattered, scattered, darkest, brightest)


@njit(**INNER)
def integrate_line_of_sight(air, sun, importance, w, options, ray, to_sun, far_km, leg):
    """Follow the line of sight of a ray (9,): start [km], apparent direction, reference; the ray is used up.

    to_sun (3,): unit vector to the true sun; options: `LegOptions`; far_km [km]: distance from the start at which the
    line ends at the latest, also without the light of the ground; infinite: with it; leg: `Leg`, filled.
    Returns `LegTotals`.
    """
    scale = air.earth_radius_km / REFERENCE_RADIUS_KM
    table = air.table[w]
    light_i, light_q, light_u = 0.0, 0.0, 0.0
    n = np.int64(0)
    depth = 0.0
    rescattered = 0.0
    scattered = 0.0
    x, y, z = ray[ORIGIN], ray[ORIGIN + 1], ray[ORIGIN + 2]
    at_observer = refractivity_on_ray(air, w, ray) if options.bent else 0.0
    if not enter_air(air, ray):
        return without_ground(0, -1, 0.0, 0.0, 0.0, 1.0)
    far_km -= math.sqrt((ray[ORIGIN] - x) ** 2 + (ray[ORIGIN + 1] - y) ** 2 + (ray[ORIGIN + 2] - z) ** 2)
    if far_km <= 0.0:
        return without_ground(0, -1, 0.0, 0.0, 0.0, 1.0)
    stretch = before_leg()
    while stretch.then == ON:
        stretch = next_stretch(air, w, options.bent, options.sag_km, False, stretch, ray, leg.chords)
        if stretch.then == NO_ROOM:
            return no_room(light_i, light_q, light_u)
        chord, s = stretch.chord, stretch.start
        line = SunlitChord(chord, leg.chords[stretch.number], to_sun)
        left = far_km - stretch.travelled - s
        whole = min(stretch.end - s, left)
        if whole > 0.0:
            i, f = locate(air, stretch.enter_km, stretch.first, stretch.last)
            after = column(table, i, f, EXTINCTION)
            dense = whole * max(after, table[stretch.first, EXTINCTION], table[stretch.last, EXTINCTION])
            wanted = max(
                whole / (options.max_length_km * scale),
                dense / options.max_depth,
                abs(stretch.leave_km - stretch.enter_km) / (RISE_PER_LENGTH * options.max_length_km * scale),
            )
            parts = int(max(1.0, min(math.ceil(wanted), MOST_PARTS)))
            length = whole / parts
            lit = is_lit(air, sun.beam, w, line, s)
            for part in range(parts):
                if n >= leg.pieces.shape[0]:
                    return no_room(light_i, light_q, light_u)
                piece = leg.pieces[n]
                start = s + part * length
                z = altitude_at(chord.altitude, chord.radius, chord.mu, start + 0.5 * length)
                i, f = locate(air, z, stretch.first, stretch.last)
                piece[LOWER] = after
                piece[MIDDLE] = column(table, i, f, EXTINCTION)
                z = altitude_at(chord.altitude, chord.radius, chord.mu, start + length)
                i, f = locate(air, z, stretch.first, stretch.last)
                after = column(table, i, f, EXTINCTION)
                piece[UPPER] = after
                piece[START] = start
                piece[LENGTH] = length
                piece[DEPTH] = depth
                piece[BASE] = IN_SHELL
                piece[FIRST] = stretch.first
                piece[LAST] = stretch.last
                piece[CHORD] = stretch.number
                whole_piece = (np.int64(1), np.bool_(False))
                sums = quadrature(air, sun, importance, w, options, line, piece, at_observer, whole_piece)
                lit_before = lit
                lit = is_lit(air, sun.beam, w, line, start + length)
                finer, edge = finer_parts(sums, lit_before, lit)
                if finer > 1:
                    sums = quadrature(air, sun, importance, w, options, line, piece, at_observer, (finer, edge))
                light_i += sums.light_i
                light_q += sums.light_q
                light_u += sums.light_u
                rescattered += sums.rescattered
                scattered += sums.scattered
                piece[RESCATTERED] = rescattered
                piece[SCATTERED] = scattered
                depth += length * (piece[LOWER] + 4.0 * piece[MIDDLE] + piece[UPPER]) / 6.0
                n += 1
                if depth > OPAQUE_DEPTH:
                    return without_ground(n, stretch.number, light_i, light_q, light_u, 0.0)
        if whole >= left:
            return without_ground(n, stretch.number, light_i, light_q, light_u, math.exp(-depth))
    if stretch.then != TO_GROUND or far_km < math.inf:
        return without_ground(n, stretch.number, light_i, light_q, light_u, math.exp(-depth))
    transmittance = math.exp(-depth)
    if options.bent:
        transmittance *= relative_index(air.refractivity[w], 0, 0.0, at_observer)
    totals = without_ground(n, stretch.number, light_i, light_q, light_u, transmittance)
    return meet_ground(air, sun, importance, w, leg, stretch, to_sun, totals)
