"""One job of a comparison: a solver at one quality, the suns and directions of one scene."""

from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from twilight import __version__, solvers
from twilight.base.digest import DISPLAY, code_digest
from twilight.config.scene import Config
from twilight.config.sun import SunElevation
from twilight.io.provenance import configuration_hash
from twilight.numerics.directions import half_of, texture_centres
from twilight.scene.scene import resolved_configuration
from twilight.scene.suns import suns_of

_GOLDEN = 0.6180339887498949
"""Golden section: its multiples modulo 1 spread evenly."""


def half_texture(shape: tuple[int, int]) -> tuple[np.ndarray, np.ndarray]:
    """Elevation and azimuth [deg] of the texture's pixels on one side of the sun's vertical, flat.

    The sky is its own mirror image about that plane, so the other half holds nothing new.
    """
    elevation, azimuth = texture_centres(shape)
    e, a = np.meshgrid(elevation, azimuth[half_of(azimuth)[0]], indexing="ij")
    return e.ravel(), a.ravel()


def stratified_directions(shape: tuple[int, int], count: int) -> tuple[np.ndarray, np.ndarray]:
    """Elevation and azimuth [deg] of about `count` pixels of the texture, spread evenly over its rows and columns.

    Row i of `count` equal bands of elevation takes the column that the golden ratio gives (a lattice of low
    discrepancy), on one side of the sun's vertical.  Every pixel of the texture has the same weight, as in a render.
    The whole half texture is given where `count` is not below it; pixels that come up twice are given once.
    """
    elevation, azimuth = texture_centres(shape)
    azimuth = azimuth[half_of(azimuth)[0]]
    if count >= elevation.size * azimuth.size:
        return half_texture(shape)
    i = np.arange(count)
    row = np.floor((i + 0.5) / count * elevation.size).astype(int)
    column = np.floor(np.mod((i + 0.5) * _GOLDEN, 1.0) * azimuth.size).astype(int)
    pixel = np.unique(row * azimuth.size + column)
    return elevation[pixel // azimuth.size], azimuth[pixel % azimuth.size]


def sun_elevations(config: Config) -> list[float]:
    """True elevations [deg] of the suns of a configuration, each once."""
    return list(dict.fromkeys(round(sun.elevation_deg, 6) for sun in suns_of(config)))


@dataclass(frozen=True)
class SampleDirections:
    """Directions [deg] whose radiances are wanted, (D,) each, and the wavelengths [nm]; None: those of the scene."""

    elevation_deg: tuple[float, ...]
    azimuth_deg: tuple[float, ...]
    wavelength_nm: tuple[float, ...] | None = None


@dataclass(frozen=True)
class Job:
    """What one worker computes.

    config: the scene; its `solver` section holds what this job's solver is set to, with name and quality.
    suns: true elevations [deg]; directions: what to return, by sun; timed: whether the run time is wanted.
    repeats: most timed runs; after `repeat_budget_s` no new one is begun.
    """

    config: Config
    suns: tuple[float, ...]
    directions: dict[float, SampleDirections]
    timed: bool = True
    repeats: int = 3
    repeat_budget_s: float = 60.0

    @property
    def solver(self) -> str:
        return self.config.solver.get("name", solvers.DEFAULT)

    @property
    def quality(self) -> str:
        return self.config.solver.get("quality", "standard")

    def key(self, sun_elevation_deg: float, what: str) -> str:
        """Name under which a sun's `time` or `radiance` is cached: a hash of all that it depends on."""
        hashed: dict[str, Any] = resolved_configuration(self.config, SunElevation(elevation_deg=sun_elevation_deg))
        for part in ("output", "name", "description", "solar_spectrum"):
            hashed.pop(part, None)
        if what == "radiance":
            hashed.pop("texture")
            directions = self.directions[sun_elevation_deg]
            if directions.wavelength_nm is not None:
                hashed.pop("wavelengths", None)
            hashed["directions"] = asdict(directions)
        elif solvers.load(self.solver).CAPABILITIES.takes_suns:
            hashed["all_suns"] = list(self.suns)
        hashed["code"] = code_of(self.solver)
        hashed["version"] = __version__
        return configuration_hash(hashed)[:24]

    def message(self, suns: tuple[float, ...], timed: tuple[float, ...]) -> dict[str, Any]:
        """The message to the worker, as JSON values; `timed` are the suns whose run time is missing."""
        name, quality, _ = self.config.chosen_solver
        options = {k: v for k, v in self.config.solver.items() if k not in ("name", "quality", "expert")}
        options |= self.config.solver.get("expert", {})
        return {
            "module": solvers.SOLVERS[name],
            "quality": quality,
            "options": options,
            "config": self.config.model_dump(mode="json", exclude_unset=True, exclude={"vary"}),
            "suns": list(suns),
            "all_suns": list(self.suns),
            "timed": list(timed),
            "directions": [asdict(self.directions[sun]) for sun in suns],
            "repeats": self.repeats,
            "repeat_budget_s": self.repeat_budget_s,
        }


@dataclass(frozen=True)
class Timing:
    """Wall and processor times [s] of each run, and memory of the process [MiB].

    set_up: what serves all suns of the job; sky: one sky of `directions` directions.  Processor time is that of all
    threads, and hardly depends on what else the machine does.
    before_mib: with the air ready, before the solver is first called.
    compiled_s: machine code made before the runs, in a process of its own.
    """

    set_up_s: list[float]
    sky_s: list[float]
    set_up_cpu_s: list[float]
    sky_cpu_s: list[float]
    directions: int
    peak_mib: float
    before_mib: float
    threads: int
    load: float
    compiled_s: float = 0.0


@dataclass
class JobOutcome:
    """What is known about one job and one sun; `reason` is one sentence where something is missing."""

    timing: Timing | None = None
    radiance: Any = None
    reason: str = ""


def code_of(solver: str) -> str:
    """SHA-256 over the code and data that the results of this solver depend on."""
    return code_digest("twilight.studies.compare.worker", solvers.SOLVERS[solver], without=DISPLAY)
