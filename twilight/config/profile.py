"""The profile of air that a climate's section `atmosphere` means."""

from __future__ import annotations

from twilight.atmosphere.profiles import AirProfile, load_profile, profile_of_levels
from twilight.config.climate import Climate


def air_profile(climate: Climate) -> AirProfile:
    """Pressure, temperature and gases of a climate that is no table, over all altitudes that it knows."""
    levels = climate.atmosphere.levels
    if levels is None:
        return load_profile(climate.atmosphere.profile)
    return profile_of_levels(climate.atmosphere.profile, **levels.model_dump(exclude={"file"}))
