"""Error against time where a user decides: a scene by its solver's qualities, and by the fitted model of clear air."""

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from twilight import solvers
from twilight.base.errors import TwilightError
from twilight.engine.problem import SceneCost, full_cost
from twilight.scene import Scene

MODEL = "compact"
"""The solver that answers at once where its air is that of the scene."""
MODEL_WAVELENGTHS = 8
"""Wavelengths of a scene at which the model is asked for its error, spread evenly; it hardly depends on how many."""


@dataclass(frozen=True)
class Choice:
    """A solver at a quality, and whether it is the scene's own.

    error: fraction that 95 % of radiances are expected to stay within under the lowest of the suns; infinite where it
    was not measured in such air, None where the solver does not say
    cost: None where it does not serve the scene; reason: then why, in a sentence
    """

    solver: str
    quality: str
    chosen: bool
    error: float | None = None
    cost: SceneCost | None = None
    reason: str = ""


def choices(scene: Scene) -> Iterator[Choice]:
    """A scene as it is, by the other qualities of its solver, and by the model.

    Other qualities keep the options of the scene's, but for a target error and those of experts.
    """
    config = scene.configuration
    name, quality, settings = config.chosen_solver
    target = getattr(settings, "target_error", 0.0)
    apart = ("name", "quality", "expert", "target_error")
    options = {key: value for key, value in config.solver.items() if key not in apart}
    asked: list[tuple[str, str, dict[str, Any], bool]] = []
    if target:
        asked.append((name, f"to {target:g}", config.solver, True))
    for one in solvers.load(name).QUALITIES:
        chosen = one == quality and not target
        asked.append((name, one, config.solver if chosen else {"name": name, "quality": one, **options}, chosen))
    if name != MODEL:
        asked.append((MODEL, "standard", {"name": MODEL}, False))
    for solver, label, section, chosen in asked:
        other = config.model_copy(update={"solver": section})
        try:
            made = replace(scene, solver=solvers.load(solver), settings=other.chosen_solver[2], config=other)
            yield Choice(solver, label, chosen, expected_error(made), full_cost(made))
        except TwilightError as error:
            yield Choice(solver, label, chosen, reason=str(error))


def expected_error(scene: Scene) -> float | None:
    """Error [fraction] that 95 % of a scene's radiances are expected to stay within; infinite, None: as of `Choice`."""
    say = scene.capabilities.expected_error
    if say is None:
        return None
    medium, n = scene.medium, scene.medium.n_wavelengths
    if scene.capabilities.kind == "fitted" and n > MODEL_WAVELENGTHS:
        medium = medium.select(np.linspace(0, n - 1, MODEL_WAVELENGTHS).round().astype(int))
    return say(medium, scene.settings, min(scene.sun_elevations_deg, default=-math.inf), scene.altitude_km)
