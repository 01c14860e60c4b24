"""Places and times with their sun and moon."""

from __future__ import annotations

from collections.abc import Sequence
from datetime import datetime
from typing import NamedTuple

import numpy as np

from twilight.base.errors import TwilightError
from twilight.sky.ephemeris import AU_KM, Sites
from twilight.sky.moon import LOWEST_DEG, irradiance_factors, is_waxing
from twilight.sky.night import Place

HIGHEST_SITE_KM = 100.0
"""Observers above this are taken as this high for the parallax of sun and moon."""


class Moons(NamedTuple):
    """The moon over N places and times, each (N,): true elevation, azimuth from north and phase angle [deg], distances
    from the observer [km] and from the sun [au]."""

    elevation_deg: np.ndarray
    azimuth_deg: np.ndarray
    phase_angle_deg: np.ndarray
    distance_km: np.ndarray
    sun_distance_au: np.ndarray
    waxing: np.ndarray

    @property
    def shines(self) -> np.ndarray:
        """Whether it lights the air over the observer, (N,)."""
        return self.elevation_deg >= LOWEST_DEG

    def irradiance_factor(self, wavelength_nm: np.ndarray) -> np.ndarray:
        """Irradiance above the air over the sun's at 1 au, (N, W)."""
        return irradiance_factors(
            wavelength_nm, self.phase_angle_deg, self.waxing, self.distance_km, self.sun_distance_au
        )


class Moments(NamedTuple):
    """N places and times with their sun: places, and elevation (true) and azimuth from north (N,) [deg], distance
    [au]; and with their moon."""

    places: tuple[Place, ...]
    sun_elevation_deg: np.ndarray
    sun_azimuth_deg: np.ndarray
    distance_au: np.ndarray
    moon: Moons

    def part(self, chosen: slice | np.ndarray) -> Moments:
        """Some of them; chosen: a range, or indices."""
        index = np.arange(len(self.places))[chosen]
        places = tuple(self.places[i] for i in index)
        height, azimuth, distance = self.sun_elevation_deg[index], self.sun_azimuth_deg[index], self.distance_au[index]
        return Moments(places, height, azimuth, distance, Moons._make(v[index] for v in self.moon))


def moments_at(
    latitude_deg: Sequence[float], longitude_deg: Sequence[float], times: Sequence[datetime], altitude_km: float = 0.0
) -> Moments:
    """The suns and moons of N places and times (with offsets).

    Errors: TwilightError for a latitude that is none, and for years outside those of the ephemeris.
    """
    keys = list(zip(latitude_deg, longitude_deg, strict=True))
    sun, moon = np.zeros((3, len(keys))), np.zeros((6, len(keys)))
    here: dict[tuple[float, float], list[int]] = {}
    for n, key in enumerate(keys):
        here.setdefault(key, []).append(n)
    for (latitude, longitude), which in here.items():
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
    return Moments(places, sun[0], sun[1], sun[2], Moons._make([*moon[:5], moon[5] > 0.0]))
