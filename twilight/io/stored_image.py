"""Pictures as linear RGB, of skies and of albedo: EXR; HDR, TIFF, PNG, JPEG by OpenImageIO (extra `photo`); HEIF by
pillow-heif (`heif`); RAW by rawpy (`raw`).

Pixels are upright, as a file's orientation says, in the whole picture where the file holds a piece of one, and their
light is Rec. 709 whatever colours the file states (``stored_colours``).
"""

import os
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, replace
from os.path import isfile
from pathlib import Path
from typing import Any

import numpy as np

from twilight.base.errors import TwilightError
from twilight.base.extras import missing
from twilight.base.reading import MEMORY_FRACTION, first_line, memory_bytes
from twilight.io import stored_colours
from twilight.io.exr import OPAQUE, exr_size, laid_out, read_latlong_exr, write_channels

MAX_PIXELS = 400_000_000
"""Larger pictures are refused before memory is taken for them: 400 megapixels are 5 GB of linear RGB."""
BYTES_PER_PIXEL = 16
"""Memory for a pixel of a picture being read: linear RGB and what was stored."""

SATURATED_FRACTION = 0.98
"""An integer sample above this fraction of the full scale counts as saturated."""

TRANSPARENT = "; a channel A (alpha) of zeros makes all of it transparent: leave that channel out, or set it to 1"
"""What is said of a picture that is transparent everywhere."""

RADIANCE_SUFFIXES = (".hdr", ".pic", ".rgbe")
SAMPLE_SUFFIXES = (".png", ".jpg", ".jpeg", ".tif", ".tiff")
HEIF_SUFFIXES = (".heic", ".heif", ".hif")
RAW_SUFFIXES = (".dng", ".cr2", ".cr3", ".nef", ".arw", ".orf", ".rw2", ".raf", ".pef", ".srw", ".raw")
SUFFIXES = (*RADIANCE_SUFFIXES, ".exr", *SAMPLE_SUFFIXES, *HEIF_SUFFIXES, *RAW_SUFFIXES)

ResponseFunction = Callable[[np.ndarray], np.ndarray]
"""Undoes a camera's curve: samples (..., 3) in 0..1 to relative exposure (..., 3), see ``camera.response``."""


def srgb_to_linear(samples: np.ndarray) -> np.ndarray:
    """Linear light of sRGB samples 0..1 (IEC 61966-2-1)."""
    z = np.asarray(samples)
    return np.where(z <= 0.04045, z / 12.92, ((np.maximum(z, 0.0) + 0.055) / 1.055) ** 2.4)


@dataclass(frozen=True)
class StoredImage:
    """A photograph as it was stored, before any response curve is undone.

    samples (H, W, 3): 0..1 of the full scale for integers, linear Rec. 709 in the file's own scale for floats; float32.
    saturated (H, W): at the upper end of an integer scale, or missing.
    missing (H, W): not finite, transparent, or outside of a piece of a picture; samples there are 0.
    bits: of an integer sample, None for floats.
    linear: the format holds light itself (HDR, EXR, RAW, float TIFF) and has no response curve.
    grey: the file has one channel, repeated here; it says nothing about colour.
    exposure_time_s: from the file, None where it does not say.
    colours: what the file states of integer samples.
    """

    samples: np.ndarray
    saturated: np.ndarray
    bits: int | None
    linear: bool
    grey: bool = False
    missing: np.ndarray | None = None
    exposure_time_s: float | None = None
    colours: stored_colours.Colours = stored_colours.STATES_NOTHING

    def light(self, response: ResponseFunction | None) -> np.ndarray:
        """Linear Rec. 709 (H, W, 3), float32, of samples whose curve is undone by `response`; None: they are linear.

        In place of sRGB's curve a file's own is taken.
        """
        if self.linear:
            return self.samples
        if response is srgb_to_linear and self.colours.curves is not None:
            light = self.colours.curves(self.samples).astype(np.float32)
        else:
            light = self.samples if response is None else np.asarray(response(self.samples), dtype=np.float32)
        matrix = self.colours.to_rec709
        return light if matrix is None else np.asarray(light @ matrix.T, dtype=np.float32)


def read_image(path: str | Path, response: ResponseFunction | None = None) -> StoredImage:
    """A photograph whose samples are linear light (relative exposure), (H, W, 3).

    response: undoes the camera's curve of integer samples (``camera.response.load_response``); None: the samples are
    linear already.  Formats that hold light itself have none, and a response for them is an error.
    Errors: TwilightError for a missing, damaged, unknown or oversized file, and where an extra is not installed.
    """
    return as_light(path, read_samples(path), response)


def as_light(path: str | Path, picture: StoredImage, response: ResponseFunction | None) -> StoredImage:
    """Samples as stored as linear light; arguments and errors as `read_image`, `path` names the file in them."""
    if picture.linear and response is not None:
        raise TwilightError(f"{path}: holds linear light; a response curve is for PNG, JPEG and integer TIFF")
    return replace(picture, samples=picture.light(response), linear=True)


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
    if suffix in HEIF_SUFFIXES:
        return _heif(path)
    if suffix in RAW_SUFFIXES:
        return _raw(path)
    raise TwilightError(f"{path}: the ending '{path.suffix}' is not known; read are {', '.join(SUFFIXES)}")


