"""Places and times with their sun and moon, and how the stars stand over them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from typing import Any

import numpy as np

from twilight.base.errors import TwilightError
from twilight.sky.ephemeris import AU_KM, Sites
from twilight.sky.lights import Sun
from twilight.sky.moon import Moon, is_waxing

OBLIQUITY_DEG = 23.4393
"""Angle between ecliptic and equator, J2000 [deg]."""
GALACTIC_POLE_DEG = (192.8595, 27.1283)
"""Right ascension and declination of the north galactic pole, J2000 (Hipparcos catalogue vol. 1 sec. 1.5.3)."""
ECLIPTIC_TILT_DEG = 60.0
"""Angle between the ecliptic and the horizon where place and time are not known: middle latitudes."""
_J2000 = datetime(2000, 1, 1, 12, tzinfo=UTC)


@dataclass(frozen=True)
class Place:
    """Where and when the observer stands; ``time`` with its offset."""

    latitude_deg: float
    longitude_deg: float
    time: datetime


def unit_vector(elevation_deg, azimuth_deg) -> np.ndarray:
    """Unit vectors (..., 3): towards azimuth 0, towards azimuth 90 deg, up."""
    e, a = np.radians(elevation_deg), np.radians(azimuth_deg)
    return np.stack(np.broadcast_arrays(np.cos(e) * np.cos(a), np.cos(e) * np.sin(a), np.sin(e)), axis=-1)


def years_from_j2000(place: Place) -> float:
    """Julian years from J2000 to the observer's time."""
    return (place.time - _J2000).total_seconds() / (86400.0 * 365.25)


def sidereal_time_deg(place: Place) -> float:
    """Mean sidereal time at the place [deg]: 280.46062 + 360.98564737 d from J2000 (Meeus 1998 ch. 12), UT1 = UTC."""
    days = (place.time - _J2000).total_seconds() / 86400.0
    return float(np.mod(280.46061837 + 360.98564736629 * days + place.longitude_deg, 360.0))


def _equatorial(right_ascension_deg: float, declination_deg: float) -> np.ndarray:
    return unit_vector(declination_deg, right_ascension_deg)


def to_horizon(equatorial: np.ndarray, place: Place) -> np.ndarray:
    """North, east and up components (3, ...) of equatorial unit vectors (3, ...) of the equinox of date."""
    return in_horizon(equatorial, np.radians(sidereal_time_deg(place)), np.radians(place.latitude_deg))


def in_horizon(equatorial: np.ndarray, sidereal_rad: Any, latitude_rad: Any) -> np.ndarray:
    """The same at sidereal times and latitudes, scalars or arrays that are broadcast with the vectors' components."""
    turn, latitude = sidereal_rad, latitude_rad
    south = np.cos(turn) * equatorial[0] + np.sin(turn) * equatorial[1]  # towards the meridian in the equator
    east = -np.sin(turn) * equatorial[0] + np.cos(turn) * equatorial[1]
    north = np.cos(latitude) * equatorial[2] - np.sin(latitude) * south
    up = np.sin(latitude) * equatorial[2] + np.cos(latitude) * south
    return np.array([north, east, up])


def poles_at(places: Sequence[Place], zero_deg: float = 0.0) -> tuple[np.ndarray, np.ndarray]:
    """Unit vectors (N, 3) to the poles of the galaxy and of the ecliptic at N places and times, as `unit_vector`.

    zero_deg: azimuth from north of their azimuth 0.  The precession of the poles since J2000, 0.3 deg, is left out.
    """
    turn = np.radians([sidereal_time_deg(place) for place in places])
    latitude = np.radians([place.latitude_deg for place in places])
    poles = []
    for pole in (_equatorial(*GALACTIC_POLE_DEG), _equatorial(270.0, 90.0 - OBLIQUITY_DEG)):
        north, east, up = in_horizon(pole, turn, latitude)
        a = np.radians(-zero_deg)
        poles.append(
            np.stack([np.cos(a) * north - np.sin(a) * east, np.sin(a) * north + np.cos(a) * east, up], axis=-1)
        )
    return poles[0], poles[1]


