"""What a picture's file states of its colours and of where its pixels belong.

Colours: an ICC profile with a matrix and curves, PNG's gAMA and cHRM, Adobe RGB by Exif's interoperability, a Radiance
picture's PRIMARIES, EXPOSURE and COLORCORR.  Places: orientation, a piece of a larger picture (TIFF, EXR), a piece of a
panorama (XMP, GPano).  What is not known is refused with a sentence.
"""

import struct
from collections.abc import Callable
from io import BytesIO
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from twilight.base.errors import TwilightError
from twilight.numerics.spectrum import from_xyz, to_rec709

ADOBE_RGB = (0.64, 0.33, 0.21, 0.71, 0.15, 0.06, 0.3127, 0.3290)
"""x, y of red, green, blue and white of Adobe RGB (1998); its samples are light to the power 1 / 2.19921875."""
ADOBE_EXPONENT = 2.19921875
EXIF_SRGB, EXIF_ADOBE_RGB, EXIF_UNCALIBRATED = 1, 2, 65535
"""Exif's ColorSpace; 2 is not in the standard, but what some cameras write for Adobe RGB."""
INKS = ("CMYK", "YCCK")
"""Pictures for print."""
SRGB_GAMMA = 0.45455
"""What PNG's gAMA says of sRGB."""
NODES = 1024
"""Samples at which the curves of a profile are tabulated."""
D50_TO_D65 = np.array(
    [
        [0.9555766, -0.0230393, 0.0631636],
        [-0.0282895, 1.0099416, 0.0210077],
        [0.0122982, -0.0204830, 1.3299098],
    ]
)
"""Bradford's adaptation of XYZ from the white of profiles to that of Rec. 709 (Lindbloom)."""


class Curves(NamedTuple):
    """Light (N, 3) at samples that go evenly from 0 to 1; call it with samples (..., 3)."""

    light: np.ndarray

    def __call__(self, samples: np.ndarray) -> np.ndarray:
        at = np.linspace(0.0, 1.0, len(self.light))
        return np.stack([np.interp(samples[..., c], at, self.light[:, c]) for c in range(3)], axis=-1)

    @property
    def linear(self) -> bool:
        """Whether samples are light already."""
        return bool(np.abs(self.light - np.linspace(0.0, 1.0, len(self.light))[:, None]).max() < 1e-3)


class Colours(NamedTuple):
    """to_rec709 (3, 3): of linear RGB, None where it is Rec. 709; curves: of the samples, None where not stated."""

    to_rec709: np.ndarray | None = None
    curves: Curves | None = None


STATES_NOTHING = Colours()


def colours_of(path: Path, spec: Any) -> Colours:
    """What a PNG, JPEG or TIFF states of its colours; spec: OpenImageIO's.  Errors: TwilightError."""
    code = spec.getattribute("CICP")
    if code is not None:
        return of_codes(path, int(code[0]), int(code[1]))
    if (model := spec.getattribute("jpeg:ColorSpace") or spec.getattribute("tiff:ColorSpace")) in INKS:
        raise TwilightError(f"{path}: holds amounts of ink ({model}), which say no light; save it as sRGB")
    profile = spec.getattribute("ICCProfile")
    if profile is not None:
        return of_profile(path, np.asarray(profile, dtype=np.uint8).tobytes(), grey=spec.nchannels <= 2)
    if path.suffix.lower() == ".png":
        return _of_png(path)
    space = spec.get_int_attribute("Exif:ColorSpace", EXIF_SRGB)
    interoperability = str(spec.getattribute("Exif:InteroperabilityIndex") or _interoperability(path))
    if interoperability.startswith("R03") or space == EXIF_ADOBE_RGB:
        return Colours(to_rec709(ADOBE_RGB), _power(ADOBE_EXPONENT))
    if space == EXIF_UNCALIBRATED:
        raise TwilightError(
            f"{path}: says that its colours are not sRGB (Exif ColorSpace {space}), and not which they are; save it as "
            "sRGB or with an ICC profile"
        )
    return Colours()


