"""Light at places and times: what shines on directions and surfaces, term by term, as spectra.

Every source of `twilight.engine.light_sources` is a term of one sum.  A surface has what falls on it from above the
horizon, and what level ground sends up:

    E = sum_sources E_s + G A E_level / pi

with G the surface's projection of the ground and A its albedo.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from twilight import solvers
from twilight.base.errors import TwilightError
from twilight.base.progress import Progress, part_of, silent
from twilight.config.load import load
from twilight.config.scene import Config
from twilight.engine.field import Field, solve
from twilight.engine.light_sources import SOURCE_NAMES, SOURCES, Moments, Source
from twilight.engine.night import levels_of
from twilight.engine.sun_tables import check_serves_every_sun
from twilight.engine.surfaces import ManySuns, Surface
from twilight.scene import resolve
from twilight.sky.night import NightLevels
from twilight.sky.quantities.measure import Quantity, Spectra, check_covered, samples_for

TIMES_BRIGHTER = 1e4
"""A source of the night is left out where sunlight is so many times brighter at every wavelength in everything that is
asked for: each changes it by less than a ten-thousandth."""
LEAST_VIEW_SR = 1e-9
"""A surface that has less than this of a sky of radiance 1 has nothing of it [sr]."""
MOST_FIELDS = 4
"""Fields that are held in memory for further questions."""
AT_ONCE = {"name": "compact", "polarisation": False}
"""The solver of a configuration that names none and sets nothing of one, where it has the air, the observer and the
wavelengths."""


def check_sources(sources: Sequence[str] | None) -> None:
    """TwilightError for the name of a source that is none."""
    for name in sources or ():
        if name not in SOURCE_NAMES:
            raise TwilightError(f"sources: '{name}' is not known; choose of {', '.join(SOURCE_NAMES)}")


@dataclass(frozen=True, eq=False)
class LightField(ManySuns):
    """A solved field that answers for directions and surfaces at many places and times."""

    @classmethod
    def of(cls, solved: Field) -> LightField:
        """With the night of the scene's configuration."""
        night = solved.scene.configuration.night
        return cls(solved, None if night is None else levels_of(night))

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
            spectra = np.zeros((which.size, len(lit), self.wavelength_nm.size))
            for s in np.flatnonzero(seeing):
                part = term.irradiance(some, lit[s])
                if part is None:
                    return None
                spectra[:, s] = part
            return spectra

        shape = (len(moments.places), len(lit), self.wavelength_nm.size)
        out = self._sum(of, sources, np.zeros(shape), view_sr)
        if not lit_ground:
            return out
        ground = self.solved.medium.ground_albedo / np.pi * out[:, -1]
        view_factor = np.array([one.ground_view for one in surfaces])
        return out[:, :-1] + view_factor[:, None] * ground[:, None]

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


@dataclass(frozen=True)
class ChosenField:
    """field: what answers; solver: which solver it is of and why, in a sentence, empty where the configuration says."""

    field: LightField
    solver: str


_fields: dict[str, ChosenField] = {}
"""Fields by their configuration as JSON, the oldest first."""


def field_for(config: Config, quantities: Sequence[Quantity], progress: Progress | None = None) -> ChosenField:
    """The solved field of a configuration, cached for the next question; its wavelengths, if not given, are chosen.

    Without a `night` of its own it has the usual one; without a `solver` of its own it is by compact where that serves.
    Errors: TwilightError for a quantity that the wavelengths do not cover, and a solver whose field serves one sun.
    """
    if config.moon is not None and config.moon.elevation_deg is not None:
        raise TwilightError("moon.elevation_deg: light takes the moon from place and time, not from there")
    responses = [asked for which in quantities for asked in which.responses()]
    if config.wavelengths is None and config.climate.medium is None:
        chosen = list(samples_for(responses))
        config = load(config.model_dump(mode="json", exclude_unset=True), {"wavelengths": {"list_nm": chosen}})
    document = json.dumps(config.model_dump(mode="json", exclude_unset=True), sort_keys=True)
    if document not in _fields:
        while len(_fields) >= MOST_FIELDS:
            del _fields[next(iter(_fields))]
        field, why = _solved(config, progress)
        field = field if field.levels is not None else replace(field, levels=NightLevels())
        _fields[document] = ChosenField(field, why)
    known = _fields[document]
    for asked in responses:
        check_covered(asked, known.field.wavelength_nm, "the field")
    return known


def _solved(config: Config, progress: Progress | None) -> tuple[LightField, str]:
    if config.solver:
        return _field(config, progress), ""
    try:
        quick = config.model_copy(update={"solver": dict(AT_ONCE)})
        return _field(quick, progress), "solver: compact, the model of all clear air, for none is named"
    except TwilightError as error:
        why = f"solver: {solvers.DEFAULT}, for none is named and compact cannot serve here ({error})"
    return _field(config, progress), why


def _field(config: Config, progress: Progress | None) -> LightField:
    scene = resolve(config)
    check_serves_every_sun(scene)
    return LightField.of(solve(scene, progress=progress))
