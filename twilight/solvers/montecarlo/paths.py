"""Backward paths: from the observer event by event, with sunlight estimated along every leg.

The Stokes vector that the observer sees is a sum over paths.  After n events, a path has the matrix

    A_n = L(phi_1) P(Theta_1) L(phi_2) P(Theta_2) ... L(phi_n) P(Theta_n)

(L: rotation into the plane of an event, P: phase matrix over P11, of which the Lambertian ground has the first column
alone).
The path picks up A_n (I, Q, U) of the sunlight scattered along its next leg, times a weight that holds transmittance,
scattering and P11 over the probability of every choice made so far.  Directions are drawn by P11 and what the first row
of A makes of it, and A is divided by its first element, which goes into the weight.

Arguments that kernels share: `kernel`.
"""

import math
from typing import Any, NamedTuple

import numpy as np

from twilight.jit.kernels import njit
from twilight.solvers.montecarlo.air import locate
from twilight.solvers.montecarlo.events import (
    ALTITUDE,
    FRACTION,
    HEADING,
    LEVEL,
    MATRIX,
    N_ORDERS,
    NUMBERS,
    ON_GROUND,
    ORDER,
    POINT,
    WEIGHT,
    DirectionWorkspace,
    begin_leg,
    choose_direction,
    choose_point,
    event_weight,
    local_frame,
)
from twilight.solvers.montecarlo.kernel import INNER, uniform
from twilight.solvers.montecarlo.leg import (
    CHORD,
    FIRST,
    LAST,
    LENGTH,
    RESCATTERED,
    START,
    Leg,
    LegOptions,
    rescattered_light,
    trace,
)
from twilight.solvers.montecarlo.rays import (
    DIRECTION,
    ORIGIN,
    altitude_at,
    radius_and_cosine,
    refractivity_at,
    relative_index,
)

CONTROL_VARIATE = N_ORDERS
"""Column of a sample behind those of the orders: the control variate, whose mean is 0."""
TOTAL = N_ORDERS
"""Column of a row of sums behind those of the orders: the total."""
MAX_EVENTS = 5000
"""Events after which a path is given up; the sample then counts as one that met a limit."""
LEAST_SURVIVAL = 0.1
"""Least probability with which a path goes on (Russian roulette), so that no weight grows more than tenfold."""
NEGLIGIBLE = 1e-12
"""Contribution of a path, in units of one at the line of sight, below which it ends: so little moves no mean."""
MOST_COPIES = 16.0
"""Most paths that go on from one leg (splitting)."""
LEAST_CONTRIBUTION = 0.33
"""Contribution below which a path of more than N_ORDERS events meets the roulette; see MOST_CONTRIBUTION."""
MOST_CONTRIBUTION = 3.0
"""Contribution above which a path of more than N_ORDERS events is split.

In between it goes on alone, in directions of the phase function: in thick air, the noise of a roulette and of the
directions of the importance function would add up over hundreds of events.
"""
STACK = 4096
"""Most events that wait."""
LATTICE = (0.8191725134, 0.6710436067, 0.5497004779)
"""Steps in three dimensions of Roberts' sequence (x, x^2, x^3 with x = 1 / 1.2207...)."""


class WalkOptions(NamedTuple):
    """How paths are sampled; nothing here moves the mean, except max_orders, which cuts the series on purpose.

    first, later: how the line of sight and later legs are cut.
    paths_per_sample: stratified paths that go on from one line of sight.
    importance_point_fraction, importance_direction_fraction: fractions of the points of events and of the directions
        after them that are drawn with the importance function; direction_candidates: directions of which one is taken.
    roulette_threshold: contribution, in units of one path at the line of sight, below which a path may end; 0: neither
        roulette nor splitting; splitting_rate: paths that go on from a leg of the contribution 1.
    control_variate: take the importance function for the light beyond each leg and sample the difference.
    """

    first: LegOptions
    later: LegOptions
    paths_per_sample: int
    importance_point_fraction: float
    importance_direction_fraction: float
    direction_candidates: int
    roulette_threshold: float
    splitting_rate: float
    control_variate: bool
    max_orders: int


class Continuation(NamedTuple):
    """How a path goes on from a leg: at_start: n - 1 where the leg begins, for bent legs; weight: of each path from it;
    copies: how many; order: of scattering of the light that they gather."""

    at_start: float
    weight: float
    copies: int
    order: Any


class PathMemory(NamedTuple):
    """Memory of one thread, for one pixel and wavelength at a time.

    line_of_sight, leg: the line of sight and a later leg; stack (STACK, EVENT_COLUMNS): events that wait; work: work
    space, with the matrix of the path on its present leg; ray (9,): work space; to_sun (3,), stream (1,).
    """

    line_of_sight: Leg
    leg: Leg
    stack: np.ndarray
    work: DirectionWorkspace
    ray: np.ndarray
    to_sun: np.ndarray
    stream: np.ndarray


