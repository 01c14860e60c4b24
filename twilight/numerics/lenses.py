"""Radial projections of lenses: from the angle off the optical axis to the radius in the image, and back.

``u`` is the radius that the named projection gives for the focal length 1, ``v`` the same after distortion; the radius
in the image is the focal length in pixels times ``v``::

    equidistant     u = theta              0 <= theta <= pi
    equisolid       u = 2 sin(theta / 2)   0 <= theta <= pi
    stereographic   u = 2 tan(theta / 2)   0 <= theta < pi
    orthographic    u = sin(theta)         0 <= theta <= pi/2
    perspective     u = tan(theta)         0 <= theta < pi/2

    v = u (1 + k1 u^2 + k2 u^4 + ...)

For ``perspective`` the polynomial is Brown's radial distortion (Brown 1966, Photogrammetric Engineering 32), for
``equidistant`` that of Kannala and Brandt (2006, IEEE PAMI 28); both as OpenCV's models of the same names have it.
It is used up to its first maximum only, beyond which one radius would stand for two angles.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

_LARGEST_RADIUS = {
    "equidistant": np.pi,
    "equisolid": 2.0,
    "stereographic": np.inf,
    "orthographic": 1.0,
    "perspective": np.inf,
}
_MOST_STEPS = 80
"""Steps of the safeguarded Newton iteration; bisection alone needs some 60 for a double."""


def ideal_radius(projection: str, sine: np.ndarray, cosine: np.ndarray) -> np.ndarray:
    """u for the sine and cosine of the angle off the axis, NaN outside the projection's range."""
    with np.errstate(divide="ignore", invalid="ignore"):
        if projection == "equidistant":
            return np.arctan2(sine, cosine)
        if projection == "equisolid":
            return 2.0 * np.sin(0.5 * np.arctan2(sine, cosine))
        if projection == "stereographic":
            return np.where((sine > 0) | (cosine > 0), 2.0 * np.tan(0.5 * np.arctan2(sine, cosine)), np.nan)
        if projection == "orthographic":
            return np.where(cosine >= 0, sine, np.nan)
        return np.where(cosine > 0, sine / cosine, np.nan)


def ideal_angle(projection: str, u: np.ndarray) -> np.ndarray:
    """The angle off the axis [rad] at the radius u, NaN outside the projection's range."""
    with np.errstate(invalid="ignore"):
        if projection == "equidistant":
            return np.where(u <= np.pi, u, np.nan)
        if projection == "equisolid":
            return 2.0 * np.arcsin(0.5 * u)
        if projection == "stereographic":
            return 2.0 * np.arctan(0.5 * u)
        if projection == "orthographic":
            return np.arcsin(u)
        return np.arctan(u)


def _even_series(u: np.ndarray | float, coefficients: Sequence[float]) -> np.ndarray:
    """1 + k1 u^2 + k2 u^4 + ..."""
    square = np.square(u)
    series = np.zeros_like(square)
    for k in reversed(coefficients):
        series = (series + k) * square
    return 1.0 + series


def distorted(u: np.ndarray | float, coefficients: Sequence[float]) -> np.ndarray:
    """v = u (1 + k1 u^2 + k2 u^4 + ...), whatever u."""
    return u * _even_series(u, coefficients)


def _slope_coefficients(coefficients: Sequence[float]) -> list[float]:
    """Coefficients of dv/du = 1 + 3 k1 u^2 + 5 k2 u^4 + ..."""
    return [(2 * n + 1) * k for n, k in enumerate(coefficients, start=1)]


def largest_radius(projection: str, coefficients: Sequence[float]) -> float:
    """The largest u at which the projection with its distortion can still be inverted; inf where there is no limit."""
    roots = np.roots([*reversed(_slope_coefficients(coefficients)), 1.0])
    extrema = [float(np.sqrt(r.real)) for r in roots if abs(r.imag) <= 1e-9 * abs(r) and r.real > 0]
    return min([_LARGEST_RADIUS[projection], *extrema])


def undistorted(v: np.ndarray, coefficients: Sequence[float], largest: float) -> np.ndarray:
    """u of `distorted(u) == v` with 0 <= u <= largest, NaN where there is none; v >= 0.

    Newton's method inside a bracket that shrinks with every step, so that it cannot leave it.
    """
    v = np.asarray(v, dtype=float)
    if not any(coefficients):
        return np.where(v <= largest, v, np.nan)
    high_end = largest
    if not np.isfinite(largest):
        most = np.max(v, initial=1.0, where=np.isfinite(v))
        high_end = 1.0
        while distorted(high_end, coefficients) < most:
            high_end *= 2.0
    top = float(distorted(high_end, coefficients))
    outside = ~(v <= top * (1.0 + 1e-12))
    goal = np.where(outside, 0.0, np.minimum(v, top))
    low, high = np.zeros_like(goal), np.full_like(goal, high_end)
    u = np.minimum(goal, high_end)
    for _ in range(_MOST_STEPS):
        error = distorted(u, coefficients) - goal
        low, high = np.where(error <= 0, u, low), np.where(error >= 0, u, high)
        slope = _even_series(u, _slope_coefficients(coefficients))
        with np.errstate(divide="ignore", invalid="ignore"):
            step = u - error / slope
        following = np.where((step >= low) & (step <= high), step, 0.5 * (low + high))
        settled = np.abs(following - u) <= 1e-15 * np.maximum(1.0, u)
        u = following
        if settled.all():
            break
    return np.where(outside, np.nan, u)
