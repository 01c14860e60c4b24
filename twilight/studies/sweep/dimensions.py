"""The dimensions of a sweep: which keys vary along each, and along which of them scenes share a solved field."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

from twilight import solvers
from twilight.base.errors import TwilightError
from twilight.config.scene import Config
from twilight.config.sun import SunElevations, SunInterval, SunTimes
from twilight.config.vary import DRAWING, DRAWS, LIST, Axis
from twilight.scene.suns import count_suns

SHAPE_KEYS = ("texture", "wavelengths")
"""Sections that set the shape of the dataset, which is one for all scenes."""
IDLE_KEYS = ("output", "name", "description", "version", "vary", *DRAWING, "solar_spectrum")
"""Keys that change nothing in the dataset."""
PLACE_KEYS = ("sun.latitude_deg", "sun.longitude_deg", "sun.distance_au")
"""What may vary beside several suns: their number stays."""
SEVERAL_SUNS = ("sun.elevations_deg", "sun.start", "sun.stop", "sun.step_minutes")
"""Keys that hold several suns of one scene."""


@dataclass(frozen=True)
class Dimension:
    """One dimension of the dataset.

    axis: the keys and values along it; None for the suns that the configuration's own `sun` section lists.
    shares_field: along it only suns and, for some solvers, observers change, for all of which one solved field serves.
    """

    name: str
    size: int
    axis: Axis | None
    shares_field: bool

    def point(self, index: int) -> dict[str, Any]:
        """Dotted keys and values at an index."""
        return {} if self.axis is None else self.axis.points[index]


def dimensions_of(axes: tuple[Axis, ...], first: Config, where: str) -> tuple[Dimension, ...]:
    """The dimensions of a series, in its order; those along which scenes share a field come last.

    first: the configuration of the first scene.
    Errors: TwilightError for keys that do not go with the configuration's own suns.
    """
    every_observer = serves_every_observer(axes, first)
    made = []
    for axis in axes:
        names = {LIST: "scene", DRAWS: "draw"}
        shared = all(shares_field_along(key, every_observer) for key in _keys([axis]))
        made.append(Dimension(names.get(axis.name) or variable_name(axis.name), len(axis.points), axis, shared))
    own = _own_suns(axes, first, where)
    if own is not None:
        made.append(own)
    return tuple(sorted(made, key=lambda dimension: dimension.shares_field))


def check_keys(axes: tuple[Axis, ...], where: str) -> None:
    """Raise TwilightError for keys that a dataset cannot have an axis of."""
    for key in _keys(axes):
        if key.split(".")[0] in SHAPE_KEYS:
            raise TwilightError(f"{where}: vary: {key} changes the shape of the dataset; make one sweep for each value")
        if key.split(".")[0] in IDLE_KEYS:
            raise TwilightError(f"{where}: vary: {key} changes nothing in the dataset, which holds radiance over F0")
        if key in SEVERAL_SUNS:
            raise TwilightError(f"{where}: vary: {key} holds several suns itself; vary sun.elevation_deg or sun.at")


def variable_name(key: str) -> str:
    """`aerosol_optical_depth_550nm` for `aerosol.optical_depth_550nm`."""
    return re.sub(r"\W", "_", key.removeprefix("climate."))


def shares_field_along(key: str, every_observer: bool) -> bool:
    """Whether one field serves all values of a key; every_observer: it serves all observers."""
    head = key.split(".")[0]
    return head == "sun" or (every_observer and head == "observer")


def serves_every_observer(axes: Iterable[Axis], first: Config) -> bool:
    """Whether the field of every solver of the sweep can be seen from any altitude."""
    names: set[Any] = {solver_of(first)}
    for axis in axes:
        for point in axis.points:
            section = point.get("solver")
            names.add(section.get("name", solvers.DEFAULT) if isinstance(section, Mapping) else None)
            names.add(point.get("solver.name"))
    return all(solvers.load(name).CAPABILITIES.every_observer for name in names if name in solvers.SOLVERS)


def solver_of(config: Config) -> str:
    """Name of the solver of a configuration."""
    return config.solver.get("name", solvers.DEFAULT)


def _own_suns(axes: tuple[Axis, ...], first: Config, where: str) -> Dimension | None:
    keys = [key for key in _keys(axes) if key.split(".")[0] == "sun"]
    if isinstance(first.sun, SunElevations):
        name, size = "sun_elevation_deg", len(first.sun.elevations_deg)
    elif isinstance(first.sun, SunInterval | SunTimes):
        name, size = "time", count_suns(first)
    else:
        return None
    for key in keys:
        if key not in PLACE_KEYS:
            raise TwilightError(
                f"{where}: vary: {key} does not go with the {size} suns of the section sun; beside them "
                f"{', '.join(PLACE_KEYS)} may vary"
            )
    return Dimension(name, size, None, True)


def _keys(axes: Iterable[Axis]) -> list[str]:
    return list(dict.fromkeys(key for axis in axes for point in axis.points for key in point))
