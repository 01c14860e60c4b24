"""The moon as a second sun: where it stands, how bright it is by phase and distance, and its disc.

The disc is as the observer sees it: its lit part, turned to the sun, flattened and coloured by the air along the
refracted paths of `twilight.sky.disc.Disc`.  The surface reflects by the law of Lommel and Seeliger, with which the
full moon is evenly bright, as it is; seas and craters are not drawn, nor is the Earth's light on the dark part.
"""

from __future__ import annotations

import datetime as dt
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike

from twilight.base.errors import TwilightError
from twilight.base.shipped_data import data_numbers
from twilight.numerics import spectrum
from twilight.sky.disc import Disc
from twilight.sky.ephemeris import AU_KM, Sites
from twilight.sky.lights import Luminary

__all__ = ["Moon", "MoonDisc", "MoonSeen", "moon_over"]


def moon_over(
    moment: dt.datetime,
    latitude_deg: float,
    longitude_deg: float,
    sun_azimuth_deg: float,
    altitude_km: float = 0.0,
) -> Moon:
    """The moon of a place and time; its azimuth counts from that of the sun (from north [deg]).

    Topocentric, without refraction.  ERFA's `moon98` (Meeus 1998, ch. 47): 10 arcsec, for the years 1000 to 3000.
    Errors: TwilightError for other years.
    """
    site = Sites([moment], latitude_deg, longitude_deg, altitude_km)
    moon, sun = site.moon(), site.sun()
    return Moon(
        float(moon.elevation_deg[0]),
        float((moon.azimuth_deg[0] - sun_azimuth_deg) % 360.0),
        float(moon.phase_angle_deg[0]),
        float(moon.distance_au[0] * AU_KM),
        float(moon.sun_distance_au[0]),
        bool(is_waxing(sun.towards, moon.towards)[0]),
    )


def is_waxing(sun: np.ndarray, moon: np.ndarray) -> np.ndarray:
    """Whether a moon stands east of the sun, as the evening's, (T,); towards both: unit vectors (T, 3) of the ICRS."""
    return np.cross(sun, moon) @ ECLIPTIC_NORTH > 0.0


ECLIPTIC_NORTH = np.array([0.0, -np.sin(np.radians(23.4393)), np.cos(np.radians(23.4393))])
"""North pole of the ecliptic in the axes of the ICRS."""


MEAN_DISTANCE_KM = 384400.0
"""Distance for which the reflectance model is normalised [km] (Kieffer and Stone 2005, eq. 8)."""
MEAN_SOLID_ANGLE_SR = 6.4177e-5
"""Solid angle of the moon at that distance [sr] (ibid.)."""
PHASE_RANGE_DEG = (1.55, 97.0)
"""Phase angles of the observations behind the model [deg]."""
EXPONENTIAL_DEG = (4.06054, 12.8802)
"""p1 and p2 of the model [deg]."""
COSINE_DEG = (-30.5858, 16.7498)
"""p3 and p4 of the model [deg]."""
LONGEST_BAND_NM = 1300.0
"""Bands up to this wavelength take part in the smooth spectrum."""
SPECTRAL_DEGREE = 3
"""Degree of the polynomial of ln(wavelength) through ln(reflectance) of the bands: residuals of single bands, which are
of the observations (filters, calibration stars, water vapour at 940 nm), are 4 % in the mean square, and a higher
degree does not lower them."""
MIDDLE_NM = 600.0
"""Wavelength [nm] about which the polynomial is written, which does not change it."""
ALLEN_MAG = (0.026, 4e-9)
"""Magnitudes per degree and per degree^4 of phase angle (Allen 1976, Astrophysical Quantities; Krisciunas and Schaefer
1991 eq. 20): the curve that continues the model beyond its range."""
LOWEST_DEG = -18.0
"""Elevation [deg] below which the moon lights nothing: its light in the air is then 1e-15 of the sun's at 1 au."""


@dataclass(frozen=True)
class Moon(Luminary):
    """The moon over an observer; all are numbers, or (N,) at N moments.

    azimuth_deg: from the sun, or north.  phase_angle_deg: between sun and observer at the moon, 0 full and 180 new.
    distance_km: from the observer.  sun_distance_au: from the sun.  waxing: None where it is not known.
    """

    name: ClassVar[str] = "moon"
    strips: ClassVar[int] = 1
    elevation_deg: Any
    azimuth_deg: Any
    phase_angle_deg: Any
    distance_km: Any = MEAN_DISTANCE_KM
    sun_distance_au: Any = 1.0
    waxing: Any = None

    @property
    def radius_deg(self) -> Any:
        """Angular radius [deg]."""
        return np.degrees(np.sqrt(MEAN_SOLID_ANGLE_SR / np.pi)) * MEAN_DISTANCE_KM / self.distance_km

    @property
    def illuminated_fraction(self) -> float:
        """Lit fraction of the disc, 0 to 1."""
        return float(0.5 * (1.0 + np.cos(np.radians(self.phase_angle_deg))))

    @property
    def shines(self) -> Any:
        """Whether it lights the air over the observer (`LOWEST_DEG`)."""
        return self.elevation_deg >= LOWEST_DEG

    @property
    def continued(self) -> bool:
        """Whether the phase angle is outside the range of the observations (`PHASE_RANGE_DEG`)."""
        return not PHASE_RANGE_DEG[0] <= self.phase_angle_deg <= PHASE_RANGE_DEG[1]

    def reflectance(self, wavelength_nm: np.ndarray) -> np.ndarray:
        """As `disc_reflectance`."""
        return disc_reflectance(wavelength_nm, self.phase_angle_deg, self.waxing)

    def irradiance_factor(self, wavelength_nm: np.ndarray) -> np.ndarray:
        """Irradiance above the air over the sun's at 1 au, (..., W): reflectance x solid angle / pi."""
        nearer = np.square(MEAN_DISTANCE_KM / self.distance_km) / np.square(self.sun_distance_au)
        return self.reflectance(wavelength_nm) * (MEAN_SOLID_ANGLE_SR / np.pi) * np.asarray(nearer)[..., None]


