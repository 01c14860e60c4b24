"""The compact model of a scene's own air: the one that comes with twilight, one fitted before, or one fitted now.

A scene that asks for the solver `compact` and names no model gets the shipped model where its air is that model's, else
the model of its climate from the user's cache, where it is fitted on first use.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from twilight.base import cache
from twilight.base.digest import code_digest
from twilight.base.errors import TwilightError
from twilight.base.progress import Progress
from twilight.config.climate import Climate
from twilight.config.load import load
from twilight.config.scene import Config
from twilight.io.provenance import configuration_hash
from twilight.scene import resolve
from twilight.solvers.compact.compact_sky import CompactSky
from twilight.solvers.compact.field import SHIPPED, CompactSettings
from twilight.solvers.compact.recognise import OtherAir, recognise
from twilight.studies.fit.compact.build import fit_compact, write_model

FITTED_BY = {"name": "zones", "quality": "draft", "polarisation": True}
"""Solver, quality and settings by which an own model is fitted: those of the shipped models."""


def needs_fit(config: Config) -> bool:
    """Whether a scene asks for the compact model of an air of which there is none yet.

    Errors: TwilightError for what no model would serve: loads, ozone columns, wavelengths and observers.
    """
    return _needs_own(config) and cache.find(cache.MODELS, _key(config.climate)) is None


def with_own_model(
    config: Config, progress: Progress | None = None, say: Callable[[str], None] = lambda sentence: None
) -> Config:
    """The configuration with the model of its own air, fitted first where there is none; others as they are.

    say: receives sentences: that a model is fitted, and how far it is off.  Errors: as `needs_fit` and `fit_compact`.
    """
    if not _needs_own(config):
        return config
    key = _key(config.climate)
    path = cache.find(cache.MODELS, key)
    if path is None:
        if cache.limit_bytes() == 0.0:
            raise TwilightError(
                f"the compact model of {config.climate.name} would be fitted and cached, and {cache.LIMIT_VARIABLE} is "
                "0; fit it with twilight fit compact, and name its file as solver.model"
            )
        say(waiting(config))
        fit = fit_compact(_fitted(config.climate), progress=progress)
        path = cache.store(cache.MODELS, key, lambda to: write_model(fit.model, to))
        if path is None:
            raise TwilightError(f"{cache.cache_folder()}: the compact model cannot be written")
        whole = next(e for e in fit.errors if e.part == "all")
        say(
            f"the compact model of {config.climate.name} took {fit.cpu_s / 60.0:.1f} minutes of processor time; skies "
            f"that it was not fitted to are off by {100 * whole.median:.2g} % (median), {100 * whole.p95:.2g} % (95 %)"
        )
    return load(config.model_dump(mode="json", exclude_none=True, exclude_unset=True), {"solver.model": str(path)})


def waiting(config: Config) -> str:
    """A sentence on how long the fit takes, by what that of the shipped model took."""
    took = CompactSky.load(SHIPPED / f"{CompactSettings().model}.npz").provenance["cpu_minutes"]
    return (
        f"there is no compact model of {config.climate.name} yet: it is fitted once and cached (twilight cache), which "
        f"takes about {took:.0f} minutes of processor time, beside coarse particles more"
    )


def _needs_own(config: Config) -> bool:
    if config.chosen_solver.name != "compact" or "model" in config.solver:
        return False
    name = CompactSettings().model
    try:
        recognise(resolve(config).medium, CompactSky.load(SHIPPED / f"{name}.npz"), name)
    except OtherAir:
        return True
    return False


def _fitted(climate: Climate) -> Config:
    """The configuration that a climate's model is fitted to: what it is a function of is as in every other."""
    data = climate.model_dump(mode="json", exclude_none=True, exclude_unset=True)
    data.get("aerosol", {}).pop("optical_depth_550nm", None)
    data.get("ground", {}).pop("albedo", None)
    for key in ("column_du", "day_of_year"):
        data.get("gases", {}).get("ozone", {}).pop(key, None)
    return load(
        {"version": 1, "climate": data, "solver": FITTED_BY},
        {"observer.altitude_km": climate.ground.altitude_km},
    )


def _key(climate: Climate) -> str:
    code = code_digest("twilight.studies.fit.compact.build", "twilight.solvers.zones")
    about: list[Any] = [code, _fitted(climate).model_dump(mode="json")]
    return configuration_hash(about)
