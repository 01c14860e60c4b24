"""Figures: a sheet of a series' pictures, and the profile of a climate."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from twilight.base.errors import TwilightError
from twilight.base.whole_files import whole_file

MAX_SHEET_PIXELS = 6000
"""Longest side of a contact sheet [pixels]."""


def contact_sheet(pictures: Sequence[tuple[str, Path]], path: Path) -> None:
    """One PNG with all pictures of a series in reading order, each with its label below.

    Pictures are scaled down together where the sheet would be wider or higher than 6000 pixels.
    Errors: TwilightError when a picture cannot be read or the sheet not be written.
    """
    from PIL import Image, ImageDraw, ImageFont  # start-up

    try:
        images = [Image.open(file).convert("RGB") for _, file in pictures]
    except OSError as error:
        raise TwilightError(f"{path}: the pictures of the series cannot be read: {error}") from None
    width, height = max(i.width for i in images), max(i.height for i in images)
    columns = max(1, round(math.sqrt(len(images) * height / width * 1.6)))
    rows = math.ceil(len(images) / columns)
    margin = 8
    size = max(12, width // 28)  # legible where the sheet is looked at whole
    line = round(1.5 * size)
    scale = min(
        1.0, MAX_SHEET_PIXELS / (columns * (width + margin)), MAX_SHEET_PIXELS / (rows * (height + line + margin))
    )
    width, height = max(1, int(width * scale)), max(1, int(height * scale))
    font = ImageFont.load_default(max(10, round(size * scale)))
    sheet = Image.new("RGB", (columns * (width + margin) + margin, rows * (height + line + margin) + margin), "black")
    draw = ImageDraw.Draw(sheet)
    for i, ((label, _), image) in enumerate(zip(pictures, images, strict=True)):
        x = margin + i % columns * (width + margin)
        y = margin + i // columns * (height + line + margin)
        sheet.paste(image.resize((width, height), Image.Resampling.LANCZOS), (x, y))
        draw.text((x, y + height + 2), label, fill="white", font=font)
    with whole_file(path) as temporary:
        sheet.save(temporary)


def profile_figure(
    title: str, altitude_km: np.ndarray, coefficients_per_km: Mapping[str, np.ndarray], wavelength_nm: float, path: Path
) -> None:
    """PNG of extinction coefficients [km^-1] against altitude [km] at one wavelength, one line for each part (Z,)."""
    import matplotlib  # start-up

    matplotlib.use("Agg")
    from matplotlib import pyplot

    figure, axes = pyplot.subplots(figsize=(6, 7), layout="constrained")
    values = np.concatenate([c[c > 0] for c in coefficients_per_km.values()] or [np.ones(1)])
    smallest, largest = float(values.min(initial=1.0)), float(values.max(initial=0.0)) or 1.0
    for name, coefficient in coefficients_per_km.items():
        axes.plot(np.where(coefficient > 0, coefficient, np.nan), altitude_km, label=name)
    axes.set(
        xscale="log",
        xlim=(max(1e-8 * largest, smallest / 3), 3 * largest),
        ylim=(0, altitude_km[-1]),
        xlabel=f"extinction at {wavelength_nm:g} nm [km$^{{-1}}$]",
        ylabel="altitude [km]",
        title=title,
    )
    axes.grid(alpha=0.3)
    axes.legend()
    try:
        with whole_file(path) as temporary:
            figure.savefig(temporary, dpi=120)
    finally:
        pyplot.close(figure)
