"""The picture of a calibration: what was detected, which star it is, and what was not found."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from twilight.base.whole_files import whole_file
from twilight.studies.validate.stars.calibrate import Calibration

SMALLEST_WIDTH = 2000
"""Pixels across; narrower pictures are enlarged, so that labels can be read."""
LARGEST_WIDTH = 4000
"""Pixels across; wider pictures are reduced."""
LABELS = 120
"""Stars that are named."""
MISSING_MAG_MARGIN = 0.7
"""Stars this much brighter than the faintest tenth of those matched are marked where they were not found."""
UNMATCHED = (255, 150, 0)
"""Colour of sources that are no star: orange."""
MATCHED = (70, 255, 90)
"""Colour of sources that are a star: green."""
MISSING = (255, 70, 90)
"""Colour of stars that were not found: red."""
TEXT = (255, 255, 120)
"""Colour of names."""


def draw(picture: np.ndarray, calibration: Calibration, path: Path) -> None:
    """Write a PNG of the picture, (height, width[, 3]) linear: orange circles around sources that are no star, green
    ones around those that are, with names or Hipparcos numbers of the brightest, red crosses at bright stars not found.

    Errors: TwilightError where it cannot be written.
    """
    from PIL import Image, ImageDraw, ImageFont  # start-up

    camera, fit = calibration.camera, calibration.fit
    width = camera.image.width_px
    scale = float(np.clip(width, SMALLEST_WIDTH, LARGEST_WIDTH)) / width
    size = (round(width * scale), round(camera.image.height_px * scale))
    image = Image.fromarray(_tones(picture)).resize(size, Image.Resampling.LANCZOS).convert("RGB")
    pen = ImageDraw.Draw(image)
    font = ImageFont.load_default(12)

    def circle(at: np.ndarray, radius: float, colour: tuple[int, int, int]) -> None:
        x, y = at * scale
        pen.ellipse([x - radius, y - radius, x + radius, y + radius], outline=colour)

    matched = np.zeros(len(calibration.sources), dtype=bool)
    matched[fit.match.source] = True
    for at in calibration.sources.xy[~matched]:
        circle(at, 4.0, UNMATCHED)
    for at in calibration.sources.xy[matched]:
        circle(at, 7.0, MATCHED)
    stars = calibration.stars
    predicted = fit.state.project(stars.directions)
    limit = np.quantile(stars.magnitude[fit.match.star], 0.9) - MISSING_MAG_MARGIN
    missing = calibration.visible & (stars.magnitude < limit)
    missing[fit.match.star] = False
    crossed = np.flatnonzero(missing)
    for at in predicted[crossed]:
        x, y = at * scale
        pen.line([x - 5, y - 5, x + 5, y + 5], fill=MISSING)
        pen.line([x - 5, y + 5, x + 5, y - 5], fill=MISSING)
    named = np.sort(np.concatenate([fit.match.star, crossed]))[:LABELS]
    taken: list[tuple[float, float, float, float]] = []
    for i in named:  # the brightest first; a name that would cover another is left out
        x, y = predicted[i] * scale
        place, name = (x + 9, y - 7), stars.label(int(i))
        box = pen.textbbox(place, name, font=font)
        if any(box[0] < b[2] and b[0] < box[2] and box[1] < b[3] and b[1] < box[3] for b in taken):
            continue
        taken.append(box)
        colour = MISSING if missing[i] else TEXT
        pen.text(place, name, fill=colour, font=font, stroke_width=1, stroke_fill=(0, 0, 0))
    with whole_file(path) as temporary:
        image.save(temporary, format="PNG")


def _tones(picture: np.ndarray) -> np.ndarray:
    """The logarithm of the light between its 1st and 99.95th percentile, as 8 bit grey (height, width)."""
    light = picture.mean(axis=-1) if picture.ndim == 3 else picture
    light = np.nan_to_num(np.asarray(light, dtype=np.float32), posinf=0.0, neginf=0.0)
    smallest = np.percentile(light[light > 0], 1.0) if (light > 0).any() else 1.0
    tones = np.log(np.maximum(light, smallest))
    low, high = np.percentile(tones, [1.0, 99.95])
    return np.round(np.clip((tones - low) / max(high - low, 1e-6), 0.0, 1.0) * 255).astype(np.uint8)
