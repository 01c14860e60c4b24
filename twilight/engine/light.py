"""Light at places and times: what shines on directions and surfaces, term by term, as spectra.

Every source is a term of one sum: `radiance` of directions, and `beams` of what has no width.  The light of a surface
is the integral over the upper hemisphere of all radiances, the beams, and what level ground sends up:

    E = sum_d w_d g(d) L_d + sum_b g(b) B_b + G A E_level / pi

with g the surface's projection towards a direction and G that of the ground.  A new source is a subclass of `Source`
with one of its two methods or both, and a line in `SOURCES`.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from twilight.base.errors import TwilightError
from twilight.engine.hemisphere import disc_beams, whole_hemisphere
from twilight.engine.night import levels_of
from twilight.engine.sky_table import SkyTable
from twilight.engine.solve import Field
from twilight.engine.surfaces import Surface
from twilight.numerics import spectrum
from twilight.sky.ephemeris import sun_position
from twilight.sky.moon import Moon, moon_over
from twilight.sky.night import NightLevels, Place, night_radiance
from twilight.sky.night.pollution import pollution_radiance
from twilight.sky.quantities.measure import Spectra

NIGHT_ROWS_DEG = np.concatenate([np.arange(0.0, 30.0, 5.0), np.arange(30.0, 91.0, 10.0)])
"""Elevations at which the night is computed [deg]; linear between them, as between azimuths and times."""
NIGHT_COLUMN_DEG = 15.0
"""Distance of the azimuths at which the night is computed [deg]."""
NIGHT_STEP = timedelta(minutes=15)
"""Times at which the night is computed are whole multiples of this: stars then move by 4 deg."""
MOMENTS_AT_ONCE = 64
"""Moments whose light on surfaces is computed together, which bounds the memory."""
_EPOCH = datetime(2000, 1, 1, tzinfo=UTC)


class Moments(NamedTuple):
    """N places and times with their sun: places, and elevation (true) and azimuth from north (N,) [deg], distance
    [au]."""

    places: tuple[Place, ...]
    sun_elevation_deg: np.ndarray
    sun_azimuth_deg: np.ndarray
    distance_au: np.ndarray

    def part(self, chosen: slice) -> Moments:
        """Some of them."""
        return Moments(self.places[chosen], *(values[chosen] for values in self[1:]))


def moments_at(
    latitude_deg: Sequence[float], longitude_deg: Sequence[float], times: Sequence[datetime], altitude_km: float = 0.0
) -> Moments:
    """The suns of N places and times (with offsets)."""
    keys = list(zip(latitude_deg, longitude_deg, strict=True))
    elevation, azimuth, distance = (np.zeros(len(keys)) for _ in range(3))
    for latitude, longitude in dict.fromkeys(keys):
        which = [n for n, key in enumerate(keys) if key == (latitude, longitude)]
        at = sun_position([times[n] for n in which], latitude, longitude, min(altitude_km, 100.0))
        elevation[which], azimuth[which], distance[which] = at.elevation_deg, at.azimuth_deg, at.distance_au
    places = tuple(Place(a, b, t) for (a, b), t in zip(keys, times, strict=True))
    return Moments(places, elevation, azimuth, distance)


class CollimatedLight(NamedTuple):
    """Light from one direction at N moments: elevation_deg and azimuth_deg from north (N,), irradiance at normal
    incidence (N, W)."""

    elevation_deg: np.ndarray
    azimuth_deg: np.ndarray
    irradiance: np.ndarray

    def view(self, surface: Surface, moments: Moments) -> np.ndarray:
        """Projection of a surface towards the light, (N, 1); 0 where the light is below the horizontal."""
        elevation_deg = self.elevation_deg[:, None]
        seen = surface.view(elevation_deg, self.azimuth_deg[:, None], moments.sun_azimuth_deg)
        return np.where(elevation_deg > 0.0, seen, 0.0)


class Source:
    """A term of the light [W m^-2 nm^-1 (sr^-1)], means over the wavelengths' bins."""

    def __init__(self, field: LightField):
        self._field = field

    def radiance(self, moments: Moments, elevation_deg: np.ndarray, azimuth_deg: np.ndarray) -> np.ndarray | None:
        """Radiance (N, D, W) of directions (N, D), 0 to 90 deg high, azimuths from north; None: the source has none."""
        return None

    def beams(self, moments: Moments) -> list[CollimatedLight]:
        """Direct light of the source."""
        return []


