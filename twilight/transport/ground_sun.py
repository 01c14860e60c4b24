"""The direct sun for an observer on the ground, by quadrature along one ray for each wavelength, in numpy alone.

It is what :mod:`twilight.transport.beam` tabulates for every point of the air, found without tables and compiled code:
paths and angles of rays are those of `clear_air.shells.Parts`, on a fine grid.  The ray that arrives from a true zenith
angle chi under the apparent one i is found by Newton's method, and with the optical depth tau along it

    E/F0 = exp(-tau) n_0^2 sin(i)/sin(chi) / (d chi/d i)

is 0 where chi is larger than that of the horizontal ray: behind the edge of the Earth's shadow.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from twilight.clear_air.shells import Parts

if TYPE_CHECKING:
    from twilight.atmosphere.medium import Medium

FINEST_KM = 0.005
"""Distance of nodes at the ground [km]."""
GROWTH = 0.03
"""By how much of the height the distance of nodes grows."""
STEP_RAD = 1e-5
"""Difference of apparent zenith angles over which d chi/d i is taken [rad]."""
NEWTON_STEPS = 12
"""Newton steps at most for the apparent zenith angle of the sun."""
CLOSE_RAD = 1e-13
"""Newton's method ends when that angle changes by less [rad]."""
HORIZONTAL = 0.5 * math.pi
"""Zenith angle of a level ray [rad]."""


class GroundSun:
    """The rays from the ground of a medium to space, asked for the sun at any elevation."""

    def __init__(self, medium: Medium):
        low, high = medium.bottom_km, medium.top_km
        height = [0.0]
        while low + height[-1] < high:
            height.append(height[-1] + FINEST_KM + GROWTH * height[-1])
        z = np.unique(np.clip(np.concatenate([low + np.array(height), medium.altitude_km]), low, high))
        # the two Gauss points between nodes, none of which lies on a jump
        between = 0.5 * np.diff(z)[:, None] * (1.0 + np.array([-1.0, 1.0]) / math.sqrt(3.0)) + z[:-1, None]
        self._per_km = medium.at(between).extinction.mean(axis=1)
        columns, self._of_column = np.unique(medium.at(z).refractivity.T, axis=0, return_inverse=True)
        self._parts = [Parts.of(z, 1.0 + column, medium.earth_radius_km) for column in columns]
        self._edges = [_chi(parts, np.array([HORIZONTAL]))[0] for parts in self._parts]
        self._overhead = medium.overhead_absorption_optical_depth
        self._screen = medium.screen
        self._powers = None if self._screen is None else self._screen.powers(medium.wavelength_nm)

    def at(self, sun_elevation_deg: float) -> tuple[np.ndarray, float]:
        """(irradiance at normal incidence over F0 (W,), bending [deg] at the most refracted wavelength; 0 in the dark).

        sun_elevation_deg: true elevation.
        """
        chi = math.radians(90.0 - sun_elevation_deg)
        irradiance = np.zeros(self._of_column.size)
        most, bending = 0.0, 0.0
        for k, (parts, edge) in enumerate(zip(self._parts, self._edges, strict=True)):
            if edge < chi:
                continue
            i = min(chi, HORIZONTAL)
            for _ in range(NEWTON_STEPS):
                there, slope = _chi_and_slope(parts, i)
                last, i = i, min(max(i + (chi - there) / slope, 0.0), HORIZONTAL)
                if abs(i - last) < CLOSE_RAD:
                    break
            # sin(i)/sin(chi) of two small angles
            spread = parts.n[0] ** 2 / slope * (math.sin(i) / math.sin(chi) if chi > 1e-4 else 1.0 / slope)
            path_km = parts.through(parts.x[:1] * math.sin(i))[0][0]
            of = self._of_column == k
            depth = path_km @ self._per_km[:, of] + self._overhead[of]
            irradiance[of] = spread * np.exp(-depth) * self._passed(of, parts, i)
            if parts.n[0] > most:
                most, bending = parts.n[0], max(0.0, chi - i)
        return irradiance, math.degrees(bending)

    def _passed(self, of: np.ndarray, parts: Parts, apparent: float) -> np.ndarray | float:
        """What a screen beyond the horizon lets pass of a ray from above (`beam_screen`) at some wavelengths."""
        if self._screen is None or self._powers is None:
            return 1.0
        along = parts.x[0] * math.cos(apparent) + self._screen.from_km
        lowest = np.interp(math.hypot(parts.x[0] * math.sin(apparent), along), parts.x, parts.altitude_km)
        return np.asarray(self._screen.at(np.array([lowest]))[0] ** self._powers[of])


def _chi(parts: Parts, apparent: np.ndarray) -> np.ndarray:
    """True zenith angles (B,) [rad] of the rays from the ground under apparent ones (B,)."""
    b = parts.x[0] * np.sin(apparent)
    return parts.through(b)[1].sum(axis=1) + np.arcsin(np.minimum(b / parts.x[-1], 1.0))


def _chi_and_slope(parts: Parts, apparent: float) -> tuple[float, float]:
    """chi and d chi/d i, the latter from angles on the near side of the horizontal."""
    upper = min(apparent + 0.5 * STEP_RAD, HORIZONTAL)
    there, above, below = _chi(parts, np.array([apparent, upper, upper - STEP_RAD]))
    return float(there), float((above - below) / STEP_RAD)
