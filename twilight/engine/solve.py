"""The engine: from a scene to something that answers for any sun, observer and direction.

A `Problem` is a scene and how it is to be solved.  Its wavelengths are divided into blocks of as many as the solver
takes at once, so that 1000 need no more memory than one block; a `Block` is one of them, solved.  Two ways lead on:

- `Problem.solve` (or `solve`) solves all blocks and holds them: a `Field` answers at any time and in any order;
- `Problem.block` solves one block, which the caller drops before the next: for a whole sequence at many wavelengths.
"""

from __future__ import annotations

from collections.abc import Hashable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from twilight.atmosphere.medium import Medium
from twilight.base.errors import TwilightError
from twilight.base.progress import Progress, part_of, silent
from twilight.engine.answer import Answer, answer_of_table, join, make_sky
from twilight.engine.block import Block
from twilight.engine.directions import check_question
from twilight.engine.disc import make_disc
from twilight.engine.field_light import FieldLight
from twilight.engine.sun_tables import SunTables
from twilight.engine.sunbeam import Direct, join_direct
from twilight.numerics.grids import texture_centres
from twilight.numerics.spectrum import DEFAULT_SOLAR_SPECTRUM
from twilight.scene.scene import Scene
from twilight.sky.disc import Disc
from twilight.sky.sky import BrowserPage, Sky
from twilight.sky.table import SkyTable, plain_grid
from twilight.sky.table import join as join_tables
from twilight.solvers.base import Cost, Interpolation

SKY_FACTS = ("sun_azimuth_deg", "distance_au", "latitude_deg", "longitude_deg", "time", "solar_spectrum",
             "night_radiance", "disc", "moon", "provenance")  # fmt: skip
"""Fields of `Sky` that a field does not know itself."""

FIELD_BYTES = 1.0e9
"""Most memory of a block of wavelengths: what is more is divided into blocks, which do not change what is computed."""


