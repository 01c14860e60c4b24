"""From a photograph's file to a sky on the grid of a computed one: reading, directions, sun and mask in one place."""

from __future__ import annotations

import warnings
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from twilight.base.errors import TwilightError, TwilightWarning
from twilight.config.scene import PLACED_NM
from twilight.numerics import spectrum
from twilight.sky import colour
from twilight.sky.sky import Sky
from twilight.studies.camera.image import StoredImage, as_light, read_image, read_samples
from twilight.studies.camera.model import CameraModel, ImageSize, Orientation
from twilight.studies.camera.response import load_response
from twilight.studies.validate.photographs import mask as masks
from twilight.studies.validate.photographs.panorama import Panorama, make_panorama, mask_image_on
from twilight.studies.validate.photographs.photo import OBSERVER, PhotoSky, photo_sky
from twilight.studies.validate.photographs.sun_azimuth import SunAzimuth, find_sun_azimuth

FINE_CELL_DEG = 0.5
"""Aimed size of the fine cells on which masks are made."""

SPECTRUM_NM = (450.0, 550.0, 620.0)
"""Where the spectra that stand for a photograph's colours have corners [nm]; they are level beyond."""


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

    def sky(
        self,
        sun_elevation_deg: float,
        sun_azimuth_deg: float | None = None,
        cd_per_m2: float = 1.0,
        wavelength_nm: ArrayLike = PLACED_NM,
    ) -> Sky:
        """What the photograph shows, ground and trees with it, as a `Sky` from 6 deg below the horizon up; 0 outside.

        sun_elevation_deg: true; sun_azimuth_deg: in the camera's azimuths, None: found in the photograph.
        cd_per_m2: luminance of 1 in the photograph's own scale.
        wavelength_nm: of the spectra, straight lines between `SPECTRUM_NM` that have the photograph's colours.
        """
        azimuth = self.sun.azimuth_deg if sun_azimuth_deg is None else sun_azimuth_deg
        panorama = make_panorama(self.picture, self.camera, self.cell_deg, self._k, azimuth)
        xyz = np.nan_to_num(panorama.rgb) @ np.linalg.inv(spectrum.xyz_to_rgb_matrix(OBSERVER)).T
        first = int(np.searchsorted(panorama.azimuth_deg, 0.0))
        columns = np.mod(np.roll(panorama.azimuth_deg, -first), 360.0)
        wavelength = np.asarray(wavelength_nm, float)
        factor = spectra_of(np.roll(cd_per_m2 * xyz, -first, axis=1), wavelength)
        made = {"solver": "photograph", "scale": f"1 = {cd_per_m2:g} cd m^-2"}
        return Sky(wavelength, panorama.elevation_deg, columns, factor, sun_elevation_deg, provenance=made)

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


def spectra_of(xyz: np.ndarray, wavelength_nm: np.ndarray) -> np.ndarray:
    """Sun-normalised spectra (..., W) >= 0 of colours (..., 3) [cd m^-2]: straight lines between `SPECTRUM_NM`."""
    lines = np.array([np.interp(wavelength_nm, SPECTRUM_NM, one) for one in np.eye(3)])
    white = colour.factor_to_xyz(np.ones((1, wavelength_nm.size)), wavelength_nm, observer=OBSERVER)
    # differences, for a single line may have a colour that no light has
    of_lines = colour.factor_to_xyz(1.0 + 0.1 * lines, wavelength_nm, observer=OBSERVER) - white
    return np.maximum(xyz @ np.linalg.inv(of_lines) @ (0.1 * lines), 0.0)


def place_sun(photograph: Photograph, known_deg: float | None, given_deg: float | None) -> tuple[float, str]:
    """The sun's azimuth in the camera's azimuths, and a sentence on where it is from.

    known_deg: from north, by place and time, which counts where the camera's azimuth is known; given_deg: what a caller
    says, which comes first.  Errors: TwilightError as `find_sun_azimuth`.
    """
    if given_deg is not None:
        return given_deg % 360.0, f"sun azimuth {given_deg % 360.0:.2f} deg, as given"
    if known_deg is not None and photograph.camera.orientation.azimuth_deg is not None:
        return known_deg, f"sun azimuth {known_deg:.2f} deg, by place and time"
    sun = photograph.sun
    by = "the sun's disc" if sun.method == "disc" else "the symmetry of the sky"
    note = f"sun azimuth {sun.azimuth_deg:.2f} +- {sun.uncertainty_deg:.2f} deg by {by}"
    if sun.elevation_deg is not None:
        note += f" (disc at elevation {sun.elevation_deg:.1f} deg)"
    return sun.azimuth_deg, note


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
        if camera.projection != "latlong" and "elevation_deg" not in camera.orientation.model_fields_set:
            raise TwilightError(
                f"{path}: its camera has no orientation.elevation_deg, how far above the horizontal it looked (90: "
                "straight up), and no picture is taken as level; give it, and roll_deg where the horizon is tilted"
            )
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
