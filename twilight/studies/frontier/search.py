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

import numpy as np

from twilight.base.errors import TwilightError
from twilight.base.extras import is_installed, missing
from twilight.base.progress import Progress, part_of, silent
from twilight.solvers.zones.settings import ZonesSettings
from twilight.studies.frontier.measure import Case, Measurement
from twilight.studies.frontier.space import SPACE, Values, neighbour, settings_at, values_of, within

MARGIN = 1.15
"""Factor in error and in time by which a point must be beaten before it is given up: times of a busy computer are
uncertain by about as much."""
STARTUP_POINTS = 10
"""Points measured before proposals follow from them."""
ON_BOUND = 0.02
"""Smallest error [%] that counts: below it, differences from the reference are rounding."""


@dataclass
class Point:
    """Settings that were tried: where they come from, and what they came to on each scene by its name."""

    values: Values
    origin: str
    found: dict[str, Measurement] = field(default_factory=dict)
    complete: bool = False

    @property
    def error_percent(self) -> float:
        """Largest error of a scene and sun [%]."""
        return max(m.worst_percent for m in self.found.values())

    @property
    def processor_s(self) -> float:
        """Geometric mean of the scenes' processor times [s]."""
        return math.exp(sum(math.log(m.processor_s) for m in self.found.values()) / len(self.found))

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
    cases: Sequence[Case],
    starts: Mapping[str, ZonesSettings],
    *,
    budget_s: float,
    most_points: int,
    seed: int = 0,
    progress: Progress = silent,
) -> Iterator[Point]:
    """Measure the starts, then what the search proposes, and give every point as it is done or given up.

    Parameters
    ----------
    cases
        Scenes to be served by the same settings; they need names of their own.
    starts
        Settings to begin with, by name.
    budget_s
        Processor seconds after which no new point is begun; the starts are measured in any case.
    most_points
        Points that are tried at most, starts among them.
    """
    import optuna  # optional

    names = [case.name for case in cases]
    if len(set(names)) < len(names):
        raise TwilightError(f"{max(names, key=names.count)}: is given twice")
    for case in cases[:1]:
        case.warm_up()
    optuna.logging.set_verbosity(optuna.logging.ERROR)
    sampler = optuna.samplers.TPESampler(seed=seed, n_startup_trials=STARTUP_POINTS, multivariate=True)
    study = optuna.create_study(directions=["minimize", "minimize"], sampler=sampler)
    for settings in starts.values():
        study.enqueue_trial(within(values_of(settings)))
    origins, rng = iter([*starts]), np.random.default_rng(seed)
    order, spent = list(cases), 0.0
    done: list[Point] = []
    while len(done) < most_points and (len(done) < len(starts) or spent < budget_s):
        if len(done) >= len(starts) and (len(done) - len(starts)) % 2 == 0:
            best = frontier(done)
            study.enqueue_trial(neighbour(best[rng.integers(len(best))].values, rng))
        trial = study.ask()
        point = Point(within({d.key: _suggest(trial, d) for d in SPACE}), next(origins, "search"))
        tell = part_of(progress, min(spent / budget_s, 0.99), 0.0, f"point {len(done) + 1}:")
        for case in order:
            tell(case.name, 0.0)
            point.found[case.name] = case.measure(settings_at(point.values, case.physics))
            spent += point.found[case.name].processor_s
            if len(done) >= len(starts) and _beaten(point, done):
                break
        point.complete = len(point.found) == len(cases)
        if point.complete:
            error = max(point.error_percent, ON_BOUND)
            study.tell(trial, [math.log(point.processor_s), math.log(error)])
        else:
            study.tell(trial, state=optuna.trial.TrialState.PRUNED)
        done.append(point)
        if len(done) == 1:
            order.sort(key=lambda case: done[0].found[case.name].processor_s)
        yield point


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
