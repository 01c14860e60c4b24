"""Light at places and times: what shines on directions and surfaces, light by light, as spectra.

Luminaries and glows are terms of one sum.  A surface has what falls on it from above the horizon, and what level ground
sends up:

    E = sum_lights E_light + G A E_level / pi

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
from twilight.clear_air.model import NUMBER
from twilight.config.load import load
from twilight.config.scene import Config
from twilight.engine.field import Field, solve
from twilight.engine.sun_tables import SunTables, check_serves_every_sun
from twilight.numerics import spectrum
from twilight.scene import resolve
from twilight.scene.lights import levels_of
from twilight.sky.lights import Luminary, outshone
from twilight.sky.moments import Moments
from twilight.sky.night import NightLevels
from twilight.sky.night.glows import Glow, glows_of
from twilight.sky.quantities.measure import Quantity, Spectra, check_covered, samples_for
from twilight.sky.surfaces import Surface

LUMINARIES = ("sun", "sky", "moon")
"""Terms of bodies: the sun's own disc, the sky that it makes, and both of the moon."""
SOURCE_NAMES = (*LUMINARIES, "airglow", "stars", "zodiacal_light", "light_pollution", "ground")
"""What `sources` may name: the terms, sunlight first, beside which glows may be left out, and the ground, which all of
them light."""
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
class LightField:
    """A solved field that answers for directions and surfaces at many places and times.

    solved: of a solver whose field serves every sun; levels: of the night, None for none; chosen: which solver it is of
    and why, in a sentence, empty where the configuration says.
    """

    solved: Field
    levels: NightLevels | None = None
    chosen: str = ""

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
        """The field under many suns."""
        return SunTables(self.solved)

    @cached_property
    def glows(self) -> dict[str, Glow]:
        """The glows of the night, by name."""
        glows = glows_of(self.levels, self.solved.medium, self.solved.scene.altitude_km) if self.levels else ()
        return {glow.name: glow for glow in glows}

    def prepare(self, moments: Moments, progress: Progress = silent) -> None:
        """Compute what surfaces and the zenith need of the suns of moments and, where it shines, of the moon."""
        each = [body.part(np.flatnonzero(body.shines)).elevation_deg for body in (moments.sun, moments.moon) if body]
        self.tables.fill(np.concatenate(each), part_of(progress, 0.0, 1.0))

    def directions(
        self, moments: Moments, elevation_deg: np.ndarray, azimuth_deg: np.ndarray, sources: Sequence[str] | None = None
    ) -> np.ndarray:
        """Radiance [W m^-2 sr^-1 nm^-1] of directions (N, D), 0 to 90 deg high, azimuths from north: (N, D, W).

        No direction sees the disc of sun or moon.
        """

        def of(light: Luminary | Glow, which: np.ndarray, _: str) -> np.ndarray:
            elevation, azimuth = elevation_deg[which], azimuth_deg[which]
            if isinstance(light, Glow):
                return light.radiance(moments.part(which), elevation, azimuth)
            from_body = azimuth - light.azimuth_deg[:, None]
            return self.tables.sky(light.elevation_deg, elevation, from_body) * self._above_air(light)[:, None]

        shape = (*elevation_deg.shape, self.wavelength_nm.size)
        return self._sum(of, moments, sources, ("sky", "moon"), np.zeros(shape), np.ones(shape[1]))

    def surfaces(
        self, moments: Moments, surfaces: Sequence[Surface], sources: Sequence[str] | None = None
    ) -> np.ndarray:
        """Irradiance [W m^-2 nm^-1] of S surfaces, (N, S, W).

        The ground is level, Lambertian, and lit by the chosen sources; it is there where `ground` is chosen.
        """
        lit_ground = (sources is None or "ground" in sources) and any(one.ground_view > 0.0 for one in surfaces)
        lit = [*surfaces, *([Surface.horizontal()] if lit_ground else [])]
        view_sr = np.array([one.sky_view for one in lit])

        def of(light: Luminary | Glow, which: np.ndarray, term: str) -> np.ndarray:
            some = moments.part(which)
            spectra = np.zeros((which.size, len(lit), self.wavelength_nm.size))
            for s in np.flatnonzero(view_sr > LEAST_VIEW_SR):
                if isinstance(light, Glow):
                    spectra[:, s] = light.irradiance(some, lit[s])
                else:
                    spectra[:, s] = self._falling(light, lit[s], some.sun.azimuth_deg, term)
            return spectra

        shape = (len(moments), len(lit), self.wavelength_nm.size)
        out = self._sum(of, moments, sources, LUMINARIES, np.zeros(shape), view_sr)
        if not lit_ground:
            return out
        ground = self.solved.medium.ground_albedo / np.pi * out[:, -1]
        view_factor = np.array([one.ground_view for one in surfaces])
        return out[:, :-1] + view_factor[:, None] * ground[:, None]

    def _above_air(self, body: Luminary) -> np.ndarray:
        return body.irradiance_factor(self.wavelength_nm) * self.solar_irradiance

    def _falling(self, body: Luminary, surface: Surface, sun_azimuth_deg: np.ndarray, term: str) -> np.ndarray:
        """Irradiance (N, W) of a surface by a body's disc, its sky, or both (`LUMINARIES`)."""
        factor = np.zeros(1)
        if term != "sun":
            normal = surface.azimuth_deg + (sun_azimuth_deg if surface.from_sun else 0.0)
            factor = self.tables.surface(surface, body.elevation_deg, normal - body.azimuth_deg)
        if term != "sky":
            elevation, beams = self.tables.strips(body)
            azimuth = np.broadcast_to(body.azimuth_deg[:, None], elevation.shape)
            cosine = surface.view(elevation, azimuth, sun_azimuth_deg)
            factor = factor + np.einsum("ns,nsw->nw", np.where(elevation > 0.0, cosine, 0.0), beams)
        return factor * self._above_air(body)

    def _sum(
        self,
        of: Callable[[Luminary | Glow, np.ndarray, str], np.ndarray],
        moments: Moments,
        sources: Sequence[str] | None,
        bodies: Sequence[str],
        out: np.ndarray,
        view_sr: np.ndarray,
    ) -> np.ndarray:
        """The lights added to `out` (N, T, W), sunlight first; of: a light at some of the moments, and which term of
        it; bodies: terms of luminaries that there are; view_sr (T,): what each target has of a sky of radiance 1."""
        check_sources(sources)
        seeing = view_sr > LEAST_VIEW_SR
        for term in (name for name in SOURCE_NAMES if sources is None or name in sources):
            body = moments.moon if term == "moon" else moments.sun
            if term in bodies and body is not None:
                which = np.flatnonzero(body.shines)
                if which.size:
                    out[which] += of(body.part(which), which, term)
            elif term in self.glows:
                which, glow = np.arange(out.shape[0]), self.glows[term]
                if seeing.any() and out.any():
                    most = view_sr[seeing][:, None] * glow.brightest
                    which = np.flatnonzero(~outshone(most, out[:, seeing]).all(axis=-1))
                if which.size:
                    out[which] += of(glow, which, term)
        return out

    def spectra(self, light: np.ndarray) -> Spectra:
        """Light [W m^-2 nm^-1 (sr^-1)], (..., W), for quantities of it."""
        factor = light / self.solar_irradiance
        return Spectra(factor, self.wavelength_nm, self.solved.solar_spectrum, where="the field")


_fields: dict[str, LightField] = {}
"""Fields by their configuration as JSON, the oldest first."""


def field_for(config: Config, quantities: Sequence[Quantity], progress: Progress | None = None) -> LightField:
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
        _fields[document] = _solved(config, progress)
    known = _fields[document]
    for asked in responses:
        check_covered(asked, known.wavelength_nm, "the field")
    return known


def _solved(config: Config, progress: Progress | None) -> LightField:
    why = ""
    if not config.solver:
        try:
            quick = _field(config.model_copy(update={"solver": dict(AT_ONCE)}), progress)
            return replace(quick, chosen=f"solver: compact, model {NUMBER} of all clear air, for none is named")
        except TwilightError as error:
            why = f"solver: {solvers.DEFAULT}, for none is named and compact cannot serve here ({error})"
    return replace(_field(config, progress), chosen=why)


def _field(config: Config, progress: Progress | None) -> LightField:
    scene = resolve(config)
    check_serves_every_sun(scene)
    levels = NightLevels() if config.night is None else levels_of(config.night)
    return LightField(solve(scene, progress=progress), levels)
