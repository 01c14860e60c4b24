"""The bright stars of Hipparcos as points: moved to a date, what of their light arrives, and in which pixels.

A camera that cannot resolve them sees them blended.
"""

from __future__ import annotations

import io
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache, lru_cache

import numpy as np

from twilight.atmosphere.medium import Medium
from twilight.base.shipped_data import data_file, data_rows
from twilight.numerics.directions import azimuth_elevation
from twilight.sky.moments import Place, to_horizon, years_from_j2000
from twilight.sky.night.glows import Glow, Starlight
from twilight.sky.night.light import starlight_s10
from twilight.transport.rays import ApparentRays, horizon_dip_deg

EPOCH = 1991.25
"""Julian year of the catalogue's positions."""
_MAS = np.pi / 180.0 / 3.6e6
"""One thousandth of an arcsecond [rad]."""


@dataclass(frozen=True, eq=False)
class Stars:
    """Point sources on a sphere, brightest first.

    directions (N, 3): unit vectors in whatever frame the maker says.  magnitude (N,).
    hip (N,): Hipparcos number, 0 for a planet.  names (N,): proper names, empty where there is none.
    """

    directions: np.ndarray
    magnitude: np.ndarray
    hip: np.ndarray
    names: np.ndarray

    def __len__(self) -> int:
        return len(self.magnitude)

    def take(self, chosen: np.ndarray) -> Stars:
        """The stars of these indices, or where this mask is true."""
        return Stars(self.directions[chosen], self.magnitude[chosen], self.hip[chosen], self.names[chosen])

    def turned(self, directions: np.ndarray) -> Stars:
        """The same stars in another frame."""
        return Stars(directions, self.magnitude, self.hip, self.names)

    def label(self, i: int) -> str:
        """The proper name, `HIP n` without one."""
        return str(self.names[i]) or f"HIP {self.hip[i]}"


@cache
def _table() -> dict[str, np.ndarray]:
    with np.load(io.BytesIO(data_file("stars/hipparcos2_bright.npz").read_bytes())) as stored:
        table = {name: stored[name] for name in stored.files}
    names = {int(row["hip"]): row["name"] for row in data_rows("stars/names.csv")}
    table["name"] = np.array([names.get(int(hip), "") for hip in table["hip"]])
    return table


def bright_stars(year: float, faintest_mag: float = 6.6) -> Stars:
    """Stars up to `faintest_mag` (Hp, at most 6.6) in the axes of the ICRS, with proper motion up to a Julian year.

    Motion along a great circle's tangent: good to 0.1 arcsec over a century for all but a few stars (radial velocity
    and parallax are left out).
    """
    table = _table()
    n = int(np.searchsorted(table["hp_mag"], faintest_mag, side="right"))
    ra, dec = np.radians(table["ra_deg"][:n]), np.radians(table["dec_deg"][:n])
    outwards = np.stack([np.cos(dec) * np.cos(ra), np.cos(dec) * np.sin(ra), np.sin(dec)], axis=-1)
    east = np.stack([-np.sin(ra), np.cos(ra), np.zeros(n)], axis=-1)
    north = np.cross(outwards, east)
    by_ra, by_dec = (
        ((year - EPOCH) * _MAS * table[f"pm_{axis}_mas_per_year"][:n].astype(float))[:, None] for axis in ("ra", "dec")
    )
    moved = outwards + by_ra * east + by_dec * north
    moved /= np.linalg.norm(moved, axis=1, keepdims=True)
    return Stars(moved, table["hp_mag"][:n].astype(float), table["hip"][:n], table["name"][:n])


def colour_index(faintest_mag: float = 6.6) -> np.ndarray:
    """B - V [mag] of the stars of `bright_stars`, in its order."""
    table = _table()
    n = int(np.searchsorted(table["hp_mag"], faintest_mag, side="right"))
    return table["b_v_mag"][:n].astype(float)


def blended(stars: Stars, resolution_rad: float) -> Stars:
    """Stars closer together than the resolution become one, named after the brightest, at their centre of light."""
    from scipy.spatial import cKDTree  # start-up

    stars = stars.take(np.argsort(stars.magnitude, kind="stable"))
    pairs = cKDTree(stars.directions).query_pairs(2.0 * np.sin(0.5 * resolution_rad), output_type="ndarray")
    pairs = np.sort(pairs, axis=1)
    free = np.ones(len(stars), dtype=bool)
    light = 10.0 ** (-0.4 * stars.magnitude)
    moment = light[:, None] * stars.directions
    for i, j in pairs[np.lexsort((pairs[:, 1], pairs[:, 0]))]:  # the brightest first
        if free[i] and free[j]:
            free[j] = False
            light[i] += light[j]
            moment[i] += moment[j]
    directions = moment / np.linalg.norm(moment, axis=1, keepdims=True)
    points = Stars(directions, -2.5 * np.log10(light), stars.hip, stars.names).take(free)
    return points.take(np.argsort(points.magnitude, kind="stable"))


