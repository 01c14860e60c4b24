"""Backward paths: from the observer event by event, with the sun asked along every leg; chunks of them in parallel.

The Stokes vector that the observer sees is a sum over paths.  After n events, a path has the matrix

    A_n = L(phi_1) P(Theta_1) L(phi_2) P(Theta_2) ... L(phi_n) P(Theta_n)

(L: rotation into the plane of an event, P: phase matrix over P11; a Lambertian ground keeps the first column alone,
water has Fresnel's matrix).
The path picks up A_n (I, Q, U) of the sunlight scattered along its next leg, times a weight that holds transmittance,
scattering and P11 over the probability of every choice made so far.  Directions are drawn by P11 and what the first row
of A makes of it, and A is kept with 1 in its corner, the corner going into the weight.  Arguments that kernels share:
`kernel`.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from twilight.kernels import njit
from twilight.solvers.montecarlo.directions import Work, choose_direction, local_frame
from twilight.solvers.montecarlo.events import (
    ALTITUDE,
    FRACTION,
    HEADING,
    LEVEL,
    MATRIX,
    NUMBERS,
    ON_GROUND,
    ORDER,
    POINT,
    WEIGHT,
    begin_leg,
    choose_point,
    event_distance,
    event_level,
    event_weight,
)
from twilight.solvers.montecarlo.ground import ground_share
from twilight.solvers.montecarlo.kernel import INNER
from twilight.solvers.montecarlo.leg import trace
from twilight.solvers.montecarlo.lines import DIRECTION, ORIGIN, altitude_at, refractivity_at, relative_index
from twilight.solvers.montecarlo.pieces import CHORD, STEERED, Cuts, Leg, steered_light
from twilight.solvers.montecarlo.random import uniform

N_ORDERS = 20
COARSE, TOTAL = N_ORDERS, N_ORDERS
"""The last column of a sample holds the coarse field's part, that of a row of sums the total."""
MAX_EVENTS = 5000
LEAST_SURVIVAL = 0.1
NEGLIGIBLE = 1e-12
MOST_COPIES = 16.0
LEAST_WORTH, MOST_WORTH = 0.33, 3.0
"""A path of more than N_ORDERS events, as there are in thick air, goes on alone while it is worth as much in units of a
continuation of the first leg, and in directions of the phase function: the noise of a roulette and of the coarse
field's directions at each of hundreds of events would add up."""
STACK = 4096
LATTICE_1, LATTICE_2, LATTICE_3 = 0.8191725134, 0.6710436067, 0.5497004779


class Walk(NamedTuple):
    """What steers a path; none of it moves the mean, except max_orders, which cuts the series on purpose.

    first, later: how the first leg and later ones are cut.  sub_paths: stratified continuations of one first leg.
    steered_fraction and table_fraction: share of events and directions drawn with the coarse field; candidates:
    directions of which one is taken.  roulette: a path whose expected contribution falls below this fraction of a
    continuation's of the first leg may end; 0 switches that and splitting off.  continuation: paths that go on from a
    later leg that is worth one continuation of the first.  control: replace the light beyond each leg by the coarse
    field's and sample the difference.
    """

    first: Cuts
    later: Cuts
    sub_paths: int
    steered_fraction: float
    table_fraction: float
    candidates: int
    roulette: float
    continuation: float
    control: bool
    max_orders: int


class Memory(NamedTuple):
    """Memory of one thread: the line of sight, a later leg, events that wait (STACK, EVENT_COLUMNS), work space."""

    sight: Leg
    leg: Leg
    stack: np.ndarray
    work: Work


@njit(inner=True, **INNER)
def descent(chord, s):
    """Sine of the angle by which a chord (9,) points below the horizontal at its distance s [km]."""
    up = square = 0.0
    for m in range(3):
        x = chord[ORIGIN + m] + s * chord[DIRECTION + m]
        up += x * chord[DIRECTION + m]
        square += x * x
    return -up / math.sqrt(square)


