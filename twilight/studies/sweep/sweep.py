"""A sweep as a plan: dimensions, grid, chunks, and the tasks that fill them, one solved field each."""

from __future__ import annotations

import functools
import itertools
import json
import math
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from twilight import __version__, solvers
from twilight.base.errors import TwilightError
from twilight.base.progress import Progress, silent
from twilight.config.climate import climate_files
from twilight.config.load import Series
from twilight.config.scene import Config
from twilight.config.solver import complete_solver
from twilight.config.vary import DRAWS
from twilight.engine.problem import START_S, check_size, field_cpu_s, plan
from twilight.io.provenance import configuration_hash, to_json
from twilight.numerics.directions import half_of, texture_centres
from twilight.scene import resolve
from twilight.scene.medium import climate_medium, name_by_content, wavelengths_of
from twilight.scene.scene import suns_of
from twilight.studies.sweep.dimensions import (
    Dimension,
    check_keys,
    dimensions_of,
    serves_every_observer,
    shares_field_along,
    solver_of,
)
from twilight.studies.sweep.work import STANDARD_ERROR, STOKES, STOKES_ERROR, DatasetBlock, ScenePosition, Task, code_of

MAX_SCENES = 10_000_000
"""Scenes of a sweep: their indices and labels fit into memory."""
MAX_FIELDS = 200_000
"""Configurations that are checked one by one before a sweep begins."""
CHUNK_BYTES = 16 * 2**20
"""Most bytes of radiance in a chunk, before compression."""
PLANNED_FIELDS = 2
"""Fields whose cost is asked for before a sweep begins."""
FEW_TASKS = 16
"""The suns of a sweep with fewer tasks than this are divided among more tasks, so that its workers have work."""
FEW_SKIES = 16
"""Skies that such a task has at least."""


