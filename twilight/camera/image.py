"""Photographs as linear RGB: HDR, EXR, TIFF, PNG, JPEG, and RAW where rawpy is installed.

Pixels are as stored: an orientation tag does not turn them, for a camera model counts rows and columns of the file.
"""

from __future__ import annotations

import os
import warnings
from collections.abc import Callable
from dataclasses import dataclass, replace
from os.path import isfile
from pathlib import Path
from typing import Any

import numpy as np

from twilight.camera.rgbe import read_rgbe
from twilight.errors import TwilightError
from twilight.extras import missing
from twilight.reading import MEMORY_SHARE, first_line, memory_bytes

MAX_PIXELS = 400_000_000
"""Larger pictures are refused before memory is taken for them: 400 megapixels are 5 GB of linear RGB."""
BYTES_PER_PIXEL = 16
"""Of a picture being read: linear RGB and what was stored."""

SATURATED_SHARE = 0.98
"""An integer sample above this share of the full scale counts as saturated."""

RADIANCE_SUFFIXES = (".hdr", ".pic", ".rgbe")
PILLOW_SUFFIXES = (".png", ".jpg", ".jpeg", ".tif", ".tiff")
RAW_SUFFIXES = (".dng", ".cr2", ".cr3", ".nef", ".arw", ".orf", ".rw2", ".raf", ".pef", ".srw", ".raw")
SUFFIXES = (*RADIANCE_SUFFIXES, ".exr", *PILLOW_SUFFIXES, *RAW_SUFFIXES)

ResponseFunction = Callable[[np.ndarray], np.ndarray]
"""Undoes a camera's curve: samples (..., 3) in 0..1 to relative exposure (..., 3), see ``camera.response``."""


@dataclass(frozen=True)
class Picture:
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


def read_image(path: str | Path, response: ResponseFunction | None = None) -> Picture:
    """A photograph whose samples are linear light (relative exposure), (H, W, 3).

    response: undoes the camera's curve of integer samples (``camera.response.load_response``); None: the samples are
    linear already.  Formats that hold light itself have none, and a response for them is an error.
    Errors: TwilightError for a missing, damaged, unknown or oversized file, and where an extra is not installed.
    """
    return as_light(path, read_samples(path), response)


def as_light(path: str | Path, picture: Picture, response: ResponseFunction | None) -> Picture:
    """Samples as stored as linear light; arguments and errors as `read_image`, `path` names the file in them."""
    if response is None:
        return replace(picture, linear=True)
    if picture.linear:
        raise TwilightError(f"{path}: holds linear light; a response curve is for PNG, JPEG and integer TIFF")
    return replace(picture, samples=np.asarray(response(picture.samples), dtype=np.float32), linear=True)


def read_samples(path: str | Path) -> Picture:
    """A photograph as stored (``Picture``); errors as ``read_image``."""
    path = Path(path)
    suffix = path.suffix.lower()
    if path.is_dir():
        raise TwilightError(f"{path}: is a folder; give the file of a photograph")
    if not isfile(path):
        raise TwilightError(f"{path}: no such file")
    if suffix in RADIANCE_SUFFIXES:
        return _floating(path, read_rgbe(path, MAX_PIXELS))
    if suffix == ".exr":
        return _floating(path, _exr(path))
    if suffix in PILLOW_SUFFIXES:
        return _pillow_or_opencv(path)
    if suffix in RAW_SUFFIXES:
        return _raw(path)
    raise TwilightError(f"{path}: the ending '{path.suffix}' is not known; read are {', '.join(SUFFIXES)}")


def _floating(path: Path, values: np.ndarray, grey: bool = False) -> Picture:
    finite = np.isfinite(values).all(axis=-1)
    if not finite.any() or not (values[finite] > 0).any():
        raise TwilightError(f"{path}: holds no light: no pixel is finite and positive")
    values = np.where(finite[..., None], values, 0.0).astype(np.float32, copy=False)
    return Picture(values, ~finite, None, True, grey)


def _check_size(path: Path, width: int, height: int) -> None:
    if width * height > MAX_PIXELS:
        raise TwilightError(f"{path}: has {width} x {height} pixels; at most {MAX_PIXELS:.3g} are read")
    if BYTES_PER_PIXEL * width * height > MEMORY_SHARE * memory_bytes():
        raise TwilightError(
            f"{path}: its {width} x {height} pixels need {BYTES_PER_PIXEL * width * height / 1e9:.3g} GB, more than "
            f"half of this machine's {memory_bytes() / 1e9:.3g} GB"
        )


def _exr(path: Path) -> np.ndarray:
    from twilight.io.exr import exr_size, read_latlong_exr

    _check_size(path, *exr_size(path))
    return np.asarray(read_latlong_exr(path).rgb, dtype=np.float32)


# PNG, JPEG, TIFF ------------------------------------------------------------------------------------------------


