"""``sky.png``: what a person looks at first, the sky over the horizon with the sun's azimuth in the middle."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Literal

import numpy as np

from twilight import colour
from twilight.errors import TwilightError
from twilight.io.environment import ground_factor
from twilight.io.provenance import provenance_fields
from twilight.io.rendered import Options, Rendered
from twilight.io.whole import whole_file
from twilight.sky import Sky

View = Literal["wide", "panorama", "fisheye"]
VIEWS: tuple[str, ...] = ("wide", "panorama", "fisheye")
DEFAULT_VIEW: View = "wide"
DEFAULT_WIDTH = {"wide": 1600, "panorama": 1440, "fisheye": 720}

WIDE_FIELD_DEG = 110.0
"""Horizontal field of view of the wide picture: that of the eyes' common field."""
WIDE_HORIZON = 0.86
"""Where the horizon lies, as a share of the height from above."""
WIDE_EXPOSURE_STEPS = -0.3
"""Stops that the wide picture is given less (or more, negative) light than the meter says."""
GROUND_SEEN_UP_TO_KM = 0.1
"""Observers no higher above the sphere see its ground from 0 deg down: the dip of the horizon is 0.3 deg at most."""


def sky_exposure_ev100(sky: Sky, observer: str = colour.DEFAULT_OBSERVER) -> float:
    """The exposure value that ``exposure="auto"`` takes for a sky (``colour.auto_exposure_ev100``), for sequences."""
    luminance = colour.sky_to_xyz(sky, observer=observer)[..., 1]
    return colour.auto_exposure_ev100(luminance, np.broadcast_to(sky.solid_angle_sr()[:, None], luminance.shape))


def view_directions(view: str, width: int) -> tuple[np.ndarray, np.ndarray]:
    """Elevation and azimuth relative to the sun [deg] of the pixel centres of a picture.

    ``wide``: a cylinder, width x 9/20 width, 110 deg from side to side, the sun's azimuth in the middle, upright lines
    straight, the horizon at 0.86 of the height; (height, 1) and (1, width).
    ``panorama``: width x width / 4, horizon below, zenith above, the sun's azimuth in the middle, clockwise to the
    right; (height, 1) and (1, width).  ``fisheye``: width x width, equidistant, the zenith in the middle, the sun's
    azimuth at the bottom, clockwise to the right (what one sees who faces the sun and looks up); outside the circle
    the elevation is negative.  Raises TwilightError for another view or size.
    """
    if view not in VIEWS:
        raise TwilightError(f"view: '{view}' is not known, choose one of {', '.join(VIEWS)}")
    if width < 4 or width % 4:
        raise TwilightError(f"width: {width} must be a positive multiple of 4")
    if view == "wide":
        height = 9 * width // 20
        pixels_per_radian = width / np.radians(WIDE_FIELD_DEG)
        elevation = np.degrees(np.arctan((WIDE_HORIZON * height - np.arange(height) - 0.5) / pixels_per_radian))
        azimuth = WIDE_FIELD_DEG * ((np.arange(width) + 0.5) / width - 0.5)
        return elevation[:, None], azimuth[None, :]
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
    view: str = DEFAULT_VIEW,
    width: int | None = None,
    exposure: float | Literal["auto"] = "auto",
    tone_mapping: str = colour.DEFAULT_TONE_MAPPING,
    observer: str = colour.DEFAULT_OBSERVER,
) -> tuple[np.ndarray, float]:
    """Display values 0..1 (height, width, 3) and the EV100 used; outside the circle of a fisheye NaN.

    The colours of the sky's grid are interpolated smoothly (``Sky.smooth``), then exposed and tone mapped.  ``auto``
    exposes the wide picture for the part of the sky that it shows, the others for the whole sky
    (``colour.auto_exposure_ev100``).  Below the horizon of the wide picture is the lit Lambertian ground; for an
    observer high above it, whose horizon dips, the picture ends at 0 deg.
    """
    elevation, azimuth = view_directions(view, width or DEFAULT_WIDTH.get(view, 0))
    check_options(exposure, tone_mapping, observer)
    if view == "wide" and sky.observer_altitude_km > GROUND_SEEN_UP_TO_KM:
        elevation = elevation[elevation[:, 0] > 0.0]
    xyz = colour.sky_to_xyz(sky, observer=observer)
    picture = sky.smooth(xyz, np.maximum(elevation, 0.0), azimuth)
    if exposure != "auto":
        ev100 = float(exposure)
    elif view == "wide":
        ev100 = colour.auto_exposure_ev100(picture[elevation[:, 0] > 0.0, :, 1]) + WIDE_EXPOSURE_STEPS
    else:
        ev100 = sky_exposure_ev100(sky, observer)
    if view == "wide":
        picture[elevation[:, 0] <= 0.0] = colour.sky_to_xyz(sky, ground_factor(sky), observer=observer)
    picture = colour.tone_map(colour.xyz_to_linear_rgb(picture), ev100, tone_mapping)
    if view == "fisheye":
        picture[elevation < 0] = np.nan
    return picture, ev100


