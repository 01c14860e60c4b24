"""What the naked eye can see on a luminous background: Crumey 2014 (MNRAS 442, 2600), fitted to Blackwell 1946.

A point of light is seen where it adds more than a threshold illuminance at the eye, an extended target where its
contrast exceeds a threshold; both are of adapted eyes that know where to look and have time.  The field factor F
multiplies the laboratory's thresholds (half of the trials, two eyes, young observers): 1.4 to 2.4 under the sky, 2
typically (sec. 3.1).

The thresholds of discs, F ((R/A)^q + C^q)^(1/q) for the solid angle A (eq. 41), say how much of a disc's light counts
at its centre: with u = A C / R that of a disc of u counts like u (1 + u^q)^(-1/q) of one without end.  Light at the
distance d from the point that is looked at, u = pi d^2 C / R, has the derivative of this for its weight,

    K(d) = (C / R) (1 + u^q)^(-1/q - 1),

and a target of any shape is seen where the integral of (L - B) K over solid angle exceeds F C B.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from twilight.base.errors import TwilightError

TYPICAL_FIELD_FACTOR = 2.0
"""Field factor of typical observers: a limit of 6.18 mag on a dark night (Crumey 2014 sec. 3.1)."""
MAGNITUDE_0_LUX = 2.54e-6
"""Illuminance of a star of V = 0 above the air [lx] (ibid. sec. 1.3, after Cox 1999)."""
LEAST_BACKGROUND_CD_PER_M2 = 1e-5
"""Luminance below which a background is as none [cd m^-2] (ibid. sec. 2.3)."""
POINT = (5.949e-8, -2.389e-7, 2.459e-7, 4.120e-4, -4.225e-4)
"""a1 to a5 of eq. 25 and 28, for luminance in cd m^-2 and illuminance in lx."""
LARGE = (9.606e-6, -4.112e-5, 5.019e-5, 4.837e-3, -4.884e-3)
"""b1 to b5 of eq. 39 and 40: threshold contrast of large targets."""
MESOPIC_CD_PER_M2 = (0.193, 3.40)
"""Luminances between which the exponent q changes (eq. 42 to 44)."""


def _hyperbola(quarter: np.ndarray, c: tuple[float, ...]) -> np.ndarray:
    """sqrt(c1 x^2 + c2 x + c3) + c4 x + c5 of x = B^-1/4."""
    return np.sqrt(np.maximum(c[0] * quarter**2 + c[1] * quarter + c[2], 0.0)) + c[3] * quarter + c[4]


def threshold_illuminance_lux(
    background_cd_per_m2: ArrayLike, field_factor: float = TYPICAL_FIELD_FACTOR
) -> np.ndarray:
    """Illuminance of a point that is just seen [lx], at the eye: eq. 34, F R B with R of eq. 25.

    background_cd_per_m2: photopic luminance, held at 1e-5 from below.  For the light of stars; achromatic.
    Range: the data go from 1e-5 to 3e3 cd m^-2.  About 0.05 cd m^-2 the fit is 0.03 mag from monotone.
    Errors: TwilightError for a field factor that is not positive.
    """
    if not field_factor > 0.0:
        raise TwilightError(f"field factor: must be above 0, not {field_factor:g}")
    b = np.maximum(np.asarray(background_cd_per_m2, float), LEAST_BACKGROUND_CD_PER_M2)
    return field_factor * b * _hyperbola(b**-0.25, POINT) ** 2


def limiting_magnitude(background_cd_per_m2: ArrayLike, field_factor: float = TYPICAL_FIELD_FACTOR) -> np.ndarray:
    """V magnitude, at the eye, of the faintest star that is seen; what the air takes is not in it."""
    return illuminance_magnitude(threshold_illuminance_lux(background_cd_per_m2, field_factor))


def illuminance_magnitude(lux: ArrayLike) -> np.ndarray:
    """V magnitude of an illuminance [lx]: infinite for none."""
    with np.errstate(divide="ignore"):
        return -2.5 * np.log10(np.asarray(lux, float) / MAGNITUDE_0_LUX)


def threshold_contrast(
    solid_angle_sr: ArrayLike, background_cd_per_m2: ArrayLike, field_factor: float = TYPICAL_FIELD_FACTOR
) -> np.ndarray:
    """Contrast (L - B) / B of an even disc of a solid angle that is just seen: eq. 41, F ((R/A)^q + C^q)^(1/q).

    Small targets tend to `threshold_illuminance_lux`, large ones to C of eq. 39.
    """
    _, point, large, q = _disc_law(background_cd_per_m2)
    return field_factor * ((point / np.asarray(solid_angle_sr, float)) ** q + large**q) ** (1.0 / q)


def magnitudes_above(
    lux: np.ndarray, distance_rad: np.ndarray, background_cd_per_m2: float, field_factor: float = TYPICAL_FIELD_FACTOR
) -> float:
    """Magnitudes by which a target of any shape is brighter than the limit, by the kernel of the module's head.

    lux (..., M): illuminance at the eye of its M parts; distance_rad (..., M): of each from the point that is looked
    at, of which there are several along the first axes: the best counts.
    """
    b, point, large, q = (float(x) for x in _disc_law(background_cd_per_m2))
    u = np.pi * np.asarray(distance_rad, float) ** 2 * large / point
    counts = (np.asarray(lux, float) * (1.0 + u**q) ** (-1.0 / q - 1.0)).sum(axis=-1).max()
    with np.errstate(divide="ignore"):
        return float(2.5 * np.log10(counts / (field_factor * point * b)))


def _disc_law(background_cd_per_m2: ArrayLike) -> tuple[np.ndarray, ...]:
    """B (held from below), R [sr], C and q of eq. 41."""
    b = np.maximum(np.asarray(background_cd_per_m2, float), LEAST_BACKGROUND_CD_PER_M2)
    low, high = MESOPIC_CD_PER_M2
    log = np.log10(b)
    q = np.where(b < low, 0.6, np.where(b < high, 0.8861 + 0.4 * log, 1.146 - 0.0885 * log))
    return b, _hyperbola(b**-0.25, POINT) ** 2, _hyperbola(b**-0.25, LARGE), q
