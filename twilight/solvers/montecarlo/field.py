"""The prepared solver: air, beam and steering of one medium, asked for any sun and any direction."""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from twilight.atmosphere.medium import Medium
from twilight.errors import TwilightError
from twilight.progress import Progress
from twilight.solvers.base import BareField, observer_at
from twilight.solvers.montecarlo.air import Air, prepare_air
from twilight.solvers.montecarlo.checkpoint import Checkpoint, fingerprint
from twilight.solvers.montecarlo.chunks import Jobs, Pixels, Sums, run_chunks, sight_transmittance
from twilight.solvers.montecarlo.coarse import solve_steering
from twilight.solvers.montecarlo.matrix import N_STOKES
from twilight.solvers.montecarlo.paths import N_ORDERS
from twilight.solvers.montecarlo.settings import MonteCarloSettings
from twilight.solvers.montecarlo.steering import Steering
from twilight.solvers.montecarlo.sunlight import Sun
from twilight.solvers.montecarlo.suntable import prepare_sun_table
from twilight.solvers.montecarlo.tally import N_ARMS, MonteCarloResult, StokesResult, Tally
from twilight.threads import in_slices
from twilight.transport.beam import prepare_beam

FARTHEST_KM = 1e7
"""Distance at which a segment has left all air."""
BATCH_SAMPLES = 4096
FIRST_SAMPLES = 2
"""Samples of an arm that are taken whatever the time limit: without them there is no standard error."""
ADAPTIVE_ROUNDS, LATE_ROUNDS = 2, 6
"""Rounds in which the arms set each other's counts, and rounds for pixels that still miss the error asked for."""


def prepare(
    medium: Medium,
    settings: MonteCarloSettings | None = None,
    *,
    observer_altitude_km: float = 0.0,
    progress: Progress | None = None,
) -> Field:
    """Everything that depends on the medium alone; `progress(doing, share)` is called now and then.

    Raises TwilightError for an observer below the ground.
    """
    settings = settings or MonteCarloSettings()
    altitude_km = observer_at(medium, observer_altitude_km)
    if progress:
        progress("montecarlo: beam and coarse field", 0.0)
    isotropic = settings.approximation == "isotropic_after_first"
    air = prepare_air(medium, 1 if isotropic else None)
    # Light scattered once keeps only its narrow forward peak (moment 3) on the line of sight: counting all of g as
    # unscattered would brighten a hazy horizon up to twofold, counting none would lose light.
    sight = prepare_air(medium, 3) if isotropic else air
    beam = prepare_beam(medium, refraction=settings.refraction, spreading=settings.spreading)
    sun = Sun(beam, prepare_sun_table(air, beam), settings.check_rate)
    with _stop_after(settings.time_limit_s) as stop:
        steering = solve_steering(air, medium, sun, settings.steering_sweeps, stop)
    return Field(medium, settings, air, sight, sun, steering, altitude_km, progress)


@contextmanager
def _stop_after(seconds: float | None) -> Iterator[np.ndarray]:
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


@dataclass(frozen=True)
class Field(BareField):
    """A medium ready for random walks; made by :func:`prepare`."""

    medium: Medium
    settings: MonteCarloSettings
    air: Air
    sight: Air
    sun: Sun
    steering: Steering
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
        """Sun-normalised Stokes vectors I, Q, U [sr^-1], shape (..., 3, W); azimuths are from the sun.

        Q > 0 is light that vibrates in the vertical plane through the line of sight (in the zenith that of the azimuth
        asked for); U > 0 is light whose vibration, for somebody who looks along the line of sight with the zenith side
        up, leans from the vertical to the right, towards larger azimuth.  The angle of vibration, clockwise from the
        vertical, is atan2(U, Q) / 2.  Signs as in Emde et al. 2015 (IPRT).
        Raises TwilightError for a field that was prepared without polarisation.
        """
        return self.stokes_with_error(sun_elevation_deg, elevation_deg, azimuth_deg).stokes

    def stokes_with_error(
        self, sun_elevation_deg, elevation_deg, azimuth_deg, *, checkpoint: str | Path | None = None, batch_order=None
    ) -> StokesResult:
        """:meth:`stokes` with standard errors; arguments as in :meth:`radiance_with_error`."""
        if not self.settings.polarised:
            raise TwilightError("montecarlo was prepared without polarisation: it knows I alone, not Q and U")
        run, shape = self._run(sun_elevation_deg, elevation_deg, azimuth_deg, checkpoint, batch_order)
        return run.tally.stokes(shape, run.all_rounds())

    def radiance_with_error(
        self, sun_elevation_deg, elevation_deg, azimuth_deg, *, checkpoint: str | Path | None = None, batch_order=None
    ) -> MonteCarloResult:
        """Radiance with standard errors and orders kept apart.

        Arguments [deg] are broadcast; elevation below 0 looks down.  With `checkpoint` (a file), the state is saved
        every few seconds and when interrupted, and a later call with the same question goes on from there.
        `batch_order` maps a number of batches to a permutation of them; the answer does not depend on it.
        """
        run, shape = self._run(sun_elevation_deg, elevation_deg, azimuth_deg, checkpoint, batch_order)
        return run.tally.result(shape, run.all_rounds())

    def inscatter(self, sun_elevation_deg, elevation_deg, azimuth_deg, distance_km) -> tuple[np.ndarray, np.ndarray]:
        """As `SegmentField.inscatter`: (sun-normalised radiance [sr^-1], transmittance), shape (..., W) each."""
        found, passed = self.inscatter_with_error(sun_elevation_deg, elevation_deg, azimuth_deg, distance_km)
        return found.radiance, passed

    def inscatter_with_error(
        self, sun_elevation_deg, elevation_deg, azimuth_deg, distance_km
    ) -> tuple[MonteCarloResult, np.ndarray]:
        """(radiance with standard errors that the air up to a distance scatters in, transmittance (..., W)).

        Errors: as `radiance`, and TwilightError for a distance that is not a number of 0 or more.
        """
        far = np.minimum(np.asarray(distance_km, dtype=float), FARTHEST_KM)
        run, shape = self._run(sun_elevation_deg, elevation_deg, azimuth_deg, None, None, far)
        passed = np.empty((run.pixels.key.size, self.medium.n_wavelengths))
        walk = self.settings.walk(self.medium.has_refraction)
        in_slices(
            lambda begin, end: sight_transmittance(
                self.air, self.sun, self.steering, walk, run.pixels, begin, end, passed
            ),
            run.pixels.key.size,
        )
        return run.tally.result(shape, run.all_rounds()), passed.reshape(*shape, -1)

    def _run(self, sun_elevation_deg, elevation_deg, azimuth_deg, checkpoint, batch_order, distance_km=np.inf):
        """The question as a :class:`_Run`, and the shape of its directions."""
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
        pixels = _pixels(
            sun.ravel(),
            elevation.ravel(),
            azimuth.ravel(),
            far.ravel(),
            self.observer_altitude_km,
            self.medium.wavelength_nm,
        )
        return _Run(self, pixels, checkpoint, batch_order), sun.shape


