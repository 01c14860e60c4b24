"""From a photograph's file to a sky on the grid of a computed one: reading, directions, sun and mask in one place."""

from __future__ import annotations

import warnings
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np

from twilight.base.errors import TwilightError, TwilightWarning
from twilight.studies.camera.image import StoredImage, as_light, read_image, read_samples
from twilight.studies.camera.model import CameraModel, ImageSize, Orientation
from twilight.studies.camera.response import load_response
from twilight.studies.validate.photographs import mask as masks
from twilight.studies.validate.photographs.panorama import Panorama, make_panorama, mask_image_on
from twilight.studies.validate.photographs.photo import PhotoSky, photo_sky
from twilight.studies.validate.photographs.sun_azimuth import SunAzimuth, find_sun_azimuth

FINE_CELL_DEG = 0.5
"""Aimed size of the fine cells on which masks are made."""


@dataclass(frozen=True, eq=False)
class MaskedSky:
    """A photograph with the sun at its place: the sky to compare, and what it was made from."""

    sky: PhotoSky
    panorama: Panorama
    mask: masks.Mask


@dataclass(frozen=True, eq=False)
class Photograph:
    """A photograph and how it is to be masked.

    picture: linear (``camera.image.read_image``).  camera: with its orientation; azimuths count from its own where that
    is unknown.  cell_deg: cells of the comparison.  profile, mask_image (H, W), automatic, min_elevation_deg,
    glare_deg: see ``mask.make_mask``.
    """

    picture: StoredImage
    camera: CameraModel
    cell_deg: float = 2.0
    profile: tuple[np.ndarray, np.ndarray] | None = None
    mask_image: np.ndarray | None = None
    automatic: bool = True
    min_elevation_deg: float = 0.0
    glare_deg: float = masks.SUN_GLARE_DEG

    @property
    def _k(self) -> int:
        return max(1, round(self.cell_deg / FINE_CELL_DEG))

    @cached_property
    def sun(self) -> SunAzimuth:
        """Where the sun is, from the photograph alone.  Errors: TwilightError as ``find_sun_azimuth``."""
        panorama, mask = self._masked(0.0, None)
        return find_sun_azimuth(panorama, mask.valid)

    def seen(self, sun_azimuth_deg: float, apparent_sun_elevation_deg: float | None) -> MaskedSky:
        """The photograph on the grid of a computed sky whose sun is there; azimuth in the camera's azimuths.

        Errors: TwilightError as ``photo.photo_sky``.
        """
        sun = None if apparent_sun_elevation_deg is None else (0.0, apparent_sun_elevation_deg)
        panorama, mask = self._masked(sun_azimuth_deg, sun)
        return MaskedSky(photo_sky(panorama, mask.valid, self.cell_deg), panorama, mask)

    def _masked(self, origin_deg: float, sun: tuple[float, float] | None) -> tuple[Panorama, masks.Mask]:
        panorama = make_panorama(self.picture, self.camera, self.cell_deg, self._k, origin_deg)
        image = None if self.mask_image is None else mask_image_on(panorama, self.mask_image, self.camera)
        mask = masks.make_mask(
            panorama,
            profile=self.profile,
            image=image,
            automatic=self.automatic,
            min_elevation_deg=self.min_elevation_deg,
            sun=sun,
            glare_deg=self.glare_deg,
        )
        return panorama, mask


def read_photograph(
    path: str | Path,
    camera: CameraModel | None,
    *,
    cell_deg: float = 2.0,
    profile: str | Path | None = None,
    mask_image: str | Path | None = None,
    automatic: bool = True,
    min_elevation_deg: float = 0.0,
    glare_deg: float = masks.SUN_GLARE_DEG,
) -> Photograph:
    """Read a photograph, undo the camera's response, and read the files of its mask.

    camera: None for a latitude-longitude panorama of the whole sphere, whose north is unknown; samples of whole numbers
    are then sRGB.
    Errors: TwilightError for any file that is missing or wrong, and for options that cannot be.
    """
    if not 0.25 <= cell_deg <= 10.0:
        raise TwilightError(f"resolution: {cell_deg:g} deg must be from 0.25 to 10 deg and divide 90 deg")
    if not 0.0 <= glare_deg <= 60.0:
        raise TwilightError(f"glare: {glare_deg:g} deg must be from 0 to 60 deg")
    if not 0.0 <= min_elevation_deg < 90.0:
        raise TwilightError(f"min_elevation: {min_elevation_deg:g} deg must be from 0 to below 90 deg")
    skyline = None if profile is None else masks.read_profile(profile)
    shown = None if mask_image is None else masks.read_mask_image(mask_image)
    if camera is None:
        samples = read_samples(path)
        camera = _panorama(path, samples)
        picture = as_light(path, samples, load_response(camera.response))
    else:
        picture = read_image(path, load_response(camera.response))
    if picture.bits == 8 and camera.response == "linear":
        warnings.warn(
            f"{path}: its 8 bits are taken for linear light, as response in the camera's file says; most are srgb",
            TwilightWarning,
            stacklevel=2,
        )
    return Photograph(picture, camera, cell_deg, skyline, shown, automatic, min_elevation_deg, glare_deg)


def _panorama(path: str | Path, picture: StoredImage) -> CameraModel:
    height, width = picture.samples.shape[:2]
    if width != 2 * height:
        raise TwilightError(
            f"{path}: is {width} x {height}, no panorama of the whole sphere, which is twice as wide as high; give its "
            "camera (--camera)"
        )
    return CameraModel(
        projection="latlong",
        image=ImageSize(width_px=width, height_px=height),
        orientation=Orientation(azimuth_deg=None),
        response="linear" if picture.linear else "srgb",
    )
