"""The night in a scene: stars, airglow and what else shines without the sun; the moon's light and its disc.

The moon's sky is the field of the sun, looked up once more, times the moon's own spectrum.
"""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from twilight.atmosphere.medium import Medium
from twilight.base.errors import TwilightError, TwilightWarning
from twilight.config.scene import Config, Night
from twilight.config.sun import SunAt, SunInterval, SunTimes
from twilight.engine.sunbeam import Direct, make_disc
from twilight.io.rendered import ViewPixels
from twilight.numerics.directions import azimuth_elevation, direction
from twilight.numerics.spectrum import solar_irradiance
from twilight.scene.scene import Scene, SceneSun
from twilight.sky.moon import PHASE_RANGE_DEG, Moon, MoonDisc, MoonSeen
from twilight.sky.night import NightLevels, Place, night_radiance
from twilight.sky.night.points import Raster, StarPoints, StarSky, resolved_starlight_fraction
from twilight.sky.night.world import NATURAL_ZENITH_MAG, artificial_zenith_cd_per_m2
from twilight.transport.rays import horizon_dip_deg

ROWS = 46
"""Elevations from the horizon to the zenith, closer towards the horizon."""
COLUMN_DEG = 3.0
"""Distance of azimuths [deg]."""
MEAN_ROWS_DEG = np.arange(3.0, 90.0, 6.0)
"""Elevations of the directions [deg] whose light stands for what falls on the ground."""
MEAN_COLUMNS_DEG = np.arange(0.0, 360.0, 30.0)
"""Azimuths of these directions [deg]."""
PIECE_DEG = 0.02
"""Largest distance of the directions of a pixel whose mean is the disc's light in the pixel [deg]."""
MOST_PIECES = 24
"""Most of these directions across a pixel."""
PIXELS_AT_ONCE = 2048
"""Pixels whose directions are held at once."""


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


def night_on_grid(scene: Scene, sun: SceneSun, elevation_deg: np.ndarray, azimuth_deg: np.ndarray) -> np.ndarray | None:
    """Radiance of the night sky (E, A, W) where the configuration asks for it.

    Rows below the horizontal are as at 0 deg down to the horizon, and dark below it.
    """
    night = scene.configuration.night
    if night is None:
        return None
    radiance = night_radiance(
        scene.medium,
        np.maximum(elevation_deg, 0.0),
        azimuth_deg,
        levels_of(night),
        sun_elevation_deg=sun.elevation_deg,
        sun_azimuth_deg=sun.azimuth_deg,
        place=place_of(sun),
        observer_altitude_km=scene.altitude_km,
    )
    if elevation_deg[0] < 0.0:
        radiance[elevation_deg < -horizon_dip_deg(scene.medium, scene.altitude_km)] = 0.0
    return radiance


def night_of_view(scene: Scene, sun: SceneSun) -> NightLight | None:
    """The night in a view, over the sun's irradiance above the air [sr^-1]."""
    config = scene.configuration
    if config.night is None or scene.observer.view is None:
        return None
    place, altitude = place_of(sun), scene.altitude_km
    points = None if place is None else star_sky(config.night, scene.medium, altitude)
    levels = levels_of(config.night)
    night = night_light(
        scene.medium,
        levels if points is None else without_points(levels),
        altitude,
        sun_elevation_deg=sun.elevation_deg,
        sun_azimuth_deg=sun.azimuth_deg,
        place=place,
    )
    if points is not None and place is not None:
        night = replace(night, stars=points.over(place), sun_azimuth_deg=sun.azimuth_deg or 0.0)
    return night.over(solar_irradiance(scene.medium.wavelength_nm, config.solar_spectrum, sun.distance_au))


@dataclass(frozen=True, eq=False)
class MoonLight:
    """seen: the moon of the sky; irradiance (W,): above the air [W m^-2 nm^-1]; over_sun (W,): over that of the sun."""

    seen: MoonSeen
    irradiance: np.ndarray
    over_sun: np.ndarray


