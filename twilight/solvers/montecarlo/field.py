"""The prepared solver: air, direct beam and importance function of one medium, for any sun and any direction."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from twilight.atmosphere.medium import Medium
from twilight.base.errors import TwilightError
from twilight.base.progress import Progress
from twilight.base.threads import in_slices
from twilight.solvers.base import BareField, observer_at
from twilight.solvers.montecarlo.air import MonteCarloAir, prepare_air
from twilight.solvers.montecarlo.beam_table import prepare_beam_table
from twilight.solvers.montecarlo.chunks import Pixels, line_of_sight_transmittance
from twilight.solvers.montecarlo.importance import ImportanceTables
from twilight.solvers.montecarlo.importance_solution import solve_importance
from twilight.solvers.montecarlo.run import Run, pixels_of, stop_after
from twilight.solvers.montecarlo.screen import screen_in_space
from twilight.solvers.montecarlo.settings import MonteCarloSettings
from twilight.solvers.montecarlo.sunlight import SolarBeam
from twilight.solvers.montecarlo.tally import MonteCarloResult, StokesResult
from twilight.transport.beam import prepare_beam

FARTHEST_KM = 1e7
"""Distance [km] at which a segment has left all air."""


def prepare(
    medium: Medium,
    settings: MonteCarloSettings | None = None,
    *,
    observer_altitude_km: float = 0.0,
    progress: Progress | None = None,
) -> Field:
    """All that depends on the medium alone: tables of the air, of the direct beam and of the importance function.

    Parameters
    ----------
    medium : Medium
        The air and the ground.
    settings : MonteCarloSettings, optional
        What is computed and how well.
    observer_altitude_km : float
        Altitude [km] of the observer, inside the air or above it.
    progress : callable, optional
        Called with a text and the fraction done, now and then.

    Returns
    -------
    Field

    Raises
    ------
    TwilightError
        For an observer below the ground.
    """
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
    return Field(medium, settings, air, line_of_sight_air, sun, importance, altitude_km, progress)


@dataclass(frozen=True)
class Field(BareField):
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
        """Sun-normalised Stokes vectors I, Q, U [sr^-1], shape (..., 3, W).

        Q > 0 is light that vibrates in the vertical plane through the line of sight (in the zenith that of the azimuth
        asked for).  U > 0 is light whose vibration, for somebody who looks along the line of sight with the zenith side
        up, leans from the vertical to the right, towards larger azimuth.  The angle of vibration, clockwise from the
        vertical, is atan2(U, Q) / 2.  Signs as in Emde et al. 2015 (IPRT); arguments as in `radiance_with_error`.

        Raises
        ------
        TwilightError
            Where the field was prepared without polarisation.
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
        """Radiance with standard errors, in all and by order of scattering.

        Parameters
        ----------
        sun_elevation_deg, elevation_deg, azimuth_deg : array_like
            Elevation of the true sun and direction of view [deg], broadcast; azimuth from the sun; elevation below 0
            looks down.
        checkpoint : path, optional
            File in which the state is saved every few seconds and when interrupted; a later call with the same question
            goes on from there.
        batch_order : callable, optional
            Maps a number of batches to a permutation of them; the answer does not depend on it.

        Returns
        -------
        MonteCarloResult
            Arrays (..., W) over the directions and wavelengths.

        Raises
        ------
        TwilightError
            For an angle out of range, or a checkpoint of another question.
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
        """Radiance that the air up to a distance scatters in, and the transmittance of that air.

        Parameters
        ----------
        sun_elevation_deg, elevation_deg, azimuth_deg : array_like
            As in :meth:`radiance_with_error`.
        distance_km : array_like
            Where the segment ends [km], 0 or more; broadcast with the angles.

        Returns
        -------
        MonteCarloResult, ndarray
            The second one (..., W), from 0 to 1.

        Raises
        ------
        TwilightError
            As :meth:`radiance_with_error`, and for a distance that is not a number of 0 or more.
        """
        far = np.minimum(np.asarray(distance_km, dtype=float), FARTHEST_KM)
        run, shape = self._run(sun_elevation_deg, elevation_deg, azimuth_deg, None, None, far)
        passed = np.empty((run.pixels.key.size, self.medium.n_wavelengths))
        walk = self.settings.walk(self.medium.has_refraction)
        in_slices(
            lambda begin, end: line_of_sight_transmittance(
                self.air, self.sun, self.importance, walk, run.pixels, begin, end, passed
            ),
            run.pixels.key.size,
        )
        return run.tally.result(shape, run.all_rounds()), passed.reshape(*shape, -1)

    def _run(self, sun_elevation_deg, elevation_deg, azimuth_deg, checkpoint, batch_order, distance_km=np.inf):
        """The question as a :class:`Run`, and the shape of its directions."""
        pixels, shape = self.question(sun_elevation_deg, elevation_deg, azimuth_deg, distance_km)
        return Run(self, pixels, checkpoint, batch_order), shape

    def question(
        self, sun_elevation_deg, elevation_deg, azimuth_deg, distance_km=np.inf
    ) -> tuple[Pixels, tuple[int, ...]]:
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
