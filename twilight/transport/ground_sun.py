"""The direct sun for an observer on the ground, by quadrature along one ray for each wavelength, in numpy alone.

It is what :mod:`twilight.transport.beam` tabulates for every point of the air, found without tables and compiled code.
With the apparent zenith angle i of the sun at radius r_0, x = n r and Bouguer's invariant p = x_0 sin i, the
bending and the optical depth of the ray to space are

    chi - i = - int dln(n)/dx  p dx / sqrt(x^2 - p^2),        tau = int k (dr/dx) x dx / sqrt(x^2 - p^2).

On a fine grid of radii ln(n), r and the mean of k are taken as linear in x from node to node; what is left has the
integrals p arcosh(x/p) and sqrt(x^2 - p^2), exact at the horizon too, where the integrands are infinite.  The ray that
arrives from a true zenith angle chi is found by Newton's method, and

    E/F0 = exp(-tau) n_0^2 sin(i)/sin(chi) / (d chi/d i)

is 0 where chi is larger than that of the horizontal ray: behind the edge of the Earth's shadow.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

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
        per_km = medium.at(between).extinction.mean(axis=1)
        index = 1.0 + medium.at(z).refractivity
        radius = medium.earth_radius_km + z
        x = index * radius[:, None]
        rise = np.diff(x, axis=0)
        self._x = x
        self._log_index_slope = -np.diff(np.log(index), axis=0) / rise
        self._per_x = per_km * np.diff(radius)[:, None] / rise
        self._overhead = medium.overhead_absorption_optical_depth
        self._index = index[0]
        self._screen = medium.screen
        self._altitude_km, self._wavelength_nm = z, medium.wavelength_nm

    def _chi(self, apparent: np.ndarray) -> np.ndarray:
        """True zenith angle (W,) [rad] of the rays under apparent ones (W,)."""
        p = self._x[0] * np.sin(apparent)
        safe = np.maximum(p, 1e-9)
        turned = safe * np.arccosh(np.maximum(self._x / safe, 1.0))
        return apparent + (self._log_index_slope * np.diff(turned, axis=0)).sum(axis=0)

    def at(self, sun_elevation_deg: float) -> tuple[np.ndarray, float]:
        """(irradiance at normal incidence over F0 (W,), bending [deg] at the most refracted wavelength; 0 in the dark).

        sun_elevation_deg: true elevation.
        """
        chi = math.radians(90.0 - sun_elevation_deg)
        i = np.full(self._index.size, min(chi, HORIZONTAL))
        lit = self._chi(np.full(i.size, HORIZONTAL)) >= chi
        if not lit.any():
            return np.zeros(i.size), 0.0
        for _ in range(NEWTON_STEPS):
            last, i = i, np.clip(i + (chi - self._chi(i)) / self._slope(i), 0.0, HORIZONTAL)
            if np.abs(i - last).max() < CLOSE_RAD:
                break
        spread = self._index**2 / self._slope(i)
        if chi > 1e-4:
            spread *= np.sin(i) / math.sin(chi)
        else:
            spread /= self._slope(i)  # sin(i)/sin(chi) of two small angles
        p = self._x[0] * np.sin(i)
        path = np.diff(np.sqrt(np.maximum(self._x**2 - p**2, 0.0)), axis=0)
        depth = (self._per_x * path).sum(axis=0) + self._overhead
        most = int(np.argmax(self._index))
        passed = self._passed(p, self._x[0] * np.cos(i))
        return np.where(lit, spread * np.exp(-depth) * passed, 0.0), float(np.degrees(max(0.0, chi - i[most])))

    def _passed(self, p: np.ndarray, u: np.ndarray) -> np.ndarray:
        """What a screen beyond the horizon lets pass (W,), of rays from above (`beam_screen`)."""
        if self._screen is None:
            return np.ones(p.size)
        x = np.hypot(p, u + self._screen.from_km)
        lowest = [np.interp(xx, column, self._altitude_km) for xx, column in zip(x, self._x.T, strict=True)]
        return self._screen.at(np.array(lowest)) ** self._screen.powers(self._wavelength_nm)

    def _slope(self, apparent: np.ndarray) -> np.ndarray:
        """d chi/d i, from angles on the near side of the horizontal."""
        upper = np.minimum(apparent + 0.5 * STEP_RAD, HORIZONTAL)
        return (self._chi(upper) - self._chi(upper - STEP_RAD)) / STEP_RAD
