"""The sun's disc in pictures and environment maps."""

from __future__ import annotations

import numpy as np

from twilight.base.conventions import EARTH_RADIUS_KM
from twilight.io.environment import pixel_of, pixel_solid_angle
from twilight.numerics.orientation import azimuth_elevation, direction
from twilight.sky import colour
from twilight.sky.disc import Disc
from twilight.sky.sky import Sky
from twilight.sky.tone import Light, Tone

COLOUR_STEP_NM = 10.0
"""Every wavelength has an edge of the disc of its own: colours need more of them than the sky."""
_NODES = 24
"""Points of a row, from limb to limb, whose light is given to the pixels of a map."""


def _fine(disc: Disc) -> Disc:
    """The disc at wavelengths close enough for its colours, where those of the sky are far apart."""
    nm = disc.wavelength_nm
    if nm.size == 1 or np.diff(nm).max() <= COLOUR_STEP_NM:
        return disc
    return disc.at_wavelengths(np.linspace(nm[0], nm[-1], int(np.ceil((nm[-1] - nm[0]) / COLOUR_STEP_NM)) + 1))


def _xyz(sky: Sky, disc: Disc, factor: np.ndarray, observer: str) -> np.ndarray:
    return colour.factor_to_xyz(factor, disc.wavelength_nm, sky.solar_spectrum, sky.distance_au, observer)


def add_to_map_xyz(sky: Sky, picture: np.ndarray, renderer: str, width: int, observer: str) -> None:
    """Add the light of the disc to an environment map (height, width, 3) of XYZ [cd m^-2]."""
    if sky.disc is None:
        return
    disc = _fine(sky.disc)
    elevation, azimuth, light = _pieces(disc)
    if light.size:
        _give(sky, picture, renderer, width, elevation, azimuth, _xyz(sky, disc, light, observer))


def add_to_map_factor(sky: Sky, picture: np.ndarray, renderer: str, width: int) -> None:
    """Add the light of the disc to an environment map (height, width, W) of radiance over F0 [sr^-1]."""
    if sky.disc is not None:
        elevation, azimuth, light = _pieces(sky.disc)
        if light.size:
            _give(sky, picture, renderer, width, elevation, azimuth, light)