def warn_of_the_moon(config: Config, moon: Moon) -> None:
    """TwilightWarning where the moon gives no light, and where its phase is not one that was observed."""
    if not moon.shines:
        text = f"stands at {moon.elevation_deg:.1f} deg, below the horizon, and lights nothing"
    elif moon.phase_angle_deg < PHASE_RANGE_DEG[0]:
        text = f"is {moon.phase_angle_deg:.2f} deg from opposition: eclipses are not computed, it is as at 1.55 deg"
    else:
        return
    warnings.warn(f"{config.title}: the moon {text}", TwilightWarning, stacklevel=4)


def moon_light(
    scene: Scene, moon: Moon, direct: Sequence[Direct] | None, sun_elevation_deg: float, sun_distance_au: float
) -> MoonLight:
    """The moon over a scene; direct: of the blocks of wavelengths, by the sun's beam in its place, None: it is down."""
    medium = scene.medium
    over_one_au = moon.irradiance_factor(medium.wavelength_nm)
    solar = solar_irradiance(medium.wavelength_nm, scene.configuration.solar_spectrum)
    beam, apparent, disc = np.zeros_like(solar), moon.elevation_deg, None
    if direct:
        apparent += direct[-1].bending_deg
        path = make_disc(medium, moon.elevation_deg, scene.altitude_km, bands=scene.bands, radius_deg=moon.radius_deg)
        if path.is_seen:
            disc = MoonDisc(path, moon, sun_elevation_deg)
            beam = disc.irradiance_factor() * solar
    return MoonLight(MoonSeen(moon, apparent, beam, disc), over_one_au * solar, over_one_au * sun_distance_au**2)


def with_moon(pixels: ViewPixels, by_moon: np.ndarray, light: MoonLight) -> ViewPixels:
    """The view with the moon's light and disc in it; by_moon (H, W, K): the same under the moon as the sun [sr^-1]."""
    return _with_disc(replace(pixels, radiance=(pixels.radiance + by_moon * light.over_sun).astype(np.float32)), light)


def _with_disc(pixels: ViewPixels, light: MoonLight) -> ViewPixels:
    """The view with the disc: each pixel has the mean of directions `PIECE_DEG` apart."""
    disc, moon = light.seen.disc, light.seen.moon
    if disc is None:
        return pixels
    disc = disc.without_dispersion()
    lower, upper = disc.edges_deg()
    middle = direction(moon.azimuth_deg, 0.5 * (lower + upper))
    rays = pixels.rays.astype(float)
    largest_angle = np.radians(upper - lower + 3.0 * pixels.pitch_deg)
    chord = np.linalg.norm(np.nan_to_num(rays) - middle, axis=-1)
    near = (chord < 2.0 * np.sin(min(0.5 * largest_angle, 0.5 * np.pi))) & np.isfinite(rays).all(axis=-1)
    where = np.nonzero(near if pixels.hidden is None else near & ~pixels.hidden)
    if not where[0].size:
        return pixels
    count = int(np.clip(np.ceil(pixels.pitch_deg / PIECE_DEG), 2, MOST_PIECES))
    step = np.radians(pixels.pitch_deg) * ((np.arange(count) + 0.5) / count - 0.5)
    ray = rays[where]
    right = np.cross(ray, [0.0, 0.0, 1.0])
    right /= np.maximum(np.linalg.norm(right, axis=-1, keepdims=True), 1e-9)
    up = np.cross(right, ray)
    radiance = pixels.radiance.copy()
    covered = np.zeros(pixels.shape) if pixels.sun is None else pixels.sun.copy()
    over_sun = light.over_sun / moon.irradiance_factor(disc.wavelength_nm)  # for the disc counts from the sun at 1 au
    for k in range(0, len(ray), PIXELS_AT_ONCE):
        part = np.s_[k : k + PIXELS_AT_ONCE]
        inside = where[0][part], where[1][part]
        r, x, y = (v[part][:, None, None] for v in (ray, right, up))
        pieces = r + x * step[:, None] + y * step[:, None, None]
        azimuth, elevation = azimuth_elevation(pieces)
        shown = disc.radiance(elevation, np.mod(azimuth - moon.azimuth_deg + 180.0, 360.0) - 180.0)
        radiance[inside] += (shown.mean(axis=(1, 2)) * over_sun).astype(radiance.dtype)
        covered[inside] = np.maximum(covered[inside], (shown.max(axis=-1) > 0.0).mean(axis=(1, 2)))
    return replace(pixels, radiance=radiance, sun=covered)
