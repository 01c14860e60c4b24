"""From a name or a file, and settings on top, to validated configurations."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterable, Mapping
from copy import deepcopy
from dataclasses import dataclass, field
from os.path import isfile
from pathlib import Path
from typing import Any

from twilight.base.errors import TwilightError
from twilight.config.climate import Climate, climate_files
from twilight.config.document import dotted, parse_yaml, read_yaml
from twilight.config.library import find, shipped
from twilight.config.scene import Config
from twilight.config.slips import warn_of_slips
from twilight.config.solver import choose_solver
from twilight.config.validate import Origins, unknown, validate
from twilight.config.vary import DRAWING, Axis, axes_of

MAX_CASES = 1000
"""Scenes of a series that is rendered to files; a sweep takes more."""


@dataclass(frozen=True)
class Case:
    """One member of a series: its name (empty when there is only one) and its configuration."""

    name: str
    config: Config


@dataclass
class _Draft:
    """A configuration as plain data with its climate inside, and where each part was read."""

    data: dict[str, Any]
    origins: dict[tuple, str]
    hidden: set[tuple] = field(default_factory=set)

    def set(self, dotted_key: str, value: Any, where: str, folder: Path) -> None:
        path = _route(dotted_key, where)
        if path == ("climate",):
            self._put_climate(value, where, folder)
            return
        parent: Any = self.data
        for depth, part in enumerate(path[:-1]):
            if parent.get(part) is None:
                parent[part] = {}
                self.origins.setdefault(path[: depth + 1], where)
            parent = parent[part]
            if not isinstance(parent, dict):
                shown = dotted_key.split(".")[: depth + 1 - len(path)]
                raise TwilightError(f"{where}: {'.'.join(shown)} holds no keys that could be set")
        parent[path[-1]] = value
        if path[0] == "climate":
            for section, place, name, _ in climate_files(self.data["climate"]):
                # what was set just now, or a part of it
                if (*place, name)[: len(path) - 1] == path[1:]:
                    section[name] = str(folder / section[name])
        self.origins[path] = where
        if path[0] == "climate":
            self.hidden.add(("climate",))

    def _put_climate(self, value: Any, where: str, folder: Path) -> None:
        if not isinstance(value, str | dict):
            raise TwilightError(
                f"{where}: climate must be the name of a climate, the path of its file, or the climate itself, "
                f"got {'null' if value is None else repr(value)}"
            )
        if isinstance(value, str):
            try:
                path = find(value, folder, kinds=("climates",))
            except TwilightError as error:
                raise TwilightError(f"{where}: climate: {error}") from None
            value, folder, where = read_yaml(path), path.parent, str(path)
            if "climate" in value:
                raise TwilightError(f"{where}: is a configuration; climate needs a climate's name or file")
            self.hidden.add(("climate",))
        self.data["climate"] = _with_paths(value, folder)
        self.origins[("climate",)] = where

    def validated(self, *, solver: bool = True) -> Config:
        origins = Origins(self.origins, frozenset(self.hidden))
        if isinstance(self.data.get("climate"), dict):
            _find_shipped_files(self.data["climate"])
        config = validate(Config, self.data, origins)
        for section, place, name, _ in climate_files(config.climate.model_dump()):
            if not isfile(section[name]):
                where, shown = origins.describe(("climate", *place, name))
                raise TwilightError(f"{where}: {dotted(shown)}: there is no file {section[name]}")
        if config.climate.air is not None and config.climate.air.asks:
            config = validate(Config, {**self.data, "climate": _measured(config, origins)}, origins)
        if solver:
            choose_solver(config.solver, origins)
        return config


def _measured(config: Config, origins: Origins) -> dict[str, Any]:
    """The climate with what its section `air` asks for."""
    from twilight.config.measured import place_and_time_of, with_measured_air  # start-up: numpy, and readers

    try:
        return with_measured_air(config.climate, place_and_time_of(config))
    except TwilightError as error:
        raise TwilightError(f"{origins.describe(('climate', 'air'))[0]}: air: {error}") from None


Target = str | Path | Mapping[str, Any]


def _find_shipped_files(climate: dict[str, Any]) -> None:
    """Find the files that a record names without their folder, where they come with the program."""
    for section, _, name, _ in climate_files(climate):
        here = section[name]
        if isinstance(here, str) and Path(here).name == here and not isfile(here):
            folder = next(iter(shipped("climates").values())).parent
            if isfile(folder / here):
                section[name] = str(folder / here)


def load(target: Target, settings: Mapping[str, Any] | None = None) -> Config:
    """The one configuration of a climate, a configuration file or a mapping.

    Parameters
    ----------
    target, settings
        As of `load_series`.

    Returns
    -------
    Config

    Raises
    ------
    TwilightError
        As of `load_series`, and for a target that describes a series.
    """
    cases = load_series(target, settings)
    if len(cases) > 1:
        raise TwilightError(f"{target}: describes {len(cases)} cases; load_series returns them all")
    return cases[0].config


def load_series(
    target: Target, settings: Mapping[str, Any] | None = None, names: Mapping[str, str] | None = None
) -> list[Case]:
    """All configurations that a target describes: one, or the product of the axes of its `vary` section.

    Parameters
    ----------
    target
        Name of a climate or configuration, path of such a file, or its content as a mapping.
    settings
        Dotted keys and values on top, e.g. {"sun.elevation_deg": -4, "aerosol.relative_humidity_percent": 95}; keys of
        a climate and of a configuration may be mixed.  Replacing the whole of `sun` takes {"sun": {...}}.
    names
        What to call a setting in errors, e.g. {"sun": "--sun-elevation"}; its key otherwise.

    Returns
    -------
    list of Case
        Name, empty without `vary`, and configuration of each.

    Raises
    ------
    TwilightError
        Names the file or setting, the key, and what is allowed.
    """
    series = load_axes(target, settings, names)
    if not series.axes:
        cases = [Case("", series.config({}))]
        warn_of_slips(cases[0].config)
        return cases
    if math.prod(len(axis.points) for axis in series.axes) > MAX_CASES:
        raise TwilightError(f"{series.where}: vary asks for more than {MAX_CASES} cases")
    cases = []
    for chosen in itertools.product(*(zip(axis.points, axis.labels, strict=True) for axis in series.axes)):
        point = {key: value for settings, _ in chosen for key, value in settings.items()}
        cases.append(Case("_".join(text for _, text in chosen), series.config(point)))
    if len({case.name for case in cases}) < len(cases):
        raise TwilightError(f"{series.where}: vary lists the same value twice")
    for case in cases:
        warn_of_slips(case.config)
    return cases


@dataclass(frozen=True)
class Series:
    """A configuration and the axes of its `vary` section, whose members are made one by one."""

    axes: tuple[Axis, ...]
    where: str
    _draft: _Draft

    def config(self, point: Mapping[str, Any]) -> Config:
        """The configuration with these dotted keys set, as values of `vary`; {}: without any.

        Errors: TwilightError that names the file, the key, and what is allowed.
        """
        folder = Path(self.where).parent if isfile(self.where) else Path()
        one = deepcopy(self._draft)
        for name in sorted(point, key=lambda name: name.count(".")):  # a climate before what is set in it
            one.set(name, deepcopy(point[name]), f"{self.where}: vary", folder)
        return one.validated()


def load_axes(
    target: Target,
    settings: Mapping[str, Any] | None = None,
    names: Mapping[str, str] | None = None,
    asked: tuple[str, ...] | None = None,
) -> Series:
    """What `target` describes, with its series not yet multiplied out; arguments and errors as `load_series`.

    asked: the kinds of things whose names an error lists, `climates` or `configs`; None: both.
    """
    draft = _read(target, asked)
    _put(draft, settings, names)
    where = Origins(draft.origins).describe(("vary",))[0]
    vary = draft.data.pop("vary", None)
    drawing = {name: draft.data.pop(name) for name in DRAWING if name in draft.data}
    set_ = {name: value for name, value in drawing.items() if value is not None}
    return Series(axes_of({} if vary is None else vary, where, set_), where, draft)


def load_climate(
    target: str | Path, settings: Mapping[str, Any] | None = None, names: Mapping[str, str] | None = None
) -> Climate:
    """The climate of a name or a file, without a sun or an observer.

    Parameters
    ----------
    target
        Name of a climate, or path of its file.
    settings, names
        As of `load_series`.

    Returns
    -------
    Climate

    Raises
    ------
    TwilightError
        As of `load_series`.
    """
    draft = _read(target, ("climates",))
    _put(draft, settings, names)
    for name in ("vary", *DRAWING):
        draft.data.pop(name, None)
    return draft.validated(solver=False).climate


def _put(draft: _Draft, settings: Mapping[str, Any] | None, names: Mapping[str, str] | None) -> None:
    """Dotted keys and values on top of what was read."""
    for name, value in (settings or {}).items():
        draft.set(name, deepcopy(value), (names or {}).get(name, f"setting {name}"), Path())


def parse_setting(text: str) -> tuple[str, Any]:
    """`key=value` of the command line: a dotted key and a YAML value."""
    name, equals, value = text.partition("=")
    if not equals or not name.strip():
        raise TwilightError(f"--set {text}: must be key=value, e.g. aerosol.relative_humidity_percent=95")
    return name.strip(), parse_yaml(value, f"--set {name.strip()}")


def _read(target: Target, asked: tuple[str, ...] | None = None) -> _Draft:
    if isinstance(target, Mapping):
        data, where, folder = deepcopy(dict(target)), "configuration", Path()
    else:
        path = find(target, asked=asked)
        data, where, folder = read_yaml(path), str(path), path.parent
    only_config = set(Config.model_fields) - set(Climate.model_fields)
    if "climate" in data or (only_config & data.keys() and not _CLIMATE_KEYS & data.keys()):
        draft = _Draft(data, {(): where})
        if "climate" in data:
            draft._put_climate(data["climate"], where, folder)
        return draft
    draft = _Draft({"version": 1, "climate": _with_paths(data, folder)}, {(): where}, {("climate",)})
    draft.origins[("climate",)] = where
    return draft


_CLIMATE_KEYS = set(Climate.model_fields) - set(Config.model_fields)


def _with_paths(climate: Any, folder: Path) -> Any:
    """Files are named relative to the folder of the file that names them."""
    for section, _, name, _ in climate_files(climate):
        section[name] = str(folder / section[name])
    return climate


def _route(dotted_key: str, where: str) -> tuple[str, ...]:
    """The path of a dotted key in a configuration; keys of a climate go to `climate`."""
    path = tuple(dotted_key.split("."))
    if path[0] in Config.model_fields:
        return path
    if path[0] in Climate.model_fields:
        return ("climate", *path)
    names: Iterable[str] = {*Config.model_fields, *Climate.model_fields}
    raise TwilightError(f"{where}: {path[0]} {unknown(path[0], names)}")