VEGA_550NM = 3.631e-11
"""Irradiance of a star of V = 0 at 550 nm [W m^-2 nm^-1] (Bessell, Castelli and Plez 1998)."""
COLOURS_B_V = (-0.4, 2.0)
"""Range of colours for which Ballesteros' formula is used."""
ROWS = 160
"""Apparent elevations of an observer between which refraction and transmittance are linear."""
SPREAD_PIXELS = 0.6
"""Standard deviation of the Gauss curve that is a star's picture [pixel]."""
WIDEST = 3.5
"""Standard deviations from the star at which its picture ends."""


def temperature_k(b_v: np.ndarray) -> np.ndarray:
    """Temperature of a black body of a colour B - V [mag] (Ballesteros 2012, Europhysics Letters 97, 34008)."""
    b_v = np.clip(b_v, *COLOURS_B_V)
    return 4600.0 * (1.0 / (0.92 * b_v + 1.7) + 1.0 / (0.92 * b_v + 0.62))


def irradiance_above_air(magnitude: np.ndarray, b_v: np.ndarray, wavelength_nm: np.ndarray) -> np.ndarray:
    """Spectral irradiance (N, W) [W m^-2 nm^-1] of stars of a visual magnitude with the spectrum of a black body."""
    planck = 1.4387769e7 / temperature_k(b_v)[:, None]  # h c / k T [nm]

    def body(nm):
        return 1.0 / (np.power(nm, 5.0) * np.expm1(planck / nm))

    nm = np.asarray(wavelength_nm, float)[None, :]
    return VEGA_550NM * 10.0 ** (-0.4 * np.asarray(magnitude))[:, None] * body(nm) / body(550.0)


@lru_cache(maxsize=1)
def resolved_starlight_fraction() -> float:
    """Fraction of these stars in the light of all stars and of dust between them, which `night_radiance` has."""
    stars = bright_stars(2000.0)
    s10 = (10.0 ** (-0.4 * (stars.magnitude - 10.0))).sum() / (4.0 * np.pi * np.degrees(1.0) ** 2)
    return float(s10 / starlight_s10(None))


