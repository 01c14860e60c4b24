"""The moon of a film: where it stands in every picture, and its disc."""

from __future__ import annotations

from dataclasses import dataclass
from datetime import timedelta

import numpy as np

from twilight.animation.timeline import Timeline
from twilight.config.scene import Config
from twilight.config.sun import SunInterval
from twilight.scene.moons import placed_moon
from twilight.sky.moon import Moon, moon_over
from twilight.sky.moon.disc import disc_integral, surface, towards_sun
from twilight.viewer.lines import sky_elevations
from twilight.viewer.moonlight import MoonColours

PIECE_DEG = 0.03
"""Distance of the points of a pixel whose mean is the disc's light in it [deg]."""
MOST_PIECES = 16
"""Most points across a pixel."""


def moons_of(config: Config, line: Timeline) -> list[Moon] | None:
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
class MoonDiscPainter:
    """refraction_deg (N,), beam (N, 4): of the sun's disc at 1 au, as `viewer.lines.sunbeam`; horizon_deg: apparent."""

    refraction_deg: np.ndarray
    beam: np.ndarray
    horizon_deg: float
    colours: MoonColours

    def light(
        self,
        elevation_deg: np.ndarray,
        azimuth_deg: np.ndarray,
        pixel_deg: float,
        moon: Moon,
        sun_elevation_deg: float,
    ) -> np.ndarray:
        """Channels [cd m^-2] of the disc in directions (H, W), (H, W, 4); azimuth from the sun's.

        A pixel has the mean of its points, so that a disc smaller than it keeps its light.
        """
        light = np.zeros((*elevation_deg.shape, 4))
        with np.errstate(invalid="ignore"):
            near = np.abs(elevation_deg - moon.elevation_deg) < 2.0 + pixel_deg
            near &= elevation_deg >= self.horizon_deg
        if not near.any():
            return light
        nodes, e = sky_elevations(self.horizon_deg), elevation_deg[near]
        true = np.radians(e - np.interp(e, nodes, self.refraction_deg))
        m, across = np.radians(moon.elevation_deg), np.radians(azimuth_deg[near] - moon.azimuth_deg)
        radius = np.sin(np.radians(moon.radius_deg))
        x = np.cos(true) * np.sin(across) / radius
        y = (np.sin(true) * np.cos(m) - np.cos(true) * np.sin(m) * np.cos(across)) / radius
        ahead = np.cos(true) * np.cos(m) * np.cos(across) + np.sin(true) * np.sin(m) > 0.0
        count = int(np.clip(np.ceil(pixel_deg / PIECE_DEG), 2, MOST_PIECES))
        step = np.radians(pixel_deg) / radius * ((np.arange(count) + 0.5) / count - 0.5)
        place = x[:, None, None] + step[:, None], y[:, None, None] + step
        shape = surface(*place, towards_sun(moon, sun_elevation_deg), moon.phase_angle_deg).mean(axis=(1, 2))
        beam = np.stack([np.exp(np.interp(e, nodes, column)) for column in np.log(self.beam).T], axis=-1)
        whole = self.colours.moonlit(beam, moon)
        light[near] = (np.where(ahead, shape, 0.0) / radius**2 / disc_integral(moon.phase_angle_deg))[:, None] * whole
        return light
