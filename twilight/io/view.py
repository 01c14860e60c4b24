"""``sky.view.png`` and ``sky.view.exr``: a picture of the observer's view, with the ground and space in it."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from twilight import colour
from twilight.io.exr import write_picture_exr
from twilight.io.picture import save_png
from twilight.io.rendered import Options, Rendered, Seen
from twilight.tone import Light, Shot, film_of

WHITE_FROM = 50.0
"""Exposed luminance (1: white) from which the sun's disc is shown white."""
DARKEST_SHARE = 1e-3
"""Pixels darker than this share of the brightest 0.5 % count as space and not for the exposure."""


def view_exposure_ev100(seen: Seen, luminance: np.ndarray) -> float:
    """The exposure value of ``exposure="auto"`` for a view: of what is lit in it, without the sun's disc."""
    keep = np.isfinite(luminance) & (luminance > 0.0)
    if seen.sun is not None:
        keep &= seen.sun == 0.0
    light = luminance[keep]
    if light.size:
        light = light[light >= DARKEST_SHARE * np.quantile(light, 0.995)]
    return colour.auto_exposure_ev100(light)


def burnt_out(picture: np.ndarray, share: np.ndarray, luminance: np.ndarray, ev100: float) -> np.ndarray:
    """The picture with a white sun where its disc is far brighter than white: tone curves keep its colour for ever."""
    middle = float(colour.expose(np.ones(1), ev100)[0]) * luminance[share >= 1.0]
    if not middle.size or np.median(middle) < WHITE_FROM:
        return picture
    return picture + share[..., None] * (1.0 - picture)


def write_view(rendered: Rendered, folder: Path, options: Options) -> list[Path]:
    """``sky.view.png``, tone mapped, and ``sky.view.exr``, linear Rec. 709 in cd/m^2 (alpha 0 outside the view)."""
    seen = rendered.view
    assert seen is not None
    sky, film = rendered.sky, film_of(options.tone_mapping, options.observer, options.tone_settings)
    factor, inside = np.nan_to_num(seen.radiance), np.isfinite(seen.radiance[..., 0])
    channels = film.see(factor, sky.wavelength_nm, Light(sky.solar_spectrum, sky.distance_au))
    luminance = np.where(inside, channels[..., 1], np.nan)
    ev100 = view_exposure_ev100(seen, luminance) if options.exposure == "auto" else float(options.exposure)
    picture, found = film.develop(channels, Shot(ev100, seen.pitch_deg))
    if seen.sun is not None:
        picture = burnt_out(picture, seen.sun, channels[..., 1], ev100)
    linear = colour.sky_to_linear_rgb(sky, factor, options.observer)
    facts = {"view": seen.kind, "exposure_ev100": f"{ev100:.6g}", "tone_mapping": options.tone_mapping}
    facts.update({name: value if isinstance(value, str) else f"{value:.6g}" for name, value in found.items()})
    return [
        save_png(np.where(inside[..., None], picture, np.nan), folder / "sky.view.png", sky, facts),
        write_picture_exr(linear, inside, folder / "sky.view.exr", sky, options.observer),
    ]
