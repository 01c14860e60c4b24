"""Sunlight scattered once along a line of sight, with the length of its path in every layer: by quadrature.

The nodes are those of :mod:`twilight.solvers.montecarlo.line_of_sight`.

Arguments that kernels share: `kernel`.  Here also layers: `path_lengths.BoxLayers`, J of them; lengths (J,): added to;
factor: that lengths count with.
"""

from __future__ import annotations

import numpy as np

from twilight.jit.kernels import njit
from twilight.solvers.montecarlo.kernel import INNER
from twilight.solvers.montecarlo.leg import ground_point
from twilight.solvers.montecarlo.line_of_sight import (
    SunlitChord,
    finer_parts,
    gauss_node,
    is_lit,
    lit_part,
    quadrature,
)
from twilight.solvers.montecarlo.path_lengths import add_chord, add_leg, add_sunbeam
from twilight.solvers.montecarlo.pieces import CHORD, LENGTH, START
from twilight.solvers.montecarlo.rays import Chord, radius_and_cosine
from twilight.solvers.montecarlo.sunlight import ground_sunlight, sunlight


@njit(**INNER)
def chord_of(air, row):
    """The `Chord` of a row (9,) of `Leg.chords`, as far as its points need it; row: of the chord."""
    r, mu = radius_and_cosine(row)
    return Chord(max(r - air.earth_radius_km, air.level_km[0]), r, mu, 0.0, 0.0)


@njit(cache=True)
def scattered_once_lengths(air, layers, sun, importance, w, options, to_sun, at_observer, line_of_sight, leg, lengths):
    """Light [sr^-1] scattered once or reflected once, I, along a line of sight; lengths (J,) [km sr^-1] += light x path
    length.

    options: by which the line was cut; at_observer: n - 1 there; line_of_sight: its `LegTotals`; leg: its `Leg`.
    """
    edges = layers.edges_km
    total = 0.0
    before, path = np.zeros(lengths.size), np.empty(lengths.size)
    number = -1
    for n in range(line_of_sight.n_pieces):
        piece = leg.pieces[n]
        if int(piece[CHORD]) != number:
            number = int(piece[CHORD])
            before[:] = 0.0
            add_leg(edges, air.earth_radius_km, leg.chords, number, 0.0, 1.0, before)
        row = leg.chords[number]
        line = SunlitChord(chord_of(air, row), row, to_sun)
        whole = quadrature(air, sun, importance, w, options, line, piece, at_observer, np.int64(1), np.bool_(False))
        lit_begin = is_lit(air, sun.beam, w, line, piece[START])
        lit_end = is_lit(air, sun.beam, w, line, piece[START] + piece[LENGTH])
        parts, edge = finer_parts(whole, lit_begin, lit_end)
        for part in range(parts):
            a = piece[START] + piece[LENGTH] * part / parts
            b = piece[START] + piece[LENGTH] * (part + 1) / parts
            if edge:
                a, b = lit_part(air, sun.beam, w, line, a, b)
            for k in range(3):
                s, z, mu_sun, i, f, light = gauss_node(air, w, options, line, piece, at_observer, a, b, k)
                light *= sunlight(air, sun, w, z, mu_sun, row, s, to_sun, i, f, np.bool_(False))[0]
                if light <= 0.0:
                    continue
                total += light
                path[:] = before
                add_chord(edges, air.earth_radius_km, row, 0.0, s, 1.0, path)
                add_sunbeam(layers, sun.beam, w, z, mu_sun, 1.0, path)
                for j in range(lengths.size):
                    lengths[j] += light * path[j]
    if line_of_sight.sun_ground > 0.0:
        total += line_of_sight.sun_ground
        add_reflected(air, layers, sun, w, to_sun, leg, line_of_sight, line_of_sight.sun_ground, lengths)
    return total


@njit(inner=True, cache=True)
def add_reflected(air, layers, sun, w, to_sun, leg, totals, factor, lengths):
    """Add factor x the path length of sunlight that the ground reflects into a leg; totals: its `LegTotals`."""
    row = leg.chords[totals.last_chord]
    add_leg(layers.edges_km, air.earth_radius_km, leg.chords, totals.last_chord, totals.ground_km, factor, lengths)
    _, _, _, mu_sun = ground_point(air, row, totals.ground_km, to_sun)
    add_sunbeam(layers, sun.beam, w, air.shell_km[0], mu_sun, factor, lengths)


@njit(inner=True, **INNER)
def reflected_sunlight(air, sun, w, to_sun, leg, totals, polarised):
    """(I, Q, U) [sr^-1] of sunlight that the ground reflects into a leg; totals: its `LegTotals`."""
    row = leg.chords[totals.last_chord]
    x, y, z, mu_sun = ground_point(air, row, totals.ground_km, to_sun)
    i, q, u = ground_sunlight(air, sun, w, x, y, z, mu_sun, row, to_sun, polarised)
    return totals.transmittance * i, totals.transmittance * q, totals.transmittance * u