@njit(inner=True, **INNER)
def push_events(air, w, walk, options, leg, totals, following, size, memory):
    """Draw stratified events on a leg and put them on the stack, of which `size` rows are in use.

    options: by which the leg was cut; leg, totals: `Leg` and its `LegTotals`; following: `Continuation`.

    Returns (new size of the stack or -1 if it is full, the light of the importance function that the events stand for).
    The numbers of the copies are a shifted lattice (Roberts' sequence in three dimensions), each uniform by itself, so
    that copies do not crowd.
    """
    stack, stream, matrix = memory.stack, memory.stream, memory.work.matrix
    at_start, weight, copies, order = following
    ground_scattered = 0.0
    if totals.ground_km >= 0.0:
        ground_scattered = totals.transmittance * air.ground_albedo[w]
    shift_1 = uniform(stream)
    shift_2 = uniform(stream)
    shift_3 = uniform(stream)
    known = 0.0
    for copy in range(copies):
        if size >= stack.shape[0]:
            return -1, known
        number = (copy + uniform(stream)) / copies
        k, probability, t = choose_point(
            leg.pieces, totals.n_pieces, ground_scattered, totals.ground_rescattered, walk.importance_point_fraction,
            number, stream,
        )  # fmt: skip
        if probability <= 0.0:
            continue
        event = stack[size]
        if k == totals.n_pieces:
            known += weight * totals.ground_rescattered / probability
            chord = leg.chords[totals.last_chord]
            s = totals.ground_km
            value = ground_scattered
            event[ALTITUDE] = air.shell_km[0]
            event[LEVEL] = 0.0
            event[FRACTION] = 0.0
            event[ON_GROUND] = 1.0
        else:
            piece = leg.pieces[k]
            light = piece[RESCATTERED]
            if k > 0:
                light -= leg.pieces[k - 1, RESCATTERED]
            known += weight * light / probability
            chord = leg.chords[int(piece[CHORD])]
            s = piece[START] + t * piece[LENGTH]
            r, mu = radius_and_cosine(chord)
            event[ALTITUDE] = altitude_at(r - air.earth_radius_km, r, mu, s)
            i, f = locate(air, event[ALTITUDE], int(piece[FIRST]), int(piece[LAST]))
            value = event_weight(air, w, piece, t, i, f)
            if options.bent:
                value *= relative_index(air.refractivity[w], i, f, at_start)
            event[LEVEL] = i
            event[FRACTION] = f
            event[ON_GROUND] = 0.0
        if value <= 0.0:
            continue
        # put the point on the sphere of its altitude again, so that rounding does not add up over events
        x = chord[ORIGIN] + s * chord[DIRECTION]
        y = chord[ORIGIN + 1] + s * chord[DIRECTION + 1]
        h = chord[ORIGIN + 2] + s * chord[DIRECTION + 2]
        scale = (air.earth_radius_km + event[ALTITUDE]) / math.sqrt(x * x + y * y + h * h)
        event[POINT] = x * scale
        event[POINT + 1] = y * scale
        event[POINT + 2] = h * scale
        for m in range(6):
            event[HEADING + m] = chord[DIRECTION + m]
        for m in range(9):
            event[MATRIX + m] = matrix[m]
        event[WEIGHT] = weight * value / probability
        event[ORDER] = order
        event[NUMBERS] = (shift_1 + copy * LATTICE[0]) % 1.0
        event[NUMBERS + 1] = (shift_2 + copy * LATTICE[1]) % 1.0
        event[NUMBERS + 2] = (shift_3 + copy * LATTICE[2]) % 1.0
        size += 1
    return size, known


@njit(inner=True, **INNER)
def push_first_events(air, w, walk, at_observer, line_of_sight, memory):
    """`push_events` on memory.line_of_sight, onto an empty stack; line_of_sight: its `LegTotals`; at_observer: n-1."""
    matrix = memory.work.matrix
    for m in range(9):
        matrix[m] = 1.0 if m % 4 == 0 else 0.0
    n = walk.paths_per_sample
    following = Continuation(at_observer, 1.0 / n, n, np.int64(1))
    return push_events(air, w, walk, walk.first, memory.line_of_sight, line_of_sight, following, np.int64(0), memory)


