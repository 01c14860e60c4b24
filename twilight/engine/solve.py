"""The engine: from a medium and a solver to something that answers for any sun, observer and direction.

A `Problem` is what is to be solved.  Its wavelengths are divided into blocks of as many as the solver takes at once, so
that 1000 need no more memory than one block; a `Block` is one of them, solved.  Two ways lead on:

- `Problem.solve` (or `solve`) solves all blocks and holds them: a `Solved` answers at any time and in any order;
- `Problem.blocks` gives the blocks one by one and holds none: for a whole sequence at many wavelengths.
"""

from __future__ import annotations

import contextlib
import os
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from twilight import ahead, solvers
from twilight.atmosphere.bands import Bands
from twilight.atmosphere.medium import Medium
from twilight.config.scene import Config
from twilight.config.solver import resolve_solver
from twilight.disc import Disc
from twilight.engine.answer import Answer, joined, of_stokes, sky_of, stacked, summed
from twilight.engine.disc import make_disc
from twilight.engine.kept import KeptFields, kept_fields
from twilight.engine.sunbeam import Direct, Sunbeam
from twilight.errors import TwilightError
from twilight.grids import half_of
from twilight.progress import Progress, part_of, silent
from twilight.scene.medium import climate_bands, climate_medium, wavelengths_of
from twilight.scene.plan import LeftOut, make_plan
from twilight.sky import Sky
from twilight.solvers.base import Capabilities, Field, Solver, Takes

FIELD_BYTES = 1.0e9
"""Most memory of a block of wavelengths: what is more is divided into blocks, which do not change what is computed."""
VALUES_AT_ONCE = 400_000
"""Directions times wavelengths of a texture that a solver is asked for at once, by rows: what it needs for each of them
is gone before the next."""


def check_ground(medium: Medium, solver: Solver) -> None:
    """TwilightError where the ground is water and the solver knows land alone."""
    if medium.has_water and not solver.CAPABILITIES.water:
        name = solver.__name__.rsplit(".", 1)[-1]
        raise TwilightError(f"ground.kind: water cannot be seen by the solver {name}; zones and montecarlo can")


@dataclass(frozen=True)
class Problem:
    """What is to be solved.

    solver: a module as `solvers.load` gives it; settings: one of its QUALITIES, perhaps with options replaced.
    observer_altitude_km: where directions are seen from unless a question says otherwise; None: from the ground.
    sun_elevations_deg: all the suns that will be asked for [deg]; None: any.
    title: what to call it in errors; left_out: what the plan of its scene left out of the medium.
    kept: where solved fields are taken from and left for the next time; None: every field is solved here.
    bands: of gases, whose lanes are solved in place of the medium's wavelengths and summed.
    plain_sun: the sun's own light on the ground is found by quadrature, where one sun is not worth tables.
    """

    medium: Medium
    solver: Solver
    settings: Any
    observer_altitude_km: float | None = None
    sun_elevations_deg: tuple[float, ...] | None = None
    title: str = ""
    left_out: tuple[LeftOut, ...] = ()
    kept: KeptFields | None = None
    bands: Bands | None = None
    plain_sun: bool = False

    def __post_init__(self) -> None:
        check_ground(self.medium, self.solver)
        if len(self.slices) > 1 and self.capabilities.field_file and self.settings.field_file:
            raise TwilightError(
                f"solver.field_file: holds the field of up to {self.capabilities.wavelengths_at_once} wavelengths, and "
                f"{self.title or 'the medium'} has {self.medium.n_wavelengths}"
            )

    @property
    def capabilities(self) -> Capabilities:
        """What the solver declares."""
        return self.solver.CAPABILITIES

    @property
    def altitude_km(self) -> float:
        """Of the observer."""
        return self.medium.bottom_km if self.observer_altitude_km is None else self.observer_altitude_km

    @cached_property
    def takes(self) -> Takes | None:
        """What its fields take, where the solver knows."""
        if self.capabilities.takes is None:
            return None
        known = self.sun_elevations_deg if self.capabilities.takes_suns else None
        return self.capabilities.takes(self.medium, self.settings, known, self.altitude_km)

    @cached_property
    def wavelengths_at_once(self) -> int:
        """Most wavelengths of a block: as many as the solver takes and as FIELD_BYTES hold, in bands too."""
        most = self.capabilities.wavelengths_at_once
        if self.takes is None or self.medium.n_wavelengths <= self.takes.together:
            return most
        return self.takes.at_once(most, FIELD_BYTES, self.bands is not None)

    @cached_property
    def slices(self) -> list[slice]:
        """The blocks of wavelengths, as places in those of the medium.

        A block holds `wavelengths_at_once` lanes at most, at least one wavelength.  Wavelengths that are not
        alike to the solver share no block, nor do those in a band with others, whose grids would follow the band's
        lanes, unless a file is to hold them all.
        """
        step, count = self.wavelengths_at_once, self.medium.n_wavelengths
        lanes = np.ones(count, int) if self.bands is None else self.bands.lanes
        keys: list[Any] = [0] * count
        if count > 1 and not (self.capabilities.field_file and self.settings.field_file):
            if self.capabilities.alike is not None:
                keys = list(self.capabilities.alike(self.medium, self.settings))
            keys = [key if lanes[w] == 1 else 1 for w, key in enumerate(keys)]
        starts, held = [0], int(lanes[0])
        for w in range(1, count):
            held += int(lanes[w])
            if held > step or keys[w] != keys[w - 1]:
                starts.append(w)
                held = int(lanes[w])
        return [slice(start, stop) for start, stop in zip(starts, [*starts[1:], count], strict=True)]

    def block(self, index: int, progress: Progress | None = None) -> Block:
        """Solve one block."""
        part = self.slices[index]
        medium = self.medium if len(self.slices) == 1 else self.medium.select(part)
        bands = None if self.bands is None else self.bands.select(part)
        return Block(self, part, medium, progress or silent, bands if bands and bands.absorption_per_km.any() else None)

    def blocks(self, progress: Progress | None = None) -> Iterator[Block]:
        """Solve the blocks one by one; whoever takes one deletes it before the next, so that one alone is held."""
        for index in range(len(self.slices)):
            yield self.block(index, progress)

    def solve(self, progress: Progress | None = None) -> Solved:
        """Solve all blocks and hold them."""
        tell, count = progress or silent, len(self.slices)
        return Solved(self, tuple(self.block(i, part_of(tell, i / count, 1.0 / count)) for i in range(count)))


