"""A sweep as a plan: dimensions, grid, chunks, and the tasks that fill them, one solved field each."""

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
from twilight.config.vary import Drawing
from twilight.engine.problem import START_S, check_size, field_cpu_s, plan
from twilight.io.provenance import configuration_hash, to_json
from twilight.numerics.directions import half_of, texture_centres
from twilight.scene import resolve
from twilight.scene.medium import climate_medium, name_by_content, wavelengths_of
from twilight.scene.suns import SceneSun, suns_of
from twilight.scene.usual import completed
from twilight.studies.sweep import dimensions
from twilight.studies.sweep.work import STANDARD_ERROR, STOKES, STOKES_ERROR, Chunk, Task, code_of

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

Index = tuple[int, ...]


class Sweep:
    """All that is to be computed, checked.

    outer, inner: dimensions along which fields differ, and those along which scenes share one; the dataset has them in
    this order.  wavelength_nm (W,); elevation_deg (E,), azimuth_deg (A,): directions; azimuths are those of the texture
    from 0 to 180 deg, the sky is its own mirror image about the sun's vertical.  layers: variables beside radiance.
    chunk: shape of a chunk over the dimensions.  document: what the sweep is, as JSON values.

    Errors: TwilightError for a sweep that is too large, for keys that cannot be axes, and for every scene's
    configuration that is not allowed, before anything is computed.
    """

    def __init__(self, series: Series, progress: Progress | None = None):
        self.series, where = series, series.where
        dimensions.check_keys(series.axes, where)
        self.first = completed(series.config({k: v for axis in series.axes for k, v in axis.points[0].items()}))
        check_size(self.first)
        for key, value in (("sun.disc", self.first.sun.disc), ("night", self.first.night), ("moon", self.first.moon)):
            if value not in (None, False):
                raise TwilightError(f"{where}: {key}: a sweep holds the sun's light in the air alone; leave {key} out")
        self.dimensions = dimensions.dimensions_of(series.axes, self.first, where)
        self.every_observer = dimensions.serves_every_observer(series.axes, self.first)
        self.outer = tuple(d for d in self.dimensions if not d.shares_field)
        self.inner = tuple(d for d in self.dimensions if d.shares_field)
        self.shape = tuple(d.size for d in self.dimensions)
        self.scenes = math.prod(self.shape)
        _refuse_too_many(where, self.scenes, "scenes", MAX_SCENES)
        _refuse_too_many(where, math.prod(d.size for d in self.outer), "fields", MAX_FIELDS)
        self.elevation_deg, azimuth_deg = texture_centres(self.first.texture.shape)
        self.azimuth_deg = np.round(azimuth_deg[half_of(azimuth_deg)[0]], 9)
        self.wavelength_nm = _wavelengths(self.first)
        self.layers: dict[str, None] = {}
        self.code: dict[str, str] = {}
        self._suns = functools.lru_cache(maxsize=100_000)(self._suns_at)
        field_keys = self._check_fields(progress or silent)
        for dimension in self.inner:  # each value alone: suns and observers do not depend on each other
            for point in filter(None, dimension.points):
                self._config(point)
        self.chunk = self._chunk()
        self.tasks = tuple(self._tasks(field_keys))
        self.fields = len(set(field_keys.values()))
        self.document = self._document()
        self.hash = configuration_hash([self.document, [task.key for task in self.tasks]])

    @property
    def drawn(self) -> dimensions.Dimension | None:
        """The dimension of the draws."""
        return next((d for d in self.dimensions if d.name == "draw"), None)

    @property
    def bytes(self) -> int:
        """Bytes of all radiances, before compression."""
        return self.scenes * self._sky_bytes

    @property
    def _sky_bytes(self) -> int:
        values = self.elevation_deg.size * self.azimuth_deg.size * self.wavelength_nm.size
        return 4 * values * (1 + len(self.layers))

    def payload(self, task: Task) -> dict[str, Any]:
        """The message to the worker of a task; skies: true elevation of the sun [deg] and observer's altitude [km]."""
        field_config = self._field_config(task)
        config = field_config.model_dump(mode="json", exclude_unset=True)
        name_by_content(config["climate"])
        for section, _, name, _ in climate_files(config["climate"]):  # a worker may run in another folder
            section[name] = str(Path(section[name]).absolute())
        suns = [self.sun(scene) for scene in task.scenes()]
        return {
            "field_key": task.field_key,
            "code": code_of(dimensions.solver_of(field_config)),
            "config": config,
            "wavelength_nm": self.wavelength_nm,
            "elevation_deg": self.elevation_deg,
            "azimuth_deg": self.azimuth_deg,
            "layers": tuple(self.layers),
            "skies": [(sun.elevation_deg, altitude_km) for sun, altitude_km in suns],
        }

    def planned_cpu_s(self) -> float | None:
        """Processor time [s] of all tasks, from what solvers say of some fields evenly among all; None where one does
        not say."""
        of_field: dict[str, list[Task]] = {}
        for task in self.tasks:
            of_field.setdefault(task.field_key, []).append(task)
        listed = list(of_field.values())
        chosen = np.unique(np.linspace(0, len(listed) - 1, PLANNED_FIELDS).round().astype(int))
        seconds = 0.0
        for tasks in (listed[i] for i in chosen):
            config = self._field_config(tasks[0])
            # a noisy light takes longer the lower the sun
            suns = sorted({self.sun(scene)[0].elevation_deg for task in tasks for scene in task.scenes()})
            problem = plan(resolve(config, wavelength_nm=self.wavelength_nm, for_plan=True), suns)
            if problem.cost is None:
                return None
            directions = self.elevation_deg.size * self.azimuth_deg.size
            seconds += field_cpu_s(problem, sum(task.skies for task in tasks), directions)
        return START_S + seconds * len(listed) / len(chosen)

    def sun(self, scene: Sequence[int]) -> tuple[SceneSun, float]:
        """Sun and altitude of the observer [km] of the scene with that index."""
        moving = {k: v for k, v in self._point(scene).items() if dimensions.section_of(k) in ("sun", "observer")}
        own = next((i for d, i in zip(self.dimensions, scene, strict=True) if d.own_suns), 0)
        suns, altitude_km = self._suns(to_json(moving))
        return suns[own], altitude_km

    def label(self, scene: Sequence[int]) -> str:
        """What a scene is called in messages: its keys and values."""
        return " ".join(
            self.sun(scene)[0].name if d.own_suns else d.labels[i] for d, i in zip(self.dimensions, scene, strict=True)
        )

    def ends(self) -> Iterator[Config]:
        """The first scene, and those with the least and the greatest of a key's numbers, the others as in the first."""
        yield self.first
        for dimension in self.dimensions:
            for key in dimension.points[0]:
                numbers = [point[key] for point in dimension.points]
                if all(isinstance(number, (int, float)) for number in numbers):
                    for end in (min(numbers), max(numbers)):
                        yield self._config(dimension.points[numbers.index(end)])

    # Configurations -------------------------------------------------------------------------------------------

    def _config(self, point: dict[str, Any]) -> Config:
        """The first scene's configuration with some keys set, its horizon and ozone too."""
        return completed(self.series.config({k: v for d in self.dimensions for k, v in d.points[0].items()} | point))

    def _point(self, index: Sequence[int]) -> dict[str, Any]:
        """Keys and values at an index along the first dimensions."""
        return {k: v for d, i in zip(self.dimensions, index, strict=False) for k, v in d.points[i].items()}

    def _suns_at(self, moving: str) -> tuple[tuple[SceneSun, ...], float]:
        """The suns of a configuration with these keys of sun and observer, and the observer's altitude [km]."""
        config = self._config(json.loads(moving))
        return tuple(suns_of(config)), config.observer.altitude_km

    def _field_config(self, task: Task) -> Config:
        return self._config(self._point([r[0] for r in task.chunks[0][: len(self.outer)]]))

    def _check_fields(self, progress: Progress) -> dict[Index, str]:
        """The hash of each field by its index along the outer dimensions; every configuration is validated."""
        keys = {}
        total = math.prod(d.size for d in self.outer)
        for done, index in enumerate(itertools.product(*(range(d.size) for d in self.outer))):
            if done % 100 == 0:
                progress(f"checking {total} configurations", done / total)
            config = self._config(self._point(index))
            idle = {"sun", *dimensions.IDLE_KEYS, *(["observer"] if self.every_observer else [])}
            described = config.model_dump(mode="json", exclude=idle)
            name_by_content(described["climate"])
            if hasattr(solvers.load(dimensions.solver_of(config)), "recorded"):
                described["solver"] = complete_solver(config.solver)  # with the content of files that it names
            if not np.array_equal(_wavelengths(config), self.wavelength_nm):
                label = " ".join(d.labels[i] for d, i in zip(self.outer, index, strict=True))
                raise TwilightError(
                    f"{self.series.where}: vary: {label} has other wavelengths than the first scene; set wavelengths "
                    f"for all"
                )
            self.layers |= dict.fromkeys(_layers(config))
            code = self.code[dimensions.solver_of(config)] = code_of(dimensions.solver_of(config))
            keys[index] = configuration_hash([described, self.wavelength_nm, code])[:24]
        return keys

    # Chunks and tasks -----------------------------------------------------------------------------------------

    def _chunk(self) -> Index:
        """Whole along the inner dimensions while that fits; the outermost of them are divided first."""
        most = max(1, CHUNK_BYTES // self._sky_bytes)
        inner = [d.size for d in self.inner]
        fields = math.prod(d.size for d in self.outer)
        if fields < FEW_TASKS and inner:
            most = min(most, max(FEW_SKIES, -(-math.prod(inner) * fields // FEW_TASKS)))
        for i, size in enumerate(inner):
            inner[i] = min(size, max(1, most // math.prod(inner[i + 1 :])))
        return (1,) * len(self.outer) + tuple(inner)

    def _tasks(self, field_keys: dict[Index, str]) -> Iterator[Task]:
        """Chunks at several indices of one field, as a list of scenes has them, go to one task as long as they fit."""
        steps = self.chunk[len(self.outer) :]
        divided = [
            [range(start, min(start + step, d.size)) for start in range(0, d.size, step)]
            for d, step in zip(self.inner, steps, strict=True)
        ]
        of_field: dict[str, list[Chunk]] = {}
        for index, key in field_keys.items():
            outer = [range(i, i + 1) for i in index]
            of_field.setdefault(key, []).extend((*outer, *ranges) for ranges in itertools.product(*divided))
        first = self.first.model_dump(mode="json", include={"sun", "observer"})
        described = to_json([first, [d.points for d in self.inner]])
        for key, chunks in of_field.items():
            listed = len({chunk[: len(self.outer)] for chunk in chunks}) > 1
            together = max(1, CHUNK_BYTES // (self._sky_bytes * math.prod(steps))) if listed else 1
            for start in range(0, len(chunks), together):
                some = tuple(chunks[start : start + together])
                places = [[self._point([r[0] for r in chunk[: len(self.outer)]]), str(chunk)] for chunk in some]
                yield Task(configuration_hash([key, described, places])[:24], key, some)

    def _document(self) -> dict[str, Any]:
        return {
            "dimensions": {
                d.name: self.first.sun.model_dump(mode="json") if d.own_suns else list(d.points)
                for d in self.dimensions
            },
            "held_out": sorted(self.drawn.held_out) if self.drawn is not None else [],
            "configuration": self.first.model_dump(
                mode="json", exclude_none=True, exclude={"vary", "output", *Drawing.model_fields}
            ),
            "version": __version__,
            "program": dict(sorted(self.code.items())),
        }


def _wavelengths(config: Config) -> np.ndarray:
    wavelength_nm = wavelengths_of(config)
    return climate_medium(config.climate, None).wavelength_nm if wavelength_nm is None else wavelength_nm


def _layers(config: Config) -> tuple[str, ...]:
    """What the solver of a configuration gives beside radiance, as names of variables."""
    name, _, settings = config.chosen_solver
    noisy = solvers.load(name).CAPABILITIES.standard_error
    error = (STANDARD_ERROR,) if noisy else ()
    if not getattr(settings, "polarisation", False):
        return error
    return error + STOKES + (STOKES_ERROR if noisy else ())


def _refuse_too_many(where: str, count: int, what: str, most: int) -> None:
    if count > most:
        raise TwilightError(f"{where}: vary asks for {count:,} {what}; one sweep takes {most:,} at most")
