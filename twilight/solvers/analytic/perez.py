"""The five-parameter sky of Perez, Seals and Michalsky 1993, as Preetham 1999 eq. 3 has it, and the CIE's form."""

from __future__ import annotations

import numpy as np

LOWEST_COSINE = 1e-3
"""exp(B / cos zenith) is held below this cosine (0.06 deg above the horizon), where B < 0 has made it 0."""


def angles(sun_elevation_deg: float, elevation_deg, azimuth_deg) -> tuple[np.ndarray, np.ndarray]:
    """Cosine of the zenith angle, and the angle to the sun [rad], of directions; azimuth from the sun [deg].

    The angle comes from the chord, 2 arcsin(|d - s| / 2), which keeps its digits beside the sun.
    """
    e, a = np.radians(np.asarray(elevation_deg, float)), np.radians(np.asarray(azimuth_deg, float))
    s = np.radians(sun_elevation_deg)
    chord = (np.cos(e) * np.cos(a) - np.cos(s)) ** 2 + (np.cos(e) * np.sin(a)) ** 2 + (np.sin(e) - np.sin(s)) ** 2
    return np.sin(e) + 0.0 * a, 2.0 * np.arcsin(np.minimum(0.5 * np.sqrt(chord), 1.0))


def perez(parameters, cos_zenith, sun_angle_rad) -> np.ndarray:
    """F = (1 + A exp(B / cos theta)) (1 + C exp(D gamma) + E cos^2 gamma), Preetham 1999 eq. 3.

    parameters: A, B, C, D, E; cos_zenith of the direction, > 0; sun_angle_rad: gamma, between direction and sun.
    """
    a, b, c, d, e = parameters
    gradation = 1.0 + a * np.exp(b / np.maximum(cos_zenith, LOWEST_COSINE))
    return gradation * (1.0 + c * np.exp(d * sun_angle_rad) + e * np.cos(sun_angle_rad) ** 2)


def perez_ratio(parameters, sun_zenith_rad: float, cos_zenith, sun_angle_rad) -> np.ndarray:
    """F(theta, gamma) / F(0, sun_zenith): 1 in the zenith (eq. 4)."""
    return perez(parameters, cos_zenith, sun_angle_rad) / perez(parameters, 1.0, sun_zenith_rad)


def cie(parameters, cos_zenith, sun_angle_rad) -> np.ndarray:
    """phi(Z) f(chi) of CIE S 011/E:2003 (ISO 15469:2004) with its parameters a, b, c, d, e.

    phi = 1 + a exp(b / cos Z), f = 1 + c (exp(d chi) - exp(d pi / 2)) + e cos^2 chi.
    """
    a, b, c, d, e = parameters
    gradation = 1.0 + a * np.exp(b / np.maximum(cos_zenith, LOWEST_COSINE))
    indicatrix = 1.0 + c * (np.exp(d * sun_angle_rad) - np.exp(0.5 * np.pi * d)) + e * np.cos(sun_angle_rad) ** 2
    return gradation * indicatrix


def traditional_overcast(cos_zenith) -> np.ndarray:
    """(1 + 2 cos theta) / 3 relative to the zenith: Moon and Spencer 1942, CIE 1955, CIE S 011 type 16, eq. 2."""
    return (1.0 + 2.0 * np.maximum(cos_zenith, 0.0)) / 3.0


def overcast_illuminance_lx(sun_elevation_deg: float) -> float:
    """Horizontal illuminance of an overcast sky [lx], 300 + 21000 sin(elevation) (Krochmann and Seidl 1974)."""
    return 300.0 + 21000.0 * float(np.sin(np.radians(sun_elevation_deg)))


def overcast_luminance(sun_elevation_deg: float, cos_zenith) -> np.ndarray:
    """Luminance [cd m^-2] of the traditional overcast sky; its zenith is 9/(7 pi) of the horizontal illuminance."""
    zenith = 9.0 / (7.0 * np.pi) * overcast_illuminance_lx(sun_elevation_deg)
    return zenith * traditional_overcast(cos_zenith)
