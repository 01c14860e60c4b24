"""The search: points of the space of settings, from good ones on, with those given up early that cannot matter.

Every other point is a neighbour of one on the frontier; the rest are proposed by optuna's multi-objective
tree-structured Parzen estimator from those measured so far (Ozaki et al. 2022, https://doi.org/10.1613/jair.1.13188).
A point is measured on one scene after another, the cheapest first, and given up as soon as another point was both
faster and better on all scenes seen by more than MARGIN.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np

from twilight.base.errors import TwilightError
from twilight.base.extras import is_installed, missing
from twilight.base.progress import Progress, part_of, silent
from twilight.studies.frontier.measure import Measurement
from twilight.studies.frontier.space import ZONES, Space, Values

if TYPE_CHECKING:
    import optuna

MARGIN = 1.06
"""Factor in error and in time by which a point must be beaten before it is given up: times of a busy computer are
uncertain by about as much."""
STARTUP_POINTS = 10
"""Points measured before proposals follow from them."""
LEAST_ERROR_PERCENT = 0.02
"""Smallest error [%] that counts: below it, differences from the reference are rounding."""


class JudgedScene(Protocol):
    """A scene that settings are tried on; `measure.ZonesScene` is one."""

    @property
    def name(self) -> str: ...

    @property
    def physics(self) -> Any:
        """The scene's own settings, from which come those that are not searched."""

    def measure(self, settings: Any) -> Measurement: ...

    def warm_up(self) -> None:
        """Have everything loaded and compiled before the clock runs."""


@dataclass
class Point:
    """Settings that were tried: where they come from, and what was measured on each scene by its name."""

    values: Values
    origin: str
    found: dict[str, Measurement] = field(default_factory=dict)
    complete: bool = False

    @property
    def error_percent(self) -> float:
        """Root mean square of the scenes' largest errors [%]."""
        return math.sqrt(sum(m.worst_percent**2 for m in self.found.values()) / len(self.found))

    @property
    def processor_s(self) -> float:
        """Geometric mean of the scenes' processor times [s]."""
        return math.exp(sum(math.log(m.processor_s) for m in self.found.values()) / len(self.found))

    @property
    def peak_mib(self) -> float:
        """Most memory that the process held on any scene [MiB]."""
        return max(m.peak_mib for m in self.found.values())

    def on(self, names: Sequence[str]) -> Point:
        """The point as it stands on some of the scenes."""
        return replace(self, found={name: self.found[name] for name in names})


def frontier(points: Sequence[Point]) -> list[Point]:
    """The complete points that no other beats in both error and time, the fastest first."""
    best: list[Point] = []
    for point in sorted((p for p in points if p.complete), key=lambda p: (p.processor_s, p.error_percent)):
        if not best or point.error_percent < best[-1].error_percent:
            best.append(point)
    return best


def check_installed() -> None:
    """TwilightError with the command that installs it, where optuna is missing."""
    if not is_installed("optuna"):
        raise missing("optuna", "searching for the frontier")


def search(
    scenes: Sequence[JudgedScene],
    starts: Mapping[str, Any],
    *,
    budget_s: float,
    most_points: int,
    longest_s: float = math.inf,
    known: Sequence[Point] = (),
    seed: int = 0,
    space: Space = ZONES,
    progress: Progress = silent,
) -> Iterator[Point]:
    """Measure the starts, then what the search proposes, and give every point as it is done or given up.

    Parameters
    ----------
    scenes
        Scenes to be served by the same settings, each of another name.
    starts
        Settings to begin with, by name.
    budget_s
        Processor seconds after which no new point is begun; the starts are measured in any case.
    most_points
        Points that are tried at most, those known and the starts among them.
    longest_s
        A point whose processor time on the scenes so far is more than this in the mean is given up.
    known
        Points of an earlier search of the same scenes, which this one goes on from.
    space
        What is searched, of the solver whose settings the starts are.
    """
    import optuna  # optional

    names = [scene.name for scene in scenes]
    if len(set(names)) < len(names):
        raise TwilightError(f"{max(names, key=names.count)}: is given twice")
    if scenes:
        scenes[0].warm_up()
    optuna.logging.set_verbosity(optuna.logging.ERROR)
    sampler = optuna.samplers.TPESampler(seed=seed + len(known), n_startup_trials=STARTUP_POINTS, multivariate=True)
    study = optuna.create_study(directions=["minimize", "minimize"], sampler=sampler)
    done = list(known)
    for point in done:
        study.add_trial(_trial(point, space))
    order, spent = _cheapest_first(scenes, done), 0.0
    left = [name for name in starts if name not in {point.origin for point in done}]
    for number in range(len(done), most_points):
        origin = left.pop(0) if left else "search"
        if origin == "search" and spent >= budget_s:
            break
        rng = np.random.default_rng([seed, number])
        if origin != "search":
            study.enqueue_trial(space.within(space.values_of(starts[origin])))
        elif number % 2 and (best := frontier(done)):
            study.enqueue_trial(space.neighbour(best[rng.integers(len(best))].values, rng))
        trial = study.ask()
        point = Point(space.within({d.key: _suggest(trial, d) for d in space.dimensions}), origin)
        tell = part_of(progress, min(spent / max(budget_s, 1.0), 0.99), 0.0, f"point {number + 1}:")
        for scene in order:
            tell(scene.name, 0.0)
            point.found[scene.name] = scene.measure(space.settings_at(point.values, scene.physics))
            spent += point.found[scene.name].processor_s
            if point.processor_s > longest_s or (origin == "search" and _beaten(point, done)):
                break
        point.complete = len(point.found) == len(scenes)
        if point.complete:
            study.tell(trial, _objectives(point))
        else:
            study.tell(trial, state=optuna.trial.TrialState.PRUNED)
        done.append(point)
        order = _cheapest_first(scenes, done)
        yield point


def _cheapest_first(scenes: Sequence[JudgedScene], done: Sequence[Point]) -> list[JudgedScene]:
    """The scenes by processor time at the first point that was measured on all."""
    first = next((point for point in done if point.complete), None)
    return list(scenes) if first is None else sorted(scenes, key=lambda scene: first.found[scene.name].processor_s)


def _objectives(point: Point) -> list[float]:
    return [math.log(point.processor_s), math.log(max(point.error_percent, LEAST_ERROR_PERCENT))]


def _trial(point: Point, space: Space) -> optuna.trial.FrozenTrial:
    """What optuna knows of a point measured earlier."""
    import optuna  # optional

    Int, Float = optuna.distributions.IntDistribution, optuna.distributions.FloatDistribution
    return optuna.trial.create_trial(
        params=dict(point.values),
        distributions={
            d.key: Int(int(d.low), int(d.high)) if d.whole else Float(d.low, d.high, log=True) for d in space.dimensions
        },
        values=_objectives(point) if point.complete else None,
        state=optuna.trial.TrialState.COMPLETE if point.complete else optuna.trial.TrialState.PRUNED,
    )


def _beaten(point: Point, done: Sequence[Point]) -> bool:
    """Whether a complete point was faster and better on the scenes that this one has been measured on."""
    names = list(point.found)
    return any(
        other.processor_s * MARGIN < point.processor_s and other.error_percent * MARGIN < point.error_percent
        for other in (p.on(names) for p in done if p.complete)
    )


def _suggest(trial, dimension) -> float:
    if dimension.whole:
        return trial.suggest_int(dimension.key, int(dimension.low), int(dimension.high))
    return trial.suggest_float(dimension.key, dimension.low, dimension.high, log=True)
