"""`Block`: some wavelengths of a scene, solved, that answers for any sun, observer and direction."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from twilight.atmosphere.bands import GasBands
from twilight.atmosphere.medium import Medium
from twilight.base import cache
from twilight.base.errors import TwilightError
from twilight.base.progress import Progress
from twilight.engine.answer import Answer, answer_of_stokes, join, sum_terms
from twilight.engine.directions import check_question
from twilight.engine.field_cache import field_key
from twilight.engine.sunbeam import Direct, Sunbeam
from twilight.engine.table import fill, first_rows, row_breaks
from twilight.numerics.grids import half_of
from twilight.sky.table import SkyTable
from twilight.solvers.base import Field, Interpolation
from twilight.transport.scattered_once import ScatteredOnce

if TYPE_CHECKING:
    from twilight.engine.solve import Problem

VALUES_AT_ONCE = 400_000
"""Directions times wavelengths of a texture or a view that a solver is asked for at once, by rows: the memory that each
of them takes is free before the next rows."""


class Block:
    """A block of wavelengths, solved.

    Parameters
    ----------
    problem
        What the block is a part of.
    wavelengths
        Range of indices into the wavelengths of the problem's scene.
    medium
        The medium at these wavelengths.
    bands
        Exponential sums of these wavelengths, whose terms are solved in place of the wavelengths; None: no gas bands.
    progress
        Called with how far a field is that has to be solved for another observer.

    Attributes
    ----------
    field
        The solver's own field (of the terms), of the observer who was asked for last.
    from_disk
        Whether the field was read from the cache.
    term_medium
        The medium with a column for each term in place of each wavelength; without bands the medium itself.
    """

    field: Field

    def __init__(
        self, problem: Problem, wavelengths: slice, medium: Medium, bands: GasBands | None, progress: Progress
    ):
        self.problem, self.scene = problem, problem.scene
        self.wavelengths, self.medium, self.bands = wavelengths, medium, bands
        self.capabilities = problem.scene.capabilities
        self.from_disk = False
        self.term_medium = medium if bands is None else bands.expand(medium)
        self.sunbeam = Sunbeam(self.term_medium, self.capabilities.kind != "transport" or problem.numpy_only_sun)
        self._progress = progress
        self._altitude_km = problem.scene.altitude_km
        self._once: ScatteredOnce | None = None

    @classmethod
    def solve(
        cls, problem: Problem, wavelengths: slice, medium: Medium, bands: GasBands | None, progress: Progress
    ) -> Block:
        """Solve the field of some wavelengths for the observer of the scene; arguments as of the class."""
        block = cls(problem, wavelengths, medium, bands, progress)
        block.field = block._prepare(block._altitude_km)
        return block

    def _prepare(self, altitude_km: float) -> Field:
        """The field for an observer, from the cache where it has it."""
        scene = self.scene
        known = {"sun_elevations_deg": self._known_suns_deg, "interpolation": self._interpolation}
        more: dict[str, Any] = {name: value for name, value in known.items() if value is not None}

        def solved(settings: Any) -> Field:
            return scene.solver.prepare(
                self.term_medium, settings, observer_altitude_km=altitude_km, progress=self._progress, **more
            )

        settings = scene.settings
        if not self.problem.cached or not hasattr(settings, "field_file") or settings.field_file:
            return solved(settings)
        key = self.key(altitude_km)
        path = cache.find(cache.FIELDS, key)
        if path is not None:
            try:
                read = solved(replace(settings, field_file=str(path)))
                self.from_disk = True
                return read
            except TwilightError:  # damaged
                cache.discard(path)
        made: Any = solved(settings)
        cache.store(cache.FIELDS, key, made.save)
        return made

    def key(self, altitude_km: float) -> str:
        """The key of the field of an observer in the cache: a hash of all that enters."""
        solver, settings = self.scene.solver.__name__, self.scene.settings
        return field_key(solver, settings, self.term_medium, self._known_suns_deg, altitude_km, self._interpolation)

    @property
    def _known_suns_deg(self) -> list[float] | None:
        """All suns that will be asked for [deg], where the solver takes them; None: any."""
        known = self.problem.sun_elevations_deg
        return list(known) if known is not None and self.capabilities.takes_suns else None

    @property
    def _interpolation(self) -> Interpolation | None:
        """What interpolates light over the block's spectral group; None: every wavelength is solved."""
        return self.problem.interpolations[self.wavelengths.start]

    def rows_at_once(self, columns: int) -> int:
        """Rows of so many directions that the solver is asked for at once."""
        return max(1, VALUES_AT_ONCE // (columns * self.term_medium.n_wavelengths))

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

        polarisation: also Q and U, where the field has them.  checkpoint: where a solver with standard errors saves
        what it has begun.  A solver whose field belongs to one observer solves anew for another one.  Standard errors
        of a wavelength's terms are added, for their noise may be correlated.
        Errors: TwilightError for what the solver cannot do, and where it gave radiance that cannot be.
        """
        directions = (sun_elevation_deg, elevation_deg, azimuth_deg)
        check_question(*directions)
        made, more = self._seen_from(observer_altitude_km)
        if checkpoint is not None and self.capabilities.standard_error:
            more["checkpoint"] = checkpoint
        polarised = polarisation and made.polarised
        if self.capabilities.standard_error and polarised:
            with_noise = made.stokes_with_error(*directions, **more)
            found = answer_of_stokes(with_noise.stokes, with_noise.standard_error)
        elif self.capabilities.standard_error:
            estimate = made.radiance_with_error(*directions, **more)
            found = Answer(estimate.radiance, estimate.standard_error)
        elif polarised:
            found = answer_of_stokes(made.stokes(*directions, **more))
        else:
            found = Answer(made.radiance(*directions, **more))
        estimated = found.standard_error is not None
        if not (np.isfinite(found.radiance).all() and (estimated or (found.radiance >= 0.0).all())):
            raise TwilightError("the solver gave radiance that is negative or not a number")
        if found.polarisation is not None and not np.isfinite(found.polarisation).all():
            raise TwilightError("the solver gave a Stokes parameter that is not a number")
        return found if self.bands is None else sum_terms(found, self.bands)

    def _seen_from(self, altitude_km: float | None) -> tuple[Any, dict[str, Any]]:
        """The field that serves an observer, and further arguments of its methods."""
        if self.capabilities.every_observer:
            return self.field, {} if altitude_km is None else {"observer_altitude_km": altitude_km}
        wanted = self.scene.altitude_km if altitude_km is None else altitude_km
        if wanted != self._altitude_km:
            self.field = self._prepare(wanted)
            self._altitude_km = wanted
        return self.field, {}

    def inscatter(
        self,
        sun_elevation_deg: float,
        elevation_deg: ArrayLike,
        azimuth_deg: ArrayLike,
        distance_km: ArrayLike,
        observer_altitude_km: float | None = None,
    ) -> tuple[np.ndarray, np.ndarray]:
        """(sun-normalised radiance [sr^-1], transmittance) of the air up to distances [km], as of `SegmentField`.

        Errors: TwilightError for a solver that knows whole lines of sight alone.
        """
        if not self.capabilities.finite_segments:
            raise TwilightError("inscatter: this solver knows whole lines of sight alone; zones, tables and montecarlo "
                                "know finite ones")  # fmt: skip
        check_question(sun_elevation_deg, elevation_deg, azimuth_deg)
        made, more = self._seen_from(observer_altitude_km)
        scattered, transmittance = made.inscatter(sun_elevation_deg, elevation_deg, azimuth_deg, distance_km, **more)
        if self.bands is None:
            return scattered, transmittance
        return self.bands.sum_terms(scattered), self.bands.sum_terms(transmittance)

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
        rows_at_once = self.rows_at_once(columns.size)
        parts = []
        for start in range(0, elevation_deg.size, rows_at_once):
            e, a = np.meshgrid(elevation_deg[start : start + rows_at_once], columns, indexing="ij")
            parts.append(self.answer(sun_elevation_deg, e, a, observer_altitude_km, polarisation=True))
        half = join(parts, axis=0)
        if half.polarisation is None:
            return Answer(half.radiance[:, back])
        mirrored = half.polarisation[:, back]
        mirrored[:, azimuth_deg > 180.0, 1] *= -1.0
        return Answer(half.radiance[:, back], None, mirrored)

    def table(
        self,
        sun_elevation_deg: float,
        observer_altitude_km: float | None = None,
        *,
        rows_deg: np.ndarray | None = None,
        columns_deg: np.ndarray | None = None,
        **limits: Any,
    ) -> SkyTable:
        """The sky of one sun on nodes that are as close as its light needs: `twilight.engine.table.fill`.

        rows_deg, columns_deg: nodes to begin with, those of another table; None: the usual.  limits: as of `fill`.
        """
        altitude = self.scene.altitude_km if observer_altitude_km is None else observer_altitude_km
        if self._once is None or self._once.altitude_km != altitude:
            self._once = ScatteredOnce(self.medium, self.bands, altitude, aerosol=self.capabilities.kind != "formula")
        rows = first_rows(*row_breaks(self.scene, altitude)) if rows_deg is None else rows_deg

        def light(elevation_deg: np.ndarray, azimuth_deg: np.ndarray) -> Answer:
            return self.texture(sun_elevation_deg, elevation_deg, azimuth_deg, altitude)

        return fill(light, self._once, sun_elevation_deg, rows, columns_deg, **limits)

    def direct(self, sun_elevation_deg: float, observer_altitude_km: float | None = None) -> Direct:
        """The sun's direct light at an observer."""
        altitude = self.scene.altitude_km if observer_altitude_km is None else observer_altitude_km
        found = self.sunbeam.at(sun_elevation_deg, altitude)
        return found if self.bands is None else found._replace(irradiance=self.bands.sum_terms(found.irradiance))
