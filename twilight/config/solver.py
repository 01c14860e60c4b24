"""The `solver:` section against the settings of the solver that it names."""

import re
from collections.abc import Mapping
from dataclasses import asdict, replace
from typing import Any, NamedTuple

from pydantic import TypeAdapter

from twilight import solvers
from twilight.base.errors import TwilightError
from twilight.base.sections import Origins, option_fields, option_name, unknown


class ChosenSolver(NamedTuple):
    """A solver's name, the name of a preset of its, and that preset with options replaced."""

    name: str
    quality: str
    settings: Any


def option_names(settings: Any) -> tuple[list[str], list[str]]:
    """(options that stand right under `solver`, options under `solver.expert`), of a solver's settings."""
    expert = [name for name in option_fields(settings) if option_name(settings, name).startswith("solver.expert.")]
    return [name for name in option_fields(settings) if name not in expert], expert


def choose_solver(section: Mapping[str, Any], origins: Origins | None = None) -> ChosenSolver:
    """The solver that a section names, and the preset of its quality with the section's other keys on top.

    origins: where the section was read, for errors.
    Errors: TwilightError for a solver, quality or option that does not exist, or a value out of range.
    """
    origins = origins or Origins()
    options = dict(section)
    name = options.pop("name", solvers.DEFAULT)
    if not isinstance(name, str) or name not in solvers.SOLVERS:
        raise _error(origins, ("name",), f"{name} {unknown(str(name), solvers.SOLVERS, 'solver')}")
    qualities = solvers.load(name).QUALITIES
    quality = options.pop("quality", "standard")
    if not isinstance(quality, str) or quality not in qualities:
        raise _error(origins, ("quality",), f"{quality} {unknown(str(quality), qualities, f'quality of {name}')}")
    preset = qualities[quality]
    common, expert = option_names(preset)
    given = options.pop("expert", {}) if expert else {}
    if not isinstance(given, Mapping):
        raise _error(origins, ("expert",), f"solver.expert must be a mapping of options of {name}, got {given!r}")
    for key in options:
        if key in expert:
            raise _error(origins, (key,), f"solver.{key} is an option for experts: write solver.expert.{key}")
        if key not in common:
            allowed_here = [*common, "name", "quality", *(["expert"] if expert else [])]
            raise _error(origins, (key,), f"solver.{key} {unknown(key, allowed_here, f'key of {name}')}")
    for key in given:
        if key in common:
            raise _error(origins, ("expert", key), f"solver.expert.{key} stands among the first: write solver.{key}")
        if key not in expert:
            raise _error(origins, ("expert", key), f"solver.expert.{key} {unknown(key, expert, f'key of {name}')}")
    try:
        return ChosenSolver(name, quality, replace(preset, **options, **given))
    except TwilightError as error:
        named = [
            word for word in re.findall(r"\bsolver\.(?:expert\.)?(\w+)", str(error)) if word in {**options, **given}
        ]
        first = next(iter([*named, *options, *given]), "name")
        raise _error(origins, ("expert", first) if first in given else (first,), str(error)) from None


def complete_solver(section: Mapping[str, Any]) -> dict[str, Any]:
    """The section with every option of the solver written out, for the record in the files.

    What a solver reads from a file is named by the file's name and the SHA-256 of its content (its `recorded`).
    """
    name, quality, settings = choose_solver(section)
    solver: Any = solvers.load(name)
    if hasattr(solver, "recorded"):
        settings = solver.recorded(settings)
    common, expert = option_names(settings)
    values = asdict(settings)
    made = {"name": name, "quality": quality, **{key: values[key] for key in common}}
    return made | ({"expert": {key: values[key] for key in expert}} if expert else {})


class SolverOptions:
    """Annotates the `solver:` section: its JSON schema has every solver's options, with their values at `standard`."""

    def __get_pydantic_json_schema__(self, core: Any, handler: Any) -> dict[str, Any]:
        return {"oneOf": [_schema_of(name) for name in solvers.SOLVERS]}


def _schema_of(name: str) -> dict[str, Any]:
    qualities = solvers.load(name).QUALITIES
    standard = qualities["standard"]
    described, values = TypeAdapter(type(standard)).json_schema()["properties"], asdict(standard)
    common, expert = (
        {key: described[key] | {"default": values[key]} for key in named} for named in option_names(standard)
    )
    keys: dict[str, Any] = {"name": {"const": name}, "quality": {"enum": list(qualities), "default": "standard"}}
    keys |= common
    if expert:
        keys["expert"] = {"type": "object", "additionalProperties": False, "properties": expert}
    made = {"type": "object", "additionalProperties": False, "properties": keys}
    return made | ({} if name == solvers.DEFAULT else {"required": ["name"]})


def _error(origins: Origins, path: tuple[str, ...], text: str) -> TwilightError:
    return TwilightError(f"{origins.describe(('solver', *path))[0]}: {text}")