def moon_illuminance_lux(moon: Moon, solar_spectrum: str = spectrum.DEFAULT_SOLAR_SPECTRUM) -> float:
    """Illuminance above the air, normal to the light [lx], by V(lambda) at 1 nm."""
    factor = moon.irradiance_factor(spectrum.VISIBLE_NM) * spectrum.colour_matching_functions("cie1931_2deg")[:, 1]
    return float(spectrum.LUMINOUS_EFFICACY_LM_PER_W * (factor @ spectrum.solar_at_visible(solar_spectrum)))


@lru_cache(maxsize=1)
def _bands() -> np.ndarray:
    """The table's rows up to `LONGEST_BAND_NM`, (B, 11)."""
    table = data_numbers("moon/rolo_kieffer_stone_2005.csv")[1]
    return table[table[:, 0] < LONGEST_BAND_NM]


def band_reflectance(
    phase_angle_deg: ArrayLike, waxing: bool | np.ndarray | None = None
) -> tuple[np.ndarray, np.ndarray]:
    """Wavelengths [nm] (B,) and disc reflectance of the bands, (..., B), for phase angles within `PHASE_RANGE_DEG`.

    Equation 10 of Kieffer and Stone 2005 without libration (at most 1 %).  waxing: the sun stands over the east of the
    moon's near side, else over its west (the waxing moon is brighter, 8 % at half moon); None: the mean of both.
    """
    table = _bands()
    degrees = np.asarray(phase_angle_deg, float)
    g = np.radians(degrees)
    sun = np.zeros(g.shape) if waxing is None else np.where(waxing, g, -g)
    (p1, p2), (p3, p4) = EXPONENTIAL_DEG, COSINE_DEG
    smooth = [np.ones(g.shape), g, g**2, g**3, sun, sun**3, sun**5]
    surge = [np.exp(-degrees / p1), np.exp(-degrees / p2), np.cos((degrees - p3) / p4)]
    return table[:, 0], np.exp(np.stack([*smooth, *surge], axis=-1) @ table[:, 1:].T)


def disc_reflectance(
    wavelength_nm: np.ndarray, phase_angle_deg: ArrayLike, waxing: bool | np.ndarray | None = None
) -> np.ndarray:
    """Disc-equivalent reflectance of the moon, (..., W), from 300 to 1250 nm, at phase angles (...).

    A polynomial of ln(wavelength) through the bands of `band_reflectance` (`SPECTRAL_DEGREE`), for the moon's rocks
    have a smooth spectrum.  Nearer to full moon than 1.55 deg, where the Earth's shadow is, the reflectance of 1.55 deg
    holds.  Beyond 97 deg that of 97 deg is continued by the phase curve of Allen 1976, with the same spectrum: its
    slope at 97 deg is that of the model within 1 %.
    Accuracy: 5 to 10 % in the absolute and 1 % in phase (Kieffer and Stone 2005); the continuation is a guide.
    Errors: TwilightError for a phase angle outside 0 to 180 deg.
    """
    phase = np.asarray(phase_angle_deg, float)
    wrong = ~((phase >= 0.0) & (phase <= 180.0))
    if wrong.any():
        raise TwilightError(f"moon: the phase angle must be from 0 to 180 deg, not {phase[wrong].flat[0]:g}")
    within = np.clip(phase, *PHASE_RANGE_DEG)
    nm, bands = band_reflectance(within, waxing)
    # least squares are linear in the logarithms
    powers = np.polynomial.polynomial.polyvander(np.log(nm / MIDDLE_NM), SPECTRAL_DEGREE)
    at = np.polynomial.polynomial.polyvander(np.log(np.asarray(wavelength_nm, float) / MIDDLE_NM), SPECTRAL_DEGREE)
    value = np.exp(np.log(bands) @ (at @ np.linalg.pinv(powers)).T)
    thinner = np.where(phase > within, allen_mag(phase) - allen_mag(within), 0.0)
    return np.asarray(value * 10.0 ** (-0.4 * thinner)[..., None])


