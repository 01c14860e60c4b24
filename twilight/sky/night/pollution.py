"""Light pollution: a level that is given, brighter towards the horizon by a published curve.  It is not computed."""

from __future__ import annotations

import numpy as np

from twilight.base.errors import TwilightError
from twilight.numerics import spectrum

NATURAL_ZENITH_MAG = 22.0
"""Zenith of a natural sky [V mag arcsec^-2], which is within the brightness that is given: 174 ucd m^-2 (Falchi et al.
2016, Science Advances 2, e1600377)."""
NATURAL_ZENITH_CD_PER_M2 = 174e-6
"""The same as a luminance [cd m^-2] (ibid.)."""
BORTLE_ZENITH_MAG = (22.0, 21.94, 21.79, 21.09, 20.0, 19.22, 18.66, 18.1, 17.5)
"""Middle of the range of zenith brightness [V mag arcsec^-2] that goes with the classes 1 to 9 of Bortle 2001 (Sky and
Telescope 101/2, 126) in the charts in common use: 21.99, 21.89, 21.69, 20.49, 19.50, 18.94, 18.38 between the classes;
8 and 9 are open ranges.  The classes themselves are of what is seen, and differ by half a class."""
EXTINCTION_MAG = 0.172
"""Extinction in the zenith [mag], V (Krisciunas and Schaefer 1991)."""
PATH_CURVATURE = 0.96
"""Of the path X = (1 - 0.96 sin^2 z)^-1/2 (Garstang 1989, PASP 101, 306)."""
TEMPERATURE_K = 3000.0
"""Temperature of the black body whose spectrum the lamps have: between sodium lamps and white LEDs."""


def bortle_zenith_mag(bortle_class: int) -> float:
    """Zenith brightness [V mag arcsec^-2] that stands for a class of Bortle 2001; TwilightError outside 1 to 9."""
    if not 1 <= bortle_class <= len(BORTLE_ZENITH_MAG):
        raise TwilightError(f"Bortle class: must be from 1 to 9, not {bortle_class}")
    return BORTLE_ZENITH_MAG[bortle_class - 1]


def artificial_zenith_cd_per_m2(zenith_mag_per_arcsec2: float) -> float:
    """Luminance of the lamps' light in the zenith [cd m^-2], for a zenith brightness with the natural sky in it.

    Errors: TwilightError for a zenith darker than the natural one, 22.0 V mag arcsec^-2.
    """
    if not zenith_mag_per_arcsec2 <= NATURAL_ZENITH_MAG:
        raise TwilightError(
            f"light pollution: a zenith of {zenith_mag_per_arcsec2:g} mag arcsec^-2 is darker than a natural one, "
            f"{NATURAL_ZENITH_MAG:g}"
        )
    return NATURAL_ZENITH_CD_PER_M2 * (10.0 ** (0.4 * (NATURAL_ZENITH_MAG - zenith_mag_per_arcsec2)) - 1.0)


def gradient(elevation_deg: np.ndarray) -> np.ndarray:
    """Brightness over that of the zenith, X 10^(-0.4 k (X - 1)): 1 there, 2.65 at the horizon and below it.

    Garstang 1989; Krisciunas and Schaefer 1991 eq. 2 and 3.  The same all around: no light dome of a town is known.
    """
    sine = np.cos(np.radians(np.maximum(np.asarray(elevation_deg, float), 0.0)))
    path = (1.0 - PATH_CURVATURE * sine**2) ** -0.5
    return path * 10.0 ** (-0.4 * EXTINCTION_MAG * (path - 1.0))


def pollution_radiance(wavelength_nm: np.ndarray, elevation_deg: np.ndarray, zenith_cd_per_m2: float) -> np.ndarray:
    """Spectral radiance of the lamps' light in the air [W m^-2 nm^-1 sr^-1], (E, W), over elevations (E,) [deg]."""
    efficacy = spectrum.LUMINOUS_EFFICACY_LM_PER_W * spectrum.colour_matching_functions("cie1931_2deg")[:, 1]
    per_lumen = 1.0 / float(_black_body(spectrum.VISIBLE_NM) @ efficacy)
    shape = _black_body(np.asarray(wavelength_nm, float)) * per_lumen
    return zenith_cd_per_m2 * gradient(elevation_deg)[:, None] * shape


def _black_body(nm: np.ndarray) -> np.ndarray:
    return 1e15 / (nm**5 * np.expm1(1.4387769e7 / (nm * TEMPERATURE_K)))
