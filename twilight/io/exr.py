"""``sky.rgb.exr`` and ``sky.spectral.exr``: environment maps as OpenEXR files, and their readers."""

import re
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from twilight.base.errors import TwilightError, check_known
from twilight.base.reading import check_expansion, reading
from twilight.base.whole_files import whole_file
from twilight.io.disc import add_to_map_factor, add_to_map_xyz
from twilight.io.environment import environment, environment_directions, ground_factor
from twilight.io.provenance import PREFIX, header_of, provenance_fields
from twilight.numerics import spectrum
from twilight.numerics.spectrum import rgb_to_xyz, to_rec709
from twilight.sky import colour
from twilight.sky.sky import Sky

REC709_CHROMATICITIES = (0.64, 0.33, 0.30, 0.60, 0.15, 0.06, 0.3127, 0.3290)
"""x, y of red, green, blue and white (ITU-R BT.709)."""
PRIMARIES = {
    "rec709": REC709_CHROMATICITIES,
    "rec2020": (0.708, 0.292, 0.170, 0.797, 0.131, 0.046, 0.3127, 0.3290),
    "acescg": (0.713, 0.293, 0.165, 0.830, 0.128, 0.044, 0.32168, 0.33767),
}
"""x, y of red, green, blue and white: ITU-R BT.709, BT.2020; AP1 of ACES (S-2014-004)."""
BRADFORD = np.array([[0.8951, 0.2664, -0.1614], [-0.7502, 1.7135, 0.0367], [0.0389, -0.0685, 1.0296]])
"""XYZ to the cones' responses of Lam's (1985) adaptation, by which ACES comes from D65."""
HALF_FROM_WIDTH = 4096
"""Width of maps [pixel] from which on they are in half floats, where these hold their light."""
HALF_RANGE = (2.0**-14, 65504.0)
"""Least normal and largest half float: between them a value is kept to 1/2048."""
OPAQUE = 0.99
"""Pixels with a smaller opacity than this show nothing."""
LARGEST = float(np.finfo(np.float32).max)
"""Largest value of a channel."""

_SPECTRAL_CHANNEL = re.compile(r"^S0\.(\d*,?\d*(?:[Ee][+-]?\d+)?)nm$")


@dataclass(frozen=True)
class LatLong:
    """An RGB picture: linear Rec. 709 (height, width, 3) on its display window, and the file's attributes.

    NaN where the file has no pixels, or transparent ones.
    """

    rgb: np.ndarray
    attributes: dict[str, Any]


def _header(sky: Sky, renderer: str, observer: str, disc: bool = False) -> dict[str, Any]:
    import OpenEXR  # start-up

    header: dict[str, Any] = {
        "whiteLuminance": float(spectrum.LUMINOUS_EFFICACY_LM_PER_W),
        f"{PREFIX}Renderer": renderer,
        f"{PREFIX}Colour": colour.colour_note(sky, observer),
        f"{PREFIX}SunElevationDeg": float(sky.sun_elevation_deg),
        f"{PREFIX}SunAzimuthDeg": float(sky.sun_azimuth_deg or 0.0),
        f"{PREFIX}SunAzimuth": "clockwise from north"
        + ("" if sky.sun_azimuth_deg is not None else "; not known, the sun is put in the north"),
        f"{PREFIX}SolarSpectrum": sky.solar_spectrum,
        f"{PREFIX}SunDisc": "in the map" if disc and sky.disc is not None else "not in the map",
    } | header_of(sky)
    if sky.moon is not None:
        header[f"{PREFIX}MoonDisc"] = "in the map" if disc and sky.moon.disc is not None else "not in the map"
    if renderer != "pbrt":
        header["envmap"] = OpenEXR.ENVMAP_LATLONG
    if sky.time is not None:
        header["capDate"] = sky.time.strftime("%Y:%m:%d %H:%M:%S")
        offset = sky.time.utcoffset()
        if offset is not None:
            # OpenEXR: universal time is local time plus the offset.
            header["utcOffset"] = -float(offset.total_seconds())
    for name, value in provenance_fields(sky.provenance).items():
        header[PREFIX + "".join(part.capitalize() for part in name.removeprefix("twilight_").split("_"))] = value
    return header