HIGHEST_SITE_KM = 100.0
"""Observers above this are taken as this high for the parallax of sun and moon."""


@dataclass(frozen=True, eq=False)
class Moments:
    """N moments: the sun, its numbers (N,) each; the moon, and the places with their times, None where not known.

    zero_deg: azimuth from north from which azimuths count.
    """

    sun: Sun
    moon: Moon | None = None
    places: tuple[Place, ...] | None = None
    zero_deg: float = 0.0

    def __len__(self) -> int:
        return int(np.size(self.sun.elevation_deg))

    def part(self, chosen: slice | np.ndarray) -> Moments:
        """Some of them; chosen: a range, or indices."""
        index = np.arange(len(self))[chosen]
        moon = None if self.moon is None else self.moon.part(index)
        places = None if self.places is None else tuple(self.places[i] for i in index)
        return Moments(self.sun.part(index), moon, places, self.zero_deg)

    @classmethod
    def of_sun(
        cls, sun_elevation_deg: float, sun_azimuth_deg: float | None = None, place: Place | None = None
    ) -> Moments:
        """One moment, azimuths counted from the sun; sun_azimuth_deg: from north, None: not known."""
        known = place is not None and sun_azimuth_deg is not None
        sun = Sun(*(np.array([value]) for value in (float(sun_elevation_deg), 0.0, 1.0)))
        return cls(sun, None, (place,) if known and place else None, float(sun_azimuth_deg or 0.0))

    def poles(self) -> tuple[np.ndarray | None, np.ndarray]:
        """Unit vectors (N, 3) to the poles of the galaxy and of the ecliptic.

        Without places there is none of the galaxy, and the ecliptic rises from the sun, whose azimuth is then 0, at
        ECLIPTIC_TILT_DEG to the horizon, leaning towards growing azimuth.
        """
        if self.places is not None:
            return poles_at(self.places, self.zero_deg)
        tilt, level = np.radians(90.0 - ECLIPTIC_TILT_DEG), np.array([0.0, 1.0, 0.0])
        # of the vectors across the sun: the level one, turned by the tilt about the sun
        sun = unit_vector(self.sun.elevation_deg, self.sun.azimuth_deg)
        return None, np.cos(tilt) * level - np.sin(tilt) * np.cross(sun, level)


def moments_at(
    latitude_deg: Sequence[float], longitude_deg: Sequence[float], times: Sequence[datetime], altitude_km: float = 0.0
) -> Moments:
    """The suns and moons of N places and times (with offsets), azimuths from north.

    Errors: TwilightError for a latitude that is none, and for years outside those of the ephemeris.
    """
    keys = list(zip(latitude_deg, longitude_deg, strict=True))
    sun, moon = np.zeros((3, len(keys))), np.zeros((6, len(keys)))
    of_place: dict[tuple[float, float], list[int]] = {}
    for n, key in enumerate(keys):
        of_place.setdefault(key, []).append(n)
    for (latitude, longitude), which in of_place.items():
        if not -90.0 <= latitude <= 90.0:
            raise TwilightError(f"latitude_deg: {latitude} must be a number between -90 and 90")
        turned = (float(longitude) + 180.0) % 360.0 - 180.0
        site = Sites([times[n] for n in which], float(latitude), turned, min(altitude_km, HIGHEST_SITE_KM))
        there, its = site.sun(), site.moon()
        sun[:, which] = there.elevation_deg, there.azimuth_deg, np.linalg.norm(site.earth, axis=-1)
        waxing = is_waxing(there.towards, its.towards)
        distance_km = its.distance_au * AU_KM
        moon[:, which] = (
            its.elevation_deg, its.azimuth_deg, its.phase_angle_deg, distance_km, its.sun_distance_au, waxing
        )  # fmt: skip
    places = tuple(Place(a, b, t) for (a, b), t in zip(keys, times, strict=True))
    return Moments(Sun(*sun), Moon(moon[0], moon[1], moon[2], moon[3], moon[4], moon[5] > 0.0), places)
