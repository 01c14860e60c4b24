"""What a reader of the Prague Sky Model makes of its file: angles, interpolation, products.

A viewpoint is taken 50 m above where it is, on a sphere of 6378 km.  The direction of view v is corrected so that the
horizon lies at 90 deg from the zenith z: v + z sin(dip).  PragueAngles:

    gamma   between v and the sun, uncorrected
    zero    between the corrected v and the zenith
    shadow  between the corrected v and the direction 90 deg above the sun in its vertical

Radiance is max(0, sum of sun(gamma) zenith(alpha)) emphasis(zero), with alpha the shadow angle for a sun below the
horizon and zero above it; all three go linearly between breaks, and radiance linearly between visibilities, albedos,
altitudes and elevations of the sun.  Channels are steps.  Transmittance is the square of factors of the place that is
looked at, linear in its altitude and in its distance along the ground.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

RADIUS_M = 6_378_000.0
"""Radius of the reader's sphere."""
SAFETY_M = 50.0
"""What the reader adds to the altitude of a viewpoint."""
TOP_M = 100_000.0
"""Altitude of the edge of the air."""
EDGE_M = 1_571_524.413613
"""Largest distance to the edge of the air along the ground."""


class PragueAngles(NamedTuple):
    """The angles gamma, zero and shadow [rad] of directions, each of their shape."""

    gamma: np.ndarray
    zero: np.ndarray
    shadow: np.ndarray


def horizon_sine(altitude_m: float) -> float:
    """Sine of the dip of the horizon from an altitude, the reader's 50 m included."""
    r = RADIUS_M + altitude_m
    return math.sqrt(r * r - RADIUS_M * RADIUS_M) / r


def angles_of(sun_deg: float, elevation_deg: ArrayLike, azimuth_deg: ArrayLike, altitude_m: float) -> PragueAngles:
    """PragueAngles of directions [deg], azimuth from the sun, seen from `altitude_m`, the reader's 50 m included."""
    e, a = np.radians(elevation_deg), np.radians(azimuth_deg)
    s = math.radians(sun_deg)
    across, up = np.cos(e) * np.cos(a), np.sin(e)
    corrected = up + horizon_sine(altitude_m)
    length = np.sqrt(np.cos(e) ** 2 + corrected**2)

    def angle(cosine: np.ndarray) -> np.ndarray:
        return np.arccos(np.clip(cosine, -1.0, 1.0))

    return PragueAngles(
        angle(across * math.cos(s) + up * math.sin(s)),
        angle(corrected / length),
        angle((corrected * math.cos(s) - across * math.sin(s)) / length),
    )


def elevation_of(zero_deg: ArrayLike, altitude_m: float) -> np.ndarray:
    """Elevation [deg] of the direction whose corrected zenith angle is `zero_deg`."""
    zero = np.radians(zero_deg)
    return 90.0 - np.degrees(zero + np.arcsin(horizon_sine(altitude_m) * np.sin(zero)))


def index_and_fraction(value: ArrayLike, breaks: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Index of the break below a value, clamped to the breaks, and the fraction of the way to the next."""
    clamped = np.clip(value, breaks[0], breaks[-1])
    index = np.minimum(np.searchsorted(breaks, clamped, side="right") - 1, max(len(breaks) - 2, 0))
    if len(breaks) == 1:
        return index, np.zeros(np.shape(clamped))
    return index, (clamped - breaks[index]) / (breaks[index + 1] - breaks[index])


def altitude_nodes_m(count: int) -> np.ndarray:
    """Altitudes of the places that factors of the transmittance are given for; the last one is the edge of the air."""
    return TOP_M * np.append((np.arange(count - 1) / count) ** 3, 1.0)


def distance_nodes_m(count: int) -> np.ndarray:
    """Distances along the ground of those places."""
    return EDGE_M * (np.arange(count) / count) ** 4
