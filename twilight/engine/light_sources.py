"""The terms of the light at places and times: sun and its sky, moon, airglow, stars, zodiacal light, lamps.

A new source is a subclass of `Source` and a line in `SOURCES`.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from datetime import datetime
from functools import cached_property
from typing import NamedTuple

import numpy as np

from twilight.base.errors import TwilightError
from twilight.engine.surfaces import ManySuns, Surface
from twilight.sky.ephemeris import AU_KM, Sites
from twilight.sky.moon import LOWEST_DEG, irradiance_factors, is_waxing
from twilight.sky.night import NightLevels, Place, night_radiance
from twilight.sky.night import light as night
from twilight.sky.night.world import Veil, poles_at, pollution_radiance, unit_vector, veil

HIGHEST_SITE_KM = 100.0
"""Observers above this are taken as this high for the parallax of sun and moon."""
ROWS_DEG = 2.5 + 5.0 * np.arange(18)
"""Elevations of the directions that stand for the night sky over surfaces [deg]."""
COLUMNS_DEG = 15.0 * np.arange(24)
"""Their azimuths from north [deg]."""
MOMENTS_AT_ONCE = 500
"""Moments whose night sky is held at once, which bounds the memory."""


class Moons(NamedTuple):
    """The moon over N places and times, each (N,): true elevation, azimuth from north and phase angle [deg], distances
    from the observer [km] and from the sun [au]."""

    elevation_deg: np.ndarray
    azimuth_deg: np.ndarray
    phase_angle_deg: np.ndarray
    distance_km: np.ndarray
    sun_distance_au: np.ndarray
    waxing: np.ndarray

    @property
    def shines(self) -> np.ndarray:
        """Whether it lights the air over the observer, (N,)."""
        return self.elevation_deg >= LOWEST_DEG

    def irradiance_factor(self, wavelength_nm: np.ndarray) -> np.ndarray:
        """Irradiance above the air over the sun's at 1 au, (N, W)."""
        return irradiance_factors(
            wavelength_nm, self.phase_angle_deg, self.waxing, self.distance_km, self.sun_distance_au
        )


class Moments(NamedTuple):
    """N places and times with their sun: places, and elevation (true) and azimuth from north (N,) [deg], distance
    [au]; and with their moon."""

    places: tuple[Place, ...]
    sun_elevation_deg: np.ndarray
    sun_azimuth_deg: np.ndarray
    distance_au: np.ndarray
    moon: Moons

    def part(self, chosen: slice | np.ndarray) -> Moments:
        """Some of them; chosen: a range, or indices."""
        index = np.arange(len(self.places))[chosen]
        places = tuple(self.places[i] for i in index)
        height, azimuth, distance = self.sun_elevation_deg[index], self.sun_azimuth_deg[index], self.distance_au[index]
        return Moments(places, height, azimuth, distance, Moons._make(v[index] for v in self.moon))


def moments_at(
    latitude_deg: Sequence[float], longitude_deg: Sequence[float], times: Sequence[datetime], altitude_km: float = 0.0
) -> Moments:
    """The suns and moons of N places and times (with offsets).

    Errors: TwilightError for a latitude that is none, and for years outside those of the ephemeris.
    """
    keys = list(zip(latitude_deg, longitude_deg, strict=True))
    sun, moon = np.zeros((3, len(keys))), np.zeros((6, len(keys)))
    of_place: dict[tuple[float, float], list[int]] = {}
    for n, key in enumerate(keys):
        of_place.setdefault(key, []).append(n)
    for (latitude, longitude), which in of_place.items():
        if not -90.0 <= latitude <= 90.0:
            raise TwilightError(f"latitude_deg: {latitude} must be a number between -90 and 90")
        turned = (float(longitude) + 180.0) % 360.0 - 180.0
        site = Sites([times[n] for n in which], float(latitude), turned, min(altitude_km, HIGHEST_SITE_KM))
        there, its = site.sun(), site.moon()
        sun[:, which] = there.elevation_deg, there.azimuth_deg, np.linalg.norm(site.earth, axis=-1)
        waxing = is_waxing(there.towards, its.towards)
        distance_km = its.distance_au * AU_KM
        moon[:, which] = (
            its.elevation_deg, its.azimuth_deg, its.phase_angle_deg, distance_km, its.sun_distance_au, waxing
        )  # fmt: skip
    places = tuple(Place(a, b, t) for (a, b), t in zip(keys, times, strict=True))
    return Moments(places, sun[0], sun[1], sun[2], Moons._make([*moon[:5], moon[5] > 0.0]))


