"""Backward paths: from the observer event by event, with the sun asked along every leg; chunks of them in parallel."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit

from twilight.solvers.montecarlo.air import N_SMOOTH
from twilight.solvers.montecarlo.events import (
    choose_direction,
    choose_point,
    event_distance,
    event_level,
    event_weight,
    local_frame,
)
from twilight.solvers.montecarlo.kernel import INNER
from twilight.solvers.montecarlo.leg import BUFFER_COLUMNS, BUFFER_PIECES, STEERED, altitude_at, trace
from twilight.solvers.montecarlo.random import start, uniform
from twilight.solvers.montecarlo.sight import (
    GROUND,
    GROUND_SINGLE,
    GROUND_STEERED,
    LANDING,
    N_SUMMARY,
    ORIGIN,
    SIGHT_COLUMNS,
    SIGHT_PIECES,
    SINGLE,
    THROUGH,
    look,
    observer_refractivity,
    relative_index,
)
from twilight.solvers.montecarlo.steering import N_DIRECTIONS, log_light_from

N_ORDERS = 20
MAX_EVENTS = 5000
LEAST_SURVIVAL = 0.1
NEGLIGIBLE = 1e-12
MOST_COPIES = 16.0
STACK = 4096
LATTICE_1, LATTICE_2, LATTICE_3 = 0.8191725134, 0.6710436067, 0.5497004779


class Walk(NamedTuple):
    """What steers a path; none of it moves the mean, except max_orders, which cuts the series on purpose.

    first_length, first_depth, later_length, later_depth: longest piece of a leg in km and in optical depth, on the
    first leg and on later ones.  sub_paths: stratified continuations of one first leg.  steered_fraction and
    table_fraction: share of events and directions drawn with the coarse field; candidates: directions of which one is
    taken.  roulette: a path whose expected contribution falls below this fraction of a continuation's of the first leg
    may end; 0 switches that and splitting off.  continuation: paths that go on from a later leg that is worth one
    continuation of the first.  control: replace the light beyond each leg by the coarse field's and sample the
    difference.  bent: the first leg follows the refracted ray.
    """

    first_length: float
    first_depth: float
    later_length: float
    later_depth: float
    sub_paths: int
    steered_fraction: float
    table_fraction: float
    candidates: int
    roulette: float
    continuation: float
    control: bool
    bent: bool
    max_orders: int


@njit(**INNER)
def observer_frame(sun_elevation, elevation, azimuth, altitude, radius, point, direction, to_sun):
    """Observer, line of sight and sun [rad, km] in the observer's Cartesian frame."""
    point[0], point[1], point[2] = 0.0, 0.0, radius + altitude
    direction[0] = math.cos(elevation) * math.cos(azimuth)
    direction[1] = math.cos(elevation) * math.sin(azimuth)
    direction[2] = math.sin(elevation)
    to_sun[0], to_sun[1], to_sun[2] = math.cos(sun_elevation), 0.0, math.sin(sun_elevation)


@njit(**INNER)
def push_events(
    air, w, walk, bent, leg, pieces, n, ground, ground_plain, ground_steered, weight, copies, order, stack, size, stream
):
    """Draw `copies` stratified events on a leg and put them on the stack.

    Returns (new size of the stack or -1 if it is full, the light of the coarse field that the events stand for).
    leg: start (3) and direction (3) of the leg, for the ground and, where `pieces` has no columns of its own, for all.
    bent: the leg is a line of sight along which (n_observer / n)^2 counts, the refractivity at the observer being
    `bent` (negative: it does not).  A row of the stack: point (3), direction (3), weight, order, altitude,
    level, fraction, 1 on the ground, three numbers for the direction.  The numbers of the copies are a shifted lattice
    (Roberts' sequence in three dimensions), each uniform by itself, so that copies do not crowd.
    """
    chords = pieces.shape[1] > BUFFER_COLUMNS
    shift_1 = uniform(stream)
    shift_2 = uniform(stream)
    shift_3 = uniform(stream)
    known = 0.0
    for copy in range(copies):
        if size >= stack.shape[0]:
            return -1, known
        number = (copy + uniform(stream)) / copies
        k, probability, t = choose_point(pieces, n, ground_plain, ground_steered, walk.steered_fraction, number, stream)
        if probability <= 0.0:
            continue
        row = stack[size]
        if k == n:
            known += weight * ground_steered / probability
            for m in range(6):
                row[m] = leg[m]
            s = ground
            event = ground_plain
            row[8] = air.shell_km[0]
            row[9] = 0.0
            row[10] = 0.0
            row[11] = 1.0
        else:
            share = pieces[k, STEERED]
            if k > 0:
                share -= pieces[k - 1, STEERED]
            known += weight * share / probability
            for m in range(6):
                row[m] = pieces[k, ORIGIN + m] if chords else leg[m]
            s = event_distance(pieces, k, t)
            r = math.sqrt(row[0] * row[0] + row[1] * row[1] + row[2] * row[2])
            mu = (row[0] * row[3] + row[1] * row[4] + row[2] * row[5]) / r
            row[8] = altitude_at(r - air.earth_radius_km, r, mu, s)
            i, f = event_level(air, pieces, k, row[8])
            event = event_weight(air, w, pieces, k, t, i, f)
            if bent >= 0.0:
                event *= relative_index(air, w, i, f, bent)
            row[9] = i
            row[10] = f
            row[11] = 0.0
        if event <= 0.0:
            continue
        x = row[0] + s * row[3]
        y = row[1] + s * row[4]
        h = row[2] + s * row[5]
        # put the point on the sphere of its altitude again, so that rounding does not add up over events
        scale = (air.earth_radius_km + row[8]) / math.sqrt(x * x + y * y + h * h)
        row[0] = x * scale
        row[1] = y * scale
        row[2] = h * scale
        row[6] = weight * event / probability
        row[7] = order
        row[12] = (shift_1 + copy * LATTICE_1) % 1.0
        row[13] = (shift_2 + copy * LATTICE_2) % 1.0
        row[14] = (shift_3 + copy * LATTICE_3) % 1.0
        size += 1
    return size, known