@cache
def from_rec709(primaries: str) -> np.ndarray:
    """Matrix (3, 3) from linear Rec. 709 to the RGB of a name of `PRIMARIES`, whites onto each other (Bradford)."""
    check_known("primaries", primaries, tuple(PRIMARIES))
    to_xyz = [rgb_to_xyz(PRIMARIES[name]) for name in ("rec709", primaries)]
    before, after = (BRADFORD @ matrix.sum(axis=1) for matrix in to_xyz)
    adapted = np.linalg.solve(BRADFORD, (after / before)[:, None] * BRADFORD)
    return np.asarray(np.linalg.solve(to_xyz[1], adapted @ to_xyz[0]))


def write_channels(
    path: str | Path, channels: dict[str, np.ndarray], attributes: dict[str, Any] | None = None, *, half: bool = False
) -> Path:
    """Write planes (H, W) as a float32 EXR or in half floats, whole or not at all; values beyond these are clipped.

    Red, green and blue are linear Rec. 709 where attributes do not say others.  Errors: TwilightError.
    """
    largest, kind = (HALF_RANGE[1], np.float16) if half else (LARGEST, np.float32)
    planes = {k: np.ascontiguousarray(np.clip(v, -largest, largest), dtype=kind) for k, v in channels.items()}
    return _write(path, planes, attributes or {})


def _is_half(rgb: np.ndarray, asked: str | None, path: str | Path) -> bool:
    """Whether a map is in half floats.  Errors: TwilightError where it is to be, and these do not hold its light."""
    if asked == "float" or (asked is None and rgb.shape[1] < HALF_FROM_WIDTH):
        return False
    brightest = rgb.max(axis=-1)
    low, high = float(np.min(brightest, where=brightest > 0.0, initial=np.inf)), float(brightest.max())
    if HALF_RANGE[0] <= low and high <= HALF_RANGE[1]:
        return True
    if asked is None:
        return False
    raise TwilightError(
        f"{path}: half floats hold light from {HALF_RANGE[0]:.2g} to {HALF_RANGE[1]:g}, and this map has "
        f"{low:.2g} to {high:.2g}; output.exr: float does"
    )


def _write(path: str | Path, planes: dict[str, np.ndarray], attributes: dict[str, Any]) -> Path:
    """Write planes (H, W) of float32 or float16 as they are."""
    import OpenEXR  # start-up

    header = {
        "compression": OpenEXR.ZIP_COMPRESSION,
        "type": OpenEXR.scanlineimage,
        "software": "twilight",
        "chromaticities": REC709_CHROMATICITIES,
        **attributes,
    }
    with whole_file(path) as temporary, OpenEXR.File(header, planes) as file:
        file.write(str(temporary))
    return Path(path)


def environment_rgb(
    sky: Sky, renderer: str, width: int, observer: str, *, disc: bool = False, primaries: str = "rec709"
) -> np.ndarray:
    """Linear RGB of primaries in units of ``spectrum.LUMINOUS_EFFICACY_LM_PER_W`` cd m^-2, (height, width', 3).

    Colours outside the gamut keep their negative values with ``openexr``; for a renderer they are moved into it
    (``colour.into_gamut``): negative light makes Mitsuba warn at every sample.
    """
    xyz = colour.sky_to_xyz(sky, observer=observer).astype(np.float32)
    ground = colour.sky_to_xyz(sky, ground_factor(sky), observer=observer)
    picture = environment(sky, xyz, ground, renderer, width)
    if disc:
        add_to_map_xyz(sky, picture, renderer, width, observer)
    matrix = from_rec709(primaries) @ spectrum.xyz_to_rgb_matrix("cie1931_2deg") / spectrum.LUMINOUS_EFFICACY_LM_PER_W
    rgb = picture @ matrix.T.astype(picture.dtype)
    if renderer == "openexr":
        return rgb
    return colour.into_gamut(rgb, colour.REC709_LUMINANCE @ np.linalg.inv(from_rec709(primaries)))


