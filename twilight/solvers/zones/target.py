"""Settings for a target error: the quality that has it in air of this kind, known before anything is solved.

The errors of the qualities were measured beside Monte-Carlo references in thirteen climates
(`benchmarks/zones_error.py`).  They depend on how low the sun is and on what kind of particles there are, which is
known beforehand: fine ones, coarse ones (dust and sea salt, whose phase functions need the degree to grow), or some
high up.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from twilight.atmosphere.medium import Medium
from twilight.solvers.zones.directions import ALOFT_KM, LEAST_ALOFT_DEPTH, degree_needed
from twilight.solvers.zones.settings import QUALITIES, ZonesSettings


class Errors(NamedTuple):
    """Largest errors [%] that 95 % of the radiances stay within, over the climates of a kind.

    day: sun above LAST_DAY_DEG; twilight: above LAST_TWILIGHT_DEG; deep: below
    """

    day: float
    twilight: float
    deep: float


LAST_DAY_DEG = -7.5
"""Sun elevation [deg] down to which the errors of +30 to -6 deg hold."""
LAST_TWILIGHT_DEG = -13.0
"""Sun elevation [deg] down to which those of -9 and -12 deg hold; below, that of -18 deg."""
SAFETY_FACTORS = {"fine": 1.45, "coarse": 1.45, "aloft": 1.9}
"""Factor of safety for air that is none of the climates, by its kind: each climate in turn left out of the table, its
errors stay within so many times the largest of the others of its kind (benchmarks/target_error.csv).  High up there are
but two, far apart."""
MEASURED_ERRORS: dict[str, dict[str, Errors]] = {
    "draft": {"fine": Errors(1.4, 2.0, 2.1), "coarse": Errors(1.7, 2.4, 3.1), "aloft": Errors(3.3, 4.5, 3.7)},
    "standard": {"fine": Errors(0.9, 1.6, 1.8), "coarse": Errors(1.2, 1.5, 1.6), "aloft": Errors(1.4, 1.5, 3.6)},
    "reference": {"fine": Errors(0.4, 0.8, 0.2)},
}
"""By quality, the cheapest first, and kind of air (benchmarks/zones_error.csv; `reference`: continental air alone)."""


NOT_OF_QUALITY = (
    *("max_orders", "polarisation", "refraction", "bent_lines_of_sight", "bent_paths"),
    *("target_error", "spectral_interpolation", "field_file"),
)
"""Settings that stay as they are where a target error chooses the quality: physics, the target and the file."""


def kind_of(medium: Medium) -> str:
    """`aloft` where there are particles high up, `coarse` beside dust or sea salt, else `fine`; one for a spectrum."""
    medium = medium.at_grid_wavelengths or medium
    scattering = medium.aerosol_extinction_per_km * medium.aerosol_single_scattering_albedo
    z = medium.altitude_km
    high = np.where(z[:, None] >= ALOFT_KM, scattering, 0.0)
    if np.trapezoid(high, z, axis=0).max() > LEAST_ALOFT_DEPTH:
        return "aloft"
    standard = QUALITIES["standard"]
    return "coarse" if degree_needed(standard, medium) > standard.degree else "fine"


def expected_error(quality: str, medium: Medium, sun_elevations_deg: Sequence[float] | None) -> float:
    """Fraction that 95 % of errors are expected to stay within at a quality, for the lowest of the suns; None: any.

    Infinite where the quality was not measured in such air.
    """
    kind = kind_of(medium)
    errors = MEASURED_ERRORS[quality].get(kind)
    if errors is None:
        return math.inf
    lowest = -90.0 if sun_elevations_deg is None else min(sun_elevations_deg)
    ranges = 1 if lowest >= LAST_DAY_DEG else 2 if lowest >= LAST_TWILIGHT_DEG else 3
    return 0.01 * SAFETY_FACTORS[kind] * max(errors[:ranges])


def quality_for(
    settings: ZonesSettings, medium: Medium, sun_elevations_deg: Sequence[float] | None
) -> tuple[str, float]:
    """The cheapest quality that has the target error, and the error expected of it; the best where none has."""
    found = [(name, expected_error(name, medium, sun_elevations_deg)) for name in MEASURED_ERRORS]
    return next((row for row in found if row[1] <= settings.target_error), found[-1])


def at_quality(settings: ZonesSettings, name: str) -> ZonesSettings:
    """The settings with the grids of a quality; those NOT_OF_QUALITY stay as they are."""
    return replace(QUALITIES[name], **{key: getattr(settings, key) for key in NOT_OF_QUALITY})


def settings_to_solve(
    medium: Medium, settings: ZonesSettings, sun_elevations_deg: Sequence[float] | None
) -> tuple[ZonesSettings, float | None]:
    """The settings that a field is solved with: those asked for, or where they have a target error those of the quality
    that reaches it, with the fraction that 95 % of its errors are expected to stay within."""
    if not settings.target_error:
        return settings, None
    name, expected = quality_for(settings, medium, sun_elevations_deg)
    return at_quality(settings, name), expected
