"""The first leg, the same for all samples of a pixel: its single scattering by quadrature, its pieces for later draws.

The integral is that of :mod:`twilight.solvers.montecarlo.leg`.  Each piece has three Gauss nodes; where sunlight
changes steeply along it, it is cut.  Where the edge of the shadow crosses a part, the edge is found by bisection and
the nodes lie on the lit side, so that no node can stand now on one side of the edge and now on the other.  Arguments
that kernels share: `kernel`.

`look` goes from chord to chord and from step to step as `leg.trace` does.  The loop stands in both: what is done in a
step differs, and numba keeps no machine code on disk of a kernel that is handed a function.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from twilight.kernels import njit
from twilight.solvers.montecarlo.air import EVENT, EXTINCTION, column, locate
from twilight.solvers.montecarlo.kernel import INNER
from twilight.solvers.montecarlo.leg import enter_air, land
from twilight.solvers.montecarlo.lines import (
    DIRECTION,
    LONGEST_KM,
    ORIGIN,
    REFERENCE_RADIUS_KM,
    altitude_at,
    begin_chord,
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
    depth_within,
    keep_chord,
    no_room,
    without_ground,
)
from twilight.solvers.montecarlo.steering import log_source_light
from twilight.solvers.montecarlo.sunlight import sunlight
from twilight.transport.beam import beam_at_one

SIGHT_PIECES, SIGHT_CHORDS = 8192, 8192
RISE = 0.15
CUTS, EDGE_CUTS = 6, 40
STEEP = 1.5
"""A piece over which the scattered sunlight changes by more than this factor is cut into CUTS parts, and one that the
edge of the shadow crosses into EDGE_CUTS."""
BISECTIONS = 40
_NODE, _WEIGHT = np.polynomial.legendre.leggauss(3)
GAUSS_NODE, GAUSS_WEIGHT = 0.5 * (_NODE + 1.0), 0.5 * _WEIGHT


class Gathered(NamedTuple):
    """Integrals over one piece.

    light_i, light_q, light_u: I, Q, U of sunlight scattered towards the observer [sr^-1]; steered, plain: weights of
    the next event there, with the coarse field's light and without; darkest, brightest: the least and the most sunlight
    scattered at a node [sr^-1 km^-1].
    """

    light_i: float
    light_q: float
    light_u: float
    steered: float
    plain: float
    darkest: float
    brightest: float


@njit(inner=True, **INNER)
def local_sun(chord, row, to_sun, earth_radius, s):
    """(altitude [km], cosine of the true sun's zenith angle) at the distance s [km] of a chord.

    chord: `Chord`; row (9,): the same as it is kept; earth_radius [km].
    """
    z = altitude_at(chord.altitude, chord.radius, chord.mu, s)
    along = 0.0
    for m in range(3):
        along += (row[ORIGIN + m] + s * row[DIRECTION + m]) * to_sun[m]
    return z, min(1.0, max(-1.0, along / (earth_radius + z)))


@njit(inner=True, **INNER)
def is_lit(air, beam, w, chord, row, to_sun, s):
    """Whether any sunlight reaches the point at the distance s [km] of a chord.

    chord: `Chord`; row (9,): the same as it is kept.
    """
    z, mu_sun = local_sun(chord, row, to_sun, air.earth_radius_km, s)
    irradiance, _ = beam_at_one(beam, z, mu_sun, w)
    return irradiance > 0.0


@njit(inner=True, **INNER)
def lit_part(air, beam, w, chord, row, to_sun, a, b):
    """(a, b) [km]: the lit side of a part of a chord that the shadow's edge crosses; all of it if both ends agree.

    chord: `Chord`; row (9,): the same as it is kept.
    """
    at_a = is_lit(air, beam, w, chord, row, to_sun, a)
    if at_a == is_lit(air, beam, w, chord, row, to_sun, b):
        return a, b
    low, high = a, b
    for _ in range(BISECTIONS):
        middle = 0.5 * (low + high)
        if is_lit(air, beam, w, chord, row, to_sun, middle) == at_a:
            low = middle
        else:
            high = middle
    return (a, low) if at_a else (high, b)


@njit(**INNER)
def quadrature(air, sun, steering, w, cuts, chord, row, to_sun, piece, at_observer, parts, edge):
    """:class:`Gathered` over one piece (a row of `pieces`, filled up to CHORD).

    chord: `Chord` that the piece lies on; row (9,): the same as it is kept; to_sun (3,): unit vector to the true sun;
    at_observer: n - 1 where the line begins; parts: number that the piece is cut into; edge: look for the edge of the
    shadow in every part.
    """
    bottom = air.shell_km[0]
    per_depth = 1.0 / (air.shell_km[air.shell_km.size - 1] - bottom)
    first, last = int(piece[FIRST]), int(piece[LAST])
    slope = row[DIRECTION] * to_sun[0] + row[DIRECTION + 1] * to_sun[1] + row[DIRECTION + 2] * to_sun[2]
    light_i, light_q, light_u, steered, plain = 0.0, 0.0, 0.0, 0.0, 0.0
    darkest, brightest = math.inf, 0.0
    for part in range(parts):
        begin = piece[START] + piece[LENGTH] * part / parts
        end = piece[START] + piece[LENGTH] * (part + 1) / parts
        lit_begin, lit_end = begin, end
        if edge:
            lit_begin, lit_end = lit_part(air, sun.beam, w, chord, row, to_sun, begin, end)
        split = lit_begin > begin or lit_end < end
        # the dark side carries no sunlight, but events: it has nodes of its own
        for side in range(2 if split else 1):
            a, b = lit_begin, lit_end
            if side == 1:
                a, b = (begin, lit_begin) if lit_begin > begin else (lit_end, end)
            for node in range(3):
                s = a + (b - a) * GAUSS_NODE[node]
                z, mu_sun = local_sun(chord, row, to_sun, air.earth_radius_km, s)
                i, f = locate(air, z, first, last)
                t = (s - piece[START]) / piece[LENGTH]
                within = depth_within(piece[LOWER], piece[MIDDLE], piece[UPPER], piece[LENGTH], t)
                weight = GAUSS_WEIGHT[node] * (b - a) * math.exp(-piece[DEPTH] - within)
                if cuts.bent:
                    weight *= relative_index(air.refractivity[w], i, f, at_observer)
                scattering = column(air.table[w], i, f, EVENT)
                if side == 0:
                    source_i, source_q, source_u = sunlight(
                        air, sun.beam, w, z, mu_sun, row, s, to_sun, i, f, cuts.polarised
                    )
                    darkest = min(darkest, source_i)
                    brightest = max(brightest, source_i)
                    light_i += weight * source_i
                    light_q += weight * source_q
                    light_u += weight * source_u
                root = math.sqrt(max(0.0, (z - bottom) * per_depth))
                up = (s + chord.radius * chord.mu) / (air.earth_radius_km + z)
                light = log_source_light(
                    steering.log_source[w],
                    steering.place_of_root,
                    steering.cos_sun,
                    steering.hint,
                    root,
                    mu_sun,
                    up,
                    slope,
                )
                plain += weight * scattering
                steered += weight * scattering * math.exp(light)
    return Gathered(light_i, light_q, light_u, steered, plain, darkest, brightest)


@njit(**INNER)
def look(air, sun, steering, w, cuts, ray, to_sun, far_km, leg):
    """Follow the line of sight of a ray (9,): start [km], apparent direction, reference; it is used up.

    to_sun (3,): unit vector to the true sun; cuts: :class:`~twilight.solvers.montecarlo.pieces.Cuts`; leg: its memory,
    filled; far_km: distance from the start at which the line ends at the latest, also without the light of the
    ground; infinite: with it.  Returns `Found`.
    """
    scale = air.earth_radius_km / REFERENCE_RADIUS_KM
    table = air.table[w]
    n_shells = air.shell_first.size
    light_i, light_q, light_u = 0.0, 0.0, 0.0
    n = np.int64(0)
    n_chords = np.int64(0)
    depth = 0.0
    steered = 0.0
    plain = 0.0
    travelled = 0.0
    x, y, z = ray[ORIGIN], ray[ORIGIN + 1], ray[ORIGIN + 2]
    at_observer = refractivity_on_ray(air, w, ray) if cuts.bent else 0.0
    if not enter_air(air, ray):
        return without_ground(0, -1, 0.0, 0.0, 0.0, 1.0)
    far_km -= math.sqrt((ray[ORIGIN] - x) ** 2 + (ray[ORIGIN + 1] - y) ** 2 + (ray[ORIGIN + 2] - z) ** 2)
    if far_km <= 0.0:
        return without_ground(0, -1, 0.0, 0.0, 0.0, 1.0)
    while True:
        chord = begin_chord(air, w, cuts.bent, cuts.sag_km, ray)
        if n_chords >= leg.chords.shape[0] or travelled > LONGEST_KM * scale:
            return no_room(light_i, light_q, light_u)
        row = keep_chord(ray, leg.chords, n_chords)
        s = 0.0
        z_enter = chord.altitude
        falling = chord.mu < 0.0
        k = first_shell(air, z_enter, chord.mu)
        while True:
            step = step_through(air, chord, s, z_enter, k, falling, False)
            left = far_km - travelled - s
            stretch = min(step.end - s, left)
            if stretch > 0.0:
                i, f = locate(air, z_enter, step.first, step.last)
                after = column(table, i, f, EXTINCTION)
                dense = stretch * max(after, table[step.first, EXTINCTION], table[step.last, EXTINCTION])
                wanted = max(
                    stretch / (cuts.max_length * scale),
                    dense / cuts.max_depth,
                    abs(step.leave_km - z_enter) / (RISE * cuts.max_length * scale),
                )
                parts = int(max(1.0, min(math.ceil(wanted), MOST_PARTS)))
                length = stretch / parts
                lit = is_lit(air, sun.beam, w, chord, row, to_sun, s)
                for part in range(parts):
                    if n >= leg.pieces.shape[0]:
                        return no_room(light_i, light_q, light_u)
                    piece = leg.pieces[n]
                    start = s + part * length
                    z = altitude_at(chord.altitude, chord.radius, chord.mu, start + 0.5 * length)
                    i, f = locate(air, z, step.first, step.last)
                    piece[LOWER] = after
                    piece[MIDDLE] = column(table, i, f, EXTINCTION)
                    z = altitude_at(chord.altitude, chord.radius, chord.mu, start + length)
                    i, f = locate(air, z, step.first, step.last)
                    after = column(table, i, f, EXTINCTION)
                    piece[UPPER] = after
                    piece[START] = start
                    piece[LENGTH] = length
                    piece[DEPTH] = depth
                    piece[BASE] = IN_SHELL
                    piece[FIRST] = step.first
                    piece[LAST] = step.last
                    piece[CHORD] = n_chords
                    found = quadrature(
                        air, sun, steering, w, cuts, chord, row, to_sun, piece, at_observer,
                        np.int64(1), np.bool_(False),
                    )  # fmt: skip
                    darkest, brightest = found.darkest, found.brightest
                    lit_before = lit
                    lit = is_lit(air, sun.beam, w, chord, row, to_sun, start + length)
                    edge = lit != lit_before or (darkest == 0.0 and brightest > 0.0)
                    if edge or brightest > STEEP * darkest:
                        found = quadrature(
                            air, sun, steering, w, cuts, chord, row, to_sun, piece, at_observer,
                            EDGE_CUTS if edge else CUTS, edge,
                        )  # fmt: skip
                    light_i += found.light_i
                    light_q += found.light_q
                    light_u += found.light_u
                    steered += found.steered
                    plain += found.plain
                    piece[STEERED] = steered
                    piece[PLAIN] = plain
                    depth += length * (piece[LOWER] + 4.0 * piece[MIDDLE] + piece[UPPER]) / 6.0
                    n += 1
                    if depth > OPAQUE_DEPTH:
                        return without_ground(n, n_chords, light_i, light_q, light_u, 0.0)
            if stretch >= left:
                return without_ground(n, n_chords, light_i, light_q, light_u, math.exp(-depth))
            s = step.end
            z_enter = step.leave_km
            if step.ends_chord:
                break
            k = step.next_shell
            falling = step.falling
            if k < 0 and far_km < math.inf:
                return without_ground(n, n_chords, light_i, light_q, light_u, math.exp(-depth))
            if k < 0:
                factor = math.exp(-depth)
                if cuts.bent:
                    factor *= relative_index(air.refractivity[w], 0, 0.0, at_observer)
                light = (light_i, light_q, light_u)
                return land(air, sun, steering, w, row, s, factor, n, n_chords, to_sun, cuts.polarised, light)
            if k >= n_shells:
                return without_ground(n, n_chords, light_i, light_q, light_u, math.exp(-depth))
        n_chords += 1
        travelled += chord.length
        end_chord(chord, ray)
