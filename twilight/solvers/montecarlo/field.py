"""The prepared solver: air, direct beam and importance function of one medium, for any sun and any direction.

A question is a `Run`: rounds of jobs, batches of a round, sums in a fixed order.
"""

from __future__ import annotations

import threading
import time
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace

import numpy as np

from twilight.atmosphere.medium import Medium, observer_at
from twilight.base.errors import TwilightError, TwilightWarning
from twilight.base.progress import Progress
from twilight.base.threads import in_slices
from twilight.solvers.base import BareField
from twilight.solvers.montecarlo import chunks
from twilight.solvers.montecarlo.air import MonteCarloAir, prepare_air
from twilight.solvers.montecarlo.events import N_ORDERS
from twilight.solvers.montecarlo.importance import ImportanceTables
from twilight.solvers.montecarlo.importance_solution import solve_importance
from twilight.solvers.montecarlo.kernel import GOLDEN, N_STOKES, mix
from twilight.solvers.montecarlo.settings import MonteCarloSettings
from twilight.solvers.montecarlo.sunlight import SolarBeam, prepare_beam_table, screen_in_space
from twilight.transport.beam import prepare_beam

BATCH_SAMPLES = 4096
"""Samples of a batch, about: between batches sums are added and progress is reported."""
FIRST_SAMPLES = 2
"""Samples of an arm that are taken whatever the time limit: without them there is no standard error."""
ADAPTIVE_ROUNDS = 2
"""Rounds in which the arms set each other's number of samples."""
LATE_ROUNDS = 6
"""Rounds for pixels that still miss the error asked for."""
FARTHEST_KM = 1e7
"""Distance [km] at which a segment has left all air."""


@contextmanager
def stop_after(seconds: float | None) -> Iterator[np.ndarray]:
    """A flag (1,) for kernels that turns from 0 to 1 after so many seconds; None: never."""
    stop = np.zeros(1, dtype=np.uint8)
    if seconds is None:
        yield stop
        return
    timer = threading.Timer(max(0.0, seconds), stop.fill, (1,))
    timer.daemon = True
    timer.start()
    try:
        yield stop
    finally:
        timer.cancel()


def pixels_of(sun_deg, elevation_deg, azimuth_deg, far_km, altitude_km: float, wavelength_nm) -> chunks.Pixels:
    """`Pixels`, whose key is a hash of the geometry: a pixel's answer does not depend on its neighbours in the call."""
    key = np.zeros(sun_deg.size, dtype=np.uint64)
    parts = [sun_deg, elevation_deg, azimuth_deg, np.full(sun_deg.size, altitude_km)]
    if np.isfinite(far_km).any():
        parts.append(far_km)
    for part in parts:
        bits = np.ascontiguousarray(part + 0.0).view(np.uint64)
        key = mix.py_func((key ^ bits) + GOLDEN)
    wavelength_key = np.round(1000.0 * wavelength_nm).astype(np.uint64)
    angles = (np.radians(sun_deg), np.radians(elevation_deg), np.radians(azimuth_deg))
    return chunks.Pixels(key, *angles, float(altitude_km), wavelength_key, np.asarray(far_km, dtype=float))