def _pixels(sun_deg, elevation_deg, azimuth_deg, far_km, altitude_km: float, wavelength_nm) -> Pixels:
    """The key is a hash of the geometry, so a pixel's answer does not depend on its neighbours in the call."""
    key = np.zeros(sun_deg.size, dtype=np.uint64)
    parts = [sun_deg, elevation_deg, azimuth_deg, np.full(sun_deg.size, altitude_km)]
    if np.isfinite(far_km).any():
        parts.append(far_km)
    for part in parts:
        bits = np.ascontiguousarray(part + 0.0).view(np.uint64)
        key = _mix(key ^ bits)
    wavelength_key = np.round(1000.0 * wavelength_nm).astype(np.uint64)
    angles = (np.radians(sun_deg), np.radians(elevation_deg), np.radians(azimuth_deg))
    return Pixels(key, *angles, float(altitude_km), wavelength_key, np.asarray(far_km, dtype=float))


def _mix(z: np.ndarray) -> np.ndarray:
    z = z + np.uint64(0x9E3779B97F4A7C15)
    z = (z ^ (z >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    z = (z ^ (z >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return z ^ (z >> np.uint64(31))


class _Run:
    """One question on its way: rounds of jobs, batches of a round, sums in a fixed order."""

    def __init__(self, field: Field, pixels: Pixels, checkpoint, batch_order):
        self.field = field
        self.pixels = pixels
        self.settings = field.settings
        self.batch_order = batch_order
        self.started = time.monotonic()
        n_wavelengths = field.medium.n_wavelengths
        self.n_stokes = N_STOKES if self.settings.polarised else 1
        self.tally = Tally(pixels.key.size, n_wavelengths, self.n_stokes)
        self.chunks_used = np.zeros_like(self.tally.count)
        self.checkpoint = None
        self.skip_rounds, self.skip_batches = 0, 0
        if checkpoint is not None:
            self.checkpoint = Checkpoint(Path(checkpoint), fingerprint(field.medium, field.settings, pixels))
            state = self.checkpoint.load()
            if state is not None:
                self.tally.count, self.tally.sums, self.tally.squares = state.count, state.sums, state.squares
                self.tally.high = state.high
                self.tally.limited = state.limited
                self.chunks_used = state.chunks_used
                self.round_plan = state.round_plan
                self.skip_rounds, self.skip_batches = state.round_index, state.batch_index

    def all_rounds(self) -> bool:
        """Take all samples; False if a limit ended the run before the target."""
        limit = self.settings.time_limit_s
        rounds = self._rounds()
        with _stop_after(None if limit is None else max(0.0, limit - (time.monotonic() - self.started))) as stop:
            for index in range(self.skip_rounds, len(rounds)):
                resumed = index == self.skip_rounds and self.skip_batches > 0
                extra = self.round_plan if resumed else self._extra(rounds[index])
                if limit is not None and index > 0 and stop[0]:
                    return False
                unstoppable = index == 0
                never = np.zeros_like(stop)
                done = self.one_round(
                    index, len(rounds), extra, self.skip_batches if resumed else 0, never if unstoppable else stop
                )
                if not done:
                    return False
        if self.field.progress:
            self._report(len(rounds) - 1, len(rounds), 1.0)
        if self.checkpoint:
            self.checkpoint.remove()
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
        if purpose == "first":
            wanted = np.full(count.shape, FIRST_SAMPLES, dtype=np.int64)
        elif purpose == "all":
            wanted = np.full(count.shape, -(-settings.samples // N_ARMS), dtype=np.int64)
        elif purpose == "pilot":
            wanted = np.full(count.shape, settings.pilot_samples, dtype=np.int64)
        else:
            assert settings.target_stderr is not None
            wanted = self.tally.wanted(settings.target_stderr, settings.max_samples, purpose == "late")
        return np.maximum(wanted - count, 0)

    def one_round(self, index: int, n_rounds: int, extra: np.ndarray, first_batch: int, stop: np.ndarray) -> bool:
        """Take `extra` samples; False if time ran out, which the flag `stop` (1,) tells."""
        jobs = self._jobs(extra)
        edges = np.concatenate([[0], np.flatnonzero(np.diff(np.cumsum(jobs[4]) // BATCH_SAMPLES)) + 1, [jobs[0].size]])
        edges = np.unique(edges)
        n_batches = edges.size - 1
        todo = list(range(first_batch, n_batches))
        if self.batch_order is not None:
            todo = [first_batch + int(b) for b in self.batch_order(len(todo))]
        waiting: dict[int, tuple] = {}
        next_batch = first_batch
        try:
            for number, b in enumerate(todo):
                part = [a[edges[b] : edges[b + 1]] for a in jobs]
                sums = self._walk(part, stop)
                if np.any(sums.samples < part[4]):
                    # cut short: it counts for the answer, and is taken up whole by who goes on
                    if self.checkpoint:
                        self.checkpoint.save(self._state(index, next_batch, extra))
                    waiting[b] = (part, sums)
                    for other, rows in waiting.values():
                        self.tally.add(other[0], other[1], other[2], rows)
                    return False
                waiting[b] = (part, sums)
                while next_batch in waiting:
                    other, rows = waiting.pop(next_batch)
                    self.tally.add(other[0], other[1], other[2], rows)
                    next_batch += 1
                self._report(index, n_rounds, (number + 1) / len(todo))
                if self.checkpoint:
                    self.checkpoint.save_if_due(self._state(index, next_batch, extra))
        except KeyboardInterrupt:
            if self.checkpoint:
                self.checkpoint.save(self._state(index, next_batch, extra))
            raise
        self.chunks_used += -(-extra // self.settings.chunk_samples)
        return True

    def _jobs(self, extra: np.ndarray):
        """Arrays pixel, wavelength, arm, chunk number, samples; all first chunks come before all second ones."""
        size = self.settings.chunk_samples
        parts = []
        left = extra.copy()
        step = 0
        while np.any(left > 0):
            pixel, wavelength, arm = np.nonzero(left > 0)
            samples = np.minimum(left[pixel, wavelength, arm], size)
            chunk = (self.chunks_used[pixel, wavelength, arm] + step) * N_ARMS + arm
            parts.append((pixel, wavelength, arm, chunk, samples))
            left[pixel, wavelength, arm] -= samples
            step += 1
        if not parts:
            return [np.zeros(0, dtype=np.int64) for _ in range(5)]
        return [np.concatenate(column) for column in zip(*parts, strict=True)]

    def _walk(self, part, stop: np.ndarray) -> Sums:
        pixel, wavelength, _, chunk, samples = part
        field = self.field
        first = np.zeros((pixel.size, self.n_stokes, N_ORDERS + 1))
        sums = Sums(
            first,
            np.zeros_like(first),
            np.zeros((pixel.size, 2)),
            np.zeros(pixel.size, dtype=np.int64),
            np.zeros(pixel.size, dtype=np.int64),
        )
        jobs = Jobs(pixel, wavelength, chunk, samples)
        walk = self.settings.walk(field.medium.has_refraction)
        seed = np.uint64(self.settings.seed)

        def work(begin: int, end: int) -> None:
            run_chunks(
                field.air, field.sight, field.sun, field.steering, walk, seed, self.pixels, jobs, begin, end, sums, stop
            )

        in_slices(work, pixel.size)
        return sums

    def _state(self, index: int, next_batch: int, extra: np.ndarray) -> dict:
        return {
            "count": self.tally.count,
            "sums": self.tally.sums,
            "squares": self.tally.squares,
            "high": self.tally.high,
            "limited": self.tally.limited,
            "chunks_used": self.chunks_used,
            "round_plan": extra,
            "round_index": index,
            "batch_index": next_batch,
        }

    def _report(self, index: int, n_rounds: int, fraction: float) -> None:
        if self.field.progress:
            with np.errstate(all="ignore"):
                error = np.nanmedian(self.tally.relative_error())
            self.field.progress(
                f"montecarlo: round {index + 1} of {n_rounds}, median standard error {100 * error:.2g} %",
                (index + fraction) / n_rounds,
            )
