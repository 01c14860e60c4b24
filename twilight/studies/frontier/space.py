"""What the search of a frontier varies: the settings of `zones` that decide error and run time."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from twilight.solvers.zones.settings import QUALITIES, ZonesSettings


@dataclass(frozen=True)
class Dimension:
    """An option of the settings and the range that is searched; whole numbers, or on a logarithmic scale."""

    key: str
    low: float
    high: float
    whole: bool = True


SPACE = (
    Dimension("degree", 8, 40),
    Dimension("max_degree", 12, 40),
    Dimension("polar_directions", 7, 24),
    Dimension("azimuth_directions", 6, 18),
    Dimension("early_orders", 1, 4),
    Dimension("late_degree", 3, 12),
    Dimension("late_polar_directions", 4, 12),
    Dimension("late_azimuth_directions", 4, 12),
    Dimension("polarisation_degree", 3, 20),
    Dimension("late_polarisation_degree", 2, 10),
    Dimension("altitude_density", 0.3, 2.0, whole=False),
    Dimension("zenith_density", 0.4, 2.0, whole=False),
    Dimension("step_density", 0.3, 1.5, whole=False),
    Dimension("first_order_step_density", 0.3, 3.0, whole=False),
    Dimension("line_of_sight_density", 0.3, 3.0, whole=False),
    Dimension("beam_density", 0.3, 1.5, whole=False),
    Dimension("tolerance", 3e-4, 3e-2, whole=False),
)
"""What is searched.  Other options say which physics is followed: they are the scene's own."""

NEIGHBOUR_STEP = 0.25
"""Standard deviation of the logarithm by which a neighbour's values differ."""
MOVED_FRACTION = 0.15
"""Fraction of the values that differ, beside one at least."""

Values = Mapping[str, float]
"""A point of the space: the value of each dimension."""


def values_of(settings: ZonesSettings) -> dict[str, float]:
    """The point of the space where settings stand."""
    return {d.key: getattr(settings, d.key) for d in SPACE}


def within(values: Values) -> dict[str, float]:
    """The point, moved into the ranges, rounded to three digits, with late counts at most the early ones."""
    out = {d.key: min(max(values[d.key], d.low), d.high) for d in SPACE}
    out = {d.key: round(out[d.key]) if d.whole else float(f"{out[d.key]:.3g}") for d in SPACE}
    for key in ("degree", "azimuth_directions", "polar_directions"):
        out["late_" + key] = min(out["late_" + key], out[key])
    out["max_degree"] = max(out["max_degree"], out["degree"])
    out["polarisation_degree"] = min(out["polarisation_degree"], out["degree"])
    most = min(out["late_degree"], out["polarisation_degree"])
    out["late_polarisation_degree"] = min(out["late_polarisation_degree"], most)
    return out


def settings_at(values: Values, physics: ZonesSettings) -> ZonesSettings:
    """The settings at a point, with everything that is not searched from `physics`."""
    return replace(physics, **within(values))  # type: ignore[arg-type]  # whole numbers where an option wants them


STARTS = {
    "brisk": replace(QUALITIES["draft"], early_orders=1, altitude_density=0.35),
    "between": replace(QUALITIES["draft"], degree=14, max_degree=24, altitude_density=0.6, zenith_density=0.85),
}
"""Settings that the search begins with beside the qualities: faster than `draft`, and between it and `standard`."""


def neighbour(values: Values, rng: np.random.Generator) -> dict[str, float]:
    """A point beside another one: some of its values changed by about NEIGHBOUR_STEP of themselves."""
    moved = rng.random(len(SPACE)) < MOVED_FRACTION
    moved[rng.integers(len(SPACE))] = True
    factors = np.where(moved, np.exp(NEIGHBOUR_STEP * rng.normal(size=len(SPACE))), 1.0)
    return within({d.key: values[d.key] * factor for d, factor in zip(SPACE, factors, strict=True)})
