"""What the search of a frontier varies: the settings of a solver that decide error and run time.

`ZONES` is that of `zones`; another solver's is a `Space` of its own.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from twilight.solvers.zones.settings import QUALITIES

NEIGHBOUR_STEP = 0.25
"""Standard deviation of the logarithm by which a neighbour's values differ."""
MOVED_FRACTION = 0.15
"""Fraction of the values that differ, beside one at least."""

Values = Mapping[str, float]
"""A point of the space: the value of each dimension."""


@dataclass(frozen=True)
class SearchedOption:
    """An option of the settings and the range that is searched; whole numbers, or on a logarithmic scale.

    choices: the numbers that the solver takes, in ascending sequence; none given: all between low and high
    """

    key: str
    low: float
    high: float
    whole: bool = True
    choices: tuple[float, ...] = ()

    @property
    def switch(self) -> bool:
        """Whether it is on or off."""
        return self.whole and (self.low, self.high) == (0, 1)

    def within(self, value: float) -> float:
        """The nearest value that is allowed; three digits where it is not whole."""
        value = min(max(value, self.low), self.high)
        if self.choices:
            value = min(self.choices, key=lambda choice: abs(choice - value))
        return round(value) if self.whole else float(f"{value:.3g}")


def _as_they_are(values: dict[str, float]) -> dict[str, float]:
    return values


@dataclass(frozen=True)
class Space:
    """What is searched of one solver.  Other options say which physics is followed: they are the scene's own.

    starts: settings that the search begins with beside the qualities
    settle: moves values that the solver refuses beside each other
    """

    dimensions: tuple[SearchedOption, ...]
    starts: Mapping[str, Any]
    settle: Callable[[dict[str, float]], dict[str, float]] = _as_they_are

    def values_of(self, settings: Any) -> dict[str, float]:
        """The point of the space where settings stand."""
        return {d.key: getattr(settings, d.key) for d in self.dimensions}

    def within(self, values: Values) -> dict[str, float]:
        """The point, moved to what is allowed."""
        return self.settle({d.key: d.within(values[d.key]) for d in self.dimensions})

    def settings_at(self, values: Values, physics: Any) -> Any:
        """The settings at a point, with everything that is not searched from `physics`."""
        found = self.within(values)
        return replace(physics, **{d.key: bool(found[d.key]) if d.switch else found[d.key] for d in self.dimensions})

    def neighbour(self, values: Values, rng: np.random.Generator) -> dict[str, float]:
        """A point beside another one: some of its values changed by about NEIGHBOUR_STEP of themselves."""
        count = len(self.dimensions)
        moved = rng.random(count) < MOVED_FRACTION
        moved[rng.integers(count)] = True
        factors = np.where(moved, np.exp(NEIGHBOUR_STEP * rng.normal(size=count)), 1.0)
        changed = {
            d.key: 1 - values[d.key] if d.switch and moves else values[d.key] * factor
            for d, moves, factor in zip(self.dimensions, moved, factors, strict=True)
        }
        return self.within(changed)


def _late_counts(values: dict[str, float]) -> dict[str, float]:
    """With late counts at most the early ones, and polarisation followed at most as far as radiance."""
    out = dict(values)
    for key in ("degree", "azimuth_directions", "polar_directions"):
        out["late_" + key] = min(out["late_" + key], out[key])
    out["max_degree"] = max(out["max_degree"], out["degree"])
    out["polarisation_degree"] = min(out["polarisation_degree"], out["degree"])
    most = min(out["late_degree"], out["polarisation_degree"])
    out["late_polarisation_degree"] = min(out["late_polarisation_degree"], most)
    return out


ZONES = Space(
    dimensions=(
        SearchedOption("degree", 8, 40),
        SearchedOption("max_degree", 12, 40),
        SearchedOption("polar_directions", 7, 24),
        SearchedOption("azimuth_directions", 6, 18),
        SearchedOption("early_orders", 1, 4),
        SearchedOption("late_degree", 3, 12),
        SearchedOption("late_polar_directions", 4, 12),
        SearchedOption("late_azimuth_directions", 4, 12),
        SearchedOption("polarisation_degree", 3, 20),
        SearchedOption("late_polarisation_degree", 2, 10),
        SearchedOption("altitude_density", 0.3, 2.0, whole=False),
        SearchedOption("zenith_density", 0.4, 2.0, whole=False),
        SearchedOption("step_density", 0.3, 1.5, whole=False),
        SearchedOption("first_order_step_density", 0.3, 3.0, whole=False),
        SearchedOption("line_of_sight_density", 0.3, 3.0, whole=False),
        SearchedOption("beam_density", 0.3, 1.5, whole=False),
        SearchedOption("tolerance", 3e-4, 3e-2, whole=False),
    ),
    starts={
        "brisk": replace(QUALITIES["draft"], early_orders=1, altitude_density=0.35),
        "between": replace(QUALITIES["draft"], degree=14, max_degree=24, altitude_density=0.6, zenith_density=0.85),
    },
    settle=_late_counts,
)
"""Of `zones`; the starts are faster than `draft`, and between it and `standard`."""