@njit(inner=True, **INNER)
def push_events(air, w, walk, cuts, at_start, leg, found, weight, matrix, copies, order, stack, size, stream):
    """Draw `copies` stratified events on a leg and put them on the stack.

    at_start: n - 1 where the leg begins, for bent legs; leg, found: from `trace` or `look`, cut by `cuts`; weight,
    matrix (9,): of the path on that leg; order: of the light that the legs after the events gather; stack (STACK,
    EVENT_COLUMNS), of which `size` rows are in use.
    Returns (new size of the stack or -1 if it is full, the light of the coarse field that the events stand for).
    The numbers of the copies are a shifted lattice (Roberts' sequence in three dimensions), each uniform by itself, so
    that copies do not crowd.
    """
    ground_plain = 0.0
    if found.ground >= 0.0:
        chord = leg.chords[found.chord]
        ground_plain = found.transmittance * ground_share(air, w, descent(chord, found.ground))
    shift_1 = uniform(stream)
    shift_2 = uniform(stream)
    shift_3 = uniform(stream)
    known = 0.0
    for copy in range(copies):
        if size >= stack.shape[0]:
            return -1, known
        number = (copy + uniform(stream)) / copies
        k, probability, t = choose_point(
            leg.pieces, found.pieces, ground_plain, found.steered_ground, walk.steered_fraction, number, stream
        )
        if probability <= 0.0:
            continue
        event = stack[size]
        if k == found.pieces:
            known += weight * found.steered_ground / probability
            chord = leg.chords[found.chord]
            s = found.ground
            # water's matrix says how much is reflected, a Lambertian ground sends on its share
            value = found.transmittance if air.water_slope > 0.0 else ground_plain
            event[ALTITUDE] = air.shell_km[0]
            event[LEVEL] = 0.0
            event[FRACTION] = 0.0
            event[ON_GROUND] = 1.0
        else:
            piece = leg.pieces[k]
            share = piece[STEERED]
            if k > 0:
                share -= leg.pieces[k - 1, STEERED]
            known += weight * share / probability
            chord = leg.chords[int(piece[CHORD])]
            s = event_distance(piece, t)
            x, y, h = chord[ORIGIN], chord[ORIGIN + 1], chord[ORIGIN + 2]
            r = math.sqrt(x * x + y * y + h * h)
            mu = (x * chord[DIRECTION] + y * chord[DIRECTION + 1] + h * chord[DIRECTION + 2]) / r
            event[ALTITUDE] = altitude_at(r - air.earth_radius_km, r, mu, s)
            i, f = event_level(air, piece, event[ALTITUDE])
            value = event_weight(air, w, piece, t, i, f)
            if cuts.bent:
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
        event[NUMBERS] = (shift_1 + copy * LATTICE_1) % 1.0
        event[NUMBERS + 1] = (shift_2 + copy * LATTICE_2) % 1.0
        event[NUMBERS + 2] = (shift_3 + copy * LATTICE_3) % 1.0
        size += 1
    return size, known


@njit(inner=True, **INNER)
def next_leg(air, steering, w, walk, table_fraction, event, unit, to_sun, stream, work):
    """Draw the leg after an event into work.new and work.matrix; returns its weight, 0 if the path ends.

    table_fraction: that of `Walk`, or 0; unit [sr^-1]: light that a path is worth; below a fraction of it the path may
    end by chance (roulette).  work: `Work`, with its frame filled.
    """
    polarised = walk.later.polarised
    cos_sun = local_frame(event[POINT], event[POINT + 1], event[POINT + 2], to_sun, work.frame)
    ratio, light = choose_direction(
        air, steering, w, event, cos_sun, table_fraction, walk.candidates, polarised, stream, work
    )
    weight = event[WEIGHT] * ratio
    if weight <= 0.0:
        return 0.0
    weight *= begin_leg(air, w, event, polarised, work)
    if walk.roulette > 0.0:
        worth = weight * light / unit
        survival = worth / walk.roulette
        if survival < 1.0:
            survival = max(LEAST_SURVIVAL, survival)
            if uniform(stream) >= survival:
                return 0.0
            weight /= survival
    return max(0.0, weight)


