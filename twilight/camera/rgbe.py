"""Reader of Radiance pictures (``.hdr``, ``.pic``): RGBE and XYZE, run-length encoded or flat."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from twilight.errors import TwilightError

_XYZ_TO_RADIANCE_RGB = np.array([[2.5653, -1.1668, -0.3984], [-1.0221, 1.9783, 0.0438], [0.0747, -0.2519, 1.1772]])
"""XYZ (equal-energy white) to Radiance's own primaries (Ward and Shakespeare, Rendering with Radiance; color.h)."""

_SMALLEST_RUN_LENGTH_WIDTH, _LARGEST_RUN_LENGTH_WIDTH = 8, 32767


def read_header(path: Path, data: bytes) -> tuple[dict[str, list[str]], int, int, bool, bool, int]:
    """Variables (all values of each), width, height, upside down, mirrored, and where the pixels begin.

    Errors: TwilightError where the bytes are not the beginning of a Radiance picture that this reader knows.
    """
    if not data.startswith(b"#?"):
        raise TwilightError(f"{path}: is not a Radiance picture: it does not begin with #?RADIANCE")
    variables: dict[str, list[str]] = {}
    position = 0
    while True:
        end = data.find(b"\n", position)
        if end < 0 or end - position > 65536:
            raise TwilightError(f"{path}: its Radiance header has no end")
        line = data[position:end].decode("latin-1").strip()
        position = end + 1
        if not line:
            break
        name, equals, value = line.partition("=")
        if equals and not name.startswith("#"):
            variables.setdefault(name.strip().upper(), []).append(value.strip())
    end = data.find(b"\n", position)
    words = data[position : max(end, position)].decode("latin-1").split()
    if len(words) != 4 or words[0] not in ("-Y", "+Y") or words[2] not in ("+X", "-X"):
        raise TwilightError(f"{path}: its size line must be -Y HEIGHT +X WIDTH (or with the other signs)")
    try:
        height, width = int(words[1]), int(words[3])
    except ValueError:
        raise TwilightError(f"{path}: its size line holds no numbers: {' '.join(words)[:80]}") from None
    if height < 1 or width < 1:
        raise TwilightError(f"{path}: says that it is {width} x {height} pixels")
    return variables, width, height, words[0] == "+Y", words[2] == "-X", end + 1


def read_rgbe(path: str | Path, max_pixels: float = np.inf) -> np.ndarray:
    """Linear RGB (height, width, 3) of a Radiance picture, float32, its EXPOSURE and COLORCORR undone.

    A mantissa m stands for the middle of its step, (m + 1/2) 2^(e - 136) (Ward, Real pixels, Graphics Gems II).
    Errors: TwilightError where the file is not complete or larger than ``max_pixels``.
    """
    path = Path(path)
    try:
        data = path.read_bytes()
    except OSError as error:
        raise TwilightError(f"{path}: cannot be read ({error.strerror or error})") from None
    variables, width, height, upside_down, mirrored, start = read_header(path, data)
    if width * height > max_pixels:
        raise TwilightError(f"{path}: has {width} x {height} pixels; at most {max_pixels:.3g} are read")
    form = variables.get("FORMAT", ["32-bit_rle_rgbe"])[-1]
    if form not in ("32-bit_rle_rgbe", "32-bit_rle_xyze"):
        raise TwilightError(f"{path}: has the FORMAT {form[:40]}; 32-bit_rle_rgbe and 32-bit_rle_xyze are read")
    runs = 4 + 8 * -(-width // 127)  # the shortest row: four planes in runs of 127
    if (len(data) - start) < height * min(4 * width, runs):
        raise TwilightError(f"{path}: is cut off: {width} x {height} pixels do not fit into {len(data)} bytes")
    rgbe = _pixels(path, data, start, width, height)
    values = (rgbe[..., :3].astype(np.float32) + 0.5) * np.exp2(rgbe[..., 3:].astype(np.float32) - 136.0)
    values[rgbe[..., 3] == 0] = 0.0
    if form.endswith("xyze"):
        values = (values @ _XYZ_TO_RADIANCE_RGB.T.astype(np.float32)).astype(np.float32)
    values /= _scale(path, variables)
    return np.ascontiguousarray(values[:: -1 if upside_down else 1, :: -1 if mirrored else 1])


def _scale(path: Path, variables: dict[str, list[str]]) -> np.ndarray:
    """What the stored values were multiplied with, (3,): all EXPOSURE and COLORCORR lines together."""
    scale = np.ones(3, dtype=np.float32)
    try:
        for text in variables.get("EXPOSURE", []):
            scale *= float(text)
        for text in variables.get("COLORCORR", []):
            scale *= np.array([float(word) for word in text.split()], dtype=np.float32)
    except ValueError:
        raise TwilightError(f"{path}: EXPOSURE or COLORCORR in its header is not a number") from None
    if not (np.isfinite(scale).all() and (scale > 0).all()):
        raise TwilightError(f"{path}: EXPOSURE or COLORCORR in its header is not positive")
    return scale


def _pixels(path: Path, data: bytes, start: int, width: int, height: int) -> np.ndarray:
    """Mantissas and exponents (height, width, 4)."""
    marker = bytes([2, 2, width >> 8, width & 255]) if width <= _LARGEST_RUN_LENGTH_WIDTH else b"none"
    if width < _SMALLEST_RUN_LENGTH_WIDTH or data[start : start + 4] != marker:
        flat = np.frombuffer(data, np.uint8, offset=start)[: 4 * width * height]
        if flat.size < 4 * width * height:
            raise TwilightError(f"{path}: is cut off, or in the run-length encoding of 1985, which is not read")
        return flat.reshape(height, width, 4)
    out = np.empty((height, width, 4), np.uint8)
    position = start
    for y in range(height):
        if data[position : position + 4] != marker:
            raise TwilightError(f"{path}: is cut off or damaged in row {y} of {height}")
        line, position = _row(path, data, position + 4, width, y, height)
        out[y] = line
    return out


def _row(path: Path, data: bytes, position: int, width: int, y: int, height: int) -> tuple[np.ndarray, int]:
    """One run-length encoded row (width, 4) and where the next one begins."""
    need = 4 * width
    line = bytearray()
    while len(line) < need:
        if position + 1 >= len(data):
            raise TwilightError(f"{path}: is cut off in row {y} of {height}")
        count = data[position]
        if count > 128:
            line += data[position + 1 : position + 2] * (count - 128)
            position += 2
        else:
            line += data[position + 1 : position + 1 + count]
            position += 1 + count
        if count == 0 or (len(line) - 1) // width > 3 or position > len(data):
            raise TwilightError(f"{path}: is damaged in row {y} of {height}")
    return np.frombuffer(bytes(line[:need]), np.uint8).reshape(4, width).T, position
