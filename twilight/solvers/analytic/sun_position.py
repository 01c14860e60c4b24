"""Where the sun stands, by the short formulae of Preetham 1999, appendix A.6.

They know neither the year nor the hour within the day, which costs up to a degree; renders use
``twilight.sky.ephemeris``.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np


class SunAngles(NamedTuple):
    """True elevation [deg] and azimuth [deg], clockwise from north."""

    elevation_deg: np.ndarray
    azimuth_deg: np.ndarray


def declination_rad(day_of_year) -> np.ndarray:
    """delta = 0.4093 sin(2 pi (J - 81) / 368), day of the year J from 1 to 365."""
    return 0.4093 * np.sin(2.0 * np.pi * (np.asarray(day_of_year, float) - 81.0) / 368.0)


def equation_of_time_h(day_of_year) -> np.ndarray:
    """0.170 sin(4 pi (J - 80) / 373) - 0.129 sin(2 pi (J - 8) / 355): true minus mean solar time [h]."""
    j = np.asarray(day_of_year, float)
    return 0.170 * np.sin(4.0 * np.pi * (j - 80.0) / 373.0) - 0.129 * np.sin(2.0 * np.pi * (j - 8.0) / 355.0)


def solar_time_h(standard_time_h, day_of_year, longitude_deg, standard_meridian_deg=0.0) -> np.ndarray:
    """Solar time [h] from standard time [h]; longitudes east positive.

    The paper adds 12 (SM - L) / pi and so counts longitudes west: to the east of the meridian the sun is earlier.
    """
    east = np.asarray(longitude_deg, float) - np.asarray(standard_meridian_deg, float)
    return np.asarray(standard_time_h, float) + equation_of_time_h(day_of_year) + east / 15.0


def sun_angles(solar_time_h, day_of_year, latitude_deg) -> SunAngles:
    """Elevation and azimuth of the sun for arrays that broadcast.

    sin(elevation) = sin l sin d - cos l cos d cos(pi t / 12); azimuth from the south to the west =
    arctan(-cos d sin(pi t / 12) / (-cos l sin d - sin l cos d cos(pi t / 12))), the quadrant from both signs.  The
    paper prints cos l sin d without its minus: the sun would then change sides at the latitude -d instead of d.
    """
    t = np.pi * np.asarray(solar_time_h, float) / 12.0
    lat = np.radians(np.asarray(latitude_deg, float))
    d = declination_rad(day_of_year)
    sine = np.sin(lat) * np.sin(d) - np.cos(lat) * np.cos(d) * np.cos(t)
    south = np.arctan2(-np.cos(d) * np.sin(t), -np.cos(lat) * np.sin(d) - np.sin(lat) * np.cos(d) * np.cos(t))
    elevation, azimuth = np.broadcast_arrays(np.degrees(np.arcsin(np.clip(sine, -1.0, 1.0))), np.degrees(south) + 180.0)
    return SunAngles(elevation, np.mod(azimuth, 360.0))
