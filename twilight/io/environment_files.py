"""The environment maps of a render: ``sky.rgb.exr`` (and ``sky.rgb.hdr``) and ``sky.spectral.exr``."""

from __future__ import annotations

from pathlib import Path

from twilight.io.exr import write_rgb_exr, write_spectral_exr
from twilight.io.rendered import Options, Rendered
from twilight.io.rgbe import write_hdr


def write_rgb(rendered: Rendered, folder: Path, options: Options) -> list[Path]:
    """``sky.rgb.exr``, and ``sky.rgb.hdr`` for Radiance, whose tools read no EXR."""
    size = {"renderer": options.renderer, "width": options.width, "observer": options.observer, "disc": options.disc}
    written = [write_rgb_exr(rendered.seen, folder / "sky.rgb.exr", **size)]  # type: ignore[arg-type]
    if options.renderer == "radiance":
        written.append(write_hdr(rendered.seen, folder / "sky.rgb.hdr", **size))  # type: ignore[arg-type]
    return written


def write_spectral(rendered: Rendered, folder: Path, options: Options) -> list[Path]:
    """``sky.spectral.exr``."""
    path = folder / "sky.spectral.exr"
    return [
        write_spectral_exr(
            rendered.fine,
            path,
            renderer=options.renderer,
            width=options.spectral_width,
            observer=options.observer,
            disc=options.disc,
        )
    ]
