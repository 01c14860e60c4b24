"""Which lights a scene has at a moment, and which are left out: sun, moon and the glows of the night."""

from __future__ import annotations

import warnings
from typing import NamedTuple

import numpy as np

from twilight.atmosphere.medium import Medium
from twilight.base.errors import TwilightError, TwilightWarning
from twilight.config.moon import MoonSection
from twilight.config.scene import Config, Night
from twilight.config.sun import SunAt, SunInterval, SunTimes
from twilight.numerics.directions import direction
from twilight.scene.plan import Omission
from twilight.scene.suns import SceneSun
from twilight.sky.ephemeris import AU_KM
from twilight.sky.lights import Luminary, Sun
from twilight.sky.moments import Moments
from twilight.sky.moon import MEAN_DISTANCE_KM, PHASE_RANGE_DEG, Moon, moon_over
from twilight.sky.night import NightLevels, Place
from twilight.sky.night.glows import Glow, glows_of
from twilight.sky.night.world import NATURAL_ZENITH_MAG, artificial_zenith_cd_per_m2


class SceneLights(NamedTuple):
    """The lights of a moment, azimuths from the sun: luminaries that light the air, the sun first, and glows.

    moon: whether it shines or not, None: the configuration has none; left_out: why what was asked for does not shine.
    """

    moment: Moments
    luminaries: tuple[Luminary, ...]
    glows: tuple[Glow, ...] = ()
    moon: Moon | None = None
    left_out: tuple[Omission, ...] = ()

    @property
    def place(self) -> Place | None:
        """Where and when the observer stands, where that is known."""
        return self.moment.places[0] if self.moment.places else None


def lights_of(config: Config, medium: Medium, altitude_km: float, sun: SceneSun) -> SceneLights:
    """The lights over an observer at the moment of one of the suns of a configuration, in its medium."""
    section = sun.section
    where = None
    if isinstance(section, SunAt) and sun.time is not None:
        where = Place(section.latitude_deg, section.longitude_deg, sun.time)
    moment = Moments.of_sun(sun.elevation_deg, sun.azimuth_deg, where)
    glows = () if config.night is None else glows_of(levels_of(config.night), medium, altitude_km)
    body, moon = Sun(sun.elevation_deg, 0.0, sun.distance_au), moon_of(config, sun)
    if moon is None or moon.shines:
        return SceneLights(moment, (body,) if moon is None else (body, moon), glows, moon)
    reason = f"stands at {moon.elevation_deg:.1f} deg, below the horizon, and lights nothing"
    return SceneLights(moment, (body,), glows, moon, (Omission("moon", reason, "none"),))


def warn_of_the_moon(config: Config, lights: SceneLights) -> None:
    """TwilightWarning where the moon gives no light, and where its phase is not one that was observed."""
    if lights.left_out:
        text = lights.left_out[0].reason
    elif lights.moon is not None and lights.moon.phase_angle_deg < PHASE_RANGE_DEG[0]:
        phase = lights.moon.phase_angle_deg
        text = f"is {phase:.2f} deg from opposition: eclipses are not computed, it is as at 1.55 deg"
    else:
        return
    warnings.warn(f"{config.title}: the moon {text}", TwilightWarning, stacklevel=4)


def levels_of(night: Night) -> NightLevels:
    """How bright each glow is."""
    given = night.light_pollution
    zenith = NATURAL_ZENITH_MAG if given is None else given.zenith_mag
    lamps = artificial_zenith_cd_per_m2(zenith)
    return NightLevels(night.airglow, night.starlight, night.zodiacal_light, lamps)


def check_stars(config: Config) -> None:
    """TwilightError for stars without a place and a time."""
    if config.night is not None and config.night.stars and not isinstance(config.sun, SunAt | SunTimes | SunInterval):
        raise TwilightError(
            f"{config.title}: night.stars needs a place and a time (sun.at, latitude_deg, longitude_deg); leave it out"
        )


def moon_of(config: Config, sun: SceneSun) -> Moon | None:
    """The moon at the moment of a sun, its azimuth from the sun's; None where the configuration has none."""
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
