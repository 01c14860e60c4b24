"""The solvers by name; each is imported when it is used.  What a solver is: `solvers.base`.

Another package adds one by an entry point of the group `twilight.solvers`, whose value is the solver's module
(docs/examples/extension).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from twilight.base.errors import TwilightError
from twilight.base.registry import Registry

if TYPE_CHECKING:
    from twilight.solvers.base import Solver

SOLVERS = Registry(
    "twilight.solvers",
    {
        "cells": "twilight.solvers.cells",
        "montecarlo": "twilight.solvers.montecarlo",
        "zones": "twilight.solvers.zones",
        "tables": "twilight.solvers.tables",
        "compact": "twilight.solvers.compact",
        "preetham": "twilight.solvers.analytic.preetham",
        "cie": "twilight.solvers.analytic.cie",
        "sunsky": "twilight.solvers.analytic.sunsky",
        "sasktran2": "twilight.solvers.sasktran2",
    },
)
DEFAULT = "zones"


def load(name: str) -> Solver:
    """The module of a solver.

    Errors: KeyError for a name that no solver has; TwilightError for another package's module that is no solver.
    """
    module: Solver = SOLVERS.load(name)
    lacks = [part for part in ("CAPABILITIES", "QUALITIES", "prepare") if not hasattr(module, part)]
    if lacks:
        raise TwilightError(f"{name}: {SOLVERS[name]} is no solver; it lacks {', '.join(lacks)}")
    return module


def installed() -> list[str]:
    """Names of the solvers for which all is there that they need."""
    return [name for name in SOLVERS if load(name).CAPABILITIES.installed]


def with_option(option: str) -> list[str]:
    """Names of the solvers whose settings have an option."""
    return [name for name in SOLVERS if hasattr(load(name).QUALITIES["standard"], option)]
