"""Backward paths: from the observer event by event, with the sun asked along every leg; chunks of them in parallel."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit

from twilight.solvers.montecarlo.events import (
    choose_direction,
    choose_point,
    event_distance,
    event_level,
    event_weight,
    local_frame,
)
from twilight.solvers.montecarlo.leg import BUFFER_PIECES, BUFFER_ROWS, STEERED, altitude_at, trace
from twilight.solvers.montecarlo.random import start, uniform
from twilight.solvers.montecarlo.steering import N_DIRECTIONS, log_light_from

N_ORDERS = 20
MAX_EVENTS = 5000
LEAST_SURVIVAL = 0.1
NEGLIGIBLE = 1e-12


class Walk(NamedTuple):
    """What steers a path; none of it moves the mean, except max_orders, which cuts the series on purpose.

    first_length, first_depth, later_length, later_depth: longest piece of a leg in km and in optical depth, on the
    first leg and on later ones.  sub_paths: stratified continuations of one first leg.  steered_fraction and
    table_fraction: share of events and directions drawn with the coarse field.  roulette: a path whose expected
    contribution falls below this fraction of the pixel's is ended at random; 0 switches it off.
    """

    first_length: float
    first_depth: float
    later_length: float
    later_depth: float
    sub_paths: int
    steered_fraction: float
    table_fraction: float
    roulette: float
    max_orders: int


@njit(cache=True)
def observer_frame(sun_elevation, elevation, azimuth, altitude, radius, point, direction, to_sun):
    """Observer, line of sight and sun [rad, km] in the observer's Cartesian frame."""
    point[0], point[1], point[2] = 0.0, 0.0, radius + altitude
    direction[0] = math.cos(elevation) * math.cos(azimuth)
    direction[1] = math.cos(elevation) * math.sin(azimuth)
    direction[2] = math.sin(elevation)
    to_sun[0], to_sun[1], to_sun[2] = math.cos(sun_elevation), 0.0, math.sin(sun_elevation)


@njit(cache=True)
def one_sample(air, sun, steering, walk, w, point, direction, to_sun, stream, work, orders):
    """Add one estimate of the radiance, order by order, to `orders`; returns 0, or 1 if a limit was met.

    orders[n] is light with n + 1 events (a reflection by the ground is one); the last entry takes the rest.
    """
    first, later, phases, out, cumulative, frame, new = work
    sx, sy, sz = to_sun[0], to_sun[1], to_sun[2]
    n_first = trace(
        air, sun, steering, w, point[0], point[1], point[2], direction[0], direction[1], direction[2],
        sx, sy, sz, walk.first_length, walk.first_depth, True, stream, first, phases, out,
    )  # fmt: skip
    if n_first < 0:
        return 1
    orders[0] += out[0] + out[1]
    if walk.max_orders <= 1:
        return 0
    albedo = air.ground_albedo[w]
    first_ground = out[2]
    first_ground_plain = out[3] * albedo if first_ground >= 0.0 else 0.0
    first_ground_steered = out[4]
    reference = first_ground_steered
    if n_first > 0:
        reference += first[STEERED, n_first - 1]
    if reference <= 0.0:
        return 0
    limit_met = 0
    for sub in range(walk.sub_paths):
        pieces = first
        n = n_first
        ground = first_ground
        ground_plain = first_ground_plain
        ground_steered = first_ground_steered
        weight = 1.0 / walk.sub_paths
        number = (sub + uniform(stream)) / walk.sub_paths
        px, py, pz = point[0], point[1], point[2]
        dx, dy, dz = direction[0], direction[1], direction[2]
        order = 1
        while True:
            k, probability, t = choose_point(
                pieces, n, ground_plain, ground_steered, walk.steered_fraction, number, stream
            )
            if probability <= 0.0:
                break
            on_ground = k == n
            i = 0
            f = 0.0
            if on_ground:
                s = ground
                z = air.shell_km[0]
                weight *= ground_plain / probability
            else:
                s = event_distance(pieces, k, t)
                r = math.sqrt(px * px + py * py + pz * pz)
                mu = (px * dx + py * dy + pz * dz) / r
                z = altitude_at(r - air.earth_radius_km, r, mu, s)
                i, f = event_level(air, pieces, k, z)
                weight *= event_weight(air, w, pieces, k, t, z, i, f) / probability
            if weight <= 0.0:
                break
            px += s * dx
            py += s * dy
            pz += s * dz
            # put the point on the sphere of its altitude again, so that rounding does not add up over events
            scale = (air.earth_radius_km + z) / math.sqrt(px * px + py * py + pz * pz)
            px *= scale
            py *= scale
            pz *= scale
            cos_sun = local_frame(px, py, pz, sx, sy, sz, frame)
            ratio, cell = choose_direction(
                air, steering, w, z, cos_sun, i, f, on_ground, frame, dx, dy, dz,
                walk.table_fraction, cumulative, stream, new,
            )  # fmt: skip
            weight *= ratio
            if weight <= 0.0:
                break
            expected = walk.sub_paths * weight * math.exp(log_light_from(steering, w, z, cos_sun, cell)) / reference
            if walk.roulette > 0.0:
                survival = expected / walk.roulette
                if survival < 1.0:
                    survival = max(LEAST_SURVIVAL, survival)
                    if uniform(stream) >= survival:
                        break
                    weight /= survival
            elif expected < NEGLIGIBLE:
                break
            dx, dy, dz = new[0], new[1], new[2]
            pieces = later
            n = trace(
                air, sun, steering, w, px, py, pz, dx, dy, dz, sx, sy, sz,
                walk.later_length, walk.later_depth, True, stream, later, phases, out,
            )  # fmt: skip
            if n < 0:
                limit_met = 1
                break
            orders[min(order, N_ORDERS - 1)] += weight * (out[0] + out[1])
            order += 1
            if order >= walk.max_orders:
                break
            if order >= MAX_EVENTS:
                limit_met = 1
                break
            ground = out[2]
            ground_plain = out[3] * albedo if ground >= 0.0 else 0.0
            ground_steered = out[4]
            number = uniform(stream)
    return limit_met


