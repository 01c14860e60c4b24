"""When the sun crosses an elevation: sunrise and sunset, and the three dawns and dusks of a place and date.

A date's dusk is the crossing between its solar noon and the following solar midnight, its dawn that between the
midnight before and the noon; either may fall on another date of the clock.  Solar noon is where the sun stands highest.
From above the sea the horizon of sunrise and sunset dips by arccos(R / (R + altitude)); dawns and dusks are those of
the sun's elevation alone.
"""

import datetime as dt
import re
from typing import NamedTuple

import numpy as np

from twilight.base.conventions import EARTH_RADIUS_KM, YEARS
from twilight.base.errors import TwilightError
from twilight.sky.ephemeris import Sites, parse_time, sun_position, zone_of

SUNRISE_DEG = -0.8333
"""True elevation [deg] of the sun's centre when its upper limb stands on a level horizon: 34' of standard refraction
and 16' of radius (U.S. Naval Observatory; Meeus 1998, ch. 15)."""
EVENTS = {
    "astronomical dawn": ("dawn", -18.0),
    "nautical dawn": ("dawn", -12.0),
    "civil dawn": ("dawn", -6.0),
    "sunrise": ("dawn", SUNRISE_DEG),
    "solar noon": ("noon", None),
    "sunset": ("dusk", SUNRISE_DEG),
    "civil dusk": ("dusk", -6.0),
    "nautical dusk": ("dusk", -12.0),
    "astronomical dusk": ("dusk", -18.0),
}
"""Side of the day and true elevation of the sun's centre [deg], by name, in the order of a day."""
GRAMMAR = f"a time such as 2003-12-08T16:30, or [a date and] one of {', '.join(EVENTS)}, or dawn or dusk and degrees"
"""What a text for a time may hold, for errors."""
_EVENT = re.compile(
    r"(?:(?P<date>\d{4}-\d{2}-\d{2})\s*)?"
    rf"(?:(?P<event>{'|'.join(EVENTS)})|(?P<side>dawn|dusk)\s+(?P<deg>[-+−]?\d+(?:\.\d+)?)(?:\s*deg)?)?",
    re.IGNORECASE,
)


class TwilightTime(NamedTuple):
    """One event of a day: time with its offset (None: the sun does not get there), true elevation and azimuth of the
    sun [deg]."""

    event: str
    time: dt.datetime | None
    elevation_deg: float
    azimuth_deg: float | None


def moment_of(
    text: str, latitude_deg: float, longitude_deg: float, time_zone: str | None = None, altitude_km: float = 0.0
) -> dt.datetime:
    """The moment of a text for a time at a place: ISO 8601 (in UTC), or a twilight as of `time_of`."""
    try:
        dt.datetime.fromisoformat(text.strip())
    except ValueError:
        return time_of(text, latitude_deg, longitude_deg, time_zone, altitude_km)
    return parse_time(text, time_zone)


def time_of(
    text: str,
    latitude_deg: float,
    longitude_deg: float,
    time_zone: str | None = None,
    altitude_km: float = 0.0,
    today: dt.date | None = None,
) -> dt.datetime:
    """The moment of `[DATE] EVENT`, e.g. `2026-06-21 civil dusk` or `dusk -4`, with the offset of the zone.

    today: the date where the text has none; None: of the clock.  time_zone: an IANA name; None: UTC, and the date is
    that of the place's mean solar time.
    Raises TwilightError for a text of another form, and where the sun does not get there.
    """
    match = _EVENT.fullmatch(text.strip())
    if match is None or not (match["event"] or match["side"]):
        raise TwilightError(f"at: '{text}' is not {GRAMMAR}")
    try:
        date = dt.date.fromisoformat(match["date"]) if match["date"] else today or today_at(longitude_deg, time_zone)
    except ValueError:
        raise TwilightError(f"at: '{match['date']}' is not a date") from None
    if match["event"]:
        name = match["event"].lower()
        side, elevation = EVENTS[name]
    else:
        side, elevation = match["side"].lower(), float(match["deg"].replace("−", "-"))
        name = f"{side} at {elevation:g} deg"
    day = _Day(date, latitude_deg, longitude_deg, time_zone, altitude_km)
    elevation = day.on_horizon(elevation)
    moment = day.noon if elevation is None else day.crossing(side, elevation)
    if moment is None:
        raise TwilightError(
            f"at: there is no {name} on {date} at latitude {latitude_deg:g}: from midnight to midnight the sun stands "
            f"between {day.lowest_deg(side):.2f} and {day.highest_deg:.2f} deg"
        )
    return day.local(moment)


def twilight_times(
    date: dt.date, latitude_deg: float, longitude_deg: float, time_zone: str | None = None, altitude_km: float = 0.0
) -> list[TwilightTime]:
    """All `EVENTS` of a date at a place, in their order.  Arguments and errors as `time_of`."""
    day = _Day(date, latitude_deg, longitude_deg, time_zone, altitude_km)
    rows = []
    for name, (side, level_deg) in EVENTS.items():
        elevation = day.on_horizon(level_deg)
        moment = day.noon if elevation is None else day.crossing(side, elevation)
        if moment is None:
            rows.append(TwilightTime(name, None, float(elevation or 0.0), None))
            continue
        at = sun_position(moment, latitude_deg, longitude_deg, altitude_km)
        rows.append(TwilightTime(name, day.local(moment), float(at.elevation_deg), float(at.azimuth_deg)))
    return rows


