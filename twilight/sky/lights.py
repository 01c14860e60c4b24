"""A sky is a sum of lights: luminaries, the field under a body's elevation, and glows, patterns seen through the air.

    L(direction) = sum_bodies F L_field(elevation of the body; direction from its azimuth)
                 + sum_glows  sum_k S_k (p_k(direction) t + <p_k> (1 - t) s)

F: irradiance of a body above the air; S_k, p_k: spectra and patterns of a glow, <p_k> the mean over the hemisphere; t,
s: what the air lets pass and scatters in (`twilight.sky.night.world.veil`).  Luminaries are `Sun` and
`twilight.sky.moon.Moon`, glows those of `twilight.sky.night.glows`; `Scene.lights` says which a moment has.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import Any, ClassVar, Self

import numpy as np

from twilight.sky.disc import SOLAR_RADIUS_DEG

TIMES_BRIGHTER = 1e4
"""A glow is left out where sunlight is so many times brighter at every wavelength in everything that is asked for: each
changes it by less than a ten-thousandth."""


class Light(ABC):
    """A part of the light of a sky; `name` is what `sources` and `Sky.lights` call it."""

    name: ClassVar[str]


class Luminary(Light):
    """A body whose light in the air is the field under its elevation, turned to its azimuth, times its irradiance.

    elevation_deg: true, of its centre; azimuth_deg: clockwise from whatever azimuths count from.  Both are numbers, or
    (N,) at N moments.
    """

    strips: ClassVar[int]
    """Horizontal strips of the disc that are refracted each by itself where it shines on surfaces."""
    elevation_deg: Any
    azimuth_deg: Any

    @property
    @abstractmethod
    def radius_deg(self) -> Any:
        """Angular radius [deg]."""

    @property
    @abstractmethod
    def shines(self) -> Any:
        """Whether it lights the air over the observer."""

    @abstractmethod
    def irradiance_factor(self, wavelength_nm: np.ndarray) -> np.ndarray:
        """Irradiance above the air over the sun's at 1 au, (..., W)."""

    def part(self, index: Any) -> Self:
        """At some of the moments."""
        return type(self)(*(None if value is None else value[index] for value in vars(self).values()))


@dataclass(frozen=True)
class Sun(Luminary):
    """The sun over an observer; distance_au: from the Earth."""

    name: ClassVar[str] = "sun"
    strips: ClassVar[int] = 12
    elevation_deg: Any
    azimuth_deg: Any = 0.0
    distance_au: Any = 1.0

    @property
    def radius_deg(self) -> Any:
        """Angular radius [deg]."""
        return np.degrees(np.arcsin(np.sin(np.radians(SOLAR_RADIUS_DEG)) / self.distance_au))

    @property
    def shines(self) -> Any:
        """Always: the field says how much."""
        return np.ones(np.shape(self.elevation_deg), bool)

    def irradiance_factor(self, wavelength_nm: np.ndarray) -> np.ndarray:
        """As of `Luminary`."""
        return np.multiply.outer(1.0 / np.square(self.distance_au), np.ones(np.size(wavelength_nm)))


def outshone(brightest: np.ndarray, light: np.ndarray) -> np.ndarray:
    """Whether light (..., W) is so much brighter than a glow ever is (W,) that it is left out, (...)."""
    return np.asarray((light > TIMES_BRIGHTER * brightest).all(axis=-1))