class Source:
    """A term of the light [W m^-2 nm^-1 (sr^-1)], means over the wavelengths' bins.

    by_night: left out where the sunlight that is asked for is far brighter than `brightest`.
    """

    by_night = False

    def __init__(self, field: ManySuns):
        self._field = field

    def radiance(self, moments: Moments, elevation_deg: np.ndarray, azimuth_deg: np.ndarray) -> np.ndarray | None:
        """Radiance (N, D, W) of directions (N, D), 0 to 90 deg high, azimuths from north; None: the source has none.

        No direction sees the disc of sun or moon.
        """
        return None

    def irradiance(self, moments: Moments, surface: Surface) -> np.ndarray | None:
        """Irradiance (N, W) of a surface by what is above the horizon; None: the source has none."""
        return None

    @property
    def brightest(self) -> np.ndarray:
        """The largest radiance that the source has at any time in any direction, (W,); of sources `by_night`."""
        raise NotImplementedError

    @property
    def _solar(self) -> np.ndarray:
        return self._field.solar_irradiance


class Sun(Source):
    """The sun's own disc in horizontal strips, each refracted."""

    def irradiance(self, moments: Moments, surface: Surface) -> np.ndarray | None:
        elevation, beams = self._field.disc.strips(moments.sun_elevation_deg)
        if not beams.any():
            return None
        azimuth = np.broadcast_to(moments.sun_azimuth_deg[:, None], elevation.shape)
        factor = _falling(surface, elevation, azimuth, beams, moments)
        return factor * (self._solar / moments.distance_au[:, None] ** 2)


class ScatteredSunlight(Source):
    """The sky that the sun makes."""

    def radiance(self, moments: Moments, elevation_deg: np.ndarray, azimuth_deg: np.ndarray) -> np.ndarray:
        from_sun = azimuth_deg - moments.sun_azimuth_deg[:, None]
        factor = self._field.sky(moments.sun_elevation_deg, elevation_deg, from_sun)
        return factor * (self._solar / moments.distance_au[:, None, None] ** 2)

    def irradiance(self, moments: Moments, surface: Surface) -> np.ndarray:
        from_sun = _normal(surface, moments) - moments.sun_azimuth_deg
        factor = self._field.over_suns.surface(surface, moments.sun_elevation_deg, from_sun)
        return factor * (self._solar / moments.distance_au[:, None] ** 2)


class Moonlight(Source):
    """The moon of the place and time: its beam, and its sky, which is the sun's in its place (`sky.moon`)."""

    def radiance(self, moments: Moments, elevation_deg: np.ndarray, azimuth_deg: np.ndarray) -> np.ndarray | None:
        shining = np.flatnonzero(moments.moon.shines)
        if not shining.size:
            return None
        moon = moments.part(shining).moon
        from_moon = azimuth_deg[shining] - moon.azimuth_deg[:, None]
        out = np.zeros((*elevation_deg.shape, self._solar.size))
        factor = self._field.sky(moon.elevation_deg, elevation_deg[shining], from_moon)
        out[shining] = factor * self._above_air(moments.part(shining))[:, None, :]
        return out

    def irradiance(self, moments: Moments, surface: Surface) -> np.ndarray | None:
        shining = np.flatnonzero(moments.moon.shines)
        if not shining.size:
            return None
        some = moments.part(shining)
        moon = some.moon
        factor = self._field.over_suns.surface(surface, moon.elevation_deg, _normal(surface, some) - moon.azimuth_deg)
        beam, bending = self._field.disc.beam(moon.elevation_deg)
        apparent = (moon.elevation_deg + bending)[:, None]
        factor = factor + _falling(surface, apparent, moon.azimuth_deg[:, None], beam[:, None, :], some)
        out = np.zeros((len(moments.places), self._solar.size))
        out[shining] = factor * self._above_air(some)
        return out

    def _above_air(self, moments: Moments) -> np.ndarray:
        return moments.moon.irradiance_factor(self._field.wavelength_nm) * self._solar


class NightSource(Source):
    """A source of the night, whose level the field says."""

    by_night = True
    level_name: str

    @property
    def level(self) -> float:
        """How bright it is; 0: not there."""
        levels = self._field.levels
        return 0.0 if levels is None else float(getattr(levels, self.level_name))