def label_of(sky: Sky) -> str:
    """One line under a picture: the sun, the climate, the luminance of the zenith."""
    climate = (sky.provenance.get("configuration") or {}).get("climate") or {}
    zenith = float(sky.luminance()[-1].mean())
    parts = [f"sun {sky.sun_elevation_deg:+.1f}°", climate.get("name"), f"zenith {zenith:.3g} cd/m^2"]
    return "   ".join(str(part) for part in parts if part)


def _write_label(pixels: np.ndarray, text: str) -> np.ndarray:
    """The picture with a line of text in its lower left corner, light on dark or dark on light."""
    from PIL import Image, ImageDraw, ImageFont

    size = max(10, pixels.shape[1] // 80)
    image = Image.fromarray(pixels)
    corner = pixels[-2 * size :, : 20 * size].mean()
    shade = 190 if corner < 110 else 40
    where = (size, pixels.shape[0] - 2 * size)
    ImageDraw.Draw(image).text(where, text, fill=(shade,) * 3, font=ImageFont.load_default(size))
    return np.asarray(image)


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
    view: str = DEFAULT_VIEW,
    width: int | None = None,
    exposure: float | Literal["auto"] = "auto",
    tone_mapping: str = colour.DEFAULT_TONE_MAPPING,
    observer: str = colour.DEFAULT_OBSERVER,
    label: bool = False,
) -> Path:
    """Write a picture of the sky as 8 bit sRGB PNG, whole or not at all; the provenance is in its text chunks.

    ``exposure`` is an exposure value at ISO 100 as on a camera (15: sunlit scene, -3: deep twilight), one step = a
    factor 2, or ``auto``; the value used is in the text chunk ``exposure_ev100``, so that the other pictures of a
    sequence can be given the same.  Tone mapping: ``colour.tone_map``.  ``label`` writes sun, climate and zenith
    luminance into the lower left corner (``label_of``).  Raises TwilightError for unknown options.
    """
    picture, ev100 = render_view(
        sky, view=view, width=width, exposure=exposure, tone_mapping=tone_mapping, observer=observer
    )
    facts = {
        "view": view,
        "exposure_ev100": f"{ev100:.6g}",
        "tone_mapping": tone_mapping,
        "colour": colour.colour_note(sky, observer),
    }
    return save_png(picture, path, sky, facts, label_of(sky) if label else "")


def save_png(picture: np.ndarray, path: str | Path, sky: Sky, facts: Mapping[str, str], label: str = "") -> Path:
    """Write display values 0..1 (H, W, 3), NaN for transparent, of a sky as 8 bit sRGB PNG, whole or not at all.

    facts: what else is said in the text chunks beside the sun and the provenance; label: into the lower left corner.
    """
    from PIL import Image
    from PIL.PngImagePlugin import PngInfo

    outside = np.isnan(picture[..., 0])
    pixels = _to_bytes(np.nan_to_num(picture))
    if label:
        pixels = _write_label(pixels, label)
    if outside.any():
        pixels = np.dstack([pixels, np.where(outside, 0, 255).astype(np.uint8)])
    info = PngInfo()
    info.add(b"sRGB", b"\x00")
    texts = {
        "Software": "twilight",
        "sun_elevation_deg": f"{sky.sun_elevation_deg:g}",
        **facts,
        **{name: str(value) for name, value in provenance_fields(sky.provenance).items()},
    }
    for name, value in texts.items():
        info.add_itxt(name, value, zip=len(value) > 1000)
    with whole_file(path) as temporary:
        Image.fromarray(pixels).save(temporary, format="PNG", pnginfo=info, optimize=False)
    return Path(path)


def write_pictures(rendered: Rendered, folder: Path, options: Options) -> list[Path]:
    """The first of the views as ``sky.png``, others as ``sky.VIEW.png``."""
    return [
        write_png(
            rendered.seen,
            folder / (f"sky.{view}.png" if i else "sky.png"),
            view=view,
            exposure=options.exposure,
            tone_mapping=options.tone_mapping,
            observer=options.observer,
            label=view == "wide",
        )
        for i, view in enumerate(options.views)
    ]