def _pillow_or_opencv(path: Path) -> Picture:
    """8 bit through Pillow, which notices a file that is cut off; 16 bit and floats, which it cannot hold: OpenCV."""
    from PIL import Image, UnidentifiedImageError

    limit, Image.MAX_IMAGE_PIXELS = Image.MAX_IMAGE_PIXELS, None  # our own limit, with our own sentence
    try:
        with warnings.catch_warnings(), Image.open(path) as picture:
            warnings.simplefilter("ignore")  # of damage in what is not the picture
            _check_size(path, *picture.size)
            deep = _is_deep(path, picture)
            seconds = _exposure_time(picture)
            picture.load()
            eight = None if deep else np.asarray(picture.convert("L" if picture.mode in ("1", "L", "LA") else "RGB"))
    except UnidentifiedImageError:
        if path.suffix.lower() not in (".tif", ".tiff"):
            raise TwilightError(f"{path}: is not a picture, or damaged at its beginning") from None
        deep, eight, seconds = True, None, None  # Pillow does not know all kinds of TIFF
    except (OSError, SyntaxError, ValueError, EOFError, IndexError, MemoryError) as error:
        raise TwilightError(f"{path}: is not a complete picture ({first_line(error)})") from None
    finally:
        Image.MAX_IMAGE_PIXELS = limit
    stored = _opencv(path) if eight is None else eight
    grey = stored.ndim == 2
    if grey:
        stored = np.repeat(stored[..., None], 3, axis=-1)
    if stored.dtype.kind == "f":
        return _floating(path, stored, grey)
    bits = 8 * stored.dtype.itemsize
    samples = stored.astype(np.float32) / np.float32(2**bits - 1)
    return Picture(samples, np.any(samples > SATURATED_SHARE, axis=-1), bits, False, grey, seconds)


def _is_deep(path: Path, picture: Any) -> bool:
    """Whether the file holds more than 8 bits, which Pillow's RGB has no room for."""
    if picture.format == "TIFF":
        return max(picture.tag_v2.get(258, (1,))) > 8
    if picture.format == "PNG":
        with open(path, "rb") as file:
            return file.read(25)[24:25] == b"\x10"  # bit depth of the first chunk, IHDR
    return False


def _exposure_time(picture: Any) -> float | None:
    exif = picture.getexif()
    value = exif.get_ifd(0x8769).get(0x829A, exif.get(0x829A))
    try:
        seconds = float(value)
    except (TypeError, ValueError, ZeroDivisionError):
        return None
    return seconds if np.isfinite(seconds) and seconds > 0 else None


SILENT = 0
"""OpenCV's LOG_LEVEL_SILENT."""


def _opencv(path: Path) -> np.ndarray:
    """Samples (H, W, 3) or (H, W) of a deep PNG or TIFF."""
    os.environ.setdefault("OPENCV_IO_MAX_IMAGE_PIXELS", str(MAX_PIXELS))  # it looks when it is loaded
    try:
        import cv2
    except ImportError:
        raise missing("cv2", f"{path}: a picture of more than 8 bits") from None
    try:
        log: Any = getattr(cv2.utils, "logging", cv2)  # the module itself before OpenCV 5
        level = log.getLogLevel()
        log.setLogLevel(SILENT)
        try:
            stored = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
        finally:
            log.setLogLevel(level)
    except (cv2.error, MemoryError) as error:
        raise TwilightError(f"{path}: cannot be read ({first_line(error)})") from None
    if stored is None or stored.size == 0:
        raise TwilightError(f"{path}: is not a complete picture")
    _check_size(path, *stored.shape[1::-1])
    if stored.dtype not in (np.uint8, np.uint16, np.float32, np.float64):
        raise TwilightError(f"{path}: holds {stored.dtype}; integers of 8 or 16 bits without sign and floats are read")
    if stored.ndim == 3 and stored.shape[2] in (3, 4):
        return np.ascontiguousarray(stored[..., 2::-1])  # OpenCV holds blue, green, red (and opacity)
    if stored.ndim == 3 and stored.shape[2] <= 2:
        return np.ascontiguousarray(stored[..., 0])
    if stored.ndim == 2:
        return stored
    raise TwilightError(f"{path}: has {stored.shape[2]} channels; 1, 3 or 4 are read")


# RAW ------------------------------------------------------------------------------------------------------------


def _raw(path: Path) -> Picture:
    """A RAW file by LibRaw: camera white balance, linear Rec. 709, no brightening, no turning; 16 bits."""
    try:
        import rawpy
    except ImportError:
        raise missing("rawpy", f"{path}: a RAW file") from None
    try:
        with rawpy.imread(str(path)) as raw:
            _check_size(path, raw.sizes.width, raw.sizes.height)
            rgb = raw.postprocess(
                gamma=(1, 1),
                no_auto_bright=True,
                use_camera_wb=True,
                output_bps=16,
                user_flip=0,
                output_color=rawpy.ColorSpace.sRGB,
                highlight_mode=rawpy.HighlightMode.Clip,
            )
    except (rawpy.LibRawError, MemoryError, ValueError) as error:
        raise TwilightError(f"{path}: is not a complete RAW file that LibRaw knows ({first_line(error)})") from None
    samples = rgb.astype(np.float32) / np.float32(65535)
    return Picture(samples, np.any(samples > SATURATED_SHARE, axis=-1), 16, True)


def write_exr(path: str | Path, rgb: np.ndarray, attributes: dict[str, Any] | None = None) -> None:
    """Write linear Rec. 709 (H, W, 3) as an EXR (float32, ZIP), whole or not at all; errors: TwilightError."""
    import OpenEXR

    from twilight.io.exr import REC709_CHROMATICITIES
    from twilight.io.whole import whole_file

    header = {
        "compression": OpenEXR.ZIP_COMPRESSION,
        "type": OpenEXR.scanlineimage,
        "software": "twilight",
        "chromaticities": REC709_CHROMATICITIES,
        **(attributes or {}),
    }
    channels = {name: np.ascontiguousarray(rgb[..., i], dtype=np.float32) for i, name in enumerate("RGB")}
    with whole_file(path) as temporary:
        OpenEXR.File(header, channels).write(str(temporary))
