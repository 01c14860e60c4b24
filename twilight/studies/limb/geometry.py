"""Lines of sight past the limb: from a sun at their tangent point to the angles that an observer above the air sees.

Lines are named by their apparent tangent altitude z, that of the straight line: an observer at the distance r = R + H
from the Earth's centre looks L / r = sin(dip) below the horizontal, with L^2 = r^2 - (R + z)^2.  At the straight line's
tangent point, with the sun at the zenith angle s and the line going on in the azimuth a from it, the sun stands for the
observer at

    cos(zenith angle) = ((R + z) cos s - L sin s cos a) / r,

and the component of its direction across the vertical plane of the line is sin s sin a for both.  The bent ray of the
same direction has its lowest point where n (R + tangent altitude) = R + z (Bouguer).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from twilight.atmosphere.medium import Medium
from twilight.base.errors import TwilightError

SHAPES = ("box", "gaussian")
"""Of fields of view: even over its whole width, or with that full width at half maximum."""
NODES = 7
"""Lines of sight in a field of view, Gauss-Legendre or Gauss-Hermite."""
STEP_KM = 0.01
"""Altitudes at which n r is tabulated, to find the lowest points of rays."""


class LimbGeometry(NamedTuple):
    """Angles [deg] of T lines of sight of an observer above the air.

    elevation_deg: apparent; sun_elevation_deg: true; azimuth_deg: from the sun; scattering_angle_deg: of light
    scattered once, at the straight line's tangent point
    """

    elevation_deg: np.ndarray
    sun_elevation_deg: np.ndarray
    azimuth_deg: np.ndarray
    scattering_angle_deg: np.ndarray


def tangent_altitudes(medium: Medium, tangent_km: ArrayLike, observer_altitude_km: float) -> np.ndarray:
    """Apparent tangent altitudes [km] as an array (T,).

    Errors: TwilightError for an observer within the air, and tangent altitudes below the ground or above the air.
    """
    if not medium.top_km < observer_altitude_km < np.inf:
        raise TwilightError(
            f"observer_altitude_km is {observer_altitude_km:g}; allowed is more than {medium.top_km:g}, above the air"
        )
    tangent = np.atleast_1d(np.asarray(tangent_km, dtype=float))
    if tangent.ndim != 1 or tangent.size == 0 or not np.all((tangent >= medium.bottom_km) & (tangent <= medium.top_km)):
        raise TwilightError(
            f"tangent_km must be one number or more, each from {medium.bottom_km:g} (the ground) to {medium.top_km:g} "
            "(the top of the air)"
        )
    return tangent


def limb_elevation_deg(medium: Medium, tangent_km: np.ndarray, observer_altitude_km: float) -> np.ndarray:
    """Elevation [deg] of straight lines of sight by their tangent altitude [km], of the same shape; level at most."""
    radius = medium.earth_radius_km
    return -np.degrees(np.arccos(np.minimum((radius + tangent_km) / (radius + observer_altitude_km), 1.0)))


def limb_geometry(
    medium: Medium, tangent_km: np.ndarray, observer_altitude_km: float, sun_elevation_deg: float, azimuth_deg: float
) -> LimbGeometry:
    """Lines of sight (T,) whose tangent points have the sun at an elevation, in an azimuth from it [deg]."""
    low, high = medium.earth_radius_km + tangent_km, medium.earth_radius_km + observer_altitude_km
    length = np.sqrt(high**2 - low**2)
    sun, azimuth = np.radians(sun_elevation_deg), np.radians(azimuth_deg)
    # direction of the sun at the tangent point: along the line of sight, across its vertical plane, and up
    along, across, up = np.cos(sun) * np.cos(azimuth), np.cos(sun) * np.sin(azimuth), np.sin(sun)
    # the observer's vertical in the tangent point's (up, along) is (low, -length) / high
    sun_of_observer = np.degrees(np.arcsin(np.clip((low * up - length * along) / high, -1.0, 1.0)))
    level = (length * up + low * along) / high
    return LimbGeometry(
        limb_elevation_deg(medium, tangent_km, observer_altitude_km),
        sun_of_observer,
        np.degrees(np.arctan2(across, level)),
        np.full(tangent_km.size, np.degrees(np.arccos(np.clip(along, -1.0, 1.0)))),
    )


def bent_tangent_km(medium: Medium, tangent_km: np.ndarray) -> np.ndarray:
    """Lowest points [km] of the bent rays (T, W), nan where they meet the ground."""
    height = np.linspace(medium.bottom_km, medium.top_km, int((medium.top_km - medium.bottom_km) / STEP_KM) + 2)
    radius = medium.earth_radius_km + height
    refractivity = medium.at(height).refractivity
    out = np.empty((tangent_km.size, medium.n_wavelengths))
    for w in range(medium.n_wavelengths):
        # the lowest point of a ray from above is the highest place that has its n r
        invariant = np.minimum.accumulate((radius * (1.0 + refractivity[:, w]))[::-1])[::-1]
        out[:, w] = np.interp(medium.earth_radius_km + tangent_km, invariant, height, left=np.nan)
    return out


def field_of_view(width_km: float | None, shape: str) -> tuple[np.ndarray, np.ndarray]:
    """Offsets in tangent altitude [km] and weights (N,), their sum 1, of a field of view; one line without a width.

    Errors: TwilightError for a width that is not above 0, and a shape that is none of SHAPES.
    """
    if shape not in SHAPES:
        raise TwilightError(f"field_of_view_shape: {shape} is not allowed; it must be {' or '.join(SHAPES)}")
    if width_km is None:
        return np.zeros(1), np.ones(1)
    if not 0.0 < width_km <= 50.0:
        raise TwilightError(f"field_of_view_km is {width_km:g}; allowed is more than 0, to 50")
    if shape == "box":
        x, weight = np.polynomial.legendre.leggauss(NODES)
        return 0.5 * width_km * x, 0.5 * weight
    x, weight = np.polynomial.hermite.hermgauss(NODES)
    # exp(-x^2) has the full width 2 sqrt(ln 2) at half maximum
    return x * width_km / (2.0 * np.sqrt(np.log(2.0))), weight / np.sqrt(np.pi)
