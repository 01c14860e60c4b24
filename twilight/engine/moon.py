"""The moon's light in a scene: the sun's field, looked up once more, times the moon's own spectrum; and its disc."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from twilight.base.errors import TwilightWarning
from twilight.config.scene import Config
from twilight.engine.disc import make_disc
from twilight.engine.sunbeam import Direct
from twilight.io.rendered import ViewPixels
from twilight.numerics.orientation import azimuth_elevation, direction
from twilight.numerics.spectrum import solar_irradiance
from twilight.sky.moon import PHASE_RANGE_DEG, Moon, MoonDisc, MoonSeen

if TYPE_CHECKING:
    from twilight.scene.scene import Scene

PIECE_DEG = 0.02
"""Largest distance of the directions of a pixel whose mean is the disc's light in the pixel [deg]."""
MOST_PIECES = 24
"""Most of these directions across a pixel."""
PIXELS_AT_ONCE = 2048
"""Pixels whose directions are held at once."""


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


def with_moon(seen: ViewPixels, by_moon: np.ndarray, light: MoonLight) -> ViewPixels:
    """The view with the moon's light and disc in it; by_moon (H, W, K): the same under the moon as the sun [sr^-1]."""
    return _with_disc(replace(seen, radiance=(seen.radiance + by_moon * light.over_sun).astype(np.float32)), light)


def _with_disc(seen: ViewPixels, light: MoonLight) -> ViewPixels:
    """The view with the disc: each pixel has the mean of directions `PIECE_DEG` apart."""
    disc, moon = light.seen.disc, light.seen.moon
    if disc is None:
        return seen
    disc = disc.without_dispersion()
    lower, upper = disc.edges_deg()
    middle = direction(moon.azimuth_deg, 0.5 * (lower + upper))
    rays = seen.rays.astype(float)
    largest_angle = np.radians(upper - lower + 3.0 * seen.pitch_deg)
    chord = np.linalg.norm(np.nan_to_num(rays) - middle, axis=-1)
    near = (chord < 2.0 * np.sin(min(0.5 * largest_angle, 0.5 * np.pi))) & np.isfinite(rays).all(axis=-1)
    where = np.nonzero(near if seen.hidden is None else near & ~seen.hidden)
    if not where[0].size:
        return seen
    count = int(np.clip(np.ceil(seen.pitch_deg / PIECE_DEG), 2, MOST_PIECES))
    step = np.radians(seen.pitch_deg) * ((np.arange(count) + 0.5) / count - 0.5)
    ray = rays[where]
    right = np.cross(ray, [0.0, 0.0, 1.0])
    right /= np.maximum(np.linalg.norm(right, axis=-1, keepdims=True), 1e-9)
    up = np.cross(right, ray)
    radiance = seen.radiance.copy()
    covered = np.zeros(seen.shape) if seen.sun is None else seen.sun.copy()
    over_sun = light.over_sun / moon.irradiance_factor(disc.wavelength_nm)  # for the disc counts from the sun at 1 au
    for k in range(0, len(ray), PIXELS_AT_ONCE):
        part = np.s_[k : k + PIXELS_AT_ONCE]
        here = where[0][part], where[1][part]
        r, x, y = (v[part][:, None, None] for v in (ray, right, up))
        pieces = r + x * step[:, None] + y * step[:, None, None]
        azimuth, elevation = azimuth_elevation(pieces)
        shown = disc.radiance(elevation, np.mod(azimuth - moon.azimuth_deg + 180.0, 360.0) - 180.0)
        radiance[here] += (shown.mean(axis=(1, 2)) * over_sun).astype(radiance.dtype)
        covered[here] = np.maximum(covered[here], (shown.max(axis=-1) > 0.0).mean(axis=(1, 2)))
    return replace(seen, radiance=radiance, sun=covered)
