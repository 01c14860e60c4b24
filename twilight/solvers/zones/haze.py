"""Where the glow of twilight ends above the horizon: at the top of the haze."""

from __future__ import annotations

import math

import numpy as np

from twilight.solvers.zones.grid import Edge
from twilight.transport.lines import touching_cosine
from twilight.transport.profile import Profile

THINNER = 1.3
"""A haze ends where extinction falls by this factor at once, at the wavelength where it falls most."""
BESIDE_KM = 1e-3
"""How far above and below an end the air is looked at."""
LEAST_DIRECTIONS, KM_PER_DIRECTION = 2, 2.0
"""Polar angles to where the haze is seen from above, at least, and thickness of the haze for each."""


def haze_top(profile: Profile) -> float | None:
    """Altitude [km] at which a haze on the ground ends: the sudden one across which extinction falls most; None where
    it does not fall suddenly.

    Seen from above, the bright air behind the Earth's edge is cut off there, within 0.05 deg: rays that pass lower are
    dimmed over hundreds of kilometres of haze.  Polar angles that do not part there see 2 % more or less of that light
    from one altitude to the next, and red twilight below a layer in the stratosphere has gone ten times along such
    rays.
    """
    factors = [_falls(profile, km) for km in profile.sharp_km]
    return float(profile.sharp_km[int(np.argmax(factors))]) if max(factors, default=0.0) >= THINNER else None


def edge_of(profile: Profile, altitude_km: np.ndarray, top_km: float | None) -> Edge | None:
    """The edge of a haze that ends at `top_km`, seen from altitudes (Z,); None without it."""
    if top_km is None:
        return None
    directions = math.ceil((top_km - float(profile.altitude_km[0])) / KM_PER_DIRECTION)
    return Edge(touching_cosine(profile, altitude_km, top_km), max(LEAST_DIRECTIONS, directions))


def _falls(profile: Profile, km: float) -> float:
    """Largest ratio of the extinction just below an altitude to that just above."""
    below, above = (
        np.array([np.interp(z, profile.altitude_km, column) for column in profile.extinction.T])
        for z in (km - BESIDE_KM, km + BESIDE_KM)
    )
    return float(np.max(below / np.maximum(above, 1e-30)))
