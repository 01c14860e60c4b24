"""Where the moon stands over a place at a time, and how much of it is lit."""

from __future__ import annotations

import datetime as dt

import numpy as np

from twilight.sky.bodies import AU_KM, Sites
from twilight.sky.moon.light import Moon


def moon_over(
    moment: dt.datetime,
    latitude_deg: float,
    longitude_deg: float,
    sun_azimuth_deg: float,
    altitude_km: float = 0.0,
) -> Moon:
    """The moon of a place and time; its azimuth counts from that of the sun (from north [deg]).

    Topocentric, without refraction.  ERFA's `moon98` (Meeus 1998, ch. 47): 10 arcsec, for the years 1000 to 3000.
    Errors: TwilightError for other years.
    """
    site = Sites([moment], latitude_deg, longitude_deg, altitude_km)
    found, sun = site.moon(), site.sun()
    return Moon(
        float(found.elevation_deg[0]),
        float((found.azimuth_deg[0] - sun_azimuth_deg) % 360.0),
        float(found.phase_angle_deg[0]),
        float(found.distance_au[0] * AU_KM),
        float(found.sun_distance_au[0]),
        bool(is_waxing(sun.towards, found.towards)[0]),
    )


def is_waxing(sun: np.ndarray, moon: np.ndarray) -> np.ndarray:
    """Whether a moon stands east of the sun, as the evening's, (T,); towards both: unit vectors (T, 3) of the ICRS."""
    return np.cross(sun, moon) @ ECLIPTIC_NORTH > 0.0


ECLIPTIC_NORTH = np.array([0.0, -np.sin(np.radians(23.4393)), np.cos(np.radians(23.4393))])
"""North pole of the ecliptic in the axes of the ICRS."""
