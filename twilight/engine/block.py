"""Some wavelengths of a scene, solved: a `Block` answers for any sun, observer and direction with Stokes parameters.

Solved fields are cached under a SHA-256 of all that enters, the solver's code included; the solver's own file format
guards the content of the file.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import asdict, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from twilight import solvers
from twilight.atmosphere.medium import Medium
from twilight.base import cache
from twilight.base.conventions import ROUNDING
from twilight.base.digest import code_digest, content_digest
from twilight.base.errors import TwilightError
from twilight.base.progress import Progress, silent
from twilight.engine.carried import MODEL, CarriedField
from twilight.engine.problem import VALUES_AT_ONCE, Problem
from twilight.engine.sunbeam import Direct, Sunbeam, disc_strips
from twilight.numerics.directions import half_of
from twilight.solvers.base import Field
from twilight.transport.scattered_once import ScatteredOnce

MANY_LEVELS = 300
"""Levels beyond which the sun's own light on the ground is found by quadrature: tables would break at each of them."""


Stokes = np.ndarray
"""Sun-normalised Stokes parameters [sr^-1], shape of the directions plus (S, W): S is 1, radiance alone, or 3: I, Q, U
(signs: `twilight.base.conventions`); nan where a solver whose answers are estimates does not know them."""
StokesWithError = tuple[Stokes, Stokes | None]
"""They and their standard errors, None where there are none."""


def join(parts: Sequence[StokesWithError], axis: int = -1) -> StokesWithError:
    """The light of all blocks of wavelengths from that of each; axis 0: from that of some rows of a texture each."""
    if len(parts) == 1:
        return parts[0]
    stokes, errors = zip(*parts, strict=True)
    return np.concatenate(stokes, axis=axis), None if errors[0] is None else np.concatenate(errors, axis=axis)


