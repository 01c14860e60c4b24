"""What a worker does: the skies of one field.

The pieces of a sweep: skies, the chunks that they lie in, and the tasks that workers are given.
"""

from __future__ import annotations

import itertools
import math
import os
import threading
import time
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from twilight import solvers
from twilight.base.digest import DISPLAY, code_digest
from twilight.base.errors import TwilightError
from twilight.config.scene import Config, Observer
from twilight.engine.field import Field, Part, parts
from twilight.engine.problem import plan
from twilight.scene import resolve
from twilight.solvers.analytic.limits import turbidity_of

STANDARD_ERROR = "standard_error"
STOKES = ("sun_normalised_radiance_q", "sun_normalised_radiance_u")
STOKES_ERROR = ("standard_error_q", "standard_error_u")


def code_of(solver: str) -> str:
    """SHA-256 over the code and data that the skies of a sweep with this solver depend on."""
    return code_digest("twilight.studies.sweep.work", solvers.SOLVERS[solver], without=DISPLAY)


@dataclass(frozen=True)
class ScenePosition:
    """Sun and observer of one sky."""

    sun_elevation_deg: float
    sun_azimuth_deg: float | None
    distance_au: float
    observer_altitude_km: float
    time_s: float | None
    name: str


@dataclass(frozen=True)
class DatasetBlock:
    """One chunk of the dataset: an index along each outer dimension, a range along each inner one."""

    index: tuple[int, ...]
    ranges: tuple[tuple[int, int], ...]

    @property
    def skies(self) -> int:
        """How many skies it holds."""
        return math.prod(stop - start for start, stop in self.ranges)

    @property
    def region(self) -> tuple[slice, ...]:
        """Where it lies in an array over the sweep's dimensions."""
        return tuple(slice(i, i + 1) for i in self.index) + tuple(slice(*r) for r in self.ranges)

    @property
    def shape(self) -> tuple[int, ...]:
        """Shape of the block in an array over the sweep's dimensions."""
        return (1,) * len(self.index) + tuple(stop - start for start, stop in self.ranges)

    def scenes(self) -> Iterator[tuple[int, ...]]:
        """The index of each of its skies."""
        return itertools.product(*((i,) for i in self.index), *(range(*r) for r in self.ranges))


@dataclass(frozen=True)
class Task:
    """What one worker computes at a time: chunks that come out of one field.  key: a hash of all it depends on."""

    key: str
    field_key: str
    blocks: tuple[DatasetBlock, ...]

    @property
    def skies(self) -> int:
        """How many skies it computes."""
        return sum(block.skies for block in self.blocks)


_ONE_AT_A_TIME = threading.Lock()
"""A worker with several threads computes one field at a time, with all of them."""
_last_field: dict[str, Field] = {}
"""The field of the block of wavelengths that was solved last: its suns may come in several tasks."""


@dataclass
class BlockResult:
    """A chunk's skies in its order: n of them.

    radiance (n, E, A, W): sun-normalised [sr^-1], float32; direct (n, W): irradiance of the sun's beam over F0;
    bending_deg (n,); more: what the field knows beside them, by the names of `layers_of`, of the radiance's shape;
    refused: the sentence of each sky that the solver cannot do, by position, whose values are NaN.
    """

    radiance: np.ndarray
    direct: np.ndarray
    bending_deg: np.ndarray
    more: dict[str, np.ndarray] = field(default_factory=dict)
    refused: dict[int, str] = field(default_factory=dict)


@dataclass(frozen=True)
class TaskResult:
    """Chunks of a task, the turbidity of their air, NaN where it has none, and the processor and wall seconds."""

    blocks: list[BlockResult]
    turbidity: float
    cpu_s: float
    wall_s: float


def compute(payload: dict[str, Any], threads: int | None = None) -> TaskResult:
    """Compute a task on `threads` threads (default: those that this Dask worker has).

    Errors: TwilightError where this worker's program is not the one that planned the task.  A scene that the solver
    refuses is no error but part of the result.
    """
    config = payload["config"].get("solver", {})
    if payload["code"] != code_of(config.get("name", solvers.DEFAULT)):
        raise TwilightError("the program or its data on this worker differ from those that started the sweep")
    with _ONE_AT_A_TIME:
        _set_threads(threads)
        begin = time.process_time(), time.perf_counter()
        fields = _Fields(payload)
        blocks = fields.blocks()
        return TaskResult(blocks, fields.turbidity, time.process_time() - begin[0], time.perf_counter() - begin[1])


