"""What a leg of a path is made of: pieces with their optical depth, chords, phase functions, and its totals.

`leg.trace` and `line_of_sight.integrate_line_of_sight` fill a `Leg`; `events` draws points from its pieces.

Arguments that kernels share: `kernel`.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from twilight.jit.kernels import njit
from twilight.solvers.montecarlo.air import EXTINCTION, air_at, column, depth_from_ground, place_in
from twilight.solvers.montecarlo.kernel import INNER
from twilight.solvers.montecarlo.rays import CHORD_COLUMNS

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
