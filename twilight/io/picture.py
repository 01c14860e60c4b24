"""``sky.png``: what a person looks at first, the upper hemisphere with the sun's azimuth in the middle."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

import numpy as np

from twilight import colour
from twilight.errors import TwilightError
from twilight.io.provenance import provenance_fields
from twilight.io.whole import whole_file
from twilight.sky import Sky

View = Literal["panorama", "fisheye"]
VIEWS: tuple[str, ...] = ("panorama", "fisheye")
DEFAULT_WIDTH = {"panorama": 1440, "fisheye": 720}


def sky_exposure_ev100(sky: Sky, observer: str = colour.DEFAULT_OBSERVER) -> float:
    """The exposure value that ``exposure="auto"`` takes for a sky (``colour.auto_exposure_ev100``), for sequences."""
    luminance = colour.sky_to_xyz(sky, observer=observer)[..., 1]
    return colour.auto_exposure_ev100(luminance, np.broadcast_to(sky.solid_angle_sr()[:, None], luminance.shape))


def view_directions(view: str, width: int) -> tuple[np.ndarray, np.ndarray]:
    """Elevation and azimuth relative to the sun [deg] of the pixel centres of a picture.

    ``panorama``: width x width / 4, horizon below, zenith above, the sun's azimuth in the middle, clockwise to the
    right; (height, 1) and (1, width).  ``fisheye``: width x width, equidistant, the zenith in the middle, the sun's
    azimuth at the bottom, clockwise to the right (what one sees who faces the sun and looks up); outside the circle
    the elevation is negative.  Raises TwilightError for another view or size.
    """
    if view not in VIEWS:
        raise TwilightError(f"view: '{view}' is not known, choose one of {', '.join(VIEWS)}")
    if width < 4 or width % 4:
        raise TwilightError(f"width: {width} must be a positive multiple of 4")
    if view == "panorama":
        elevation = 90.0 - 360.0 * (np.arange(width // 4) + 0.5) / width
        azimuth = 360.0 * (np.arange(width) + 0.5) / width - 180.0
        return elevation[:, None], azimuth[None, :]
    centre = 2 * (np.arange(width) + 0.5) / width - 1
    down, right = np.meshgrid(centre, centre, indexing="ij")
    return 90.0 * (1.0 - np.hypot(right, down)), np.degrees(np.arctan2(right, down))


def check_options(exposure: float | Literal["auto"], tone_mapping: str, observer: str) -> None:
    """Raise TwilightError for an exposure, a tone mapping or an observer that cannot be."""
    if exposure != "auto" and not np.isfinite(float(exposure)):
        raise TwilightError(f"exposure: {exposure} must be 'auto' or a finite exposure value at ISO 100")
    colour.check_names(tone_mapping, observer)


def render_view(
    sky: Sky,
    *,
    view: str = "panorama",
    width: int | None = None,
    exposure: float | Literal["auto"] = "auto",
    tone_mapping: str = "filmic",
    observer: str = colour.DEFAULT_OBSERVER,
) -> tuple[np.ndarray, float]:
    """Display values 0..1 (height, width, 3) and the EV100 used; outside the circle of a fisheye NaN.

    The colours of the sky's grid are interpolated smoothly (``Sky.smooth``), then exposed and tone mapped.
    """
    elevation, azimuth = view_directions(view, width or DEFAULT_WIDTH.get(view, 0))
    check_options(exposure, tone_mapping, observer)
    ev100 = sky_exposure_ev100(sky, observer) if exposure == "auto" else float(exposure)
    xyz = colour.sky_to_xyz(sky, observer=observer)
    picture = sky.smooth(xyz, np.maximum(elevation, 0.0), azimuth)
    picture = colour.tone_map(colour.xyz_to_linear_rgb(picture), ev100, tone_mapping)
    if view == "fisheye":
        picture[elevation < 0] = np.nan
    return picture, ev100


def _to_bytes(picture: np.ndarray) -> np.ndarray:
    """8 bits with an ordered dither of half a step, so that the smooth sky shows no bands.

    The pattern is interleaved gradient noise (Jimenez 2014, Next generation post processing in Call of Duty): fixed,
    so equal skies give equal files.
    """
    y, x = np.indices(picture.shape[:2])
    noise = np.mod(52.9829189 * np.mod(0.06711056 * x + 0.00583715 * y, 1.0), 1.0)
    return np.clip(np.floor(picture * 255.0 + noise[..., None]), 0, 255).astype(np.uint8)


def write_png(
    sky: Sky,
    path: str | Path,
    *,
    view: str = "panorama",
    width: int | None = None,
    exposure: float | Literal["auto"] = "auto",
    tone_mapping: str = "filmic",
    observer: str = colour.DEFAULT_OBSERVER,
) -> Path:
    """Write a picture of the sky as 8 bit sRGB PNG, whole or not at all; the provenance is in its text chunks.

    ``exposure`` is an exposure value at ISO 100 as on a camera (15: sunlit scene, -3: deep twilight), one step = a
    factor 2, or ``auto``; the value used is in the text chunk ``exposure_ev100``, so that the other pictures of a
    sequence can be given the same.  Tone mapping: ``colour.tone_map``.  Raises TwilightError for unknown options.
    """
    from PIL import Image
    from PIL.PngImagePlugin import PngInfo

    picture, ev100 = render_view(
        sky, view=view, width=width, exposure=exposure, tone_mapping=tone_mapping, observer=observer
    )
    outside = np.isnan(picture[..., 0])
    pixels = _to_bytes(np.nan_to_num(picture))
    if outside.any():
        pixels = np.dstack([pixels, np.where(outside, 0, 255).astype(np.uint8)])
    info = PngInfo()
    info.add(b"sRGB", b"\x00")
    texts = {
        "Software": "twilight",
        "sun_elevation_deg": f"{sky.sun_elevation_deg:g}",
        "view": view,
        "exposure_ev100": f"{ev100:.6g}",
        "tone_mapping": tone_mapping,
        "colour": colour.colour_note(sky, observer),
        **{name: str(value) for name, value in provenance_fields(sky.provenance).items()},
    }
    for name, value in texts.items():
        info.add_itxt(name, value, zip=len(value) > 1000)
    with whole_file(path) as temporary:
        Image.fromarray(pixels).save(temporary, format="PNG", pnginfo=info, optimize=False)
    return Path(path)
