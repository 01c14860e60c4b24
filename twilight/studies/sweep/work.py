"""What a worker of a sweep does: the skies of one field."""

from __future__ import annotations

import itertools
import math
import os
import threading
import time
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from twilight import solvers
from twilight.base.digest import DISPLAY, code_digest
from twilight.base.errors import TwilightError
from twilight.config.scene import Config, Observer
from twilight.engine.field import Field, Part, parts
from twilight.engine.problem import plan
from twilight.scene import Scene, resolve
from twilight.solvers.analytic.daylight import turbidity_of

RADIANCE = "sun_normalised_radiance"
DIRECT = "direct_irradiance_factor"
BENDING = "solar_bending"
STANDARD_ERROR = "standard_error"
STOKES = (f"{RADIANCE}_q", f"{RADIANCE}_u")
STOKES_ERROR = ("standard_error_q", "standard_error_u")

Chunk = tuple[range, ...]
"""A chunk of the dataset: its indices along each dimension of the sweep."""


@dataclass(frozen=True)
class Task:
    """Chunks that are computed from one field.  key: a hash of all that they depend on."""

    key: str
    field_key: str
    chunks: tuple[Chunk, ...]

    @property
    def skies(self) -> int:
        """How many skies it computes."""
        return sum(math.prod(map(len, chunk)) for chunk in self.chunks)

    def scenes(self) -> Iterator[tuple[int, ...]]:
        """The index of each of its skies, chunk by chunk."""
        return itertools.chain.from_iterable(itertools.product(*chunk) for chunk in self.chunks)


@dataclass(frozen=True)
class TaskResult:
    """The skies of a task, n of them in its order.

    arrays: float32 by variable: sun-normalised radiance [sr^-1] and its layers (n, E, A, W), irradiance of the sunbeam
    over F0 (n, W), apparent minus true elevation of the sun [deg] (n,); refused: the solver's sentence about each sky
    that it refuses, by position, whose values are NaN; turbidity: of the air, NaN where it has none.
    """

    arrays: dict[str, np.ndarray]
    refused: dict[int, str]
    turbidity: float
    cpu_s: float
    wall_s: float


_ONE_AT_A_TIME = threading.Lock()
"""A worker with several threads computes one field at a time, with all of them."""
_last_scene: dict[str, tuple[Scene, float]] = {}
"""The scene of the field of the last task, and the turbidity of its air."""
_last_field: dict[str, Field] = {}
"""The field of the wavelengths that were solved last: several tasks may ask it for suns."""


def code_of(solver: str) -> str:
    """SHA-256 over the code and data that the skies of a sweep with this solver depend on."""
    return code_digest("twilight.studies.sweep.work", solvers.SOLVERS[solver], without=DISPLAY)


def compute(payload: dict[str, Any], threads: int | None = None) -> TaskResult:
    """Compute a task, as `Sweep.payload` describes it, on `threads` threads (default: those of this Dask worker).

    Errors: TwilightError where this worker's program is not the one that planned the task.  A scene that the solver
    refuses is no error but part of the result.
    """
    if payload["code"] != code_of(payload["config"].get("solver", {}).get("name", solvers.DEFAULT)):
        raise TwilightError("the program or its data on this worker differ from those that started the sweep")
    with _ONE_AT_A_TIME:
        _set_threads(threads)
        cpu, wall = time.process_time(), time.perf_counter()
        arrays, refused, turbidity = _skies(payload)
        return TaskResult(arrays, refused, turbidity, time.process_time() - cpu, time.perf_counter() - wall)


def forget() -> None:
    """Let go of the field that this process holds."""
    _last_scene.clear()
    _last_field.clear()


def _set_threads(threads: int | None) -> None:
    import numba  # start-up

    most = int(numba.config.NUMBA_NUM_THREADS)  # type: ignore[attr-defined]  # made when numba is loaded
    if threads is None:
        threads = most
        if "NUMBA_NUM_THREADS" not in os.environ:
            from distributed import get_worker  # optional

            threads = get_worker().state.nthreads
    numba.set_num_threads(max(1, min(threads, most)))


def _skies(payload: dict[str, Any]) -> tuple[dict[str, np.ndarray], dict[int, str], float]:
    skies: list[tuple[float, float]] = payload["skies"]
    directions = payload["elevation_deg"], payload["azimuth_deg"]
    nm = payload["wavelength_nm"]
    grid = (*(angles.size for angles in directions), nm.size)
    shapes = dict.fromkeys((RADIANCE, *payload["layers"]), grid) | {DIRECT: grid[2:], BENDING: ()}
    arrays = {name: np.full((len(skies), *shape), np.nan, np.float32) for name, shape in shapes.items()}
    refused: dict[int, str] = {}
    turbidity = math.nan
    try:
        scene, turbidity = _scene_of(payload)
        for part in parts(plan(replace(scene, observer=Observer(altitude_km=skies[0][1])))):
            field = _solved(f"{payload['field_key']} {part.wavelengths.start}", part)
            for i, (sun, altitude) in enumerate(skies):
                if i in refused:
                    continue
                try:
                    for name, values in _variables(*field.samples(sun, *directions, altitude)):
                        arrays[name][i, ..., part.wavelengths] = values
                    arrays[DIRECT][i, part.wavelengths], arrays[BENDING][i] = field.direct(sun, altitude)
                except TwilightError as error:
                    refused[i] = str(error)
    except TwilightError as error:  # of the air or of the solver's preparation: no scene of this field can be done
        refused = dict.fromkeys(range(len(skies)), str(error))
    for values in arrays.values():  # refused at some wavelengths is refused at all
        values[list(refused)] = np.nan
    return arrays, refused, turbidity


def _scene_of(payload: dict[str, Any]) -> tuple[Scene, float]:
    key = payload["field_key"]
    if key not in _last_scene:
        _last_scene.clear()
        scene = resolve(Config.model_validate(payload["config"]), wavelength_nm=payload["wavelength_nm"])
        turbidity = math.nan
        with suppress(TwilightError):  # no air, no turbidity
            turbidity = turbidity_of(scene.medium)
        _last_scene[key] = scene, turbidity
    return _last_scene[key]


def _solved(key: str, part: Part) -> Field:
    if key not in _last_field:
        _last_field.clear()  # first, so that two fields are never held
        _last_field[key] = part.solve()
    return _last_field[key]


def _variables(stokes: np.ndarray, error: np.ndarray | None) -> Iterator[tuple[str, np.ndarray]]:
    """What samples (E, A, S, W) hold, arrays (E, A, W), by the names of the dataset's variables; S is 1 or 3."""
    for values, names in ((stokes, (RADIANCE, *STOKES)), (error, (STANDARD_ERROR, *STOKES_ERROR))):
        if values is not None:
            yield from zip(names[: values.shape[2]], np.moveaxis(values, 2, 0), strict=True)