@njit(cache=True, nogil=True)
def run_chunks(
    air, sun, steering, walk, seed, keys, sun_elevation, elevation, azimuth, altitude,
    job_pixel, job_wavelength, job_chunk, job_samples, first_job, end_job, sums, squares, limits,
):  # fmt: skip
    """Run the jobs first_job..end_job; row j of `sums` and `squares` gets the sums over its samples of x and x^2 for each order and the total.

    keys, sun_elevation, elevation, azimuth (P,) [rad] and altitude [km] describe pixels; a job is (pixel, wavelength,
    chunk number, samples).  A row depends on its job alone, so neither threads nor the order of jobs change it.
    sums, squares (J, N_ORDERS + 1); limits (J,) counts samples that met a limit of the walk.
    """
    first = np.empty((BUFFER_ROWS, BUFFER_PIECES))
    later = np.empty((BUFFER_ROWS, BUFFER_PIECES))
    out = np.empty(5)
    phases = np.empty((air.table.shape[2], 2))
    cumulative = np.empty(N_DIRECTIONS)
    frame = np.empty((3, 3))
    new = np.empty(3)
    work = (first, later, phases, out, cumulative, frame, new)
    point = np.empty(3)
    direction = np.empty(3)
    to_sun = np.empty(3)
    orders = np.empty(N_ORDERS)
    stream = np.empty(1, dtype=np.uint64)
    for j in range(first_job, end_job):
        pixel = job_pixel[j]
        w = job_wavelength[j]
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
        start(stream, seed, keys[pixel], w, job_chunk[j])
        for _ in range(job_samples[j]):
            orders[:] = 0.0
            limits[j] += one_sample(air, sun, steering, walk, w, point, direction, to_sun, stream, work, orders)
            total = 0.0
            for n in range(N_ORDERS):
                sums[j, n] += orders[n]
                squares[j, n] += orders[n] * orders[n]
                total += orders[n]
            sums[j, N_ORDERS] += total
            squares[j, N_ORDERS] += total * total