@dataclass(frozen=True)
class Problem:
    """How a scene is solved.

    Parameters
    ----------
    scene
        What is solved.
    sun_elevations_deg
        All the suns that will be asked for [deg], which some solvers take to save time; None: any.
    cached
        Whether solved fields are taken from the user's cache and left there; else every field is solved here.
    numpy_only_sun
        The sun's own light on the ground is found by quadrature, where one sun is not worth tables.
    """

    scene: Scene
    sun_elevations_deg: tuple[float, ...] | None = None
    cached: bool = False
    numpy_only_sun: bool = False

    def __post_init__(self) -> None:
        scene, able = self.scene, self.scene.capabilities
        if len(self.slices) > 1 and self._in_one_file:
            raise TwilightError(
                f"solver.field_file: holds the field of up to {able.wavelengths_at_once} wavelengths, and "
                f"{scene.title or 'the medium'} has {scene.medium.n_wavelengths}"
            )

    @property
    def _in_one_file(self) -> bool:
        """Whether a file is to hold the field of all wavelengths, or holds it."""
        return bool(getattr(self.scene.settings, "field_file", None))

    @cached_property
    def cost(self) -> Cost | None:
        """Memory and processor time of the fields, where the solver knows them."""
        scene, able = self.scene, self.scene.capabilities
        if able.cost is None:
            return None
        return able.cost(scene.medium, scene.settings, self.sun_elevations_deg, scene.altitude_km)

    @cached_property
    def wavelengths_at_once(self) -> int:
        """Most wavelengths of a block: as many as the solver takes and as FIELD_BYTES hold, in bands too."""
        most = self.scene.capabilities.wavelengths_at_once
        if self.cost is None or self.scene.medium.n_wavelengths <= self.cost.block_size:
            return most
        return self.cost.max_wavelengths(most, FIELD_BYTES, self.scene.bands is not None)

    @cached_property
    def term_counts(self) -> np.ndarray:
        """Terms of each wavelength, (W,); 1 without bands."""
        scene = self.scene
        return np.ones(scene.medium.n_wavelengths, int) if scene.bands is None else scene.bands.term_counts

    @cached_property
    def _groups(self) -> list[Hashable]:
        """A key for each wavelength: those of different keys are in different blocks."""
        scene, able = self.scene, self.scene.capabilities
        count = scene.medium.n_wavelengths
        keys: list[Hashable] = [0] * count
        if count > 1 and not self._in_one_file:
            if able.spectral_groups is not None:
                keys = list(able.spectral_groups(scene.medium, scene.settings))
            keys = [key if self.term_counts[w] == 1 else 1 for w, key in enumerate(keys)]
        return keys

    @cached_property
    def interpolations(self) -> list[Interpolation | None]:
        """What interpolates light over the spectral group of each wavelength; None where all of a group are solved."""
        scene, able = self.scene, self.scene.capabilities
        found: list[Interpolation | None] = [None] * scene.medium.n_wavelengths
        if able.spectral_interpolation is None:
            return found
        for key in dict.fromkeys(self._groups):
            members = np.array([w for w, other in enumerate(self._groups) if other == key])
            one = able.spectral_interpolation(scene.medium, scene.bands, members, scene.settings)
            for w in members:
                found[w] = one
        return found

    @cached_property
    def slices(self) -> list[slice]:
        """The blocks of wavelengths, as ranges of indices into those of the medium.

        A block holds `wavelengths_at_once` terms of exponential sums at most, at least one wavelength.  Wavelengths of
        different spectral groups are in different blocks, and so are those in a band and others, whose grids would
        follow the band's terms, unless a file is to hold them all.
        """
        term_counts, keys = self.term_counts, self._groups
        starts, held = [0], int(term_counts[0])
        for w in range(1, len(keys)):
            held += int(term_counts[w])
            if held > self.wavelengths_at_once or keys[w] != keys[w - 1]:
                starts.append(w)
                held = int(term_counts[w])
        ends = [*starts[1:], self.scene.medium.n_wavelengths]
        return [slice(start, stop) for start, stop in zip(starts, ends, strict=True)]

    def block(self, index: int, progress: Progress | None = None) -> Block:
        """Solve one block."""
        scene, part = self.scene, self.slices[index]
        medium = scene.medium if part == slice(0, scene.medium.n_wavelengths) else scene.medium.select(part)
        bands = None if scene.bands is None else scene.bands.select(part)
        bands = bands if bands is not None and bands.absorption_per_km.any() else None
        return Block.solve(self, part, medium, bands, progress or silent)

    def solve(self, progress: Progress | None = None) -> Field:
        """Solve all blocks and hold them."""
        tell, count = progress or silent, len(self.slices)
        return Field(self, tuple(self.block(i, part_of(tell, i / count, 1.0 / count)) for i in range(count)))


