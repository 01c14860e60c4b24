"""The environment maps of a render: ``sky.rgb.exr`` (for Radiance ``sky.rgb.hdr`` too) and ``sky.spectral.exr``."""

from pathlib import Path
from typing import Any

import numpy as np

from twilight.base.errors import TwilightError
from twilight.base.whole_files import whole_file
from twilight.io.exr import REC709_CHROMATICITIES, environment_rgb, write_rgb_exr, write_spectral_exr
from twilight.io.provenance import provenance_fields
from twilight.io.rendered import Options, Rendered
from twilight.numerics import spectrum
from twilight.sky import colour
from twilight.sky.sky import Sky


def write_rgb(rendered: Rendered, folder: Path, options: Options) -> list[Path]:
    """``sky.rgb.exr``, and ``sky.rgb.hdr`` for Radiance, whose tools read no EXR."""
    chosen = _map_options(options, options.width)
    more: dict[str, Any] = {"primaries": options.primaries, "exr": options.exr}
    written = [write_rgb_exr(rendered.seen, folder / "sky.rgb.exr", **chosen, **more)]
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


RADIANCE_EFFICACY_LM_PER_W = 179.0
"""Luminous efficacy that Radiance's tools multiply with (Ward, Shakespeare: Rendering with Radiance)."""


def to_rgbe(rgb: np.ndarray) -> np.ndarray:
    """Four bytes per pixel (..., 4): mantissas of red, green, blue, and the exponent of the largest plus 128.

    Values must not be negative; they are stored to 1/256 of the largest channel, between 1e-38 and 1e38.
    """
    largest = rgb.max(axis=-1)
    _, exponent = np.frexp(largest)
    exponent = np.clip(exponent, -127, 127)
    mantissa = np.floor(rgb * np.exp2(8.0 - exponent)[..., None])
    out = np.empty((*largest.shape, 4), dtype=np.uint8)
    out[..., :3] = np.clip(mantissa, 0, 255)
    out[..., 3] = exponent + 128
    out[largest < 2.0**-127] = 0
    return out


def _scanline(pixels: np.ndarray) -> bytes:
    """One scanline (width, 4) in the run-length format, without runs: a reader takes 2 2 for its start."""
    width = pixels.shape[0]
    parts = [bytes([2, 2, width >> 8, width & 255])]
    for channel in pixels.T:
        data = channel.tobytes()
        for start in range(0, width, 128):
            piece = data[start : start + 128]
            parts += [bytes([len(piece)]), piece]
    return b"".join(parts)


def write_hdr(
    sky: Sky,
    path: str | Path,
    *,
    renderer: str = "radiance",
    width: int = 1024,
    observer: str = colour.DEFAULT_OBSERVER,
    disc: bool = False,
) -> Path:
    """Write the environment map of `write_rgb_exr` in Radiance's RGBE format (8 bit mantissa), whole or not at all.

    The values are scaled so that 179 lm/W times the Rec. 709 luminance of a pixel is its luminance, as Radiance's tools
    expect; colours outside the gamut are moved into it.  In a scene:
    ``void colorpict sky 7 red green blue sky.rgb.hdr . 'Atan2(Dy,Dx)/PI+1' '1-Acos(Dz)/PI'``, +X east, +Y north.

    Arguments and errors: as of `write_rgb_exr`; width [pixel]: 8 to 32767, all that the format has.
    """
    if not 8 <= width < 32768:
        raise TwilightError(f"width: {width} must be between 8 and 32767 for a Radiance picture")
    rgb = environment_rgb(sky, renderer, width, observer, disc=disc)
    rgb = colour.into_gamut(rgb) * (spectrum.LUMINOUS_EFFICACY_LM_PER_W / RADIANCE_EFFICACY_LM_PER_W)
    height = rgb.shape[0]
    fields = {name: str(value).replace("\n", " ") for name, value in provenance_fields(sky.provenance).items()}
    header = [
        "#?RADIANCE",
        "SOFTWARE= twilight",
        *(f"TWILIGHT_{name.removeprefix('twilight_').upper()}= {value}" for name, value in fields.items()),
        f"PRIMARIES= {' '.join(f'{x:g}' for x in REC709_CHROMATICITIES)}",
        "FORMAT=32-bit_rle_rgbe",
        "",
        f"-Y {height} +X {rgb.shape[1]}",
        "",
    ]
    body = b"".join(_scanline(row) for row in to_rgbe(rgb))
    with whole_file(path) as temporary:
        temporary.write_bytes("\n".join(header).encode() + body)
    return Path(path)
