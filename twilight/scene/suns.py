"""The suns of a configuration, one by one."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from datetime import datetime, timedelta

from twilight.base.conventions import ROUNDING
from twilight.config.scene import Config
from twilight.config.sun import SunAt, SunElevation, SunElevations, SunInterval, SunTimes
from twilight.sky.ephemeris import sun_position


@dataclass(frozen=True)
class SceneSun:
    """One sun of a sequence, and the section of a configuration that asks for this sun alone.

    elevation_deg: true; azimuth_deg: clockwise from north, None where there is no place; name: for a folder.
    """

    name: str
    section: SunElevation | SunAt
    elevation_deg: float
    azimuth_deg: float | None = None
    distance_au: float = 1.0
    time: datetime | None = None


def count_suns(config: Config) -> int:
    """How many suns a configuration has."""
    sun = config.sun
    if isinstance(sun, SunElevations):
        return len(sun.elevations_deg)
    if isinstance(sun, SunInterval | SunTimes):
        return len(_moments(sun))
    return 1


def suns_of(config: Config) -> Iterator[SceneSun]:
    """The positions of the sun of a configuration, one by one."""
    sun = config.sun
    if isinstance(sun, SunElevation):
        yield SceneSun(_elevation_name(sun.elevation_deg), sun, sun.elevation_deg, distance_au=sun.distance_au)
    elif isinstance(sun, SunElevations):
        for elevation in sun.elevations_deg:
            section = SunElevation(elevation_deg=elevation, distance_au=sun.distance_au, disc=sun.disc)
            yield SceneSun(_elevation_name(elevation), section, elevation, distance_au=sun.distance_au)
    else:
        for moment in _moments(sun):
            place = {key: getattr(sun, key) for key in ("latitude_deg", "longitude_deg", "time_zone", "disc")}
            one_at = SunAt(at=moment, **place)
            above = config.observer.altitude_km  # within what views have
            at = sun_position(moment, sun.latitude_deg, sun.longitude_deg, above, highest_km=max(above, 100.0))
            finest = "%H%M%S.%f" if moment.microsecond else "%H%M%S" if moment.second else "%H%M"
            twice = moment.replace(fold=0).utcoffset() != moment.replace(fold=1).utcoffset()  # as summer time ends
            name = moment.strftime(f"%Y-%m-%dT{finest}{'%z' if twice else ''}")
            yield SceneSun(name, one_at, float(at.elevation_deg), float(at.azimuth_deg), float(at.distance_au), moment)


def _elevation_name(elevation_deg: float) -> str:
    return f"sun{elevation_deg:+06.2f}"


def _moments(sun: SunAt | SunTimes | SunInterval) -> list[datetime]:
    """The times with their offsets; a daylight-saving change within an interval does not disturb the steps."""
    if isinstance(sun, SunAt):
        return [sun.aware(sun.at)]
    if isinstance(sun, SunTimes):
        return [sun.aware(moment) for moment in sun.times]
    start, stop = sun.aware(sun.start), sun.aware(sun.stop)
    step = timedelta(minutes=sun.step_minutes)
    count = int((stop.timestamp() - start.timestamp()) / step.total_seconds() + ROUNDING) + 1
    return [datetime.fromtimestamp(start.timestamp() + i * step.total_seconds(), start.tzinfo) for i in range(count)]
