"""Positions of stars and planets over a place, refracted, by astropy (the extra `stars`) without a download."""

import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from datetime import UTC, datetime
from typing import Any

import numpy as np

from twilight.base.errors import TwilightError
from twilight.base.extras import missing
from twilight.sky.night.points import Stars, bright_stars

STANDARD_PRESSURE_HPA = 1010.0
STANDARD_TEMPERATURE_C = 10.0
"""Air for which Bennett's coefficients hold."""
LOWEST_DEG = -1.0
_STEPS = 6
"""Steps of the iteration from true to apparent elevations, whose error falls to a sixth or less with each."""


def refraction_rad(true_elevation_rad: np.ndarray, pressure_hpa: float, temperature_c: float) -> np.ndarray:
    """How much higher than its true elevation a star appears [rad], by Bennett (1982, Journal of Navigation 35, 255).

    R = 1 / tan(h + 7.31 / (h + 4.4)), R - 0.06 sin(14.7 R + 13), in arcmin with h the apparent elevation in deg and the
    sine's argument in deg, times P / 1010 hPa * 283 K / T; good to 0.015' in that air, from the zenith to the horizon.
    Below -1 deg, where no star is seen, the value at -1 deg is taken.
    """
    true = np.maximum(np.degrees(true_elevation_rad), LOWEST_DEG)
    air = pressure_hpa / STANDARD_PRESSURE_HPA * (273.15 + STANDARD_TEMPERATURE_C) / (273.15 + temperature_c)
    lift = np.zeros_like(true)
    for _ in range(_STEPS):
        h = true + lift
        r = 1.0 / np.tan(np.radians(h + 7.31 / (h + 4.4)))
        lift = np.maximum(r - 0.06 * np.sin(np.radians(14.7 * r + 13.0)), 0.0) * air / 60.0
    return np.radians(lift)


def lifted(directions: np.ndarray, zenith: np.ndarray, pressure_hpa: float, temperature_c: float) -> np.ndarray:
    """Unit vectors (..., 3) turned towards the zenith (3,), a unit vector in the same frame, by the refraction."""
    height = directions @ zenith
    flat = directions - height[..., None] * zenith
    across = np.linalg.norm(flat, axis=-1)
    elevation = np.arctan2(height, across)
    apparent = elevation + refraction_rad(elevation, pressure_hpa, temperature_c)
    with np.errstate(divide="ignore", invalid="ignore"):
        unit = np.where(across[..., None] > 0, flat / across[..., None], 0.0)
    return np.cos(apparent)[..., None] * unit + np.sin(apparent)[..., None] * zenith


def pressure_at_hpa(altitude_km: float) -> float:
    """Pressure of the standard atmosphere near the ground, 1013.25 exp(-h / 8.4 km)."""
    return float(1013.25 * np.exp(-altitude_km / 8.4))


LOWEST_RAD = np.radians(2.0)
"""Elevation of the lowest stars [rad]: haze hides lower ones, and their refraction depends on the air of the day."""
PLANETS = {"Mercury": -0.6, "Venus": -4.4, "Mars": -1.6, "Jupiter": -9.4, "Saturn": -9.4}
"""Magnitudes at 1 au from the sun and the Earth, fully lit (Meeus 1998, Astronomical Algorithms, ch. 41), Saturn with
its ring half open; phases are left out, which is well within what a match allows."""
FIRST_YEAR = 1900
"""First year in which proper motions and planets are used."""
LAST_YEAR = 2100
"""Last year in which proper motions and planets are used."""


@dataclass(frozen=True)
class StarSite:
    """Where the camera stood."""

    latitude_deg: float
    longitude_deg: float
    altitude_km: float = 0.0