@dataclass(frozen=True, repr=False)
class Field(FieldLight):
    """A problem with all its blocks solved."""

    problem: Problem
    blocks: tuple[Block, ...]

    def __repr__(self) -> str:
        """Five lines: the air, wavelengths, observers and suns that it answers for, and how it is asked."""
        scene, able, suns = self.scene, self.scene.capabilities, self.problem.sun_elevations_deg
        quality = "" if scene.config is None else f" ({scene.config.chosen_solver[1]})"
        nm = self.medium.wavelength_nm
        told = suns is not None and able.takes_suns
        which = f"suns from {min(suns):g} to {max(suns):g} deg" if told and suns else "any sun"
        others = ", other observers too" if able.every_observer else ""
        polarised = ", polarised" if self.blocks[0].field.polarised else ""
        air = scene.title or self.medium.name or "a medium"
        return (
            f"<{type(self).__name__} of {air}, by {scene.solver_name}{quality}\n"
            f"  {nm.size} wavelengths {nm[0]:g} to {nm[-1]:g} nm{polarised}, in {len(self.blocks)} blocks\n"
            f"  observer at {scene.altitude_km:g} km{others}; air from {self.medium.bottom_km:g} to "
            f"{self.medium.top_km:g} km\n"
            f"  for {which}\n"
            f"  radiance(sun, elevation, azimuth) [sr^-1], sky(sun), direct(sun), view()>"
        )

    @property
    def scene(self) -> Scene:
        """What was solved."""
        return self.problem.scene

    @property
    def medium(self) -> Medium:
        """The medium at all wavelengths."""
        return self.scene.medium

    @property
    def keys(self) -> tuple[str, ...]:
        """A hash of all that enters each block's field, and how its terms make wavelengths."""
        altitude = self.scene.altitude_km
        return tuple(block.key(altitude) + ("" if block.bands is None else " bands") for block in self.blocks)

    @property
    def solar_spectrum(self) -> str:
        """Name of the scene's solar spectrum."""
        config = self.scene.config
        return DEFAULT_SOLAR_SPECTRUM if config is None else config.solar_spectrum

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
        return join([block.answer(*question) for block in self.blocks])

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
        found = join([block.answer(*question, polarisation=True) for block in self.blocks])
        if found.polarisation is None:
            raise TwilightError("this field has no Stokes parameters: its solver.polarisation is not true")
        return np.concatenate([found.radiance[..., None, :], found.polarisation], axis=-2)

    def direct(self, sun_elevation_deg: float, observer_altitude_km: float | None = None) -> Direct:
        """The sun's direct light at an observer."""
        return join_direct([block.direct(sun_elevation_deg, observer_altitude_km) for block in self.blocks])

    def disc(
        self, sun_elevation_deg: float, observer_altitude_km: float | None = None, *, distance_au: float = 1.0
    ) -> Disc:
        """The sun's disc as an observer sees it: `twilight.sky.disc.Disc`."""
        altitude = self.scene.altitude_km if observer_altitude_km is None else observer_altitude_km
        return make_disc(self.medium, sun_elevation_deg, altitude, distance_au, self.scene.bands)

    def table(self, sun_elevation_deg: float, observer_altitude_km: float | None = None, **nodes: Any) -> SkyTable:
        """The sky of one sun on nodes that are as close as its light needs; nodes, limits: as of `Block.table`."""
        tables: list[SkyTable] = []
        for block in self.blocks:
            if tables:
                nodes = {**nodes, "rows_deg": tables[-1].elevation_deg, "columns_deg": tables[-1].azimuth_deg}
            tables.append(block.table(sun_elevation_deg, observer_altitude_km, **nodes))
        return join_tables(tables)

    @cached_property
    def _sun_tables(self) -> SunTables | None:
        """The tables of the scene's observer; None for a solver with noise, or one of the suns that it was told."""
        able = self.scene.capabilities
        told = able.takes_suns and self.problem.sun_elevations_deg is not None
        return SunTables(self) if able.every_sun and not told and not able.standard_error else None

    def _table_of(self, sun_elevation_deg: float, altitude_km: float) -> SkyTable:
        """The sky of one sun, from those of its neighbours where there are some."""
        check_question(sun_elevation_deg, 0.0, 0.0)
        tables = self._sun_tables
        if tables is None or altitude_km != self.scene.altitude_km:
            return self.table(sun_elevation_deg, altitude_km)
        if not tables.suns_deg[0] <= sun_elevation_deg <= tables.suns_deg[-1]:
            return self.table(sun_elevation_deg, altitude_km)
        return tables.under(sun_elevation_deg)

    def sky(
        self,
        sun_elevation_deg: float,
        elevation_deg: np.ndarray | None = None,
        azimuth_deg: np.ndarray | None = None,
        observer_altitude_km: float | None = None,
        **facts: Any,
    ) -> Sky:
        """The sky of a sun: of an observer for whom the skies of other suns are there, in a few hundredths of a second.

        Parameters
        ----------
        sun_elevation_deg
            True elevation of the sun [deg].
        elevation_deg, azimuth_deg
            Rows (E,) and columns (A,) [deg] on which light is computed; both None: where it changes, so that straight
            lines do between them, of a solver whose field serves every sun by the skies of suns about 0.5 deg apart,
            which are computed when they are needed and cached.
        observer_altitude_km
            Above sea level [km]; None: the scene's observer.
        **facts
            Further fields of `Sky`, such as sun_azimuth_deg, distance_au, time and night_radiance.

        Returns
        -------
        Sky

        Raises
        ------
        TwilightError
            For what the solver cannot do.
        """
        unknown = [name for name in facts if name not in SKY_FACTS]
        if unknown:
            raise TwilightError(f"sky: {unknown[0]} is no argument; allowed are {', '.join(SKY_FACTS)}")
        altitude = self.scene.altitude_km if observer_altitude_km is None else observer_altitude_km
        if elevation_deg is None and azimuth_deg is None and not self.scene.capabilities.standard_error:
            table = self._table_of(sun_elevation_deg, altitude)
            elevation_deg, azimuth_deg = plain_grid(table)
            answer = answer_of_table(table, elevation_deg, azimuth_deg)
        else:
            rows, columns = texture_centres((30, 120))
            elevation_deg = rows if elevation_deg is None else elevation_deg
            azimuth_deg = columns if azimuth_deg is None else azimuth_deg
            answer = join([b.texture(sun_elevation_deg, elevation_deg, azimuth_deg, altitude) for b in self.blocks])
        direct = self.direct(sun_elevation_deg, altitude)
        return make_sky(self.medium, (elevation_deg, azimuth_deg), answer, direct, sun_elevation_deg, altitude, **facts)

    def inscatter(
        self,
        sun_elevation_deg: float,
        elevation_deg: ArrayLike,
        azimuth_deg: ArrayLike,
        distance_km: ArrayLike,
        observer_altitude_km: float | None = None,
    ) -> tuple[np.ndarray, np.ndarray]:
        """The air between the observer and objects: an object is seen as `scattered + transmittance * its radiance`.

        Parameters
        ----------
        sun_elevation_deg
            True elevation of the sun [deg].
        elevation_deg, azimuth_deg
            Of the lines of sight [deg], azimuth from the sun.
        distance_km
            Of the objects [km]; beyond the end of a line in the air, all of the line's air counts.
        observer_altitude_km
            Above sea level [km]; None: the scene's observer.

        Returns
        -------
        scattered, transmittance : numpy.ndarray
            Sun-normalised radiance [sr^-1] and transmittance, shape of the directions plus (W,) each.

        Raises
        ------
        TwilightError
            For a solver that knows whole lines of sight alone.
        """
        question = (sun_elevation_deg, elevation_deg, azimuth_deg, distance_km, observer_altitude_km)
        scattered, transmittance = zip(*(block.inscatter(*question) for block in self.blocks), strict=True)
        return np.concatenate(scattered, axis=-1), np.concatenate(transmittance, axis=-1)

    if TYPE_CHECKING:  # the viewer stands above this room: `twilight.api.calls` attaches it

        def view(self, **options: Any) -> BrowserPage: ...


def solve(
    scene: Scene,
    sun_elevations_deg: Sequence[float] | None = None,
    progress: Progress | None = None,
    *,
    cached: bool = True,
) -> Field:
    """Solve a scene and hold it.

    sun_elevations_deg: true elevations of all the suns that will be asked for [deg], None: any; progress: called as
    progress(doing, fraction) now and then; cached: whether the user's cache gives and keeps it, else it is solved here.
    Errors: TwilightError for what the solver cannot do.
    """
    known = None if sun_elevations_deg is None else tuple(sun_elevations_deg)
    return Problem(scene, known, cached).solve(progress)
