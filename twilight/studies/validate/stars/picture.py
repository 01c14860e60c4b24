"""The picture of a calibration: what was detected, which star it is, and what was not found.

The date of a picture by its planets: bright sources that no star accounts for, in the right places together.
"""

from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from pathlib import Path

import numpy as np

from twilight.base.errors import TwilightError
from twilight.base.whole_files import whole_file
from twilight.studies.validate.stars.calibrate import Calibration
from twilight.studies.validate.stars.coordinates import PLANETS, lifted, planet_tracks, precession

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


FAINTEST_MAG = 1.5
"""Magnitude of the faintest source that may be a planet; Mars at its faintest, and Mercury, are missed."""
STEP_DAYS = 2.0
"""Step of the dates that are tried [d]."""
LARGEST_SEPARATION_RAD = np.radians(1.0)
"""Largest angle between a planet and its source [rad]: stitched panoramas are bent by that much."""
LEAST_PLANETS = 2
"""Number of planets that a date needs."""
CONSPICUOUS = {"Venus": 10.0, "Jupiter": 15.0}
"""Elevations [deg] from which on a planet cannot be missed."""


@dataclass(frozen=True)
class Dating:
    """When the planets stood as in the picture: the best day, the first and last that fit nearly as well.

    planets: names with their distance [deg] from the source on the best day.  others: how many other dates, more than
    two months away, have as many planets in place.
    """

    best: datetime
    first: datetime
    last: datetime
    planets: dict[str, float]
    others: int


def date_by_planets(calibration: Calibration, first_year: float, last_year: float) -> Dating | None:
    """The date between two Julian years that puts most planets onto bright sources that are no star; None without any.

    At least two planets must fit, with nothing as conspicuous as Venus or Jupiter missing.
    Errors: TwilightError where the calibration was made with place and time.
    """
    air = calibration.fit.state.air
    if air is None:
        raise TwilightError("planets date pictures whose place and time are unknown; these are known")
    zenith = np.array(air.zenith)
    unmatched = np.ones(len(calibration.sources), dtype=bool)
    unmatched[calibration.fit.match.source] = False
    magnitude = calibration.magnitude_zero - 2.5 * np.log10(calibration.sources.flux)
    bright = np.flatnonzero(unmatched & (magnitude < FAINTEST_MAG))
    if len(bright) < LEAST_PLANETS:
        return None
    own = calibration.camera.directions_own(calibration.sources.xy[bright])
    lowered = 2.0 * own - lifted(own, zenith, air.pressure_hpa, air.temperature_c)  # refraction is small: undone so
    to_equator = precession(calibration.year)
    sources = lowered @ calibration.fit.state.matrix @ to_equator
    sources /= np.linalg.norm(sources, axis=1, keepdims=True)
    years, tracks = planet_tracks(first_year, last_year, STEP_DAYS)
    chord = np.linalg.norm(tracks[:, :, None, :] - sources[None, None], axis=-1).min(axis=-1)
    distance = 2.0 * np.arcsin(np.clip(0.5 * chord, 0.0, 1.0))  # (time, planet)
    there = distance < LARGEST_SEPARATION_RAD
    overhead = zenith @ calibration.fit.state.matrix @ to_equator
    for name, least_deg in CONSPICUOUS.items():
        i = list(PLANETS).index(name)
        high = tracks[:, i] @ overhead > np.sin(np.radians(least_deg))
        in_picture = calibration.camera.inside(calibration.fit.state.project(tracks[:, i] @ to_equator.T))
        there[high & ~there[:, i] & in_picture] = False
    count = there.sum(axis=1)
    most = int(count.max())
    if most < LEAST_PLANETS:
        return None
    spread = np.where(there, distance**2, 0.0).sum(axis=1) / np.maximum(count, 1)
    best = int(np.argmin(np.where(count == most, spread, np.inf)))
    as_good = (count == most) & (spread <= max(2.0 * spread[best], np.radians(0.3) ** 2))
    # the dates without a gap about the best
    worse = np.flatnonzero(~as_good)
    first = int(worse[worse < best].max(initial=-1)) + 1
    last = int(worse[worse > best].min(initial=len(years))) - 1
    elsewhere = np.flatnonzero((count == most) & (np.abs(years - years[best]) > 1.0 / 6.0))
    others = 0 if not len(elsewhere) else 1 + int((np.diff(elsewhere) > 30).sum())
    planets = {n: float(np.degrees(distance[best, i])) for i, n in enumerate(PLANETS) if there[best, i]}
    return Dating(_moment(years[best]), _moment(years[first]), _moment(years[last]), planets, others)


def _moment(year: float) -> datetime:
    return datetime(2000, 1, 1, 12, tzinfo=UTC) + timedelta(days=(float(year) - 2000.0) * 365.25)