def horizontal(place: StarSite, moment: datetime, pressure_hpa: float, temperature_c: float) -> Stars:
    """Stars and planets more than 2 deg up: apparent directions east, north, up, with refraction; brightest first.

    moment: with its time zone; UT1 is taken for UTC, which is good to 0.9 s, or 14 arcsec.  Precession, nutation,
    aberration and the planets (to an arcminute) are astropy's.
    Errors: TwilightError where astropy is missing, or a moment is outside the years 1900 to 2100.
    """
    check_year(moment.year)
    zenith = np.array([0.0, 0.0, 1.0])
    with _astropy() as (coordinates, units, Time):
        time = Time(moment.astimezone(UTC).replace(tzinfo=None), scale="utc")
        stars = bright_stars(float(time.jyear))
        site = coordinates.EarthLocation(
            lat=place.latitude_deg * units.deg, lon=place.longitude_deg * units.deg, height=place.altitude_km * units.km
        )
        local = coordinates.AltAz(obstime=time, location=site, pressure=0.0 * units.hPa)
        x, y, z = stars.directions.T
        fixed = coordinates.SkyCoord(
            ra=np.arctan2(y, x) * units.rad, dec=np.arcsin(np.clip(z, -1.0, 1.0)) * units.rad, frame="icrs"
        )
        true = _east_north_up(fixed.transform_to(local))
        bodies, magnitudes = [], []
        sun = coordinates.get_body_barycentric("sun", time, ephemeris="builtin")
        for name, magnitude in PLANETS.items():
            body = coordinates.get_body(name.lower(), time, site, ephemeris="builtin")
            from_sun = (coordinates.get_body_barycentric(name.lower(), time, ephemeris="builtin") - sun).norm()
            bodies.append(_east_north_up(body.transform_to(local)))
            magnitudes.append(magnitude + 5.0 * np.log10(from_sun.to_value("au") * body.distance.to_value("au")))
    all_of_them = Stars(
        np.concatenate([true, np.array(bodies)]),
        np.concatenate([stars.magnitude, magnitudes]),
        np.concatenate([stars.hip, np.zeros(len(bodies), dtype=stars.hip.dtype)]),
        np.concatenate([stars.names.astype(object), np.array(list(PLANETS), dtype=object)]),
    )
    up = all_of_them.directions[:, 2] > np.sin(LOWEST_RAD)
    seen_stars = all_of_them.take(up).take(np.argsort(all_of_them.magnitude[up], kind="stable"))
    return seen_stars.turned(lifted(seen_stars.directions, zenith, pressure_hpa, temperature_c))


def equatorial(year: float) -> Stars:
    """All stars in the axes of the mean equator and equinox of a Julian year, brightest first.

    Where place and moment are unknown, so are aberration (20 arcsec) and nutation (17 arcsec): they are left out.
    """
    check_year(year)
    stars = bright_stars(year)
    return stars.turned(stars.directions @ precession(year).T)


def precession(year: float) -> np.ndarray:
    """Matrix (3, 3) from the axes of the ICRS to those of the mean equator and equinox of a Julian year."""
    with _astropy() as (coordinates, units, Time):
        frame = coordinates.FK5(equinox=Time(year, format="jyear"))
        axes = coordinates.SkyCoord(ra=[0.0, 90.0, 0.0] * units.deg, dec=[0.0, 0.0, 90.0] * units.deg, frame="icrs")
        return np.asarray(axes.transform_to(frame).cartesian.xyz.value)


def planet_tracks(first_year: float, last_year: float, step_days: float) -> tuple[np.ndarray, np.ndarray]:
    """(Julian years (T,), directions (T, planets, 3) from the Earth's centre, axes of the ICRS), in PLANETS' order.

    Light time and aberration, which move them by less than an arcminute, are left out.
    """
    with _astropy() as (coordinates, _, Time):
        time = Time(np.arange(first_year, last_year, step_days / 365.25), format="jyear")
        earth = coordinates.get_body_barycentric("earth", time, ephemeris="builtin").xyz.value
        tracks = [
            coordinates.get_body_barycentric(name.lower(), time, ephemeris="builtin").xyz.value - earth
            for name in PLANETS
        ]
        directions = np.moveaxis(np.array(tracks), (0, 1, 2), (1, 2, 0))
        return time.jyear, directions / np.linalg.norm(directions, axis=-1, keepdims=True)


def check_year(year: float) -> None:
    """Raise TwilightError unless proper motions and planets are known well in that year."""
    if not FIRST_YEAR <= year <= LAST_YEAR:
        raise TwilightError(f"the year {year:g} must be from {FIRST_YEAR} to {LAST_YEAR}")


def _east_north_up(frame: Any) -> np.ndarray:
    azimuth, elevation = frame.az.rad, frame.alt.rad
    return np.stack(
        [np.sin(azimuth) * np.cos(elevation), np.cos(azimuth) * np.cos(elevation), np.sin(elevation)], axis=-1
    )


@contextmanager
def _astropy() -> Iterator[tuple[Any, Any, Any]]:
    """(astropy.coordinates, astropy.units, Time), with an Earth that turns evenly: UT1 = UTC, poles that do not move.

    The tables of how it does turn come over the network, or take astropy 10 s to read; they hold less than 0.9 s, less
    than a camera's clock is off, and 0.5 arcsec.
    """
    try:
        from astropy import coordinates, units  # optional
        from astropy.time import Time  # optional
        from astropy.utils import iers  # optional
    except ImportError:
        raise missing("astropy", "calibration from stars") from None

    level = iers.IERS(
        {
            "MJD": [0.0, 1e5] * units.d,
            "UT1_UTC": [0.0, 0.0] * units.s,
            "PM_x": [0.0, 0.0] * units.arcsec,
            "PM_y": [0.0, 0.0] * units.arcsec,
        }
    )
    with warnings.catch_warnings(), iers.conf.set_temp("auto_download", False), iers.earth_orientation_table.set(level):
        warnings.simplefilter("ignore")
        yield coordinates, units, Time
