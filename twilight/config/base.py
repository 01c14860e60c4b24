"""What all configuration models share: frozen, no unknown keys, and a unit and a line of help for every key."""

from __future__ import annotations

import itertools
from collections.abc import Iterable
from typing import Annotated, Any

from pydantic import AfterValidator, BaseModel, ConfigDict, Field, Strict

Number = Annotated[float, Strict()]
"""A number, not text that looks like one and not true or false."""
Integer = Annotated[int, Strict()]
Flag = Annotated[bool, Strict()]


def one_line(path: str) -> str:
    """The path of a file; ValueError for what cannot be one."""
    if "\0" in path or "\n" in path:
        raise ValueError("must be the path of a file")
    return path


FilePath = Annotated[str, AfterValidator(one_line)]


def increase(values: Iterable[Any]) -> bool:
    """Whether each of the values is larger than the one before."""
    return all(a < b for a, b in itertools.pairwise(values))


class Section(BaseModel):
    """One mapping of a climate or a configuration."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False, validate_default=True)


def key(default: Any, help: str, *, unit: str = "", **limits: Any) -> Any:
    """A key of a section: its default, its unit, one line of help, and limits such as `ge`, `le`, `min_length`.

    Without a unit (text, switches, choices, sections) pass none; a pure number has the unit "1".
    """
    made = {"default_factory": default} if callable(default) else {"default": default}
    return Field(**made, description=help, json_schema_extra={"unit": unit} if unit else None, **limits)
