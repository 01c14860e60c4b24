"""Chunks of paths, many in parallel: what pixels ask, the jobs that threads take, and the sums over all samples.

Sums are kept for every pixel, wavelength, component and order, in two arms that set each other's sample counts.
Stopping on the error estimated from the same samples biases the mean: a run of dark samples looks precise and stops
early.  So how many more samples an arm takes is decided by the other arm alone, and the arms' means are averaged with
equal weight.  Only a pixel that still misses its target after several rounds, which takes a rare bright sample in one
arm, goes on in both by the larger of the two counts.

Arguments that kernels share: `kernel`.
"""

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from twilight.jit.kernels import njit
from twilight.solvers.montecarlo.air import SPECIES
from twilight.solvers.montecarlo.events import EVENT_COLUMNS, N_ORDERS, new_workspace
from twilight.solvers.montecarlo.kernel import INNER, N_STOKES, start
from twilight.solvers.montecarlo.leg import LEG_CHORDS, LEG_PIECES, new_leg, without_ground
from twilight.solvers.montecarlo.line_of_sight import (
    LINE_OF_SIGHT_CHORDS,
    LINE_OF_SIGHT_PIECES,
    integrate_line_of_sight,
)
from twilight.solvers.montecarlo.paths import CONTROL_VARIATE, STACK, TOTAL, PathMemory, one_sample
from twilight.solvers.montecarlo.rays import CHORD_COLUMNS, DIRECTION, ORIGIN, REFERENCE, refractivity_at

N_ARMS = 2
"""Halves of the samples of a pixel that set each other's number."""
SKEWNESS_FACTOR = 1.75
"""The mean of n skewed samples strays from the truth, in units of its own estimated error, with the variance
1 + (2 + 7/4 skewness^2) / n to first order (Edgeworth expansion of Student's t; Hall 1987, Ann. Prob. 15, 920)."""
UNTRUSTED = 0.5
"""Relative error of the variance beyond which a standard error of more than SMALL is not to be trusted."""
SMALL = 0.05
"""Relative error of the mean up to which it is known, whatever its variance hangs on."""
FEWEST, FEWEST_IN_THICK_AIR = 8, 128
"""Samples of an arm below which a standard error is not to be trusted, unless they are all the same; the second one
where the vertical optical depth is above THICK_DEPTH, where one sample in a hundred may hold a tenth of the light."""
THICK_DEPTH = 3.0
"""See FEWEST_IN_THICK_AIR."""
UNCERTAIN = 0.1
"""Relative error of the mean beyond which it is not to be trusted: light is not negative, so that so uncertain a mean
hangs on a few bright samples, whether they came or not.  In odd air without an importance function, means with 0.2 were
up to ten standard errors too low, and with 0.1 none (`tests/solvers/test_montecarlo_coverage.py`)."""
MAX_CONTROL_FRACTION = 0.25
"""Fraction of the light that may come from the control variate, whose mean is 0, in an answer that is trusted."""
GROWTH = 64
"""Most by which the samples of a pixel grow in one round, so that no pilot with one bright sample asks for millions."""
MISSED = 1.5
"""Late rounds go on with pixels whose error is larger than the target by this factor."""


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

    pixel, wavelength: indices; arm: 0 or 1, see `Tally`; chunk: number that names the random stream; samples: how many.
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


@dataclass(frozen=True)
class MonteCarloResult:
    """Sun-normalised radiance L/F0 [sr^-1] with its noise; arrays (..., W), orders (N_ORDERS, ..., W).

    radiance, standard_error: mean and its standard deviation; nan where too few paths found light to know them
    (`Tally.unknown`).
    order_radiance[n], order_standard_error[n]: of light scattered n + 1 times, a reflection by the ground being one;
    the last entry holds the rest.  The first one is known everywhere, and a lower bound of the radiance.
    samples: samples taken. limited: samples that met a safety limit of the walk (0 in any sane medium).
    complete: False if a limit of time or samples ended the run before twice the target.
    """

    radiance: np.ndarray
    standard_error: np.ndarray
    order_radiance: np.ndarray
    order_standard_error: np.ndarray
    samples: np.ndarray
    limited: int
    complete: bool