class Sun(Source):
    """The sun's own disc in horizontal strips, each refracted; no direction sees the disc."""

    def beams(self, moments: Moments) -> list[CollimatedLight]:
        field = self._field
        made = [disc_beams(field.solved, float(sun)) for sun in moments.sun_elevation_deg]
        if not any(one is not None for one in made):
            return []
        strips = next(one for one in made if one is not None)[0].size
        zero = np.zeros(strips), np.zeros((strips, field.wavelength_nm.size))
        elevation = np.stack([(one or zero)[0] for one in made])
        irradiance = np.stack([(one or zero)[1] for one in made])
        scale = field.solar_irradiance / moments.distance_au[:, None] ** 2
        azimuth = moments.sun_azimuth_deg
        return [CollimatedLight(elevation[:, s], azimuth, irradiance[:, s] * scale) for s in range(strips)]


class ScatteredSunlight(Source):
    """The sky that the sun makes."""

    def radiance(self, moments: Moments, elevation_deg: np.ndarray, azimuth_deg: np.ndarray) -> np.ndarray:
        from_sun = azimuth_deg - moments.sun_azimuth_deg[:, None]
        factor = self._field.sky(moments.sun_elevation_deg, elevation_deg, from_sun)
        return factor * (self._field.solar_irradiance / moments.distance_au[:, None, None] ** 2)


class Moonlight(Source):
    """The moon of the place and time: its beam, and its sky, which is the sun's in its place (`sky.moon`).

    No direction sees its disc.
    """

    def __init__(self, field: LightField):
        section = field.solved.scene.configuration.moon
        if section is not None and section.elevation_deg is not None:
            raise TwilightError("moon.elevation_deg: light takes the moon from place and time, not from there")
        super().__init__(field)
        self._made: dict[Place, Moon] = {}

    def _moons(self, moments: Moments) -> list[Moon]:
        """Azimuths from north."""
        altitude_km = min(self._field.solved.scene.altitude_km, 100.0)
        for place in moments.places:
            if place not in self._made:
                where = (place.time, place.latitude_deg, place.longitude_deg)
                self._made[place] = moon_over(*where, sun_azimuth_deg=0.0, altitude_km=altitude_km)
        return [self._made[place] for place in moments.places]

    def _irradiance(self, moons: Sequence[Moon]) -> np.ndarray:
        """Above the air, (N, W)."""
        return np.stack([moon.irradiance_factor(self._field.wavelength_nm) for moon in moons]) * (
            self._field.solar_irradiance
        )

    def radiance(self, moments: Moments, elevation_deg: np.ndarray, azimuth_deg: np.ndarray) -> np.ndarray | None:
        moons = self._moons(moments)
        if not any(moon.shines for moon in moons):
            return None
        height = np.array([moon.elevation_deg if moon.shines else -90.0 for moon in moons])
        from_moon = azimuth_deg - np.array([moon.azimuth_deg for moon in moons])[:, None]
        factor = self._field.sky(height, elevation_deg, from_moon)
        return factor * self._irradiance(moons)[:, None, :]

    def beams(self, moments: Moments) -> list[CollimatedLight]:
        moons = self._moons(moments)
        direct = [self._field.solved.direct(moon.elevation_deg) for moon in moons]
        height = np.array([m.elevation_deg + d.bending_deg for m, d in zip(moons, direct, strict=True)])
        passed = np.stack([d.irradiance for d in direct])
        if not passed.any():
            return []
        azimuth = np.array([m.azimuth_deg for m in moons])
        return [CollimatedLight(height, azimuth, passed * self._irradiance(moons))]