class Run:
    """Samples of one question: `all_rounds` takes them, `tally` holds their sums."""

    def __init__(self, field: MonteCarloField, pixels: chunks.Pixels, batch_order: Callable | None = None):
        self.field = field
        self.pixels = pixels
        self.settings = field.settings
        self.batch_order = batch_order
        self.started = time.monotonic()
        self.n_stokes = N_STOKES if self.settings.polarised else 1
        self.tally = chunks.Tally(pixels.key.size, self.n_stokes, field.medium.optical_depth("total"))
        self.chunks_used = np.zeros_like(self.tally.count)

    def all_rounds(self) -> bool:
        """Take all samples; False if a limit ended the run before the target."""
        limit = self.settings.time_limit_s
        rounds = self._rounds()
        with stop_after(None if limit is None else max(0.0, limit - (time.monotonic() - self.started))) as stop:
            for index, purpose in enumerate(rounds):
                if limit is not None and index > 0 and stop[0]:
                    return False
                # the first round is taken whatever the time limit
                flag = np.zeros_like(stop) if index == 0 else stop
                if not self._one_round(index, len(rounds), self._extra(purpose), flag):
                    return False
        if self.field.progress:
            self._report(len(rounds) - 1, len(rounds), 1.0)
        target = self.settings.target_stderr
        return target is None or bool(np.all(self.tally.relative_error() <= 2.0 * target))

    def _rounds(self) -> list[str]:
        """What the rounds are for: "first" (with a time limit), "pilot" or "all", "adaptive", "late"."""
        start = [] if self.settings.time_limit_s is None else ["first"]
        if self.settings.target_stderr is None:
            return [*start, "all"]
        return [*start, "pilot"] + ["adaptive"] * ADAPTIVE_ROUNDS + ["late"] * LATE_ROUNDS

    def _extra(self, purpose: str) -> np.ndarray:
        """Samples (P, W, 2) that a round adds."""
        settings, count = self.settings, self.tally.count
        fixed = {"first": FIRST_SAMPLES, "all": -(-settings.samples // chunks.N_ARMS), "pilot": settings.pilot_samples}
        if purpose in fixed:
            return np.maximum(fixed[purpose] - count, 0)
        assert settings.target_stderr is not None
        wanted = self.tally.wanted(settings.target_stderr, settings.max_samples, purpose == "late")
        return np.maximum(wanted - count, 0)

    def _one_round(self, index: int, n_rounds: int, extra: np.ndarray, stop: np.ndarray) -> bool:
        """Take `extra` samples; False if time ran out, which the flag `stop` (1,) tells."""
        jobs = self._jobs(extra)
        size = jobs.samples.size
        edges = np.flatnonzero(np.diff(np.cumsum(jobs.samples) // BATCH_SAMPLES)) + 1
        edges = np.unique(np.concatenate([[0], edges, [size]]))
        todo = [int(b) for b in (self.batch_order or range)(edges.size - 1)]
        waiting: dict[int, tuple[chunks.ChunkJobs, chunks.ChunkSums]] = {}
        next_batch = 0
        for number, b in enumerate(todo):
            part = chunks.ChunkJobs(*(a[edges[b] : edges[b + 1]] for a in jobs))
            sums = self._walk(part, stop)
            waiting[b] = (part, sums)
            if np.any(sums.samples < part.samples):
                for done in waiting.values():
                    self.tally.add(*done)
                return False
            while next_batch in waiting:
                self.tally.add(*waiting.pop(next_batch))
                next_batch += 1
            self._report(index, n_rounds, (number + 1) / len(todo))
        self.chunks_used += -(-extra // self.settings.chunk_samples)
        return True

    def _jobs(self, extra: np.ndarray) -> chunks.ChunkJobs:
        """The chunks of `extra` samples (P, W, 2); all first chunks come before all second ones."""
        parts = []
        left = extra.copy()
        step = 0
        while np.any(left > 0):
            pixel, wavelength, arm = np.nonzero(left > 0)
            samples = np.minimum(left[pixel, wavelength, arm], self.settings.chunk_samples)
            chunk = (self.chunks_used[pixel, wavelength, arm] + step) * chunks.N_ARMS + arm
            parts.append(chunks.ChunkJobs(pixel, wavelength, arm, chunk, samples))
            left[pixel, wavelength, arm] -= samples
            step += 1
        if not parts:
            return chunks.ChunkJobs(*(np.zeros(0, dtype=np.int64) for _ in chunks.ChunkJobs._fields))
        return chunks.ChunkJobs(*(np.concatenate(column) for column in zip(*parts, strict=True)))

    def _walk(self, jobs: chunks.ChunkJobs, stop: np.ndarray) -> chunks.ChunkSums:
        field = self.field
        size = jobs.samples.size
        sums = np.zeros((size, self.n_stokes, N_ORDERS + 1))
        counts = np.zeros((2, size), dtype=np.int64)
        chunk_sums = chunks.ChunkSums(sums, np.zeros_like(sums), np.zeros((size, 2)), *counts)
        walk = self.settings.walk(field.medium.has_refraction)
        seed = np.uint64(self.settings.seed)

        def work(begin: int, end: int) -> None:
            air, sight_air = field.air, field.line_of_sight_air
            chunks.run_chunks(
                air, sight_air, field.sun, field.importance, walk, seed, self.pixels, jobs, begin, end, chunk_sums, stop
            )

        in_slices(work, size)
        return chunk_sums

    def _report(self, index: int, n_rounds: int, fraction: float) -> None:
        if self.field.progress:
            with np.errstate(all="ignore"):
                error = np.nanmedian(self.tally.relative_error())
            self.field.progress(
                f"montecarlo: round {index + 1} of {n_rounds}, median standard error {100 * error:.2g} %",
                (index + fraction) / n_rounds,
            )


def warn_of_unknown(tally: chunks.Tally) -> None:
    """A TwilightWarning where too few paths found light to know how much there is."""
    unknown = tally.unknown()
    if unknown.any():
        warnings.warn(
            f"montecarlo: too few paths find light in {unknown.sum()} of {unknown.size} directions and wavelengths, "
            "which have no value (nan); more of solver.time_limit_s, solver.samples or solver.max_samples may give "
            "them one",
            TwilightWarning,
            stacklevel=3,
        )


def prepare(
    medium: Medium,
    settings: MonteCarloSettings | None = None,
    *,
    observer_altitude_km: float = 0.0,
    progress: Progress | None = None,
) -> MonteCarloField:
    """All that depends on the medium alone, as of `solvers.base.Solver`: tables of the air, of the direct beam and of
    the importance function.  Errors: TwilightError for an observer below the ground."""
    settings = settings or MonteCarloSettings()
    altitude_km = observer_at(medium, observer_altitude_km)
    if progress:
        progress("montecarlo: direct beam and importance function", 0.0)
    isotropic = settings.approximation == "isotropic_after_first"
    air = prepare_air(medium, 1 if isotropic else None)
    # Of light scattered once the narrow forward peak (moment 3) alone counts as unscattered on the line of sight: all
    # of g would brighten a hazy horizon up to twofold, none of it would lose light.
    line_of_sight_air = prepare_air(medium, 3) if isotropic else air
    beam = prepare_beam(medium, refraction=settings.refraction, spreading=settings.spreading)
    table = prepare_beam_table(air, beam)
    if medium.screen is not None:
        # the walk looks up a screened table; what is exact has the screen at its place
        bare = replace(medium, screen=None)
        beam = prepare_beam(bare, refraction=settings.refraction, spreading=settings.spreading)
    screen = screen_in_space(medium, settings.refraction and medium.has_refraction)
    sun = SolarBeam(beam, table, settings.exact_beam_fraction, screen)
    with stop_after(settings.time_limit_s) as stop:
        importance = solve_importance(air, medium, sun, settings.importance_sweeps, stop)
    return MonteCarloField(medium, settings, air, line_of_sight_air, sun, importance, altitude_km, progress)


@dataclass(frozen=True)
class MonteCarloField(BareField):
    """A medium ready for random walks; made by :func:`prepare`."""

    medium: Medium
    settings: MonteCarloSettings
    air: MonteCarloAir
    line_of_sight_air: MonteCarloAir
    sun: SolarBeam
    importance: ImportanceTables
    observer_altitude_km: float
    progress: Progress | None = None

    def radiance(self, sun_elevation_deg, elevation_deg, azimuth_deg) -> np.ndarray:
        """Sun-normalised radiance L/F0 [sr^-1], shape (..., W); azimuths are from the sun."""
        return self.radiance_with_error(sun_elevation_deg, elevation_deg, azimuth_deg).radiance

    @property
    def polarised(self) -> bool:
        """Whether paths carry Stokes vectors."""
        return self.settings.polarised

    def stokes(self, sun_elevation_deg, elevation_deg, azimuth_deg) -> np.ndarray:
        """Sun-normalised Stokes vectors I, Q, U [sr^-1], as of `solvers.base.PolarisedField`; arguments as in
        `radiance_with_error`.  Errors: TwilightError where the field was prepared without polarisation."""
        return self.stokes_with_error(sun_elevation_deg, elevation_deg, azimuth_deg).stokes

    def stokes_with_error(
        self, sun_elevation_deg, elevation_deg, azimuth_deg, *, batch_order: Callable | None = None
    ) -> chunks.StokesResult:
        """:meth:`stokes` with standard errors; arguments as in :meth:`radiance_with_error`."""
        if not self.settings.polarised:
            raise TwilightError("montecarlo was prepared without polarisation: it knows I alone, not Q and U")
        run, shape = self._run(sun_elevation_deg, elevation_deg, azimuth_deg, batch_order)
        complete = run.all_rounds()
        warn_of_unknown(run.tally)
        return run.tally.stokes(shape, complete)

    def radiance_with_error(
        self, sun_elevation_deg, elevation_deg, azimuth_deg, *, batch_order: Callable | None = None
    ) -> chunks.MonteCarloResult:
        """Radiance with standard errors, in all and by order of scattering: arrays (..., W) over the directions and
        wavelengths; nan, with a warning, where too few paths find light.

        Arguments as of `solvers.base.Field.radiance`.  batch_order: maps a number of batches to a permutation of them;
        the answer does not depend on it.  Errors: TwilightError for an angle out of range."""
        run, shape = self._run(sun_elevation_deg, elevation_deg, azimuth_deg, batch_order)
        complete = run.all_rounds()
        warn_of_unknown(run.tally)
        return run.tally.result(shape, complete)

    def inscatter(self, sun_elevation_deg, elevation_deg, azimuth_deg, distance_km) -> tuple[np.ndarray, np.ndarray]:
        """As `SegmentField.inscatter`: (sun-normalised radiance [sr^-1], transmittance), shape (..., W) each."""
        scattered, passed = self.inscatter_with_error(sun_elevation_deg, elevation_deg, azimuth_deg, distance_km)
        return scattered.radiance, passed

    def inscatter_with_error(
        self, sun_elevation_deg, elevation_deg, azimuth_deg, distance_km
    ) -> tuple[chunks.MonteCarloResult, np.ndarray]:
        """Radiance that the air up to a distance scatters in, as of `radiance_with_error`, and the transmittance (...,
        W) of that air.  Errors: TwilightError for a distance that is not a number of 0 or more."""
        far = np.minimum(np.asarray(distance_km, dtype=float), FARTHEST_KM)
        run, shape = self._run(sun_elevation_deg, elevation_deg, azimuth_deg, None, far)
        passed = np.empty((run.pixels.key.size, self.medium.n_wavelengths))
        walk = self.settings.walk(self.medium.has_refraction)
        in_slices(
            lambda begin, end: chunks.line_of_sight_transmittance(
                self.air, self.sun, self.importance, walk, run.pixels, begin, end, passed
            ),
            run.pixels.key.size,
        )
        complete = run.all_rounds()
        warn_of_unknown(run.tally)
        return run.tally.result(shape, complete), passed.reshape(*shape, -1)

    def _run(self, sun_elevation_deg, elevation_deg, azimuth_deg, batch_order, distance_km=np.inf):
        """The question as a :class:`Run`, and the shape of its directions."""
        pixels, shape = self.question(sun_elevation_deg, elevation_deg, azimuth_deg, distance_km)
        return Run(self, pixels, batch_order), shape

    def question(
        self, sun_elevation_deg, elevation_deg, azimuth_deg, distance_km=np.inf
    ) -> tuple[chunks.Pixels, tuple[int, ...]]:
        """The pixels of a question, and the shape of its directions."""
        sun, elevation, azimuth, far = np.broadcast_arrays(
            *(np.asarray(a, dtype=float) for a in (sun_elevation_deg, elevation_deg, azimuth_deg, distance_km))
        )
        if not np.all(far >= 0.0):
            raise TwilightError("distance_km must be 0 or more")
        for name, a, limit in (("sun_elevation_deg", sun, 90.0), ("elevation_deg", elevation, 90.0)):
            if not np.all(np.abs(a) <= limit):
                raise TwilightError(f"{name} must be between -{limit:g} and {limit:g}")
        if not np.all(np.isfinite(azimuth)):
            raise TwilightError("azimuth_deg must be finite")
        pixels = pixels_of(
            sun.ravel(),
            elevation.ravel(),
            azimuth.ravel(),
            far.ravel(),
            self.observer_altitude_km,
            self.medium.wavelength_nm,
        )
        return pixels, sun.shape
