"""Options that several commands have, and the objects that options of one command are together."""

from __future__ import annotations

import datetime as dt
import functools
import inspect
import re
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, fields, is_dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, NamedTuple, get_type_hints

import typer

from twilight.base.errors import TwilightError

if TYPE_CHECKING:
    from twilight.config import Config
    from twilight.config.sun import SunAt

MAX_WORKERS = 10_000
"""Most processes or jobs, and most threads of each."""


def argument(metavar: str, help: str, complete: Callable[[str], list[str]] | None = None) -> Any:
    """A positional argument; complete: the names that the shell offers for what was typed."""
    return typer.Argument(metavar=metavar, help=help, autocompletion=complete)


def option(metavar: str, help: str, *names: str, complete: Callable[[str], list[str]] | None = None) -> Any:
    """An option with a value, by the name of its parameter or by `names`."""
    return typer.Option(*names, metavar=metavar, help=help, autocompletion=complete)


def flag(name: str, help: str) -> Any:
    """An option without a value."""
    return typer.Option(name, help=help)


class Within(NamedTuple):
    """Limits of the value of an option, where it is given."""

    low: float
    high: float


class EndsIn(tuple[str, ...]):
    """Ends of the names of files that an option takes; the first is named in errors."""


class Sets(tuple[str, ...]):
    """Dotted keys of a configuration that an option sets, where it is given (`Settings`)."""


def spread(command: Callable[..., None]) -> Callable[..., None]:
    """The command with options of its own for the fields of each parameter that is a dataclass; `Within` and `EndsIn`
    among an option's annotations are seen to before it runs.

    Errors, when it runs: TwilightError for a value beyond them.
    """
    hints = get_type_hints(command, include_extras=True)
    groups: dict[str, Any] = {name: kind for name, kind in hints.items() if is_dataclass(kind)}
    options: list[inspect.Parameter] = []
    for parameter in inspect.signature(command).parameters.values():
        if parameter.name not in groups:
            options.append(parameter.replace(kind=parameter.KEYWORD_ONLY, annotation=hints[parameter.name]))
            continue
        kind = groups[parameter.name]
        own = get_type_hints(kind, include_extras=True)
        of_group = inspect.signature(kind).parameters.values()
        options += [p.replace(kind=p.KEYWORD_ONLY, annotation=own[p.name]) for p in of_group]

    @functools.wraps(command)
    def called(**given: Any) -> None:
        for one in options:
            for limit in getattr(one.annotation, "__metadata__", ()):
                if isinstance(limit, Within):
                    check_range(given[one.name], _name_of(one.name, one.annotation), *limit)
                elif isinstance(limit, EndsIn):
                    check_suffix(given[one.name], _name_of(one.name, one.annotation), *limit)
        for name, kind in groups.items():
            given[name] = kind(**{f.name: given.pop(f.name) for f in fields(kind)})
        command(**given)

    called.__signature__ = inspect.Signature(options)  # type: ignore[attr-defined]
    called.__annotations__ = {one.name: one.annotation for one in options}
    return called


def _name_of(name: str, annotation: Any) -> str:
    """What an option is called, by the name of its parameter and its annotation."""
    called = getattr(annotation.__metadata__[0], "default", ...)
    return called if isinstance(called, str) else f"--{name.replace('_', '-')}"


def climate_names(incomplete: str) -> list[str]:
    """Names that the shell completes for a climate."""
    return _starting("climates", incomplete)


def config_names(incomplete: str) -> list[str]:
    """Names that the shell completes for a configuration."""
    return _starting("configs", incomplete)


def scene_names(incomplete: str) -> list[str]:
    """Names that the shell completes for a scene."""
    return climate_names(incomplete) + config_names(incomplete)


SHOWN = ("climates", "configs", "solvers", "schema")
"""What `twilight show` knows beside names."""


def shown_names(incomplete: str) -> list[str]:
    """Names that the shell completes for what is shown."""
    return [word for word in SHOWN if word.startswith(incomplete)] + scene_names(incomplete)


def solver_names(incomplete: str) -> list[str]:
    """Names that the shell completes for a solver."""
    from twilight.solvers import SOLVERS

    return [name for name in SOLVERS if name.startswith(incomplete)]


def _starting(kind: str, incomplete: str) -> list[str]:
    from twilight.config.load import shipped

    return [name for name in shipped(kind) if name.startswith(incomplete)]


