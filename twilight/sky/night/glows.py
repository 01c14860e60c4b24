"""Glows: airglow, the stars together, zodiacal light and the lamps' light in the air.

A glow is a sum of patterns over the sky, each of one spectrum, seen through the air:

    L = sum_k S_k (p_k t + <p_k> (1 - t) s)

with t the transmittance of the line of sight, <p_k> the pattern's mean over the hemisphere by the cosine, and s what
the air scatters in of it (`twilight.sky.night.world.veil`).  Radiances are means over the wavelengths' bins
(``numerics.spectrum.wavelength_bounds``), so that no line is lost between two samples.  Brightness is good to some
20 %; real nights differ by a factor 2, and cities by any factor.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import ClassVar, Self

import numpy as np

from twilight.atmosphere.medium import Medium
from twilight.base.errors import TwilightError
from twilight.numerics.spectrum import wavelength_bounds
from twilight.sky.lights import Light
from twilight.sky.moments import Moments, Place, unit_vector
from twilight.sky.night import light
from twilight.sky.night.world import Veil, gradient, lamp_spectrum, veil
from twilight.sky.surfaces import Surface
from twilight.sky.table import SkyTable
from twilight.transport.rays import horizon_dip_deg

ROWS_DEG = 1.5 + 3.0 * np.arange(30)
"""Elevations of the directions that stand for the hemisphere [deg]."""
COLUMNS_DEG = 15.0 * np.arange(24)
"""Their azimuths [deg]."""
TABLE_ROWS = 46
"""Elevations of a table from the horizon to the zenith, closer towards the horizon."""
TABLE_COLUMN_DEG = 3.0
"""Distance of its azimuths [deg]."""
MOMENTS_AT_ONCE = 300
"""Moments whose sky is held at once, which bounds the memory."""


@dataclass(frozen=True)
class NightLevels:
    """How bright each part is, in units of its usual brightness; 0 leaves it out.

    airglow: 1 is the mean of a solar cycle; about 0.7 at solar minimum, 1.3 at a strong maximum, with as much again
        from night to night.
    starlight: all stars as a smooth glow, and starlight scattered by dust between them.
    zodiacal_light: sunlight scattered by dust between the planets.
    light_pollution_cd_per_m2: luminance of the lamps' light in the zenith (`Skyglow`), which is given.
    """

    airglow: float = 1.0
    starlight: float = 1.0
    zodiacal_light: float = 1.0
    light_pollution_cd_per_m2: float = 0.0

    def __post_init__(self):
        for name in ("airglow", "starlight", "zodiacal_light", "light_pollution_cd_per_m2"):
            value = getattr(self, name)
            if not (np.isfinite(value) and value >= 0):
                raise TwilightError(f"night.{name}: must be 0 or more, not {value}")


def hemisphere_weights() -> np.ndarray:
    """Of ROWS_DEG (R,), for the mean of a hemisphere by the cosine of the angle to the zenith."""
    weight = np.sin(2.0 * np.radians(ROWS_DEG))
    return weight / weight.sum()


@dataclass(frozen=True, eq=False)
class Glow(Light):
    """A glow over an observer.

    level: in units of its usual brightness; medium: the air that it is seen through; altitude_km: of the observer.
    """

    level: float
    medium: Medium
    altitude_km: float

    @abstractmethod
    def spectra(self) -> np.ndarray:
        """S_k at the usual brightness, where its pattern is 1 [W m^-2 nm^-1 sr^-1], (K, W)."""

    @abstractmethod
    def patterns(self, moments: Moments, elevation_deg: np.ndarray, azimuth_deg: np.ndarray) -> np.ndarray:
        """p_k in directions (N, D) of N moments, or (1, D) of all, (N, D, K); (1, D, K) where they do not turn."""

    def air(self, elevation_deg: np.ndarray) -> Veil:
        """What the air does along lines of sight (E,)."""
        return veil(self.medium, elevation_deg, self.altitude_km)

    def at(self, altitude_km: float) -> Self:
        """The same seen from another altitude."""
        return replace(self, altitude_km=altitude_km)

    def means(self, moments: Moments) -> np.ndarray:
        """<p_k>, (N, K)."""
        return np.einsum("nrck,r->nk", self._hemisphere(moments), hemisphere_weights() / COLUMNS_DEG.size)

    def on_grid(self, moment: Moments, elevation_deg: np.ndarray, azimuth_deg: np.ndarray) -> np.ndarray:
        """Radiance [W m^-2 nm^-1 sr^-1] on rows (E,) and columns (A,) [deg] at one moment, (E, A, W)."""
        e, a = np.meshgrid(elevation_deg, azimuth_deg, indexing="ij")
        pattern = self.patterns(moment, e.reshape(1, -1), a.reshape(1, -1)).reshape(*e.shape, -1)
        passed, source = self.air(elevation_deg)
        return Veil(passed[:, None], source).behind(pattern @ self._shining, self.means(moment) @ self._shining)

    def radiance(self, moments: Moments, elevation_deg: np.ndarray, azimuth_deg: np.ndarray) -> np.ndarray:
        """Radiance [W m^-2 nm^-1 sr^-1] in directions (N, D) [deg] of N moments, (N, D, W)."""
        each, back = np.unique(elevation_deg, return_inverse=True)
        passed, source = self.air(each)
        back = back.reshape(elevation_deg.shape)
        out = np.empty((*elevation_deg.shape, source.size))
        for start in range(0, len(moments), MOMENTS_AT_ONCE):
            part = slice(start, start + MOMENTS_AT_ONCE)
            some = moments.part(part)
            above = self.patterns(some, elevation_deg[part], azimuth_deg[part]) @ self._shining
            out[part] = Veil(passed[back[part]], source).behind(above, (self.means(some) @ self._shining)[:, None])
        return out

    def irradiance(self, moments: Moments, surface: Surface) -> np.ndarray:
        """Irradiance [W m^-2 nm^-1] of a surface by what is above the horizon, (N, W)."""
        passed, source = self._row_air
        out = np.empty((len(moments), source.size))
        for start in range(0, len(moments), MOMENTS_AT_ONCE):
            part = slice(start, start + MOMENTS_AT_ONCE)
            some = moments.part(part)
            weight = _weights(surface, some)
            direct = np.einsum("nrc,nrck->nrk", weight, self._hemisphere(some))
            straight = np.einsum("nrk,kw,rw->nw", direct, self._shining, passed, optimize=True)
            scattered = weight.sum(axis=2) @ ((1.0 - passed) * source)
            out[part] = straight + scattered * (self.means(some) @ self._shining)
        return out

    @property
    @abstractmethod
    def brightest(self) -> np.ndarray:
        """The largest radiance that it has at any time in any direction, or more, (W,)."""

    def _hemisphere(self, moments: Moments) -> np.ndarray:
        """Patterns at ROWS_DEG and COLUMNS_DEG, (N or 1, R, C, K)."""
        e, a = (x.reshape(1, -1) for x in np.meshgrid(ROWS_DEG, COLUMNS_DEG, indexing="ij"))
        return self.patterns(moments, e, a).reshape(-1, ROWS_DEG.size, COLUMNS_DEG.size, len(self._shining))

    @cached_property
    def _shining(self) -> np.ndarray:
        return self.level * self.spectra()

    @cached_property
    def _row_air(self) -> Veil:
        return self.air(ROWS_DEG)


class _SameAround(Glow):
    """A glow that is the same at all moments and azimuths."""

    @cached_property
    def brightest(self) -> np.ndarray:
        """As of `Glow`."""
        rows = np.linspace(0.0, 90.0, 91)
        return np.asarray(self.on_grid(Moments.of_sun(0.0), rows, np.zeros(1)).max(axis=(0, 1)))


class _AmongStars(Glow):
    """A glow of one pattern that turns with the stars."""

    @property
    @abstractmethod
    def largest(self) -> float:
        """Largest value of the pattern."""

    @cached_property
    def brightest(self) -> np.ndarray:
        """As of `Glow`."""
        return np.asarray(self.largest * self._shining[0] * np.maximum(self._row_air.source, 1.0))


class Airglow(_SameAround):
    """Lines and continuum of layers at 90 to 300 km, brighter towards the horizon by van Rhijn's function."""

    name: ClassVar[str] = "airglow"

    def spectra(self) -> np.ndarray:
        """As of `Glow`: of each layer."""
        return light.airglow_zenith(wavelength_bounds(self.medium.wavelength_nm))

    def patterns(self, moments: Moments, elevation_deg: np.ndarray, azimuth_deg: np.ndarray) -> np.ndarray:
        """As of `Glow`."""
        return np.stack(
            [light.van_rhijn(elevation_deg, layer, self.altitude_km) for layer in light.airglow_layers()], axis=-1
        )