def forget() -> None:
    """Let go of the field that this process holds."""
    _last_field.clear()


def _set_threads(threads: int | None) -> None:
    import numba  # start-up

    most = int(numba.config.NUMBA_NUM_THREADS)  # type: ignore[attr-defined]  # made when numba is loaded
    if threads is None:
        threads = most
        if "NUMBA_NUM_THREADS" not in os.environ:
            from distributed import get_worker  # start-up

            threads = get_worker().state.nthreads
    numba.set_num_threads(max(1, min(threads, most)))


class _Fields:
    """The fields of one climate: solved once for each block of wavelengths and, if need be, observer."""

    def __init__(self, payload: dict[str, Any]):
        self.payload = payload
        self.config = Config.model_validate(payload["config"])
        self.skies: list[list[ScenePosition]] = payload["blocks"]
        self.turbidity = math.nan

    def blocks(self) -> list[BlockResult]:
        """All chunks of the task."""
        out = [self._empty(len(skies)) for skies in self.skies]
        try:
            scene = resolve(self.config, wavelength_nm=self.payload["wavelength_nm"])
            observer = Observer(altitude_km=self.skies[0][0].observer_altitude_km)
            with suppress(TwilightError):  # no air, no turbidity
                self.turbidity = turbidity_of(scene.medium)
            for part in parts(plan(replace(scene, observer=observer))):
                self._wavelengths(part, out)
        except TwilightError as error:  # of the air or of the solver's preparation: no scene of this field can be done
            for block in out:
                block.refused = {i: str(error) for i in range(len(block.radiance))}
        for block in out:
            self._clear(block)
        return out

    def _empty(self, n: int) -> BlockResult:
        shape = (self.payload["elevation_deg"].size, self.payload["azimuth_deg"].size)
        w = self.payload["wavelength_nm"].size
        return BlockResult(
            np.full((n, *shape, w), np.nan, np.float32),
            np.full((n, w), np.nan, np.float32),
            np.full(n, np.nan, np.float32),
        )

    def _wavelengths(self, part: Part, out: list[BlockResult]) -> None:
        solved = self._solved(part)
        for skies, block in zip(self.skies, out, strict=True):
            for i, sky in enumerate(skies):
                if i in block.refused:
                    continue
                try:
                    self._sky(solved, sky, i, block)
                except TwilightError as error:
                    block.refused[i] = str(error)

    def _solved(self, part: Part) -> Field:
        key = f"{self.payload['field_key']} {part.wavelengths.start}"
        if key not in _last_field:
            _last_field.clear()  # first, so that two fields are never held
            _last_field[key] = part.solve()
        return _last_field[key]

    def _sky(self, solved: Field, sky: ScenePosition, i: int, block: BlockResult) -> None:
        sun, altitude, part = sky.sun_elevation_deg, sky.observer_altitude_km, solved.wavelengths
        found = solved.samples(sun, self.payload["elevation_deg"], self.payload["azimuth_deg"], altitude)
        layers = layers_of(found.standard_error, found.polarisation, found.polarisation_error)
        for name, values in layers.items():
            block.more.setdefault(name, np.full_like(block.radiance, np.nan))[i, ..., part] = values
        block.radiance[i, ..., part] = found.radiance
        block.direct[i, part], block.bending_deg[i] = solved.direct(sun, altitude)

    def _clear(self, block: BlockResult) -> None:
        """A sky that was refused in one block of wavelengths is not there in the others."""
        for i in block.refused:
            for values in (block.radiance, block.direct, block.bending_deg, *block.more.values()):
                values[i] = np.nan


def layers_of(
    standard_error: np.ndarray | None, polarisation: np.ndarray | None, polarisation_error: np.ndarray | None
) -> dict[str, np.ndarray]:
    """What samples (E, A) hold beside their radiance: arrays (E, A, W) by the names of the dataset's variables."""
    layers = {} if standard_error is None else {STANDARD_ERROR: standard_error}
    for values, names in ((polarisation, STOKES), (polarisation_error, STOKES_ERROR)):
        if values is not None:
            layers |= {name: values[:, :, i] for i, name in enumerate(names)}
    return layers
