"""`estimate`: the air from a photograph; `read_sky`: a stored sky or a photograph of one."""

from __future__ import annotations

import warnings
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import get_args

import numpy as np

from twilight.api.arguments import SceneLike, config_of
from twilight.api.representation import Sky
from twilight.base.errors import TwilightError, TwilightWarning
from twilight.base.progress import Progress, silent
from twilight.base.sections import unknown
from twilight.config.aerosol import AerosolType
from twilight.io.netcdf import read_sky as read_stored
from twilight.io.stored_image import SUFFIXES
from twilight.studies.camera import CameraModel, read_camera
from twilight.studies.validate.photographs.airs import OTHERS
from twilight.studies.validate.photographs.estimated import Estimate
from twilight.studies.validate.photographs.estimating import Given, estimate_air
from twilight.studies.validate.photographs.photograph import Photograph, read_photograph

__all__ = ["Estimate", "estimate", "read_sky"]

TYPES = ("continental_average", "maritime_clean", "desert", "urban")
"""Aerosol types that are tried."""


def estimate(
    picture: str | Path | Photograph | Sequence[str | Path | Photograph],
    scene: SceneLike = "continental-average",
    *,
    camera: str | Path | CameraModel | None = None,
    field_of_view_deg: float | None = None,
    sun_elevation_deg: float | Sequence[float] | None = None,
    sun_azimuth_deg: float | None = None,
    types: Sequence[str] = TYPES,
    parameters: Sequence[str] = ("ozone", "albedo"),
    white_balance: bool | None = None,
    tone_curve: bool | None = None,
    brightness: bool = True,
    colour: bool = True,
    refine: bool = False,
    profile: str | Path | None = None,
    mask: str | Path | None = None,
    automatic_mask: bool = True,
    min_elevation_deg: float = 3.0,
    glare_deg: float = 10.0,
    resolution_deg: float = 3.0,
    settings: Mapping[str, object] | None = None,
    name: str | Sequence[str] | None = None,
    progress: Progress = silent,
) -> Estimate:
    """The air from a photograph of a clear sky, or from several of one evening.

    Parameters
    ----------
    picture
        HDR, EXR, TIFF, PNG, JPEG, HEIF or RAW; several are of one camera that was not moved, and of one air.
    scene
        As of `render`: all that is not estimated.  Its sun counts where it is given: an elevation, a place and time, or
        several elevations to search between; otherwise that of the file's time and place, or all are searched.  Its
        horizon counts where it is given (`clean`: nothing beyond it); otherwise it is `typical`.
    camera
        File of a camera or its model; None: a panorama of the whole sphere, twice as wide as high, or what the file
        says.  Where neither says the angle above the horizontal, that is found by the horizon, or with the air.
    field_of_view_deg
        Across the width, of a picture whose file does not say the focal length.
    sun_elevation_deg, sun_azimuth_deg
        Of the sun: true elevation (of every picture of a series), and azimuth in the camera's azimuths; None: found.
    types, parameters
        Aerosol types to try, and what is estimated beside the optical depth: `ozone`, `albedo`.
    white_balance, tone_curve
        Gains of red, green and blue, and a curve of three numbers, are free beside the exposure; None: where a camera
        made a picture to look at (8 or 16 bits of sRGB), gains also where no camera is given.
    brightness, colour
        Whether differences of brightness over the sky count, and of colour.
    refine
        The fit ends with the sky of the scene's own solver, screen, night and observer; otherwise all is `compact`'s.
    profile, mask, automatic_mask, min_elevation_deg, glare_deg, resolution_deg
        What is clear sky: skyline (CSV), mask picture, whether ground and clouds are looked for, lowest elevation,
        radius about the sun, and side of the cells.
    settings
        Dotted keys of the scene.
    name
        Of the picture, in sentences and in the climate; None: of its file.
    progress
        Called as progress(doing, fraction) now and then.

    Returns
    -------
    Estimate
        `fits`, `parameters` (value, intervals, constrained), `sentences()`, `climate` (a mapping that `render` takes),
        `comparison` with the photograph, `sky`.

    Raises
    ------
    TwilightError
        For whatever is not allowed or cannot be found in the picture, in one sentence.
    """
    pictures = [picture] if isinstance(picture, str | Path | Photograph) else list(picture)
    if not pictures:
        raise TwilightError("picture: none is given")
    if not (brightness or colour):
        raise TwilightError("brightness, colour: one of them must count")
    suns = None if sun_elevation_deg is None else np.atleast_1d(np.asarray(sun_elevation_deg, float)).tolist()
    known = {p.name for p in OTHERS}
    for what, names, allowed in (("types", types, set(get_args(AerosolType))), ("parameters", parameters, known)):
        for word in names:
            if word not in allowed:
                raise TwilightError(f"{what}: {word} {unknown(word, sorted(allowed), what[:-1])}")
    if not types:
        raise TwilightError("types: names no aerosol type")
    called = [name] * len(pictures) if name is None or isinstance(name, str) else list(name)
    photographs: list[Photograph] = []
    names = []
    for one, known_as in zip(pictures, called, strict=True):
        if isinstance(one, Photograph):
            names.append(known_as or "photograph")
            photographs.append(one)
            continue
        names.append(known_as or Path(one).name)
        photographs.append(
            read_photograph(
                one,
                camera if camera is None or isinstance(camera, CameraModel) else read_camera(camera),
                cell_deg=resolution_deg,
                profile=profile,
                mask_image=mask,
                automatic=automatic_mask,
                min_elevation_deg=min_elevation_deg,
                glare_deg=glare_deg,
                field_of_view_deg=field_of_view_deg,
            )
        )
    texture = {"resolution_deg": photographs[0].cell_deg}
    config = config_of(scene, {"texture": texture}, settings=settings)
    says = Given(
        list(dict.fromkeys(types)),
        parameters,
        sun_azimuth_deg,
        suns,
        white_balance,
        tone_curve,
        brightness,
        colour,
        refine,
    )
    estimated = estimate_air(names, photographs, config, says, progress)
    if not estimated.fits:
        warnings.warn(f"{estimated.picture}: {estimated.sentences()[0]}", TwilightWarning, stacklevel=2)
    return estimated


