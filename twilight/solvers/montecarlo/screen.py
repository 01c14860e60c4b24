"""What lies beyond the horizon, at its place around the observer: the way of each sunbeam is followed to the sun.

The screen (`twilight.atmosphere.screen`) is here the air between two distances from the observer, along the ground.
From a point in sunlight the refracted ray is followed towards the sun step by step in space, and its least altitude
over that air is what T is taken at: no invariant, no tangent altitude and no symmetry about the sun's axis, on which
the sunbeam's own tables rest.  The observer stands at (0, 0, r), and x points to the sun, y to its right.

Arguments that kernels share: `kernel`; screen: `ScreenInSpace`, not empty.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from twilight.atmosphere.medium import Medium
from twilight.jit.kernels import njit
from twilight.solvers.montecarlo.kernel import INNER
from twilight.solvers.montecarlo.rays import LONGEST_KM, curvature

STEP_KM = 2.0
"""Length of a step below the highest altitude of the screen [km]."""
STEP_PER_HEIGHT = 0.3
"""Growth of a step with the height above it [km per km]."""
NOT_MET = 1e9
"""Least altitude of a ray that does not cross the screen's air [km]."""


class ScreenInSpace(NamedTuple):
    """T (N,) by altitude_km (N,), none where nothing screens; from_km, to_km: from the observer; bent: rays are.

    power (W,): of T.
    """

    altitude_km: np.ndarray
    transmission: np.ndarray
    from_km: float
    to_km: float
    bent: bool
    power: np.ndarray


def screen_in_space(medium: Medium, bent: bool) -> ScreenInSpace:
    """The screen of a medium."""
    screen = medium.screen
    if screen is None:
        return ScreenInSpace(np.zeros(0), np.zeros(0), 0.0, 0.0, bent, np.zeros(0))
    z, passed = np.array(screen.altitude_km), np.array(screen.transmission)
    power = screen.powers(medium.wavelength_nm)
    return ScreenInSpace(z, passed, screen.from_km, min(screen.to_km, LONGEST_KM), bent, power)


@njit(inner=True, **INNER)
def least_altitude(air, screen, w, x, y, z, dx, dy, dz):
    """Least altitude [km] over the screen's air of the ray from a point (x, y, z) [km] in a direction (dx, dy, dz)."""
    radius = air.earth_radius_km
    highest = screen.altitude_km[screen.altitude_km.size - 1]
    least = NOT_MET
    travelled = 0.0
    r = math.sqrt(x * x + y * y + z * z)
    h0, d0 = r - radius, radius * math.atan2(math.sqrt(x * x + y * y), z)
    while travelled < LONGEST_KM:
        mu = (x * dx + y * dy + z * dz) / r
        if mu >= 0.0 and h0 > highest:
            break
        step = STEP_KM + STEP_PER_HEIGHT * max(0.0, h0 - highest)
        half = 0.0
        sine = math.sqrt(max(0.0, (1.0 - mu) * (1.0 + mu)))
        if screen.bent and sine > 1e-6:
            middle = h0 + 0.5 * step * (mu + 0.5 * step * sine * sine / (2.0 * r))
            half = 0.5 * step * curvature(air, w, middle, sine)
            # towards the Earth, in the vertical plane: half of the bending before the step, half of it after
            c, s = math.cos(half), math.sin(half) / sine
            dx, dy, dz = (c + s * mu) * dx - s * x / r, (c + s * mu) * dy - s * y / r, (c + s * mu) * dz - s * z / r
        x, y, z = x + step * dx, y + step * dy, z + step * dz
        r = math.sqrt(x * x + y * y + z * z)
        h1, d1 = r - radius, radius * math.atan2(math.sqrt(x * x + y * y), z)
        first, last = max(min(d0, d1), screen.from_km), min(max(d0, d1), screen.to_km)
        if first <= last:
            slope = (h1 - h0) / (d1 - d0) if d1 != d0 else 0.0
            least = min(least, h0 + slope * (first - d0), h0 + slope * (last - d0))
        if half != 0.0:
            mu = (x * dx + y * dy + z * dz) / r
            sine = math.sqrt(max(1e-12, (1.0 - mu) * (1.0 + mu)))
            c, s = math.cos(half), math.sin(half) / sine
            dx, dy, dz = (c + s * mu) * dx - s * x / r, (c + s * mu) * dy - s * y / r, (c + s * mu) * dz - s * z / r
        h0, d0 = h1, d1
        travelled += step
    return least


@njit(**INNER)
def passing_in_space(air, screen, w, x, y, z, sx, sy, sz):
    """T of the beam from the apparent sun (sx, sy, sz) to a point (x, y, z) [km]."""
    h = least_altitude(air, screen, w, x, y, z, sx, sy, sz)
    altitude, transmission = screen.altitude_km, screen.transmission
    last = altitude.size - 1
    if h <= altitude[0]:
        passed = transmission[0]
    elif h >= altitude[last]:
        passed = transmission[last]
    else:
        k = 0
        while altitude[k + 1] < h:
            k += 1
        f = (h - altitude[k]) / (altitude[k + 1] - altitude[k])
        passed = (1.0 - f) * transmission[k] + f * transmission[k + 1]
    return passed ** screen.power[w]
