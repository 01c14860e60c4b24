"""Chunks of paths, many in parallel: what pixels ask, the jobs that threads take, and the sums that they bring.

Arguments that kernels share: `kernel`.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from twilight.kernels import njit
from twilight.solvers.montecarlo.air import SPECIES
from twilight.solvers.montecarlo.directions import new_work
from twilight.solvers.montecarlo.events import EVENT_COLUMNS
from twilight.solvers.montecarlo.kernel import INNER
from twilight.solvers.montecarlo.lines import CHORD_COLUMNS, DIRECTION, ORIGIN, REFERENCE, refractivity_at
from twilight.solvers.montecarlo.matrix import N_STOKES
from twilight.solvers.montecarlo.paths import COARSE, N_ORDERS, STACK, TOTAL, Memory, one_sample
from twilight.solvers.montecarlo.pieces import LEG_CHORDS, LEG_PIECES, new_leg, without_ground
from twilight.solvers.montecarlo.random import start
from twilight.solvers.montecarlo.sight import SIGHT_CHORDS, SIGHT_PIECES, look


class Pixels(NamedTuple):
    """What is asked, P pixels: key (P,) names their random streams; sun_elevation, elevation, azimuth (P,) [rad],
    azimuth from the sun; altitude [km] of the observer; wavelength_key (W,); far_km (P,): where lines of sight end."""

    key: np.ndarray
    sun_elevation: np.ndarray
    elevation: np.ndarray
    azimuth: np.ndarray
    altitude: float
    wavelength_key: np.ndarray
    far_km: np.ndarray


class Jobs(NamedTuple):
    """J pieces of work, arrays (J,): pixel, index of the wavelength, number of the chunk, samples to take."""

    pixel: np.ndarray
    wavelength: np.ndarray
    chunk: np.ndarray
    samples: np.ndarray


class Sums(NamedTuple):
    """Results of J jobs: sums of x and of x^2 over samples, (J, S, N_ORDERS + 1), S = 3 components I, Q, U or 1; x is
    the light of each order and, last, of all.  high (J, 2): sums of x^3 and x^4 for all of I.  samples, limits (J,):
    samples taken, and those among them that met a limit of the walk."""

    first: np.ndarray
    second: np.ndarray
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


@njit(inner=True, **INNER)
def add_sample(orders, first, second):
    """Add one sample, and its squares, to the sums of a job; returns the whole I.

    orders (S, N_ORDERS + 1) [sr^-1]: light of the sample by Stokes element and order; first, second (S, TOTAL + 1):
    sums of the values [sr^-1] and of their squares [sr^-2].
    """
    intensity = 0.0
    for m in range(orders.shape[0]):
        total = orders[m, COARSE]
        for n in range(N_ORDERS):
            x = orders[m, n]
            first[m, n] += x
            second[m, n] += x * x
            total += x
        first[m, TOTAL] += total
        second[m, TOTAL] += total * total
        if m == 0:
            intensity = total
    return intensity


@njit(cache=True, nogil=True)
def sight_transmittance(air, sun, steering, walk, pixels, begin, end, out):
    """Transmittance of lines of sight, at all wavelengths.

    pixels: `Pixels`; begin, end: the first pixel and the one after the last; out (P, W): filled, transmittance in 0..1.
    """
    memory = new_leg(air.table.shape[2] - SPECIES, SIGHT_PIECES, SIGHT_CHORDS)
    ray = np.empty(CHORD_COLUMNS)
    to_sun = np.empty(3)
    for p in range(begin, end):
        for w in range(out.shape[1]):
            observer_ray(
                pixels.sun_elevation[p], pixels.elevation[p], pixels.azimuth[p], pixels.altitude,
                air.earth_radius_km, ray, to_sun,
            )  # fmt: skip
            out[p, w] = look(air, sun, steering, w, walk.first, ray, to_sun, pixels.far_km[p], memory).transmittance


@njit(cache=True, nogil=True)
def run_chunks(air, sight_air, sun, steering, walk, seed, pixels, jobs, first_job, end_job, sums, stop):
    """Run jobs and fill their rows of the sums.

    pixels: `Pixels`; jobs: `Jobs`; first_job, end_job: the first job and the one after the last; sums: `Sums`, filled;
    sight_air: the air that single scattering is seen through, the same as `air` unless events are isotropic; seed: an
    integer; stop (1,): no sample is begun once it is not 0.  A row depends on its job alone, so neither threads nor the
    order of jobs change it.
    """
    n_species = air.table.shape[2] - SPECIES
    sight_leg = new_leg(n_species, SIGHT_PIECES, SIGHT_CHORDS)
    leg = new_leg(n_species, LEG_PIECES, LEG_CHORDS)
    memory = Memory(sight_leg, leg, np.empty((STACK, EVENT_COLUMNS)), new_work())
    ray = np.empty(CHORD_COLUMNS)
    to_sun = np.empty(3)
    n_stokes = sums.first.shape[1]
    single = np.zeros(N_STOKES)
    orders = np.empty((n_stokes, N_ORDERS + 1))
    stream = np.empty(1, dtype=np.uint64)
    last_pixel = -1
    last_wavelength = -1
    sight = without_ground(0, -1, 0.0, 0.0, 0.0, 1.0)
    at_observer = 0.0
    for j in range(first_job, end_job):
        p = jobs.pixel[j]
        w = jobs.wavelength[j]
        if p != last_pixel or w != last_wavelength:
            last_pixel = p
            last_wavelength = w
            for own in range(2):
                if own == 0 and not air.isotropic_events:
                    continue
                observer_ray(
                    pixels.sun_elevation[p], pixels.elevation[p], pixels.azimuth[p], pixels.altitude,
                    air.earth_radius_km, ray, to_sun,
                )  # fmt: skip
                # light scattered once is seen through air that may not be the diffuse light's
                seen = air if own == 1 else sight_air
                sight = look(seen, sun, steering, w, walk.first, ray, to_sun, pixels.far_km[p], memory.sight)
                if own == 0 or not air.isotropic_events:
                    single[0] = sight.sun_i + sight.sun_ground
                    single[1] = sight.sun_q
                    single[2] = sight.sun_u
            if walk.first.bent:
                at_observer = refractivity_at(air, w, pixels.altitude)
        start(stream, seed, pixels.key[p], pixels.wavelength_key[w], jobs.chunk[j])
        for _ in range(jobs.samples[j]):
            if stop[0] != 0:
                break
            sums.samples[j] += 1
            orders[:] = 0.0
            for m in range(n_stokes):
                orders[m, 0] = single[m]
            if sight.pieces < 0:
                sums.limits[j] += 1
            else:
                sums.limits[j] += one_sample(
                    air, sun, steering, walk, w, at_observer, to_sun, sight, stream, memory, orders
                )
            total = add_sample(orders, sums.first[j], sums.second[j])
            sums.high[j, 0] += total * total * total
            sums.high[j, 1] += total * total * total * total
