"""Options that several commands have."""

from __future__ import annotations

import re
from collections.abc import Iterable
from typing import Any

import typer


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
