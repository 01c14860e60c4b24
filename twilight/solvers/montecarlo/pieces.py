"""What a leg of a path is made of: pieces with their optical depth, chords, phases, and what is found along it.

`leg.trace` and `sight.look` fill a `Leg`; `events` draws from its pieces.

Arguments that kernels share: `kernel`.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from twilight.kernels import njit
from twilight.solvers.montecarlo.air import EXTINCTION, column, depth_from_ground, place_in, weighted_depth
from twilight.solvers.montecarlo.kernel import INNER
from twilight.solvers.montecarlo.lines import CHORD_COLUMNS

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
MOST_PARTS = 100000.0


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

    air, w, piece: as everywhere; t: of the length, 0 to 1.
    """
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
def growth(at, by_layer, z, first, last, c0, c1, c2):
    """What tells how optical depth grows up to an altitude z [km] between two levels of `at`.

    first, last: the levels; by_layer: optical depth from the ground along a line of the secant c0 + c1 h + c2 h^2, (c0,
    c1, c2) [1, km^-1, km^-2]; else the extinction [km^-1].
    """
    i, f = place_in(at, z, first, last)
    if by_layer:
        return depth_from_ground(at, i, f, c0, c1, c2)
    return column(at.table, i, f, EXTINCTION)


@njit(inline="always", **INNER)
def without_ground(n, chord, light_i, light_q, light_u, transmittance):
    """`Found` for a leg that ends in the air or in space.

    n: number of its pieces; chord: number of the chord it ends on; light_i, light_q, light_u [sr^-1]: sunlight
    scattered on the way; transmittance: of the whole leg.
    """
    return Found(n, chord, light_i, light_q, light_u, 0.0, -1.0, transmittance, 0.0)


@njit(inline="always", **INNER)
def no_room(light_i, light_q, light_u):
    """`Found` for a leg that needs more pieces or chords than there is memory for; light_i, light_q, light_u [sr^-1]:
    so far.
    """
    return Found(-1, -1, light_i, light_q, light_u, 0.0, -1.0, 0.0, 0.0)


@njit(inline="always", **INNER)
def keep_chord(ray, chords, n):
    """Keep a ray (9,) as a row of the chords (K, 9) of a `Leg`; returns the row.

    n: its number.
    """
    row = chords[n]
    for m in range(CHORD_COLUMNS):
        row[m] = ray[m]
    return row


@njit(inner=True, **INNER)
def steered_light(leg, found):
    """The coarse field's estimate of the light that is scattered again along a leg [sr^-1]."""
    if found.pieces > 0:
        return found.steered_ground + leg.pieces[found.pieces - 1, STEERED]
    return found.steered_ground
