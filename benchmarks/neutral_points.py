"""Polarisation of the sky as numbers: the neutral points, and the degree of polarisation at the zenith.

All act on a field that gives Stokes vectors, `field.stokes(sun_elevation_deg, elevation_deg, azimuth_deg)`.  Light
scattered once vibrates across the plane through the sun: on the sun's vertical horizontally, Q < 0.  Light scattered
more often adds Q > 0 near the sun and opposite to it, and where both cancel the sky is unpolarised: Babinet's point
above the sun, Brewster's below it, Arago's above the antisolar point (Coulson 1988, Polarization and Intensity of Light
in the Atmosphere).
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

STEP_DEG = 0.5
LOWEST_DEG = 0.5
"""Elevation down to which neutral points are looked for."""


class NeutralPoints(NamedTuple):
    """Angles [deg] from the sun (Babinet, Brewster) and from the antisolar point (Arago), each (W,); nan: not in the
    sky."""

    babinet_deg: np.ndarray
    brewster_deg: np.ndarray
    arago_deg: np.ndarray


def degree_of_polarisation(stokes: np.ndarray) -> np.ndarray:
    """sqrt(Q^2 + U^2)/I of Stokes vectors (..., 3, W), shape (..., W); 0 where there is no light."""
    intensity = stokes[..., 0, :]
    lit = intensity > 0.0
    return np.where(lit, np.hypot(stokes[..., 1, :], stokes[..., 2, :]) / np.where(lit, intensity, 1.0), 0.0)


def neutral_points(field: Any, sun_elevation_deg: float) -> NeutralPoints:
    """Where Q changes its sign on the sun's vertical.

    Of several zeros on one side the nearest one to the sun, or to the antisolar point, counts.
    """
    # from the horizon below the sun through the zenith to the horizon opposite: the angle along that half circle
    along = np.arange(LOWEST_DEG, 180.0 - LOWEST_DEG + 1e-9, STEP_DEG)
    front = along <= 90.0
    elevation = np.where(front, along, 180.0 - along)
    stokes = field.stokes(sun_elevation_deg, elevation, np.where(front, 0.0, 180.0))
    q = stokes[:, 1]
    found = np.full((3, q.shape[1]), np.nan)
    for w, column in enumerate(q.T):
        k = np.flatnonzero(np.signbit(column[:-1]) != np.signbit(column[1:]))
        zero = along[k] + STEP_DEG * column[k] / (column[k] - column[k + 1])
        # Q rises towards sun and antisolar point
        towards_sun = column[k] > 0.0
        from_sun = zero - sun_elevation_deg
        babinet = from_sun[towards_sun & (from_sun > 0.0) & (zero < 90.0)]
        brewster = -from_sun[~towards_sun & (from_sun < 0.0)]
        arago = 180.0 + sun_elevation_deg - zero[~towards_sun & (zero > 90.0)]
        for row, values in zip(found, (babinet, brewster, arago), strict=True):
            row[w] = values.min() if values.size else np.nan
    return NeutralPoints(*found)


def zenith_polarisation(field: Any, sun_elevation_deg: float) -> np.ndarray:
    """Degree of linear polarisation (W,) at the zenith."""
    return degree_of_polarisation(field.stokes(sun_elevation_deg, 90.0, 0.0))