SCENE = argument("CLIMATE_OR_CONFIG", "Name or file of a climate or configuration.", scene_names)
CLIMATE = argument("CLIMATE", "Name or file of a climate or configuration.", scene_names)
SETTINGS = option("KEY=VALUE", "Any key; may be repeated.", "--set")
SOLVER = option("NAME", "See `twilight show solvers`.", complete=solver_names)
QUALITY = option("NAME", "Preset of the solver: draft, standard, reference ...")
ALTITUDE_KM = option("KM", "Altitude of the observer above sea level.")
ONLY_PLAN = flag("--plan", "Only say what would be computed.")
LATITUDE = option("DEG", "North positive, or 52.5N.")
LATITUDES = Within(-90.0, 90.0)
LONGITUDE = option("DEG", "East positive, or 13.4E.")
LONGITUDES = Within(-720.0, 720.0)
TimeZone = Annotated[
    str | None, option("ZONE", "Of times without offset and of what is printed, e.g. Europe/Berlin; without it, UTC.")
]
AltitudeKm = Annotated[float | None, ALTITUDE_KM, Sets(["observer.altitude_km"])]
Quality = Annotated[str | None, QUALITY, Sets(["solver.quality"])]
Solver = Annotated[str | None, SOLVER, Sets(["solver.name"])]
Given = Mapping[str, tuple[Any, str]]
"""Options by the dotted key that each sets: the value, None where the option was not given, and its name for errors."""


@dataclass(frozen=True, kw_only=True)
class Settings:
    """Keys of a configuration: `--set`, which overrides the options of a command for single keys (`Sets`)."""

    settings: Annotated[list[str] | None, SETTINGS] = None

    def chosen(self, more: Given | None = None) -> tuple[dict[str, Any], dict[str, str]]:
        """The values by dotted key, and what to call each in errors; more: whole sections first."""
        given: dict[str, tuple[Any, str]] = {}
        for name, annotation in get_type_hints(type(self), include_extras=True).items():
            value = getattr(self, name)
            keys = next((one for one in annotation.__metadata__ if isinstance(one, Sets)), ())
            given |= {key: (None if value is False else value, _name_of(name, annotation)) for key in keys}
        return settings_of(self.settings, {**(more or {}), **given})


@dataclass(frozen=True, kw_only=True)
class SolverSettings(Settings):
    """The quality of the solver, and any key."""

    quality: Quality = None


@dataclass(frozen=True, kw_only=True)
class ObserverSettings(SolverSettings):
    """The observer's altitude too."""

    altitude_km: AltitudeKm = None


@dataclass(frozen=True)
class Place:
    """A place, and the time zone of what is said of it."""

    latitude: Annotated[float, LATITUDE, LATITUDES]
    longitude: Annotated[float, LONGITUDE, LONGITUDES]
    time_zone: TimeZone = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "longitude", turned(self.longitude))


@dataclass(frozen=True)
class PlaceAndTime:
    """A place and a time, where they are given."""

    at: Annotated[
        str | None,
        option(
            "TIME",
            "Date and time, e.g. 2003-12-08T16:30, or '2026-06-21 civil dusk', 'sunset', 'dusk -4'.  Needs a place; "
            "see `twilight times`.",
        ),
    ] = None
    latitude: Annotated[float | None, LATITUDE, LATITUDES] = None
    longitude: Annotated[float | None, LONGITUDE, LONGITUDES] = None
    time_zone: TimeZone = None

    @property
    def given(self) -> dict[str, Any]:
        """Keys of the section `sun`; none where nothing is given.  Errors: TwilightError for half of it."""
        keys = {"at": self.at, "latitude_deg": self.latitude, "longitude_deg": self.longitude}
        given = {key: value for key, value in {**keys, "time_zone": self.time_zone}.items() if value is not None}
        if given and None in keys.values():
            raise TwilightError("--at: a time needs a place and a place a time: give --at, --latitude and --longitude")
        return given

    def sun(self) -> SunAt | None:
        """The section `sun` of the place and time; None where neither is given.  Errors name the options."""
        from twilight.base.sections import Origins, validate
        from twilight.config.sun import SunAt

        names = {"latitude_deg": "--latitude", "longitude_deg": "--longitude", "at": "--at", "time_zone": "--time-zone"}
        origins = Origins({(): "--at", **{(key,): name for key, name in names.items()}})
        return validate(SunAt, self.given, origins) if self.given else None


