"""The error that 95 % of radiances are expected to stay within, of whatever settings a scene has."""

import math

from twilight.atmosphere.medium import Medium
from twilight.solvers.zones.settings import ZonesSettings
from twilight.solvers.zones.solver import MEASURED_ERRORS, NOT_OF_QUALITY, at_quality, expected_error, quality_for

PHYSICS = tuple(key for key in NOT_OF_QUALITY if key not in ("target_error", "spectrum", "field_file"))
"""Settings without which the errors of a quality are others."""

MAX_MEASURED_DEPTH = 1.0
"""Largest optical depth of particles [at any wavelength of a scene] of the climates whose errors were measured; `urban`
has 0.84 at 450 nm."""


def stated_error(
    medium: Medium, settings: ZonesSettings, lowest_sun_deg: float, observer_altitude_km: float = 0.0
) -> float:
    """Fraction, for suns down to the lowest [deg]; infinite where it was not measured: in thicker air, with grids of
    one's own, or with physics left out."""
    usual = ZonesSettings()
    if any(getattr(settings, key) != getattr(usual, key) for key in PHYSICS):
        return math.inf
    if medium.optical_depth("aerosol").max() > MAX_MEASURED_DEPTH:
        return math.inf
    if settings.target_error:
        return quality_for(settings, medium, [lowest_sun_deg])[1]
    qualities = (name for name in MEASURED_ERRORS if at_quality(settings, name) == settings)
    return min((expected_error(name, medium, [lowest_sun_deg]) for name in qualities), default=math.inf)
