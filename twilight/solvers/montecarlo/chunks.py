"""Chunks of paths, many in parallel: what pixels ask, the jobs that threads take, and the sums that they bring.

Arguments that kernels share: `kernel`.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from twilight.jit.kernels import njit
from twilight.solvers.montecarlo.air import SPECIES
from twilight.solvers.montecarlo.directions import new_workspace
from twilight.solvers.montecarlo.events import EVENT_COLUMNS
from twilight.solvers.montecarlo.kernel import INNER
from twilight.solvers.montecarlo.line_of_sight import (
    LINE_OF_SIGHT_CHORDS,
    LINE_OF_SIGHT_PIECES,
    integrate_line_of_sight,
)
from twilight.solvers.montecarlo.matrix import N_STOKES
from twilight.solvers.montecarlo.paths import CONTROL_VARIATE, N_ORDERS, STACK, TOTAL, PathMemory, one_sample
from twilight.solvers.montecarlo.pieces import LEG_CHORDS, LEG_PIECES, new_leg, without_ground
from twilight.solvers.montecarlo.random import start
from twilight.solvers.montecarlo.rays import CHORD_COLUMNS, DIRECTION, ORIGIN, REFERENCE, refractivity_at


class Pixels(NamedTuple):
    """What is asked, P pixels.

    key (P,): names their random streams; sun_elevation_rad, elevation_rad, azimuth_rad (P,): azimuth from the sun;
    altitude_km: of the observer; wavelength_key (W,); far_km (P,): where lines of sight end.
    """

    key: np.ndarray
    sun_elevation_rad: np.ndarray
    elevation_rad: np.ndarray
    azimuth_rad: np.ndarray
    altitude_km: float
    wavelength_key: np.ndarray
    far_km: np.ndarray


class ChunkJobs(NamedTuple):
    """J chunks of samples to take, arrays (J,).

    pixel, wavelength: indices; arm: 0 or 1, see `tally`; chunk: number that names the random stream; samples: how many.
    """

    pixel: np.ndarray
    wavelength: np.ndarray
    arm: np.ndarray
    chunk: np.ndarray
    samples: np.ndarray


class ChunkSums(NamedTuple):
    """Results of J jobs.

    sums, squares (J, S, N_ORDERS + 1): of x [sr^-1] and x^2 over samples, S = 3 components I, Q, U or 1; x is the light
    of each order and, last, of all.  high (J, 2): sums of x^3 and x^4 for all of I.  samples, limits (J,): samples
    taken, and those among them that met a limit of the walk.
    """

    sums: np.ndarray
    squares: np.ndarray
    high: np.ndarray
    samples: np.ndarray
    limits: np.ndarray


@njit(**INNER)
def observer_ray(sun_elevation, elevation, azimuth, altitude, radius, ray, to_sun):
    """Fill ray (9,) and to_sun (3,) in the observer's Cartesian frame (towards the sun, to its right, up).

    sun_elevation, elevation, azimuth [rad]: of the sun and of the line of sight; altitude, radius [km]: of the observer
    above the Earth's sphere, and of that sphere.  The reference of the Stokes vector lies in the vertical plane of the
    azimuth, also in the zenith, so that Q > 0 is light that vibrates vertically; azimuths grow to the right, and U > 0
    is light whose vibration leans from the vertical to the right.
    """
    ray[ORIGIN], ray[ORIGIN + 1], ray[ORIGIN + 2] = 0.0, 0.0, radius + altitude
    ray[DIRECTION] = math.cos(elevation) * math.cos(azimuth)
    ray[DIRECTION + 1] = math.cos(elevation) * math.sin(azimuth)
    ray[DIRECTION + 2] = math.sin(elevation)
    ray[REFERENCE] = -math.sin(elevation) * math.cos(azimuth)
    ray[REFERENCE + 1] = -math.sin(elevation) * math.sin(azimuth)
    ray[REFERENCE + 2] = math.cos(elevation)
    to_sun[0], to_sun[1], to_sun[2] = math.cos(sun_elevation), 0.0, math.sin(sun_elevation)


@njit(inner=True, cache=True)
def new_memory(air):
    """`PathMemory` of one thread."""
    n_species = air.table.shape[2] - SPECIES
    return PathMemory(
        new_leg(n_species, LINE_OF_SIGHT_PIECES, LINE_OF_SIGHT_CHORDS),
        new_leg(n_species, LEG_PIECES, LEG_CHORDS),
        np.empty((STACK, EVENT_COLUMNS)),
        new_workspace(),
        np.empty(CHORD_COLUMNS),
        np.empty(3),
        np.empty(1, dtype=np.uint64),
    )


@njit(inner=True, **INNER)
def pixel_line_of_sight(air, sun, importance, walk, w, pixels, p, memory):
    """Follow the line of sight of a pixel into memory.line_of_sight; returns its `LegTotals`, and fills memory.to_sun.

    pixels: `Pixels`; p: index of the pixel.
    """
    observer_ray(
        pixels.sun_elevation_rad[p], pixels.elevation_rad[p], pixels.azimuth_rad[p], pixels.altitude_km,
        air.earth_radius_km, memory.ray, memory.to_sun,
    )  # fmt: skip
    return integrate_line_of_sight(
        air, sun, importance, w, walk.first, memory.ray, memory.to_sun, pixels.far_km[p], memory.line_of_sight
    )


@njit(inner=True, **INNER)
def add_sample(orders, sums, squares):
    """Add one sample, and its squares, to the sums of a job; returns the whole I.

    orders (S, N_ORDERS + 1) [sr^-1]: light of the sample by Stokes element and order; sums, squares (S,
    TOTAL + 1): of the values [sr^-1] and of their squares [sr^-2].
    """
    intensity = 0.0
    for m in range(orders.shape[0]):
        total = orders[m, CONTROL_VARIATE]
        for n in range(N_ORDERS):
            x = orders[m, n]
            sums[m, n] += x
            squares[m, n] += x * x
            total += x
        sums[m, TOTAL] += total
        squares[m, TOTAL] += total * total
        if m == 0:
            intensity = total
    return intensity


@njit(cache=True, nogil=True)
def line_of_sight_transmittance(air, sun, importance, walk, pixels, begin, end, out):
    """Transmittance of lines of sight, at all wavelengths.

    pixels: `Pixels`; begin, end: the first pixel and the one after the last; out (P, W): filled, transmittance in 0..1.
    """
    memory = new_memory(air)
    for p in range(begin, end):
        for w in range(out.shape[1]):
            out[p, w] = pixel_line_of_sight(air, sun, importance, walk, w, pixels, p, memory).transmittance


@njit(cache=True, nogil=True)
def run_chunks(air, line_of_sight_air, sun, importance, walk, seed, pixels, jobs, first_job, end_job, sums, stop):
    """Run jobs and fill their rows of the sums.

    line_of_sight_air: the air that single scattering is seen through, the same as `air` unless events are isotropic;
    seed: an integer; pixels: `Pixels`; jobs: `ChunkJobs`; first_job, end_job: the first job and the one after the last;
    sums: `ChunkSums`, filled; stop (1,): no sample is begun once it is not 0.  A row depends on its job alone, so
    neither threads nor the order of jobs change it.
    """
    memory = new_memory(air)
    n_stokes = sums.sums.shape[1]
    single = np.zeros(N_STOKES)
    orders = np.empty((n_stokes, N_ORDERS + 1))
    last_pixel = -1
    last_wavelength = -1
    line_of_sight = without_ground(0, -1, 0.0, 0.0, 0.0, 1.0)
    at_observer = 0.0
    for j in range(first_job, end_job):
        p = jobs.pixel[j]
        w = jobs.wavelength[j]
        if p != last_pixel or w != last_wavelength:
            last_pixel = p
            last_wavelength = w
            line_of_sight = pixel_line_of_sight(line_of_sight_air, sun, importance, walk, w, pixels, p, memory)
            single[0] = line_of_sight.sun_i + line_of_sight.sun_ground
            single[1] = line_of_sight.sun_q
            single[2] = line_of_sight.sun_u
            if air.isotropic_events:
                # the air that scatters diffuse light is another one
                line_of_sight = pixel_line_of_sight(air, sun, importance, walk, w, pixels, p, memory)
            if walk.first.bent:
                at_observer = refractivity_at(air, w, pixels.altitude_km)
        start(memory.stream, seed, pixels.key[p], pixels.wavelength_key[w], jobs.chunk[j])
        for _ in range(jobs.samples[j]):
            if stop[0] != 0:
                break
            sums.samples[j] += 1
            orders[:] = 0.0
            for m in range(n_stokes):
                orders[m, 0] = single[m]
            if line_of_sight.n_pieces < 0:
                sums.limits[j] += 1
            else:
                sums.limits[j] += one_sample(air, sun, importance, walk, w, at_observer, line_of_sight, memory, orders)
            total = add_sample(orders, sums.sums[j], sums.squares[j])
            sums.high[j, 0] += total * total * total
            sums.high[j, 1] += total * total * total * total
