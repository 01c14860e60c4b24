"""`estimate`: the air from a photograph; `read_sky`: a stored sky or a photograph of one."""

from __future__ import annotations

import inspect
import textwrap
import warnings
from collections.abc import Callable, Sequence
from dataclasses import fields
from pathlib import Path
from typing import Concatenate, ParamSpec

from twilight.api.arguments import config_of
from twilight.api.representation import Sky
from twilight.base.arguments import in_units
from twilight.base.errors import TwilightError, TwilightWarning
from twilight.io.netcdf import read_sky as read_stored
from twilight.io.stored_image import SUFFIXES
from twilight.studies.camera import CameraModel
from twilight.studies.validate.photographs.options import TO_THE_HORIZON, EstimateOptions
from twilight.studies.validate.photographs.picture import Photograph, read_photograph
from twilight.studies.validate.photographs.report import Estimate
from twilight.studies.validate.photographs.series import estimate_air

__all__ = ["Estimate", "estimate", "read_sky"]

Picture = str | Path | Photograph
P = ParamSpec("P")


def estimate_with(picture: Picture | Sequence[Picture], options: EstimateOptions) -> Estimate:
    """`estimate` with its options as one."""
    pictures = [picture] if isinstance(picture, str | Path | Photograph) else list(picture)
    if not pictures:
        raise TwilightError("picture: none is given")
    photographs = [one if isinstance(one, Photograph) else read_photograph(one, options) for one in pictures]
    if options.name is not None:
        names = [options.name] * len(pictures) if isinstance(options.name, str) else options.name
        photographs = [one.told(name=name) for one, name in zip(photographs, names, strict=True)]
    config = config_of(
        options.scene, {"texture": {"resolution_deg": photographs[0].cell_deg}}, settings=options.settings
    )
    estimated = estimate_air(photographs, config, options)
    if not estimated.fits:
        warnings.warn(f"{estimated.picture}: {estimated.sentences()[0]}", TwilightWarning, stacklevel=3)
    return estimated


HEAD = """The air from a photograph of a clear sky, or from several of one evening.

    Parameters
    ----------
    picture
        HDR, EXR, TIFF, PNG, JPEG, HEIF or RAW; several are of one camera that was not moved, and of one air."""
TAIL = """
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


def _asked_by(
    options: Callable[P, EstimateOptions],
) -> Callable[Concatenate[Picture | Sequence[Picture], P], Estimate]:
    """`estimate` with the fields of its options as arguments, which stand in one place with what they mean."""

    def estimate(picture: Picture | Sequence[Picture], *given: P.args, **named: P.kwargs) -> Estimate:
        return estimate_with(picture, options(*given, **named))

    first = inspect.Parameter("picture", inspect.Parameter.POSITIONAL_OR_KEYWORD)
    given = inspect.signature(options).parameters.values()
    setattr(estimate, "__signature__", inspect.Signature([first, *given], return_annotation="Estimate"))  # noqa: B010
    said = [(one.name, one.metadata["says"].replace("  ", " ")) for one in fields(EstimateOptions)]
    lines = [f"    {name}\n{textwrap.indent(textwrap.fill(text, 112), ' ' * 8)}" for name, text in said]
    estimate.__doc__ = "\n".join([HEAD, *lines, TAIL])
    return estimate


estimate = in_units(_asked_by(EstimateOptions))


@in_units
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
    photograph = read_photograph(path, EstimateOptions(camera=camera, **TO_THE_HORIZON))
    if sun_elevation_deg is None:
        sun_elevation_deg = photograph.sun.disc_elevation_deg
        if sun_elevation_deg is None:
            raise TwilightError(f"{path}: shows no disc of the sun; give sun_elevation_deg")
    return photograph.sky(sun_elevation_deg, sun_azimuth_deg, cd_per_m2)