def _floating(path: Path, values: np.ndarray, grey: bool = False) -> StoredImage:
    finite = np.isfinite(values).all(axis=-1)
    if not finite.any():
        raise TwilightError(f"{path}: holds no light: no pixel is finite and opaque{TRANSPARENT}")
    if not (values[finite] > 0).any():
        raise TwilightError(f"{path}: holds no light: no pixel is positive")
    values = np.where(finite[..., None], values, 0.0).astype(np.float32, copy=False)
    return StoredImage(values, ~finite, None, True, grey, ~finite)


def _of_integers(
    path: Path,
    samples: np.ndarray,
    opaque: np.ndarray | None,
    colours: stored_colours.Colours,
    *,
    grey: bool = False,
    place: stored_colours.Place | None = None,
    orientation: int = 1,
    seconds: float = 0.0,
) -> StoredImage:
    """A picture of whole numbers (H, W, 3) of 8 or 16 bits; opaque (H, W): None for all of it."""
    if samples.dtype not in (np.uint8, np.uint16):
        raise TwilightError(f"{path}: holds {samples.dtype}; integers of 8 or 16 bits without sign and floats are read")
    bits = 8 * samples.dtype.itemsize
    scaled = samples.astype(np.float32) / np.float32(2**bits - 1)
    missing = np.zeros(samples.shape[:2], bool) if opaque is None else ~opaque
    if missing.all():
        raise TwilightError(f"{path}: holds no light{TRANSPARENT}")
    if place is not None:
        scaled, missing = laid_out(scaled, place, 0.0), laid_out(missing, place, True)
    scaled, missing = (stored_colours.upright(values, orientation) for values in (scaled, missing))
    saturated = missing | np.any(scaled > SATURATED_FRACTION, axis=-1)
    exposure = seconds if 0.0 < seconds < np.inf else None
    return StoredImage(scaled, saturated, bits, False, grey, missing, exposure, colours)


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
        raise missing("OpenImageIO", f"{path}: a picture") from None
    OpenImageIO.attribute("limits:imagesize_MB", 0)  # our own limit, with our own sentence
    wanted = OpenImageIO.ImageSpec()
    wanted.attribute("oiio:UnassociatedAlpha", 1)  # samples as stored, not times the opacity
    head = stored_colours.radiance_head(path) if path.suffix.lower() in RADIANCE_SUFFIXES else None
    with _readable(path, head is not None and head.xyz) as readable, _without_native_messages():
        file = OpenImageIO.ImageInput.open(str(readable), wanted)
        if file is None:
            raise TwilightError(f"{path}: is not a complete picture ({_line(OpenImageIO.geterror())})")
        spec = file.spec()
        _check_size(path, spec.width, spec.height)
        _check_single(path, file)
        stored = file.read_image(OpenImageIO.UNKNOWN)
        error = file.geterror()
    if stored is None or error:
        raise TwilightError(f"{path}: is not a complete picture ({_line(error)})")
    if spec.nchannels > 4:
        raise TwilightError(f"{path}: has {spec.nchannels} channels; 1 to 4 are read")
    grey = spec.nchannels <= 2
    if path.suffix.lower() in (".tif", ".tiff") and spec.get_int_attribute("tiff:PhotometricInterpretation", 1) == 0:
        if stored.dtype == np.uint16:
            stored = 65535 - stored  # WhiteIsZero, which the library undoes of 8 bits alone
        elif stored.dtype != np.uint8:
            raise TwilightError(f"{path}: holds floats of which 0 is white; save it with black as 0")
    samples = np.repeat(stored[..., :1], 3, axis=-1) if grey else stored[..., :3]
    colours, place = stored_colours.colours_of(path, spec), stored_colours.place_of(path, spec)
    orientation = spec.get_int_attribute("Orientation", 1)
    if place is not None:
        _check_size(path, place.width, place.height)
    if spec.format.basetype in (OpenImageIO.HALF, OpenImageIO.FLOAT, OpenImageIO.DOUBLE):
        light = samples.astype(np.float32)
        if head is not None:
            light = np.asarray(_radiance(light) / head.divisor, dtype=np.float32)
            colours = stored_colours.Colours(head.to_rec709)
        elif (
            colours.curves is not None and np.abs(colours.curves.light - np.linspace(0, 1, 1024)[:, None]).max() > 1e-3
        ):
            raise TwilightError(
                f"{path}: holds floats and a colour profile with a curve; save it linear, or as integers"
            )
        light = light if colours.to_rec709 is None else light @ colours.to_rec709.T.astype(np.float32)
        light = light if place is None else laid_out(light, place, np.nan)
        return _floating(path, stored_colours.upright(light, orientation), grey)
    opaque = None
    if spec.alpha_channel >= 0:
        opaque = stored[..., spec.alpha_channel] >= OPAQUE * np.iinfo(stored.dtype).max
    seconds = spec.get_float_attribute("ExposureTime")
    return _of_integers(
        path, samples, opaque, colours, grey=grey, place=place, orientation=orientation, seconds=seconds
    )