@njit(inner=True, **INNER)
def next_leg(air, importance, w, walk, event, unit, memory):
    """Draw the leg after an event into work.new and work.matrix of the memory; returns its weight, 0 if the path ends.

    unit [sr^-1]: light that one path stands for at the line of sight.
    """
    work, stream = memory.work, memory.stream
    polarised = walk.later.polarised
    cos_sun = local_frame(event[POINT], event[POINT + 1], event[POINT + 2], memory.to_sun, work.frame)
    ratio, light = choose_direction(air, importance, w, walk, event, cos_sun, stream, work)
    weight = event[WEIGHT] * ratio
    if weight <= 0.0:
        return 0.0
    weight *= begin_leg(air, w, event, polarised, work)
    if walk.roulette_threshold > 0.0:
        contribution = weight * light / unit
        survival = contribution / walk.roulette_threshold
        if survival < 1.0:
            survival = max(LEAST_SURVIVAL, survival)
            if uniform(stream) >= survival:
                return 0.0
            weight /= survival
    return max(0.0, weight)


@njit(inner=True, **INNER)
def continuations(walk, contribution, order, stream):
    """(number of paths that go on from a leg, their mean number, by which the weight of each is divided).

    contribution: light expected of one, in units of one path at the line of sight; order: of the light they gather.
    """
    usual = LEAST_CONTRIBUTION < contribution < MOST_CONTRIBUTION
    if walk.roulette_threshold > 0.0 and (order <= N_ORDERS or not usual):
        mean = min(max(contribution * walk.splitting_rate, LEAST_SURVIVAL), MOST_COPIES)
        return int(mean + uniform(stream)), mean
    return (0 if contribution < NEGLIGIBLE else 1), 1.0


@njit(inner=True, **INNER)
def one_sample(air, sun, importance, walk, w, at_observer, line_of_sight, memory, orders):
    """Add one estimate of the light scattered more than once, order by order, to `orders`; 1 if a limit was met.

    orders (S, N_ORDERS + 1): of I and, if S is 3, Q and U.  orders[:, n] is light scattered n + 1 times (a reflection
    by the ground is one); column N_ORDERS - 1 takes the rest, and CONTROL_VARIATE is the light of the importance
    function along every leg, less what the events drawn on that leg stand for.  The sum of that over the legs of a path
    has the mean 0, and takes away most of the noise of the orders' sum.

    From every leg as many paths go on as its expected light makes, in units of one path at the line of sight: none
    (roulette) or several (splitting), so that the weights of long paths do not drift apart.

    at_observer: n - 1 there; line_of_sight: `LegTotals` of the leg that memory.line_of_sight holds.
    """
    leg, matrix, stream = memory.leg, memory.work.matrix, memory.stream
    n_stokes = orders.shape[0]
    control_variate = 1.0 if walk.control_variate else 0.0
    limit_met = 0
    remaining = rescattered_light(memory.line_of_sight, line_of_sight)
    orders[0, CONTROL_VARIATE] += control_variate * remaining
    if walk.max_orders < 2 or remaining <= 0.0:
        return 0
    unit = remaining / walk.paths_per_sample
    size, known = push_first_events(air, w, walk, at_observer, line_of_sight, memory)
    orders[0, CONTROL_VARIATE] -= control_variate * known
    if size < 0:
        return 1
    while size > 0:
        size -= 1
        event = memory.stack[size]
        order = int(event[ORDER])
        weight = next_leg(air, importance, w, walk, event, unit, memory)
        if weight <= 0.0:
            continue
        at_start = refractivity_at(air, w, event[ALTITUDE]) if walk.later.bent else 0.0
        totals = trace(air, sun, importance, w, memory.work.new, memory.to_sun, walk.later, stream, leg)
        if totals.n_pieces < 0:
            limit_met = 1
        light = totals.sun_i + totals.sun_ground
        place = min(order, N_ORDERS - 1)
        for m in range(n_stokes):
            orders[m, place] += weight * (matrix[3 * m] * light)
            if n_stokes > 1:
                orders[m, place] += weight * (matrix[3 * m + 1] * totals.sun_q + matrix[3 * m + 2] * totals.sun_u)
        order += 1
        remaining = rescattered_light(leg, totals)
        for m in range(n_stokes):
            orders[m, CONTROL_VARIATE] += control_variate * weight * matrix[3 * m] * remaining
        if order < walk.max_orders and remaining > 0.0:
            copies, mean_copies = continuations(walk, weight * remaining / unit, order, stream)
            if order >= MAX_EVENTS:
                limit_met = 1
            elif copies > 0:
                following = Continuation(at_start, weight / mean_copies, copies, order)
                full, known = push_events(air, w, walk, walk.later, leg, totals, following, size, memory)
                if full < 0:
                    return 1
                for m in range(n_stokes):
                    orders[m, CONTROL_VARIATE] -= control_variate * matrix[3 * m] * known
                size = full
    return limit_met