class NightPart(Source):
    """One part of the night sky, of `NightLevels`."""

    def __init__(self, field: LightField, part: str):
        super().__init__(field)
        self._part = part
        self._made: dict[tuple, np.ndarray] = {}

    def radiance(self, moments: Moments, elevation_deg: np.ndarray, azimuth_deg: np.ndarray) -> np.ndarray | None:
        levels = self._field.levels
        level = getattr(levels, self._part) if levels is not None else 0.0
        if level == 0.0:
            return None
        out = np.zeros((*elevation_deg.shape, self._field.wavelength_nm.size))
        for n, place in enumerate(moments.places):
            steps = (place.time - _EPOCH) / NIGHT_STEP
            whole = int(np.floor(steps))
            ends = [(whole, 1.0 - (steps - whole)), (whole + 1, steps - whole)]
            grid = sum(weight * self._grid(place, step) for step, weight in ends if weight > 0.0)
            out[n] = level * _bilinear(np.asarray(grid), elevation_deg[n], azimuth_deg[n])
        return out

    def _grid(self, place: Place, step: int) -> np.ndarray:
        """Radiance (R, C, W) over NIGHT_ROWS_DEG and azimuths from north."""
        # airglow is the same at all times and azimuths
        key = () if self._part == "airglow" else (place.latitude_deg, place.longitude_deg, step)
        if key not in self._made:
            then = Place(place.latitude_deg, place.longitude_deg, _EPOCH + step * NIGHT_STEP)
            sun = sun_position(then.time, then.latitude_deg, then.longitude_deg)
            columns = np.arange(0.0, 360.0, NIGHT_COLUMN_DEG)
            alone = NightLevels(**{"airglow": 0.0, "starlight": 0.0, "zodiacal_light": 0.0, self._part: 1.0})
            where: dict[str, Any] = {
                "sun_elevation_deg": float(sun.elevation_deg),
                "sun_azimuth_deg": float(sun.azimuth_deg),
                "place": then,
                "observer_altitude_km": self._field.solved.scene.altitude_km,
            }
            rows = NIGHT_ROWS_DEG, columns - float(sun.azimuth_deg)
            self._made[key] = night_radiance(self._field.solved.medium, *rows, alone, **where)
        return self._made[key]


class ArtificialSkyglow(Source):
    """The lamps' light in the air, a level that is given."""

    def radiance(self, moments: Moments, elevation_deg: np.ndarray, azimuth_deg: np.ndarray) -> np.ndarray | None:
        levels = self._field.levels
        zenith = 0.0 if levels is None else levels.light_pollution_cd_per_m2
        if zenith == 0.0:
            return None
        made = pollution_radiance(self._field.wavelength_nm, elevation_deg.ravel(), zenith)
        return made.reshape(*elevation_deg.shape, -1)


def _bilinear(grid: np.ndarray, elevation_deg: np.ndarray, azimuth_deg: np.ndarray) -> np.ndarray:
    """Values (D, W) of a grid over NIGHT_ROWS_DEG and azimuths from 0 on."""
    i = np.clip(np.searchsorted(NIGHT_ROWS_DEG, elevation_deg, side="right") - 1, 0, NIGHT_ROWS_DEG.size - 2)
    f = ((elevation_deg - NIGHT_ROWS_DEG[i]) / (NIGHT_ROWS_DEG[i + 1] - NIGHT_ROWS_DEG[i]))[:, None]
    place = np.mod(azimuth_deg, 360.0) / NIGHT_COLUMN_DEG
    j = np.floor(place).astype(int) % grid.shape[1]
    k, g = (j + 1) % grid.shape[1], (place - np.floor(place))[:, None]
    return (1 - f) * ((1 - g) * grid[i, j] + g * grid[i, k]) + f * ((1 - g) * grid[i + 1, j] + g * grid[i + 1, k])


