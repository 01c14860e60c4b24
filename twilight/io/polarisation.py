"""``sky.polarisation.png``: degree and angle of linear polarisation of the whole sky."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from twilight.io.picture import save_pixels, view_directions
from twilight.io.rendered import Options, Rendered
from twilight.sky.sky import Sky

WIDTH = 400
"""Width and height of a map of the whole sky [pixel]; beside it BAR_WIDTH of the scale, its numbers, and MARGIN."""
BAR_WIDTH = 14
"""Width of the colour bars [pixel]."""
NUMBERS_WIDTH = 40
"""Width of the numbers beside the bars [pixel]."""
MARGIN = 12
"""Between the parts of the picture [pixel]."""
TITLE_HEIGHT = 24
"""Height of the titles [pixel]."""
FONT_SIZE = 13
"""Height of titles and numbers [pixel]."""
WAVELENGTH_NM = 550.0
"""Wavelength that is drawn: the sky's nearest to it [nm]."""
VIRIDIS = (
    "440154 48186a 472d7b 424086 3b528b 33638d 2c728e 26828e 21918c "
    "1fa088 28ae80 3fbc73 5ec962 84d44b addc30 d8e219 fde725"
)
TWILIGHT = (
    "e2d9e2 c4ced4 95b5c7 7297c1 6276ba 5e51ad 592a8f 45135c 2f1436 "
    "4a1342 741e4f 983550 b25652 c27c63 cca389 d8c7be e2d9e2"
)
"""Matplotlib's colour maps of these names (public domain, CC0) at 17 places, between which straight lines are within 6
of 255 of them: one for quantities that grow, and one for angles, whose ends are one."""


def polarisation_maps(sky: Sky, width: int = WIDTH) -> tuple[np.ndarray, np.ndarray, float]:
    """Degree and angle [deg] of linear polarisation as fisheye pictures (``io.picture.view_directions``), (width,
    width) each, NaN outside the circle; and their wavelength [nm], the sky's nearest to 550.

    Errors: TwilightError for a sky without Stokes parameters.
    """
    elevation, azimuth = view_directions("fisheye", width)
    w = int(np.argmin(np.abs(sky.wavelength_nm - WAVELENGTH_NM)))
    above = elevation >= 0.0
    q, u = np.moveaxis(sky.sample_fractional_stokes(elevation[above], azimuth[above])[..., w], -1, 0)
    degree, angle = np.full(above.shape, np.nan), np.full(above.shape, np.nan)
    degree[above], angle[above] = np.hypot(q, u), 0.5 * np.degrees(np.arctan2(u, q))
    return degree, angle, float(sky.wavelength_nm[w])


def write_polarisation_png(sky: Sky, path: str | Path) -> Path:
    """Draw the whole sky, the zenith in the middle and the sun's azimuth at the bottom: degree, and angle of vibration.

    The file is written whole or not at all.  Errors: TwilightError for a sky without Stokes parameters.
    """
    from PIL import Image, ImageDraw, ImageFont  # start-up

    degree, angle, wavelength = polarisation_maps(sky)
    shown = (
        (degree, VIRIDIS, np.linspace(0.0, 1.0, 6), "degree of linear polarisation"),
        (angle, TWILIGHT, np.linspace(-90.0, 90.0, 7), "angle of vibration from the vertical, clockwise [deg]"),
    )
    panel = WIDTH + BAR_WIDTH + NUMBERS_WIDTH + 2 * MARGIN
    image = Image.new("RGB", (MARGIN + 2 * panel, 2 * TITLE_HEIGHT + WIDTH + 2 * MARGIN), "white")
    draw, font = ImageDraw.Draw(image), ImageFont.load_default(FONT_SIZE)
    above = f"sun at {sky.sun_elevation_deg:g} deg (its azimuth below), {wavelength:g} nm"
    draw.text((0.5 * image.width, MARGIN), above, fill="black", font=font, anchor="ma")
    top = MARGIN + 2 * TITLE_HEIGHT
    for i, (values, colours, ticks, title) in enumerate(shown):
        left = MARGIN + i * panel
        draw.text((left + 0.5 * WIDTH, MARGIN + TITLE_HEIGHT), title, fill="black", font=font, anchor="ma")
        fraction = (values - ticks[0]) / (ticks[-1] - ticks[0])
        image.paste(Image.fromarray(_coloured(fraction, colours)), (left, top))
        bar = np.broadcast_to(1.0 - (np.arange(WIDTH)[:, None] + 0.5) / WIDTH, (WIDTH, BAR_WIDTH))
        right = left + WIDTH + MARGIN
        image.paste(Image.fromarray(_coloured(bar, colours)), (right, top))
        for k, tick in enumerate(ticks):
            y = top + round((WIDTH - 1) * (1.0 - k / (ticks.size - 1)))
            draw.line((right + BAR_WIDTH, y, right + BAR_WIDTH + 3, y), fill="black")
            draw.text((right + BAR_WIDTH + 6, y), f"{tick:g}", fill="black", font=font, anchor="lm")
    return save_pixels(np.asarray(image), path, sky, {"wavelength_nm": wavelength})


def _coloured(fraction: np.ndarray, colours: str) -> np.ndarray:
    """sRGB (H, W, 3), 8 bit, of fractions 0..1 (H, W) of a colour map; white where there is none."""
    knots = np.array([[int(colour[i : i + 2], 16) for i in (0, 2, 4)] for colour in colours.split()])
    places = np.linspace(0.0, 1.0, len(knots))
    rgb = np.stack([np.interp(np.nan_to_num(fraction), places, knots[:, c]) for c in range(3)], axis=-1)
    return np.where(np.isnan(fraction)[..., None], 255, np.round(rgb)).astype(np.uint8)


def write_polarisation(rendered: Rendered, folder: Path, options: Options) -> list[Path]:
    """``sky.polarisation.png``."""
    return [write_polarisation_png(rendered.sky, folder / "sky.polarisation.png")]
