"""Options that several commands have."""

from __future__ import annotations

import re
from collections.abc import Iterable
from typing import TYPE_CHECKING, Any

import typer

from twilight.base.errors import TwilightError

if TYPE_CHECKING:
    from twilight.config import Config

MOST = 1000
"""Most numbers of a range."""


def option(metavar: str, help: str, *names: str) -> Any:
    return typer.Option(*names, metavar=metavar, help=help)


def climate_names(incomplete: str) -> list[str]:
    """Names that the shell completes for a climate."""
    return _starting("climates", incomplete)


def config_names(incomplete: str) -> list[str]:
    """Names that the shell completes for a configuration."""
    return _starting("configs", incomplete)


def scene_names(incomplete: str) -> list[str]:
    """Names that the shell completes for a scene."""
    return climate_names(incomplete) + config_names(incomplete)


def solver_names(incomplete: str) -> list[str]:
    """Names that the shell completes for a solver."""
    from twilight.solvers import SOLVERS

    return [name for name in SOLVERS if name.startswith(incomplete)]


def _starting(kind: str, incomplete: str) -> list[str]:
    from twilight.config.library import shipped

    return [name for name in shipped(kind) if name.startswith(incomplete)]


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


def check_polarised(config: Any) -> None:
    """Raise TwilightError, before anything is computed, where what is to be written needs polarised light."""
    from twilight import solvers
    from twilight.base.formats import WHERE_POLARISED

    wanted = [f"output.files: {name}" for name in config.output.files or () if name in WHERE_POLARISED]
    if config.output.polariser_deg is not None:
        wanted.append("output.polariser_deg")
    name, quality, settings = config.chosen_solver
    if wanted and not (solvers.load(name).CAPABILITIES.stokes and settings.polarisation):
        able = ", ".join(n for n in solvers.SOLVERS if solvers.load(n).CAPABILITIES.stokes)
        raise TwilightError(
            f"{config.title}: {wanted[0]} needs polarised light, and {name} ({quality}) computes none; set "
            f"solver.polarisation: true with one of {able}"
        )


def numbers(text: str, option: str, low: float, high: float) -> list[float]:
    """Numbers with commas between them, each once; TwilightError for anything else."""
    try:
        values = [float(part) for part in text.split(",")]
    except ValueError:
        raise TwilightError(f"{option}: {text} must be numbers with commas between them, e.g. 5,0,-6") from None
    for value in values:
        within(value, option, low, high)
    return list(dict.fromkeys(values))


def numbers_or_range(text: str, option: str, low: float, high: float) -> list[float]:
    """Numbers of `first:last:step`, or with commas between them; TwilightError for anything else, and above MOST."""
    if ":" not in text:
        return numbers(text, option, low, high)
    try:
        first, last, step = (float(part) for part in text.split(":"))
    except ValueError:
        raise TwilightError(f"{option}: {text} must be first:last:step, e.g. 80:96:0.5") from None
    for value in (first, last):
        within(value, option, low, high)
    if not (step > 0.0 and last >= first and (last - first) / step < MOST):
        raise TwilightError(f"{option}: {text} must go up by a step above 0, to at most {MOST} numbers")
    return [first + k * step for k in range(int((last - first) / step + 1e-6) + 1)]


def one_config(scene: str, chosen: dict[str, Any], names: dict[str, str], command: str) -> Config:
    """The configuration of a command that takes one scene; TwilightError for a series of them."""
    from twilight.config import load_series

    cases = load_series(scene, chosen, names)
    if len(cases) > 1:
        raise TwilightError(f"{scene}: is a series of {len(cases)} scenes (vary); {command} takes one")
    return cases[0].config


def within(value: float, option: str, low: float, high: float) -> None:
    """TwilightError for a value of an option that is not between the two."""
    if not low <= value <= high:
        raise TwilightError(f"{option}: {value:.10g} is not allowed; it must be from {low:g} to {high:g}")
