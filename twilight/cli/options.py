"""Options that several commands have."""

from __future__ import annotations

import re
from collections.abc import Iterable
from typing import Any

import typer

from twilight.errors import TwilightError


def option(metavar: str, help: str, *names: str) -> Any:
    return typer.Option(*names, metavar=metavar, help=help)


def settings_of(texts: Iterable[str] | None) -> tuple[dict[str, Any], dict[str, str]]:
    """The values of `--set KEY=VALUE` by dotted key, and what to call each in errors.

    Errors: TwilightError for a text that is not KEY=VALUE.
    """
    from twilight.config.load import parse_setting

    chosen = dict(parse_setting(text) for text in texts or ())
    return chosen, {key: f"--set {key}" for key in chosen}


def file_stem(text: str, otherwise: str) -> str:
    """A text as part of a file's name."""
    return re.sub(r"[^\w.+-]+", "-", text).strip("-.") or otherwise


def numbers(text: str, option: str, low: float, high: float) -> list[float]:
    """Numbers with commas between them, each once; TwilightError for anything else."""
    try:
        values = [float(part) for part in text.split(",")]
    except ValueError:
        raise TwilightError(f"{option}: {text} must be numbers with commas between them, e.g. 5,0,-6") from None
    for value in values:
        within(value, option, low, high)
    return list(dict.fromkeys(values))


def within(value: float, option: str, low: float, high: float) -> None:
    """TwilightError for a value of an option that is not between the two."""
    if not low <= value <= high:
        raise TwilightError(f"{option}: {value:g} is not allowed; it must be from {low:g} to {high:g}")