def of_codes(path: Path, primaries: int, curve: int) -> Colours:
    """Colours by codes of ITU-T H.273 (nclx, cICP); 2 is "unspecified": Rec. 709 and sRGB."""
    if primaries not in PRIMARIES or curve not in TRANSFERS:
        raise TwilightError(
            f"{path}: has primaries {primaries} and curve {curve} of ITU-T H.273, which are not read; save it as sRGB "
            "or with an ICC profile"
        )
    chromaticities, light = PRIMARIES[primaries], TRANSFERS[curve]
    matrix = None if chromaticities is None else to_rec709(chromaticities)
    if light is None:
        return Colours(matrix)
    return Colours(matrix, Curves(np.repeat(light(np.linspace(0.0, 1.0, NODES))[:, None], 3, axis=1)))


def _of_pq(samples: np.ndarray) -> np.ndarray:
    """Light of the perceptual quantiser (ITU-R BT.2100, table 4), 1 for the reference white."""
    m1, m2, c1, c2, c3 = 2610 / 16384, 2523 / 32, 3424 / 4096, 2413 / 128, 2392 / 128
    root = samples ** (1.0 / m2)
    return 1e4 / REFERENCE_WHITE_CD_PER_M2 * (np.maximum(root - c1, 0.0) / (c2 - c3 * root)) ** (1.0 / m1)


def _of_hlg(samples: np.ndarray) -> np.ndarray:
    """Light before the camera of hybrid log-gamma (ITU-R BT.2100, table 5), 1 for the reference white."""
    a, b, c = 0.17883277, 0.28466892, 0.55991073

    def light(x: np.ndarray) -> np.ndarray:
        return np.where(x <= 0.5, x**2 / 3.0, (np.exp((x - c) / a) + b) / 12.0)

    return light(samples) / light(np.array(HLG_WHITE))


REFERENCE_WHITE_CD_PER_M2 = 203.0
"""Luminance of white paper in PQ (ITU-R BT.2408) [cd m^-2]."""
HLG_WHITE = 0.75
"""Its sample in hybrid log-gamma (the same)."""
PRIMARIES: dict[int, tuple[float, ...] | None] = {
    1: None,
    2: None,
    9: (0.708, 0.292, 0.170, 0.797, 0.131, 0.046, 0.3127, 0.3290),
    12: (0.680, 0.320, 0.265, 0.690, 0.150, 0.060, 0.3127, 0.3290),
}
"""x, y of red, green, blue and white by their code of ITU-T H.273: Rec. 709, unspecified, Rec. 2020, Display P3."""
TRANSFERS: dict[int, Callable[[np.ndarray], np.ndarray] | None] = {
    1: None,
    2: None,
    4: lambda samples: samples**2.2,
    6: None,
    8: lambda samples: samples,
    13: None,
    14: None,
    15: None,
    16: _of_pq,
    18: _of_hlg,
}
"""Light of samples by the curve's code of ITU-T H.273; None: sRGB's, also of Rec. 601, 709 and 2020, whose pictures are
shown alike."""


def _power(exponent: float) -> Curves:
    return Curves(np.repeat(np.linspace(0.0, 1.0, NODES)[:, None] ** exponent, 3, axis=1))


def _of_png(path: Path) -> Colours:
    from PIL import Image  # start-up

    try:
        with Image.open(path) as image:
            said = dict(image.info)
    except (OSError, ValueError, SyntaxError):
        return Colours()  # whoever reads the pixels says what is wrong
    if "srgb" in said:
        return Colours()
    gamma, primaries = said.get("gamma"), said.get("chromaticity")
    curves = None if not gamma or abs(gamma / SRGB_GAMMA - 1.0) < 0.01 else _power(1.0 / gamma)
    if primaries is None:
        return Colours(None, curves)
    # PNG begins with the white
    return Colours(_matrix(path, (*primaries[2:], *primaries[:2])), curves)


def _interoperability(path: Path) -> str:
    from PIL import Image  # start-up

    try:
        with Image.open(path) as image:
            return str(image.getexif().get_ifd(0xA005).get(1, ""))
    except (OSError, ValueError, SyntaxError, AttributeError):
        return ""


def _matrix(path: Path, chromaticities: tuple[float, ...]) -> np.ndarray | None:
    try:
        return to_rec709(chromaticities)
    except ValueError:
        raise TwilightError(
            f"{path}: says that its primaries and white are {chromaticities}, which cannot be"
        ) from None


