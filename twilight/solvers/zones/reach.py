"""How far around the Earth the field of a scene must reach: which solar zenith angles its suns and observers need."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from twilight.atmosphere.medium import Medium

LAST_ZENITH_DEG = 132.0
"""Solar zenith angle beyond which the field is taken as it is here: it is then e^-60 of the day's."""
LEAST_OBSERVER_KM, MARGIN_DEG = 12.0, 2.0
"""A field for known suns serves observers up to this altitude at least, and this far beyond what they see."""
BRIGHT_ZENITH_DEG = 85.0
"""Air under a sun of this zenith angle or larger is always part of the field: in deep twilight its light comes far."""


def reach_deg(medium: Medium, observer_altitude_km: float) -> float:
    """How far around the Earth from an observer [deg] the field is needed.

    To where the top of the air sinks below the horizon, and a margin.  Light that comes from beyond is scattered below
    the horizon of all that is seen: leaving it out moves the sky by less than 5e-4, in twilight by less than 1e-4.
    """
    ground = medium.earth_radius_km + medium.bottom_km

    def dip_deg(altitude_km: float) -> float:
        return math.degrees(math.acos(ground / max(ground, medium.earth_radius_km + altitude_km)))

    return dip_deg(medium.top_km) + dip_deg(max(observer_altitude_km, LEAST_OBSERVER_KM)) + MARGIN_DEG


def zenith_range(
    medium: Medium, sun_elevations_deg: Sequence[float] | None, observer_altitude_km: float
) -> tuple[float, float]:
    """Solar zenith angles [deg] that a scene with these suns needs; all of them where None is given."""
    if sun_elevations_deg is None:
        return 0.0, LAST_ZENITH_DEG
    around = reach_deg(medium, observer_altitude_km)
    lowest, highest = float(np.min(sun_elevations_deg)), float(np.max(sun_elevations_deg))
    return min(max(0.0, 90.0 - highest - around), BRIGHT_ZENITH_DEG), min(LAST_ZENITH_DEG, 90.0 - lowest + around)