def moon_times(
    date: dt.date, latitude_deg: float, longitude_deg: float, time_zone: str | None = None, altitude_km: float = 0.0
) -> list[TwilightTime]:
    """Moonrise and moonset between the midnights of a date, each as often as it is (0 to 2 times), by their time.

    As of the sun: of the upper limb on a level horizon, with 34' of refraction; elevation and azimuth are the moon's.
    Arguments and errors as `time_of`.
    """
    day = _Day(date, latitude_deg, longitude_deg, time_zone, altitude_km)
    horizon, (first, last) = SUNRISE_DEG - day.dip_deg, day.midnights
    moments = [first + (last - first) * f for f in np.linspace(0.0, 1.0, 289)]
    above = Sites(moments, latitude_deg, longitude_deg, altitude_km).moon().elevation_deg - horizon
    rows = []
    for i in np.flatnonzero((above[:-1] < 0.0) != (above[1:] < 0.0)).tolist():
        moment = moments[i] + (moments[i + 1] - moments[i]) * float(above[i] / (above[i] - above[i + 1]))
        at = Sites([moment], latitude_deg, longitude_deg, altitude_km).moon()
        name = "moonrise" if above[i] < 0.0 else "moonset"
        rows.append(TwilightTime(name, day.local(moment), float(at.elevation_deg[0]), float(at.azimuth_deg[0])))
    return rows


def today_at(longitude_deg: float, time_zone: str | None = None) -> dt.date:
    """The date now, on the clocks of a zone or by the mean solar time of a place."""
    if time_zone is not None:
        return dt.datetime.now(zone_of(time_zone)).date()
    return (dt.datetime.now(dt.UTC) + _solar_offset(longitude_deg)).date()


def _solar_offset(longitude_deg: float) -> dt.timedelta:
    """Mean solar time of a place minus UTC."""
    return dt.timedelta(hours=((longitude_deg + 180.0) % 360.0 - 180.0) / 15.0)


class _Day:
    """From the solar midnight before a date's noon to the one after it."""

    def __init__(self, date: dt.date, latitude_deg: float, longitude_deg: float, zone: str | None, altitude_km: float):
        if not YEARS[0] <= date.year <= YEARS[1]:
            raise TwilightError(f"at: the date {date} is outside the years {YEARS[0]} to {YEARS[1]}")
        self.dip_deg = float(np.degrees(np.arccos(EARTH_RADIUS_KM / (EARTH_RADIUS_KM + max(altitude_km, 0.0)))))
        self.place = (latitude_deg, longitude_deg, altitude_km)
        self.zone = None if zone is None else zone_of(zone)
        try:
            clock = dt.datetime.combine(date, dt.time(12), tzinfo=dt.UTC) - _solar_offset(longitude_deg)
            if self.zone is not None:
                # the noon of the date as the zone's clocks have it
                clock += dt.timedelta(days=(date - clock.astimezone(self.zone).date()).days)
            self.noon = self._extreme(clock, highest=True)
            half = dt.timedelta(hours=12)
            self.midnights = self._extreme(self.noon - half, False), self._extreme(self.noon + half, False)
        except OverflowError:
            raise TwilightError(f"at: the date {date} is outside the years {YEARS[0]} to {YEARS[1]}") from None
        self.highest_deg = self._elevation([self.noon])[0]

    def on_horizon(self, elevation_deg: float | None) -> float | None:
        """Elevation [deg] of an event for the altitude: sunrise and sunset are on the horizon, which dips."""
        return elevation_deg if elevation_deg != SUNRISE_DEG else SUNRISE_DEG - self.dip_deg

    def _elevation(self, moments: list[dt.datetime]) -> np.ndarray:
        latitude, longitude, altitude = self.place
        return np.asarray(sun_position(moments, latitude, longitude, altitude).elevation_deg)

    def _extreme(self, about: dt.datetime, highest: bool) -> dt.datetime:
        """The highest or lowest sun within three hours of a moment, to a second."""
        window = dt.timedelta(hours=3)
        for _ in range(4):
            moments = [about + window * f for f in np.linspace(-1.0, 1.0, 37)]
            elevation = self._elevation(moments)
            about = moments[int(np.argmax(elevation) if highest else np.argmin(elevation))]
            window /= 18
        return about

    def lowest_deg(self, side: str) -> float:
        """Elevation [deg] at the midnight of a side of the day."""
        return float(self._elevation([self.midnights[side == "dusk"]])[0])

    def crossing(self, side: str, elevation_deg: float) -> dt.datetime | None:
        """When the sun's centre passes an elevation between noon and the midnight of a side; None: not at all."""
        low, high = self.midnights[side == "dusk"], self.noon
        ends = self._elevation([low, high]) - elevation_deg
        if ends[0] > 0.0 or ends[1] < 0.0:
            return None
        # the elevation rises all the way from midnight to noon
        for _ in range(4):
            moments = [low + (high - low) * f for f in np.linspace(0.0, 1.0, 33)]
            above = self._elevation(moments) >= elevation_deg
            k = int(np.argmax(above)) if above.any() else len(moments) - 1
            low, high = moments[max(k - 1, 0)], moments[k]
        return low + 0.5 * (high - low)

    def local(self, moment: dt.datetime) -> dt.datetime:
        """With the offset of the zone, to the nearest second."""
        return (moment + dt.timedelta(milliseconds=500)).replace(microsecond=0).astimezone(self.zone or dt.UTC)
