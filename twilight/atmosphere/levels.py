"""Interpolation of a coefficient between two levels: exponential, or linear where one end is 0.

    a(f) = a0^(1-f) a1^f,   mean = (a1 - a0) / ln(a1/a0),   f the fraction of the way from the lower level to the upper.

The rule of all coefficients but the scattering and the refractivity of air, which follow Steffen's monotone cubics: the
slope is continuous at every point, and the curve stays between the values at the ends of each interval, so that no
inversion and no duct appears which the points do not have; through points of a straight line it is that line.

References
----------
Steffen 1990, Astron. Astrophys. 239, 443.
"""

import numpy as np

from twilight.base.conventions import ROUNDING


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


def monotone_slopes(x, y) -> np.ndarray:
    """dy/dx (N, ...) of the curve through y (N, ...) at the increasing x (N,), N at least 2."""
    x, y = np.asarray(x, dtype=float), np.asarray(y, dtype=float)
    h = np.diff(x).reshape(-1, *([1] * (y.ndim - 1)))
    s = np.diff(y, axis=0) / h
    if len(s) == 1:
        return np.concatenate([s, s])
    parabola = (s[:-1] * h[1:] + s[1:] * h[:-1]) / (h[:-1] + h[1:])
    least = np.minimum(np.minimum(np.abs(s[:-1]), np.abs(s[1:])), 0.5 * np.abs(parabola))
    inner = (np.sign(s[:-1]) + np.sign(s[1:])) * least
    return np.concatenate([_at_end(s[:1], s[1:2], h[:1], h[1:2]), inner, _at_end(s[-1:], s[-2:-1], h[-1:], h[-2:-1])])


def _at_end(s, s_next, h, h_next):
    """Slope at an end, of the parabola through the three outermost points, limited so that the curve stays monotone.

    s, h: secant slope and width of the outermost interval; s_next, h_next: of the one beside it.
    """
    slope = s + (s - s_next) * h / (h + h_next)
    return np.where(slope * s <= 0.0, 0.0, np.sign(s) * np.minimum(np.abs(slope), 2.0 * np.abs(s)))


def cubic_piece(lower, upper, lower_change, upper_change):
    """Coefficients (c1, c2, c3) of `lower` + c1 f + c2 f^2 + c3 f^3 on 0 <= f <= 1; changes are dy/df at both ends."""
    rise = upper - lower
    return lower_change, 3.0 * rise - 2.0 * lower_change - upper_change, lower_change + upper_change - 2.0 * rise


def monotone_cubic(z, x, y) -> np.ndarray:
    """The curve through y (N,) at the increasing x (N,), at z of any shape, constant outside."""
    x, y = np.asarray(x, dtype=float), np.asarray(y, dtype=float)
    slope = monotone_slopes(x, y)
    i = np.clip(np.searchsorted(x, z, side="right") - 1, 0, x.size - 2)
    h = x[i + 1] - x[i]
    f = np.clip((z - x[i]) / h, 0.0, 1.0)
    c1, c2, c3 = cubic_piece(y[i], y[i + 1], slope[i] * h, slope[i + 1] * h)
    return y[i] + f * (c1 + f * (c2 + f * c3))


def log_cubics(altitude_km: np.ndarray, coefficient: np.ndarray) -> np.ndarray:
    """c1, c2, c3 (3, L - 1, W) of ln a(f) = ln a(0) + c1 f + c2 f^2 + c3 f^3 between the levels; 0 where an end is 0.

    altitude_km (L,) not decreasing, coefficient (L, W): a.  A curve ends where a is 0 and where it jumps.
    """
    z, a = altitude_km, coefficient
    thick = np.diff(z) > 0
    positive = a > 0
    log = np.log(np.where(positive, a, 1.0))
    piece = np.zeros((3, z.size - 1, a.shape[1]))
    # a curve ends at a pair of levels that do not join
    ends = np.where(thick[:, None], ~(positive[:-1] & positive[1:]), np.abs(np.diff(log, axis=0)) > ROUNDING)
    distinct, members = np.unique(ends, axis=1, return_inverse=True)
    for p in range(distinct.shape[1]):
        columns = np.flatnonzero(members.ravel() == p)
        cuts = np.flatnonzero(distinct[:, p])
        for first, last in zip(np.concatenate([[0], cuts + 1]), np.append(cuts, z.size - 1), strict=True):
            if last <= first:
                continue
            levels = np.arange(first, last + 1)
            place = np.concatenate([[0], np.cumsum(thick[first:last])])  # a level that comes twice is one point
            points = levels[np.concatenate([[True], thick[first:last]])]
            if points.size < 2:
                continue
            y = log[np.ix_(points, columns)]
            slope = monotone_slopes(z[points], y)[place]
            inner = np.flatnonzero(thick[first:last])
            dz = np.diff(z)[first + inner][:, None]
            rows = np.ix_(first + inner, columns)
            for c, value in enumerate(
                cubic_piece(
                    log[np.ix_(levels[inner], columns)],
                    log[np.ix_(levels[inner + 1], columns)],
                    slope[inner] * dz,
                    slope[inner + 1] * dz,
                )
            ):
                piece[c][rows] = value
    return piece


def interpolate_smooth(lower, upper, piece, fraction):
    """Value at the fraction f of a layer whose logarithm is a cubic; piece (3, ...): as of `log_cubics`."""
    c1, c2, c3 = piece
    positive = (lower > 0) & (upper > 0)
    smooth = lower * np.exp(fraction * (c1 + fraction * (c2 + fraction * c3)))
    smooth = np.where(fraction >= 1.0, upper, smooth)  # a jump has no cubic, only an upper end
    return np.where(positive, smooth, lower * (1 - fraction) + upper * fraction)


def smooth_mean(altitude_km: np.ndarray, coefficient: np.ndarray, exponential_mean: np.ndarray) -> np.ndarray:
    """Mean (L - 1, W) over each layer of a coefficient (L, W) that goes by `log_cubics`.

    exponential_mean (L - 1, W): the mean if the coefficient went exponentially (`levels.layer_mean`).  Quadrature adds
    the small difference of the two, so that exponential air is exact.
    """
    lower, upper = coefficient[:-1], coefficient[1:]
    piece = log_cubics(altitude_km, coefficient)
    x, weight = np.polynomial.legendre.leggauss(8)
    mean = np.array(exponential_mean)
    for f, g in zip(0.5 * (x + 1.0), 0.5 * weight, strict=True):
        mean += g * (interpolate_smooth(lower, upper, piece, f) - interpolate_coefficient(lower, upper, f))
    return mean
