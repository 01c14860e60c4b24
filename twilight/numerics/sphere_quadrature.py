"""Directions and weights for integrals of a sky's radiance over the two hemispheres, seen from any altitude.

Gauss-Legendre points on panels that end where a sky has its edges: elevations at the horizontal, at the sun and beside
it, at the horizon, and at lines of sight with tangents between the ground and the observer; azimuths that are closer
the closer to the sun.  A sky is its own mirror image about the sun's vertical: one half is asked for, and counts twice.

Irradiances and actinic fluxes are within 0.2 % of those of more than twice as many points on each panel with the sun
above -8 deg, within 1 % at -12 deg (`tests/test_fluxes.py`).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

UP_DEG = (0.0, 0.7, 3.0, 10.0, 30.0, 90.0)
"""Ends of the panels of elevation above the horizontal [deg], the sun apart."""
BESIDE_SUN_DEG = (-8.0, -2.0, 0.0, 2.0, 8.0)
"""Further ends from the sun's elevation on, where that is above the horizontal."""
TANGENTS_KM = (0.5, 1.5, 3.0, 5.0, 8.0, 12.0, 17.0, 23.0, 30.0, 40.0, 60.0, 80.0, 100.0)
"""Heights above the ground [km] of the lines of sight whose elevations end panels below the horizontal."""
BELOW_HORIZON_DEG = (-15.0, -5.0, -1.5)
"""Ends below the horizon, from there."""
LEAST_DEG = 40.0
"""Elevation [deg] below the horizontal where a last panel begins, down to the nadir."""
AZIMUTH_DEG = (0.0, 4.0, 25.0, 90.0, 180.0)
"""Ends of the panels of azimuth from the sun [deg]."""
POINTS = 3
"""Points on each panel."""


class Hemisphere(NamedTuple):
    """Lines of sight of one hemisphere: elevation_deg (E,), azimuth_deg (A,) and weight_sr (E, A), 2 pi in all."""

    elevation_deg: np.ndarray
    azimuth_deg: np.ndarray
    weight_sr: np.ndarray

    @property
    def horizontal_weight(self) -> np.ndarray:
        """Weights of the irradiance of a horizontal surface, (E, A): pi in all."""
        return self.weight_sr * np.abs(np.sin(np.radians(self.elevation_deg)))[:, None]


def _panels(edges: Sequence[float], points: int) -> tuple[np.ndarray, np.ndarray]:
    """Points and weights of Gauss and Legendre on intervals between increasing edges."""
    x, w = np.polynomial.legendre.leggauss(points)
    e = np.asarray(edges, dtype=float)
    first, last = e[:-1, None], e[1:, None]
    return (0.5 * (first + last + (last - first) * x)).ravel(), (0.5 * (last - first) * w).ravel()


def _hemisphere(edges: set[float], points: int) -> Hemisphere:
    elevation, width = _panels(sorted(edges), points)
    azimuth, around = _panels(AZIMUTH_DEG, points)
    weight = np.radians(width) * np.cos(np.radians(elevation))
    return Hemisphere(elevation, azimuth, 2.0 * weight[:, None] * np.radians(around))


def hemispheres(
    sun_elevation_deg: float,
    height_km: float,
    tangent_elevation_deg: Callable[[np.ndarray], np.ndarray],
    points: int = POINTS,
) -> tuple[Hemisphere, Hemisphere]:
    """The upper and the lower hemisphere.

    Parameters
    ----------
    sun_elevation_deg
        Elevation of the sun as it is seen [deg].
    height_km
        Of the observer above the ground [km].
    tangent_elevation_deg
        Elevation [deg] at which the observer sees lines whose lowest points are at heights above the ground [km]
        between 0 and `height_km`.
    points
        On each panel.
    """
    beside = {sun_elevation_deg + b for b in BESIDE_SUN_DEG} if sun_elevation_deg > 0.0 else set()
    up = set(UP_DEG) | {b for b in beside if 0.0 < b < 90.0}
    heights = np.array([0.0, *TANGENTS_KM])
    tangents = tangent_elevation_deg(heights[heights < height_km]) if height_km > 0.0 else np.zeros(1)
    horizon = float(tangents[0])
    down = {-90.0, 0.0} | {float(t) for t in tangents}
    down |= {d for d in (-LEAST_DEG, *(horizon + b for b in BELOW_HORIZON_DEG)) if -90.0 < d < horizon}
    return _hemisphere(up, points), _hemisphere(down, points)
