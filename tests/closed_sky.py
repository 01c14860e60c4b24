"""A sky in closed form, brighter towards the sun, for tests of pages, films and shaders: its solver takes no time."""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from airs import scene_of_field, turbid

from twilight.engine import Field, solve
from twilight.numerics.directions import scattering_angle_rad
from twilight.show.page import PageNodes
from twilight.show.tones import Channels
from twilight.solvers.base import BareField

EIGHT_NM = np.array([380.0, 440.0, 472.0, 548.0, 580.0, 616.0, 676.0, 756.0])
"""Wavelengths of pages and shaders [nm]."""
FIVE_NM = np.array([400.0, 470.0, 540.0, 600.0, 680.0])
"""Wavelengths of films [nm]."""
COARSE = PageNodes(ground=5, haze=5, sky=17, columns=13)
"""Nodes of the tables of pages."""
ELEVEN_SUNS_DEG = (20.0, 10.0, 4.0, 1.0, -1.0, -2.5, -4.0, -6.0, -9.0, -12.0, -17.9)
"""Suns under which every page is compared with Python [deg]."""
ALL_SKY = {"projection": "fisheye", "fov": 180, "elevation": 90, "azimuth": 0}
"""State of a page that shows the whole sky."""


def bluer_upwards(e: np.ndarray, a: np.ndarray) -> np.ndarray:
    """Exponent of the wavelength by elevation and azimuth [rad]."""
    return -1.0 - 2.0 * np.sin(e) ** 2


@dataclass
class ClosedSky(BareField):
    """L/F0 = level(sun) (1.2 + 0.4 cos e cos a + 0.3 cos 2e) (wavelength / 550 nm)^colour(e, a), 2 % more a kilometre
    up.

    level: of the sun's elevation [deg]; colour: of elevation e and azimuth a [rad].
    """

    medium: Any
    level: Callable[[float], float]
    colour: Callable[[np.ndarray, np.ndarray], np.ndarray] = bluer_upwards

    def radiance(self, sun_elevation_deg, elevation_deg, azimuth_deg, *, observer_altitude_km=0.0):
        e, a = np.broadcast_arrays(np.radians(elevation_deg), np.radians(azimuth_deg))
        shape = 1.2 + 0.4 * np.cos(e) * np.cos(a) + 0.3 * np.cos(2 * e)
        colour = (self.medium.wavelength_nm / 550.0) ** self.colour(e, a)[..., None]
        return self.level(sun_elevation_deg) * (1.0 + 0.02 * observer_altitude_km) * shape[..., None] * colour


def solved(level: Callable[[float], float]) -> Field:
    """Of hazy air at EIGHT_NM."""
    return solve(scene_of_field(ClosedSky(turbid(wavelength_nm=EIGHT_NM), level)), cached=False)


def gone_at_17_deg(sun_elevation_deg: float) -> float:
    """A level that falls as twilight does, faster and faster."""
    return math.exp(2.0 * min(sun_elevation_deg, 0.0) ** 3 / (100.0 + sun_elevation_deg**2))


def closed(name: str = "closed", level: float = 1.0) -> Field:
    """A solved sky of that level, times a factor, under a title."""
    medium = turbid(wavelength_nm=EIGHT_NM)
    scene = scene_of_field(ClosedSky(medium, lambda sun: level * gone_at_17_deg(sun)))
    return solve(replace(scene, title=name), cached=False)


def field_luminance(solved: Field, sun_deg: float, count: int = 1000) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Elevation and azimuth [deg] of lines of sight from 0.3 deg up to the zenith, a third of them below 10 deg, 0.3
    deg off the sun's disc at least, and the field's luminance there [cd m^-2], (N,) each."""
    random = np.random.default_rng(1)
    elevation = np.degrees(np.arcsin(random.uniform(math.sin(math.radians(0.3)), 1.0, count)))
    elevation[: count // 3] = random.uniform(0.3, 10.0, count // 3)
    azimuth = random.uniform(-180.0, 180.0, count)
    azimuth[::5] = random.uniform(-10.0, 10.0, azimuth[::5].size)
    keep = np.degrees(scattering_angle_rad(sun_deg, elevation, azimuth)) > 0.3 + 0.27 + 0.6
    elevation, azimuth = elevation[keep], azimuth[keep]
    channels = Channels(solved.medium.wavelength_nm)
    return elevation, azimuth, channels.of(solved.radiance(sun_deg, elevation, azimuth))[:, 1]