def turned(longitude_deg: float) -> float:
    """A longitude of up to two turns as the same one from -180 to 360 deg."""
    return longitude_deg if -180.0 <= longitude_deg <= 360.0 else (longitude_deg + 180.0) % 360.0 - 180.0


def settings_of(texts: Iterable[str] | None, given: Given | None = None) -> tuple[dict[str, Any], dict[str, str]]:
    """The values of `--set KEY=VALUE` by dotted key, and what to call each in errors.

    given: options that --set may override; where it replaces a whole section, they set their keys in the new one.
    Errors: TwilightError for a text that is not KEY=VALUE.
    """
    from twilight.config.load import parse_setting

    chosen: dict[str, Any] = {}
    names: dict[str, str] = {}
    put_options(chosen, names, given or {})
    for key, value in map(parse_setting, texts or ()):
        chosen[key], names[key] = value, f"--set {key}"
        for later in [option for option in given or () if option in chosen and option.startswith(f"{key}.")]:
            chosen[later] = chosen.pop(later)
    return chosen, names


def put_options(chosen: dict[str, Any], names: dict[str, str], given: Given) -> None:
    """Set the keys of the options that were given, which override what is chosen already."""
    for key, (value, name) in given.items():
        if value is not None:
            chosen[key], names[key] = value, name


def file_stem(text: str, otherwise: str) -> str:
    """A text as part of a file's name."""
    return re.sub(r"[^\w.+-]+", "-", text).strip("-.") or otherwise


def output_folder(output: Path | None, prefix: str, name: str, otherwise: str = "scene") -> Path:
    """The folder that --output names, else out/PREFIX-NAME; TwilightError where it cannot be a folder."""
    from twilight.base.whole_files import check_folder

    folder = output or Path("out") / f"{prefix}-{file_stem(name, otherwise)}"
    check_folder(folder)
    return folder


def check_polarised(config: Any) -> None:
    """Raise TwilightError, before anything is computed, where what is to be written needs polarised light."""
    from twilight import solvers
    from twilight.base.formats import WHERE_POLARISED

    wanted = [f"output.files: {name}" for name in config.output.files or () if name in WHERE_POLARISED]
    if config.output.polariser_deg is not None:
        wanted.append("output.polariser_deg")
    name, quality, settings = config.chosen_solver
    if wanted and not getattr(settings, "polarisation", False):
        able = ", ".join(solvers.with_option("polarisation"))
        raise TwilightError(
            f"{config.title}: {wanted[0]} needs polarised light, and {name} ({quality}) computes none; set "
            f"solver.polarisation: true with one of {able}"
        )


def parse_numbers(text: str, option: str, low: float, high: float) -> list[float]:
    """Numbers with commas between them, each once; TwilightError for anything else."""
    try:
        values = [float(part) for part in text.split(",")]
    except ValueError:
        raise TwilightError(f"{option}: {text} must be numbers with commas between them, e.g. 5,0,-6") from None
    for value in values:
        check_range(value, option, low, high)
    return list(dict.fromkeys(values))


def load_one_scene(scene: str, chosen: dict[str, Any], names: dict[str, str], command: str) -> Config:
    """The configuration of a command that takes one scene; TwilightError for a series of them."""
    from twilight.config import load_series

    cases = load_series(scene, chosen, names)
    if len(cases) > 1:
        raise TwilightError(f"{scene}: is a series of {len(cases)} scenes (vary); {command} takes one")
    return cases[0].config


def check_range(value: float | None, option: str, low: float, high: float) -> None:
    """TwilightError for a value of an option that is given and not from `low` to `high`."""
    if value is not None and not low <= value <= high:
        raise TwilightError(f"{option}: {value:.10g} is not allowed; it must be from {low:g} to {high:g}")


def check_suffix(path: Path | None, option: str, *suffixes: str) -> None:
    """TwilightError for a file that is given and whose name ends in none of the suffixes; suffixes[0] is named."""
    if path is not None and path.suffix.lower() not in suffixes:
        raise TwilightError(f"{option}: {path} must end in {suffixes[0]}")


def parse_date(text: str, option: str, example: str = "2026-06-21") -> dt.date:
    """The date of an option; TwilightError for anything else."""
    try:
        return dt.date.fromisoformat(text.strip())
    except ValueError:
        raise TwilightError(f"{option}: {text} is not a date such as {example}") from None