@njit(inner=True, **INNER)
def one_sample(air, sun, steering, walk, w, at_observer, to_sun, sight, stream, memory, orders):
    """Add one estimate of the light scattered more than once, order by order, to `orders`; 1 if a limit was met.

    orders (S, N_ORDERS + 1): of I and, if S is 3, Q and U.  orders[:, n] is light with n + 1 events (a reflection by
    the ground is one); column N_ORDERS - 1 takes the rest, and COARSE is the coarse field's part: its light along every
    leg, less what the events drawn on that leg stand for.  The sum of that over the legs of a path has the mean 0, and
    takes away most of the noise of the orders' sum.
    From every leg as many paths go on as its expected light is worth, in units of a share of the pixel's: none
    (roulette) or many (splitting), so that the weights of long paths do not drift apart.
    at_observer: n - 1 there; sight: `Found` of the line of sight that memory.sight holds; memory: `Memory`.
    """
    leg = memory.leg
    stack = memory.stack
    work = memory.work
    matrix = work.matrix
    n_stokes = orders.shape[0]
    control = 1.0 if walk.control else 0.0
    limit_met = 0
    remaining = steered_light(memory.sight, sight)
    orders[0, COARSE] += control * remaining
    if walk.max_orders < 2 or remaining <= 0.0:
        return 0
    unit = remaining / walk.sub_paths
    for m in range(9):
        matrix[m] = 1.0 if m % 4 == 0 else 0.0
    size, known = push_events(
        air, w, walk, walk.first, at_observer, memory.sight, sight, 1.0 / walk.sub_paths, matrix, walk.sub_paths,
        np.int64(1), stack, np.int64(0), stream,
    )  # fmt: skip
    orders[0, COARSE] -= control * known
    if size < 0:
        return 1
    while size > 0:
        size -= 1
        event = stack[size]
        order = int(event[ORDER])
        table_fraction = walk.table_fraction if order <= N_ORDERS else 0.0
        weight = next_leg(air, steering, w, walk, table_fraction, event, unit, to_sun, stream, work)
        if weight <= 0.0:
            continue
        at_start = refractivity_at(air, w, event[ALTITUDE]) if walk.later.bent else 0.0
        found = trace(air, sun, steering, w, work.new, to_sun, walk.later, stream, leg)
        if found.pieces < 0:
            limit_met = 1
        light = found.sun_i + found.sun_ground
        place = min(order, N_ORDERS - 1)
        for m in range(n_stokes):
            orders[m, place] += weight * (matrix[3 * m] * light)
            if n_stokes > 1:
                orders[m, place] += weight * (matrix[3 * m + 1] * found.sun_q + matrix[3 * m + 2] * found.sun_u)
        order += 1
        remaining = steered_light(leg, found)
        for m in range(n_stokes):
            orders[m, COARSE] += control * weight * matrix[3 * m] * remaining
        if order < walk.max_orders and remaining > 0.0:
            copies = 1
            worth = weight * remaining / unit
            if walk.roulette > 0.0 and (order <= N_ORDERS or not LEAST_WORTH < worth < MOST_WORTH):
                mean_copies = min(max(worth * walk.continuation, LEAST_SURVIVAL), MOST_COPIES)
                copies = int(mean_copies + uniform(stream))
                weight /= mean_copies
            elif worth < NEGLIGIBLE:
                copies = 0
            if order >= MAX_EVENTS:
                limit_met = 1
            elif copies > 0:
                full, known = push_events(
                    air, w, walk, walk.later, at_start, leg, found, weight, matrix, copies, order, stack, size, stream
                )
                if full < 0:
                    return 1
                for m in range(n_stokes):
                    orders[m, COARSE] -= control * matrix[3 * m] * known
                size = full
    return limit_met
