"""From a photograph's file to a sky on the grid of a computed one: reading, directions, sun and mask in one place.

A camera that was not given is made of what the file says (`camera.exif`), and how it was held of what the file says or
of the horizon in the picture; what neither tells is fitted with the air, never taken as level.

What makes a photograph useless for its air, or less useful, told before anything is fitted.
"""

from __future__ import annotations

import warnings
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from scipy import ndimage

from twilight.base.errors import TwilightError, TwilightWarning
from twilight.config.scene import PLACED_NM
from twilight.io.stored_image import StoredImage, as_light, read_image, read_samples
from twilight.numerics import spectrum
from twilight.sky import colour
from twilight.sky.colour import REC709_LUMINANCE
from twilight.sky.sky import Sky
from twilight.studies.camera.exif import (
    ANGLE_ERROR_DEG,
    COMPASS_ERROR_DEG,
    LUMINANCE_LN,
    STATES_NOTHING,
    Stated,
    read_stated,
)
from twilight.studies.camera.model import LARGEST_PIXELS, CameraModel, ImageSize, Lens, Orientation, read_camera
from twilight.studies.camera.response import load_response
from twilight.studies.validate.photographs import mask as masks
from twilight.studies.validate.photographs.mask import SKYLINE_ERROR_DEG, TILT_ERROR_DEG, find_horizon, separation_deg
from twilight.studies.validate.photographs.options import EstimateOptions
from twilight.studies.validate.photographs.picture_sky import OBSERVER, PhotoSky, fine_sky, in_cells, mask_image_on
from twilight.studies.validate.photographs.sun_azimuth import SunAzimuth, burnt_disc, find_sun_azimuth

FINE_CELL_DEG = 0.5
"""Aimed size of the fine cells on which masks are made."""
WIDE_VIEW = 0.45
"""Part of the horizon from which the symmetry of the sky tells the sun's azimuth by itself."""
NO_DISC_DEG = 2.0
"""Distance from a sun that is given, which may be a whole degree, from which a light is not its disc [deg]."""
NARROW_ERROR_DEG = 8.0
"""Standard error of what symmetry tells of a smaller part [deg]."""
UNKNOWN_PITCH_DEG, UNKNOWN_ROLL_DEG = 12.0, 3.0
"""Standard errors of the angle above the horizontal and of the tilt of a camera of which nothing is known [deg]."""
ZOOM_ERROR_PERCENT = 1.5
"""Standard error of the width of a view by a focal length in 35 mm, a whole number, of a lens that distorts [%]."""
GUESSED_PITCH_DEG = 12.0
"""Elevation of such a camera's axis, about which it is sought [deg]."""
SPECTRUM_NM = (450.0, 550.0, 620.0)
"""Where the spectra that stand for a photograph's colours have corners [nm]; they are level beyond."""


