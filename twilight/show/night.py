"""The night's light in a film: found at some moments, drawn once for each, mixed in between."""

from __future__ import annotations

from dataclasses import dataclass, replace
from datetime import UTC, datetime, timedelta
from functools import lru_cache

import numpy as np

from twilight.atmosphere.medium import Medium
from twilight.config.scene import Config
from twilight.config.sun import SunInterval
from twilight.engine.night import NightLight, levels_of, night_light, star_sky, without_points
from twilight.numerics.directions import direction
from twilight.show.timeline import FilmTimeline
from twilight.show.tones import Channels
from twilight.sky.night import Place
from twilight.sky.night.points import Raster, StarSky

STEP_S = 900.0
"""Largest time between two moments: the stars turn by 3.75 deg."""


@dataclass(frozen=True, eq=False)
class MovingStars:
    """The brighter stars as points over a place: sky, what the air does to them; channels (W, 4), X, Y, Z and scotopic
    luminance of a radiance of 1 at each wavelength; place: with the time of the film's beginning."""

    sky: StarSky
    channels: np.ndarray
    place: Place

    def at(self, time_s: float) -> tuple[np.ndarray, np.ndarray]:
        """Directions (N, 3) east, north, up and illuminances (N, 4) at a time of the film."""
        points = self.sky.over(replace(self.place, time=self.place.time + timedelta(seconds=time_s)))
        return direction(points.azimuth_deg, points.elevation_deg), points.irradiance @ self.channels

    def arrays(self) -> dict[str, np.ndarray]:
        """As `from_arrays` takes them."""
        sky, place = self.sky, self.place
        return {
            "stars_rows": np.stack([sky.apparent_deg, sky.true_deg]),
            "stars_passed": sky.passed,
            "stars_wavelength_nm": sky.wavelength_nm,
            "stars_channels": self.channels,
            "stars_place": np.array([sky.level, place.latitude_deg, place.longitude_deg, place.time.timestamp()]),
        }

    @classmethod
    def from_arrays(cls, cached: dict[str, np.ndarray]) -> MovingStars:
        """What `arrays` gave."""
        level, latitude, longitude, begin = (float(v) for v in cached["stars_place"])
        apparent, true = cached["stars_rows"]
        sky = StarSky(apparent, true, cached["stars_passed"], cached["stars_wavelength_nm"], level)
        return cls(sky, cached["stars_channels"], Place(latitude, longitude, datetime.fromtimestamp(begin, UTC)))


@dataclass(frozen=True)
class Nights:
    """time_s (K,): of the moments; sun_azimuth_deg (K,), from which the azimuths of `lights` count.

    lights: X, Y, Z and scotopic luminance [cd m^-2]; stars: those that are points, whose light `lights` lack.
    """

    time_s: np.ndarray
    sun_azimuth_deg: np.ndarray
    lights: tuple[NightLight, ...]
    stars: MovingStars | None = None

    def arrays(self) -> dict[str, np.ndarray]:
        """As `from_arrays` takes them."""
        return {
            "night_time_s": self.time_s,
            "night_sun_azimuth_deg": self.sun_azimuth_deg,
            "night_elevation_deg": self.lights[0].elevation_deg,
            "night_azimuth_deg": self.lights[0].azimuth_deg,
            "night_radiance": np.stack([one.radiance for one in self.lights]),
            "night_ground": np.stack([one.ground for one in self.lights]),
            **({} if self.stars is None else self.stars.arrays()),
        }

    @classmethod
    def from_arrays(cls, cached: dict[str, np.ndarray]) -> Nights:
        """What `arrays` gave."""
        axes = cached["night_elevation_deg"], cached["night_azimuth_deg"]
        pairs = zip(cached["night_radiance"], cached["night_ground"], strict=True)
        lights = tuple(NightLight(*axes, r, g) for r, g in pairs)
        stars = MovingStars.from_arrays(cached) if "stars_place" in cached else None
        return cls(cached["night_time_s"], cached["night_sun_azimuth_deg"], lights, stars)


def nights_of(config: Config, medium: Medium, channels: Channels, line: FilmTimeline) -> Nights | None:
    """The nights of a film, None where its configuration has none."""
    if config.night is None:
        return None
    span = float(line.time_s[-1])
    times = np.linspace(0.0, span, 1 + int(np.ceil(span / STEP_S)))
    elevation, azimuth = (np.interp(times, line.time_s, v) for v in (line.elevation_deg, line.azimuth_deg))
    levels, stars, lights, site = levels_of(config.night), None, [], None
    if isinstance(config.sun, SunInterval):
        site = Place(config.sun.latitude_deg, config.sun.longitude_deg, config.sun.aware(config.sun.start))
        sky = star_sky(config.night, medium, config.observer.altitude_km)
        if sky is not None:
            levels = without_points(levels)
            stars = MovingStars(sky, channels.of(np.diag(1.0 / channels.solar_irradiance)), site)
    for t, e, a in zip(times, elevation, azimuth, strict=True):
        place = None if site is None else replace(site, time=site.time + timedelta(seconds=float(t)))
        night = night_light(
            medium,
            levels,
            config.observer.altitude_km,
            sun_elevation_deg=float(e),
            sun_azimuth_deg=None if place is None else float(a),
            place=place,
        )
        radiance, ground = (channels.of(v / channels.solar_irradiance) for v in (night.radiance, night.ground))
        lights.append(NightLight(night.elevation_deg, night.azimuth_deg, radiance, ground))
    return Nights(times, azimuth, tuple(lights), stars)


class NightPainter:
    """Draws the night in a fixed set of directions (H, W) [deg], at any time of the film."""

    def __init__(self, nights: Nights, elevation_deg: np.ndarray, azimuth_deg: np.ndarray):
        self.nights = nights
        self._raster = None if nights.stars is None else Raster(direction(azimuth_deg, elevation_deg), 1.0)

        @lru_cache(maxsize=2)
        def picture(k: int) -> np.ndarray:
            away = azimuth_deg - nights.sun_azimuth_deg[k]
            return np.nan_to_num(nights.lights[k].at(elevation_deg, away)).astype(np.float32)

        self._picture = picture

    def light(self, time_s: float) -> np.ndarray:
        """X, Y, Z and scotopic luminance [cd m^-2], (H, W, 4); 0 outside the picture."""
        out = self._glow(time_s)
        if self.nights.stars is None or self._raster is None:
            return out
        out = out.copy()
        self._raster.add(out, *self.nights.stars.at(time_s))
        return out

    def _glow(self, time_s: float) -> np.ndarray:
        times = self.nights.time_s
        k = int(np.clip(np.searchsorted(times, time_s, side="right") - 1, 0, max(times.size - 2, 0)))
        if times.size == 1:
            return self._picture(0)
        fraction = float(np.clip((time_s - times[k]) / (times[k + 1] - times[k]), 0.0, 1.0))
        return (1.0 - fraction) * self._picture(k) + fraction * self._picture(k + 1)
