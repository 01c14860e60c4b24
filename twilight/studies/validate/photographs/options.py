"""What may be asked of an estimate, once: the arguments of `twilight.estimate` and the options of its command."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import KW_ONLY, dataclass
from pathlib import Path
from typing import Any, get_args

import numpy as np

from twilight.base.errors import TwilightError
from twilight.base.progress import Progress, silent
from twilight.base.sections import unknown
from twilight.config.aerosol import AerosolType
from twilight.studies.camera import CameraModel, read_camera
from twilight.studies.validate.photographs.air import OTHERS
from twilight.studies.validate.photographs.picture import Photograph, read_photograph

TYPES = ("continental_average", "maritime_clean", "desert", "urban")
"""Aerosol types that are tried."""


@dataclass(frozen=True)
class EstimateOptions:
    """All that may be said beside the picture.

    Parameters
    ----------
    scene
        As of `render`: all that is not estimated.  Its sun counts where it is given: an elevation, a place and time, or
        several elevations to search between; otherwise that of the file's time and place, or all are searched.  Its
        horizon counts where it is given (`clean`: nothing beyond it); otherwise it is `typical`.  So does its
        `observer.altitude_km`; otherwise that of the file, or the haze's interval holds what may lie below the camera.
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

    Raises
    ------
    TwilightError
        For whatever is not allowed.
    """

    scene: Any = "continental-average"
    _: KW_ONLY
    camera: str | Path | CameraModel | None = None
    field_of_view_deg: float | None = None
    sun_elevation_deg: float | Sequence[float] | None = None
    sun_azimuth_deg: float | None = None
    types: Sequence[str] = TYPES
    parameters: Sequence[str] = ("ozone", "albedo")
    white_balance: bool | None = None
    tone_curve: bool | None = None
    brightness: bool = True
    colour: bool = True
    refine: bool = False
    profile: str | Path | None = None
    mask: str | Path | None = None
    automatic_mask: bool = True
    min_elevation_deg: float = 3.0
    glare_deg: float = 10.0
    resolution_deg: float = 3.0
    settings: Mapping[str, object] | None = None
    name: str | Sequence[str] | None = None
    progress: Progress = silent

    def __post_init__(self) -> None:
        if not (self.brightness or self.colour):
            raise TwilightError("brightness, colour: one of them must count")
        known = {p.name for p in OTHERS}
        given = (("types", self.types, set(get_args(AerosolType))), ("parameters", self.parameters, known))
        for what, names, allowed in given:
            for word in names:
                if word not in allowed:
                    raise TwilightError(f"{what}: {word} {unknown(word, sorted(allowed), what[:-1])}")
        if not self.types:
            raise TwilightError("types: names no aerosol type")

    @property
    def suns_deg(self) -> list[float] | None:
        """The sun's elevation of every picture."""
        if self.sun_elevation_deg is None:
            return None
        return [float(sun) for sun in np.atleast_1d(np.asarray(self.sun_elevation_deg, float))]

    def photograph(self, picture: str | Path | Photograph) -> Photograph:
        """The picture, read where it is a file.  Errors: TwilightError as `read_photograph`."""
        if isinstance(picture, Photograph):
            return picture
        given = self.camera
        camera = given if given is None or isinstance(given, CameraModel) else read_camera(given)
        return read_photograph(
            picture,
            camera,
            cell_deg=self.resolution_deg,
            profile=self.profile,
            mask_image=self.mask,
            automatic=self.automatic_mask,
            min_elevation_deg=self.min_elevation_deg,
            glare_deg=self.glare_deg,
            field_of_view_deg=self.field_of_view_deg,
        )
