"""How bright the moon is: its disc-integrated spectral irradiance by phase and distance."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike

from twilight.base.errors import TwilightError
from twilight.base.shipped_data import data_numbers
from twilight.numerics import spectrum

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
class Moon:
    """The moon over an observer.

    elevation_deg: true, of its centre.  azimuth_deg: from the sun, clockwise.  phase_angle_deg: between sun and
    observer at the moon, 0 full and 180 new.  distance_km: from the observer.  sun_distance_au: from the sun.
    waxing: None where it is not known.
    """

    elevation_deg: float
    azimuth_deg: float
    phase_angle_deg: float
    distance_km: float = MEAN_DISTANCE_KM
    sun_distance_au: float = 1.0
    waxing: bool | None = None

    @property
    def radius_deg(self) -> float:
        """Angular radius [deg]."""
        return float(np.degrees(np.sqrt(MEAN_SOLID_ANGLE_SR / np.pi)) * MEAN_DISTANCE_KM / self.distance_km)

    @property
    def illuminated_fraction(self) -> float:
        """Lit fraction of the disc, 0 to 1."""
        return float(0.5 * (1.0 + np.cos(np.radians(self.phase_angle_deg))))

    @property
    def shines(self) -> bool:
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
        """Irradiance above the air over the sun's at 1 au, (W,)."""
        return irradiance_factors(
            wavelength_nm, self.phase_angle_deg, self.waxing, self.distance_km, self.sun_distance_au
        )


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


def irradiance_factors(
    wavelength_nm: np.ndarray,
    phase_angle_deg: ArrayLike,
    waxing: bool | np.ndarray | None,
    distance_km: ArrayLike,
    sun_distance_au: ArrayLike,
) -> np.ndarray:
    """Irradiance above the air over the sun's at 1 au, (..., W): reflectance x solid angle / pi, by the distances."""
    nearer = (MEAN_DISTANCE_KM / np.asarray(distance_km, float)) ** 2 / np.asarray(sun_distance_au, float) ** 2
    reflectance = disc_reflectance(wavelength_nm, phase_angle_deg, waxing)
    return reflectance * (MEAN_SOLID_ANGLE_SR / np.pi) * nearer[..., None]


def allen_mag(phase_angle_deg: np.ndarray) -> np.ndarray:
    """Magnitudes by which the moon is fainter than the full one, 0.026 g + 4e-9 g^4, without the surge."""
    linear, fourth = ALLEN_MAG
    return linear * phase_angle_deg + fourth * phase_angle_deg**4
