"""Light at places and times: what shines on directions and surfaces, term by term, as spectra.

Every source of `twilight.engine.light_sources` is a term of one sum.  A surface has what falls on it from above the
horizon, and what level ground sends up:

    E = sum_sources E_s + G A E_level / pi

with G the surface's projection of the ground and A its albedo.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from twilight.base.errors import TwilightError
from twilight.base.progress import Progress, part_of, silent
from twilight.engine.light_sources import SOURCE_NAMES, SOURCES, Source
from twilight.engine.moments import Moments
from twilight.engine.night import levels_of
from twilight.engine.over_suns import HIGHEST_SUN_DEG, DiscOverSuns, OverSuns
from twilight.engine.solve import Field
from twilight.engine.sun_tables import SunTables
from twilight.engine.surfaces import Surface
from twilight.numerics import spectrum
from twilight.sky.night import NightLevels
from twilight.sky.quantities.measure import Spectra

TIMES_BRIGHTER = 1e4
"""A source of the night is left out where sunlight is so many times brighter at every wavelength in everything that is
asked for: each changes it by less than a ten-thousandth."""
FEW_LINES = 100
"""Lines of sight up to which they are computed one by one, for each sun whose table or hemisphere is missing."""
FEW_SUNS = 2
"""Moments up to which they are, for each of these suns."""
LEAST_VIEW_SR = 1e-9
"""A surface that has less than this of a sky of radiance 1 has nothing of it [sr]."""
ZENITH_DEG = 90.0 - 1e-9
"""Elevation from which on a direction is the zenith, whatever its azimuth [deg]."""


def check_sources(sources: Sequence[str] | None) -> None:
    """TwilightError for the name of a source that is none."""
    for name in sources or ():
        if name not in SOURCE_NAMES:
            raise TwilightError(f"sources: '{name}' is not known; choose of {', '.join(SOURCE_NAMES)}")


@dataclass(frozen=True, eq=False)
class LightField:
    """A solved field that answers for directions and surfaces at many places and times.

    solved: of a solver whose field serves every sun; levels: of the night, None for none.
    """

    solved: Field
    levels: NightLevels | None = None

    @classmethod
    def of(cls, solved: Field) -> LightField:
        """With the night of the scene's configuration."""
        night = solved.scene.configuration.night
        return cls(solved, None if night is None else levels_of(night))

    @property
    def wavelength_nm(self) -> np.ndarray:
        """Wavelengths [nm], (W,)."""
        return self.solved.medium.wavelength_nm

    @cached_property
    def solar_irradiance(self) -> np.ndarray:
        """Of the sun at 1 au [W m^-2 nm^-1], mean over each wavelength's bin, (W,)."""
        return spectrum.solar_irradiance(self.wavelength_nm, self.solved.solar_spectrum)

    @cached_property
    def tables(self) -> SunTables:
        """The sky for many suns."""
        return SunTables(self.solved)

    @cached_property
    def over_suns(self) -> OverSuns:
        """What surfaces and the zenith have of it."""
        return OverSuns(self.solved, self.tables.suns_deg)

    @cached_property
    def disc(self) -> DiscOverSuns:
        """The sun's beam."""
        return DiscOverSuns(self.solved)

    def sky(self, sun_elevation_deg: np.ndarray, elevation_deg: np.ndarray, azimuth_deg: np.ndarray) -> np.ndarray:
        """Sun-normalised radiance [sr^-1], (N, D, W), of N suns (N,) and D directions of each (N, D), 0 to 90 deg high,
        azimuths from the sun.

        Where few lines of sight are asked for, each is computed; the zenith and others are read from tables.
        """
        suns = np.broadcast_to(sun_elevation_deg[:, None], elevation_deg.shape)
        out = np.zeros((*elevation_deg.shape, self.wavelength_nm.size))
        zenith = (elevation_deg >= ZENITH_DEG) & (suns <= HIGHEST_SUN_DEG)
        for some, source in ((zenith, self.over_suns), (~zenith, self.tables)):
            if not some.any():
                continue
            missing = source.missing(suns[some]) if self.tables.suns_deg[0] <= suns[some].min() else 0
            asked = np.flatnonzero(some.any(axis=1))
            if some.sum() <= FEW_LINES * missing and asked.size <= FEW_SUNS * missing:
                for n in asked:
                    e, a = elevation_deg[n, some[n]], azimuth_deg[n, some[n]]
                    out[n, some[n]] = self.solved.radiance(float(sun_elevation_deg[n]), e, a)
            elif source is self.tables:
                out[some] = self.tables.light(suns[some], elevation_deg[some], azimuth_deg[some])
            else:
                out[some] = self.over_suns.zenith(suns[some])
        return out

    def prepare(self, moments: Moments, progress: Progress = silent) -> None:
        """Compute what surfaces and the zenith need of the suns of moments and, where it shines, of the moon."""
        moon = moments.moon.elevation_deg[moments.moon.shines]
        self.over_suns.fill(np.concatenate([moments.sun_elevation_deg, moon]), part_of(progress, 0.0, 1.0))

    @cached_property
    def _sources(self) -> dict[str, Source]:
        return {name: make(self) for name, make in SOURCES.items()}

    def terms(self, sources: Sequence[str] | None) -> list[Source]:
        """The terms of some sources in the order of all, None: all.  Errors: TwilightError for a name that is none."""
        check_sources(sources)
        return [self._sources[name] for name in SOURCES if sources is None or name in sources]

    def directions(
        self, moments: Moments, elevation_deg: np.ndarray, azimuth_deg: np.ndarray, sources: Sequence[str] | None = None
    ) -> np.ndarray:
        """Radiance [W m^-2 sr^-1 nm^-1] of directions (N, D), 0 to 90 deg high, azimuths from north: (N, D, W)."""

        def of(term: Source, which: np.ndarray) -> np.ndarray | None:
            return term.radiance(moments.part(which), elevation_deg[which], azimuth_deg[which])

        shape = (*elevation_deg.shape, self.wavelength_nm.size)
        return self._sum(of, sources, np.zeros(shape), np.ones(shape[1]))

    def surfaces(
        self, moments: Moments, surfaces: Sequence[Surface], sources: Sequence[str] | None = None
    ) -> np.ndarray:
        """Irradiance [W m^-2 nm^-1] of S surfaces, (N, S, W).

        The ground is level, Lambertian, and lit by the chosen sources; it is there where `ground` is chosen.
        """
        lit_ground = (sources is None or "ground" in sources) and any(one.ground_view > 0.0 for one in surfaces)
        lit = [*surfaces, *([Surface.horizontal()] if lit_ground else [])]

        view_sr = np.array([one.sky_view for one in lit])
        seeing = view_sr > LEAST_VIEW_SR

        def of(term: Source, which: np.ndarray) -> np.ndarray | None:
            some = moments.part(which)
            found = np.zeros((which.size, len(lit), self.wavelength_nm.size))
            for s in np.flatnonzero(seeing):
                part = term.irradiance(some, lit[s])
                if part is None:
                    return None
                found[:, s] = part
            return found

        shape = (len(moments.places), len(lit), self.wavelength_nm.size)
        out = self._sum(of, sources, np.zeros(shape), view_sr)
        if not lit_ground:
            return out
        ground = self.solved.medium.ground_albedo / np.pi * out[:, -1]
        seen = np.array([one.ground_view for one in surfaces])
        return out[:, :-1] + seen[:, None] * ground[:, None]

    def _sum(
        self,
        of: Callable[[Source, np.ndarray], np.ndarray | None],
        sources: Sequence[str] | None,
        out: np.ndarray,
        view_sr: np.ndarray,
    ) -> np.ndarray:
        """The terms added to `out` (N, T, W), sunlight first; of: a term of moments; view_sr (T,): what each target has
        of a sky of radiance 1."""
        seeing = view_sr > LEAST_VIEW_SR
        for term in self.terms(sources):
            which = np.arange(out.shape[0])
            if term.by_night and seeing.any() and out.any():
                most = view_sr[seeing][:, None] * term.brightest
                which = np.flatnonzero((out[:, seeing] <= TIMES_BRIGHTER * most).any(axis=(1, 2)))
            if which.size:
                part = of(term, which)
                if part is not None:
                    out[which] += part
        return out

    def spectra(self, light: np.ndarray) -> Spectra:
        """Light [W m^-2 nm^-1 (sr^-1)], (..., W), for quantities of it."""
        factor = light / self.solar_irradiance
        return Spectra(factor, self.wavelength_nm, self.solved.solar_spectrum, where="the field")
