"""Where a direction above the horizon points among the stars: ecliptic and galactic latitude, from formulas."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from typing import Any

import numpy as np

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


def ecliptic_from_sun(
    elevation_deg, azimuth_deg, sun_elevation_deg: float, sun_azimuth_deg: float | None, place: Place | None
) -> tuple[np.ndarray, np.ndarray]:
    """Ecliptic longitude from the sun, 0..180 deg, and absolute ecliptic latitude [deg] of directions.

    azimuth_deg is relative to the sun.  Without a place the ecliptic is taken to rise from the sun at
    ``ECLIPTIC_TILT_DEG`` to the horizon, leaning towards growing azimuth.
    """
    direction = unit_vector(elevation_deg, azimuth_deg)
    sun = unit_vector(sun_elevation_deg, 0.0)
    if place is None or sun_azimuth_deg is None:
        tilt = np.radians(90.0 - ECLIPTIC_TILT_DEG)
        # of the vectors across the sun: the level one, turned by the tilt about the sun
        level = np.array([0.0, 1.0, 0.0])
        pole = np.cos(tilt) * level - np.sin(tilt) * np.cross(sun, level)
    else:
        pole = to_horizon(_ecliptic_pole(), place)
        pole = _turned(pole, -sun_azimuth_deg)
    latitude = np.degrees(np.arcsin(np.clip(direction @ pole, -1.0, 1.0)))
    sun = sun - (sun @ pole) * pole  # 0 but for the accuracy of the sidereal time
    sun /= np.linalg.norm(sun)
    longitude = np.degrees(np.arctan2(direction @ np.cross(pole, sun), direction @ sun))
    return np.abs(longitude), np.abs(latitude)


def galactic_latitude(elevation_deg, azimuth_deg, sun_azimuth_deg: float, place: Place) -> np.ndarray:
    """Absolute galactic latitude [deg] of directions whose azimuth is relative to the sun.

    Here and for the ecliptic the precession of the poles since J2000, 0.3 deg, is left out.
    """
    pole = _turned(to_horizon(_equatorial(*GALACTIC_POLE_DEG), place), -sun_azimuth_deg)
    return np.degrees(np.abs(np.arcsin(np.clip(unit_vector(elevation_deg, azimuth_deg) @ pole, -1.0, 1.0))))


def years_from_j2000(place: Place) -> float:
    """Julian years from J2000 to the observer's time."""
    return (place.time - _J2000).total_seconds() / (86400.0 * 365.25)


def sidereal_time_deg(place: Place) -> float:
    """Mean sidereal time at the place [deg]: 280.46062 + 360.98564737 d from J2000 (Meeus 1998 ch. 12), UT1 = UTC."""
    days = (place.time - _J2000).total_seconds() / 86400.0
    return float(np.mod(280.46061837 + 360.98564736629 * days + place.longitude_deg, 360.0))


def _equatorial(right_ascension_deg: float, declination_deg: float) -> np.ndarray:
    return unit_vector(declination_deg, right_ascension_deg)


def _ecliptic_pole() -> np.ndarray:
    return _equatorial(270.0, 90.0 - OBLIQUITY_DEG)


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


def poles_at(places: Sequence[Place]) -> tuple[np.ndarray, np.ndarray]:
    """North, east and up components (N, 3) of the poles of the galaxy and of the ecliptic at N places and times."""
    turn = np.radians([sidereal_time_deg(place) for place in places])
    latitude = np.radians([place.latitude_deg for place in places])
    galaxy, ecliptic = _equatorial(*GALACTIC_POLE_DEG), _ecliptic_pole()
    return in_horizon(galaxy, turn, latitude).T, in_horizon(ecliptic, turn, latitude).T


def _turned(vector: np.ndarray, azimuth_deg: float) -> np.ndarray:
    a = np.radians(azimuth_deg)
    north, east, up = vector
    return np.array([np.cos(a) * north - np.sin(a) * east, np.sin(a) * north + np.cos(a) * east, up])
