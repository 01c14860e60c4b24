"""How a coefficient goes between two levels: exponentially, or linearly where one end is 0.

    a(f) = a0^(1-f) a1^f,   mean = (a1 - a0) / ln(a1/a0),   f the fraction of the way from the lower level to the upper.

The rule of all coefficients but the scattering and the refractivity of air (:mod:`twilight.atmosphere.steffen`).
"""

from __future__ import annotations

import numpy as np


def interpolate_coefficient(lower, upper, fraction):
    """The coefficient at a fraction of the way between its values at two levels; arrays broadcast."""
    positive = (lower > 0) & (upper > 0)
    lo = np.where(positive, lower, 1.0)
    hi = np.where(positive, upper, 1.0)
    return np.where(positive, lo * (hi / lo) ** fraction, lower * (1 - fraction) + upper * fraction)


def layer_mean(lower, upper):
    """Mean of a coefficient between two levels, in the same unit; without cancellation where both are close."""
    positive = (lower > 0) & (upper > 0)
    lo = np.where(positive, lower, 1.0)
    q = np.log(np.where(positive, upper, 1.0) / lo)
    small = np.abs(q) < 1e-6
    mean = lo * np.where(small, 1.0 + 0.5 * q, np.expm1(q) / np.where(small, 1.0, q))
    return np.where(positive, mean, 0.5 * (lower + upper))


def vertical_integral(coefficient: np.ndarray, altitude_km: np.ndarray) -> np.ndarray:
    """Integral (...) over all levels of a coefficient (L, ...) at altitudes (L,) [km]."""
    thickness = np.diff(altitude_km).reshape(-1, *([1] * (coefficient.ndim - 1)))
    return np.sum(layer_mean(coefficient[:-1], coefficient[1:]) * thickness, axis=0)