def read_sky(
    path: str | Path,
    *,
    sun_elevation_deg: float | None = None,
    sun_azimuth_deg: float | None = None,
    camera: str | Path | CameraModel | None = None,
    cd_per_m2: float = 1.0,
) -> Sky:
    """A sky that was written as HDF5, or a photograph of one.

    Parameters
    ----------
    path
        sky.h5, or a picture as of `estimate`.
    sun_elevation_deg, sun_azimuth_deg
        Of a photograph: the sun's true elevation and its azimuth in the camera's azimuths; None: by its disc, and by
        the symmetry of the sky.
    camera
        Of a photograph, as of `estimate`.
    cd_per_m2
        Luminance of 1 in the photograph's own scale.

    Returns
    -------
    Sky
        Of a photograph with spectra that have its colours; ground and trees are in it, and 0 where it shows nothing.

    Raises
    ------
    TwilightError
        For a file that is missing, damaged or something else, and a sun that is neither given nor seen.
    """
    if Path(path).suffix.lower() not in SUFFIXES:
        return read_stored(path)
    photograph = read_photograph(
        path, camera if camera is None or isinstance(camera, CameraModel) else read_camera(camera)
    )
    if sun_elevation_deg is None:
        sun_elevation_deg = photograph.sun.disc_elevation_deg
        if sun_elevation_deg is None:
            raise TwilightError(f"{path}: shows no disc of the sun; give sun_elevation_deg")
    return photograph.sky(sun_elevation_deg, sun_azimuth_deg, cd_per_m2)
