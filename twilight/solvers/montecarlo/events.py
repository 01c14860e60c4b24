"""Where a path goes on: the point of the next event on a leg, and the matrix of the path after it.

An event is a row of numbers, whose columns are named here; rows wait on a stack.  Arguments that kernels share:
`kernel`.
"""

from __future__ import annotations

import math

from twilight.kernels import njit
from twilight.solvers.montecarlo.air import EVENT, SPECIES, interpolate, locate
from twilight.solvers.montecarlo.ground import ground_matrix
from twilight.solvers.montecarlo.kernel import INNER
from twilight.solvers.montecarlo.lines import CHORD_COLUMNS, DIRECTION, ORIGIN, REFERENCE
from twilight.solvers.montecarlo.matrix import (
    components,
    depolarise,
    double_angle,
    next_reference,
    scatter,
    species_matrix,
)
from twilight.solvers.montecarlo.pieces import DEPTH, FIRST, LAST, LENGTH, PLAIN, START, STEERED, depth_inside
from twilight.solvers.montecarlo.random import uniform

# columns of an event: point [km], direction and reference of the leg that it lies on, matrix of the path up to it (see
# `matrix.scatter`), weight, order of the light that the next leg gathers, altitude [km], its level and the fraction
# above it, 1 on the ground, three numbers in [0, 1) that decide the direction of the next leg
POINT, HEADING, ACROSS, MATRIX = 0, 3, 6, 9
WEIGHT, ORDER, ALTITUDE, LEVEL, FRACTION, ON_GROUND, NUMBERS = range(18, 25)
EVENT_COLUMNS = NUMBERS + 3


@njit(inner=True, **INNER)
def draw_piece(pieces, column, n, x):
    """First of the n pieces (M, PIECE_COLUMNS) whose running sum in a `column` exceeds x.

    pieces: of a leg, n: how many it has; column: STEERED or PLAIN; x [sr^-1]: below the sum of the last piece.
    """
    lo = 0
    hi = n - 1
    while lo < hi:
        mid = (lo + hi) // 2
        if pieces[mid, column] > x:
            hi = mid
        else:
            lo = mid + 1
    return lo


@njit(inner=True, **INNER)
def choose_point(pieces, n, ground_plain, ground_steered, steered_fraction, number, stream):
    """Draw one of the first n pieces of a leg, or its ground, from a mixture of steered and plain weights.

    pieces (M, PIECE_COLUMNS); n: how many of them the leg has; ground_plain, ground_steered: the ground's two weights;
    steered_fraction: share of the draws by steered weights; number: in [0, 1), decides the piece; stream (1,): random
    numbers.

    Returns (index of the piece, or n for the ground; its probability; uniform number within the piece).
    """
    all_plain = ground_plain
    all_steered = ground_steered
    if n > 0:
        all_plain += pieces[n - 1, PLAIN]
        all_steered += pieces[n - 1, STEERED]
    if all_plain <= 0.0:
        return n, 0.0, 0.0
    steer = steered_fraction if all_steered > 0.0 else 0.0
    if number < steer:
        column = STEERED
        x = number / steer * all_steered
    else:
        column = PLAIN
        x = (number - steer) / (1.0 - steer) * all_plain
    k = n
    if n > 0 and x < pieces[n - 1, column]:
        k = draw_piece(pieces, column, n, x)
        plain = pieces[k, PLAIN]
        steered = pieces[k, STEERED]
        if k > 0:
            plain -= pieces[k - 1, PLAIN]
            steered -= pieces[k - 1, STEERED]
    else:
        plain = ground_plain
        steered = ground_steered
    probability = (1.0 - steer) * plain / all_plain
    if steer > 0.0:
        probability += steer * steered / all_steered
    return k, probability, uniform(stream)


@njit(inner=True, **INNER)
def event_weight(air, w, piece, t, i, f):
    """Transmittance x scattering x length of a piece (its row), at its fraction t: the weight but for the probability.

    (i, f): the place of the point among the levels.
    """
    within = depth_inside(air, w, piece, t, i, f)
    return piece[LENGTH] * math.exp(-piece[DEPTH] - within) * interpolate(air, w, i, f, EVENT)


@njit(inner=True, **INNER)
def event_distance(piece, t):
    """Distance [km] from the start of the chord to a point of a piece (its row).

    t: fraction of the piece's length, 0 to 1.
    """
    return piece[START] + t * piece[LENGTH]


@njit(inner=True, **INNER)
def event_level(air, piece, z):
    """`locate` an altitude z [km] within the shell or layer of a piece (its row)."""
    return locate(air, z, int(piece[FIRST]), int(piece[LAST]))


@njit(inner=True, **INNER)
def mixed_matrix(air, w, i, f, cosine):
    """(P12, P22, P33) over P11 at the place (i, f) of the levels.

    cosine: of the scattering angle.
    """
    if air.isotropic_events:
        return 0.0, 0.0, 0.0
    total = 0.0
    m12 = 0.0
    m22 = 0.0
    m33 = 0.0
    for c in range(air.table.shape[2] - SPECIES):
        beta = interpolate(air, w, i, f, SPECIES + c)
        if beta > 0.0:
            p11, p12, p22, p33 = species_matrix(air, w, c, cosine)
            total += beta * p11
            m12 += beta * p12
            m22 += beta * p22
            m33 += beta * p33
    return m12 / total, m22 / total, m33 / total


@njit(inner=True, **INNER)
def begin_leg(air, w, event, polarised, work):
    """Complete work.new, whose direction is drawn, and work.matrix; returns the factor on the weight of the path.

    event (EVENT_COLUMNS,): where the leg begins; work: `directions.Work`, with its frame filled.
    """
    new = work.new
    for m in range(3):
        new[ORIGIN + m] = event[POINT + m]
    d = event[HEADING:ACROSS]
    e = event[ACROSS:MATRIX]
    direction = new[DIRECTION:REFERENCE]
    next_reference(d, e, direction, new[REFERENCE:CHORD_COLUMNS])
    on_ground = event[ON_GROUND] > 0.0
    if not polarised or (on_ground and air.water_slope <= 0.0):
        depolarise(work.matrix, event[MATRIX:WEIGHT])
        return 1.0
    cosine = min(1.0, max(-1.0, d[0] * direction[0] + d[1] * direction[1] + d[2] * direction[2]))
    if on_ground:
        up = work.frame[2]
        mu_in = up[0] * direction[0] + up[1] * direction[1] + up[2] * direction[2]
        mu_out = -(up[0] * d[0] + up[1] * d[1] + up[2] * d[2])
        p11, m12, m22, m33 = ground_matrix(air, w, mu_in, mu_out, cosine)
        if p11 <= 0.0:
            return 0.0
        m12, m22, m33 = m12 / p11, m22 / p11, m33 / p11
    else:
        m12, m22, m33 = mixed_matrix(air, w, int(event[LEVEL]), event[FRACTION], cosine)
    a, b = components(e, d, direction[0], direction[1], direction[2])
    cos_2phi, sin_2phi = double_angle(a, b)
    return scatter(event[MATRIX:WEIGHT], cos_2phi, sin_2phi, m12, m22, m33, work.matrix)