SOURCES: dict[str, Callable[[LightField], Source]] = {
    "sun": Sun,
    "sky": ScatteredSunlight,
    "moon": Moonlight,
    "airglow": lambda field: NightPart(field, "airglow"),
    "stars": lambda field: NightPart(field, "starlight"),
    "zodiacal_light": lambda field: NightPart(field, "zodiacal_light"),
    "light_pollution": ArtificialSkyglow,
}
"""The terms of the light, by name."""
SOURCE_NAMES = (*SOURCES, "ground")
"""What `sources` may name: the terms, and the ground, which reflects all of them."""


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
    def _table(self) -> SkyTable:
        return SkyTable(self.solved)

    def sky(self, sun_elevation_deg: np.ndarray, elevation_deg: np.ndarray, azimuth_deg: np.ndarray) -> np.ndarray:
        """The sky that the sun makes [sr^-1]; arguments as of `SkyTable.radiance`."""
        return self._table.radiance(sun_elevation_deg, elevation_deg, azimuth_deg)

    @cached_property
    def _sources(self) -> dict[str, Source]:
        return {name: make(self) for name, make in SOURCES.items()}

    def terms(self, sources: Sequence[str] | None) -> list[Source]:
        """The terms of some sources; None: all.  Errors: TwilightError for a name that is none."""
        for name in sources or ():
            if name not in SOURCE_NAMES:
                raise TwilightError(f"sources: '{name}' is not known; choose of {', '.join(SOURCE_NAMES)}")
        chosen = SOURCES if sources is None else [name for name in sources if name != "ground"]
        return [self._sources[name] for name in chosen]

    def directions(
        self, moments: Moments, elevation_deg: np.ndarray, azimuth_deg: np.ndarray, sources: Sequence[str] | None = None
    ) -> np.ndarray:
        """Radiance [W m^-2 sr^-1 nm^-1] of directions (N, D), 0 to 90 deg high, azimuths from north: (N, D, W)."""
        out = np.zeros((*elevation_deg.shape, self.wavelength_nm.size))
        for term in self.terms(sources):
            part = term.radiance(moments, elevation_deg, azimuth_deg)
            if part is not None:
                out += part
        return out

    def surfaces(
        self, moments: Moments, surfaces: Sequence[Surface], sources: Sequence[str] | None = None
    ) -> np.ndarray:
        """Irradiance [W m^-2 nm^-1] of S surfaces, (N, S, W).

        The ground is level, Lambertian, and lit by the chosen sources; it is there where `ground` is chosen.
        """
        count = len(moments.places)
        out = np.zeros((count, len(surfaces), self.wavelength_nm.size))
        for start in range(0, count, MOMENTS_AT_ONCE):
            part = slice(start, start + MOMENTS_AT_ONCE)
            out[part] = self._surfaces(moments.part(part), surfaces, sources)
        return out

    def _surfaces(self, moments: Moments, surfaces: Sequence[Surface], sources: Sequence[str] | None) -> np.ndarray:
        grids = [whole_hemisphere(float(sun)) for sun in moments.sun_elevation_deg]
        elevation = np.stack([grid[0] for grid in grids])
        azimuth = np.stack([grid[1] for grid in grids]) + moments.sun_azimuth_deg[:, None]
        solid = np.stack([grid[2] for grid in grids])
        radiance = self.directions(moments, elevation, azimuth, sources)
        beams = [beam for term in self.terms(sources) for beam in term.beams(moments)]
        with_ground = sources is None or "ground" in sources
        out = np.zeros((len(moments.places), len(surfaces), self.wavelength_nm.size))

        def falling(surface: Surface) -> np.ndarray:
            weight = surface.view(elevation, azimuth, moments.sun_azimuth_deg) * solid
            total = np.einsum("nd,ndw->nw", weight, radiance)
            for beam in beams:
                total += beam.view(surface, moments) * beam.irradiance
            return total

        ground = None
        for s, surface in enumerate(surfaces):
            out[:, s] = falling(surface)
            if with_ground and surface.ground_view > 0.0:
                if ground is None:
                    ground = self.solved.medium.ground_albedo / np.pi * falling(Surface.horizontal())
                out[:, s] += surface.ground_view * ground
        return out

    def spectra(self, light: np.ndarray) -> Spectra:
        """Light [W m^-2 nm^-1 (sr^-1)], (..., W), for quantities of it."""
        factor = light / self.solar_irradiance
        return Spectra(factor, self.wavelength_nm, self.solved.solar_spectrum, where="the field")
