"""Where the sun stands: place and time to true elevation, azimuth and distance."""

from __future__ import annotations

import datetime as dt
from collections.abc import Sequence
from typing import NamedTuple
from zoneinfo import ZoneInfo

import numpy as np

from twilight.base.errors import TwilightError
from twilight.sky.bodies import Sites, check_year


class SunPosition(NamedTuple):
    """Topocentric position of the centre of the sun; floats, or arrays for a sequence of times.

    elevation_deg: true elevation, without refraction; azimuth_deg: clockwise from north, 0 <= azimuth < 360;
    distance_au: Earth-sun distance [au].
    """

    elevation_deg: float | np.ndarray
    azimuth_deg: float | np.ndarray
    distance_au: float | np.ndarray


def zone_of(name: str) -> ZoneInfo:
    """The time zone of an IANA name; TwilightError for any other."""
    try:
        return ZoneInfo(name)
    except (KeyError, ValueError, OSError):
        raise TwilightError(f"time zone: '{name}' is not an IANA name such as Europe/Berlin or UTC") from None


def parse_time(time: dt.datetime | str, time_zone: str | None = None) -> dt.datetime:
    """A moment in UTC from a datetime or 'YYYY-MM-DDTHH:MM[:SS]', with its own offset or in the named time zone.

    time_zone: a name of the IANA data base such as 'Europe/Berlin', used only for times without an offset.  A time that
    the clocks skip is refused; one that they show twice is the first of the two.
    """
    if isinstance(time, str):
        try:
            moment = dt.datetime.fromisoformat(time.strip())
        except ValueError:
            raise TwilightError(
                f"time: '{time}' is not a time such as 2003-12-08T16:30 or 2003-12-08T16:30+01:00"
            ) from None
    elif isinstance(time, dt.datetime):
        moment = time
    else:
        raise TwilightError(f"time: expected a datetime or an ISO 8601 string, not {type(time).__name__}")
    if moment.utcoffset() is None:
        if time_zone is None:
            raise TwilightError(
                f"time: '{time}' has no time zone; add an offset (2003-12-08T16:30+01:00) or a zone (Europe/Berlin)"
            )
        zone = zone_of(time_zone)
        moment = moment.replace(tzinfo=zone)
        check_year(moment, f"'{time}'")
        utc = moment.astimezone(dt.UTC)
        if utc.astimezone(zone).replace(tzinfo=None) != moment.replace(tzinfo=None):
            raise TwilightError(f"time: {time} does not exist in {time_zone}, the clocks skip it")
    check_year(moment, f"'{time}'")
    return moment.astimezone(dt.UTC)


def sun_position(
    time: dt.datetime | str | Sequence[dt.datetime | str],
    latitude_deg: float,
    longitude_deg: float,
    altitude_km: float = 0.0,
    *,
    time_zone: str | None = None,
) -> SunPosition:
    """Topocentric position of the sun for an observer at a place and a time (or a sequence of times).

    time: see :func:`parse_time`.  latitude_deg: geodetic, -90..90, north positive.  longitude_deg: -180..360, east
    positive.  altitude_km: above the ellipsoid, -1..100 (parallax only).  Elevation is without refraction.

    By `twilight.sky.bodies`, for the years 1000 to 3000: within 0.7 arcsec of NREL's SPA (Reda & Andreas, Solar Energy
    76 (2004) 577) from 1900 to 2200; UT1 is taken as UTC (0.004 deg at most).
    """
    for name, value, low, high in (
        ("latitude_deg", latitude_deg, -90.0, 90.0),
        ("longitude_deg", longitude_deg, -180.0, 360.0),
        ("altitude_km", altitude_km, -1.0, 100.0),
    ):
        if not (isinstance(value, int | float | np.number) and low <= float(value) <= high):
            raise TwilightError(f"{name}: {value} must be a number between {low:g} and {high:g}")
    longitude = (float(longitude_deg) + 180.0) % 360.0 - 180.0
    single = isinstance(time, str | dt.datetime)
    if not single and not hasattr(time, "__iter__"):
        raise TwilightError(f"time: expected a time or a sequence of times, not {type(time).__name__}")
    times: Sequence[dt.datetime | str] = [time] if single else list(time)  # type: ignore[list-item,arg-type]
    moments = [parse_time(t, time_zone) for t in times]
    site = Sites(moments, float(latitude_deg), longitude, float(altitude_km))
    sun = site.sun()
    distance = np.linalg.norm(site.earth, axis=-1)
    if single:
        return SunPosition(float(sun.elevation_deg[0]), float(sun.azimuth_deg[0]), float(distance[0]))
    return SunPosition(sun.elevation_deg, sun.azimuth_deg, distance)
