"""Where sun and moon stand over a place: offline, by the routines of the IAU's SOFA collection (ERFA).

Place and time to true elevation, azimuth and distance.  Axes of the ICRS; the Earth turns as UT1 = UTC (0.9 s at most,
or 14 arcsec) and its poles do not move.  The sun's aberration is in; refraction is not.
"""

import datetime as dt
import warnings
from collections.abc import Sequence
from typing import NamedTuple
from zoneinfo import ZoneInfo

import numpy as np

from twilight.base.conventions import YEARS
from twilight.base.errors import TwilightError, TwilightWarning
from twilight.numerics.directions import azimuth_elevation


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
        if moment.replace(fold=1).astimezone(dt.UTC) > utc:
            first = moment.isoformat(timespec="minutes")
            warnings.warn(
                f"time: {time} is shown twice by the clocks of {time_zone}: the first, {first}, is taken",
                TwilightWarning,
                stacklevel=2,
            )
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
    highest_km: float = 100.0,
) -> SunPosition:
    """Topocentric position of the sun for an observer at a place and a time (or a sequence of times).

    time: see :func:`parse_time`.  latitude_deg: geodetic, -90..90, north positive.  longitude_deg: -180..360, east
    positive.  altitude_km: above the ellipsoid, -1..highest_km (parallax only).  Elevation is without refraction.

    By ERFA, for the years 1000 to 3000: within 0.7 arcsec of NREL's SPA (Reda & Andreas, Solar Energy
    76 (2004) 577) from 1900 to 2200; UT1 is taken as UTC (0.004 deg at most).
    """
    for name, value, low, high in (
        ("latitude_deg", latitude_deg, -90.0, 90.0),
        ("longitude_deg", longitude_deg, -180.0, 360.0),
        ("altitude_km", altitude_km, -1.0, highest_km),
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


AU_KM = 1.495978707e8
"""Astronomical unit [km] (IAU 2012)."""
LIGHT_DAYS_PER_AU = 499.004783836 / 86400.0
"""Time that light takes for 1 au [d]."""
DELTA_T_S: tuple[tuple[float, float, float, tuple[float, ...]], ...] = (
    (500, 1000, 100, (1574.2, -556.01, 71.23472, 0.319781, -0.8503463, -0.005050998, 0.0083572073)),
    (1600, 1600, 1, (120, -0.9808, -0.01532, 1 / 7129)),
    (1700, 1700, 1, (8.83, 0.1603, -0.0059285, 0.00013336, -1 / 1174000)),
    (1800, 1800, 1, (13.72, -0.332447, 0.0068612, 0.0041116, -0.00037436, 1.21272e-5, -1.699e-7, 8.75e-10)),
    (1860, 1860, 1, (7.62, 0.5737, -0.251754, 0.01680668, -0.0004473624, 1 / 233174)),
    (1900, 1900, 1, (-2.79, 1.494119, -0.0598939, 0.0061966, -0.000197)),
    (1920, 1920, 1, (21.20, 0.84493, -0.076100, 0.0020936)),
    (1941, 1950, 1, (29.07, 0.407, -1 / 233, 1 / 2547)),
    (1961, 1975, 1, (45.45, 1.067, -1 / 260, -1 / 718)),
    (1986, 2000, 1, (63.86, 0.3345, -0.060374, 0.0017275, 0.000651814, 2.373599e-5)),
    (2005, 2000, 1, (62.92, 0.32217, 0.005589)),
    (2050, 1820, 100, (-20 - 0.5628 * 330, 0.5628 * 100, 32)),
    (2150, 1820, 100, (-20, 0, 32)),
)
"""TT - UT1 [s] (Espenak and Meeus 2006): first year, and coefficients of the powers of (year - origin) / unit."""
MARGIN = dt.timedelta(days=3)
"""Beyond the first and last year: twilights of their first and last days."""


def check_year(moment: dt.datetime, said: object) -> None:
    """TwilightError for a moment with its offset outside the years that are taken; said: what it is called."""
    first, last = (dt.datetime(year, 1, 1, tzinfo=dt.UTC) for year in (YEARS[0], YEARS[1] + 1))
    if not first - MARGIN <= moment < last + MARGIN:
        raise TwilightError(f"time: {said} is outside the years {YEARS[0]} to {YEARS[1]}")


class BodyPlace(NamedTuple):
    """One body at T moments.

    elevation_deg, azimuth_deg (T,): true, of its centre, azimuth from north.  distance_au (T,): from the observer,
    sun_distance_au (T,): from the sun; phase_angle_deg (T,): between sun and observer at the body, NaN for the sun.
    towards (T, 3): unit vectors of the ICRS.
    """

    elevation_deg: np.ndarray
    azimuth_deg: np.ndarray
    distance_au: np.ndarray
    sun_distance_au: np.ndarray
    phase_angle_deg: np.ndarray
    towards: np.ndarray


class Sites:
    """An observer at T moments: how the Earth stands, and where it is.

    moments: with their offsets, of the years `YEARS`; latitude_deg, longitude_deg: geodetic; altitude_km: above the
    ellipsoid.
    """

    def __init__(
        self, moments: Sequence[dt.datetime], latitude_deg: float, longitude_deg: float, altitude_km: float = 0.0
    ):
        import erfa  # start-up

        for moment in moments:
            check_year(moment, moment.isoformat())
        utc = [moment.astimezone(dt.UTC) for moment in moments]
        epoch = dt.datetime(1970, 1, 1, tzinfo=dt.UTC)
        day = np.array([(m - epoch) / dt.timedelta(days=1) for m in utc])
        ut1 = (np.full(day.size, 2440587.5), day)
        self._tt = (ut1[0], day + delta_t_s(utc) / 86400.0)
        turn = erfa.c2t00b(*self._tt, *ut1, 0.0, 0.0)
        latitude, longitude = np.radians([latitude_deg, longitude_deg])
        site_au = erfa.gd2gc(1, longitude, latitude, 1000.0 * altitude_km) / 1000.0 / AU_KM
        self._observer = np.einsum("tji,j->ti", turn, site_au)  # from the Earth's centre [au]
        east = np.array([-np.sin(longitude), np.cos(longitude), 0.0])
        up = np.array([np.cos(latitude) * np.cos(longitude), np.cos(latitude) * np.sin(longitude), np.sin(latitude)])
        self._axes = np.stack([east, np.cross(up, east), up]) @ turn
        with warnings.catch_warnings():  # beyond 1900 to 2100, which `YEARS` answers for
            warnings.simplefilter("ignore", erfa.ErfaWarning)
            earth, barycentric = erfa.epv00(*self._tt)
        self.earth = earth["p"]
        """From the sun to the Earth's centre [au], (T, 3)."""
        self._velocity = barycentric["v"]

    def moon(self) -> BodyPlace:
        """The moon's centre, by ERFA's `moon98`."""
        import erfa  # start-up

        vector = erfa.moon98(*self._tt)["p"] - self._observer
        return self._place(vector, vector + self._observer + self.earth, vector)

    def sun(self) -> BodyPlace:
        """The sun's centre."""
        vector = -self.earth - self._observer
        apparent = vector / np.linalg.norm(vector, axis=-1, keepdims=True) + self._velocity * LIGHT_DAYS_PER_AU
        return self._place(vector, np.full(vector.shape, np.nan), apparent)

    def _place(self, vector: np.ndarray, sun: np.ndarray, apparent: np.ndarray) -> BodyPlace:
        distance, from_sun = np.linalg.norm(vector, axis=-1), np.linalg.norm(sun, axis=-1)
        azimuth, elevation = azimuth_elevation(np.einsum("tij,tj->ti", self._axes, apparent))
        across = np.linalg.norm(np.cross(vector, sun), axis=-1)
        phase = np.degrees(np.arctan2(across, (vector * sun).sum(axis=-1)))
        towards = apparent / np.linalg.norm(apparent, axis=-1, keepdims=True)
        return BodyPlace(elevation, azimuth, distance, from_sun, phase, towards)


def delta_t_s(moments: Sequence[dt.datetime]) -> np.ndarray:
    """TT - UT1 of moments in UTC [s], by `DELTA_T_S`, constant through a month."""
    year = np.array([m.year + (m.month - 0.5) / 12.0 for m in moments])
    row = np.searchsorted([first for first, *_ in DELTA_T_S], [m.year for m in moments], side="right") - 1
    delta_t = np.empty(year.size)
    for k in np.unique(row):
        _, origin, unit, powers = DELTA_T_S[k]
        delta_t[row == k] = np.polynomial.polynomial.polyval((year[row == k] - origin) / unit, powers)
    return delta_t