class Sweep:
    """All that is to be computed, checked.

    outer, inner: dimensions along which fields differ, and those along which scenes share one; the dataset has them in
    this order.  wavelength_nm (W,); elevation_deg (E,), azimuth_deg (A,): directions; azimuths are those of the texture
    from 0 to 180 deg, the sky is its own mirror image about the sun's vertical.  chunk: shape of a chunk over the
    dimensions.  document: what the sweep is, as JSON values.

    Errors: TwilightError for a sweep that is too large, for keys that cannot be axes, and for every scene's
    configuration that is not allowed, before anything is computed.
    """

    def __init__(self, series: Series, progress: Progress | None = None):
        self.series, where = series, series.where
        count = math.prod(len(axis.points) for axis in series.axes)
        _refuse_too_many(where, count, "scenes", MAX_SCENES)
        check_keys(series.axes, where)
        self.first = series.config({k: v for axis in series.axes for k, v in axis.points[0].items()})
        check_size(self.first)
        for key, value in (("sun.disc", self.first.sun.disc), ("night", self.first.night), ("moon", self.first.moon)):
            if value not in (None, False):
                raise TwilightError(f"{where}: {key}: a sweep holds the sun's light in the air alone; leave {key} out")
        dimensions = dimensions_of(series.axes, self.first, where)
        self.every_observer = serves_every_observer(series.axes, self.first)
        self.outer = tuple(d for d in dimensions if not d.shares_field)
        self.inner = tuple(d for d in dimensions if d.shares_field)
        self.dimensions = self.outer + self.inner
        self.shape = tuple(d.size for d in self.dimensions)
        self.scenes = math.prod(self.shape)
        _refuse_too_many(where, self.scenes, "scenes", MAX_SCENES)
        _refuse_too_many(where, math.prod(d.size for d in self.outer), "fields", MAX_FIELDS)
        self.elevation_deg, azimuth_deg = texture_centres(self.first.texture.shape)
        self.azimuth_deg = np.round(azimuth_deg[half_of(azimuth_deg)[0]], 9)
        self.wavelength_nm = self._wavelengths(self.first)
        self.layers: dict[str, None] = {}
        self.code: dict[str, str] = {}
        self._position_cache = functools.lru_cache(maxsize=100_000)(self._positions)
        field_keys = self._check_fields(progress or silent)
        self._check_inner()
        self.chunk = self._chunk()
        self.tasks = tuple(self._tasks(field_keys))
        self.fields = len(set(field_keys.values()))
        self.document = self._document()
        self.hash = configuration_hash([self.document, [task.key for task in self.tasks]])

    @property
    def drawn(self) -> Dimension | None:
        """The dimension of the draws."""
        return next((d for d in self.dimensions if d.axis is not None and d.axis.name == DRAWS), None)

    @property
    def bytes(self) -> int:
        """Bytes of all radiances, before compression."""
        return self.scenes * self._sky_bytes

    @property
    def _sky_bytes(self) -> int:
        values = self.elevation_deg.size * self.azimuth_deg.size * self.wavelength_nm.size
        return 4 * values * (1 + len(self.layers))

    def payload(self, task: Task) -> dict[str, Any]:
        """The message to the worker of a task."""
        made = self._field_config(task.blocks[0].index)
        config = made.model_dump(mode="json", exclude_unset=True)
        name_by_content(config["climate"])
        for section, _, name, _ in climate_files(config["climate"]):  # a worker may run in another folder
            section[name] = str(Path(section[name]).absolute())
        return {
            "field_key": task.field_key,
            "code": code_of(solver_of(made)),
            "config": config,
            "wavelength_nm": self.wavelength_nm,
            "elevation_deg": self.elevation_deg,
            "azimuth_deg": self.azimuth_deg,
            "blocks": [[self.position(scene) for scene in block.scenes()] for block in task.blocks],
        }

    def planned_cpu_s(self) -> float | None:
        """Processor time [s] of all tasks, from what solvers say of some fields evenly among all; None where one does
        not say."""
        skies: dict[str, int] = {}
        place: dict[str, tuple[int, ...]] = {}
        for task in self.tasks:
            skies[task.field_key] = skies.get(task.field_key, 0) + task.skies
            place.setdefault(task.field_key, task.blocks[0].index)
        keys = list(skies)
        chosen = [keys[i] for i in np.unique(np.linspace(0, len(keys) - 1, PLANNED_FIELDS).round().astype(int))]
        directions = self.elevation_deg.size * self.azimuth_deg.size
        seconds = 0.0
        for key in chosen:
            config = self._field_config(place[key])
            # a noisy light takes longer the lower the sun
            ranges = [(0, d.size) for d in self.inner]
            suns = {
                self.position(scene).sun_elevation_deg for scene in DatasetBlock(place[key], tuple(ranges)).scenes()
            }
            problem = plan(resolve(config, wavelength_nm=self.wavelength_nm, for_plan=True), sorted(suns))
            if problem.cost is None:
                return None
            seconds += field_cpu_s(problem, skies[key], directions)
        return START_S + seconds * len(keys) / len(chosen)

    def position(self, scene: Sequence[int]) -> ScenePosition:
        """Sun and observer of the scene with that index."""
        outer, inner = scene[: len(self.outer)], scene[len(self.outer) :]
        along = tuple(i for d, i in zip(self.inner, inner, strict=True) if d.axis is not None)
        own = [i for d, i in zip(self.inner, inner, strict=True) if d.axis is None]
        return self._position_cache(to_json(self._sun_and_observer(outer)), along)[own[0] if own else 0]

    def label(self, scene: Sequence[int]) -> str:
        """What a scene is called in messages: its keys and values."""
        parts = []
        for dimension, i in zip(self.dimensions, scene, strict=True):
            parts.append(self.position(scene).name if dimension.axis is None else dimension.axis.labels[i])
        return " ".join(parts) or self.first.title

    # Checks ---------------------------------------------------------------------------------------------------

    def _check_fields(self, progress: Progress) -> dict[tuple[int, ...], str]:
        """The hash of each field by its index along the outer dimensions; every configuration is validated."""
        keys = {}
        total = math.prod(d.size for d in self.outer)
        wavelengths: dict[str, np.ndarray] = {}
        for done, index in enumerate(itertools.product(*(range(d.size) for d in self.outer))):
            if done % 100 == 0:
                progress(f"checking {total} configurations", done / total)
            config = self._field_config(index)
            described = config.model_dump(
                mode="json", exclude={"sun", "output", "name", "description", "vary", "solar_spectrum", "version"}
            )
            name_by_content(described["climate"])
            if hasattr(solvers.load(solver_of(config)), "recorded"):
                described["solver"] = complete_solver(config.solver)  # with the content of files that it names
            if self.every_observer:
                described.pop("observer")
            asked = to_json([described.get("wavelengths"), described["climate"].get("medium")])
            if asked not in wavelengths:
                wavelengths[asked] = self._wavelengths(config)
                if not np.array_equal(wavelengths[asked], self.wavelength_nm):
                    raise TwilightError(
                        f"{self.series.where}: vary: {self._describe(index)} has other wavelengths than the first "
                        f"scene; set wavelengths for all"
                    )
            self._add_layers(config)
            code = self.code[solver_of(config)] = code_of(solver_of(config))
            keys[index] = configuration_hash([described, self.wavelength_nm, code])[:24]
        return keys

    def _add_layers(self, config: Config) -> None:
        """Note what the solver of a configuration gives beside radiance (`layers`: names of variables)."""
        name, _, settings = config.chosen_solver
        able = solvers.load(name).CAPABILITIES
        polarised = getattr(settings, "polarisation", False)
        self.layers |= dict.fromkeys([STANDARD_ERROR] if able.standard_error else [])
        self.layers |= dict.fromkeys(STOKES if polarised else ())
        self.layers |= dict.fromkeys(STOKES_ERROR if polarised and able.standard_error else ())

    def _check_inner(self) -> None:
        """Each value along the inner dimensions is validated alone: suns and observers do not depend on each other."""
        for dimension in self.inner:
            for i in range(dimension.size if dimension.axis is not None else 0):
                self.series.config(self._first_point() | dimension.point(i))

    def _wavelengths(self, config: Config) -> np.ndarray:
        wavelength_nm = wavelengths_of(config)
        return climate_medium(config.climate, None).wavelength_nm if wavelength_nm is None else wavelength_nm

    # Configurations -------------------------------------------------------------------------------------------

    def _first_point(self) -> dict[str, Any]:
        return {k: v for d in self.dimensions for k, v in d.point(0).items()}

    def ends(self) -> Iterator[Config]:
        """The first scene, and those with the least and the greatest of a key's numbers, the others as in the first."""
        yield self.first
        for dimension in self.dimensions:
            points = [dimension.point(i) for i in range(dimension.size)]
            for key in points[0]:
                numbers = [point[key] for point in points]
                if all(isinstance(number, (int, float)) for number in numbers):
                    for end in (min(numbers), max(numbers)):
                        yield self.series.config(self._first_point() | points[numbers.index(end)])

    def _outer_point(self, index: Sequence[int]) -> dict[str, Any]:
        return {k: v for d, i in zip(self.outer, index, strict=True) for k, v in d.point(i).items()}

    def _field_config(self, index: tuple[int, ...]) -> Config:
        return self.series.config(self._first_point() | self._outer_point(index))

    def _describe(self, index: tuple[int, ...]) -> str:
        return " ".join(d.axis.labels[i] for d, i in zip(self.outer, index, strict=True) if d.axis is not None)

    def _positions(self, served: str, along: tuple[int, ...]) -> tuple[ScenePosition, ...]:
        """The suns of a configuration with these keys of the outer and indices along the inner dimensions."""
        point = self._first_point() | json.loads(served)
        for dimension, i in zip((d for d in self.inner if d.axis is not None), along, strict=True):
            point |= dimension.point(i)
        config = self.series.config(point)
        return tuple(
            ScenePosition(
                sun.elevation_deg,
                sun.azimuth_deg,
                sun.distance_au,
                config.observer.altitude_km,
                None if sun.time is None else sun.time.timestamp(),
                sun.name,
            )
            for sun in suns_of(config)
        )

    # Chunks and tasks -----------------------------------------------------------------------------------------

    def _chunk(self) -> tuple[int, ...]:
        """Whole along the inner dimensions while that fits; the outermost of them are divided first."""
        most = max(1, CHUNK_BYTES // self._sky_bytes)
        inner = [d.size for d in self.inner]
        fields = math.prod(d.size for d in self.outer)
        if fields < FEW_TASKS and inner:
            most = min(most, max(FEW_SKIES, -(-math.prod(inner) * fields // FEW_TASKS)))
        for i, size in enumerate(inner):
            rest = math.prod(inner[i + 1 :])
            inner[i] = min(size, max(1, most // rest))
        return (1,) * len(self.outer) + tuple(inner)

    def _tasks(self, field_keys: dict[tuple[int, ...], str]) -> Iterator[Task]:
        """Chunks of the same field go to one task, as long as they fit."""
        steps = self.chunk[len(self.outer) :]
        ranges = [
            [(start, min(start + step, d.size)) for start in range(0, d.size, step)]
            for d, step in zip(self.inner, steps, strict=True)
        ]
        of_field: dict[str, list[DatasetBlock]] = {}
        for index, key in field_keys.items():
            of_field.setdefault(key, []).extend(DatasetBlock(index, chosen) for chosen in itertools.product(*ranges))
        whole = math.prod(steps)
        first = self.first.model_dump(mode="json", include={"sun", "observer"})
        inner = to_json([first, [d.axis.points for d in self.inner if d.axis is not None]])
        for key, blocks in of_field.items():
            listed = len({block.index for block in blocks}) > 1
            for together in _packed(blocks, max(whole, CHUNK_BYTES // self._sky_bytes) if listed else whole):
                suns = [[self._sun_and_observer(b.index), b.ranges] for b in together]
                yield Task(configuration_hash([key, inner, suns])[:24], key, tuple(together))

    def _sun_and_observer(self, index: Sequence[int]) -> dict[str, Any]:
        """The keys of the sun and, where a field serves all, of the observer at an index along the outer dimensions."""
        return {k: v for k, v in self._outer_point(index).items() if shares_field_along(k, self.every_observer)}

    def _document(self) -> dict[str, Any]:
        return {
            "version": __version__,
            "code": dict(sorted(self.code.items())),
            "configuration": self.first.model_dump(mode="json", exclude_none=True, exclude={"vary", "output"}),
            "dimensions": {
                d.name: self.first.sun.model_dump(mode="json") if d.axis is None else list(d.axis.points)
                for d in self.dimensions
            },
            "held_out": sorted(d.axis.held_out) if (d := self.drawn) is not None and d.axis is not None else [],
        }


def _packed(blocks: list[DatasetBlock], most: int) -> Iterator[list[DatasetBlock]]:
    """Blocks in order, put together as long as they hold no more than `most` skies."""
    together: list[DatasetBlock] = []
    for block in blocks:
        if together and sum(b.skies for b in together) + block.skies > most:
            yield together
            together = []
        together.append(block)
    yield together


def _refuse_too_many(where: str, count: int, what: str, most: int) -> None:
    if count > most:
        raise TwilightError(f"{where}: vary asks for {count:,} {what}; one sweep takes {most:,} at most")