# ICC profiles ---------------------------------------------------------------------------------------------------


def of_profile(path: Path, data: bytes, grey: bool) -> Colours:
    """An ICC profile of three primaries and their curves, or, of a grey picture, of a grey curve."""
    from PIL import ImageCms  # start-up

    try:
        profile = ImageCms.ImageCmsProfile(BytesIO(data)).profile
        tags = _tags(data)
        if grey and profile.xcolor_space.strip() == "GRAY" and "kTRC" in tags:
            return Colours(None, Curves(np.repeat(_curve(tags["kTRC"])[:, None], 3, axis=1)))
        if profile.xcolor_space.strip() == "RGB" and profile.is_matrix_shaper:
            columns = np.array([profile.red_colorant, profile.green_colorant, profile.blue_colorant])[:, 0]
            matrix = from_xyz(D50_TO_D65 @ columns.T)
            return Colours(matrix, Curves(np.stack([_curve(tags[f"{c}TRC"]) for c in "rgb"], axis=-1)))
    except (OSError, ValueError, KeyError, IndexError, TypeError, struct.error, ImageCms.PyCMSError):
        raise TwilightError(f"{path}: its colour profile (ICC) is damaged; save it as sRGB") from None
    raise TwilightError(
        f"{path}: its colour profile (ICC) is not one of three primaries and their curves{', or of grey' * grey}; save "
        "it as sRGB"
    )


def _tags(data: bytes) -> dict[str, bytes]:
    """The tags of a profile (ICC.1:2010, 7.3)."""
    (count,) = struct.unpack_from(">I", data, 128)
    found = {}
    for n in range(min(count, 1000)):
        name, offset, size = struct.unpack_from(">4sII", data, 132 + 12 * n)
        found[name.decode("latin-1")] = data[offset : offset + size]
    return found


def _curve(tag: bytes) -> np.ndarray:
    """Light (NODES,) of a curve: a table or an exponent (ICC.1:2010, 10.5), or a formula (10.15)."""
    x = np.linspace(0.0, 1.0, NODES)
    if tag[:4] == b"curv":
        (count,) = struct.unpack_from(">I", tag, 8)
        if count == 0:
            return x
        table = np.frombuffer(tag, ">u2", count, 12).astype(float)
        return x ** (table[0] / 256.0) if count == 1 else np.interp(x, np.linspace(0.0, 1.0, count), table / 65535.0)
    (kind,) = struct.unpack_from(">H", tag, 8)
    if tag[:4] != b"para" or kind > 4:
        raise ValueError("no curve")
    numbers = [v / 65536.0 for v in struct.unpack_from(f">{(1, 3, 4, 5, 7)[kind]}i", tag, 12)]
    g, a, b, c, d, e, f = numbers + [0.0] * (7 - len(numbers))
    if kind == 0:
        a, d = 1.0, -np.inf
    elif kind == 1:
        d = -b / a
    elif kind == 2:
        c, d, e, f = 0.0, -b / a, c, c
    power = np.maximum(a * x + b, 0.0) ** g + e
    return np.clip(np.where(x >= d, power, c * x + f), 0.0, 1.0)


# Radiance -------------------------------------------------------------------------------------------------------


class RadianceHead(NamedTuple):
    """xyz: the pixels are X, Y, Z; divisor (3,): of the stored numbers; to_rec709 as in `Colours`."""

    xyz: bool
    divisor: np.ndarray
    to_rec709: np.ndarray | None


