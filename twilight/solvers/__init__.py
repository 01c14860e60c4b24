"""The solvers by name; each is imported when it is used.  What a solver is, and how to add one: `solvers.base`."""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, cast

if TYPE_CHECKING:
    from twilight.solvers.base import Solver

SOLVERS: dict[str, str] = {
    "cells": "twilight.solvers.cells",
    "montecarlo": "twilight.solvers.montecarlo",
    "zones": "twilight.solvers.zones",
    "tables": "twilight.solvers.tables",
    "compact": "twilight.solvers.compact",
    "preetham": "twilight.solvers.analytic.preetham",
    "cie": "twilight.solvers.analytic.cie",
    "sunsky": "twilight.solvers.analytic.sunsky",
    "sasktran2": "twilight.solvers.sasktran2",
}
DEFAULT = "zones"


def load(name: str) -> Solver:
    """The module of a solver; KeyError when there is none of that name."""
    return cast("Solver", import_module(SOLVERS[name]))


def installed() -> list[str]:
    """Names of the solvers for which all is there that they need."""
    return [name for name in SOLVERS if load(name).CAPABILITIES.installed]