class SameAround(NightSource):
    """A source that is the same at all times and azimuths."""

    def of_rows(self, elevation_deg: np.ndarray) -> np.ndarray:
        """Radiance over elevations (E,), (E, W)."""
        raise NotImplementedError

    @cached_property
    def _rows(self) -> np.ndarray:
        return self.of_rows(ROWS_DEG)

    @cached_property
    def brightest(self) -> np.ndarray:  # type: ignore[override]
        return np.asarray(self.of_rows(np.linspace(0.0, 90.0, 91)).max(axis=0))

    def radiance(self, moments: Moments, elevation_deg: np.ndarray, azimuth_deg: np.ndarray) -> np.ndarray | None:
        if self.level == 0.0:
            return None
        each, back = np.unique(elevation_deg, return_inverse=True)
        return self.of_rows(each)[back.reshape(elevation_deg.shape)]

    def irradiance(self, moments: Moments, surface: Surface) -> np.ndarray | None:
        if self.level == 0.0:
            return None
        return np.einsum("nrc,rw->nw", _weights(surface, moments), self._rows)


class Airglow(SameAround):
    """Light of the air at 90 to 300 km."""

    level_name = "airglow"

    def of_rows(self, elevation_deg: np.ndarray) -> np.ndarray:
        alone = NightLevels(airglow=self.level, starlight=0.0, zodiacal_light=0.0)
        altitude_km = self._field.solved.scene.altitude_km
        medium = self._field.solved.medium
        return night_radiance(medium, elevation_deg, np.zeros(1), alone, observer_altitude_km=altitude_km)[:, 0]


class ArtificialSkyglow(SameAround):
    """The lamps' light in the air, a level that is given."""

    level_name = "light_pollution_cd_per_m2"

    def of_rows(self, elevation_deg: np.ndarray) -> np.ndarray:
        return pollution_radiance(self._field.wavelength_nm, elevation_deg, self.level)


class FixedToStars(NightSource):
    """A source of one spectrum above the air, whose pattern turns with the sky.

    Seen through the air: L = spectrum (pattern t + mean (1 - t) s), `twilight.sky.night.world`.
    """

    def spectrum(self) -> np.ndarray:
        """Where the pattern is 1 [W m^-2 nm^-1 sr^-1], (W,)."""
        raise NotImplementedError

    def pattern(self, moments: Moments, towards: np.ndarray) -> np.ndarray:
        """In directions (N, D, 3), or (1, D, 3) at all moments, north, east and up: (N, D)."""
        raise NotImplementedError

    def largest(self) -> float:
        """Largest value of the pattern."""
        raise NotImplementedError

    def _veil(self, elevation_deg: np.ndarray) -> Veil:
        return veil(self._field.solved.medium, elevation_deg, self._field.solved.scene.altitude_km)

    @cached_property
    def _row_veil(self) -> Veil:
        return self._veil(ROWS_DEG)

    @cached_property
    def _shining(self) -> np.ndarray:
        return self.level * self.spectrum()

    @cached_property
    def brightest(self) -> np.ndarray:  # type: ignore[override]
        return np.asarray(self.largest() * self._shining * np.maximum(self._row_veil.source, 1.0))

    def _over_sky(self, moments: Moments) -> tuple[np.ndarray, np.ndarray]:
        """The pattern at ROWS_DEG and COLUMNS_DEG (N, R, C), and its mean by the cosine (N,)."""
        towards = unit_vector(ROWS_DEG[:, None], COLUMNS_DEG).reshape(1, -1, 3)
        radiance = self.pattern(moments, towards).reshape(-1, ROWS_DEG.size, COLUMNS_DEG.size)
        weight = np.sin(2.0 * np.radians(ROWS_DEG))
        return radiance, radiance.mean(axis=2) @ (weight / weight.sum())

    def radiance(self, moments: Moments, elevation_deg: np.ndarray, azimuth_deg: np.ndarray) -> np.ndarray | None:
        if self.level == 0.0:
            return None
        each, back = np.unique(elevation_deg, return_inverse=True)
        air = self._veil(each)
        passed = air.transmittance[back.reshape(elevation_deg.shape)]
        out = np.empty(passed.shape)
        for start in range(0, len(moments.places), MOMENTS_AT_ONCE):
            part = slice(start, start + MOMENTS_AT_ONCE)
            some, t = moments.part(part), passed[part]
            glow = self.pattern(some, unit_vector(elevation_deg[part], azimuth_deg[part]))
            mean = self._over_sky(some)[1][:, None, None]
            out[part] = self._shining * (glow[..., None] * t + mean * (1.0 - t) * air.source)
        return out

    def irradiance(self, moments: Moments, surface: Surface) -> np.ndarray | None:
        if self.level == 0.0:
            return None
        passed, source = self._row_veil
        out = np.empty((len(moments.places), source.size))
        for start in range(0, len(moments.places), MOMENTS_AT_ONCE):
            part = slice(start, start + MOMENTS_AT_ONCE)
            some = moments.part(part)
            weight = _weights(surface, some)
            pattern, mean = self._over_sky(some)
            direct = (weight * pattern).sum(axis=2) @ passed
            out[part] = direct + (weight.sum(axis=2) @ ((1.0 - passed) * source)) * mean[:, None]
        return out * self._shining


