"""Random paths that remember how long their way was in every layer, and the sums of them that air-mass factors need.

The walk is that of :mod:`twilight.solvers.montecarlo.paths`, event by event.  A path that brings the light x after a
way of l_j [km] in layer j adds x to the light and x l_j to its derivative by absorption in that layer, -dI / dk_j.  Of
the points along a leg that sunlight reaches, each with its part of the leg's light, one is drawn in proportion to that
part, and its way stands for those of all: unbiased, and one sunbeam has to be followed instead of dozens.

The control variate of the walk has the mean 0: it is summed apart, and `air_mass` takes as much of it as helps.

Arguments that kernels share: `kernel`.  Here also edges (J + 1,): altitudes [km] that bound J layers, ascending;
lengths (J,): added to; factor: that lengths count with; profile: `transport.ray_profile.RayProfile`.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from twilight.jit.kernels import njit
from twilight.solvers.montecarlo.air import SPECIES, locate
from twilight.solvers.montecarlo.chunks import observer_ray
from twilight.solvers.montecarlo.directions import new_workspace
from twilight.solvers.montecarlo.events import ACROSS, ALTITUDE, EVENT_COLUMNS, HEADING, ORDER, POINT
from twilight.solvers.montecarlo.kernel import INNER
from twilight.solvers.montecarlo.leg import trace
from twilight.solvers.montecarlo.length_line import add_grounded, reflected_sunlight, scattered_once_lengths
from twilight.solvers.montecarlo.line_of_sight import (
    LINE_OF_SIGHT_CHORDS,
    LINE_OF_SIGHT_PIECES,
    integrate_line_of_sight,
)
from twilight.solvers.montecarlo.path_lengths import add_leg, add_sunbeam, place_on_leg
from twilight.solvers.montecarlo.paths import (
    LEAST_SURVIVAL,
    LEAST_WORTH,
    MAX_EVENTS,
    MOST_COPIES,
    MOST_WORTH,
    N_ORDERS,
    NEGLIGIBLE,
    STACK,
    PathMemory,
    next_leg,
    push_events,
)
from twilight.solvers.montecarlo.pieces import (
    CHORD,
    DEPTH,
    FIRST,
    LAST,
    LEG_CHORDS,
    LEG_PIECES,
    LENGTH,
    START,
    LegOptions,
    depth_inside,
    new_leg,
    rescattered_light,
)
from twilight.solvers.montecarlo.random import start, uniform
from twilight.solvers.montecarlo.rays import (
    CHORD_COLUMNS,
    DIRECTION,
    ORIGIN,
    altitude_at,
    radius_and_cosine,
    refractivity_at,
    relative_index,
)
from twilight.solvers.montecarlo.sunlight import sunlight

LIGHT, LIGHT_SQUARE, CONTROL, CONTROL_SQUARE, LIGHT_CONTROL, N_SCALARS = range(6)
"""Columns of `LengthSums.scalars`: sums over samples of x, x^2, v, v^2 and x v, x the light, v the control variate."""
WAY, WAY_SQUARE, LIGHT_WAY, CONTROL_WAY, N_WAYS = range(5)
"""Rows of `LengthSums.ways`: sums of y, y^2, x y and v y, y the light times its way in each layer."""


class LengthSums(NamedTuple):
    """Sums over the samples of Q jobs: scalars (Q, N_SCALARS), ways (Q, N_WAYS, J); samples, limits (Q,)."""

    scalars: np.ndarray
    ways: np.ndarray
    samples: np.ndarray
    limits: np.ndarray


class WayMemory(NamedTuple):
    """Ways [km] of one thread: of events that wait (STACK, J), of the path that goes on (J,), and room (J,)."""

    stack: np.ndarray
    path: np.ndarray
    room: np.ndarray


@njit(inner=True, **INNER)
def leg_light(
    air, profile, sun, w, to_sun, options, at_start, weight, matrix, leg, totals, edges, way, room, lengths, stream
):
    """I [sr^-1] of sunlight scattered or reflected into a leg once, times the path's weight and matrix; lengths (J,)
    [km sr^-1] += it x way.

    at_start: n - 1 where the leg begins; weight, matrix (9,): of the path; totals: `LegTotals`; way (J,) [km]: up to
    the leg; room (J,): work space.
    """
    radius = air.earth_radius_km
    light, whole, chosen = 0.0, 0.0, 0.0
    number: Any = np.int64(0)
    distance, altitude, cosine, grounded = 0.0, 0.0, 0.0, False
    for n in range(totals.n_pieces):
        piece = leg.pieces[n]
        row = leg.chords[int(piece[CHORD])]
        t = uniform(stream)
        s = piece[START] + t * piece[LENGTH]
        r, mu = radius_and_cosine(row)
        z = altitude_at(r - radius, r, mu, s)
        i, f = locate(air, z, int(piece[FIRST]), int(piece[LAST]))
        up = 0.0
        for m in range(3):
            up += (row[ORIGIN + m] + s * row[DIRECTION + m]) * to_sun[m]
        mu_sun = min(1.0, max(-1.0, up / (radius + z)))
        of_i, of_q, of_u = sunlight(air, sun, w, z, mu_sun, row, s, to_sun, i, f, options.polarised)
        if of_i <= 0.0:
            continue
        passed = piece[LENGTH] * math.exp(-piece[DEPTH] - depth_inside(air, w, piece, t, i, f))
        if options.bent:
            passed *= relative_index(air.refractivity[w], i, f, at_start)
        seen = passed * (of_i + matrix[1] * of_q + matrix[2] * of_u)
        light += seen
        whole += passed * of_i
        if uniform(stream) * whole < passed * of_i:
            chosen = seen / (passed * of_i)
            number, distance, altitude, cosine = int(piece[CHORD]), s, z, mu_sun
    if totals.sun_ground > 0.0:
        of_i, of_q, of_u = reflected_sunlight(air, sun, w, to_sun, leg, totals, options.polarised)
        seen = of_i + matrix[1] * of_q + matrix[2] * of_u
        light += seen
        whole += of_i
        if uniform(stream) * whole < of_i:
            chosen = seen / of_i
            grounded = True
    if whole <= 0.0:
        return 0.0
    for j in range(way.size):
        room[j] = way[j]
    if grounded:
        add_grounded(air, profile, sun, w, to_sun, leg, totals, edges, 1.0, room)
    else:
        add_leg(edges, radius, leg.chords, number, distance, 1.0, room)
        add_sunbeam(profile, sun.beam, w, altitude, cosine, edges, 1.0, room)
    for j in range(way.size):
        lengths[j] += weight * chosen * whole * room[j]
    return weight * light


@njit(inner=True, **INNER)
def ways_of_events(air, leg, last_chord, edges, path, stack, first, end, ways):
    """Fill rows first..end of ways (STACK, J) [km] for events just put on the stack: path (J,) up to the leg, and on.

    leg: that they lie on, with chords up to `last_chord`; stack (STACK, EVENT_COLUMNS).
    """
    for k in range(first, end):
        event = stack[k]
        number, s = place_on_leg(leg.chords, last_chord, event[POINT:HEADING], event[HEADING:ACROSS])
        for j in range(path.size):
            ways[k, j] = path[j]
        add_leg(edges, air.earth_radius_km, leg.chords, number, s, 1.0, ways[k])


@njit(inner=True, **INNER)
def one_path_sample(
    air, profile, sun, importance, walk, w, at_observer, to_sun, line_of_sight, edges, stream, memory, ways, lengths
):
    """(I of light scattered more than once, control variate, 1 if a limit was met) [sr^-1] of one sample, as
    `paths.one_sample`; lengths (J,) [km sr^-1] += its light x way.

    at_observer: n - 1 there; line_of_sight: `LegTotals` of memory.line_of_sight; memory: `PathMemory`; ways:
    `WayMemory`.
    """
    leg, stack, work = memory.leg, memory.stack, memory.work
    matrix = work.matrix
    path = ways.path
    # the light of a leg is gathered by `leg_light`
    later = walk.later
    false: Any = np.bool_(False)
    gather = LegOptions(later.max_length_km, later.max_depth, later.sag_km, later.bent, false, false)
    light, limit_met = 0.0, 0
    remaining = rescattered_light(memory.line_of_sight, line_of_sight)
    control = remaining
    if walk.max_orders < 2 or remaining <= 0.0:
        return 0.0, 0.0, 0
    unit = remaining / walk.paths_per_sample
    for m in range(9):
        matrix[m] = 1.0 if m % 4 == 0 else 0.0
    size, known = push_events(
        air, w, walk, walk.first, at_observer, memory.line_of_sight, line_of_sight, 1.0 / walk.paths_per_sample, matrix,
        walk.paths_per_sample, np.int64(1), stack, np.int64(0), stream,
    )  # fmt: skip
    control -= known
    if size < 0:
        return 0.0, 0.0, 1
    for j in range(path.size):
        path[j] = 0.0
    ways_of_events(air, memory.line_of_sight, line_of_sight.last_chord, edges, path, stack, 0, size, ways.stack)
    while size > 0:
        size -= 1
        event = stack[size]
        order = int(event[ORDER])
        for j in range(path.size):
            path[j] = ways.stack[size, j]
        direction_fraction = walk.importance_direction_fraction if order <= N_ORDERS else 0.0
        weight = next_leg(air, importance, w, walk, direction_fraction, event, unit, to_sun, stream, work)
        if weight <= 0.0:
            continue
        at_start = refractivity_at(air, w, event[ALTITUDE]) if walk.later.bent else 0.0
        totals = trace(air, sun, importance, w, work.new, to_sun, gather, stream, leg)
        if totals.n_pieces < 0:
            return light, control, 1
        light += leg_light(
            air, profile, sun, w, to_sun, walk.later, at_start, weight, matrix, leg, totals, edges, path, ways.room,
            lengths, stream,
        )  # fmt: skip
        order += 1
        remaining = rescattered_light(leg, totals)
        control += weight * remaining
        if order < walk.max_orders and remaining > 0.0:
            copies = 1
            worth = weight * remaining / unit
            if walk.roulette_threshold > 0.0 and (order <= N_ORDERS or not LEAST_WORTH < worth < MOST_WORTH):
                mean_copies = min(max(worth * walk.splitting_rate, LEAST_SURVIVAL), MOST_COPIES)
                copies = int(mean_copies + uniform(stream))
                weight /= mean_copies
            elif worth < NEGLIGIBLE:
                copies = 0
            if order >= MAX_EVENTS:
                limit_met = 1
            elif copies > 0:
                full, known = push_events(
                    air, w, walk, walk.later, at_start, leg, totals, weight, matrix, copies, order, stack, size, stream
                )
                if full < 0:
                    return light, control, 1
                ways_of_events(air, leg, totals.last_chord, edges, path, stack, size, full, ways.stack)
                control -= known
                size = full
    return light, control, limit_met


@njit(cache=True, nogil=True)
def run_length_chunks(
    air, profile, sun, importance, walk, seed, pixels, jobs, first_job, end_job, edges, single, single_ways, sums
):
    """Run jobs and fill their rows of the sums.

    seed: an integer; pixels: `Pixels`; jobs: `ChunkJobs`; first_job, end_job: the first job and the one after the last;
    single (P, W) [sr^-1], single_ways (P, W, J) [km sr^-1]: light scattered once, of `single_scattering`; sums:
    `LengthSums`, filled.
    """
    n_layers = edges.size - 1
    n_species = air.table.shape[2] - SPECIES
    line_leg = new_leg(n_species, LINE_OF_SIGHT_PIECES, LINE_OF_SIGHT_CHORDS)
    leg = new_leg(n_species, LEG_PIECES, LEG_CHORDS)
    memory = PathMemory(line_leg, leg, np.empty((STACK, EVENT_COLUMNS)), new_workspace())
    ways = WayMemory(np.empty((STACK, n_layers)), np.empty(n_layers), np.empty(n_layers))
    ray, to_sun = np.empty(CHORD_COLUMNS), np.empty(3)
    lengths = np.empty(n_layers)
    stream = np.empty(1, dtype=np.uint64)
    for q in range(first_job, end_job):
        p, w = jobs.pixel[q], jobs.wavelength[q]
        observer_ray(
            pixels.sun_elevation_rad[p], pixels.elevation_rad[p], pixels.azimuth_rad[p], pixels.altitude_km,
            air.earth_radius_km, ray, to_sun,
        )  # fmt: skip
        line_of_sight = integrate_line_of_sight(
            air, sun, importance, w, walk.first, ray, to_sun, pixels.far_km[p], memory.line_of_sight
        )
        at_observer = refractivity_at(air, w, pixels.altitude_km) if walk.first.bent else 0.0
        start(stream, seed, pixels.key[p], pixels.wavelength_key[w], jobs.chunk[q])
        scalars, rows = sums.scalars[q], sums.ways[q]
        for _ in range(jobs.samples[q]):
            for j in range(n_layers):
                lengths[j] = single_ways[p, w, j]
            light, control, limit = 0.0, 0.0, 1
            if line_of_sight.n_pieces >= 0:
                light, control, limit = one_path_sample(
                    air, profile, sun, importance, walk, w, at_observer, to_sun, line_of_sight, edges, stream, memory,
                    ways, lengths,
                )  # fmt: skip
            light += single[p, w]
            sums.samples[q] += 1
            sums.limits[q] += limit
            scalars[LIGHT] += light
            scalars[LIGHT_SQUARE] += light * light
            scalars[CONTROL] += control
            scalars[CONTROL_SQUARE] += control * control
            scalars[LIGHT_CONTROL] += light * control
            for j in range(n_layers):
                rows[WAY, j] += lengths[j]
                rows[WAY_SQUARE, j] += lengths[j] * lengths[j]
                rows[LIGHT_WAY, j] += light * lengths[j]
                rows[CONTROL_WAY, j] += control * lengths[j]


@njit(cache=True, nogil=True)
def single_scattering(air, profile, sun, importance, walk, pixels, begin, end, edges, light, lengths):
    """Fill light (P, W) [sr^-1] scattered once and lengths (P, W, J) [km sr^-1], it x way, of pixels begin..end.

    pixels: `Pixels`.
    """
    leg = new_leg(air.table.shape[2] - SPECIES, LINE_OF_SIGHT_PIECES, LINE_OF_SIGHT_CHORDS)
    ray, to_sun = np.empty(CHORD_COLUMNS), np.empty(3)
    for p in range(begin, end):
        for w in range(light.shape[1]):
            observer_ray(
                pixels.sun_elevation_rad[p], pixels.elevation_rad[p], pixels.azimuth_rad[p], pixels.altitude_km,
                air.earth_radius_km, ray, to_sun,
            )  # fmt: skip
            totals = integrate_line_of_sight(air, sun, importance, w, walk.first, ray, to_sun, pixels.far_km[p], leg)
            at_observer = refractivity_at(air, w, pixels.altitude_km) if walk.first.bent else 0.0
            light[p, w] = scattered_once_lengths(
                air, profile, sun, importance, w, walk.first, to_sun, at_observer, totals, leg, edges, lengths[p, w]
            )
