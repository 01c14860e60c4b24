"""`Field`: a scene, solved, that answers for any sun, observer and direction; and what solves one.

- `solve` solves all blocks of wavelengths and holds them: a `Field` answers at any time and in any order;
- `parts` gives the blocks one by one, each a `Field` of some wavelengths that the caller drops before the next: for
  many suns at many wavelengths.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property, partial
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from twilight.atmosphere.bands import GasBands
from twilight.atmosphere.medium import Medium
from twilight.base.arguments import in_units
from twilight.base.errors import TwilightError
from twilight.base.progress import Progress, part_of, silent
from twilight.base.threads import one_blas_thread
from twilight.config import Config
from twilight.engine.block import Block, StokesWithError, check_question, join
from twilight.engine.field_light import FieldLight
from twilight.engine.one_sun import SunLight, interpolation_error, warn_of_black, warn_of_error
from twilight.engine.problem import Problem, plan
from twilight.engine.sun_tables import SunTables
from twilight.engine.sunbeam import Direct, join_direct, make_disc
from twilight.engine.table import row_breaks
from twilight.numerics.directions import texture_centres
from twilight.numerics.spectrum import DEFAULT_SOLAR_SPECTRUM
from twilight.scene.scene import Scene, resolve
from twilight.sky.disc import Disc
from twilight.sky.lights import Sun
from twilight.sky.plain_grid import plain_grid
from twilight.sky.sky import BrowserPage, Sky
from twilight.sky.table import SkyTable

OWN_TABLE_DEG = (-3.2, 3.2)
"""Suns between which a sky is computed for its own sun [deg]: the edge of the Earth's shadow and the light beside a sun
at the horizon move with it, and between two suns they would be off by 10 % to a factor of 2."""

SKY_FACTS = ("sun_azimuth_deg", "distance_au", "latitude_deg", "longitude_deg", "time", "solar_spectrum",
             "night_radiance", "disc", "moon", "provenance")  # fmt: skip
"""Fields of `Sky` that a field does not know itself."""


@in_units
@dataclass(frozen=True, repr=False)
class Field(FieldLight):
    """Some or all wavelengths of a scene, solved."""

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

    def __reduce__(self) -> tuple[Any, ...]:
        """What another process makes the field of: the scene's configuration, solved there or taken from its cache."""
        config = self.scene.config
        if config is None or not self._is_whole:
            raise TwilightError("this field cannot go to another process; hand over the climate and solve it there")
        return _solved_again, (config, self.problem.sun_elevations_deg, self.cached)

    @property
    def scene(self) -> Scene:
        """What was solved."""
        return self.problem.scene

    @cached_property
    def medium(self) -> Medium:
        """The medium at the field's wavelengths."""
        return self.scene.medium if self._is_whole else self.scene.medium.select(self.wavelengths)

    @cached_property
    def bands(self) -> GasBands | None:
        """Exponential sums of the field's wavelengths; None: there are none."""
        bands = self.scene.bands
        return bands if bands is None or self._is_whole else bands.select(self.wavelengths)

    @property
    def wavelengths(self) -> slice:
        """Range of indices into the wavelengths of the scene."""
        return slice(self.blocks[0].wavelengths.start, self.blocks[-1].wavelengths.stop)

    @property
    def _is_whole(self) -> bool:
        return self.wavelengths == slice(0, self.scene.medium.n_wavelengths)

    @property
    def cached(self) -> bool:
        """Whether what is computed is taken from the user's cache and left there."""
        return self.problem.cached

    @property
    def sun_range_deg(self) -> tuple[float, float]:
        """Lowest and highest sun that may be asked for [deg]."""
        low, high = getattr(self.blocks[0].field, "sun_range_deg", (-90.0, 90.0))
        return float(low), float(high)

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
        return self.radiance_with_error(sun_elevation_deg, elevation_deg, azimuth_deg, observer_altitude_km)[0]

    def radiance_with_error(
        self,
        sun_elevation_deg: float,
        elevation_deg: ArrayLike,
        azimuth_deg: ArrayLike,
        observer_altitude_km: float | None = None,
    ) -> StokesWithError:
        """Radiance, and its standard error from a solver that estimates it; both nan where that does not know it."""
        question = (sun_elevation_deg, elevation_deg, azimuth_deg, observer_altitude_km)
        stokes, error = join([block.answer(*question) for block in self.blocks])
        return stokes[..., 0, :], None if error is None else error[..., 0, :]

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
        stokes, _ = join([block.answer(*question, polarisation=True) for block in self.blocks])
        if stokes.shape[-2] == 1:
            raise TwilightError("this field has no Stokes parameters: its solver.polarisation is not true")
        return stokes

    def direct(self, sun_elevation_deg: float, observer_altitude_km: float | None = None) -> Direct:
        """The sun's direct light at an observer."""
        return join_direct([block.direct(sun_elevation_deg, observer_altitude_km) for block in self.blocks])

    def of_terms(self, value: Callable[[Medium], np.ndarray]) -> np.ndarray:
        """What a function finds for a medium at the terms of the wavelengths' exponential sums, (..., T), summed to
        wavelengths (..., W)."""
        values = [(value(block.term_medium), block.bands) for block in self.blocks]
        return np.concatenate([v if bands is None else bands.sum_terms(v) for v, bands in values], axis=-1)

    def disc(
        self, sun_elevation_deg: float, observer_altitude_km: float | None = None, *, distance_au: float = 1.0
    ) -> Disc:
        """The sun's disc as an observer sees it: `twilight.sky.disc.Disc`."""
        altitude = self.scene.altitude_km if observer_altitude_km is None else observer_altitude_km
        return make_disc(self.medium, Sun(sun_elevation_deg, 0.0, distance_au), altitude, self.bands)

    def table(self, sun_elevation_deg: float, observer_altitude_km: float | None = None, **nodes: Any) -> SkyTable:
        """The sky of one sun on nodes that are as close as its light needs.

        nodes: rows_deg and columns_deg to begin with, those of another table; aureole_sun_deg, the sun whose aureole
        the phase function is of, which tables of several suns share; and limits as of `twilight.engine.table.fill`.
        """
        return self.gather(sun_elevation_deg, observer_altitude_km, **nodes).table

    def gather(
        self,
        sun_elevation_deg: float,
        observer_altitude_km: float | None = None,
        grid: tuple[np.ndarray, np.ndarray] | None = None,
        before: SunLight | None = None,
        **nodes: Any,
    ) -> SunLight:
        """The light of one sun: plain samples on a grid (rows (E,) and columns (A,) [deg]), or a table.

        before: that at the wavelengths before these, which are added to it.  nodes: as of `table`.
        """
        altitude = self.scene.altitude_km if observer_altitude_km is None else observer_altitude_km
        light = SunLight(grid) if before is None else before
        for block in self.blocks:
            light.add(block, sun_elevation_deg, altitude, **nodes)
        return light

    def samples(
        self,
        sun_elevation_deg: float,
        elevation_deg: np.ndarray,
        azimuth_deg: np.ndarray,
        observer_altitude_km: float | None = None,
    ) -> StokesWithError:
        """The light on rows (E,) and columns (A,) [deg], (E, A, S, W), polarised where the field is, I not negative."""
        grid = elevation_deg, azimuth_deg
        return self.gather(sun_elevation_deg, observer_altitude_km, grid).on_grid(grid)

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
        between = tables.suns_deg[0] <= sun_elevation_deg <= tables.suns_deg[-1]
        low, high = OWN_TABLE_DEG
        if not between or low < sun_elevation_deg < high or row_breaks(self.scene, altitude_km)[1]:
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
            which are computed when they are needed and cached; but from high up, and beside a sun within 3.2 deg of the
            horizon, by the sky of this very sun.
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

        Warns
        -----
        TwilightWarning
            For a black sky: of a sun too low, or an observer above the air; for one that rows and columns do not hold.
        """
        unknown = [name for name in facts if name not in SKY_FACTS]
        if unknown:
            raise TwilightError(f"sky: {unknown[0]} is no argument; allowed are {', '.join(SKY_FACTS)}")
        altitude = self.scene.altitude_km if observer_altitude_km is None else observer_altitude_km
        if elevation_deg is None and azimuth_deg is None and not self.scene.capabilities.standard_error:
            light = SunLight(None, [self._table_of(sun_elevation_deg, altitude)])
            grid = plain_grid(light.table)
        else:
            rows, columns = texture_centres((30, 120))
            grid = rows if elevation_deg is None else elevation_deg, columns if azimuth_deg is None else azimuth_deg
            light = self.gather(sun_elevation_deg, altitude, grid)
        direct = self.direct(sun_elevation_deg, altitude)
        sky = light.sky(self.medium, grid, direct, sun_elevation_deg, altitude, **facts)
        without_night = "a field has no light of the night: render with night.airglow=1 has, or give night_radiance"
        warn_of_error(interpolation_error(light, sky), sky, stacklevel=2)
        warn_of_black(self.scene, sky, "" if sky.night_radiance is not None else without_night, stacklevel=2)
        return sky

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


def _solved_again(config: Config, sun_elevations_deg: tuple[float, ...] | None, cached: bool) -> Field:
    """The field of a configuration, in the process that reads it."""
    return solve(resolve(config), sun_elevations_deg, cached=cached)


@one_blas_thread()
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
    problem, tell = plan(scene, sun_elevations_deg, cached=cached), progress or silent
    count = len(problem.slices)
    return Field(problem, tuple(Block(problem, i, part_of(tell, i / count, 1.0 / count)) for i in range(count)))


class Part(NamedTuple):
    """A block of wavelengths: range of indices into those of the scene; solve(progress) gives its field."""

    wavelengths: slice
    solve: Callable[..., Field]


def parts(problem: Problem) -> list[Part]:
    """The blocks of a plan in their order.  Each is a `Field` of some wavelengths, and the next may be solved when the
    caller has dropped it."""

    def solved(index: int, progress: Progress = silent) -> Field:
        return Field(problem, (Block(problem, index, progress),))

    return [Part(part, partial(solved, index)) for index, part in enumerate(problem.slices)]