def allen_mag(phase_angle_deg: np.ndarray) -> np.ndarray:
    """Magnitudes by which the moon is fainter than the full one, 0.026 g + 4e-9 g^4, without the surge."""
    linear, fourth = ALLEN_MAG
    return linear * phase_angle_deg + fourth * phase_angle_deg**4


@dataclass(frozen=True, eq=False)
class MoonDisc(Disc):
    """What the air does to the light of the moon's disc; radiances are over the sun's irradiance at 1 au.

    moon: its place and phase.  sun_elevation_deg: true, of the sun, which with `moon.azimuth_deg` says to where the lit
    limb points.
    """

    ACROSS: ClassVar[int] = 24
    moon: Moon
    sun_elevation_deg: float

    @classmethod
    def of(cls, path: Disc, moon: Moon, sun_elevation_deg: float) -> MoonDisc:
        """The moon in the refracted image of a disc of its elevation and radius."""
        return cls(**vars(path), moon=moon, sun_elevation_deg=sun_elevation_deg)

    @property
    def bright_limb_deg(self) -> float:
        """Position angle of the middle of the lit limb [deg]: 0 up, 90 towards larger azimuth."""
        right, up = towards_sun(self.moon, self.sun_elevation_deg)
        return float(np.degrees(np.arctan2(right, up)) % 360.0)

    def _above_the_air(self, true_deg: np.ndarray, azimuth_deg: np.ndarray, at: tuple | None = None) -> np.ndarray:
        """As of `Disc`: `surface` in true directions, azimuth from the moon, scaled to the moon's irradiance."""
        t, m, a = (np.radians(x) for x in (true_deg, self.moon.elevation_deg, azimuth_deg))
        radius = np.sin(np.radians(self.radius_deg))
        x = np.cos(t) * np.sin(a) / radius
        y = (np.sin(t) * np.cos(m) - np.cos(t) * np.sin(m) * np.cos(a)) / radius
        in_front = np.cos(t) * np.cos(m) * np.cos(a) + np.sin(t) * np.sin(m) > 0.0
        towards, phase = towards_sun(self.moon, self.sun_elevation_deg), self.moon.phase_angle_deg
        scale = self.moon.irradiance_factor(self.wavelength_nm) / radius**2 / disc_integral(phase)
        return np.where(in_front, surface(x, y, towards, phase), 0.0) * (scale if at is None else scale[at])


def towards_sun(moon: Moon, sun_elevation_deg: float) -> tuple[float, float]:
    """Unit vector on the moon's disc towards the sun: to larger azimuth, and up."""
    m, s, a = np.radians([moon.elevation_deg, sun_elevation_deg, -moon.azimuth_deg])
    right, up = np.cos(s) * np.sin(a), np.sin(s) * np.cos(m) - np.cos(s) * np.sin(m) * np.cos(a)
    length = float(np.hypot(right, up))
    return (float(right) / length, float(up) / length) if length > 1e-12 else (0.0, 1.0)


def surface(x: np.ndarray, y: np.ndarray, towards_sun: tuple[float, float], phase_angle_deg: float) -> np.ndarray:
    """Brightness mu0 / (mu0 + mu) of a sphere (Lommel and Seeliger) at places x, y of its disc of radius 1.

    mu0, mu: cosines of the angles between its normal and sun, observer; 0 off the disc and where it is night.
    """
    z2 = 1.0 - x**2 - y**2
    mu = np.sqrt(np.maximum(z2, 0.0))
    g = np.radians(phase_angle_deg)
    mu0 = (x * towards_sun[0] + y * towards_sun[1]) * np.sin(g) + mu * np.cos(g)
    lit = (z2 > 0.0) & (mu0 > 0.0)
    return np.where(lit, mu0 / np.where(lit, mu0 + mu, 1.0), 0.0)


def disc_integral(phase_angle_deg: float) -> float:
    """Integral of `surface` over the disc: pi/2 (1 - sin(g/2) tan(g/2) ln(cot(g/4))), from 0 to 179.9 deg.

    Beyond, where the crescent is thinner than mountains are high, that of 179.9 deg.
    """
    g = np.radians(np.clip(phase_angle_deg, 1e-6, 179.9))
    return float(0.5 * np.pi * (1.0 - np.sin(g / 2) * np.tan(g / 2) * np.log(1.0 / np.tan(g / 4))))


@dataclass(frozen=True, eq=False)
class MoonSeen:
    """The moon of a sky.

    moon: its place above the air.  apparent_elevation_deg: where refraction shows its centre.  direct_irradiance (W,):
    of what is seen of its disc, normal to its light [W m^-2 nm^-1].  disc: None where the moon is below the horizon.
    """

    moon: Moon
    apparent_elevation_deg: float
    direct_irradiance: np.ndarray
    disc: MoonDisc | None

    def dimmed(self, factor: float) -> MoonSeen:
        """Its light behind a filter."""
        disc = None if self.disc is None else self.disc.dimmed(factor)
        return replace(self, direct_irradiance=factor * self.direct_irradiance, disc=disc)