class Block:
    """A block of wavelengths, solved; index: which of the problem's parts.

    wavelengths: range of indices into those of the problem's scene; medium: at these; bands: exponential sums of them,
        whose terms are solved in place of the wavelengths, None: no gas bands; term_medium: with a column for each term
    carrier: what carries light of the terms from nodes; None: they are solved
    field: the solver's own (of the terms), of the observer who was asked for last; from_disk: read from the cache"""

    def __init__(self, problem: Problem, index: int, progress: Progress = silent):
        self.problem, self.scene = problem, problem.scene
        self.wavelengths = problem.slices[index]
        self.medium, self.bands = problem.part(index)
        self.capabilities = problem.scene.capabilities
        self.from_disk = False
        self.term_medium = self.medium if self.bands is None else self.bands.expand(self.medium)
        self.carrier = problem.carriers[self.wavelengths.start]
        layered = self.medium.altitude_km.size > MANY_LEVELS
        in_numpy = (
            self.capabilities.kind != "transport" or problem.numpy_only_sun or layered or self.carrier is not None
        )
        self.sunbeam = Sunbeam(self.term_medium, in_numpy)
        self._progress = progress
        self._altitude_km = problem.scene.altitude_km
        self._once: ScatteredOnce | None = None
        self._widening: dict[float, np.ndarray] = {}
        self.field: Field = self._prepare(self._altitude_km)

    def _prepare(self, altitude_km: float) -> Field:
        """The field for an observer: solved, or carried from that of its nodes."""
        if self.carrier is None:
            return self._solved(self.term_medium, altitude_km)
        nodes = self.carrier.nodes
        at_nodes = self.carrier.solved(altitude_km, lambda: self._solved(nodes, altitude_km))
        try:
            return CarriedField.of(self.term_medium, self.medium, self.bands, self.carrier, at_nodes, altitude_km)
        except TwilightError:  # the model has the air of the nodes, and not that of all
            self.carrier = None
            return self._prepare(altitude_km)

    def _solved(self, medium: Medium, altitude_km: float) -> Field:
        """The solver's field of a medium for an observer, from the cache where it has it."""
        scene, known = self.scene, self._known_suns_deg
        more: dict[str, Any] = {} if known is None else {"sun_elevations_deg": known}

        def solved(settings: Any) -> Field:
            return scene.solver.prepare(
                medium, settings, observer_altitude_km=altitude_km, progress=self._progress, **more
            )

        settings = scene.settings
        if not self.problem.cached or not hasattr(settings, "field_file") or settings.field_file:
            return solved(settings)
        key = field_key(scene.solver.__name__, settings, medium, known, altitude_km)
        path = cache.find(cache.FIELDS, key)
        if path is not None:
            try:
                read = solved(replace(settings, field_file=str(path)))
                self.from_disk = True
                return read
            except TwilightError:  # damaged
                cache.discard(path)
        field: Any = solved(settings)
        cache.store(cache.FIELDS, key, field.save)
        return field

    def key(self, altitude_km: float) -> str:
        """The key of the field of an observer in the cache: a hash of all that enters."""
        question = (self.scene.solver.__name__, self.scene.settings)
        key = field_key(*question, self.term_medium, self._known_suns_deg, altitude_km)
        if self.carrier is None:
            return key
        nodes = field_key(*question, self.carrier.nodes, self._known_suns_deg, altitude_km)
        return f"{key} carried from {nodes} by {code_digest(solvers.load(MODEL).__name__)}"

    @cached_property
    def _all_solved(self) -> list[Block]:
        """The same wavelengths without the fitted model, for what it does not have: each is solved."""
        settings = replace(self.scene.settings, spectrum="solved")
        scene = replace(self.scene, medium=self.medium, bands=self.bands, settings=settings)
        problem = replace(self.problem, scene=scene)
        return [Block(problem, index, self._progress) for index in range(len(problem.slices))]

    def _beyond_the_model(self, sun_elevation_deg: float, elevation_deg: Any, altitude_km: float | None) -> list[Block]:
        """Blocks that answer in place of this one, where its light is carried and the model lacks the question."""
        if self.carrier is None or self.field.serves(sun_elevation_deg, elevation_deg, altitude_km):  # type: ignore[attr-defined]
            return []
        return self._all_solved

    @property
    def _known_suns_deg(self) -> list[float] | None:
        """All suns that will be asked for [deg], where the solver takes them; None: any."""
        known = self.problem.sun_elevations_deg
        return list(known) if known is not None and self.capabilities.takes_suns else None

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
    ) -> StokesWithError:
        """Light of directions [deg] (azimuth from the sun), seen from an altitude; None: the problem's.

        polarisation: also Q and U, where the field has them.  A solver whose field belongs to one observer solves anew
        for another one.  Standard errors of a wavelength's terms are added, for their noise may be correlated.
        Errors: TwilightError for what the solver cannot do, and where it gave radiance that cannot be.
        """
        directions = (sun_elevation_deg, elevation_deg, azimuth_deg)
        check_question(*directions)
        solved = self._beyond_the_model(sun_elevation_deg, elevation_deg, observer_altitude_km)
        if solved:
            asked = (*directions, observer_altitude_km)
            return join([block.answer(*asked, polarisation=polarisation) for block in solved])
        field, more = self._seen_from(observer_altitude_km)
        polarised = polarisation and field.polarised
        if self.capabilities.standard_error and polarised:
            with_noise = field.stokes_with_error(*directions, **more)
            stokes, error = with_noise.stokes, with_noise.standard_error
        elif self.capabilities.standard_error:
            estimate = field.radiance_with_error(*directions, **more)
            stokes, error = estimate.radiance[..., None, :], estimate.standard_error[..., None, :]
        elif polarised:
            stokes, error = field.stokes(*directions, **more), None
        else:
            stokes, error = field.radiance(*directions, **more)[..., None, :], None
        radiance = stokes[..., 0, :]
        known = np.isfinite(radiance) | (error is not None and np.isnan(error[..., 0, :]))
        if not (known.all() and (error is not None or (radiance >= 0.0).all())):
            raise TwilightError("the solver gave radiance that is negative or not a number")
        if not (np.isfinite(stokes) | np.isnan(radiance)[..., None, :]).all():
            raise TwilightError("the solver gave a Stokes parameter that is not a number")
        if self.bands is None:
            return stokes, error
        return self.bands.sum_terms(stokes), None if error is None else self.bands.sum_terms(error)

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
        if self.carrier is not None:
            asked = (sun_elevation_deg, elevation_deg, azimuth_deg, distance_km, observer_altitude_km)
            parts = zip(*(block.inscatter(*asked) for block in self._all_solved), strict=True)
            return tuple(np.concatenate(part, axis=-1) for part in parts)  # type: ignore[return-value]
        field, more = self._seen_from(observer_altitude_km)
        scattered, transmittance = field.inscatter(sun_elevation_deg, elevation_deg, azimuth_deg, distance_km, **more)
        if self.bands is None:
            return scattered, transmittance
        return self.bands.sum_terms(scattered), self.bands.sum_terms(transmittance)

    def texture(
        self,
        sun_elevation_deg: float,
        elevation_deg: np.ndarray,
        azimuth_deg: np.ndarray,
        observer_altitude_km: float | None = None,
    ) -> StokesWithError:
        """The sky on a grid of rows (E,) and columns (A,) [deg]: (E, A, S, W), I never negative, polarised if possible.

        The sky is its own mirror image about the sun's vertical: a deterministic solver is asked for one half only.
        In the other half I and Q are the same, and U has the other sign.
        """
        if self.capabilities.standard_error:
            e, a = np.meshgrid(elevation_deg, azimuth_deg, indexing="ij")
            stokes, error = self.answer(sun_elevation_deg, e, a, observer_altitude_km, polarisation=True)
            # few samples of a faint pixel may average below 0, which no sky is; its standard error says how little it
            # means
            radiance = np.maximum(stokes[..., :1, :], 0.0)
            return np.concatenate([radiance, stokes[..., 1:, :]], axis=-2), error
        column, back = half_of(azimuth_deg)
        columns = azimuth_deg[column]
        rows_at_once = self.rows_at_once(columns.size)
        parts = []
        for start in range(0, elevation_deg.size, rows_at_once):
            e, a = np.meshgrid(elevation_deg[start : start + rows_at_once], columns, indexing="ij")
            parts.append(self.answer(sun_elevation_deg, e, a, observer_altitude_km, polarisation=True))
        whole = join(parts, axis=0)[0][:, back]
        whole[:, azimuth_deg > 180.0, 2:] *= -1.0
        return whole, None

    def scattered_once(self, altitude_km: float) -> ScatteredOnce:
        """What aerosol scatters once towards an observer, without which light has no aureole."""
        if self._once is None or self._once.altitude_km != altitude_km:
            self._once = ScatteredOnce(
                self.medium, self.bands, altitude_km, aerosol=self.capabilities.kind != "formula"
            )
            self._widening.clear()
        return self._once

    def widening(self, sun_elevation_deg: float, altitude_km: float) -> np.ndarray | None:
        """`ScatteredOnce.widening` of a sun for an observer; None without an aureole, and of a solver with noise."""
        once = self.scattered_once(altitude_km)
        if once.log_phase is None or self.capabilities.standard_error:
            return None
        if sun_elevation_deg not in self._widening:

            def light(elevation_deg: np.ndarray, azimuth_deg: np.ndarray) -> np.ndarray:
                return self.answer(sun_elevation_deg, elevation_deg, azimuth_deg, altitude_km)[0][..., 0, :]

            self._widening[sun_elevation_deg] = once.widening(light, sun_elevation_deg)
        return self._widening[sun_elevation_deg]

    def direct(self, sun_elevation_deg: float, observer_altitude_km: float | None = None) -> Direct:
        """The sun's direct light at an observer."""
        altitude = self.scene.altitude_km if observer_altitude_km is None else observer_altitude_km
        direct = self.sunbeam.at(sun_elevation_deg, altitude)
        return direct if self.bands is None else direct._replace(irradiance=self.bands.sum_terms(direct.irradiance))

    def disc_irradiance(self, sun_elevation_deg: float, altitude_km: float) -> np.ndarray:
        """Irradiance of level ground by the sun's disc over F0, (W,)."""
        strips = self.sunbeam.strips(sun_elevation_deg, max(altitude_km, self.medium.bottom_km))
        if strips is None:
            return np.zeros(self.medium.n_wavelengths)
        elevation, beams = strips
        beams = disc_strips()[1][:, None] * (beams if self.bands is None else self.bands.sum_terms(beams))
        return np.maximum(np.sin(np.radians(elevation)), 0.0) @ beams