@dataclass(frozen=True, eq=False)
class Photograph:
    """A picture: its pixels, its camera, its time and place, and where its sun stands.

    picture: linear (`stored_image.read_image`).  camera: with its orientation; azimuths count from its own where that
    is unknown.  cell_deg: cells of the comparison.  mask_image (H, W), automatic, min_elevation_deg,
    glare_deg: see `mask.masked`.  errors_deg: standard errors of the camera's azimuth (from north), elevation and
    roll, 0: as told.  zoom_error: of the width of the view [%].  balanced: its colours are of the camera as described,
    else of who knows what white.  stated: what the file says.  remarks: sentences on where the camera is from.

    Of the sun, once it is placed: its true elevation, NaN where it is sought between between_deg; its azimuth in the
    camera's azimuths and the standard error of that; sentences on where these are from; its azimuth from north, where
    the camera's is known too.
    """

    picture: StoredImage
    camera: CameraModel
    cell_deg: float = 2.0
    mask_image: np.ndarray | None = None
    automatic: bool = True
    min_elevation_deg: float = 0.0
    glare_deg: float = masks.SUN_GLARE_DEG
    errors_deg: tuple[float, float, float] = (0.0, 0.0, 0.0)
    zoom_error: float = 0.0
    balanced: bool = True
    stated: Stated = STATES_NOTHING
    remarks: tuple[str, ...] = ()
    name: str = "photograph"
    sun_elevation_deg: float = np.nan
    sun_azimuth_deg: float = np.nan
    between_deg: tuple[float, float] = (np.nan, np.nan)
    heading_error_deg: float = 0.0
    sun_remarks: tuple[str, ...] = ()
    by_time_deg: float | None = None

    def told(self, **facts: Any) -> Photograph:
        """The same with other words on its name or its sun; what was computed of its pixels stays."""
        made = replace(self, **facts)
        made.__dict__.update({key: self.__dict__[key] for key in ("sun", "_seen") if key in self.__dict__})
        return made

    @property
    def developed(self) -> bool:
        """A camera made a picture to look at of it: gains and tone curve are its own."""
        return self.picture.bits is not None and self.camera.response == "srgb"

    @property
    def log_exposure(self) -> tuple[float, float] | None:
        """ln of the luminance [cd m^-2] of linear light 1 and its standard error, where the file says an exposure."""
        if self.stated.cd_per_m2 is None or not self.developed:
            return None
        return float(np.log(self.stated.cd_per_m2)), LUMINANCE_LN

    def turned(
        self, pitch_deg: float, roll_deg: float, errors_deg: tuple[float, float, float], wider_percent: float = 0.0
    ) -> Photograph:
        """The same with its camera turned by these angles, and its view that much wider."""
        old = self.camera.orientation
        elevation = float(np.clip(old.elevation_deg + pitch_deg, -90.0, 90.0))
        roll = (old.roll_deg + roll_deg + 180.0) % 360.0 - 180.0
        held = Orientation(azimuth_deg=old.azimuth_deg, elevation_deg=elevation, roll_deg=roll)
        camera = self.camera.changed(orientation=held)
        if wider_percent:
            lens = Lens(field_of_view_deg=_wider(self.camera.lens.field_of_view_deg or 0.0, wider_percent))
            camera = camera.changed(lens=lens)
        return replace(self, camera=camera, errors_deg=errors_deg)

    @property
    def _k(self) -> int:
        return max(1, round(self.cell_deg / FINE_CELL_DEG))

    @cached_property
    def sun(self) -> SunAzimuth:
        """Where the sun is, from the photograph alone: in a view of less than half the horizon by its burnt disc first,
        for such a piece may look symmetrical about anything.  Errors: TwilightError as `find_sun_azimuth`."""
        return self._sun(True)

    def _sun(self, by_disc: bool) -> SunAzimuth:
        sky = self._masked(0.0, None)
        wide = float(sky.covered.any(axis=0).mean()) > WIDE_VIEW
        disc = burnt_disc(sky) if by_disc and not wide else None
        if disc is not None:
            return disc
        found = find_sun_azimuth(sky, sky.valid, by_disc)
        if wide or found.method != "symmetry":
            return found
        return replace(found, uncertainty_deg=max(found.uncertainty_deg, NARROW_ERROR_DEG))

    @cached_property
    def _seen(self) -> dict[tuple[float, float | None], PhotoSky]:
        return {}

    def seen(self, sun_azimuth_deg: float, apparent_sun_elevation_deg: float | None) -> PhotoSky:
        """The photograph on the grid of a computed sky whose sun is there; azimuth in the camera's azimuths.

        Errors: TwilightError as `in_cells`.
        """
        key = (sun_azimuth_deg, apparent_sun_elevation_deg)
        if key not in self._seen:
            sun = None if apparent_sun_elevation_deg is None else (0.0, apparent_sun_elevation_deg)
            sky = in_cells(self._masked(sun_azimuth_deg, sun))
            self._seen.clear()  # the last one is asked for again
            self._seen[key] = sky
        return self._seen[key]

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
        sky = fine_sky(self.picture, self.camera, self.cell_deg, self._k, azimuth)
        xyz = np.nan_to_num(sky.rgb) @ np.linalg.inv(spectrum.xyz_to_rgb_matrix(OBSERVER)).T
        first = int(np.searchsorted(sky.columns_deg, 0.0))
        columns = np.mod(np.roll(sky.columns_deg, -first), 360.0)
        wavelength = np.asarray(wavelength_nm, float)
        factor = spectra_of(np.roll(cd_per_m2 * xyz, -first, axis=1), wavelength)
        made = {"solver": "photograph", "scale": f"1 = {cd_per_m2:g} cd m^-2"}
        return Sky(wavelength, sky.rows_deg, columns, factor, sun_elevation_deg, provenance=made)

    def _masked(self, origin_deg: float, sun: tuple[float, float] | None) -> PhotoSky:
        sky = fine_sky(self.picture, self.camera, self.cell_deg, self._k, origin_deg)
        return masks.masked(
            sky,
            image=None if self.mask_image is None else mask_image_on(sky, self.mask_image, self.camera),
            automatic=self.automatic,
            min_elevation_deg=self.min_elevation_deg,
            sun=sun,
            glare_deg=self.glare_deg,
        )