def write_rgb_exr(
    sky: Sky,
    path: str | Path,
    *,
    renderer: str = "openexr",
    width: int = 1024,
    observer: str = colour.DEFAULT_OBSERVER,
    disc: bool = False,
    primaries: str = "rec709",
    exr: str | None = None,
) -> Path:
    """Write the environment map as linear Rec. 709 (D65) or of other primaries, channels R, G, B and nothing else.

    1 stands for 683 cd m^-2 (header ``whiteLuminance``), so that the values are radiances weighted with V(lambda),
    W m^-2 sr^-1, a handful by day.  Colours outside the gamut keep their negative values with ``openexr`` and are moved
    into it for a renderer.  The chromaticity is that of the observer, the luminance that of V(lambda).  The lower
    hemisphere is the Lambertian ground.

    path: of the file, which is written whole or not at all.  renderer: whose axes the map has, a name of `RENDERERS` of
    `twilight.io.environment`.  width: of the picture [pixel], a multiple of 4; that of a square for `pbrt` is half of
    it.  observer: colour matching functions, a name of `twilight.numerics.spectrum.OBSERVERS`.  disc: whether the discs
    of sun and moon (of `Sky`) are in it, their light in the pixels that it comes from.  primaries: a name of
    `PRIMARIES`.  exr: float or half; None: half for maps of `HALF_FROM_WIDTH` and more whose light that holds.
    Errors: TwilightError for an unknown renderer or observer, another width, and a file that cannot be written.
    """
    rgb = environment_rgb(sky, renderer, width, observer, disc=disc, primaries=primaries)
    planes = {name: rgb[..., i] for i, name in enumerate("RGB")}
    header = _header(sky, renderer, observer, disc)
    if primaries != "rec709":
        header |= {"chromaticities": PRIMARIES[primaries], f"{PREFIX}Primaries": primaries}
    return write_channels(path, planes, header, half=_is_half(rgb, exr, path))


def write_picture_exr(planes: np.ndarray, path: str | Path, sky: Sky, observer: str) -> Path:
    """Write a picture of a sky that is no environment map: red, green, blue (linear Rec. 709 in the units of
    `write_rgb_exr`) and alpha, (4, H, W) float32, which is clipped in place to what that holds."""
    header = {name: value for name, value in _header(sky, "openexr", observer).items() if name != "envmap"}
    np.clip(planes, -LARGEST, LARGEST, out=planes)
    return _write(path, dict(zip("RGBA", planes, strict=True)), header)


def write_spectral_exr(
    sky: Sky,
    path: str | Path,
    *,
    renderer: str = "openexr",
    width: int = 256,
    observer: str = colour.DEFAULT_OBSERVER,
    disc: bool = False,
) -> Path:
    """Write the spectral environment map in the layout of Fichet, Pacanowski and Wilkie 2021 (JCGT 10(3)).

    One channel ``S0.550,000000nm`` per wavelength with the radiance in W m^-2 sr^-1 nm^-1 (float32), S1 and S2 beside
    it where the sky is polarised, and a preview R, G, B as in `write_rgb_exr`.  The layout's ``emissiveUnits`` has no
    form per nm and its reference reader accepts one string only; ``twilightRadianceUnits`` states the unit,
    ``twilightWavelengthBoundsNm`` the bins.

    Arguments: as of `write_rgb_exr`.  Errors: as there, and TwilightError for wavelengths closer than 1e-6 nm.
    """
    sun = sky.solar_irradiance
    spectra = environment(sky, sky.normalised_radiance, ground_factor(sky), renderer, width).astype(float)
    if disc:
        add_to_map_factor(sky, spectra, renderer, width)
    spectra *= sun
    rgb = environment_rgb(sky, renderer, width, observer, disc=disc)
    channels = {name: rgb[..., i] for i, name in enumerate("RGB")}
    for i, wavelength in enumerate(sky.wavelength_nm):
        channels[_channel("S0", wavelength)] = spectra[..., i]
    if len(channels) != 3 + sky.wavelength_nm.size:
        raise TwilightError(f"{path}: wavelengths closer than 1e-6 nm cannot be told apart in a spectral EXR")
    if sky.polarisation is not None:
        for name, values in zip(("S1", "S2"), _stokes(sky, spectra, renderer, width), strict=True):
            for i, wavelength in enumerate(sky.wavelength_nm):
                channels[_channel(name, wavelength)] = values[..., i]
    header = _header(sky, renderer, observer) | {
        "spectralLayoutVersion": "1.0",
        "emissiveUnits": "W.m^-2.sr^-1",
        f"{PREFIX}RadianceUnits": "W.m^-2.sr^-1.nm^-1",
        f"{PREFIX}WavelengthBoundsNm": ";".join(
            f"{low:.6g}:{high:.6g}" for low, high in spectrum.wavelength_bounds(sky.wavelength_nm, sky.solar_spectrum)
        ),
        f"{PREFIX}SolarIrradiance": ";".join(f"{value:.9g}" for value in sun),
    }
    if sky.polarisation is not None:
        header["polarisationHandedness"] = "right"
        header[f"{PREFIX}StokesReference"] = (
            "S1 = Q, S2 = U: plane through the line of sight and the vertical of the sky (not of the picture); S1 > 0: "
            "light vibrates in it; S2 > 0: seen along the line of sight the vibration leans clockwise from the vertical"
        )
    return write_channels(path, channels, header)


