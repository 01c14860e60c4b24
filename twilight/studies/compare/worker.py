"""Runs one job in a process of its own, so that peak memory means something.

Reads a job (JSON) from standard input and writes one JSON object a line to standard output:
{"progress": [words, fraction]}, {"sun": deg, "timing": {...}}, {"sun": deg, "radiance": [[...]]}, {"sun": deg,
"reason": "..."}, {"compiled_s": s} and nothing after it where machine code had to be made.
"""

import ctypes
import gc
import json
import math
import os
import sys
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from importlib import import_module
from typing import Any

import numpy as np

from twilight.base.errors import TwilightError
from twilight.base.progress import PhasedProgress
from twilight.config.scene import Config
from twilight.engine.field import Field, solve
from twilight.scene import Scene, resolve

Send = Callable[[dict[str, Any]], None]


class Compiled(Exception):
    """Machine code was made, which takes time and memory that do not belong to a run."""


class _CompilationClock:
    """Seconds that numba spent compiling in this process."""

    def __init__(self) -> None:
        from numba.core.event import install_recorder  # start-up

        self._context = install_recorder("numba:compile")
        self._recorder = self._context.__enter__()

    @property
    def seconds(self) -> float:
        """The union of all compilations; those within others are not counted twice."""
        depth, begun, total = 0, 0.0, 0.0
        for at, event in self._recorder.buffer:
            if event.is_start:
                begun, depth = (at if depth == 0 else begun), depth + 1
            elif depth:
                depth -= 1
                total += at - begun if depth == 0 else 0.0
        return total


class _Clocks:
    """Wall and processor seconds of every block that ended well."""

    def __init__(self) -> None:
        self.wall_s: list[float] = []
        self.cpu_s: list[float] = []

    def __enter__(self) -> None:
        self._start = time.perf_counter(), time.process_time()

    def __exit__(self, kind: Any, error: Any, trace: Any) -> None:
        if kind is None:
            self.wall_s.append(time.perf_counter() - self._start[0])
            self.cpu_s.append(time.process_time() - self._start[1])


def execute(message: dict[str, Any], send: Send) -> None:
    """Compute a job and send what comes out; a scene that the solver cannot do is sent as its reason."""
    _Execution(message, send).all_suns()


