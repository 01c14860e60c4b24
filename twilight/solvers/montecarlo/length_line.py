"""Sunlight scattered once along a line of sight, with the length of its way in every layer: by quadrature.

The nodes are those of :mod:`twilight.solvers.montecarlo.line_of_sight`.

Arguments that kernels share: `kernel`.  Here also edges (J + 1,): altitudes [km] that bound J layers, ascending;
lengths (J,): added to; factor: that lengths count with; profile: `transport.ray_profile.RayProfile`.
"""

from __future__ import annotations

import math

import numpy as np

from twilight.jit.kernels import njit
from twilight.solvers.montecarlo.air import locate
from twilight.solvers.montecarlo.kernel import INNER
from twilight.solvers.montecarlo.line_of_sight import (
    EDGE_PARTS,
    GAUSS_NODE,
    GAUSS_WEIGHT,
    STEEP_PARTS,
    STEEP_RATIO,
    SunlitChord,
    is_lit,
    lit_part,
    local_sun,
    quadrature,
)
from twilight.solvers.montecarlo.path_lengths import add_chord, add_leg, add_sunbeam
from twilight.solvers.montecarlo.pieces import (
    CHORD,
    DEPTH,
    FIRST,
    LAST,
    LENGTH,
    LOWER,
    MIDDLE,
    START,
    UPPER,
    depth_within,
)
from twilight.solvers.montecarlo.rays import DIRECTION, ORIGIN, Chord, radius_and_cosine, relative_index
from twilight.solvers.montecarlo.sunlight import ground_sunlight, sunlight


@njit(**INNER)
def chord_of(air, row):
    """The `Chord` of a row (9,) of `Leg.chords`, as far as its points need it.

    row: of the chord.
    """
    r, mu = radius_and_cosine(row)
    return Chord(max(r - air.earth_radius_km, air.level_km[0]), r, mu, 0.0, 0.0)


@njit(inner=True, **INNER)
def parts_of(air, sun, importance, w, options, line, piece, at_observer):
    """(number of parts that a piece is cut into, whether the shadow's edge is looked for in them).

    line: `SunlitChord` that the piece lies on; at_observer: n - 1 where the line of sight begins.
    """
    first = quadrature(air, sun, importance, w, options, line, piece, at_observer, np.int64(1), np.bool_(False))
    begins = is_lit(air, sun.beam, w, line, piece[START])
    ends = is_lit(air, sun.beam, w, line, piece[START] + piece[LENGTH])
    if begins != ends or (first.darkest == 0.0 and first.brightest > 0.0):
        return EDGE_PARTS, True
    return (STEEP_PARTS if first.brightest > STEEP_RATIO * first.darkest else 1), False


@njit(cache=True)
def scattered_once_lengths(
    air, profile, sun, importance, w, options, to_sun, at_observer, line_of_sight, leg, edges, lengths
):
    """Light [sr^-1] scattered once or reflected once, I, along a line of sight; lengths (J,) [km sr^-1] += it x way.

    options: by which the line was cut; at_observer: n - 1 there; line_of_sight: its `LegTotals`; leg: its `Leg`.
    """
    total = 0.0
    before, way = np.zeros(lengths.size), np.empty(lengths.size)
    number = -1
    for n in range(line_of_sight.n_pieces):
        piece = leg.pieces[n]
        if int(piece[CHORD]) != number:
            number = int(piece[CHORD])
            before[:] = 0.0
            add_leg(edges, air.earth_radius_km, leg.chords, number, 0.0, 1.0, before)
        row = leg.chords[number]
        line = SunlitChord(chord_of(air, row), row, to_sun)
        parts, edge = parts_of(air, sun, importance, w, options, line, piece, at_observer)
        for part in range(parts):
            a = piece[START] + piece[LENGTH] * part / parts
            b = piece[START] + piece[LENGTH] * (part + 1) / parts
            if edge:
                a, b = lit_part(air, sun.beam, w, line, a, b)
            for node in range(3):
                s = a + (b - a) * GAUSS_NODE[node]
                z, mu_sun = local_sun(line, air.earth_radius_km, s)
                i, f = locate(air, z, int(piece[FIRST]), int(piece[LAST]))
                t = (s - piece[START]) / piece[LENGTH]
                within = depth_within(piece[LOWER], piece[MIDDLE], piece[UPPER], piece[LENGTH], t)
                light = GAUSS_WEIGHT[node] * (b - a) * math.exp(-piece[DEPTH] - within)
                if options.bent:
                    light *= relative_index(air.refractivity[w], i, f, at_observer)
                light *= sunlight(air, sun, w, z, mu_sun, row, s, to_sun, i, f, np.bool_(False))[0]
                if light <= 0.0:
                    continue
                total += light
                way[:] = before
                add_chord(edges, air.earth_radius_km, row, 0.0, s, 1.0, way)
                add_sunbeam(profile, sun.beam, w, z, mu_sun, edges, 1.0, way)
                for j in range(lengths.size):
                    lengths[j] += light * way[j]
    if line_of_sight.sun_ground > 0.0:
        total += line_of_sight.sun_ground
        add_grounded(air, profile, sun, w, to_sun, leg, line_of_sight, edges, line_of_sight.sun_ground, lengths)
    return total


@njit(inner=True, **INNER)
def sun_above_ground(air, leg, totals, to_sun):
    """Cosine of the true sun's zenith angle where a leg meets the ground; leg: `Leg`, totals: its `LegTotals`."""
    row = leg.chords[totals.last_chord]
    up = 0.0
    for m in range(3):
        up += (row[ORIGIN + m] + totals.ground_km * row[DIRECTION + m]) * to_sun[m]
    return min(1.0, max(-1.0, up / (air.earth_radius_km + air.shell_km[0])))


@njit(inner=True, cache=True)
def add_grounded(air, profile, sun, w, to_sun, leg, totals, edges, factor, lengths):
    """Add factor x the way of sunlight that the ground reflects into a leg; totals: its `LegTotals`."""
    add_leg(edges, air.earth_radius_km, leg.chords, totals.last_chord, totals.ground_km, factor, lengths)
    mu_sun = sun_above_ground(air, leg, totals, to_sun)
    add_sunbeam(profile, sun.beam, w, air.shell_km[0], mu_sun, edges, factor, lengths)


@njit(inner=True, **INNER)
def reflected_sunlight(air, sun, w, to_sun, leg, totals, polarised):
    """(I, Q, U) [sr^-1] of sunlight that the ground reflects into a leg; totals: its `LegTotals`."""
    row = leg.chords[totals.last_chord]
    x = row[ORIGIN] + totals.ground_km * row[DIRECTION]
    y = row[ORIGIN + 1] + totals.ground_km * row[DIRECTION + 1]
    z = row[ORIGIN + 2] + totals.ground_km * row[DIRECTION + 2]
    mu_sun = sun_above_ground(air, leg, totals, to_sun)
    i, q, u = ground_sunlight(air, sun, w, x, y, z, mu_sun, row, to_sun, polarised)
    return totals.transmittance * i, totals.transmittance * q, totals.transmittance * u
