"""``sky.view.png`` and ``sky.view.exr``: a picture of the observer's view, with the ground and space in it."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np

from twilight.io.exr import write_picture_exr
from twilight.io.picture import save_pixels, to_bytes
from twilight.io.rendered import Options, Rendered, ViewPixels, ViewSource
from twilight.numerics import spectrum
from twilight.sky import colour
from twilight.sky.tone import CurveTone, Light, Shot, Tone, tone_of

DARKEST_FRACTION = 1e-3
"""Pixels darker than this fraction of the brightest 0.5 % count as space and not for the exposure."""
PIXELS_AT_ONCE = 1 << 18
METERED_PIXELS = 1 << 21
"""A larger picture is metered on some of its rows and columns, evenly spaced."""


@dataclass(frozen=True)
class ViewPicture:
    """pixels (H, W, 3): 8 bit sRGB, 4 with alpha where some lie outside the view; ev100: exposure value at ISO 100;
    facts: what the tone set or found."""

    pixels: np.ndarray
    ev100: float
    facts: dict[str, float | str]


def _parts(view: ViewSource) -> Iterator[tuple[slice, ViewPixels]]:
    """The picture by rows, as many as are worked on at once."""
    height, width = view.shape
    step = max(1, PIXELS_AT_ONCE // width)
    for first in range(0, height, step):
        stop = min(first + step, height)
        yield slice(first, stop), view.rows(first, stop)


def _metered(view: ViewSource) -> Iterator[ViewPixels]:
    """The picture, or evenly spaced pixels of a large one."""
    height, width = view.shape
    step = int(np.ceil(np.sqrt(height * width / METERED_PIXELS)))
    if step == 1:
        for _, part in _parts(view):
            yield part
        return
    for row in range(step // 2, height, step):
        yield view.rows(row, row + 1).columns(step)


def view_exposure_ev100(luminance: np.ndarray, highlights_over_mean: float = colour.HIGHLIGHTS_OVER_MEAN) -> float:
    """The exposure value of ``exposure="auto"`` for a view, of the luminances [cd m^-2] of pixels without the disc."""
    light = luminance[np.isfinite(luminance) & (luminance > 0.0)]
    if light.size:
        light = light[light >= DARKEST_FRACTION * np.quantile(light, 0.995)]
    return colour.auto_exposure_ev100(light, None, highlights_over_mean)


def picture(
    seen: ViewSource,
    wavelength_nm: np.ndarray,
    light: Light,
    tone: Tone,
    exposure: float | Literal["auto"] = "auto",
) -> ViewPicture:
    """Paint a view: as a tone shows it at an exposure value, or at that of its own light without the sun's disc.

    A tone that changes pixel by pixel (`tone.CurveTone`) is developed by rows, in the memory of the 8 bit picture;
    others need the whole one.
    """

    def channels_of(part: ViewPixels) -> np.ndarray:
        return tone.see(np.nan_to_num(part.radiance), wavelength_nm, light)

    ev100 = _meter(seen, channels_of, tone) if exposure == "auto" else float(exposure)
    height, width = seen.shape
    pixels = np.empty((height, width, 4), np.uint8)
    facts: dict[str, float | str] = {}
    shot = Shot(ev100, seen.pitch_deg)
    if isinstance(tone, CurveTone):
        for rows, part in _parts(seen):
            display, facts = tone.develop(channels_of(part), shot)
            pixels[rows] = _eight_bit(display, part, rows.start)
    else:
        whole = seen.rows(0, height)
        display, facts = tone.develop(channels_of(whole), shot)
        pixels[:] = _eight_bit(display, whole, 0)
    opaque = bool((pixels[..., 3] == 255).all())
    return ViewPicture(np.ascontiguousarray(pixels[..., :3]) if opaque else pixels, ev100, facts)


def _meter(view: ViewSource, channels_of: Callable[[ViewPixels], np.ndarray], tone: Tone) -> float:
    luminances = []
    for part in _metered(view):
        keep = np.isfinite(part.radiance[..., 0])
        if part.sun is not None:
            keep &= part.sun == 0.0
        luminances.append(channels_of(part)[..., 1][keep])
    return view_exposure_ev100(np.concatenate(luminances), tone.highlights_over_mean)


def _eight_bit(display: np.ndarray, part: ViewPixels, first_row: int) -> np.ndarray:
    """Rows of a picture as 8 bits with alpha, 0 outside the view."""
    alpha = np.where(np.isfinite(part.radiance[..., 0]), 255, 0).astype(np.uint8)
    display = np.where(alpha[..., None] > 0, display, np.nan)
    return np.dstack([to_bytes(display, first_row), alpha])


def write_view(rendered: Rendered, folder: Path, options: Options) -> list[Path]:
    """``sky.view.png``, tone mapped, and ``sky.view.exr``, linear Rec. 709 in cd/m^2 (alpha 0 outside the view)."""
    view = rendered.view
    assert view is not None
    sky, tone = rendered.sky, tone_of(options.tone_mapping, options.observer, options.tone_settings)
    developed = picture(view, sky.wavelength_nm, Light(sky.solar_spectrum, sky.distance_au), tone, options.exposure)
    facts = {
        "view": view.kind,
        "exposure_ev100": developed.ev100,
        "tone_mapping": options.tone_mapping,
        **developed.facts,
    }
    png = save_pixels(developed.pixels, folder / "sky.view.png", sky, facts)
    del developed
    planes = np.zeros((4, *view.shape), np.float32)
    for rows, part in _parts(view):
        inside = np.isfinite(part.radiance[..., 0])
        linear = colour.sky_to_linear_rgb(sky, np.nan_to_num(part.radiance), options.observer)
        planes[:3, rows] = np.moveaxis(np.where(inside[..., None], linear, 0.0), -1, 0)
        planes[:3, rows] /= spectrum.LUMINOUS_EFFICACY_LM_PER_W
        planes[3, rows] = inside
    return [png, write_picture_exr(planes, folder / "sky.view.exr", sky, options.observer)]
