"""Photographs made from computed skies, for tests."""

import numpy as np

from twilight.config import load
from twilight.engine import run
from twilight.io.stored_image import StoredImage
from twilight.scene import resolve
from twilight.sky import colour
from twilight.studies.camera import CameraModel
from twilight.studies.camera.response import srgb_to_linear
from twilight.studies.validate.photographs.mask import separation_deg


def preetham(sun_elevation_deg=12.0, **settings):
    """A daylight sky that costs nothing."""
    chosen = {"sun.elevation_deg": sun_elevation_deg, "solver.name": "preetham", **settings}
    return run(resolve(load("continental-average", chosen)))


def latlong(width=256, azimuth_deg=None, **more):
    return CameraModel.model_validate(
        {
            "projection": "latlong",
            "image": {"width_px": width, "height_px": width // 2},
            "orientation": {"azimuth_deg": azimuth_deg},
            **more,
        }
    )


def fisheye(size=240, azimuth_deg=20.0):
    return CameraModel.model_validate(
        {
            "projection": "equisolid",
            "image": {"width_px": size, "height_px": size},
            "lens": {
                "field_of_view_deg": 180.0,
                "image_circle_px": float(size),
                "distortion": [0.02],
                "vignetting": [-0.12],
            },
            "orientation": {"azimuth_deg": azimuth_deg, "elevation_deg": 90.0},
        }
    )


def perspective(width=300, height=200, azimuth_deg=70.0, elevation_deg=20.0, fov_deg=75.0):
    return CameraModel.model_validate(
        {
            "projection": "perspective",
            "image": {"width_px": width, "height_px": height},
            "lens": {"field_of_view_deg": fov_deg, "natural_vignetting": True},
            "orientation": {"azimuth_deg": azimuth_deg, "elevation_deg": elevation_deg, "roll_deg": 4.0},
        }
    )


def take(sky, camera, sun_azimuth_deg, *, xyz=None, noise=0.0, ground=0.02, sun=True, seed=5, exposure=None):
    """Linear RGB (H, W, 3) that the camera sees: the sky, a dark ground, vignetting, noise (relative), the sun's disc.

    xyz (E, A, 3): what the sky looks like instead of its own spectra.
    exposure: factor; None scales the 99th percentile to 0.8.
    """
    azimuth, elevation = camera.azimuth_elevation(camera.pixel_centres())
    there = np.isfinite(elevation)
    up = there & (elevation > 0)
    rgb = np.zeros((*elevation.shape, 3))
    xyz = colour.sky_to_xyz(sky, observer="cie1931_2deg") if xyz is None else xyz
    seen = sky.smooth(xyz, elevation[up], azimuth[up] - sun_azimuth_deg)
    rgb[up] = colour.xyz_to_linear_rgb(seen)
    level = np.median(rgb[up])
    random = np.random.default_rng(seed)
    down = there & ~up
    rgb[down] = ground * level * np.array([1.2, 1.0, 0.7]) * random.uniform(0.5, 1.5, (down.sum(), 1))
    if sun:
        away = separation_deg(elevation, azimuth, sky.sun_elevation_deg, sun_azimuth_deg)
        rgb[there & (away < 0.9)] = 3e4 * level
    rgb *= np.nan_to_num(camera.relative_illumination(camera.pixel_centres()))[..., None]
    rgb *= 1.0 + noise * random.standard_normal(rgb.shape)
    scale = 0.8 / np.percentile(rgb[up], 99) if exposure is None else exposure
    return np.maximum(rgb * scale, 0.0)


def picture(rgb):
    """Floats as a photograph."""
    return StoredImage(rgb.astype(np.float32), np.zeros(rgb.shape[:2], bool), None, True)


def eight_bit(rgb):
    """Floats as a photograph that went through an 8 bit sRGB file."""
    z = np.round(255 * colour.srgb_encode(rgb)) / 255
    return StoredImage(srgb_to_linear(z).astype(np.float32), (z > 0.98).any(axis=-1), 8, True)
