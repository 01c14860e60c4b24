"""Photographs as linear RGB: EXR; HDR, TIFF, PNG, JPEG with OpenImageIO (extra `photo`); RAW with rawpy (`raw`).

Pixels are as stored: an orientation tag does not turn them, for a camera model counts rows and columns of the file.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from os.path import isfile
from pathlib import Path
from typing import Any

import numpy as np

from twilight.base.errors import TwilightError
from twilight.base.extras import missing
from twilight.base.reading import MEMORY_FRACTION, first_line, memory_bytes
from twilight.io.exr import exr_size, read_latlong_exr, write_channels

MAX_PIXELS = 400_000_000
"""Larger pictures are refused before memory is taken for them: 400 megapixels are 5 GB of linear RGB."""
BYTES_PER_PIXEL = 16
"""Memory for a pixel of a picture being read: linear RGB and what was stored."""

SATURATED_FRACTION = 0.98
"""An integer sample above this fraction of the full scale counts as saturated."""

RADIANCE_SUFFIXES = (".hdr", ".pic", ".rgbe")
SAMPLE_SUFFIXES = (".png", ".jpg", ".jpeg", ".tif", ".tiff")
RAW_SUFFIXES = (".dng", ".cr2", ".cr3", ".nef", ".arw", ".orf", ".rw2", ".raf", ".pef", ".srw", ".raw")
SUFFIXES = (*RADIANCE_SUFFIXES, ".exr", *SAMPLE_SUFFIXES, *RAW_SUFFIXES)

ResponseFunction = Callable[[np.ndarray], np.ndarray]
"""Undoes a camera's curve: samples (..., 3) in 0..1 to relative exposure (..., 3), see ``camera.response``."""


@dataclass(frozen=True)
class StoredImage:
    """A photograph as it was stored, before any response curve is undone.

    samples (H, W, 3): 0..1 of the full scale for integers, the file's own numbers for floats; float32.
    saturated (H, W): at the upper end of an integer scale, or not finite.
    bits: of an integer sample, None for floats.
    linear: the format holds light itself (HDR, EXR, RAW, float TIFF) and has no response curve.
    grey: the file has one channel, repeated here; it says nothing about colour.
    exposure_time_s: from the file, None where it does not say.
    """

    samples: np.ndarray
    saturated: np.ndarray
    bits: int | None
    linear: bool
    grey: bool = False
    exposure_time_s: float | None = None


def read_image(path: str | Path, response: ResponseFunction | None = None) -> StoredImage:
    """A photograph whose samples are linear light (relative exposure), (H, W, 3).

    response: undoes the camera's curve of integer samples (``camera.response.load_response``); None: the samples are
    linear already.  Formats that hold light itself have none, and a response for them is an error.
    Errors: TwilightError for a missing, damaged, unknown or oversized file, and where an extra is not installed.
    """
    return as_light(path, read_samples(path), response)


def as_light(path: str | Path, picture: StoredImage, response: ResponseFunction | None) -> StoredImage:
    """Samples as stored as linear light; arguments and errors as `read_image`, `path` names the file in them."""
    if response is None:
        return replace(picture, linear=True)
    if picture.linear:
        raise TwilightError(f"{path}: holds linear light; a response curve is for PNG, JPEG and integer TIFF")
    return replace(picture, samples=np.asarray(response(picture.samples), dtype=np.float32), linear=True)


def read_samples(path: str | Path) -> StoredImage:
    """A photograph as stored; errors as ``read_image``."""
    path = Path(path)
    suffix = path.suffix.lower()
    if path.is_dir():
        raise TwilightError(f"{path}: is a folder; give the file of a photograph")
    if not isfile(path):
        raise TwilightError(f"{path}: no such file")
    if suffix == ".exr":
        return _floating(path, _exr(path))
    if suffix in (*RADIANCE_SUFFIXES, *SAMPLE_SUFFIXES):
        return _openimageio(path)
    if suffix in RAW_SUFFIXES:
        return _raw(path)
    raise TwilightError(f"{path}: the ending '{path.suffix}' is not known; read are {', '.join(SUFFIXES)}")


def _floating(path: Path, values: np.ndarray, grey: bool = False) -> StoredImage:
    finite = np.isfinite(values).all(axis=-1)
    if not finite.any() or not (values[finite] > 0).any():
        raise TwilightError(f"{path}: holds no light: no pixel is finite and positive")
    values = np.where(finite[..., None], values, 0.0).astype(np.float32, copy=False)
    return StoredImage(values, ~finite, None, True, grey)


def _check_size(path: Path, width: int, height: int) -> None:
    if width * height > MAX_PIXELS:
        raise TwilightError(f"{path}: has {width} x {height} pixels; at most {MAX_PIXELS:.3g} are read")
    if BYTES_PER_PIXEL * width * height > MEMORY_FRACTION * memory_bytes():
        raise TwilightError(
            f"{path}: its {width} x {height} pixels need {BYTES_PER_PIXEL * width * height / 1e9:.3g} GB, more than "
            f"half of this machine's {memory_bytes() / 1e9:.3g} GB"
        )


