"""Zenith range of a field: the solar zenith angles that the suns and observers of a scene need."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from twilight.atmosphere.medium import Medium

LAST_ZENITH_DEG = 132.0
"""Solar zenith angle beyond which the field is taken as it is here: it is then e^-60 of the day's."""
MIN_OBSERVER_KM = 12.0
"""Altitude [km] up to which a field for known suns serves all observers, however low the scene's own."""
MARGIN_DEG = 2.0
"""Range [deg] by which a field for known suns exceeds what its observers see."""
BRIGHT_ZENITH_DEG = 85.0
"""Air under a sun of this zenith angle or larger is always part of the field: in deep twilight its light comes far."""


def visible_arc_deg(medium: Medium, observer_altitude_km: float) -> float:
    """Arc around the Earth from an observer [deg] within which the field is needed.

    It ends where the top of the air sinks below the horizon, and a margin beyond.  Light that comes from beyond is
    scattered below the horizon of all that is seen: leaving it out moves the sky by less than 5e-4, in twilight by less
    than 1e-4.
    """
    ground = medium.earth_radius_km + medium.bottom_km

    def dip_deg(altitude_km: float) -> float:
        return math.degrees(math.acos(ground / max(ground, medium.earth_radius_km + altitude_km)))

    return dip_deg(medium.top_km) + dip_deg(max(observer_altitude_km, MIN_OBSERVER_KM)) + MARGIN_DEG


def zenith_range(
    medium: Medium, sun_elevations_deg: Sequence[float] | None, observer_altitude_km: float
) -> tuple[float, float]:
    """Solar zenith angles [deg] that a scene with these suns needs; all of them where None is given."""
    if sun_elevations_deg is None:
        return 0.0, LAST_ZENITH_DEG
    around = visible_arc_deg(medium, observer_altitude_km)
    lowest, highest = float(np.min(sun_elevations_deg)), float(np.max(sun_elevations_deg))
    return min(max(0.0, 90.0 - highest - around), BRIGHT_ZENITH_DEG), min(LAST_ZENITH_DEG, 90.0 - lowest + around)
