"""The dimensions of a sweep: which keys vary along each, what a dataset calls them, and where scenes share a field."""

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

from twilight import solvers
from twilight.base.errors import TwilightError
from twilight.config.climate import Climate
from twilight.config.scene import Config
from twilight.config.sun import SunElevations, SunInterval, SunTimes
from twilight.config.vary import DRAWS, LIST, Axis, Drawing
from twilight.io.labels import LABELS, attributes
from twilight.scene.suns import count_suns

SHAPE_KEYS = ("texture", "wavelengths")
"""Sections that set the shape of the dataset, which is one for all scenes."""
IDLE_KEYS = ("output", "name", "description", "version", "vary", *Drawing.model_fields, "solar_spectrum")
"""Keys that change nothing in the dataset."""
PLACE_KEYS = ("sun.latitude_deg", "sun.longitude_deg", "sun.distance_au")
"""What may vary beside several suns: their number stays."""
SEVERAL_SUNS = ("sun.elevations_deg", "sun.start", "sun.stop", "sun.step_minutes")
"""Keys that hold several suns of one scene."""


@dataclass(frozen=True)
class Dimension:
    """One dimension of the dataset.

    points: dotted keys and values of each index, empty along the suns that the configuration's own `sun` section lists
    (`own_suns`); labels: of each index, for messages; held_out: draws for validation.
    shares_field: one solved field serves all indices, for only suns change and, for some solvers, observers.
    """

    name: str
    points: tuple[dict[str, Any], ...]
    labels: tuple[str, ...]
    shares_field: bool
    own_suns: bool = False
    held_out: frozenset[int] = frozenset()

    @property
    def size(self) -> int:
        """How many indices it has."""
        return len(self.points)


def dimensions_of(axes: tuple[Axis, ...], first: Config, where: str) -> tuple[Dimension, ...]:
    """The dimensions of a series, in its order; those along which scenes share a field come last.

    first: the configuration of the first scene.
    Errors: TwilightError for keys that do not go with the configuration's own suns.
    """
    every_observer = serves_every_observer(axes, first)
    dimensions = []
    for axis in axes:
        name = {LIST: "scene", DRAWS: "draw"}.get(axis.name) or variable_name(axis.name)
        shared = all(shares_field_along(key, every_observer) for key in axis.points[0])
        dimensions.append(Dimension(name, axis.points, axis.labels, shared, held_out=axis.held_out))
    if isinstance(first.sun, SunElevations | SunInterval | SunTimes):
        size = count_suns(first)
        for key in _keys(axes):
            if key.startswith("sun.") and key not in PLACE_KEYS:
                raise TwilightError(
                    f"{where}: vary: {key} does not go with the {size} suns of the section sun; beside them "
                    f"{', '.join(PLACE_KEYS)} may vary"
                )
        name = "sun_elevation_deg" if isinstance(first.sun, SunElevations) else "time"
        dimensions.append(Dimension(name, ({},) * size, (), True, own_suns=True))
    return tuple(sorted(dimensions, key=lambda dimension: dimension.shares_field))


def check_keys(axes: tuple[Axis, ...], where: str) -> None:
    """Raise TwilightError for keys that a dataset cannot have an axis of."""
    for key in _keys(axes):
        if section_of(key) in SHAPE_KEYS:
            raise TwilightError(f"{where}: vary: {key} changes the shape of the dataset; make one sweep for each value")
        if section_of(key) in IDLE_KEYS:
            raise TwilightError(f"{where}: vary: {key} changes nothing in the dataset, which holds radiance over F0")
        if key in SEVERAL_SUNS:
            raise TwilightError(f"{where}: vary: {key} holds several suns itself; vary sun.elevation_deg or sun.at")


def _keys(axes: Iterable[Axis]) -> list[str]:
    return [key for axis in axes for key in axis.points[0]]


def section_of(key: str) -> str:
    """The outermost section of a dotted key."""
    return key.partition(".")[0]


def shares_field_along(key: str, every_observer: bool) -> bool:
    """Whether one field serves all values of a key; every_observer: it serves all observers."""
    return section_of(key) == "sun" or (every_observer and section_of(key) == "observer")


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


# Names and labels -----------------------------------------------------------------------------------------------


def variable_name(key: str) -> str:
    """`aerosol_optical_depth_550nm` for `aerosol.optical_depth_550nm`."""
    return re.sub(r"\W", "_", key.removeprefix("climate."))


UNITS = {"deg": "degree", "au": "astronomical_unit", "cm^-3": "cm-3", "m/s": "m s-1"}
"""Units of keys as UDUNITS spells them."""


def key_attributes(key: str) -> dict[str, str]:
    """CF attributes of a dotted key: long_name, units and, as the comment, its line of help; and the key itself."""
    field = _field(Config | Climate, key.removeprefix("climate.").split("."))
    extra = {} if field is None else field.json_schema_extra
    unit = str(extra.get("unit", "")) if isinstance(extra, dict) else ""
    help_text = (field.description or "") if field is not None else ""
    cf = {"long_name": label_of(key), "units": UNITS.get(unit, unit), "comment": help_text, "key": key}
    if variable_name(key) in LABELS:
        cf |= attributes(variable_name(key))
    return {name: value for name, value in cf.items() if value}


def _field(annotation: Any, parts: list[str]) -> Any:
    """The pydantic field of a key, through sections and unions; None: there is none."""
    if hasattr(annotation, "model_fields"):
        field = annotation.model_fields.get(parts[0])
        return field if field is None or len(parts) == 1 else _field(field.annotation, parts[1:])
    members = (_field(member, parts) for member in getattr(annotation, "__args__", ()))
    return next((field for field in members if field is not None), None)


def label_of(key: str) -> str:
    """The last section and name of a key, without a unit: `aerosol optical depth at 550 nm`."""
    section, _, last = key.removeprefix("climate.").rpartition(".")
    words = re.sub(r"(_mag)?_per_\w+$|_(deg|au|km|um|nm|mm|du|k|hpa|ppm|percent)$", "", last)
    words = f"{section.rpartition('.')[2].removesuffix('expert')} {words}".replace("_", " ").strip()
    return re.sub(r" (\d+)nm$", r" at \1 nm", words)
