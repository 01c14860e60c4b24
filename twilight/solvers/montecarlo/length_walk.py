"""Random paths with their length in every layer of air, and the sums of them that air-mass factors need.

The walk is that of :mod:`twilight.solvers.montecarlo.paths`, event by event.  A path that brings the light x after a
length of l_j [km] in layer j adds x to the light and x l_j to its derivative by absorption in that layer, -dI / dk_j.
Of the points along a leg that sunlight reaches, each with its part of the leg's light, one is drawn in proportion to
that part, and its path length stands for those of all: unbiased, and one sunbeam has to be followed instead of dozens.

The control variate of the walk has the mean 0: it is summed apart, and `air_mass` takes as much of it as helps.

Arguments that kernels share: `kernel`.  Here also layers: `path_lengths.BoxLayers`, J of them; lengths (J,): added to.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from twilight.jit.kernels import njit
from twilight.solvers.montecarlo.air import locate
from twilight.solvers.montecarlo.chunks import new_memory, pixel_line_of_sight
from twilight.solvers.montecarlo.events import ACROSS, ALTITUDE, HEADING, ORDER, POINT
from twilight.solvers.montecarlo.kernel import INNER
from twilight.solvers.montecarlo.leg import trace
from twilight.solvers.montecarlo.length_line import add_reflected, reflected_sunlight, scattered_once_lengths
from twilight.solvers.montecarlo.path_lengths import add_leg, add_sunbeam, place_on_leg
from twilight.solvers.montecarlo.paths import (
    MAX_EVENTS,
    STACK,
    continuations,
    next_leg,
    push_events,
    push_first_events,
)
from twilight.solvers.montecarlo.pieces import (
    CHORD,
    DEPTH,
    FIRST,
    LAST,
    LENGTH,
    START,
    LegOptions,
    depth_inside,
    rescattered_light,
)
from twilight.solvers.montecarlo.random import start, uniform
from twilight.solvers.montecarlo.rays import (
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
PATH, PATH_SQUARE, LIGHT_PATH, CONTROL_PATH, N_PATHS = range(5)
"""Rows of `LengthSums.paths`: sums of y, y^2, x y and v y, y the light times its path length in each layer."""


class LengthSums(NamedTuple):
    """Sums over the samples of Q jobs: scalars (Q, N_SCALARS), paths (Q, N_PATHS, J); limits (Q,): of samples that met
    a limit of the walk."""

    scalars: np.ndarray
    paths: np.ndarray
    limits: np.ndarray


class LengthMemory(NamedTuple):
    """Path lengths [km] of one thread: events that wait (STACK, J), the path that goes on (J,); work space (J,)."""

    stack: np.ndarray
    path: np.ndarray
    work: np.ndarray


@njit(inner=True, **INNER)
def leg_light(air, layers, sun, w, options, at_start, weight, totals, memory, travelled, lengths):
    """I [sr^-1] of sunlight scattered or reflected once into memory.leg, times the path's weight and matrix; lengths
    (J,) [km sr^-1] += light x path length.

    at_start: n - 1 where the leg begins; weight: of the path; totals: `LegTotals`; travelled: `LengthMemory`, with the
    path up to the leg.
    """
    leg, to_sun, stream, matrix = memory.leg, memory.to_sun, memory.stream, memory.work.matrix
    path, whole_path = travelled.path, travelled.work
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
    for j in range(path.size):
        whole_path[j] = path[j]
    if grounded:
        add_reflected(air, layers, sun, w, to_sun, leg, totals, 1.0, whole_path)
    else:
        add_leg(layers.edges_km, radius, leg.chords, number, distance, 1.0, whole_path)
        add_sunbeam(layers, sun.beam, w, altitude, cosine, 1.0, whole_path)
    for j in range(path.size):
        lengths[j] += weight * chosen * whole * whole_path[j]
    return weight * light


@njit(inner=True, **INNER)
def lengths_to_events(air, layers, leg, last_chord, stack, first, end, travelled):
    """Fill rows first..end of travelled.stack for events just put on the stack: the path up to the leg, and on.

    leg: that they lie on, with chords up to `last_chord`; stack (STACK, EVENT_COLUMNS); travelled: `LengthMemory`.
    """
    for k in range(first, end):
        event = stack[k]
        number, s = place_on_leg(leg.chords, last_chord, event[POINT:HEADING], event[HEADING:ACROSS])
        for j in range(travelled.path.size):
            travelled.stack[k, j] = travelled.path[j]
        add_leg(layers.edges_km, air.earth_radius_km, leg.chords, number, s, 1.0, travelled.stack[k])


@njit(inner=True, **INNER)
def one_path_sample(air, layers, sun, importance, walk, w, at_observer, line_of_sight, memory, travelled, lengths):
    """(I of light scattered more than once, control variate, 1 if a limit was met) [sr^-1] of one sample, as
    `paths.one_sample`; lengths (J,) [km sr^-1] += light x path length.

    at_observer: n - 1 there; line_of_sight: `LegTotals` of memory.line_of_sight; travelled: `LengthMemory`.
    """
    leg, path = memory.leg, travelled.path
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
    size, drawn = push_first_events(air, w, walk, at_observer, line_of_sight, memory)
    control -= drawn
    if size < 0:
        return 0.0, 0.0, 1
    for j in range(path.size):
        path[j] = 0.0
    lengths_to_events(air, layers, memory.line_of_sight, line_of_sight.last_chord, memory.stack, 0, size, travelled)
    while size > 0:
        size -= 1
        event = memory.stack[size]
        order = int(event[ORDER])
        for j in range(path.size):
            path[j] = travelled.stack[size, j]
        weight = next_leg(air, importance, w, walk, event, unit, memory)
        if weight <= 0.0:
            continue
        at_start = refractivity_at(air, w, event[ALTITUDE]) if walk.later.bent else 0.0
        totals = trace(air, sun, importance, w, memory.work.new, memory.to_sun, gather, memory.stream, leg)
        if totals.n_pieces < 0:
            return light, control, 1
        light += leg_light(air, layers, sun, w, walk.later, at_start, weight, totals, memory, travelled, lengths)
        order += 1
        remaining = rescattered_light(leg, totals)
        control += weight * remaining
        if order < walk.max_orders and remaining > 0.0:
            copies, mean_copies = continuations(walk, weight * remaining / unit, order, memory.stream)
            if order >= MAX_EVENTS:
                limit_met = 1
            elif copies > 0:
                full, drawn = push_events(
                    air, w, walk, walk.later, at_start, leg, totals, weight / mean_copies, copies, order, size, memory
                )
                if full < 0:
                    return light, control, 1
                lengths_to_events(air, layers, leg, totals.last_chord, memory.stack, size, full, travelled)
                control -= drawn
                size = full
    return light, control, limit_met


@njit(cache=True, nogil=True)
def run_length_chunks(
    air, layers, sun, importance, walk, seed, pixels, jobs, first_job, end_job, single, single_lengths, sums
):
    """Run jobs and fill their rows of the sums.

    seed: an integer; pixels: `Pixels`; jobs: `ChunkJobs`; first_job, end_job: the first job and the one after the last;
    single (P, W) [sr^-1], single_lengths (P, W, J) [km sr^-1]: light scattered once, of `single_scattering`; sums:
    `LengthSums`, filled.
    """
    n_layers = layers.edges_km.size - 1
    memory = new_memory(air)
    travelled = LengthMemory(np.empty((STACK, n_layers)), np.empty(n_layers), np.empty(n_layers))
    lengths = np.empty(n_layers)
    for q in range(first_job, end_job):
        p, w = jobs.pixel[q], jobs.wavelength[q]
        line_of_sight = pixel_line_of_sight(air, sun, importance, walk, w, pixels, p, memory)
        at_observer = refractivity_at(air, w, pixels.altitude_km) if walk.first.bent else 0.0
        start(memory.stream, seed, pixels.key[p], pixels.wavelength_key[w], jobs.chunk[q])
        scalars, rows = sums.scalars[q], sums.paths[q]
        for _ in range(jobs.samples[q]):
            for j in range(n_layers):
                lengths[j] = single_lengths[p, w, j]
            light, control, limit = 0.0, 0.0, 1
            if line_of_sight.n_pieces >= 0:
                light, control, limit = one_path_sample(
                    air, layers, sun, importance, walk, w, at_observer, line_of_sight, memory, travelled, lengths
                )
            light += single[p, w]
            sums.limits[q] += limit
            scalars[LIGHT] += light
            scalars[LIGHT_SQUARE] += light * light
            scalars[CONTROL] += control
            scalars[CONTROL_SQUARE] += control * control
            scalars[LIGHT_CONTROL] += light * control
            for j in range(n_layers):
                rows[PATH, j] += lengths[j]
                rows[PATH_SQUARE, j] += lengths[j] * lengths[j]
                rows[LIGHT_PATH, j] += light * lengths[j]
                rows[CONTROL_PATH, j] += control * lengths[j]


@njit(cache=True, nogil=True)
def single_scattering(air, layers, sun, importance, walk, pixels, begin, end, light, lengths):
    """Fill light (P, W) [sr^-1] scattered once and lengths (P, W, J) [km sr^-1], light x path length, of pixels
    begin..end.

    pixels: `Pixels`.
    """
    memory = new_memory(air)
    for p in range(begin, end):
        for w in range(light.shape[1]):
            totals = pixel_line_of_sight(air, sun, importance, walk, w, pixels, p, memory)
            at_observer = refractivity_at(air, w, pixels.altitude_km) if walk.first.bent else 0.0
            light[p, w] = scattered_once_lengths(
                air, layers, sun, importance, w, walk.first, memory.to_sun, at_observer, totals, memory.line_of_sight,
                lengths[p, w],
            )  # fmt: skip
