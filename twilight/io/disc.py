"""The discs of sun and moon in pictures and environment maps."""

from typing import NamedTuple

import numpy as np

from twilight.base.conventions import DARK, EARTH_RADIUS_KM
from twilight.io.environment import pixel_of, pixel_solid_angle
from twilight.numerics.directions import direction
from twilight.sky import colour
from twilight.sky.disc import Disc
from twilight.sky.sky import Sky
from twilight.sky.tone import Light, Tone

COLOUR_STEP_NM = 10.0
"""Every wavelength has an edge of the disc of its own: colours need more of them than the sky."""
_NODES = 24
"""Points of a row, from limb to limb, whose light is given to the pixels of a map."""


class _Shown(NamedTuple):
    """A disc; azimuth_deg: of its body from the sun; scale: of its radiance to that over F0 at the sky's distance."""

    disc: Disc
    azimuth_deg: float
    scale: float


def _shown(sky: Sky) -> list[_Shown]:
    """The discs of a sky that are above its horizon."""
    discs: list[_Shown] = []
    if sky.disc is not None and sky.disc.is_seen:
        discs.append(_Shown(sky.disc, 0.0, 1.0))
    if sky.moon is not None and sky.moon.disc is not None:
        discs.append(_Shown(sky.moon.disc, sky.moon.moon.azimuth_deg, sky.distance_au**2))
    return discs


def _fine(disc: Disc) -> Disc:
    """The disc at wavelengths close enough for its colours, where those of the sky are far apart."""
    nm = disc.wavelength_nm
    if nm.size == 1 or np.diff(nm).max() <= COLOUR_STEP_NM:
        return disc
    return disc.at_wavelengths(np.linspace(nm[0], nm[-1], int(np.ceil((nm[-1] - nm[0]) / COLOUR_STEP_NM)) + 1))


def add_to_map_xyz(sky: Sky, picture: np.ndarray, renderer: str, width: int, observer: str) -> None:
    """Add the light of the discs to an environment map (height, width, 3) of XYZ [cd m^-2]."""
    for shown in _shown(sky):
        disc = _fine(shown.disc)
        elevation, azimuth, light = _pieces(shown._replace(disc=disc))
        xyz = colour.factor_to_xyz(light, disc.wavelength_nm, sky.solar_spectrum, sky.distance_au, observer)
        _give(sky, picture, renderer, width, elevation, azimuth, xyz)


def add_to_map_factor(sky: Sky, picture: np.ndarray, renderer: str, width: int) -> None:
    """Add the light of the discs to an environment map (height, width, W) of radiance over F0 [sr^-1]."""
    for shown in _shown(sky):
        _give(sky, picture, renderer, width, *_pieces(shown))


def _pieces(shown: _Shown) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Elevation, azimuth from the sun [deg] and irradiance over F0 (N, W) of small pieces of a disc's image.

    The pieces of all wavelengths are those of the widest one; their light sums to that of `rows`.
    """
    disc = shown.disc
    rows = disc.rows()
    keep = rows.any(axis=1)
    elevation, rows = disc.elevation_deg[keep], rows[keep]
    half = disc.half_width_deg()[keep].max(axis=1)
    node = (np.arange(_NODES) + 0.5) / _NODES * 2.0 - 1.0
    azimuth = half[:, None] * node
    fraction = disc.radiance(elevation[:, None], azimuth)
    total = fraction.sum(axis=1, keepdims=True)
    # a wavelength whose disc is narrower than the distance of the points has its light in the middle
    middle = np.full((1, _NODES, 1), 1.0 / _NODES)
    fraction = np.where(total > 0.0, fraction / np.where(total > 0.0, total, 1.0), middle)
    light = rows[:, None, :] * fraction * shown.scale
    return np.repeat(elevation, _NODES), azimuth.ravel() + shown.azimuth_deg, light.reshape(-1, light.shape[-1])


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
    sky: Sky, picture: np.ndarray, elevation_deg: np.ndarray, azimuth_deg: np.ndarray, tone: Tone, points: int = 8
) -> None:
    """Add the discs to a picture (height, width, K) of a tone's channels, whose pixels look in directions from the sun,
    broadcast to (height, width); each holds the mean of points x points.

    In any projection: a pixel at a seam is taken as wide as most are.
    """
    seen = _shown(sky)
    if not seen:
        return
    rays = direction(azimuth_deg, elevation_deg)
    down, right = (_within_a_pixel(np.gradient(rays, axis=axis)) for axis in (0, 1))
    for shown in seen:
        disc = _fine(shown.disc)
        for pixels, light, _ in disc.in_pixels(rays, down, right, shown.azimuth_deg, points):
            picture[pixels] += tone.see(light * shown.scale, disc.wavelength_nm, light_of(sky))


def _within_a_pixel(steps: np.ndarray) -> np.ndarray:
    """Steps (height, width, 3) from a pixel to the next, no longer than twice their median."""
    length = np.linalg.norm(steps, axis=-1, keepdims=True)
    return steps * np.minimum(1.0, 2.0 * np.median(length) / np.maximum(length, DARK))


def light_of(sky: Sky) -> Light:
    """What the spectra of a sky are multiplied by."""
    return Light(sky.solar_spectrum, sky.distance_au)


def dip_deg(sky: Sky) -> float:
    """Dip of the horizon [deg] of a smooth Earth without refraction."""
    return float(np.degrees(np.arccos(EARTH_RADIUS_KM / (EARTH_RADIUS_KM + max(sky.observer_altitude_km, 0.0)))))