class _Execution:
    def __init__(self, message: dict[str, Any], send: Send):
        self.message, self.send = message, send
        self.config = Config.model_validate(message["config"])
        self.solver = import_module(message["module"])
        self.settings = replace(self.solver.QUALITIES[message["quality"]], **message["options"])
        self.suns: list[float] = message["suns"]
        self.timed: list[float] = message["timed"]
        self.directions = dict(zip(self.suns, message["directions"], strict=True))
        self.failed: set[float] = set()
        self.sent: set[float] = set()
        self.meter = PhasedProgress(lambda doing, fraction: send({"progress": [doing, fraction]}))
        self.meter.phase("", 0.0, 0.5)

    def all_suns(self) -> None:
        scene = self._scene(None)
        clock = _CompilationClock()
        self.before_mib = peak_mib()
        self._warm_up(scene)
        if clock.seconds > 0.0:
            self.send({"compiled_s": clock.seconds})
            raise Compiled
        if self.timed:
            self._timed_runs(scene, clock)
        for wanted in dict.fromkeys(_named_wavelengths(d) for d in self.directions.values()):
            suns = [s for s in self.suns if _named_wavelengths(self.directions[s]) == wanted]
            field = None
            for sun in (s for s in suns if s not in self.failed | self.sent):
                try:
                    field = field or self._solve(scene if wanted is None else self._scene(np.array(wanted)))
                    self._send_radiance(field, sun)
                except TwilightError as error:
                    self._fail(sun, error)

    def _scene(self, wavelength_nm: np.ndarray | None) -> Scene:
        """The scene at its own or at other wavelengths, with the solver and the settings that the job names."""
        return resolve(self.config, wavelength_nm=wavelength_nm, solver=(self.solver, self.settings))

    def _solve(self, scene: Scene) -> Field:
        """The field of a scene, solved here."""
        return solve(scene, self.message["all_suns"], self.meter, cached=False)

    def _warm_up(self, scene: Scene) -> None:
        """Every kernel once, at one wavelength and in few directions, so that it is loaded before the clock starts."""
        try:
            field = self._solve(self._scene(scene.medium.wavelength_nm[:1].copy()))
            for sun in self.suns[:1]:
                self._light(field, sun, np.array([3.0, 60.0]), np.array([0.0, 90.0]))
        except TwilightError:
            pass  # the run itself will say so

    def _timed_runs(self, scene: Scene, clock: _CompilationClock) -> None:
        begun = time.perf_counter()
        set_up = _Clocks()
        skies = {sun: _Clocks() for sun in self.timed}
        while not set_up.wall_s or (
            len(set_up.wall_s) < self.message["repeats"]
            and time.perf_counter() - begun < self.message["repeat_budget_s"]
        ):
            compiled = clock.seconds
            try:
                with set_up:
                    field = self._solve(scene)
                    if self.solver.CAPABILITIES.every_sun:  # what all suns share may be made for the first one
                        with suppress(TwilightError):
                            field.radiance(self.suns[0], np.array([90.0]), np.array([0.0]))
            except TwilightError as error:
                for sun in self.suns:
                    self._fail(sun, error)
                return
            for i, sun in enumerate(self.timed):
                if sun in self.failed:
                    continue
                self.meter.phase("", 0.5 + 0.5 * i / len(self.timed), 0.5 / len(self.timed))
                d = self.directions[sun]
                try:
                    with skies[sun]:
                        light = self._light(field, sun, np.array(d["elevation_deg"]), np.array(d["azimuth_deg"]))
                except TwilightError as error:
                    self._fail(sun, error)
                    continue
                # a table is a whole sky
                whole = int(np.prod(self.config.texture.shape))
                estimated = self.solver.CAPABILITIES.standard_error
                self._send_timing(sun, set_up, skies[sun], light.shape[0] if estimated else whole)
                if len(set_up.wall_s) == 1 and _named_wavelengths(d) is None:
                    self._send(sun, light)
            if clock.seconds > compiled:  # the warm-up had missed a kernel: the run that made it does not count
                self.send({"compiled_s": clock.seconds})
                raise Compiled

    def _light(self, field: Field, sun: float, elevation_deg: np.ndarray, azimuth_deg: np.ndarray) -> np.ndarray:
        """Radiance (D, W) in directions (D,), as files hold it: read from the sky's table, or computed one by one by a
        solver whose time grows with the directions."""
        if self.solver.CAPABILITIES.standard_error:
            return field.radiance(sun, elevation_deg, azimuth_deg)
        return field.table(sun).light(elevation_deg, azimuth_deg)

    def _send_timing(self, sun: float, set_up: _Clocks, sky: _Clocks, directions: int) -> None:
        import numba  # start-up

        timing = {
            "set_up_s": set_up.wall_s,
            "sky_s": sky.wall_s,
            "set_up_cpu_s": set_up.cpu_s,
            "sky_cpu_s": sky.cpu_s,
            "directions": directions,
            "peak_mib": peak_mib(),
            "before_mib": self.before_mib,
            "threads": numba.get_num_threads(),
            "load": os.getloadavg()[0] if hasattr(os, "getloadavg") else 0.0,
        }
        self.send({"sun": sun, "timing": timing})

    def _send_radiance(self, field: Field, sun: float) -> None:
        d = self.directions[sun]
        self._send(sun, self._light(field, sun, np.array(d["elevation_deg"]), np.array(d["azimuth_deg"])))

    def _send(self, sun: float, radiance: np.ndarray) -> None:
        if unknown := int(np.isnan(radiance).sum()):
            self._fail(sun, TwilightError(f"too few paths find light: {unknown} of {radiance.size} radiances unknown"))
            return
        if not (radiance >= 0).all():  # an estimate, by its noise
            self._fail(sun, TwilightError("gave radiance that is negative or not a number"))
            return
        self.sent.add(sun)
        self.send({"sun": sun, "radiance": radiance.tolist()})

    def _fail(self, sun: float, error: TwilightError) -> None:
        self.failed.add(sun)
        self.send({"sun": sun, "reason": str(error)})


def _named_wavelengths(directions: dict[str, Any]) -> tuple[float, ...] | None:
    wanted = directions["wavelength_nm"]
    return None if wanted is None else tuple(wanted)


def main() -> int:
    """Read, compute, write; what solvers print goes to standard error."""
    out = os.fdopen(os.dup(1), "w", buffering=1)
    os.dup2(2, 1)

    def send(message: dict[str, Any]) -> None:
        out.write(json.dumps(message) + "\n")

    try:
        execute(json.load(sys.stdin), send)
    except Compiled:
        return 0
    except BrokenPipeError:  # nobody reads any more
        os._exit(1)
    return 0


if sys.platform != "win32":
    import resource


def peak_mib() -> float:
    """Most memory this process has held [MiB], since `forget_peak` where the system can count anew; nan on Windows.

    Linux counts into ru_maxrss what the parent held when it started this process; VmHWM is this process alone.
    """
    with suppress(OSError), open("/proc/self/status", encoding="ascii") as status:
        for line in status:
            if line.startswith("VmHWM:"):
                return float(line.split()[1]) / 1024.0
    if sys.platform == "win32":
        return math.nan
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return peak / (1024.0**2 if sys.platform == "darwin" else 1024.0)


def forget_peak() -> None:
    """Free what nothing holds and have the peak counted anew; on Linux alone."""
    gc.collect()
    if sys.platform == "linux":
        with suppress(AttributeError, OSError):  # of the GNU C library alone
            ctypes.CDLL(None).malloc_trim(0)
    with suppress(OSError), open("/proc/self/clear_refs", "w", encoding="ascii") as file:
        file.write("5")
