"""Sums over samples for every pixel, wavelength, component and order, in two arms that set each other's sample counts.

Stopping on the error estimated from the same samples biases the mean: a run of dark samples looks precise and stops
early.  Here the samples of a pixel come in two arms; how many more an arm takes is decided by the other arm alone, and
the arms' means are averaged with equal weight.  Only a pixel that still misses its target after several rounds, which
takes a rare bright sample in one arm, goes on in both by the larger of the two counts.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from twilight.solvers.montecarlo.paths import N_ORDERS, TOTAL

N_ARMS = 2


@dataclass(frozen=True)
class MonteCarloResult:
    """Sun-normalised radiance L/F0 [sr^-1] with its noise; arrays (..., W), orders (N_ORDERS, ..., W).

    order_radiance[n]: light with n + 1 events, a reflection by the ground being one; the last entry holds the rest.
    standard_error, order_standard_error: one standard deviation of the means; nan where fewer than 2 samples an arm.
    samples: samples taken. limited: samples that met a safety limit of the walk (0 in any sane medium).
    complete: False if a time limit ended the run before the target.
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
    """Sun-normalised Stokes vectors [sr^-1] with their noise; arrays (..., 3, W) of I, Q, U, but samples (..., W).

    The signs are those of :meth:`twilight.solvers.montecarlo.Field.stokes`; the rest is as in `MonteCarloResult`.
    """

    stokes: np.ndarray
    standard_error: np.ndarray
    samples: np.ndarray
    limited: int
    complete: bool


class Tally:
    """Running sums: count (P, W, 2); sums, squares (P, W, 2, S, N_ORDERS + 1), the last column being the total."""

    def __init__(self, n_pixels: int, n_wavelengths: int, n_stokes: int):
        self.count = np.zeros((n_pixels, n_wavelengths, N_ARMS), dtype=np.int64)
        self.sums = np.zeros((n_pixels, n_wavelengths, N_ARMS, n_stokes, N_ORDERS + 1))
        self.squares = np.zeros_like(self.sums)
        self.limited = 0

    def add(self, pixel, wavelength, arm, samples, sums) -> None:
        """Add rows of jobs, `Sums`, one after the other."""
        where = (pixel, wavelength, arm)
        np.add.at(self.count, where, samples)
        np.add.at(self.sums, where, sums.first)
        np.add.at(self.squares, where, sums.second)
        self.limited += int(sums.limits.sum())

    def moments(self, which=np.s_[:, :]):
        """Means and variances of a mean, per arm, (P, W, 2, ...); which: components and orders."""
        index = (slice(None), slice(None), slice(None), *which)
        sums, squares = self.sums[index], self.squares[index]
        n = self.count.reshape(*self.count.shape, *([1] * (sums.ndim - 3))).astype(float)
        with np.errstate(invalid="ignore", divide="ignore"):
            mean = sums / n
            variance = np.maximum(squares / n - mean**2, 0.0) / (n - 1)
        return mean, variance

    def wanted(self, target: float, max_samples: int) -> np.ndarray:
        """Samples (P, W, 2) each arm should have in all, judged from the other arm: v / (2 (target mean)^2)."""
        mean, variance = self.moments((0, TOTAL))
        with np.errstate(invalid="ignore", divide="ignore"):
            # a mean that is not positive yet says nothing of the error asked for: go on with twice as many
            more = np.where(variance > 0, 2.0 * self.count, 0.0)
            n = np.where(mean > 0, variance * self.count / (2.0 * (target * mean) ** 2), more)
        n = np.nan_to_num(n, nan=0.0, posinf=max_samples)
        return np.minimum(np.ceil(n), max_samples // N_ARMS).astype(np.int64)[..., ::-1]

    def relative_error(self) -> np.ndarray:
        """Standard error over mean (P, W); 0 for a black pixel, infinite where the mean is not positive yet."""
        mean, variance = self.moments((0, TOTAL))
        m = mean.mean(axis=-1)
        error = 0.5 * np.sqrt(variance.sum(axis=-1))
        return np.where(m > 0, error / np.where(m > 0, m, 1.0), np.where(error > 0, np.inf, 0.0))

    def result(self, shape: tuple[int, ...], complete: bool) -> MonteCarloResult:
        """Means and errors of I with the pixels in `shape`."""
        mean, variance = self.moments((0, slice(None)))
        mean = mean.mean(axis=2)
        error = np.sqrt(variance.sum(axis=2)) / N_ARMS
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
        mean, variance = self.moments((slice(None), TOTAL))
        mean = np.moveaxis(mean.mean(axis=2), -1, 1)
        error = np.moveaxis(np.sqrt(variance.sum(axis=2)), -1, 1) / N_ARMS
        full = (*shape, *mean.shape[1:])
        return StokesResult(
            mean.reshape(full),
            error.reshape(full),
            self.count.sum(axis=-1).reshape(*shape, self.count.shape[1]),
            self.limited,
            complete,
        )
