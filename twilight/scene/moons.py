"""The moon of a configuration, for each of its suns."""

from __future__ import annotations

import numpy as np

from twilight.config.scene import Config
from twilight.config.sun import MoonSection, SunAt
from twilight.numerics.directions import direction
from twilight.scene.suns import SceneSun
from twilight.sky.ephemeris import AU_KM
from twilight.sky.moon import MEAN_DISTANCE_KM, Moon, moon_over


def moon_of(config: Config, sun: SceneSun) -> Moon | None:
    """The moon at the moment of a sun; None where the configuration has none."""
    section = config.moon
    if section is None:
        return None
    if section.elevation_deg is None:
        place = sun.section
        assert isinstance(place, SunAt) and sun.time is not None and sun.azimuth_deg is not None
        altitude = config.observer.altitude_km
        return moon_over(sun.time, place.latitude_deg, place.longitude_deg, sun.azimuth_deg, altitude)
    return placed_moon(section, sun.elevation_deg, sun.distance_au)


def placed_moon(section: MoonSection, sun_elevation_deg: float, sun_distance_au: float) -> Moon:
    """The moon that a configuration puts somewhere (`elevation_deg`), under a sun."""
    assert section.elevation_deg is not None
    azimuth = 180.0 if section.azimuth_deg is None else section.azimuth_deg % 360.0
    distance = section.distance_km or MEAN_DISTANCE_KM
    moon = distance * direction(azimuth, section.elevation_deg)
    from_sun = moon - sun_distance_au * AU_KM * direction(0.0, sun_elevation_deg)
    phase = section.phase_angle_deg
    if phase is None:
        phase = float(np.degrees(np.arctan2(np.linalg.norm(np.cross(moon, from_sun)), moon @ from_sun)))
    away = float(np.linalg.norm(from_sun)) / AU_KM
    return Moon(section.elevation_deg, azimuth, phase, distance, away)
