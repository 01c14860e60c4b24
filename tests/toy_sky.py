"""Skies with a closed form, for tests of pictures and files."""

import numpy as np

from twilight.numerics.directions import texture_centres
from twilight.sky.sky import Sky

SUN_AZIMUTH = 235.0
GLOW_ELEVATION = 25.0
DARK = 1e-12


def unit_vector(elevation_deg, azimuth_deg):
    """East, north, up."""
    e, a = np.radians(elevation_deg), np.radians(azimuth_deg)
    return np.stack(np.broadcast_arrays(np.cos(e) * np.sin(a), np.cos(e) * np.cos(a), np.sin(e)), axis=-1)


def texture_grid(step_deg=3.0):
    """Row and column centres (elevation_deg, azimuth_deg) of the hemisphere, of squares of a step that divides 90."""
    rows = round(90.0 / step_deg)
    return texture_centres((rows, 4 * rows))


def glow_sky(
    *,
    glow_elevation_deg=15.0,
    glow_azimuth_deg=0.0,
    width_deg=6.0,
    floor=1e-3,
    step_deg=3.0,
    wavelength_nm=(400.0, 450.0, 500.0, 550.0, 600.0, 650.0, 700.0),
    **fields,
):
    """A blue gradient with one round glow at an elevation and an azimuth relative to the sun."""
    wavelength = np.asarray(wavelength_nm, float)
    elevation, azimuth = texture_grid(step_deg)
    directions = unit_vector(elevation[:, None], azimuth[None, :])
    cosine = directions @ unit_vector(glow_elevation_deg, glow_azimuth_deg)
    glow = np.exp((cosine - 1.0) / np.radians(width_deg) ** 2)
    blue = floor * (1.0 + directions[..., 2:3]) * (wavelength / 550.0) ** -4
    return Sky(wavelength, elevation, azimuth, blue + glow[..., None], fields.pop("sun_elevation_deg", 5.0), **fields)


def spot(**fields):
    """One round glow on a black sky, 25 deg high at the sun's azimuth (south-west)."""
    return glow_sky(glow_elevation_deg=GLOW_ELEVATION, floor=DARK, sun_azimuth_deg=SUN_AZIMUTH, **fields)


def brightest_uv(picture):
    """Centroid of the brightest tenth in units of the picture, from its upper left."""
    light = picture.sum(axis=-1)
    light = np.where(light > 0.9 * light.max(), light, 0.0)
    v, u = np.indices(light.shape)
    return (
        ((u + 0.5) * light).sum() / light.sum() / light.shape[1],
        ((v + 0.5) * light).sum() / light.sum() / light.shape[0],
    )