@njit(**INNER)
def one_sample(air, sun, steering, walk, w, bent, to_sun, line, n_line, summary, stream, work, orders):
    """Add one estimate of the light scattered more than once, order by order, to `orders`; 1 if a limit was met.

    orders[n] is light with n + 1 events (a reflection by the ground is one); the one before the last takes the rest,
    and the last is the coarse field's part: its light along every leg, less what the events drawn on that leg stand
    for.  The sum of that over the legs of a path has the mean 0, and takes away most of the noise of the orders' sum.
    From every leg as many paths go on as its expected light is worth, in units of a share of the pixel's: none
    (roulette) or many (splitting), so that the weights of long paths do not drift apart.
    line, n_line, summary: the line of sight, from `look`.
    """
    pieces, phases, out, cumulative, blurred, frame, leg, trial, new, stack = work
    sx, sy, sz = to_sun[0], to_sun[1], to_sun[2]
    albedo = air.ground_albedo[w]
    coarse = orders.size - 1
    control = 1.0 if walk.control else 0.0
    limit_met = 0
    remaining = summary[GROUND_STEERED]
    if n_line > 0:
        remaining += line[n_line - 1, STEERED]
    orders[coarse] += control * remaining
    if walk.max_orders < 2 or remaining <= 0.0:
        return 0
    unit = remaining / walk.sub_paths
    for m in range(6):
        leg[m] = summary[LANDING + m]
    # the ground is where the leg already is
    ground_plain = summary[THROUGH] * albedo if summary[GROUND] >= 0.0 else 0.0
    size, known = push_events(
        air, w, walk, bent, leg, line, n_line, 0.0, ground_plain, summary[GROUND_STEERED], 1.0 / walk.sub_paths,
        walk.sub_paths, 1, stack, 0, stream,
    )  # fmt: skip
    orders[coarse] -= control * known
    if size < 0:
        return 1
    while True:
        # the next leg, from the top of the stack
        alive = False
        weight = 0.0
        order = 0
        while size > 0 and not alive:
            size -= 1
            row = stack[size]
            cos_sun = local_frame(row[0], row[1], row[2], sx, sy, sz, frame)
            ratio, cell = choose_direction(
                air, steering, w, row[8], cos_sun, int(row[9]), row[10], row[11] > 0.0, frame, row[3], row[4], row[5],
                walk.table_fraction, walk.candidates, cumulative, blurred, row[12:15], stream, trial, new,
            )  # fmt: skip
            weight = row[6] * ratio
            if weight <= 0.0:
                continue
            if walk.roulette > 0.0:
                worth = weight * math.exp(log_light_from(steering, w, row[8], cos_sun, cell)) / unit
                survival = worth / walk.roulette
                if survival < 1.0:
                    survival = max(LEAST_SURVIVAL, survival)
                    if uniform(stream) >= survival:
                        continue
                    weight /= survival
            alive = True
            order = int(row[7])
            leg[0], leg[1], leg[2] = row[0], row[1], row[2]
            leg[3], leg[4], leg[5] = new[0], new[1], new[2]
        if not alive:
            return limit_met
        n = trace(
            air, sun, steering, w, leg[0], leg[1], leg[2], leg[3], leg[4], leg[5], sx, sy, sz,
            walk.later_length, walk.later_depth, 1, stream, pieces, phases, out,
        )  # fmt: skip
        if n < 0:
            limit_met = 1
            n = 0
        orders[min(order, coarse - 1)] += weight * (out[0] + out[1])
        order += 1
        ground = out[2]
        ground_plain = out[3] * albedo if ground >= 0.0 else 0.0
        remaining = out[4]
        if n > 0:
            remaining += pieces[n - 1, STEERED]
        orders[coarse] += control * weight * remaining
        if order < walk.max_orders and remaining > 0.0:
            copies = 1
            worth = weight * remaining / unit
            if walk.roulette > 0.0:
                mean_copies = min(max(worth * walk.continuation, LEAST_SURVIVAL), MOST_COPIES)
                copies = int(mean_copies + uniform(stream))
                weight /= mean_copies
            elif worth < NEGLIGIBLE:
                copies = 0
            if order >= MAX_EVENTS:
                limit_met = 1
            elif copies > 0:
                full, known = push_events(
                    air, w, walk, -1.0, leg, pieces, n, ground, ground_plain, out[4], weight, copies, order,
                    stack, size, stream,
                )  # fmt: skip
                if full < 0:
                    return 1
                orders[coarse] -= control * known
                size = full