class Starlight(_AmongStars):
    """All stars with diffuse galactic light, by galactic latitude, with the sun's spectrum; without a place the mean
    over the sky."""

    name: ClassVar[str] = "stars"

    def spectra(self) -> np.ndarray:
        """As of `Glow`: of one S10."""
        return (light.S10_550NM * light.solar_shape(self.medium.wavelength_nm, 550.0))[None]

    def patterns(self, moments: Moments, elevation_deg: np.ndarray, azimuth_deg: np.ndarray) -> np.ndarray:
        """As of `Glow` [S10]."""
        galaxy, _ = moments.poles()
        if galaxy is None:
            return np.full((*elevation_deg.shape, 1), float(light.starlight_s10(None)))
        sine = _along(unit_vector(elevation_deg, azimuth_deg), galaxy)
        return light.starlight_s10(np.degrees(np.arcsin(np.clip(sine, -1.0, 1.0))))[..., None]

    @property
    def largest(self) -> float:
        """In the plane of the galaxy."""
        return float(light.starlight_s10(np.zeros(1))[0])


class ZodiacalLight(_AmongStars):
    """Sunlight from dust between the planets, by ecliptic longitude from the sun and latitude (Leinert et al. 1998)."""

    name: ClassVar[str] = "zodiacal_light"

    def spectra(self) -> np.ndarray:
        """As of `Glow`: of 1 W m^-2 nm^-1 sr^-1 at 500 nm."""
        nm = self.medium.wavelength_nm
        return (light.solar_shape(nm, 500.0) * light.zodiacal_colour(nm))[None]

    def patterns(self, moments: Moments, elevation_deg: np.ndarray, azimuth_deg: np.ndarray) -> np.ndarray:
        """As of `Glow` [W m^-2 nm^-1 sr^-1 at 500 nm]."""
        longitude, latitude = ecliptic_from_sun(moments, elevation_deg, azimuth_deg)
        return light.zodiacal_500nm(longitude, latitude)[..., None]

    @property
    def largest(self) -> float:
        """Next to the sun."""
        return float(light.zodiacal_500nm(np.linspace(0.0, 180.0, 361)[:, None], np.linspace(0.0, 90.0, 181)).max())