def _check_single(path: Path, file: Any) -> None:
    """TwilightError for a film or pages; a smaller picture beside the first is a preview."""
    pages = 1
    if path.suffix.lower() == ".png":
        from PIL import Image  # start-up

        with suppress(OSError, ValueError, SyntaxError), Image.open(path) as image:
            pages = int(getattr(image, "n_frames", 1))
    elif path.suffix.lower() in (".tif", ".tiff"):
        size = file.spec().width, file.spec().height
        while file.seek_subimage(pages, 0) and (file.spec().width, file.spec().height) == size:
            pages += 1
        file.geterror()  # that there are no more is none
        file.seek_subimage(0, 0)
    if pages > 1:
        raise TwilightError(f"{path}: holds {pages} pictures, of one size; give a file with one of them")


@contextmanager
def _readable(path: Path, xyz: bool) -> Iterator[Path]:
    """The file itself, or a Radiance picture of X, Y, Z as one of R, G, B, which is what OpenImageIO reads."""
    if not xyz:
        yield path
        return
    with tempfile.TemporaryDirectory(prefix="twilight-") as folder:
        copy = Path(folder) / f"picture{path.suffix}"
        copy.write_bytes(path.read_bytes().replace(b"32-bit_rle_xyze", b"32-bit_rle_rgbe", 1))
        yield copy


def _radiance(rgb: np.ndarray) -> np.ndarray:
    """A Radiance picture's light.

    A mantissa m stands for the middle of its step, (m + 1/2) 2^(e - 136) (Ward, Real pixels, Graphics Gems II); what is
    read is its lower end, and the largest channel's exponent is that of all three.
    """
    largest = rgb.max(axis=-1, keepdims=True)
    exponent = np.frexp(largest)[1]
    return np.where(largest > 0, rgb + np.ldexp(np.float32(0.5), exponent - 8), 0.0).astype(np.float32)


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


def _heif(path: Path) -> StoredImage:
    """A HEIF, upright as its decoder has it, of 8 bits or of more: its colours are those of its ICC profile, else of
    its codes (nclx: Display P3, Rec. 2020; sRGB, linear, PQ, HLG)."""
    try:
        import pillow_heif  # optional
    except ImportError:
        raise missing("pillow_heif", f"{path}: a HEIF picture") from None
    try:
        file = pillow_heif.open_heif(path, convert_hdr_to_8bit=False)
        _check_size(path, *file.size)
        mode, said = file.mode.partition(";")[0], dict(file.info)
        stored = np.asarray(file[0])
    except (OSError, ValueError, SyntaxError, EOFError, RuntimeError) as error:
        raise TwilightError(f"{path}: is not a complete picture ({first_line(error)})") from None
    stored = stored.reshape(*stored.shape[:2], -1)
    if stored.dtype == np.uint16:  # filled up with zeros below
        bits = int(said.get("bit_depth") or 16)
        stored = np.minimum(np.rint((stored >> (16 - bits)) * (65535.0 / (2**bits - 1))), 65535).astype(np.uint16)
    opaque = stored[..., -1] >= OPAQUE * np.iinfo(stored.dtype).max if mode.endswith("A") else None
    grey = mode.startswith("L")
    samples = np.repeat(stored[..., :1], 3, axis=-1) if grey else stored[..., :3]
    if profile := said.get("icc_profile"):
        colours = stored_colours.of_profile(path, profile, grey=grey)
    else:
        codes = said.get("nclx_profile") or {}
        colours = stored_colours.of_codes(
            path, codes.get("color_primaries", 2), codes.get("transfer_characteristics", 2)
        )
    return _of_integers(path, samples, opaque, colours, grey=grey)


# RAW ------------------------------------------------------------------------------------------------------------


def _raw(path: Path) -> StoredImage:
    """A RAW file by LibRaw: camera white balance, linear Rec. 709, no brightening; 16 bits."""
    try:
        import rawpy  # optional
    except ImportError:
        raise missing("rawpy", f"{path}: a RAW file") from None
    try:
        with rawpy.imread(str(path)) as raw:
            _check_size(path, raw.sizes.width, raw.sizes.height)
            rgb = raw.postprocess(
                gamma=(1, 1), no_auto_bright=True, use_camera_wb=True, output_bps=16,
                output_color=rawpy.ColorSpace.sRGB, highlight_mode=rawpy.HighlightMode.Clip,
            )  # fmt: skip
    except (rawpy.LibRawError, MemoryError, ValueError) as error:
        raise TwilightError(f"{path}: is not a complete RAW file that LibRaw knows ({first_line(error)})") from None
    samples = rgb.astype(np.float32) / np.float32(65535)
    return StoredImage(samples, np.any(samples > SATURATED_FRACTION, axis=-1), 16, True)


def write_exr(path: str | Path, rgb: np.ndarray, attributes: dict[str, Any] | None = None) -> None:
    """Write linear Rec. 709 (H, W, 3) as an EXR (float32, ZIP), whole or not at all; errors: TwilightError."""
    write_channels(path, {name: rgb[..., i] for i, name in enumerate("RGB")}, attributes)