def _wider(field_deg: float, percent: float) -> float:
    return float(2.0 * np.degrees(np.arctan((1.0 + 0.01 * percent) * np.tan(np.radians(0.5 * field_deg)))))


def spectra_of(xyz: np.ndarray, wavelength_nm: np.ndarray) -> np.ndarray:
    """Sun-normalised spectra (..., W) >= 0 of colours (..., 3) [cd m^-2]: straight lines between `SPECTRUM_NM`."""
    lines = np.array([np.interp(wavelength_nm, SPECTRUM_NM, one) for one in np.eye(3)])
    white = colour.factor_to_xyz(np.ones((1, wavelength_nm.size)), wavelength_nm, observer=OBSERVER)
    # differences, for a single line may have a colour that no light has
    of_lines = colour.factor_to_xyz(1.0 + 0.1 * lines, wavelength_nm, observer=OBSERVER) - white
    return np.maximum(xyz @ np.linalg.inv(of_lines) @ (0.1 * lines), 0.0)


class PlacedSun(NamedTuple):
    """The sun's azimuth in the camera's azimuths and its standard error [deg], a sentence on where it is from, and the
    light that was taken for it, which has an elevation; None: by other means."""

    azimuth_deg: float
    error_deg: float
    sentence: str
    light: SunAzimuth | None = None


def place_sun(
    photograph: Photograph,
    known_deg: float | None,
    given_deg: float | None,
    between_deg: tuple[float, float] = (-np.inf, np.inf),
) -> PlacedSun:
    """The sun's azimuth in a photograph.

    known_deg: from north, by place and time, which counts where the camera's azimuth is known, or by a compass where
    the sky says nothing; given_deg: what a caller says, which comes first.  between_deg: true elevations of the sun; a
    light beyond them by more than `NO_DISC_DEG` and by two standard errors of the camera's elevation is no disc of it.
    Errors: TwilightError as `find_sun_azimuth`.
    """
    if given_deg is not None:
        return PlacedSun(given_deg % 360.0, 0.0, f"sun azimuth {given_deg % 360.0:.2f} deg, as given")
    compass = photograph.errors_deg[0]
    north = known_deg is not None and photograph.camera.orientation.azimuth_deg is not None
    if north and compass == 0.0:
        return PlacedSun(known_deg or 0.0, 0.0, f"sun azimuth {known_deg:.2f} deg, by place and time")
    far, other = max(NO_DISC_DEG, 2.0 * photograph.errors_deg[1]), ""
    try:
        sun = photograph.sun
        at, far = sun.true_elevation_deg, far + 2.0 * sun.elevation_error_deg
        if at is not None and not between_deg[0] - far <= at <= between_deg[1] + far:
            other = f"; the light at {at:.1f} deg is not taken for its disc, since the sun is said to stand elsewhere"
            sun = photograph._sun(False)
    except TwilightError:
        sun = None
        if not north:
            raise
    if sun is None or (north and sun.uncertainty_deg >= NARROW_ERROR_DEG):
        note = f"sun azimuth {known_deg:.1f} +- {compass:.0f} deg, by time and compass{other}"
        return PlacedSun(known_deg or 0.0, compass, note)
    by = {"disc": "the sun's disc", "aureole": "its aureole, which is at the end of the scale"}.get(
        sun.method, "the symmetry of the sky"
    )
    note = f"sun azimuth {sun.azimuth_deg:.2f} +- {sun.uncertainty_deg:.2f} deg by {by}"
    if sun.elevation_deg is not None:
        note += f" (its middle at elevation {sun.elevation_deg:.1f} deg)"
    light = None if sun.elevation_deg is None else sun
    return PlacedSun(sun.azimuth_deg, sun.uncertainty_deg, note + other, light)