def _exr(path: Path) -> np.ndarray:
    _check_size(path, *exr_size(path))
    return np.asarray(read_latlong_exr(path).rgb, dtype=np.float32)


# HDR, PNG, JPEG, TIFF -------------------------------------------------------------------------------------------


def _openimageio(path: Path) -> StoredImage:
    """Any depth through OpenImageIO, which notices a file that is cut off."""
    try:
        import OpenImageIO  # optional
    except ImportError:
        raise missing("OpenImageIO", f"{path}: a photograph") from None
    OpenImageIO.attribute("limits:imagesize_MB", 0)  # our own limit, with our own sentence
    wanted = OpenImageIO.ImageSpec()
    wanted.attribute("oiio:UnassociatedAlpha", 1)  # samples as stored, not times the opacity
    with _without_native_messages():
        file = OpenImageIO.ImageInput.open(str(path), wanted)
        if file is None:
            raise TwilightError(f"{path}: is not a complete picture ({_line(OpenImageIO.geterror())})")
        spec = file.spec()
        _check_size(path, spec.width, spec.height)
        stored = file.read_image(OpenImageIO.UNKNOWN)
        error = file.geterror()
    if stored is None or error:
        raise TwilightError(f"{path}: is not a complete picture ({_line(error)})")
    if spec.nchannels > 4:
        raise TwilightError(f"{path}: has {spec.nchannels} channels; 1 to 4 are read")
    grey = spec.nchannels <= 2
    samples = np.repeat(stored[..., :1], 3, axis=-1) if grey else stored[..., :3]
    if spec.format.basetype in (OpenImageIO.HALF, OpenImageIO.FLOAT, OpenImageIO.DOUBLE):
        samples = samples.astype(np.float32)
        return _floating(path, _radiance(samples, spec) if path.suffix.lower() in RADIANCE_SUFFIXES else samples, grey)
    if stored.dtype not in (np.uint8, np.uint16):
        raise TwilightError(f"{path}: holds {stored.dtype}; integers of 8 or 16 bits without sign and floats are read")
    bits = 8 * stored.dtype.itemsize
    samples = samples.astype(np.float32) / np.float32(2**bits - 1)
    saturated = np.any(samples > SATURATED_FRACTION, axis=-1)
    seconds = spec.get_float_attribute("ExposureTime")
    return StoredImage(samples, saturated, bits, False, grey, seconds if 0.0 < seconds < np.inf else None)


def _radiance(rgb: np.ndarray, spec: Any) -> np.ndarray:
    """A Radiance picture's light, its EXPOSURE undone, upright.

    A mantissa m stands for the middle of its step, (m + 1/2) 2^(e - 136) (Ward, Real pixels, Graphics Gems II); what is
    read is its lower end, and the largest channel's exponent is that of all three.
    """
    largest = rgb.max(axis=-1, keepdims=True)
    exponent = np.frexp(largest)[1]
    rgb = np.where(largest > 0, rgb + np.ldexp(np.float32(0.5), exponent - 8), 0.0).astype(np.float32)
    orientation = spec.get_int_attribute("Orientation", 1)
    rgb = rgb[::-1] if orientation in (3, 4) else rgb
    rgb = rgb[:, ::-1] if orientation in (2, 3) else rgb
    return rgb / np.float32(spec.get_float_attribute("hdr:exposure", 1.0))


def _line(error: str) -> str:
    return first_line(ValueError(error.strip()))


@contextmanager
def _without_native_messages() -> Iterator[None]:
    """Nothing on stderr from libpng and others, which print what is raised here as a sentence."""
    stderr, null = os.dup(2), os.open(os.devnull, os.O_WRONLY)
    os.dup2(null, 2)
    try:
        yield
    finally:
        os.dup2(stderr, 2)
        os.close(stderr)
        os.close(null)


# RAW ------------------------------------------------------------------------------------------------------------


def _raw(path: Path) -> StoredImage:
    """A RAW file by LibRaw: camera white balance, linear Rec. 709, no brightening, no turning; 16 bits."""
    try:
        import rawpy  # optional
    except ImportError:
        raise missing("rawpy", f"{path}: a RAW file") from None
    try:
        with rawpy.imread(str(path)) as raw:
            _check_size(path, raw.sizes.width, raw.sizes.height)
            rgb = raw.postprocess(
                gamma=(1, 1), no_auto_bright=True, use_camera_wb=True, output_bps=16, user_flip=0,
                output_color=rawpy.ColorSpace.sRGB, highlight_mode=rawpy.HighlightMode.Clip,
            )  # fmt: skip
    except (rawpy.LibRawError, MemoryError, ValueError) as error:
        raise TwilightError(f"{path}: is not a complete RAW file that LibRaw knows ({first_line(error)})") from None
    samples = rgb.astype(np.float32) / np.float32(65535)
    return StoredImage(samples, np.any(samples > SATURATED_FRACTION, axis=-1), 16, True)


def write_exr(path: str | Path, rgb: np.ndarray, attributes: dict[str, Any] | None = None) -> None:
    """Write linear Rec. 709 (H, W, 3) as an EXR (float32, ZIP), whole or not at all; errors: TwilightError."""
    write_channels(path, {name: rgb[..., i] for i, name in enumerate("RGB")}, attributes)