def _channel(component: str, wavelength_nm: float) -> str:
    """`S0.550,000000nm`."""
    return f"{component}.{f'{wavelength_nm:.6f}'.replace('.', ',')}nm"


def _stokes(sky: Sky, spectra: np.ndarray, renderer: str, width: int) -> tuple[np.ndarray, np.ndarray]:
    """Q and U of an environment map whose I is `spectra` (height, width', W); the ground is unpolarised."""
    elevation, azimuth = environment_directions(renderer, width)
    lowest = sky.elevation_edges_deg[0]
    azimuth = azimuth - (sky.sun_azimuth_deg or 0.0)
    q, u = np.moveaxis(sky.sample_fractional_stokes(np.maximum(elevation, lowest), azimuth), -2, 0)
    above = (elevation >= lowest)[..., None]
    return q * spectra * above, u * spectra * above


WHAT = "a complete OpenEXR file"


def _read(path: str | Path) -> tuple[dict[str, Any], dict[str, np.ndarray]]:
    import OpenEXR  # start-up

    path = Path(path)
    check_expansion(path, sum(_part_bytes(path, header) for header in _headers(path)))
    with reading(path, WHAT), OpenEXR.File(str(path), separate_channels=True) as file:
        header = dict(file.header())
        # The pixels belong to the file and end with it.
        channels = {name: np.array(channel.pixels) for name, channel in file.channels().items()}
    if len({pixels.shape for pixels in channels.values()}) > 1:
        raise TwilightError(f"{path}: its channels are not of the same size")
    return header, channels


def exr_size(path: str | Path) -> tuple[int, int]:
    """Width and height [pixels] of an EXR file's display window, or of its data window where that is larger.

    Errors: TwilightError where it has none.
    """
    header = _headers(Path(path))[0]
    return max(
        (_size(header, window) for window in ("displayWindow", "dataWindow")), key=lambda size: size[0] * size[1]
    )


def _headers(path: Path) -> list[dict[str, Any]]:
    """The header of every part, without the pixels."""
    import OpenEXR  # start-up

    with reading(path, WHAT), OpenEXR.File(str(path), separate_channels=True, header_only=True) as file:
        return [dict(part.header) for part in file.parts]


def _size(header: dict[str, Any], window: str = "dataWindow") -> tuple[int, int]:
    (left, top), (right, bottom) = ((int(x) for x in corner) for corner in header[window])
    return right - left + 1, bottom - top + 1


def _part_bytes(path: Path, header: dict[str, Any]) -> float:
    """Bytes of the pixels that a part's header describes, at half precision."""
    import OpenEXR  # start-up

    if header["type"] not in (OpenEXR.scanlineimage, OpenEXR.tiledimage):
        raise TwilightError(f"{path}: has samples at several depths, which are not read")
    width, height = _size(header)
    return 2.0 * len(header["channels"]) * width * height