@dataclass(frozen=True)
class StokesResult:
    """Sun-normalised Stokes vectors I, Q, U [sr^-1] with their noise: arrays (..., 3, W); samples (..., W).

    The signs are those of :meth:`twilight.solvers.montecarlo.MonteCarloField.stokes`; the rest is as in
    `MonteCarloResult`.
    """

    stokes: np.ndarray
    standard_error: np.ndarray
    samples: np.ndarray
    limited: int
    complete: bool


class Tally:
    """Running sums: count (P, W, 2); sums, squares (P, W, 2, S, N_ORDERS + 1), the last column being the total;
    high (P, W, 2, 2): of the third and fourth power of all of I; fewest (W,): samples of an arm that tell its error."""

    def __init__(self, n_pixels: int, n_stokes: int, optical_depth: np.ndarray):
        """optical_depth (W,): the vertical one of the air."""
        n_wavelengths = optical_depth.size
        self.fewest = np.where(optical_depth > THICK_DEPTH, FEWEST_IN_THICK_AIR, FEWEST)
        self.count = np.zeros((n_pixels, n_wavelengths, N_ARMS), dtype=np.int64)
        self.sums = np.zeros((n_pixels, n_wavelengths, N_ARMS, n_stokes, N_ORDERS + 1))
        self.squares = np.zeros_like(self.sums)
        self.high = np.zeros((n_pixels, n_wavelengths, N_ARMS, 2))
        self.limited = 0

    def add(self, jobs: ChunkJobs, sums: ChunkSums) -> None:
        """Add the rows of jobs one after the other."""
        where = (jobs.pixel, jobs.wavelength, jobs.arm)
        np.add.at(self.count, where, sums.samples)
        np.add.at(self.high, where, sums.high)
        np.add.at(self.sums, where, sums.sums)
        np.add.at(self.squares, where, sums.squares)
        self.limited += int(sums.limits.sum())

    def moments(self, which: tuple) -> tuple[np.ndarray, np.ndarray]:
        """Means and variances of a mean, per arm, (P, W, 2, ...); which: components and orders."""
        index = (slice(None), slice(None), slice(None), *which)
        sums, squares = self.sums[index], self.squares[index]
        n = self.count.reshape(*self.count.shape, *([1] * (sums.ndim - 3))).astype(float)
        with np.errstate(invalid="ignore", divide="ignore"):
            mean = sums / n
            variance = np.maximum(squares / n - mean**2, 0.0) / (n - 1)
            skewness = self.shape_of_samples()[0].reshape(n.shape)
            variance *= 1.0 + SKEWNESS_FACTOR * skewness**2 / n
        return mean, variance

    def means(self, which: tuple) -> tuple[np.ndarray, np.ndarray]:
        """Means of both arms and their standard errors, (P, W, ...); which: components and orders."""
        mean, variance = self.moments(which)
        return mean.mean(axis=2), np.sqrt(variance.sum(axis=2)) / N_ARMS

    def shape_of_samples(self) -> tuple[np.ndarray, np.ndarray]:
        """Skewness and kurtosis of the samples of I, per arm, each (P, W, 2); 0 and 3 where they do not vary."""
        n = np.maximum(self.count, 1).astype(float)
        m1, m2 = self.sums[..., 0, TOTAL] / n, self.squares[..., 0, TOTAL] / n
        m3, m4 = self.high[..., 0] / n, self.high[..., 1] / n
        variance = m2 - m1**2
        varies = variance > 1e-12 * m1**2
        scale = np.where(varies, variance, 1.0)
        skewness = np.where(varies, (m3 - 3 * m1 * m2 + 2 * m1**3) / scale**1.5, 0.0)
        kurtosis = np.where(varies, (m4 - 4 * m1 * m3 + 6 * m1**2 * m2 - 3 * m1**4) / scale**2, 3.0)
        return skewness, kurtosis

    def unknown(self) -> np.ndarray:
        """Where (P, W) the error of the mean is not known, because too few paths found light.

        That is where samples vary and an arm has too few of them, or the error is more than UNCERTAIN of the mean, or
        more than SMALL of it and the variance known to no better than UNTRUSTED of itself, sqrt((kurtosis - 1) / n);
        and where the control variate, which light that no path found yet leaves behind, is more than
        MAX_CONTROL_FRACTION of the mean.
        """
        _, kurtosis = self.shape_of_samples()
        doubt = np.sqrt((np.maximum(kurtosis - 1.0, 0.0) / np.maximum(self.count, 1)).mean(axis=-1) / N_ARMS)
        mean, variance = self.moments((0, slice(None)))
        varies = np.any(variance[..., TOTAL] != 0.0, axis=-1)
        error = self.relative_error()
        mean = mean.mean(axis=2)
        control = np.abs(mean[..., TOTAL] - mean[..., :N_ORDERS].sum(axis=-1))
        by_control = control > MAX_CONTROL_FRACTION * np.abs(mean[..., TOTAL])
        few = self.count.min(axis=-1) < self.fewest
        return by_control | varies & (few | (error > UNCERTAIN) | (error > SMALL) & (doubt > UNTRUSTED))

    def wanted(self, target: float, max_samples: int, late: bool) -> np.ndarray:
        """Samples (P, W, 2) each arm should have in all, judged from the other arm: v / (2 (target mean)^2).

        No more than GROWTH times those it has.  late: only pixels whose error is above MISSED times the target go on,
        both arms by the larger of the two counts, and those that are unknown by twice as many.
        """
        mean, variance = self.moments((0, TOTAL))
        with np.errstate(invalid="ignore", divide="ignore"):
            # a mean that is not positive yet says nothing of the error asked for: go on with twice as many
            more = np.where(variance > 0, 2.0 * self.count, 0.0)
            n = np.where(mean > 0, variance * self.count / (2.0 * (target * mean) ** 2), more)
        n = np.nan_to_num(n, nan=0.0, posinf=max_samples)[..., ::-1]
        if late:
            unknown = self.unknown()[..., None]
            missed = unknown | (self.relative_error() > MISSED * target)[..., None]
            least = np.where(unknown, 2.0, 1.25) * self.count
            n = np.where(missed, np.maximum(n.max(axis=-1, keepdims=True), least), 0.0)
        n = np.minimum(n, GROWTH * self.count)
        return np.minimum(np.ceil(n), max_samples // N_ARMS).astype(np.int64)

    def relative_error(self) -> np.ndarray:
        """Standard error over mean (P, W); 0 for a black pixel, infinite where the mean is not positive yet."""
        mean, error = self.means((0, TOTAL))
        return np.where(mean > 0, error / np.where(mean > 0, mean, 1.0), np.where(error > 0, np.inf, 0.0))

    def result(self, shape: tuple[int, ...], complete: bool) -> MonteCarloResult:
        """Means and errors of I with the pixels in `shape`."""
        mean, error = self.means((0, slice(None)))
        # light scattered once has no noise
        mean[self.unknown(), 1:] = error[self.unknown(), 1:] = np.nan
        full = (*shape, self.count.shape[1])

        def orders_first(a):
            return np.moveaxis(a[..., :N_ORDERS], -1, 0).reshape(N_ORDERS, *full)

        return MonteCarloResult(
            mean[..., TOTAL].reshape(full),
            error[..., TOTAL].reshape(full),
            orders_first(mean),
            orders_first(error),
            self.count.sum(axis=-1).reshape(full),
            self.limited,
            complete,
        )

    def stokes(self, shape: tuple[int, ...], complete: bool) -> StokesResult:
        """Means and errors of I, Q, U with the pixels in `shape`."""
        mean, error = (np.moveaxis(values, -1, 1) for values in self.means((slice(None), TOTAL)))
        unknown = np.broadcast_to(self.unknown()[:, None], mean.shape)
        mean[unknown] = error[unknown] = np.nan
        full = (*shape, self.count.shape[1])
        return StokesResult(
            mean.reshape(*shape, *mean.shape[1:]),
            error.reshape(*shape, *mean.shape[1:]),
            self.count.sum(axis=-1).reshape(full),
            self.limited,
            complete,
        )
