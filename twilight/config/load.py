"""From a name or a file, and settings on top, to validated configurations.

Climates and configurations that come with the program are known by name.  Values that are allowed and almost surely a
slip (a fraction meant as per cent, metres meant as kilometres) are warned of.
"""

import itertools
import math
import warnings
from collections.abc import Iterable, Iterator, Mapping
from copy import deepcopy
from dataclasses import dataclass, field
from difflib import get_close_matches
from os.path import isdir, isfile
from pathlib import Path
from typing import Any

from twilight.base.document import parse_yaml, read_yaml
from twilight.base.errors import TwilightError, TwilightWarning
from twilight.base.sections import Origins, dotted, unknown, validate
from twilight.config.climate import Climate, climate_files
from twilight.config.scene import Config
from twilight.config.solver import choose_solver
from twilight.config.vary import Axis, Drawing, axes_of


def shipped(kind: str) -> dict[str, Path]:
    """Name -> file of the shipped `climates` or `configs`, sorted by name.

    An installed package holds the two folders inside itself; a checkout holds them beside the package.
    """
    package = Path(__file__).resolve().parents[1]
    folder = next((f for f in (package / kind, package.parent / kind) if f.is_dir()), None)
    if folder is None:
        raise TwilightError(f"the {kind} that come with twilight are missing from this installation: install it again")
    return {path.stem: path for path in sorted(folder.glob("*.yaml"))}


NOUNS = {"climates": "climate", "configs": "configuration"}


def find(
    target: str | Path,
    folder: Path = Path(),
    kinds: tuple[str, ...] = ("climates", "configs"),
    asked: tuple[str, ...] | None = None,
) -> Path:
    """The file that `target` means: a path (relative to `folder`), or the name of something shipped.

    asked: the kinds that an error lists and suggests, where fewer make sense than are found.
    Errors: TwilightError that lists the nearest names when there is no such thing.
    """
    asked = asked or kinds
    noun = " or ".join(NOUNS[kind] for kind in asked)
    text = str(target)
    if "\0" in text or not text:
        raise TwilightError(f"{text!r} is neither a file nor the name of a {noun}")
    path = folder / Path(text).expanduser()
    if isfile(path):  # unlike Path.is_file, False for a name that is too long
        return path
    if isdir(path):
        raise TwilightError(f"{path}: is a folder; give the file of a {noun}")
    found = next((names[text] for names in map(shipped, kinds) if text in names), None)
    if found is not None:
        return found
    if path.suffix in (".yaml", ".yml", ".json") or "/" in text or "\\" in text:
        beside = get_close_matches(path.stem, _files_beside(path), n=1)
        near = get_close_matches(path.stem, [name for kind in asked for name in shipped(kind)], n=1)
        hint = f"; did you mean {path.parent / _files_beside(path)[beside[0]]}?" if beside else ""
        hint = hint or (f"; did you mean {near[0]}, which needs no path?" if near else f"; {_lists(asked)}")
        raise TwilightError(f"{path}: there is no such file{hint}")
    suggested = [name for kind in asked for name in shipped(kind)]
    near = get_close_matches(text, suggested, n=1)
    hint = f"did you mean {near[0]}?" if near else _names(asked)
    raise TwilightError(f"{text} is not a {noun}; {hint}")


def _files_beside(path: Path) -> dict[str, str]:
    """Names of the documents in the folder of a path by their stems; none where it cannot be read."""
    try:
        return {
            one.stem: one.name
            for one in path.parent.iterdir()
            if one.suffix in (".yaml", ".yml", ".json") and one.name != path.name
        }
    except OSError:
        return {}


def _names(kinds: tuple[str, ...]) -> str:
    """`climates are a, b; configurations are c`, for errors."""
    return "; ".join(f"{NOUNS[kind]}s are {', '.join(shipped(kind))}" for kind in kinds)


def _lists(kinds: tuple[str, ...]) -> str:
    """Where the names are listed, for errors."""
    commands = " and ".join(f"`twilight show {kind}`" for kind in kinds)
    return f"{commands} list{'s' * (len(kinds) == 1)} those that come with the program"


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
            for section, _, name, _ in climate_files(self.data["climate"]):
                here = section[name]
                if isinstance(here, str) and Path(here).name == here and not isfile(here):  # of a record
                    beside = next(iter(shipped("climates").values())).parent / here
                    section[name] = str(beside) if isfile(beside) else here
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
    """All configurations that a target describes: one, or the product of the axes of its `vary` section, by name.

    target: name of a climate or configuration, path of such a file, or its content as a mapping.  settings: dotted keys
    and values on top, e.g. {"sun.elevation_deg": -4, "aerosol.relative_humidity_percent": 95}; keys of a climate and of
    a configuration may be mixed; replacing the whole of `sun` takes {"sun": {...}}.  names: what to call a setting in
    errors, e.g. {"sun": "--sun-elevation"}; its key otherwise.
    Errors: TwilightError that names the file or setting, the key, and what is allowed."""
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
    drawing = {name: draft.data.pop(name) for name in Drawing.model_fields if name in draft.data}
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
    for name in ("vary", *Drawing.model_fields):
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


LOWEST_OZONE_DU = 70.0
"""NASA Ozone Watch has 73 DU as the lowest column measured (30 September 1994)."""
HIGHEST_CLOSE_VIEW_KM = 100.0
"""Altitude [km] from which a picture of the upper hemisphere alone is dark: the Karman line."""
LARGEST_USUAL_DEPTH = 5.0
"""Vertical optical depth at 550 nm above which a slip is likelier than a dust storm."""
LOWEST_CO2_PPM = 100.0
"""Least carbon dioxide that is no slip [ppm]: the last 800 000 years had 172 and more (Luethi et al. 2008)."""


def warn_of_slips(*configs: Config) -> None:
    """A TwilightWarning for each value of one or more configurations that is almost surely a slip."""
    for sentence in dict.fromkeys(sentence for config in configs for sentence in slips(config)):
        warnings.warn(sentence, TwilightWarning, stacklevel=3)


def slips(config: Config) -> Iterator[str]:
    """One sentence for each, with the key, its unit and what was perhaps meant."""
    climate = config.climate
    if climate.aerosol is not None:
        humidity = climate.aerosol.relative_humidity_percent
        if 0.0 < humidity <= 1.0:
            meant = f"{100 * humidity:g} is {100 * humidity:g} %"
            yield f"aerosol.relative_humidity_percent is {humidity:g} %, drier than any desert; {meant}"
        depth = climate.aerosol.optical_depth_550nm
        if depth is not None and depth > LARGEST_USUAL_DEPTH:
            yield f"aerosol.optical_depth_550nm is {depth:g}, more than all but the densest smoke and dust"
    column = climate.gases.ozone.column_du
    if column is not None and 0.0 < column < LOWEST_OZONE_DU:
        meant = f"{column:g} mm of ozone are {100 * column:g} DU"
        yield f"gases.ozone.column_du is {column:g} DU, less than has ever been measured; {meant}"
    carbon_dioxide = climate.refraction.co2_ppm
    if 0.0 < carbon_dioxide < LOWEST_CO2_PPM:
        yield f"refraction.co2_ppm is {carbon_dioxide:g} ppm; the air has 420"
    altitude = config.observer.altitude_km
    if altitude >= HIGHEST_CLOSE_VIEW_KM and config.observer.view is None:
        yield f"observer.altitude_km is {altitude:g} km, above the air; {altitude:g} m are {altitude / 1000:g} km"