@dataclass(frozen=True, eq=False)
class StarSky:
    """What the air does to stars on their way to an observer.

    apparent_deg, true_deg (K,): elevations with refraction and without; passed (K, W): transmittance;
    wavelength_nm (W,); level: factor on all stars.
    """

    apparent_deg: np.ndarray
    true_deg: np.ndarray
    passed: np.ndarray
    wavelength_nm: np.ndarray
    level: float = 1.0

    @classmethod
    def of(cls, medium: Medium, altitude_km: float, level: float = 1.0) -> StarSky:
        """That of an observer; refraction is the one of the middle wavelength."""
        low = -horizon_dip_deg(medium, altitude_km) + 1e-3
        apparent = low + (90.0 - low) * np.linspace(0.0, 1.0, ROWS) ** 2
        true, passed = ApparentRays(medium).follow(altitude_km, apparent, np.arange(medium.n_wavelengths))
        middle = true[:, medium.n_wavelengths // 2]
        return cls(apparent, np.maximum.accumulate(middle), passed, medium.wavelength_nm, level)

    def over(self, place: Place) -> StarPoints:
        """The stars that are up over a place."""
        years = years_from_j2000(place)
        stars = bright_stars(2000.0 + years)
        true = to_horizon(precession(years) @ stars.directions.T, place)
        azimuth, elevation = azimuth_elevation(np.stack([true[1], true[0], true[2]], axis=-1))
        up = elevation > self.true_deg[0]
        azimuth, elevation = azimuth[up], elevation[up]
        shown = np.interp(elevation, self.true_deg, self.apparent_deg)
        passed = np.stack([np.interp(shown, self.apparent_deg, column) for column in self.passed.T], axis=-1)
        above = irradiance_above_air(stars.magnitude[up], colour_index()[up], self.wavelength_nm)
        return StarPoints(azimuth, shown, self.level * above * passed)


def with_points(glows: Sequence[Glow]) -> tuple[tuple[Glow, ...], StarSky | None]:
    """Glows whose starlight lacks the brighter stars, and these; None: there is no starlight."""
    sky, rest = None, []
    for glow in glows:
        if isinstance(glow, Starlight):
            sky = StarSky.of(glow.medium, glow.altitude_km, glow.level)
            glow = replace(glow, level=glow.level * (1.0 - resolved_starlight_fraction()))
        rest.append(glow)
    return tuple(rest), sky


@dataclass(frozen=True, eq=False)
class StarPoints:
    """Points of light: azimuth_deg (N,) from north, apparent elevation_deg (N,), irradiance (N, K)."""

    azimuth_deg: np.ndarray
    elevation_deg: np.ndarray
    irradiance: np.ndarray


class Raster:
    """Pixels of a picture, or of some rows of one, that points are drawn into.

    rays (H, W, 3): directions of the pixels, in any frame, NaN outside the picture; pitch_deg: angle between pixels,
    for a picture of one row or column.
    """

    def __init__(self, rays: np.ndarray, pitch_deg: float):
        from scipy.spatial import cKDTree  # start-up

        self.shape = rays.shape[:2]
        inside = np.isfinite(rays).all(axis=-1)
        self._pixel = np.flatnonzero(inside)
        self._rays = rays.reshape(-1, 3)[self._pixel]
        self._step = _spacing(rays, np.radians(pitch_deg)).ravel()[self._pixel]
        self._tree = cKDTree(self._rays)

    def spread(self, towards: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """(pixel (M,), point (M,), fraction of the point's irradiance that is the pixel's radiance (M,) [sr^-1]).

        towards (N, 3): directions of the points.  A point is a Gauss curve over the sky, SPREAD_PIXELS of the largest
        distance between neighbouring pixels there: whatever the projection is, its light is conserved within 1 %.
        """
        none = np.zeros(0, int), np.zeros(0, int), np.zeros(0)
        if not self._pixel.size or not len(towards):
            return none
        widest = WIDEST * SPREAD_PIXELS * float(self._step.max())
        near, nearest = self._tree.query(towards, distance_upper_bound=widest)
        shown = np.flatnonzero(np.isfinite(near))
        width = SPREAD_PIXELS * self._step[nearest[shown]]
        lists = self._tree.query_ball_point(towards[shown], WIDEST * width)
        count = np.array([len(one) for one in lists], int)
        if not count.sum():
            return none
        pixel, which = np.concatenate([np.asarray(one, int) for one in lists]), np.repeat(np.arange(shown.size), count)
        square = ((self._rays[pixel] - towards[shown][which]) ** 2).sum(axis=-1)
        variance = width[which] ** 2
        fraction = np.exp(-0.5 * square / variance) / (2.0 * np.pi * variance * -np.expm1(-0.5 * WIDEST**2))
        return self._pixel[pixel], shown[which], fraction

    def add(self, picture: np.ndarray, towards: np.ndarray, irradiance: np.ndarray, hidden: np.ndarray | None = None):
        """Add points of an irradiance (N, K) to a picture (H, W, K); hidden (H, W): where nothing of them is seen."""
        pixel, point, fraction = self.spread(towards)
        if hidden is not None:
            fraction = np.where(hidden.ravel()[pixel], 0.0, fraction)
        flat = picture.reshape(-1, picture.shape[-1])
        np.add.at(flat, pixel, (fraction[:, None] * irradiance[point]).astype(picture.dtype))


def _spacing(rays: np.ndarray, otherwise: float) -> np.ndarray:
    """The largest distance (H, W) of a pixel's direction from its neighbours' below and beside it."""
    spacing = np.zeros(rays.shape[:2])
    for axis in range(2):
        if rays.shape[axis] == 1:
            spacing = np.maximum(spacing, otherwise)
            continue
        step = np.linalg.norm(np.diff(rays, axis=axis), axis=-1)
        # a jump, from face to face of a cube, is no distance between neighbours
        step = np.where(step < 20.0 * np.nanmedian(step), step, 0.0)
        low = np.concatenate([step, np.zeros_like(step.take([0], axis))], axis=axis)
        high = np.concatenate([np.zeros_like(step.take([0], axis)), step], axis=axis)
        spacing = np.fmax(spacing, np.fmax(low, high))
    return np.where(spacing > 0.0, spacing, otherwise)


def precession(years: float) -> np.ndarray:
    """Matrix (3, 3) from the equator and equinox of J2000 to those of a date (Meeus 1998 ch. 21)."""
    t = years / 100.0
    arcsec = (
        t * (2306.2181 + t * (0.30188 + t * 0.017998)),
        t * (2306.2181 + t * (1.09468 + t * 0.018203)),
        t * (2004.3109 - t * (0.42665 + t * 0.041833)),
    )
    zeta, z, theta = np.radians(np.array(arcsec) / 3600.0)

    def about_pole(angle: float) -> np.ndarray:
        c, s = np.cos(angle), np.sin(angle)
        return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])

    c, s = np.cos(theta), np.sin(theta)
    return about_pole(z) @ np.array([[c, 0.0, -s], [0.0, 1.0, 0.0], [s, 0.0, c]]) @ about_pole(zeta)
