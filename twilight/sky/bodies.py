"""Where moon, planets and stars stand over a place: offline, by the routines of the IAU's SOFA collection (ERFA).

Axes of the ICRS; the Earth turns as UT1 = UTC (0.9 s at most, or 14 arcsec) and its poles do not move.  Light time and
aberration of planets and stars are in; refraction is not.
"""

from __future__ import annotations

import datetime as dt
from typing import NamedTuple

import numpy as np

from twilight.base.errors import TwilightError
from twilight.numerics.orientation import azimuth_elevation
from twilight.sky.ephemeris import check_year, delta_t_s

AU_KM = 1.495978707e8
"""Astronomical unit [km] (IAU 2012)."""
LIGHT_DAYS_PER_AU = 499.004783836 / 86400.0
"""Time that light takes for 1 au [d]."""
PLANETS = {"mercury": 1, "venus": 2, "mars": 4, "jupiter": 5, "saturn": 6, "uranus": 7, "neptune": 8}
"""Numbers of the planets in ERFA."""


class BodyPlace(NamedTuple):
    """One body at T moments.

    elevation_deg, azimuth_deg (T,): true, of its centre, azimuth from north.  distance_au (T,): from the observer,
    sun_distance_au (T,): from the sun; phase_angle_deg (T,): between sun and observer at the body, NaN for a star.
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

    def __init__(self, moments: list[dt.datetime], latitude_deg: float, longitude_deg: float, altitude_km: float = 0.0):
        import erfa  # start-up

        for moment in moments:
            check_year(moment, moment.isoformat())
        self._erfa = erfa
        utc = [moment.astimezone(dt.UTC) for moment in moments]
        epoch = dt.datetime(1970, 1, 1, tzinfo=dt.UTC)
        day = np.array([(m - epoch) / dt.timedelta(days=1) for m in utc])
        self.ut1 = (np.full(day.size, 2440587.5), day)
        self.tt = (self.ut1[0], day + delta_t_s(utc) / 86400.0)
        turn = erfa.c2t00b(*self.tt, *self.ut1, 0.0, 0.0)
        latitude, longitude = np.radians([latitude_deg, longitude_deg])
        here = erfa.gd2gc(1, longitude, latitude, 1000.0 * altitude_km) / 1000.0 / AU_KM
        self.observer = np.einsum("tji,j->ti", turn, here)  # from the Earth's centre [au]
        east = np.array([-np.sin(longitude), np.cos(longitude), 0.0])
        up = np.array([np.cos(latitude) * np.cos(longitude), np.cos(latitude) * np.sin(longitude), np.sin(latitude)])
        self._axes = np.stack([east, np.cross(up, east), up]) @ turn
        earth, self._earth_barycentric = erfa.epv00(*self.tt)
        self.earth = earth["p"]  # from the sun [au]

    def body(self, name: str) -> BodyPlace:
        """`moon` or one of `PLANETS`; TwilightError for any other name."""
        erfa = self._erfa
        if name == "moon":
            vector = erfa.moon98(*self.tt)["p"] - self.observer
            sun = vector + self.observer + self.earth
            return self._place(vector, sun, vector)
        if name not in PLANETS:
            raise TwilightError(f"body: '{name}' is not known; moon, {', '.join(PLANETS)} are")
        delay = np.zeros(self.tt[1].size)
        for _ in range(3):
            sun = erfa.plan94(self.tt[0], self.tt[1] - delay, PLANETS[name])["p"]
            vector = sun - self.earth - self.observer
            delay = np.linalg.norm(vector, axis=-1) * LIGHT_DAYS_PER_AU
        return self._place(vector, sun, self._aberrated(vector))

    def sun(self) -> BodyPlace:
        """The sun's centre."""
        vector = -self.earth - self.observer
        return self._place(vector, np.full(vector.shape, np.nan), self._aberrated(vector))

    def star(self, direction: np.ndarray) -> BodyPlace:
        """A star in a direction (3,) or (T, 3) of the ICRS, far away."""
        vector = np.broadcast_to(direction, self.earth.shape)
        made = self._place(vector, np.full(vector.shape, np.nan), self._aberrated(vector))
        return made._replace(distance_au=np.full(len(vector), np.inf))

    def _aberrated(self, vector: np.ndarray) -> np.ndarray:
        velocity = self._earth_barycentric["v"] * LIGHT_DAYS_PER_AU
        return vector / np.linalg.norm(vector, axis=-1, keepdims=True) + velocity

    def _place(self, vector: np.ndarray, sun: np.ndarray, apparent: np.ndarray) -> BodyPlace:
        distance, from_sun = np.linalg.norm(vector, axis=-1), np.linalg.norm(sun, axis=-1)
        azimuth, elevation = azimuth_elevation(np.einsum("tij,tj->ti", self._axes, apparent))
        across = np.linalg.norm(np.cross(vector, sun), axis=-1)
        phase = np.degrees(np.arctan2(across, (vector * sun).sum(axis=-1)))
        towards = apparent / np.linalg.norm(apparent, axis=-1, keepdims=True)
        return BodyPlace(elevation, azimuth, distance, from_sun, phase, towards)