def radiance_head(path: Path) -> RadianceHead:
    """The head of a Radiance picture: every EXPOSURE and COLORCORR counts.  Errors: TwilightError."""
    with path.open("rb") as file:
        head = file.read(65536).partition(b"\n\n")[0]
    divisor, primaries, xyz = np.ones(3), None, False
    for line in head.decode("latin-1").splitlines():
        name, _, value = line.partition("=")
        name, value = name.strip().upper(), value.strip()
        try:
            if name == "EXPOSURE":
                divisor = divisor * float(value)
            elif name == "COLORCORR":
                divisor = divisor * np.array([float(v) for v in value.split()]).reshape(3)
            elif name == "PRIMARIES":
                primaries = tuple(float(v) for v in value.split())
                if len(primaries) != 8:
                    raise ValueError
                primaries = primaries if any(primaries) else None  # some programs write zeros for "not stated"
        except ValueError:
            raise TwilightError(f"{path}: {name}={value[:80]} in its head is not what it should be") from None
        xyz |= name == "FORMAT" and value.lower() == "32-bit_rle_xyze"
    if not (np.isfinite(divisor).all() and (divisor > 0.0).all()):
        raise TwilightError(f"{path}: its EXPOSURE and COLORCORR must be positive; they are {divisor}")
    if xyz:
        return RadianceHead(True, divisor, from_xyz(np.eye(3)))
    return RadianceHead(False, divisor, None if primaries is None else _matrix(path, primaries))


# Places ---------------------------------------------------------------------------------------------------------


class Place(NamedTuple):
    """Where the stored pixels lie in the whole picture: its size, and their left upper corner [pixels]."""

    width: int
    height: int
    left: int
    top: int


def place_of(path: Path, spec: Any) -> Place | None:
    """What a file says of the whole that it is a piece of; None: it is the whole.  Errors: TwilightError."""
    whole = Place(spec.full_width, spec.full_height, spec.x - spec.full_x, spec.y - spec.full_y)
    return _piece(spec, _panorama(path, spec) or whole)


def _piece(spec: Any, place: Place) -> Place | None:
    return None if place == Place(spec.width, spec.height, 0, 0) else place


def _panorama(path: Path, spec: Any) -> Place | None:
    """The piece of a panorama that GPano says, in pixels of the file (which may have been made smaller since)."""

    def number(name: str) -> float | None:
        value = spec.getattribute(f"GPano:{name}")
        try:
            return None if value is None else float(value)
        except ValueError:
            raise TwilightError(f"{path}: GPano:{name} is {value!r}, not a number") from None

    kind = spec.getattribute("GPano:ProjectionType")
    if kind is not None and str(kind).lower() != "equirectangular":
        raise TwilightError(f"{path}: is a panorama of the projection {kind!r}; equirectangular ones are read")
    for name in ("PosePitchDegrees", "PoseRollDegrees"):
        if abs(number(name) or 0.0) > 0.5:
            raise TwilightError(
                f"{path}: says that it is not level (GPano:{name} {number(name):g}); level it, and set that to 0"
            )
    names = ("FullPanoWidthPixels", "FullPanoHeightPixels", "CroppedAreaLeftPixels", "CroppedAreaTopPixels")
    sizes = ("CroppedAreaImageWidthPixels", "CroppedAreaImageHeightPixels")
    values, (width, height) = [number(name) for name in names], [number(name) for name in sizes]
    if values[0] is None or values[1] is None:
        if said := [name for name, value in zip(names, values, strict=True) if value]:
            raise TwilightError(
                f"{path}: says GPano:{said[0]}, and not how large the whole is; that takes GPano:{names[0]} and "
                f"GPano:{names[1]}"
            )
        return None
    full_width, full_height, left, top = (value or 0.0 for value in values)
    scale = np.array([spec.width / (width or full_width), spec.height / (height or full_height)])
    place = Place(*(round(v) for v in np.array([full_width, full_height, left, top]) * np.tile(scale, 2)))
    if min(place) < 0 or place.left + spec.width > place.width + 1 or place.top + spec.height > place.height + 1:
        raise TwilightError(
            f"{path}: what GPano says cannot be: {spec.width} x {spec.height} pixels at {place.left}, {place.top} of "
            f"{place.width} x {place.height}"
        )
    return place


def upright(values: np.ndarray, orientation: int) -> np.ndarray:
    """Pixels (H, W, ...) turned as a file's orientation (1 to 8, as of TIFF and Exif) says."""
    if orientation >= 5:
        values = np.swapaxes(values, 0, 1)
    across, down = {2: (1, 0), 3: (1, 1), 4: (0, 1), 6: (1, 0), 7: (1, 1), 8: (0, 1)}.get(orientation, (0, 0))
    values = values[:, ::-1] if across else values
    return np.ascontiguousarray(values[::-1] if down else values)
