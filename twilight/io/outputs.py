"""All files of a render, in one folder."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Literal

from twilight import colour
from twilight.errors import TwilightError
from twilight.io.environment import environment_directions
from twilight.io.exr import write_rgb_exr, write_spectral_exr
from twilight.io.netcdf import write_sky
from twilight.io.picture import DEFAULT_VIEW, DEFAULT_WIDTH, check_options, view_directions, write_png
from twilight.io.rgbe import write_hdr
from twilight.sky import Sky

FILES: tuple[str, ...] = ("sky.png", "sky.rgb.exr", "sky.spectral.exr", "sky.h5")


def write_outputs(
    sky: Sky,
    folder: str | Path,
    *,
    panorama: Sky | None = None,
    files: Sequence[str] = FILES,
    views: Sequence[str] = (DEFAULT_VIEW,),
    target: str = "openexr",
    width: int = 1024,
    spectral_width: int = 256,
    exposure: float | Literal["auto"] = "auto",
    tone_mapping: str = colour.DEFAULT_TONE_MAPPING,
    observer: str = colour.DEFAULT_OBSERVER,
) -> list[Path]:
    """Write ``files`` of a sky into ``folder`` (made if it is not there) and return their paths.

    ``panorama`` is the same sky on a finer grid (``sky.latlong_grid(width, sun_azimuth_deg)`` goes into the RGB EXR
    pixel by pixel); the pictures and environment maps are made from it where it is given, ``sky.h5`` always holds
    ``sky``.  The first of ``views`` is ``sky.png``, others are ``sky.VIEW.png``.  ``target``, ``width``,
    ``spectral_width``: of the environment maps (``io.environment``); the target ``radiance`` adds ``sky.rgb.hdr``.
    ``exposure``, ``tone_mapping``: of the pictures.
    Each file is whole or absent.  Raises TwilightError for an unknown option or where the folder cannot be written.
    """
    folder = Path(folder)
    unknown = [name for name in files if name not in FILES]
    if unknown:
        raise TwilightError(f"files: '{unknown[0]}' is not known, choose from {', '.join(FILES)}")
    check_options(exposure, tone_mapping, observer)
    for view in views:
        view_directions(view, DEFAULT_WIDTH.get(view, 4))
    for size in (width, spectral_width):
        environment_directions(target, size)
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise TwilightError(f"{folder}: the folder cannot be made ({error.strerror or error})") from error
    fine = sky if panorama is None else panorama
    written = []
    if "sky.png" in files:
        for i, view in enumerate(views):
            name = f"sky.{view}.png" if i else "sky.png"
            options = {
                "exposure": exposure,
                "tone_mapping": tone_mapping,
                "observer": observer,
                "label": view == "wide",
            }
            written.append(write_png(fine, folder / name, view=view, **options))  # type: ignore[arg-type]
    if "sky.rgb.exr" in files:
        written.append(write_rgb_exr(fine, folder / "sky.rgb.exr", target=target, width=width, observer=observer))
        if target == "radiance":  # whose tools read no EXR
            written.append(write_hdr(fine, folder / "sky.rgb.hdr", target=target, width=width, observer=observer))
    if "sky.spectral.exr" in files:
        path = folder / "sky.spectral.exr"
        written.append(write_spectral_exr(fine, path, target=target, width=spectral_width, observer=observer))
    if "sky.h5" in files:
        written.append(write_sky(sky, folder / "sky.h5"))
    return written
