"""The solvers by name; each is imported when it is used.

A solver is a module with `prepare(medium, settings, *, observer_altitude_km=0.0, progress=None) -> Field`, where
`Field.radiance(sun_elevation_deg, elevation_deg, azimuth_deg)` gives the sun-normalised radiance [sr^-1], and with
`QUALITIES`: the names of its presets and their frozen settings.  `progress(doing, share)` takes a few words and the
share of this call's work that is done, 0 to 1.  A solver with a standard error has `Field.radiance_with_error`, whose
result has `radiance` and `standard_error`.  A module with `TAKES_SUNS` has a `prepare` that also takes
`sun_elevations_deg`, all the suns that will be asked for, and computes only what they need; one with `WAVELENGTH_BLOCK`
says how many wavelengths it takes at once.
"""

from __future__ import annotations

from importlib import import_module
from importlib.util import find_spec
from types import ModuleType

SOLVERS: dict[str, str] = {
    "cells": "twilight.solvers.cells",
    "montecarlo": "twilight.solvers.montecarlo",
    "zones": "twilight.solvers.zones",
    "tables": "twilight.solvers.tables",
    "preetham": "twilight.solvers.analytic.preetham",
    "cie": "twilight.solvers.analytic.cie",
    "sunsky": "twilight.solvers.analytic.sunsky",
    "sasktran2": "twilight.solvers.sasktran2",
}
NEEDS = {"sunsky": "mitsuba", "sasktran2": "sasktran2"}
"""Programs of others, which the extra `peers` installs."""
DEFAULT = "zones"


def load(name: str) -> ModuleType:
    """The module of a solver; KeyError when there is none of that name."""
    return import_module(SOLVERS[name])


def installed(name: str) -> bool:
    """Whether what the solver needs is there."""
    return name not in NEEDS or find_spec(NEEDS[name]) is not None