def check_question(sun_elevation_deg: Any, elevation_deg: Any, azimuth_deg: Any) -> None:
    """TwilightError for a sun or directions [deg] that are none."""
    if not _within(sun_elevation_deg, 90.0) or np.ndim(sun_elevation_deg):
        raise TwilightError(f"sun_elevation_deg: must be a number between -90 and 90, got {sun_elevation_deg!r}")
    if not _within(elevation_deg, 90.0 + ROUNDING):
        raise TwilightError("elevation_deg: must be numbers between -90 and 90")
    if not _within(azimuth_deg, np.inf):
        raise TwilightError("azimuth_deg: must be finite numbers")


def _within(angle_deg: Any, limit_deg: float) -> bool:
    """Whether all of some angles are finite numbers within -limit_deg to limit_deg."""
    try:
        angle = np.asarray(angle_deg, float)
    except (TypeError, ValueError):
        return False
    return bool((np.isfinite(angle) & (np.abs(angle) <= limit_deg)).all())


def field_key(
    solver: str,
    settings: Any,
    medium: Medium,
    suns_deg: Sequence[float] | None,
    altitude_km: float,
) -> str:
    """The key of the field of a problem.

    solver: name of its module; suns_deg: all that will be asked for, None: any; altitude_km: the observer's.
    """
    about = [solver, asdict(settings), None if suns_deg is None else sorted(suns_deg), altitude_km]
    told = json.dumps(about, sort_keys=True, default=str)
    return content_digest(code_digest(solver), told, medium, medium.at_grid_wavelengths)