class Skyglow(_SameAround):
    """The lamps' light, a level that is given [cd m^-2 in the zenith]; it is made in the air, which dims it no more."""

    name: ClassVar[str] = "light_pollution"

    def spectra(self) -> np.ndarray:
        """As of `Glow`."""
        return lamp_spectrum(self.medium.wavelength_nm)[None]

    def patterns(self, moments: Moments, elevation_deg: np.ndarray, azimuth_deg: np.ndarray) -> np.ndarray:
        """As of `Glow`: over the zenith's."""
        return gradient(elevation_deg)[..., None]

    def air(self, elevation_deg: np.ndarray) -> Veil:
        """As of `Glow`."""
        count = self.medium.n_wavelengths
        return Veil(np.ones((elevation_deg.size, count)), np.zeros(count))


def glows_of(levels: NightLevels, medium: Medium, altitude_km: float) -> tuple[Glow, ...]:
    """The glows of some levels over an observer, without those of level 0."""
    kinds: dict[type[Glow], float] = {
        Airglow: levels.airglow,
        Starlight: levels.starlight,
        ZodiacalLight: levels.zodiacal_light,
        Skyglow: levels.light_pollution_cd_per_m2,
    }
    return tuple(kind(level, medium, altitude_km) for kind, level in kinds.items() if level > 0.0)


