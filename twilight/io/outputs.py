"""All files of a render, in one folder."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from twilight.base.errors import TwilightError
from twilight.base.formats import FORMATS, WHERE_DISC, WHERE_MOON, WHERE_POLARISED, WITH_VIEW, check_names, file_names
from twilight.io.environment import environment_directions
from twilight.io.picture import DEFAULT_VIEW, DEFAULT_WIDTH, check_options, view_directions
from twilight.io.rendered import Options, Rendered, ViewSource
from twilight.sky.sky import Sky


def write_outputs(
    sky: Sky,
    folder: str | Path,
    *,
    view: ViewSource | None = None,
    files: Sequence[str] | None = None,
    views: Sequence[str] = (DEFAULT_VIEW,),
    **options: Any,
) -> list[Path]:
    """Write files of a sky into a folder, which is made if it is not there; each is whole or absent.  Returns them.

    sky: what ``sky.h5`` holds, and pictures and environment maps are made from.  view: what `engine.view` saw, for the
    file `view`.  files: names of `twilight.base.formats.FORMATS`; None: all of them, without pictures of the
    polarisation, the disc and a view where there is none; with `view` those of a view alone.  views, options: as of
    `twilight.io.rendered.Options`.
    Errors: TwilightError for an unknown option, and where the folder cannot be written.
    """
    folder = Path(folder)
    try:
        chosen = check_names(tuple(FORMATS.own if files is None else files))
    except ValueError as error:
        raise TwilightError(f"files: {error}") from None
    if files is None and view is not None:
        chosen = WITH_VIEW if sky.moon is None else WITH_VIEW + WHERE_MOON
    elif files is None:
        without = {"view"}
        without.update(WHERE_POLARISED if sky.polarisation is None else ())
        without.update(WHERE_MOON if sky.moon is None else ())
        without.update(WHERE_DISC if sky.disc is None else ())
        chosen = tuple(name for name in chosen if name not in without)
    elif "view" in chosen and view is None:
        raise TwilightError("output.files: view needs a view of the observer (observer.view)")
    o = Options(views=tuple(views), **options)
    check_options(o.exposure, o.tone_mapping, o.observer)
    for name in views:
        view_directions(name, DEFAULT_WIDTH.get(name, 4))
    for size in (o.width, o.spectral_width):
        environment_directions(o.renderer, size)
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise TwilightError(f"{folder}: the folder cannot be made ({error.strerror or error})") from error
    rendered = Rendered(sky, o.polariser_deg, view)
    written = [path for name in chosen for path in FORMATS.load(name)(rendered, folder, o)]
    for path in written:
        if path.name not in file_names():
            raise TwilightError(f"{path}: is a file that none of the formats {', '.join(chosen)} declares")
    return written