def read_photograph(path: str | Path, how: EstimateOptions | None = None) -> Photograph:
    """Read a photograph, undo the camera's response, and read the files of its mask.

    Without a camera it is a latitude-longitude panorama of the whole sphere, whose north is unknown, or a picture whose
    file says its focal length in 35 mm or whose field of view is given; whole numbers are then sRGB.
    Errors: TwilightError for any file that is missing or wrong, and for options that cannot be.
    """
    how = how or EstimateOptions()
    if not 0.25 <= how.resolution_deg <= 10.0:
        raise TwilightError(f"resolution: {how.resolution_deg:g} deg must be from 0.25 to 10 deg and divide 90 deg")
    if not 0.0 <= how.glare_deg <= 60.0:
        raise TwilightError(f"glare: {how.glare_deg:g} deg must be from 0 to 60 deg")
    if not 0.0 <= how.min_elevation_deg < 90.0:
        raise TwilightError(f"min_elevation: {how.min_elevation_deg:g} deg must be from 0 to below 90 deg")
    shown = None if how.mask is None else masks.read_mask_image(how.mask)
    camera = how.camera if how.camera is None or isinstance(how.camera, CameraModel) else read_camera(how.camera)
    stated = read_stated(path)
    for doubt in stated.doubts:
        warnings.warn(f"{path}: {doubt}", TwilightWarning, stacklevel=2)
    unknown = camera is None
    by_focal_length = unknown and how.field_of_view_deg is None
    if camera is None:
        samples = read_samples(path)
        camera = _camera(Path(path), samples, stated, how.field_of_view_deg)
        picture = as_light(path, samples, load_response(camera.response))
        errors = (COMPASS_ERROR_DEG, ANGLE_ERROR_DEG, ANGLE_ERROR_DEG)
    else:
        picture = read_image(path, load_response(camera.response))
        errors = (0.0, 0.0, 0.0)
    if picture.bits == 8 and camera.response == "linear":
        warnings.warn(
            f"{path}: its 8 bits are taken for linear light, as response in the camera's file says; most are srgb",
            TwilightWarning,
            stacklevel=2,
        )
    made = Photograph(
        picture, camera, how.resolution_deg, shown, how.automatic_mask, how.min_elevation_deg, how.glare_deg,
        balanced=not unknown, stated=stated, name=Path(path).name,
    )  # fmt: skip
    if camera.projection == "latlong":
        return made
    if by_focal_length:
        made = replace(made, zoom_error=ZOOM_ERROR_PERCENT)
    if "elevation_deg" in camera.orientation.model_fields_set:
        return replace(made, errors_deg=errors)
    return _held(made, errors[0])


def _held(photograph: Photograph, compass_deg: float) -> Photograph:
    """A photograph whose file does not say how the camera was held, by the horizon in it."""
    old = photograph.camera.orientation
    found = find_horizon(photograph.picture, photograph.camera)
    if found is None:
        elevation, roll, errors = GUESSED_PITCH_DEG, old.roll_deg, (compass_deg, UNKNOWN_PITCH_DEG, UNKNOWN_ROLL_DEG)
        note = "camera: no horizon is seen, so that its angle above the horizontal is fitted with the air"
    else:
        elevation, roll, errors = *found, (compass_deg, SKYLINE_ERROR_DEG, TILT_ERROR_DEG)
        note = (
            f"camera: {elevation:.1f} +- {SKYLINE_ERROR_DEG:g} deg above the horizontal, tilted {roll:.1f} +- "
            f"{TILT_ERROR_DEG:g} deg, by the horizon in the picture"
        )
    held = Orientation(azimuth_deg=old.azimuth_deg, elevation_deg=elevation, roll_deg=roll)
    camera = photograph.camera.changed(orientation=held)
    return replace(photograph, camera=camera, errors_deg=errors, remarks=(note,))


def _camera(path: Path, picture: StoredImage, stated: Stated, field_of_view_deg: float | None) -> CameraModel:
    height, width = picture.samples.shape[:2]
    if min(width, height) < 2 or max(width, height) > LARGEST_PIXELS:
        raise TwilightError(f"{path}: is {width} x {height}; a side has from 2 to {LARGEST_PIXELS} pixels")
    if width != 2 * height or field_of_view_deg is not None:
        made = stated.camera(path, width, height, field_of_view_deg)
        return made.changed(response="linear") if picture.linear else made
    return CameraModel(
        projection="latlong",
        image=ImageSize(width_px=width, height_px=height),
        orientation=Orientation(azimuth_deg=None),
        response="linear" if picture.linear else "srgb",
    )


