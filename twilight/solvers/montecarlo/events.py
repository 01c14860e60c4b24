"""Scattering events: the point of the next event on a leg, and the matrix of the path after the event.

An event is a row of numbers with named columns; rows wait on a stack.  Arguments that kernels share: `kernel`.
"""

from __future__ import annotations

import math

from twilight.jit.kernels import njit
from twilight.solvers.montecarlo.air import SCATTERING, SPECIES, interpolate
from twilight.solvers.montecarlo.kernel import INNER
from twilight.solvers.montecarlo.matrix import (
    components,
    depolarise,
    double_angle,
    next_reference,
    scatter,
    species_matrix,
)
from twilight.solvers.montecarlo.pieces import DEPTH, LENGTH, RESCATTERED, SCATTERED, depth_inside
from twilight.solvers.montecarlo.random import draw_from, uniform
from twilight.solvers.montecarlo.rays import CHORD_COLUMNS, DIRECTION, ORIGIN, REFERENCE

# Columns of an event.
# POINT (3) [km]; HEADING (3), ACROSS (3): unit vectors, direction and reference of the leg that the event lies on.
# MATRIX (9): of the path up to the event, see `matrix.scatter`.
# WEIGHT: of the path; ORDER: of scattering of the sunlight that the next leg gathers.
# ALTITUDE [km]; LEVEL, FRACTION: its place among the levels of the air.
# ON_GROUND: 1 on the ground, else 0.
# NUMBERS (3): in [0, 1), decide the direction of the next leg.
POINT, HEADING, ACROSS, MATRIX = 0, 3, 6, 9
WEIGHT, ORDER, ALTITUDE, LEVEL, FRACTION, ON_GROUND, NUMBERS = range(18, 25)
EVENT_COLUMNS = NUMBERS + 3


@njit(inner=True, **INNER)
def choose_point(pieces, n, ground_scattered, ground_rescattered, importance_fraction, number, stream):
    """Draw a piece of a leg, or its ground, by the importance function or by scattering alone.

    The density is importance_fraction x (light scattered again) + the rest x (light scattered once), both over their
    sums along the leg.

    pieces (M, PIECE_COLUMNS); n: how many of them the leg has; ground_scattered, ground_rescattered: the two weights of
    the ground, as in the columns SCATTERED and RESCATTERED; importance_fraction: in [0, 1); number: in [0, 1), decides
    the piece.

    Returns (index of the piece, or n for the ground; its probability; uniform number within the piece).
    """
    all_scattered = ground_scattered
    all_rescattered = ground_rescattered
    if n > 0:
        all_scattered += pieces[n - 1, SCATTERED]
        all_rescattered += pieces[n - 1, RESCATTERED]
    if all_scattered <= 0.0:
        return n, 0.0, 0.0
    by_importance = importance_fraction if all_rescattered > 0.0 else 0.0
    if number < by_importance:
        column = RESCATTERED
        x = number / by_importance * all_rescattered
    else:
        column = SCATTERED
        x = (number - by_importance) / (1.0 - by_importance) * all_scattered
    k = n
    if n > 0 and x < pieces[n - 1, column]:
        k = draw_from(pieces[:n, column], x)
        scattered = pieces[k, SCATTERED]
        rescattered = pieces[k, RESCATTERED]
        if k > 0:
            scattered -= pieces[k - 1, SCATTERED]
            rescattered -= pieces[k - 1, RESCATTERED]
    else:
        scattered = ground_scattered
        rescattered = ground_rescattered
    probability = (1.0 - by_importance) * scattered / all_scattered
    if by_importance > 0.0:
        probability += by_importance * rescattered / all_rescattered
    return k, probability, uniform(stream)


@njit(inner=True, **INNER)
def event_weight(air, w, piece, t, i, f):
    """Transmittance x scattering x length of a piece (its row), at its fraction t: the weight but for the probability.

    (i, f): the place of the point among the levels.
    """
    within = depth_inside(air, w, piece, t, i, f)
    return piece[LENGTH] * math.exp(-piece[DEPTH] - within) * interpolate(air, w, i, f, SCATTERING)


@njit(inner=True, **INNER)
def mean_matrix(air, w, i, f, cosine):
    """(P12, P22, P33) over P11 at the place (i, f) of the levels; `cosine`: of the scattering angle."""
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

    event (EVENT_COLUMNS,): where the leg begins; work: `directions.DirectionWorkspace`, with its frame filled.
    """
    new = work.new
    for m in range(3):
        new[ORIGIN + m] = event[POINT + m]
    d = event[HEADING:ACROSS]
    e = event[ACROSS:MATRIX]
    direction = new[DIRECTION:REFERENCE]
    next_reference(d, e, direction, new[REFERENCE:CHORD_COLUMNS])
    if not polarised or event[ON_GROUND] > 0.0:
        depolarise(work.matrix, event[MATRIX:WEIGHT])
        return 1.0
    cosine = min(1.0, max(-1.0, d[0] * direction[0] + d[1] * direction[1] + d[2] * direction[2]))
    m12, m22, m33 = mean_matrix(air, w, int(event[LEVEL]), event[FRACTION], cosine)
    a, b = components(e, d, direction[0], direction[1], direction[2])
    cos_2phi, sin_2phi = double_angle(a, b)
    return scatter(event[MATRIX:WEIGHT], cos_2phi, sin_2phi, m12, m22, m33, work.matrix)
