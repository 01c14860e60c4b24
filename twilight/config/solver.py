"""The `solver:` section against the settings of the solver that it names."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import asdict, fields, replace
from typing import Any, NamedTuple, get_type_hints

from pydantic import TypeAdapter, ValidationError

from twilight import solvers
from twilight.base.errors import TwilightError
from twilight.config.validate import Origins, allowed, unknown


class ChosenSolver(NamedTuple):
    """A solver's name, the name of a preset of its, and that preset with options replaced."""

    name: str
    quality: str
    settings: Any


def option_names(settings: type) -> tuple[list[str], list[str]]:
    """(options that stand right under `solver`, options under `solver.expert`), of a solver's class of settings.

    The former are those that the class lists in `COMMON`, in that order; without such a list all are.
    """
    known = [f.name for f in fields(settings)]
    common = list(getattr(settings, "COMMON", known))
    return common, [name for name in known if name not in common]


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
    common, expert = option_names(type(preset))
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
    hints = get_type_hints(type(preset), include_extras=True)
    chosen: dict[str, Any] = {}
    for path, value in [
        *(((key,), v) for key, v in options.items()),
        *((("expert", key), v) for key, v in given.items()),
    ]:
        key = path[-1]
        try:
            chosen[key] = TypeAdapter(hints[key]).validate_python(value, strict=not isinstance(value, list))
        except ValidationError:
            text = f"solver.{'.'.join(path)} must be {allowed(hints[key])}, got {value!r}"
            raise _error(origins, path, text) from None
    try:
        return ChosenSolver(name, quality, replace(preset, **chosen))
    except TwilightError as error:
        # solvers call their options solver.NAME
        text = re.sub(r"\bsolver\.(\w+)", lambda m: f"solver.expert.{m[1]}" if m[1] in expert else m[0], str(error))
        first = next(iter(chosen), "name")
        raise _error(origins, ("expert", first) if first in expert else (first,), text) from None


def complete_solver(section: Mapping[str, Any]) -> dict[str, Any]:
    """The section with every option of the solver written out, for the record in the files.

    What a solver reads from a file is named by the file's name and the SHA-256 of its content (its `recorded`).
    """
    name, quality, settings = choose_solver(section)
    solver: Any = solvers.load(name)
    if hasattr(solver, "recorded"):
        settings = solver.recorded(settings)
    common, expert = option_names(type(settings))
    values = asdict(settings)
    made = {"name": name, "quality": quality, **{key: values[key] for key in common}}
    return made | ({"expert": {key: values[key] for key in expert}} if expert else {})


def explain_options(settings: type) -> dict[str, str]:
    """What each option of a solver is for, from the docstring of its settings.

    The docstring says `option, option: what they are`, each such piece on lines of its own; a line that ends with a
    colon and names no option is a heading.
    """
    names = "|".join(sorted((f.name for f in fields(settings)), key=len, reverse=True))
    start = re.compile(rf"\s*((?:{names})(?:, (?:{names}))*): ?(.*)")
    found: dict[str, str] = {}
    current: tuple[str, ...] = ()
    for line in (settings.__doc__ or "").splitlines():
        begins = start.fullmatch(line)
        if begins:
            current = tuple(begins[1].split(", "))
            found.update(dict.fromkeys(current, begins[2].strip()))
        elif not line.strip() or line.rstrip().endswith(":"):
            current = ()
        else:
            found.update({name: f"{found[name]} {line.strip()}".strip() for name in current})
    yaml = {"None": "null", "True": "true", "False": "false"}
    return {
        name: re.sub(r"\b(None|True|False)\b", lambda word: yaml[word[0]], " ".join(text.split())).rstrip(".")
        for name, text in found.items()
    }


class SolverOptions:
    """Annotates the `solver:` section: its JSON schema has every solver's options, with their values at `standard`."""

    def __get_pydantic_json_schema__(self, core: Any, handler: Any) -> dict[str, Any]:
        return {"oneOf": [_schema_of(name) for name in solvers.SOLVERS]}


def _schema_of(name: str) -> dict[str, Any]:
    qualities = solvers.load(name).QUALITIES
    standard = qualities["standard"]
    hints, why, values = get_type_hints(type(standard)), explain_options(type(standard)), asdict(standard)
    common, expert = (
        {
            key: TypeAdapter(hints[key]).json_schema() | {"default": values[key], "description": why.get(key, "")}
            for key in named
        }
        for named in option_names(type(standard))
    )
    keys: dict[str, Any] = {"name": {"const": name}, "quality": {"enum": list(qualities), "default": "standard"}}
    keys |= common
    if expert:
        keys["expert"] = {"type": "object", "additionalProperties": False, "properties": expert}
    made = {"type": "object", "additionalProperties": False, "properties": keys}
    return made | ({} if name == solvers.DEFAULT else {"required": ["name"]})


def _error(origins: Origins, path: tuple[str, ...], text: str) -> TwilightError:
    return TwilightError(f"{origins.describe(('solver', *path))[0]}: {text}")
