"""Directions of the pixels of an environment map in the layout of every renderer, and their light.

All maps hold directions of the world: azimuth clockwise from north.  With u, v in 0..1 from the picture's upper left:

=========  =====================================================================================================
openexr    latitude-longitude, OpenEXR ENVMAP_LATLONG, UsdLux: +Y up, +Z north, -X east; u = 1/2 + azimuth / 360,
           so north is in the middle of the picture and east to its right.
mitsuba    the same (Mitsuba ``envmap``, +Y up), without negative values, as for all that follow.
blender    latitude-longitude, +Z up, +X east, +Y north (Blender's own sun position add-on); Cycles has u = 1/2 at
           +X and u = 1/4 at +Y, so u = 1/2 + (azimuth - 90) / 360: east is in the middle, south to its right.
radiance   latitude-longitude, +Z up, +X east, +Y north; genssky maps with u = 1/2 + atan2(Dy, Dx) / 360, so
           u = 1/2 + (90 - azimuth) / 360: east is in the middle, *north* to its right (mirrored).
pbrt       equal-area octahedral square (Clarberg 2008), +Z up, +X east, +Y north (pbrt-v4 ``infinite`` light).
=========  =====================================================================================================

Where the sun's azimuth is not known it is taken as 0: the sun stands in the north.
"""

from dataclasses import replace
from typing import Literal

import numpy as np

from twilight.base.errors import TwilightError, check_known
from twilight.sky.polarised import nearest_known
from twilight.sky.sky import Sky

Target = Literal["openexr", "mitsuba", "blender", "radiance", "pbrt"]
RENDERERS: tuple[str, ...] = ("openexr", "mitsuba", "blender", "radiance", "pbrt")

_LATLONG = {"openexr": (0.0, 360.0), "mitsuba": (0.0, 360.0), "blender": (90.0, 360.0), "radiance": (90.0, -360.0)}
"""Azimuth in the middle of the picture [deg] and its change over the picture's width [deg]."""