def read_latlong_exr(path: str | Path) -> LatLong:
    """Read an RGB picture, whatever its primaries and white are and whichever part of its display window it holds.

    Errors: TwilightError where the file is not a complete EXR, has no R, G, B, or is no latitude-longitude map.
    """
    import OpenEXR  # start-up

    header, channels = _read(path)
    if not {"R", "G", "B"} <= channels.keys():
        raise TwilightError(f"{path}: has the channels {', '.join(sorted(channels))}, expected R, G and B")
    if header.get("envmap") == OpenEXR.ENVMAP_CUBE:
        raise TwilightError(f"{path}: is a map of six sides of a cube; latitude-longitude ones are read")
    rgb = np.stack([channels[name] for name in "RGB"], axis=-1)
    if (own := header.get(f"{PREFIX}Primaries")) in PRIMARIES:
        rgb = rgb.astype(np.float32) @ np.linalg.inv(from_rec709(str(own))).T.astype(np.float32)
    elif "chromaticities" in header:
        try:
            matrix = to_rec709(tuple(header["chromaticities"]))
        except ValueError:
            raise TwilightError(f"{path}: its chromaticities {header['chromaticities']} cannot be") from None
        rgb = rgb if matrix is None else (rgb @ matrix.T).astype(rgb.dtype)
    if "A" in channels:
        rgb[channels["A"] < OPAQUE] = np.nan
    return LatLong(_on_display(Path(path), rgb, header), header)


def _on_display(path: Path, rgb: np.ndarray, header: dict[str, Any]) -> np.ndarray:
    """Pixels of the data window on the display window, NaN where there are none."""
    if _size(header, "displayWindow") == _size(header) and np.array_equal(
        header["displayWindow"][0], header["dataWindow"][0]
    ):
        return rgb
    width, height = _size(header, "displayWindow")
    check_expansion(path, 4.0 * rgb.shape[-1] * width * height)
    left, top = (int(a) - int(b) for a, b in zip(header["dataWindow"][0], header["displayWindow"][0], strict=True))
    whole = laid_out(rgb, (width, height, left, top), np.nan)
    if np.isnan(whole).all():
        raise TwilightError(f"{path}: has no pixel within its display window")
    return whole


def laid_out(values: np.ndarray, place: tuple[int, int, int, int], outside: float) -> np.ndarray:
    """Pixels (h, w, ...) on the whole picture (H, W, ...), `outside` where there are none; what is beyond it is left.

    place: width and height of the whole, column and row of the first pixel.
    """
    width, height, left, top = place
    whole = np.full((height, width, *values.shape[2:]), outside, dtype=values.dtype)
    rows = slice(max(top, 0), min(top + values.shape[0], height))
    columns = slice(max(left, 0), min(left + values.shape[1], width))
    if rows.start < rows.stop and columns.start < columns.stop:
        whole[rows, columns] = values[rows.start - top : rows.stop - top, columns.start - left : columns.stop - left]
    return whole


def read_spectral_exr(path: str | Path) -> tuple[np.ndarray, np.ndarray, dict[str, Any]]:
    """Read a spectral environment map in the layout of `write_spectral_exr`, with channels like ``S0.550,0nm``.

    Returns the wavelengths (W,) [nm], increasing, the radiance (height, width, W) in the unit that the attributes say,
    and the attributes of the file's header.
    Errors: TwilightError where the file is not a complete EXR or has no channel of the layout.
    """
    header, channels = _read(path)
    planes = {
        float(match.group(1).replace(",", ".")): pixels
        for name, pixels in channels.items()
        if (match := _SPECTRAL_CHANNEL.match(name))
    }
    if not planes:
        raise TwilightError(f"{path}: has no channel like S0.550,0nm (Fichet et al. 2021)")
    wavelength = np.array(sorted(planes))
    return wavelength, np.stack([planes[w] for w in wavelength], axis=-1), header