UPSIDE_DOWN = 2.0
"""Light of the lower half of a picture over that of the upper beyond which it may stand on its head."""
ROUGH = 0.04
"""Difference of ln(light) between neighbours on the ground, or of what stands on it, beyond the noise of a sky."""
NIGHT_CD_PER_M2 = 2e-3
"""Luminance of the sky below which a picture is one of the night: a zenith with the sun at -15 deg."""
MOST_SATURATED, MUCH_SATURATED = 0.6, 0.2
"""Part of the sky that is shown, saturated: refused, and worth a warning."""
LAMP_SQUARE_DEG = 2.0
"""Area of saturated light in the sky from which it counts as a sun [deg^2]."""
APART_DEG = 15.0
"""Distance of two such lights that are not one [deg]."""


def check_upright(photograph: Photograph) -> None:
    """TwilightError for a picture that stands on its head: below brighter, and smoother, than above."""
    light = photograph.picture.samples @ REC709_LUMINANCE.astype(np.float32)
    step = max(1, light.shape[1] // 200)
    small = light[::step, ::step]
    upper, lower = np.array_split(small, 2)
    logarithms = [np.log(np.maximum(half, 1e-6 + 1e-4 * float(small.max()))) for half in (upper, lower)]
    level = [float(np.median(half)) for half in logarithms]
    rough = [float(np.median(np.abs(np.diff(half, axis=1)))) for half in logarithms]
    if level[1] - level[0] > np.log(UPSIDE_DOWN) and rough[0] > ROUGH and rough[0] > 2.0 * rough[1]:
        raise TwilightError(
            f"{photograph.name}: its lower half is brighter and smoother than its upper: it stands on its head, or "
            "shows no sky; turn it"
        )


def check_sky(photograph: Photograph, seen: PhotoSky) -> list[str]:
    """Sentences of warning about the sky of a photograph.  Errors: TwilightError for one that is of no use."""
    shown = seen.covered & (seen.rows_deg > 0.0)[:, None]
    weight = np.cos(np.radians(seen.rows_deg))[:, None] * shown
    sky = weight * ~seen.foreground
    saturated = float((sky * seen.saturated).sum() / max(float(sky.sum()), 1e-12))
    if saturated > MOST_SATURATED:
        raise TwilightError(
            f"{photograph.name}: is over-exposed: {saturated:.0%} of its sky is at the end of its scale"
        )
    lines = []
    if saturated > MUCH_SATURATED:
        lines.append(f"{saturated:.0%} of the sky is over-exposed and left out: intervals are wider")
    exposure = photograph.log_exposure
    if exposure is not None:
        luminance = float(np.nanmedian(seen.xyz[..., 1][seen.counts])) * float(np.exp(exposure[0]))
        if luminance < NIGHT_CD_PER_M2:
            raise TwilightError(
                f"{photograph.name}: by exposure time, aperture and sensitivity its sky has {luminance:.1g} cd/m^2: a "
                "night, or moonlight; the air is estimated by the sun's light down to -15 deg"
            )
    count = _lights(seen, seen.saturated & shown & ~seen.foreground)
    if count > 1:
        lines.append(
            f"{count} lights in the sky are at the end of the scale, more than {APART_DEG:g} deg apart: reflections or "
            "lamps; give --sun-azimuth, and a --mask without their glare"
        )
    return lines


def _lights(sky: PhotoSky, saturated: np.ndarray) -> int:
    """How many large saturated lights stand far from each other."""
    labels, count = ndimage.label(saturated, np.ones((3, 3)))
    if count < 2:
        return count
    rows, columns = np.indices(saturated.shape)
    elevation, azimuth = sky.rows_deg[rows], sky.columns_deg[columns]
    area = ndimage.sum_labels(np.cos(np.radians(elevation)) * sky.step_deg**2, labels, np.arange(1, count + 1))
    kept: list[tuple[float, float]] = []
    for label in 1 + np.argsort(-area):
        if area[label - 1] < LAMP_SQUARE_DEG:
            break
        here = labels == label
        east, north = np.sin(np.radians(azimuth[here])).mean(), np.cos(np.radians(azimuth[here])).mean()
        middle = float(elevation[here].mean()), float(np.degrees(np.arctan2(east, north)))
        if all(float(separation_deg(*middle, *other)) > APART_DEG for other in kept):
            kept.append(middle)
    return len(kept)