def environment_directions(renderer: str, width: int) -> tuple[np.ndarray, np.ndarray]:
    """Elevation and azimuth (clockwise from north) of every pixel centre [deg], which broadcast to (height, width').

    Latitude-longitude: (height, 1) and (1, width), half as high; ``pbrt``: squares with sides of width / 2.
    Raises TwilightError for an unknown renderer or a width that is not a positive multiple of 4.
    """
    check_known("renderer", renderer, RENDERERS)
    if width < 4 or width % 4:
        raise TwilightError(f"width: {width} must be a positive multiple of 4")
    if renderer == "pbrt":
        return _octahedral_directions(width // 2)
    middle, turn = _LATLONG[renderer]
    azimuth = np.mod(middle + turn * ((np.arange(width) + 0.5) / width - 0.5), 360.0)
    elevation = 90.0 - 360.0 * (np.arange(width // 2) + 0.5) / width
    return elevation[:, None], azimuth[None, :]


def _octahedral_directions(side: int) -> tuple[np.ndarray, np.ndarray]:
    """Pixel centres of the equal-area octahedral square.

    A point (a, b) of the square -1..1 with |a| + |b| = 1 - d has z = 1 - (1 - |d|)^2 on the upper hemisphere (d > 0)
    and its negative on the lower one.  On a quarter the azimuth from +X towards +Y goes linearly from 0 to 90 deg along
    the lines of constant d (Clarberg 2008, Fast equal-area mapping of the (hemi)sphere using SIMD).
    """
    centre = 2 * (np.arange(side) + 0.5) / side - 1
    b, a = np.meshgrid(centre, centre, indexing="ij")
    d = 1 - np.abs(a) - np.abs(b)
    r = 1 - np.abs(d)
    z = np.copysign(1 - r * r, d)
    with np.errstate(divide="ignore", invalid="ignore"):
        fraction = np.where(r > 0, (np.abs(b) - np.abs(a)) / r, 0.0)
    quarter = (fraction + 1) * 45.0
    x = np.copysign(np.cos(np.radians(quarter)), a)
    y = np.copysign(np.sin(np.radians(quarter)), b)
    azimuth = np.mod(90.0 - np.degrees(np.arctan2(y, x)), 360.0)
    return np.degrees(np.arcsin(np.clip(z, -1.0, 1.0))), azimuth


def pixel_of(
    renderer: str, width: int, elevation_deg: np.ndarray, azimuth_deg: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Row and column of the pixel that a direction of the world falls into, for arrays of one shape."""
    if renderer == "pbrt":
        return _octahedral_pixel(width // 2, elevation_deg, azimuth_deg)
    middle, turn = _LATLONG[renderer]
    across = np.mod((np.asarray(azimuth_deg) - middle) / turn + 0.5, 1.0)
    column = np.minimum((across * width).astype(int), width - 1)
    row = np.clip(((90.0 - np.asarray(elevation_deg)) / 360.0 * width).astype(int), 0, width // 2 - 1)
    return row, column


def _octahedral_pixel(side: int, elevation_deg: np.ndarray, azimuth_deg: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The inverse of `_octahedral_directions`."""
    z = np.sin(np.radians(elevation_deg))
    r = np.sqrt(1.0 - np.abs(z))
    angle = np.radians(90.0 - np.asarray(azimuth_deg))
    x, y = np.cos(angle), np.sin(angle)
    b = r * 2.0 / np.pi * np.arctan2(np.abs(y), np.abs(x))
    a = r - b
    below = z < 0.0
    a, b = np.where(below, 1.0 - b, a), np.where(below, 1.0 - a, b)
    place = [np.copysign(b, y), np.copysign(a, x)]
    row, column = (np.clip(((c + 1.0) / 2.0 * side).astype(int), 0, side - 1) for c in place)
    return row, column


def pixel_solid_angle(renderer: str, width: int) -> np.ndarray:
    """Solid angle of every pixel [sr], (height, width'); they sum to 4 pi."""
    if renderer == "pbrt":
        return np.full((width // 2, width // 2), 16.0 * np.pi / width**2)
    edge = np.sin(np.radians(90.0 - 360.0 * np.arange(width // 2 + 1) / width))
    return np.repeat((edge[:-1] - edge[1:])[:, None] * 2.0 * np.pi / width, width, axis=1)


def ground_factor(sky: Sky) -> np.ndarray:
    """Radiance of the Lambertian ground divided by F0 [sr^-1], (W,): albedo / pi x horizontal irradiance.

    The beams of sun and moon are part of the irradiance where the sky knows them.  The irradiance is that of the
    observer's place; light that is not known counts as in the nearest known direction.
    """
    sky = replace(sky, sun_normalised_radiance=nearest_known(sky.sun_normalised_radiance), standard_error=None)
    if sky.ground_albedo is None or not np.any(sky.ground_albedo):
        return np.zeros(sky.wavelength_nm.size)
    falling = sky.irradiance_factor(direct=sky.direct_irradiance is not None)
    if sky.moon is not None:
        sine = max(0.0, float(np.sin(np.radians(sky.moon.apparent_elevation_deg))))
        falling = falling + sine * sky.moon.direct_irradiance / sky.solar_irradiance
    return sky.ground_albedo / np.pi * falling


def environment(sky: Sky, values: np.ndarray, ground: np.ndarray, renderer: str, width: int) -> np.ndarray:
    """Values (E, A, K) on the sky's grid and (K,) for the ground as an environment map, (height, width', K).

    The sky is interpolated by ``Sky.smooth``.  Everything below the sky's lower edge is ground.
    """
    elevation, azimuth = environment_directions(renderer, width)
    azimuth = azimuth - (sky.sun_azimuth_deg or 0.0)
    above = elevation >= sky.elevation_edges_deg[0]
    picture = np.empty((*np.broadcast_shapes(elevation.shape, azimuth.shape), values.shape[2]), dtype=values.dtype)
    if renderer == "pbrt":
        picture[above] = sky.smooth(values, elevation[above], azimuth[above])
        picture[~above] = ground
    else:
        rows = above[:, 0]
        picture[rows] = sky.smooth(values, elevation[rows], azimuth)
        picture[~rows] = ground
    return picture