@njit(cache=True, nogil=True)
def run_chunks(
    air, sight, sun, steering, walk, seed, keys, wavelength_keys, sun_elevation, elevation, azimuth, altitude,
    job_pixel, job_wavelength, job_chunk, job_samples, first_job, end_job, sums, squares, limits,
):  # fmt: skip
    """Run the jobs first_job..end_job; row j of `sums` and `squares` gets sums of x and x^2 over the samples of job j.

    x is the radiance of each order and, last, of all.  keys, wavelength_keys name the random streams; sun_elevation,
    elevation, azimuth (P,) [rad] and altitude [km] describe pixels; a job is (pixel, wavelength, chunk number,
    samples).  A row depends on its job alone, so neither threads nor the order of jobs change it.
    `sight` is the air that single scattering is seen through, the same as `air` unless events are isotropic.
    sums, squares (J, N_ORDERS + 1); limits (J,) counts samples that met a limit of the walk.
    """
    pieces = np.empty((BUFFER_PIECES, BUFFER_COLUMNS))
    line = np.empty((SIGHT_PIECES, SIGHT_COLUMNS))
    summary = np.empty(N_SUMMARY)
    stack = np.empty((STACK, 15))
    leg = np.empty(6)
    out = np.empty(5)
    phases = np.empty((air.table.shape[2], 2))
    cumulative = np.empty(N_DIRECTIONS)
    blurred = np.empty(N_SMOOTH)
    frame = np.empty((3, 3))
    new = np.empty(3)
    trial = np.empty(3)
    work = (pieces, phases, out, cumulative, blurred, frame, leg, trial, new, stack)
    point = np.empty(3)
    direction = np.empty(3)
    to_sun = np.empty(3)
    orders = np.empty(N_ORDERS + 1)
    stream = np.empty(1, dtype=np.uint64)
    last_pixel = -1
    last_wavelength = -1
    n_line = 0
    single = 0.0
    at_observer = -1.0
    for j in range(first_job, end_job):
        pixel = job_pixel[j]
        w = job_wavelength[j]
        if pixel != last_pixel or w != last_wavelength:
            last_pixel = pixel
            last_wavelength = w
            observer_frame(
                sun_elevation[pixel],
                elevation[pixel],
                azimuth[pixel],
                altitude,
                air.earth_radius_km,
                point,
                direction,
                to_sun,
            )
            single = 0.0
            if air.isotropic_events:
                # light scattered once is seen through air that is not the diffuse light's
                look(
                    sight, sun, steering, w, walk.bent, point, direction, to_sun, walk.first_length, walk.first_depth,
                    line, summary,
                )  # fmt: skip
                single = summary[SINGLE] + summary[GROUND_SINGLE]
            n_line = look(
                air, sun, steering, w, walk.bent, point, direction, to_sun, walk.first_length, walk.first_depth,
                line, summary,
            )  # fmt: skip
            if not air.isotropic_events:
                single = summary[SINGLE] + summary[GROUND_SINGLE]
            if walk.bent:
                at_observer = observer_refractivity(air, w, altitude)
        if n_line < 0:
            limits[j] += job_samples[j]
        start(stream, seed, keys[pixel], wavelength_keys[w], job_chunk[j])
        for _ in range(job_samples[j]):
            orders[:] = 0.0
            orders[0] = single
            if n_line >= 0:
                limits[j] += one_sample(
                    air, sun, steering, walk, w, at_observer, to_sun, line, n_line, summary, stream, work, orders
                )
            total = orders[N_ORDERS]
            for n in range(N_ORDERS):
                sums[j, n] += orders[n]
                squares[j, n] += orders[n] * orders[n]
                total += orders[n]
            sums[j, N_ORDERS] += total
            squares[j, N_ORDERS] += total * total
