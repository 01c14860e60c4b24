"""Box air-mass factors of one air or of many, on as many processes as there are.

Every air of a series is a task.  Where a solver estimates standard errors, and there are more processes than airs, each
air is divided into parts with random numbers of their own; the mean of n parts has the error sqrt(sum of squares) / n.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from twilight import solvers
from twilight.base.errors import TwilightError
from twilight.base.progress import Progress, part_of
from twilight.config.climate import climate_files
from twilight.config.load import Series
from twilight.config.scene import Config
from twilight.config.vary import DRAWS, LIST
from twilight.engine import Problem
from twilight.scene import resolve
from twilight.studies.airmass import factors
from twilight.studies.sweep.dimensions import variable_name

if TYPE_CHECKING:
    from distributed import Client
    from xarray import Dataset


@dataclass(frozen=True)
class Question:
    """Suns (S,), line of sight [deg] and altitudes [km] that bound the layers, None for the usual ones."""

    sun_elevation_deg: tuple[float, ...]
    elevation_deg: float
    azimuth_deg: float
    edges_km: tuple[float, ...] | None


def box_table(
    series: Series, question: Question, progress: Progress, client: Client | None = None, workers: int = 1
) -> Dataset:
    """Box air-mass factors of every air of a series, over its axes and the dimensions of `factors.box_factors`.

    client: of Dask, with so many workers; None: this process computes.
    Errors: TwilightError for an air whose layers are not those of the others, and whatever a solver refuses.
    """
    points = list(itertools.product(*(axis.points for axis in series.axes)))
    configs = [series.config({k: v for part in point for k, v in part.items()}) for point in points]
    n_parts = [max(1, math.ceil(workers / len(configs))) if _estimates(config) else 1 for config in configs]
    tasks = [part for config, n in zip(configs, n_parts, strict=True) for part in parts_of(config, n)]
    if client is None:
        done = [
            compute(task, question, part_of(progress, i / len(tasks), 1.0 / len(tasks))) for i, task in enumerate(tasks)
        ]
    else:
        done = client.gather(client.map(compute, tasks, question=question, pure=False))
    found = iter(done)
    airs = [merged(list(itertools.islice(found, n))) for n in n_parts]
    return _joined(series, airs)


def compute(config: dict[str, Any], question: Question, progress: Progress | None = None) -> Dataset:
    """Box air-mass factors of one configuration, as JSON has it."""
    scene = resolve(Config.model_validate(config))
    solved = Problem(scene, question.sun_elevation_deg).solve(progress)
    return factors.box_factors(
        solved, question.sun_elevation_deg, question.elevation_deg, question.azimuth_deg, edges_km=question.edges_km
    )


def _estimates(config: Config) -> bool:
    return bool(solvers.load(config.chosen_solver[0]).CAPABILITIES.standard_error)


def parts_of(config: Config, n: int) -> list[dict[str, Any]]:
    """n configurations whose estimates are independent, and together as good as that of the whole."""
    whole = config.model_dump(mode="json", exclude_unset=True)
    for section, _, name, _ in climate_files(whole["climate"]):  # a worker may run in another folder
        section[name] = str(Path(section[name]).absolute())
    if n == 1:
        return [whole]
    settings = config.chosen_solver[2]
    target = settings.target_stderr
    of_part = {
        "target_stderr": None if target is None else min(1.0, target * math.sqrt(n)),
        "samples": max(2, math.ceil(settings.samples / n)),
    }
    solver = whole["solver"]
    expert = {**solver.get("expert", {}), "max_samples": max(2, math.ceil(settings.max_samples / n))}
    return [{**whole, "solver": {**solver, **of_part, "expert": expert, "seed": settings.seed + k}} for k in range(n)]


def merged(parts: Sequence[Dataset]) -> Dataset:
    """The mean of independent estimates of one air, with its standard error."""
    if len(parts) == 1:
        return parts[0]
    made = parts[0].copy()
    made["box_air_mass_factor"] = sum(part["box_air_mass_factor"] for part in parts) / len(parts)
    made["box_air_mass_factor"].attrs = parts[0]["box_air_mass_factor"].attrs
    squares = sum(part["standard_error"] ** 2 for part in parts)
    made["standard_error"] = np.sqrt(squares) / len(parts)
    made["standard_error"].attrs = parts[0]["standard_error"].attrs
    return made


def _joined(series: Series, airs: list[Dataset]) -> Dataset:
    """The datasets of all airs along the axes of their series, whose last one changes fastest."""
    import xarray  # start-up

    for air in airs[1:]:
        if not np.array_equal(air["altitude_bnds"].values, airs[0]["altitude_bnds"].values):
            raise TwilightError("airmass: the airs of the table begin or end at other altitudes; give --layers")
    estimated = [name for name in airs[0].data_vars if name != "altitude_bnds"]
    found = airs
    for axis in reversed(series.axes):
        size = len(axis.points)
        name = {LIST: "scene", DRAWS: "draw"}.get(axis.name) or variable_name(axis.name)
        single = all(len(point) == 1 for point in axis.points)
        values = [next(iter(point.values())) for point in axis.points] if single else list(axis.labels)
        if not all(isinstance(value, int | float) for value in values):
            values = list(axis.labels)
        along = xarray.DataArray(values, dims=name, name=name)
        found = [
            xarray.concat(found[i : i + size], along, data_vars=estimated, coords="minimal", compat="override")
            for i in range(0, len(found), size)
        ]
        for one in found:
            one.attrs = airs[0].attrs
    return found[0]