class Starlight(FixedToStars):
    """All stars together, by galactic latitude."""

    level_name = "starlight"

    def spectrum(self) -> np.ndarray:
        return night.S10_550NM * night.solar_shape(self._field.wavelength_nm, 550.0)

    def pattern(self, moments: Moments, towards: np.ndarray) -> np.ndarray:
        galaxy, _ = poles_at(moments.places)
        sine = _along(towards, galaxy)
        return night.starlight_s10(np.degrees(np.arcsin(np.clip(sine, -1.0, 1.0))))

    def largest(self) -> float:
        return float(night.starlight_s10(np.zeros(1))[0])


class ZodiacalLight(FixedToStars):
    """Sunlight from dust between the planets, by ecliptic longitude from the sun and latitude."""

    level_name = "zodiacal_light"

    def spectrum(self) -> np.ndarray:
        nm = self._field.wavelength_nm
        return night.solar_shape(nm, 500.0) * night.zodiacal_colour(nm)

    def pattern(self, moments: Moments, towards: np.ndarray) -> np.ndarray:
        _, pole = poles_at(moments.places)
        sun = unit_vector(moments.sun_elevation_deg, moments.sun_azimuth_deg)
        sun = sun - (sun * pole).sum(axis=1, keepdims=True) * pole
        sun /= np.linalg.norm(sun, axis=1, keepdims=True)
        latitude = np.degrees(np.arcsin(np.clip(_along(towards, pole), -1.0, 1.0)))
        longitude = np.degrees(np.arctan2(_along(towards, np.cross(pole, sun)), _along(towards, sun)))
        return night.zodiacal_500nm(longitude, latitude)

    def largest(self) -> float:
        return float(night.zodiacal_500nm(np.linspace(0.0, 180.0, 361)[:, None], np.linspace(0.0, 90.0, 181)).max())


def _along(towards: np.ndarray, axis: np.ndarray) -> np.ndarray:
    """Scalar products of directions (N or 1, D, 3) with an axis (N, 3), (N, D)."""
    return np.asarray(np.matmul(towards, axis[:, :, None])[..., 0])


def _normal(surface: Surface, moments: Moments) -> np.ndarray:
    """Azimuth of a surface's normal from north [deg], (N,)."""
    return surface.azimuth_deg + (moments.sun_azimuth_deg if surface.from_sun else np.zeros(len(moments.places)))


def _falling(
    surface: Surface, elevation_deg: np.ndarray, azimuth_deg: np.ndarray, beams: np.ndarray, moments: Moments
) -> np.ndarray:
    """Irradiance (N, W) by beams (N, S, W) from directions (N, S); 0 of those from below the horizontal."""
    cosine = surface.view(elevation_deg, azimuth_deg, moments.sun_azimuth_deg)
    return np.einsum("ns,nsw->nw", np.where(elevation_deg > 0.0, cosine, 0.0), beams)


def _weights(surface: Surface, moments: Moments) -> np.ndarray:
    """Of the night's directions for a surface, (N, R, C) [sr]; (1, R, C) serves all moments where none differs."""
    rows, columns = (x.ravel()[None] for x in np.meshgrid(ROWS_DEG, COLUMNS_DEG, indexing="ij"))
    turning = surface.turns and surface.from_sun
    sun = moments.sun_azimuth_deg if turning else np.zeros(1)
    count = sun.size
    shape = (count, rows.size)
    cosine = surface.view(np.broadcast_to(rows, shape), np.broadcast_to(columns, shape), sun)
    height = np.diff(np.sin(np.radians(np.append(ROWS_DEG - 2.5, 90.0))))
    solid = height * np.radians(COLUMNS_DEG[1])
    weight = cosine.reshape(count, ROWS_DEG.size, -1) * solid[:, None]
    return np.broadcast_to(weight, (len(moments.places), *weight.shape[1:]))


SOURCES: dict[str, Callable[[ManySuns], Source]] = {
    "sun": Sun,
    "sky": ScatteredSunlight,
    "moon": Moonlight,
    "airglow": Airglow,
    "stars": Starlight,
    "zodiacal_light": ZodiacalLight,
    "light_pollution": ArtificialSkyglow,
}
"""The terms of the light, by name; sunlight first, beside which the night may be left out."""
SOURCE_NAMES = (*SOURCES, "ground")
"""What `sources` may name: the terms, and the ground, which reflects all of them."""
