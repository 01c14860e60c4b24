"""Which directions of a scene's texture are compared."""

from __future__ import annotations

import numpy as np

from twilight.config.scene import Config
from twilight.numerics.directions import half_of, texture_centres
from twilight.scene.suns import suns_of

_GOLDEN = 0.6180339887498949
"""Golden section: its multiples modulo 1 spread evenly."""


def half_texture(shape: tuple[int, int]) -> tuple[np.ndarray, np.ndarray]:
    """Elevation and azimuth [deg] of the texture's pixels on one side of the sun's vertical, flat.

    The sky is its own mirror image about that plane, so the other half holds nothing new.
    """
    elevation, azimuth = texture_centres(shape)
    e, a = np.meshgrid(elevation, azimuth[half_of(azimuth)[0]], indexing="ij")
    return e.ravel(), a.ravel()


def stratified_directions(shape: tuple[int, int], count: int) -> tuple[np.ndarray, np.ndarray]:
    """Elevation and azimuth [deg] of about `count` pixels of the texture, spread evenly over its rows and columns.

    Row i of `count` equal bands of elevation takes the column that the golden ratio gives (a lattice of low
    discrepancy), on one side of the sun's vertical.  Every pixel of the texture has the same weight, as in a render.
    The whole half texture is given where `count` is not below it; pixels that come up twice are given once.
    """
    elevation, azimuth = texture_centres(shape)
    azimuth = azimuth[half_of(azimuth)[0]]
    if count >= elevation.size * azimuth.size:
        return half_texture(shape)
    i = np.arange(count)
    row = np.floor((i + 0.5) / count * elevation.size).astype(int)
    column = np.floor(np.mod((i + 0.5) * _GOLDEN, 1.0) * azimuth.size).astype(int)
    pixel = np.unique(row * azimuth.size + column)
    return elevation[pixel // azimuth.size], azimuth[pixel % azimuth.size]


def sun_elevations(config: Config) -> list[float]:
    """True elevations [deg] of the suns of a configuration, each once."""
    return list(dict.fromkeys(round(sun.elevation_deg, 6) for sun in suns_of(config)))
