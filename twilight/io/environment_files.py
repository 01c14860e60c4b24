"""The environment maps of a render: ``sky.rgb.exr`` (and ``sky.rgb.hdr``) and ``sky.spectral.exr``."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from twilight.io.exr import write_rgb_exr, write_spectral_exr
from twilight.io.rendered import Options, Rendered
from twilight.io.rgbe import write_hdr


def write_rgb(rendered: Rendered, folder: Path, options: Options) -> list[Path]:
    """``sky.rgb.exr``, and ``sky.rgb.hdr`` for Radiance, whose tools read no EXR."""
    chosen = _map_options(options, options.width)
    written = [write_rgb_exr(rendered.seen, folder / "sky.rgb.exr", **chosen)]
    if options.renderer == "radiance":
        written.append(write_hdr(rendered.seen, folder / "sky.rgb.hdr", **chosen))
    return written


def write_spectral(rendered: Rendered, folder: Path, options: Options) -> list[Path]:
    """``sky.spectral.exr``."""
    chosen = _map_options(options, options.spectral_width)
    return [write_spectral_exr(rendered.sky, folder / "sky.spectral.exr", **chosen)]


def _map_options(options: Options, width: int) -> dict[str, Any]:
    """What all environment maps have in common."""
    return {"renderer": options.renderer, "width": width, "observer": options.observer, "disc": options.disc}