def glow_table(glows: Sequence[Glow], moment: Moments, medium: Medium, altitude_km: float) -> SkyTable:
    """The sum of glows [W m^-2 nm^-1 sr^-1] at a moment as a table of straight lines, the ground in its two first rows.

    Between the horizon of a high observer and 0 deg the sky is as at 0 deg.  The ground sends back by its albedo what
    falls on it, and no air stands before it.
    """
    dip = -horizon_dip_deg(medium, altitude_km)
    rows = dip + (90.0 - dip) * np.linspace(0.0, 1.0, TABLE_ROWS) ** 2
    columns = np.arange(0.0, 360.0, TABLE_COLUMN_DEG)
    sky, falling = np.zeros((rows.size, columns.size, medium.n_wavelengths)), np.zeros(medium.n_wavelengths)
    for glow in glows:
        sky += glow.on_grid(moment, np.maximum(rows, 0.0), columns)
        falling += glow.at(medium.bottom_km).irradiance(moment, Surface.horizontal())[0]
    ground = np.broadcast_to(medium.ground_albedo / np.pi * falling, (2, *sky.shape[1:]))
    sun = np.zeros(1)
    light_of = np.concatenate([ground, sky])[None]
    return SkyTable(sun, sun, np.append([-90.0, dip], rows), columns, light_of, mirrored=False, logarithmic=False)


def ecliptic_from_sun(
    moments: Moments, elevation_deg: np.ndarray, azimuth_deg: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Ecliptic longitude from the sun, -180 to 180 deg, and ecliptic latitude [deg] of directions (N, D)."""
    _, pole = moments.poles()
    sun = unit_vector(moments.sun.elevation_deg, moments.sun.azimuth_deg)
    sun = sun - (sun * pole).sum(axis=1, keepdims=True) * pole  # 0 but for the accuracy of the sidereal time
    sun /= np.linalg.norm(sun, axis=1, keepdims=True)
    towards = unit_vector(elevation_deg, azimuth_deg)
    latitude = np.degrees(np.arcsin(np.clip(_along(towards, pole), -1.0, 1.0)))
    longitude = np.degrees(np.arctan2(_along(towards, np.cross(pole, sun)), _along(towards, sun)))
    return longitude, latitude


def night_radiance(
    medium: Medium,
    elevation_deg: np.ndarray,
    azimuth_deg: np.ndarray,
    levels: NightLevels | None = None,
    *,
    sun_elevation_deg: float = -18.0,
    sun_azimuth_deg: float | None = None,
    place: Place | None = None,
    observer_altitude_km: float = 0.0,
) -> np.ndarray:
    """The sum of the glows over elevations (E,) and azimuths (A,) from the sun, (E, A, W) [W m^-2 nm^-1 sr^-1]."""
    rows, columns = np.asarray(elevation_deg, float), np.asarray(azimuth_deg, float)
    moment = Moments.of_sun(sun_elevation_deg, sun_azimuth_deg, place)
    out = np.zeros((rows.size, columns.size, medium.n_wavelengths))
    for glow in glows_of(levels or NightLevels(), medium, observer_altitude_km):
        out += glow.on_grid(moment, rows, columns)
    return out


def _along(towards: np.ndarray, axis: np.ndarray) -> np.ndarray:
    """Scalar products of directions (N or 1, D, 3) with an axis (N, 3), (N, D)."""
    return np.asarray(np.matmul(towards, axis[:, :, None])[..., 0])


def _weights(surface: Surface, moments: Moments) -> np.ndarray:
    """Of the hemisphere's directions for a surface, (N or 1, R, C) [sr]."""
    e, a = (x.reshape(1, -1) for x in np.meshgrid(ROWS_DEG, COLUMNS_DEG, indexing="ij"))
    sun = moments.sun.azimuth_deg if surface.turns and surface.from_sun else np.zeros(1)
    shape = (np.size(sun), e.size)
    view = surface.view(np.broadcast_to(e, shape), np.broadcast_to(a, shape), sun)
    half = 0.5 * (ROWS_DEG[1] - ROWS_DEG[0])
    height = np.sin(np.radians(ROWS_DEG + half)) - np.sin(np.radians(ROWS_DEG - half))
    solid = height * np.radians(COLUMNS_DEG[1])
    return view.reshape(-1, ROWS_DEG.size, COLUMNS_DEG.size) * solid[:, None]
