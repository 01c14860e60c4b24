"""The dimensions of a sweep: which keys vary along each, and along which of them scenes share a solved field.

What a dataset calls the coordinate of a key that a sweep varies: a few words and a unit, for axes and legends.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

from twilight import solvers
from twilight.base.errors import TwilightError
from twilight.config.climate import Climate
from twilight.config.scene import Config
from twilight.config.sun import SunElevations, SunInterval, SunTimes
from twilight.config.vary import DRAWING, DRAWS, LIST, Axis
from twilight.io.labels import LABELS, attributes
from twilight.scene.scene import count_suns

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


TEXTS = {
    "aerosol.angstrom.asymmetry": "asymmetry of the aerosol",
    "aerosol.angstrom.exponent": "Ångström exponent",
    "aerosol.angstrom.single_scattering_albedo": "single scattering albedo",
    "aerosol.boundary_layer_top_km": "top of the boundary layer",
    "aerosol.mineral_transported.bottom_km": "bottom of the mineral layer",
    "aerosol.mineral_transported.number_density_per_cm3": "mineral particles",
    "aerosol.mineral_transported.optical_depth_550nm": "mineral optical depth at 550 nm",
    "aerosol.mineral_transported.top_km": "top of the mineral layer",
    "aerosol.modes.number_density_per_cm3": "particles (modes)",
    "aerosol.optical_depth_550nm": "aerosol optical depth at 550 nm",
    "aerosol.relative_humidity_percent": "relative humidity",
    "aerosol.scale_height_km": "scale height of the aerosol",
    "aerosol.type": "aerosol",
    "atmosphere.layers.equal_air_mass": "layers of equal air mass",
    "atmosphere.profile": "profile of the air",
    "atmosphere.top_km": "top of the air",
    "gases.no2": "NO2",
    "gases.o4": "O4",
    "gases.oxygen": "bands of oxygen",
    "gases.ozone.column_du": "ozone column",
    "gases.ozone.day_of_year": "day of the year",
    "gases.ozone.treatment": "treatment of ozone",
    "gases.water_vapour.column_mm": "water vapour column",
    "ground.albedo": "albedo of the ground",
    "ground.altitude_km": "altitude of the ground",
    "horizon.screen.clouds.cover": "cover of clouds beyond the horizon",
    "horizon.screen.clouds.top_km": "top of clouds beyond the horizon",
    "medium.earth_radius_km": "radius of the Earth",
    "observer.altitude_km": "observer altitude",
    "night.airglow": "airglow over usual",
    "night.light_pollution.zenith_mag_per_arcsec2": "zenith under light pollution",
    "night.starlight": "starlight over usual",
    "night.zodiacal_light": "zodiacal light over usual",
    "refraction.co2_ppm": "CO2",
    "refraction.relative_humidity_percent": "humidity of Haber's refraction",
    "stratosphere.kind": "stratosphere",
    "stratosphere.levels.altitude_km": "altitude (stratospheric levels)",
    "sun.at": "time",
    "sun.distance_au": "distance of the sun",
    "sun.latitude_deg": "latitude",
    "sun.longitude_deg": "longitude",
    "sun.time_zone": "time zone",
    "terrain.albedo": "albedo of the mountains",
    "terrain.azimuth_deg": "azimuth of the mountains",
    "terrain.base_km": "foot of the mountains",
    "terrain.distance_km": "distance of the mountains",
    "terrain.height_km": "height of the mountains",
}
"""Of keys whose own words would not do."""
UNITS = {"deg": "degree", "au": "astronomical_unit", "cm^-3": "cm-3", "m/s": "m s-1"}
"""Units of keys as UDUNITS spells them."""


def key_attributes(key: str) -> dict[str, str]:
    """CF attributes of a dotted key: long_name, units and, as the comment, its line of help; and the key itself."""
    unit, text = describe_key(key)
    short = key.removeprefix("climate.")
    made = {"long_name": label_of(short, unit), "units": UNITS.get(unit, unit), "comment": text, "key": key}
    if variable_name(key) in LABELS:
        made |= attributes(variable_name(key))
    return {name: value for name, value in made.items() if value}


def label_of(key: str, unit: str = "") -> str:
    """A few words for a key: those of `TEXTS`, else its own without the unit at their end."""
    if key in TEXTS:
        return TEXTS[key]
    section, _, last = key.rpartition(".")
    words = last.split("_")
    if unit and len(words) > 1 and words[-1] == unit.split("/")[0].lower():
        words.pop()
    of = section.rpartition(".")[2].replace("_", " ")
    text = " ".join(words)
    return text if not of or of in ("expert", "climate", text) else f"{text} ({of})"


def describe_key(key: str) -> tuple[str, str]:
    """(unit, one line of help) of a dotted key, empty where there is none."""
    parts = key.removeprefix("climate.").split(".")
    for model in (Config, Climate):
        owner: Any = model
        info = None
        for part in parts:
            info = next((m.model_fields[part] for m in _models(owner) if part in m.model_fields), None)
            if info is None:
                break
            owner = info.annotation
        if info is not None:
            extra = info.json_schema_extra
            return (str(extra.get("unit", "")) if isinstance(extra, dict) else "", info.description or "")
    return "", ""


def _models(annotation: Any) -> list[Any]:
    """All models in an annotation, through unions."""
    if hasattr(annotation, "model_fields"):
        return [annotation]
    return [model for inner in getattr(annotation, "__args__", ()) for model in _models(inner)]
