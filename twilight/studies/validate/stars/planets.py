"""The date of a picture by its planets: bright sources that no star accounts for, in the right places together."""

from __future__ import annotations

from dataclasses import dataclass
from datetime import UTC, datetime, timedelta

import numpy as np

from twilight.base.errors import TwilightError
from twilight.studies.validate.stars.calibrate import Calibration
from twilight.studies.validate.stars.coordinates import PLANETS, lifted, planet_tracks, precession

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
