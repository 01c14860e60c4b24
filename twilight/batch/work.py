"""What a worker does: the skies of one field."""

from __future__ import annotations

import os
import threading
import time
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from twilight import solvers
from twilight.air import climate_medium
from twilight.batch.sweep import ScenePosition, code_digest
from twilight.config.scene import Config
from twilight.errors import TwilightError
from twilight.plan import make_plan
from twilight.run import WAVELENGTH_BLOCK, _Sunbeam, resolve_solver_of

_ONE_AT_A_TIME = threading.Lock()
"""A worker with several threads computes one field at a time, with all of them."""

_last: dict[str, tuple[Any, dict[float, _Sunbeam]]] = {}
"""The field that was solved last and its sunbeams: suns of one field may come in several tasks."""


@dataclass
class BlockResult:
    """A chunk's skies in its order: n of them.

    radiance, standard_error (n, E, A, W): sun-normalised [sr^-1], float32; direct (n, W): irradiance of the sun's beam
    over F0; bending_deg (n,); refused: the sentence of each sky that the solver cannot do, by position, whose
    values are NaN.
    """

    radiance: np.ndarray
    direct: np.ndarray
    bending_deg: np.ndarray
    standard_error: np.ndarray | None = None
    refused: dict[int, str] = field(default_factory=dict)


@dataclass(frozen=True)
class TaskResult:
    """Chunks of a task, and the processor and wall seconds that they took."""

    blocks: list[BlockResult]
    cpu_s: float
    wall_s: float


def compute(payload: dict[str, Any], threads: int | None = None) -> TaskResult:
    """Compute a task on `threads` threads (default: those that this Dask worker has).

    Errors: TwilightError where this worker's program is not the one that planned the task.  A scene that the solver
    refuses is no error but part of the result.
    """
    if payload["code"] != code_digest():
        raise TwilightError("the program or its data on this worker differ from those that started the sweep")
    with _ONE_AT_A_TIME:
        _set_threads(threads)
        begin = time.process_time(), time.perf_counter()
        blocks = _Fields(payload).blocks()
        return TaskResult(blocks, time.process_time() - begin[0], time.perf_counter() - begin[1])


def forget() -> None:
    """Let go of the field that this process holds."""
    _last.clear()


def _set_threads(threads: int | None) -> None:
    import numba

    most = int(numba.config.NUMBA_NUM_THREADS)  # type: ignore[attr-defined]  # made when numba is loaded
    if threads is None:
        threads = most
        if "NUMBA_NUM_THREADS" not in os.environ:
            from distributed import get_worker

            threads = get_worker().state.nthreads
    numba.set_num_threads(max(1, min(threads, most)))


class _Fields:
    """The fields of one climate: solved once for each block of wavelengths and, if need be, observer."""

    def __init__(self, payload: dict[str, Any]):
        self.payload = payload
        self.config = Config.model_validate(payload["config"])
        self.elevation, self.azimuth = np.meshgrid(payload["elevation_deg"], payload["azimuth_deg"], indexing="ij")
        self.skies: list[list[ScenePosition]] = payload["blocks"]

    def blocks(self) -> list[BlockResult]:
        """All chunks of the task."""
        out = [self._empty(len(skies)) for skies in self.skies]
        try:
            name, _, settings = resolve_solver_of(self.config)
            self.solver = solvers.load(name)
            medium = climate_medium(make_plan(self.config).climate, self.payload["wavelength_nm"])
            for start in range(0, medium.n_wavelengths, WAVELENGTH_BLOCK):
                part = slice(start, start + WAVELENGTH_BLOCK)
                whole = medium.n_wavelengths <= WAVELENGTH_BLOCK
                self._wavelengths(medium if whole else medium.select(part), settings, part, out)
        except TwilightError as error:  # of the air or of the solver's preparation: no scene of this field can be done
            for block in out:
                block.refused = {i: str(error) for i in range(len(block.radiance))}
        for block in out:
            self._clear(block)
        return out

    def _empty(self, n: int) -> BlockResult:
        w = self.payload["wavelength_nm"].size
        return BlockResult(
            np.full((n, *self.elevation.shape, w), np.nan, np.float32),
            np.full((n, w), np.nan, np.float32),
            np.full(n, np.nan, np.float32),
        )

    def _wavelengths(self, medium: Any, settings: Any, part: slice, out: list[BlockResult]) -> None:
        made, beams = self._solved(medium, settings, part)
        for skies, block in zip(self.skies, out, strict=True):
            for i, sky in enumerate(skies):
                if i in block.refused:
                    continue
                altitude = sky.observer_altitude_km
                if altitude not in beams:
                    beams[altitude] = _Sunbeam(medium, altitude)
                try:
                    self._sky(made, sky, i, part, block)
                except TwilightError as error:
                    block.refused[i] = str(error)
                    continue
                block.direct[i, part], block.bending_deg[i] = beams[altitude].at(sky.sun_elevation_deg)

    def _solved(self, medium: Any, settings: Any, part: slice) -> tuple[Any, dict[float, _Sunbeam]]:
        key = f"{self.payload['field_key']} {part.start}"
        if key not in _last:
            _last.clear()  # first, so that two fields are never held
            altitude = self.skies[0][0].observer_altitude_km
            _last[key] = self.solver.prepare(medium, settings, observer_altitude_km=altitude), {}
        return _last[key]

    def _sky(self, made: Any, sky: ScenePosition, i: int, part: slice, block: BlockResult) -> None:
        directions = (sky.sun_elevation_deg, self.elevation, self.azimuth)
        where = {"observer_altitude_km": sky.observer_altitude_km} if self.payload["everywhere"] else {}
        if hasattr(made, "radiance_with_error"):
            found = made.radiance_with_error(*directions, **where)
            radiance = found.radiance
            if block.standard_error is None:
                block.standard_error = np.full_like(block.radiance, np.nan)
            block.standard_error[i, ..., part] = found.standard_error
        else:
            radiance = made.radiance(*directions, **where)
        if not (np.isfinite(radiance).all() and (radiance >= 0.0).all()):
            raise TwilightError("the solver gave radiance that is negative or not a number")
        block.radiance[i, ..., part] = radiance

    def _clear(self, block: BlockResult) -> None:
        """A sky that was refused in one block of wavelengths is not there in the others."""
        for i in block.refused:
            for values in (block.radiance, block.direct, block.bending_deg, block.standard_error):
                if values is not None:
                    values[i] = np.nan
