"""Sums over samples for every pixel, wavelength, component and order, in two arms that set each other's sample counts.

Stopping on the error estimated from the same samples biases the mean: a run of dark samples looks precise and stops
early.  Here the samples of a pixel come in two arms; how many more an arm takes is decided by the other arm alone, and
the arms' means are averaged with equal weight.  Only a pixel that still misses its target after several rounds, which
takes a rare bright sample in one arm, goes on in both by the larger of the two counts.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from twilight.solvers.montecarlo.chunks import ChunkJobs, ChunkSums
from twilight.solvers.montecarlo.paths import N_ORDERS, TOTAL

N_ARMS = 2
"""Halves of the samples of a pixel that set each other's number."""
SKEWNESS_FACTOR = 1.75
"""The mean of n skewed samples strays from the truth, in units of its own estimated error, with the variance
1 + (2 + 7/4 skewness^2) / n to first order (Edgeworth expansion of Student's t; Hall 1987, Ann. Prob. 15, 920)."""
UNTRUSTED = 0.5
"""Relative error of the variance beyond which a standard error is not to be trusted."""
FEWEST = 8
"""Samples of an arm below which a standard error is not to be trusted, unless they are all the same."""
UNCERTAIN = 0.25
"""Relative error of the mean beyond which it is not to be trusted: light is not negative, so that so uncertain a mean
hangs on a few bright samples, whether they came or not."""
MAX_CONTROL_FRACTION = 0.25
"""Fraction of the light that may come from the control variate, whose mean is 0, in an answer that is trusted."""
GROWTH = 64
"""Most by which the samples of a pixel grow in one round, so that no pilot with one bright sample asks for millions."""
MISSED = 1.5
"""Late rounds go on with pixels whose error is larger than the target by this factor."""


@dataclass(frozen=True)
class MonteCarloResult:
    """Sun-normalised radiance L/F0 [sr^-1] with its noise; arrays (..., W), orders (N_ORDERS, ..., W).

    order_radiance[n]: light scattered n + 1 times, a reflection by the ground being one; the last entry holds the rest.
    standard_error, order_standard_error: one standard deviation of the means; nan where fewer than 2 samples an arm.
    samples: samples taken. limited: samples that met a safety limit of the walk (0 in any sane medium).
    untrusted (..., W): a few bright samples hold most of the variance, so that the error may be larger than stated.
    complete: False if a limit of time or samples ended the run before twice the target.
    """

    radiance: np.ndarray
    standard_error: np.ndarray
    order_radiance: np.ndarray
    order_standard_error: np.ndarray
    samples: np.ndarray
    untrusted: np.ndarray
    limited: int
    complete: bool


@dataclass(frozen=True)
class StokesResult:
    """Sun-normalised Stokes vectors I, Q, U [sr^-1] with their noise: arrays (..., 3, W); samples, untrusted (..., W).

    The signs are those of :meth:`twilight.solvers.montecarlo.Field.stokes`; the rest is as in `MonteCarloResult`.
    """

    stokes: np.ndarray
    standard_error: np.ndarray
    samples: np.ndarray
    untrusted: np.ndarray
    limited: int
    complete: bool


class Tally:
    """Running sums: count (P, W, 2); sums, squares (P, W, 2, S, N_ORDERS + 1), the last column being the total;
    high (P, W, 2, 2): of the third and fourth power of all of I."""

    def __init__(self, n_pixels: int, n_wavelengths: int, n_stokes: int):
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

    def untrusted(self) -> np.ndarray:
        """Where (P, W) the variance itself is known to no better than UNTRUSTED of itself: sqrt((kurtosis - 1) / n).

        And where an arm has fewer than FEWEST samples that vary, the error is more than UNCERTAIN of the mean, or the
        control variate, which light that no path found yet leaves behind, is more than MAX_CONTROL_FRACTION of it.
        """
        _, kurtosis = self.shape_of_samples()
        doubt = np.maximum(kurtosis - 1.0, 0.0) / np.maximum(self.count, 1)
        mean, variance = self.moments((0, slice(None)))
        few = (self.count.min(axis=-1) < FEWEST) & np.any(variance[..., TOTAL] != 0.0, axis=-1)
        mean = mean.mean(axis=2)
        control = np.abs(mean[..., TOTAL] - mean[..., :N_ORDERS].sum(axis=-1))
        by_control = control > MAX_CONTROL_FRACTION * np.abs(mean[..., TOTAL])
        unknown = np.sqrt(doubt.mean(axis=-1) / N_ARMS) > UNTRUSTED
        return few | by_control | (self.relative_error() > UNCERTAIN) | unknown

    def wanted(self, target: float, max_samples: int, late: bool) -> np.ndarray:
        """Samples (P, W, 2) each arm should have in all, judged from the other arm: v / (2 (target mean)^2).

        No more than GROWTH times those it has.  late: only pixels whose error is above MISSED times the target go on,
        and both arms by the larger of the two counts.
        """
        mean, variance = self.moments((0, TOTAL))
        with np.errstate(invalid="ignore", divide="ignore"):
            # a mean that is not positive yet says nothing of the error asked for: go on with twice as many
            more = np.where(variance > 0, 2.0 * self.count, 0.0)
            n = np.where(mean > 0, variance * self.count / (2.0 * (target * mean) ** 2), more)
        n = np.nan_to_num(n, nan=0.0, posinf=max_samples)[..., ::-1]
        if late:
            missed = self.relative_error() > MISSED * target
            n = np.where(missed[..., None], np.maximum(n.max(axis=-1, keepdims=True), 1.25 * self.count), 0.0)
        n = np.minimum(n, GROWTH * self.count)
        return np.minimum(np.ceil(n), max_samples // N_ARMS).astype(np.int64)

    def relative_error(self) -> np.ndarray:
        """Standard error over mean (P, W); 0 for a black pixel, infinite where the mean is not positive yet."""
        mean, error = self.means((0, TOTAL))
        return np.where(mean > 0, error / np.where(mean > 0, mean, 1.0), np.where(error > 0, np.inf, 0.0))

    def result(self, shape: tuple[int, ...], complete: bool) -> MonteCarloResult:
        """Means and errors of I with the pixels in `shape`."""
        mean, error = self.means((0, slice(None)))
        full = (*shape, self.count.shape[1])

        def orders_first(a):
            return np.moveaxis(a[..., :N_ORDERS], -1, 0).reshape(N_ORDERS, *full)

        return MonteCarloResult(
            mean[..., TOTAL].reshape(full),
            error[..., TOTAL].reshape(full),
            orders_first(mean),
            orders_first(error),
            self.count.sum(axis=-1).reshape(full),
            self.untrusted().reshape(full),
            self.limited,
            complete,
        )

    def stokes(self, shape: tuple[int, ...], complete: bool) -> StokesResult:
        """Means and errors of I, Q, U with the pixels in `shape`."""
        mean, error = (np.moveaxis(values, -1, 1) for values in self.means((slice(None), TOTAL)))
        full = (*shape, self.count.shape[1])
        return StokesResult(
            mean.reshape(*shape, *mean.shape[1:]),
            error.reshape(*shape, *mean.shape[1:]),
            self.count.sum(axis=-1).reshape(full),
            self.untrusted().reshape(full),
            self.limited,
            complete,
        )