class Block:
    """A block of wavelengths, solved.

    wavelengths: its place in those of the problem; medium: at these wavelengths; bands: their lanes, if there are any;
    field: the solver's own (of the lanes), of the observer who was asked for last; from_disk: whether it was read.
    """

    def __init__(
        self, problem: Problem, wavelengths: slice, medium: Medium, progress: Progress, bands: Bands | None = None
    ):
        self.problem, self.wavelengths, self.medium, self.bands = problem, wavelengths, medium, bands
        self.capabilities = problem.capabilities
        self._lanes = medium if bands is None else bands.expand(medium)
        self.sunbeam = Sunbeam(self._lanes, self.capabilities.plain or problem.plain_sun)
        self._progress = progress
        self._altitude_km = problem.altitude_km
        self.from_disk = False
        self.field = self._prepare(self._altitude_km)
        ahead.wait()  # for what a look at the field calls

    def _prepare(self, altitude_km: float) -> Field:
        prepare: Any = self.problem.solver.prepare
        known = self.problem.sun_elevations_deg
        more = {"sun_elevations_deg": list(known)} if known is not None and self.capabilities.takes_suns else {}

        def solved(settings: Any) -> Field:
            return prepare(self._lanes, settings, observer_altitude_km=altitude_km, progress=self._progress, **more)

        settings, kept = self.problem.settings, self.problem.kept
        if kept is None or not self.capabilities.field_file or settings.field_file:
            return solved(settings)
        path = kept.path(
            self.problem.solver.__name__, settings, self._lanes, more.get("sun_elevations_deg"), altitude_km
        )
        if path.exists():
            with contextlib.suppress(OSError):  # a cache that may be read only
                os.utime(path)
            try:
                read = solved(replace(settings, field_file=str(path)))
                self.from_disk = True
                return read
            except TwilightError:  # damaged
                with contextlib.suppress(OSError):
                    path.unlink()
        made = solved(settings)
        kept.keep(path, made)
        return made

    def answer(
        self,
        sun_elevation_deg: float,
        elevation_deg: ArrayLike,
        azimuth_deg: ArrayLike,
        observer_altitude_km: float | None = None,
        *,
        polarisation: bool = False,
        checkpoint: Path | None = None,
    ) -> Answer:
        """Radiance in directions [deg] (azimuth from the sun), seen from an altitude; None: the problem's.

        polarisation: also Q and U, where the field has them.  checkpoint: where a solver with standard errors keeps
        what it has begun.  A solver whose field belongs to one observer solves anew for another one.  Standard errors
        of a wavelength's lanes are added, for their noise may be alike.
        Errors: TwilightError for what the solver cannot do, and where it gave radiance that cannot be.
        """
        directions = (sun_elevation_deg, elevation_deg, azimuth_deg)
        made, more = self._seen_from(observer_altitude_km)
        if checkpoint is not None and self.capabilities.standard_error:
            more["checkpoint"] = checkpoint
        polarised = polarisation and made.polarised
        if self.capabilities.standard_error and polarised:
            with_noise = made.stokes_with_error(*directions, **more)
            found = of_stokes(with_noise.stokes, with_noise.standard_error)
        elif self.capabilities.standard_error:
            estimate = made.radiance_with_error(*directions, **more)
            found = Answer(estimate.radiance, estimate.standard_error)
        elif polarised:
            found = of_stokes(made.stokes(*directions, **more))
        else:
            found = Answer(made.radiance(*directions, **more))
        estimated = found.standard_error is not None
        if not (np.isfinite(found.radiance).all() and (estimated or (found.radiance >= 0.0).all())):
            raise TwilightError("the solver gave radiance that is negative or not a number")
        if found.polarisation is not None and not np.isfinite(found.polarisation).all():
            raise TwilightError("the solver gave a Stokes parameter that is not a number")
        return found if self.bands is None else summed(found, self.bands)

    def _seen_from(self, altitude_km: float | None) -> tuple[Any, dict[str, Any]]:
        """The field that serves an observer, and what to tell it."""
        if self.capabilities.every_observer:
            return self.field, {} if altitude_km is None else {"observer_altitude_km": altitude_km}
        wanted = self.problem.altitude_km if altitude_km is None else altitude_km
        if wanted != self._altitude_km:
            self.field = self._prepare(wanted)
            self._altitude_km = wanted
        return self.field, {}

    def texture(
        self,
        sun_elevation_deg: float,
        elevation_deg: np.ndarray,
        azimuth_deg: np.ndarray,
        observer_altitude_km: float | None = None,
    ) -> Answer:
        """The sky on a grid of rows (E,) and columns (A,) [deg]: (E, A, W), never negative; polarised where it can be.

        The sky is its own mirror image about the sun's vertical: a deterministic solver is asked for one half only.
        In the other half I and Q are the same, and U has the other sign.
        """
        if self.capabilities.standard_error:
            e, a = np.meshgrid(elevation_deg, azimuth_deg, indexing="ij")
            found = self.answer(sun_elevation_deg, e, a, observer_altitude_km, polarisation=True)
            # few samples of a faint pixel may average below 0, which no sky is; its standard error says how little it
            # means
            return replace(found, radiance=np.maximum(found.radiance, 0.0))
        column, back = half_of(azimuth_deg)
        columns = azimuth_deg[column]
        rows_at_once = max(1, VALUES_AT_ONCE // (columns.size * self._lanes.n_wavelengths))
        parts = []
        for start in range(0, elevation_deg.size, rows_at_once):
            e, a = np.meshgrid(elevation_deg[start : start + rows_at_once], columns, indexing="ij")
            parts.append(self.answer(sun_elevation_deg, e, a, observer_altitude_km, polarisation=True))
        half = parts[0] if len(parts) == 1 else stacked(parts)
        if half.polarisation is None:
            return Answer(half.radiance[:, back])
        mirrored = half.polarisation[:, back]
        mirrored[:, azimuth_deg > 180.0, 1] *= -1.0
        return Answer(half.radiance[:, back], None, mirrored)

    def direct(self, sun_elevation_deg: float, observer_altitude_km: float | None = None) -> Direct:
        """The sun's direct light at an observer."""
        altitude = self.problem.altitude_km if observer_altitude_km is None else observer_altitude_km
        found = self.sunbeam.at(sun_elevation_deg, altitude)
        return found if self.bands is None else found._replace(irradiance=self.bands.summed(found.irradiance))


@dataclass(frozen=True)
class Solved:
    """A problem with all its blocks solved."""

    problem: Problem
    blocks: tuple[Block, ...] = field(repr=False)

    @property
    def medium(self) -> Medium:
        """The medium at all wavelengths."""
        return self.problem.medium

    def radiance(
        self,
        sun_elevation_deg: float,
        elevation_deg: ArrayLike,
        azimuth_deg: ArrayLike,
        observer_altitude_km: float | None = None,
    ) -> np.ndarray:
        """Sun-normalised radiance [sr^-1], shape of the directions [deg] plus (W,); arguments as `Block.answer`."""
        return self.radiance_with_error(sun_elevation_deg, elevation_deg, azimuth_deg, observer_altitude_km).radiance

    def radiance_with_error(
        self,
        sun_elevation_deg: float,
        elevation_deg: ArrayLike,
        azimuth_deg: ArrayLike,
        observer_altitude_km: float | None = None,
    ) -> Answer:
        """Radiance, and its standard error from a solver that estimates it."""
        question = (sun_elevation_deg, elevation_deg, azimuth_deg, observer_altitude_km)
        return joined([block.answer(*question) for block in self.blocks])

    def stokes(
        self,
        sun_elevation_deg: float,
        elevation_deg: ArrayLike,
        azimuth_deg: ArrayLike,
        observer_altitude_km: float | None = None,
    ) -> np.ndarray:
        """Sun-normalised Stokes parameters I, Q, U [sr^-1], shape of the directions plus (3, W).

        Errors: TwilightError for a field without polarisation.
        """
        question = (sun_elevation_deg, elevation_deg, azimuth_deg, observer_altitude_km)
        found = joined([block.answer(*question, polarisation=True) for block in self.blocks])
        if found.polarisation is None:
            raise TwilightError("this field has no Stokes parameters: its solver.polarisation is not true")
        return np.concatenate([found.radiance[..., None, :], found.polarisation], axis=-2)

    def direct(self, sun_elevation_deg: float, observer_altitude_km: float | None = None) -> Direct:
        """The sun's direct light at an observer."""
        found = [block.direct(sun_elevation_deg, observer_altitude_km) for block in self.blocks]
        return Direct(np.concatenate([one.irradiance for one in found]), found[-1].bending_deg)

    def disc(
        self, sun_elevation_deg: float, observer_altitude_km: float | None = None, *, distance_au: float = 1.0
    ) -> Disc:
        """The sun's disc as an observer sees it: `twilight.disc.Disc`."""
        altitude = self.problem.altitude_km if observer_altitude_km is None else observer_altitude_km
        return make_disc(self.medium, sun_elevation_deg, altitude, distance_au, self.problem.bands)

    def sky(
        self,
        sun_elevation_deg: float,
        elevation_deg: np.ndarray,
        azimuth_deg: np.ndarray,
        observer_altitude_km: float | None = None,
        **facts: Any,
    ) -> Sky:
        """The sky on a grid of rows (E,) and columns (A,) [deg]; `facts` are further fields of `Sky`."""
        altitude = self.problem.altitude_km if observer_altitude_km is None else observer_altitude_km
        answer = joined([b.texture(sun_elevation_deg, elevation_deg, azimuth_deg, altitude) for b in self.blocks])
        direct = self.direct(sun_elevation_deg, altitude)
        return sky_of(self.medium, (elevation_deg, azimuth_deg), answer, direct, sun_elevation_deg, altitude, **facts)

    def view(self, **options: Any) -> Any:
        """The field in a browser, for any sun and direction: a `twilight.window.View`, which a notebook shows and
        `save(path)` writes as HTML; options as `twilight.window.view_fields`.  Takes a minute or more.
        """
        from twilight.window import view_field

        return view_field(self, **options)


def problem_of(
    config: Config,
    sun_elevations_deg: Sequence[float] | None = None,
    *,
    wavelength_nm: np.ndarray | None = None,
    by: tuple[Solver, Any] | None = None,
    kept: KeptFields | None = None,
) -> Problem:
    """The problem of a configuration's scene: its climate without what its plan leaves out, its solver, its observer.

    sun_elevations_deg: all the suns that will be asked for, None: any.  wavelength_nm: in place of the scene's own.
    by: (solver, settings) in place of the configuration's.  kept: as of `Problem`.
    Errors: TwilightError for whatever in the configuration cannot be computed.
    """
    if by is None:
        name, _, settings = resolve_solver(config.solver)
        by = solvers.load(name), settings
    plan = make_plan(config, wavelength_nm)
    medium = climate_medium(plan.climate, wavelengths_of(config) if wavelength_nm is None else wavelength_nm)
    return Problem(
        medium,
        *by,
        config.observer.altitude_km,
        None if sun_elevations_deg is None else tuple(sun_elevations_deg),
        config.title,
        plan.left_out,
        kept,
        None if by[0].CAPABILITIES.formula else climate_bands(plan.climate, medium),
    )


def solve(
    config: Config, sun_elevations_deg: Sequence[float] | None = None, progress: Progress | None = None
) -> Solved:
    """Solve a configuration's scene, for the suns that will be asked for or for any (None), and hold it."""
    return problem_of(config, sun_elevations_deg, kept=kept_fields()).solve(progress)