def _pieces(disc: Disc) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Elevation, azimuth from the sun [deg] and irradiance over F0 (N, W) of small pieces of the disc's image.

    The pieces of all wavelengths are those of the widest one; their light sums to `Disc.irradiance_factor`.
    """
    rows = disc.rows()
    keep = rows.any(axis=1)
    if not keep.any():
        return np.zeros(0), np.zeros(0), np.zeros((0, disc.wavelength_nm.size))
    elevation, rows = disc.elevation_deg[keep], rows[keep]
    half = disc.half_width_deg()[keep].max(axis=1)
    node = (np.arange(_NODES) + 0.5) / _NODES * 2.0 - 1.0
    azimuth = half[:, None] * node
    fraction = disc.radiance(elevation[:, None], azimuth)
    total = fraction.sum(axis=1, keepdims=True)
    # a wavelength whose disc is narrower than the distance of the points has its light in the middle
    middle = np.full((1, _NODES, 1), 1.0 / _NODES)
    fraction = np.where(total > 0.0, fraction / np.where(total > 0.0, total, 1.0), middle)
    light = rows[:, None, :] * fraction
    return np.repeat(elevation, _NODES), azimuth.ravel(), light.reshape(-1, light.shape[-1])


def _give(
    sky: Sky,
    picture: np.ndarray,
    renderer: str,
    width: int,
    elevation: np.ndarray,
    azimuth: np.ndarray,
    light: np.ndarray,
) -> None:
    """Give light (N, K) to the pixels that it comes from, as radiance: the map keeps its sum."""
    row, column = pixel_of(renderer, width, elevation, azimuth + (sky.sun_azimuth_deg or 0.0))
    np.add.at(picture, (row, column), light / pixel_solid_angle(renderer, width)[row, column, None])


def add_to_picture(
    sky: Sky,
    picture: np.ndarray,
    elevation_deg: np.ndarray,
    azimuth_deg: np.ndarray,
    tone: Tone,
    points: int = 8,
) -> None:
    """Add the disc to a picture (height, width, K) of a tone's channels, whose pixels look in directions from the sun.

    elevation_deg, azimuth_deg: broadcast to (height, width).  Each pixel holds the mean of points x points.
    """
    if sky.disc is None or not sky.disc.is_seen:
        return
    elevation, azimuth = np.broadcast_arrays(elevation_deg, azimuth_deg)
    lower, upper = sky.disc.edges_deg()
    down, right = _steps(elevation, azimuth)
    around = np.mod(azimuth + 180.0, 360.0) - 180.0
    margin = 2.0 * np.nanmax(np.abs(down))
    reach = 2.0 * sky.disc.half_width_deg().max() + 2.0 * np.nanmax(np.abs(right))
    near = (elevation > lower - margin) & (elevation < upper + margin) & (np.abs(around) < reach)
    if not near.any():
        return
    disc = _fine(sky.disc)
    offset = (np.arange(points) + 0.5) / points - 0.5
    where = np.nonzero(near)
    e = elevation[where][:, None, None] + down[where][:, None, None] * offset[:, None]
    a = around[where][:, None, None] + right[where][:, None, None] * offset[None, :]
    e, a = np.broadcast_arrays(e, a)
    for start in range(0, e.shape[0], 512):
        part = slice(start, start + 512)
        light = disc.radiance(e[part], a[part]).mean(axis=(1, 2))
        picture[where[0][part], where[1][part]] += tone.see(light, disc.wavelength_nm, light_of(sky))


def add_to_view(sky: Sky, picture: np.ndarray, rays: np.ndarray, tone: Tone, points: int = 8) -> None:
    """As `add_to_picture` for pixels (height, width, 3) that look along unit vectors from the sun's azimuth, in any
    projection: a pixel at a seam is taken as wide as most are."""
    if sky.disc is None or not sky.disc.is_seen:
        return
    down, right = (_within_a_pixel(np.gradient(rays, axis=axis)) for axis in (0, 1))
    lower, upper = sky.disc.edges_deg()
    sun = direction(np.zeros(1), np.full(1, 0.5 * (lower + upper)))[0]
    size = np.linalg.norm(down, axis=-1) + np.linalg.norm(right, axis=-1)
    where = np.nonzero(rays @ sun > np.cos(np.radians(upper - lower) + size))
    if not where[0].size:
        return
    disc = _fine(sky.disc)
    offset = (np.arange(points) + 0.5) / points - 0.5
    for start in range(0, where[0].size, 512):
        pixels = where[0][start : start + 512], where[1][start : start + 512]
        ray = rays[pixels][:, None, None] + down[pixels][:, None, None] * offset[:, None, None]
        azimuth, elevation = azimuth_elevation(ray + right[pixels][:, None, None] * offset[None, :, None])
        light = disc.radiance(elevation, np.mod(azimuth + 180.0, 360.0) - 180.0).mean(axis=(1, 2))
        picture[pixels] += tone.see(light, disc.wavelength_nm, light_of(sky))


def _within_a_pixel(steps: np.ndarray) -> np.ndarray:
    """Steps (height, width, 3) from a pixel to the next, no longer than twice their median."""
    length = np.linalg.norm(steps, axis=-1, keepdims=True)
    return steps * np.minimum(1.0, 2.0 * np.median(length) / np.maximum(length, 1e-30))


def _steps(elevation: np.ndarray, azimuth: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Change of elevation from a row to the next and of azimuth from a column to the next [deg]."""
    turn = np.mod(np.diff(azimuth, axis=1, append=azimuth[:, :1]) + 180.0, 360.0) - 180.0
    turn[:, -1] = turn[:, -2]
    return np.gradient(elevation, axis=0), turn


def light_of(sky: Sky) -> Light:
    """What the spectra of a sky are multiplied by."""
    return Light(sky.solar_spectrum, sky.distance_au)


def dip_deg(sky: Sky) -> float:
    """Dip of the horizon [deg] of a smooth Earth without refraction."""
    return float(np.degrees(np.arccos(EARTH_RADIUS_KM / (EARTH_RADIUS_KM + max(sky.observer_altitude_km, 0.0)))))
