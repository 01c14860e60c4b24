"""The moon of a film: where it stands in every picture, and its disc."""

from __future__ import annotations

from dataclasses import dataclass
from datetime import timedelta

import numpy as np

from twilight.animation.disc import RefractedBeam
from twilight.animation.timeline import FilmTimeline
from twilight.config.scene import Config
from twilight.config.sun import SunInterval
from twilight.scene.moons import placed_moon
from twilight.sky.moon import Moon, disc_integral, moon_over, surface, towards_sun
from twilight.viewer.moonlight import MoonColours

PIECE_DEG = 0.03
"""Distance of the points of a pixel whose mean is the disc's light in it [deg]."""
MOST_PIECES = 16
"""Most points across a pixel."""


def moons_of(config: Config, line: FilmTimeline) -> list[Moon] | None:
    """The moon of every picture, its azimuth from the sun's; None where the configuration has none.

    One that is put somewhere stands still, as seen from the sun's azimuth.
    """
    if config.moon is None:
        return None
    suns = zip(line.time_s, line.elevation_deg, line.azimuth_deg, line.distance_au, strict=True)
    sun = config.sun
    if not isinstance(sun, SunInterval):
        return [placed_moon(config.moon, float(e), float(au)) for _, e, _, au in suns]
    start, where = sun.aware(sun.start), (sun.latitude_deg, sun.longitude_deg)
    altitude_km = config.observer.altitude_km
    return [moon_over(start + timedelta(seconds=float(t)), *where, float(a), altitude_km) for t, _, a, _ in suns]


@dataclass(frozen=True)
class MoonDiscPainter(RefractedBeam):
    """Draws the moon's disc, whose beam is the sun's in moonlight."""

    colours: MoonColours

    def light(
        self, elevation_deg: np.ndarray, azimuth_deg: np.ndarray, pixel_deg: float, moon: Moon, sun_elevation_deg: float
    ) -> np.ndarray:
        """Channels [cd m^-2] of the disc in directions (H, W), (H, W, 4); azimuth from the sun's.

        A pixel has the mean of its points, so that a disc smaller than it keeps its light.
        """
        light = np.zeros((*elevation_deg.shape, 4))
        near = self.near(elevation_deg, moon.elevation_deg, pixel_deg)
        if not near.any():
            return light
        true, beam = self.at(elevation_deg[near])
        m, across = np.radians(moon.elevation_deg), np.radians(azimuth_deg[near] - moon.azimuth_deg)
        radius = np.sin(np.radians(moon.radius_deg))
        x = np.cos(true) * np.sin(across) / radius
        y = (np.sin(true) * np.cos(m) - np.cos(true) * np.sin(m) * np.cos(across)) / radius
        facing = np.cos(true) * np.cos(m) * np.cos(across) + np.sin(true) * np.sin(m) > 0.0
        count = int(np.clip(np.ceil(pixel_deg / PIECE_DEG), 2, MOST_PIECES))
        step = np.radians(pixel_deg) / radius * ((np.arange(count) + 0.5) / count - 0.5)
        place = x[:, None, None] + step[:, None], y[:, None, None] + step
        shape = surface(*place, towards_sun(moon, sun_elevation_deg), moon.phase_angle_deg).mean(axis=(1, 2))
        whole = self.colours.moonlit(beam, moon)
        light[near] = (np.where(facing, shape, 0.0) / radius**2 / disc_integral(moon.phase_angle_deg))[:, None] * whole
        return light
