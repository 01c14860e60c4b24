"""The night's light of a scene in any direction: the sky down to the horizon, and the ground that it lights."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from twilight.atmosphere.medium import Medium
from twilight.base.errors import TwilightError
from twilight.config.scene import Config, Night
from twilight.config.sun import SunAt, SunInterval, SunTimes
from twilight.numerics.orientation import azimuth_elevation, direction
from twilight.scene.suns import SceneSun
from twilight.sky.night import NightLevels, Place, night_radiance
from twilight.sky.night.points import Raster, StarPoints, StarSky, resolved_starlight_fraction
from twilight.sky.night.world import NATURAL_ZENITH_MAG, artificial_zenith_cd_per_m2
from twilight.transport.apparent_rays import horizon_dip_deg

ROWS = 46
"""Elevations from the horizon to the zenith, closer towards the horizon."""
COLUMN_DEG = 3.0
"""Distance of azimuths [deg]."""
MEAN_ROWS_DEG = np.arange(3.0, 90.0, 6.0)
"""Elevations of the directions [deg] whose light stands for what falls on the ground."""
MEAN_COLUMNS_DEG = np.arange(0.0, 360.0, 30.0)
"""Azimuths of these directions [deg]."""


@dataclass(frozen=True)
class NightLight:
    """elevation_deg (E,) from the horizon to 90; azimuth_deg (A,) from 0 to 360, both; radiance (E, A, K) and that of
    the ground (K,), in one unit.  Azimuths as those that are asked for, from the sun.

    stars: the brighter ones, whose light `radiance` then lacks; sun_azimuth_deg: from north, the zero of the azimuths.
    """

    elevation_deg: np.ndarray
    azimuth_deg: np.ndarray
    radiance: np.ndarray
    ground: np.ndarray
    stars: StarPoints | None = None
    sun_azimuth_deg: float = 0.0

    def at(self, elevation_deg: np.ndarray, azimuth_deg: np.ndarray) -> np.ndarray:
        """(..., K) in directions: bilinear, the ground below the horizon, NaN where a direction is NaN."""
        e, a = self.elevation_deg, np.mod(azimuth_deg, 360.0)
        inside = np.isfinite(elevation_deg)
        elevation = np.where(inside, elevation_deg, 0.0)
        i = np.clip(np.searchsorted(e, elevation, side="right") - 1, 0, e.size - 2)
        place = np.where(inside, a, 0.0) / self.azimuth_deg[1]
        j = np.minimum(place.astype(int), self.azimuth_deg.size - 2)
        f = np.clip((elevation - e[i]) / (e[i + 1] - e[i]), 0.0, 1.0)[..., None]
        g = (place - j)[..., None]
        r = self.radiance
        out = (1 - f) * ((1 - g) * r[i, j] + g * r[i, j + 1]) + f * ((1 - g) * r[i + 1, j] + g * r[i + 1, j + 1])
        out = np.where((elevation < e[0])[..., None], self.ground, out)
        return np.where(inside[..., None], out, np.nan)

    def seen_by(self, rays: np.ndarray, pitch_deg: float, hidden: np.ndarray | None = None) -> np.ndarray:
        """(H, W, K) of directions (H, W, 3) of pixels pitch_deg apart; hidden (H, W): where terrain, lit as the ground,
        stands before the sky."""
        azimuth, elevation = azimuth_elevation(rays)
        out = self.at(elevation, azimuth)
        if hidden is not None:
            out = np.where(hidden[..., None], self.ground, out)
        if self.stars is not None:
            towards = direction(self.stars.azimuth_deg - self.sun_azimuth_deg, self.stars.elevation_deg)
            Raster(rays, pitch_deg).add(out, towards, self.stars.irradiance, hidden)
        return out

    def over(self, irradiance: np.ndarray) -> NightLight:
        """This light over an irradiance (K,)."""
        stars = self.stars
        if stars is not None:
            stars = replace(stars, irradiance=stars.irradiance / irradiance)
        return replace(self, radiance=self.radiance / irradiance, ground=self.ground / irradiance, stars=stars)


def levels_of(night: Night) -> NightLevels:
    """How bright each part is."""
    given = night.light_pollution
    zenith = NATURAL_ZENITH_MAG if given is None else given.zenith_mag
    lamps = artificial_zenith_cd_per_m2(zenith)
    return NightLevels(night.airglow, night.starlight, night.zodiacal_light, lamps)


def check_stars(config: Config) -> None:
    """TwilightError for stars without a place and a time."""
    if config.night is not None and config.night.stars and not isinstance(config.sun, SunAt | SunTimes | SunInterval):
        raise TwilightError(
            f"{config.title}: night.stars needs a place and a time (sun.at, latitude_deg, longitude_deg); leave it out"
        )


def star_sky(night: Night, medium: Medium, altitude_km: float) -> StarSky | None:
    """The brighter stars as points, None where they are in the glow of all stars."""
    if night.stars is False or night.starlight == 0.0:
        return None
    return StarSky.of(medium, altitude_km, night.starlight)


def without_points(levels: NightLevels) -> NightLevels:
    """The glow of all stars without those that are points."""
    return replace(levels, starlight=levels.starlight * (1.0 - resolved_starlight_fraction()))


def place_of(sun: SceneSun) -> Place | None:
    """Where and when the observer stands, where a scene says it."""
    at = sun.section
    return Place(at.latitude_deg, at.longitude_deg, sun.time) if isinstance(at, SunAt) and sun.time else None


def night_light(
    medium: Medium,
    levels: NightLevels,
    altitude_km: float,
    *,
    sun_elevation_deg: float,
    sun_azimuth_deg: float | None = None,
    place: Place | None = None,
) -> NightLight:
    """The night [W m^-2 nm^-1 sr^-1] from an altitude, azimuths from the sun.

    Between the horizon of a high observer and 0 deg the sky is as at 0 deg.  The ground sends back by its albedo what
    falls on it, and no air stands before it.
    """
    dip = -horizon_dip_deg(medium, altitude_km)
    elevation = dip + (90.0 - dip) * np.linspace(0.0, 1.0, ROWS) ** 2
    azimuth = np.arange(0.0, 360.0 + COLUMN_DEG, COLUMN_DEG)
    where: dict[str, Any] = {"sun_elevation_deg": sun_elevation_deg, "sun_azimuth_deg": sun_azimuth_deg, "place": place}

    def radiance(rows: np.ndarray, columns: np.ndarray, observer_km: float) -> np.ndarray:
        return night_radiance(medium, rows, columns, levels, **where, observer_altitude_km=observer_km)

    half = radiance(np.maximum(elevation, 0.0), azimuth[:-1], altitude_km)
    falling = radiance(MEAN_ROWS_DEG, MEAN_COLUMNS_DEG, medium.bottom_km).mean(axis=1)
    weight = np.sin(2.0 * np.radians(MEAN_ROWS_DEG))
    ground = medium.ground_albedo * (weight @ falling) / weight.sum()
    return NightLight(elevation, azimuth, np.concatenate([half, half[:, :1]], axis=1), ground)
