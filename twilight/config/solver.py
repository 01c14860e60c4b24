"""The `solver:` section against the settings of the solver that it names."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import asdict, fields, replace
from typing import Any, get_type_hints

from pydantic import TypeAdapter, ValidationError

from twilight import solvers
from twilight.config.validate import Origins, allowed, unknown
from twilight.errors import TwilightError


def resolve_solver(section: Mapping[str, Any], origins: Origins | None = None) -> tuple[str, str, Any]:
    """(solver, quality, settings): the preset of that quality with the section's other keys on top.

    origins: where the section was read, for errors.
    Errors: TwilightError for a solver, quality or option that does not exist, or a value out of range.
    """
    origins = origins or Origins()
    options = dict(section)
    name = options.pop("name", solvers.DEFAULT)
    if not isinstance(name, str) or name not in solvers.SOLVERS:
        raise _error(origins, "name", f"{name} {unknown(str(name), solvers.SOLVERS, 'solver')}")
    qualities = solvers.load(name).QUALITIES
    quality = options.pop("quality", "standard")
    if not isinstance(quality, str) or quality not in qualities:
        raise _error(origins, "quality", f"{quality} {unknown(str(quality), qualities, f'quality of {name}')}")
    preset = qualities[quality]
    hints = get_type_hints(type(preset), include_extras=True)
    known = [f.name for f in fields(preset)]
    for key, value in options.items():
        if key not in known:
            raise _error(origins, key, f"solver.{key} {unknown(key, [*known, 'name', 'quality'], f'key of {name}')}")
        try:
            options[key] = TypeAdapter(hints[key]).validate_python(value, strict=not isinstance(value, list))
        except ValidationError:
            raise _error(origins, key, f"solver.{key} must be {allowed(hints[key])}, got {value!r}") from None
    try:
        return name, quality, replace(preset, **options)
    except TwilightError as error:
        raise _error(origins, next(iter(options), "name"), str(error)) from None


def complete_solver(section: Mapping[str, Any]) -> dict[str, Any]:
    """The section with every option of the solver written out, for the record in the files.

    What a solver reads from a file is named by the file's name and the SHA-256 of its content (its `recorded`).
    """
    name, quality, settings = resolve_solver(section)
    solver: Any = solvers.load(name)
    if solver.CAPABILITIES.reads_files:
        settings = solver.recorded(settings)
    return {"name": name, "quality": quality, **asdict(settings)}


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


def _error(origins: Origins, key: str, text: str) -> TwilightError:
    return TwilightError(f"{origins.describe(('solver', key))[0]}: {text}")
