"""What lies beyond the horizon, at its place around the observer: the way of each sunbeam is followed to the sun.

The screen (`twilight.atmosphere.screen`) is here the air between two distances from the observer, along the ground.
From a point in sunlight the refracted ray is followed towards the sun step by step in space, and its least altitude
over that air is what T is taken at: no invariant, no tangent altitude and no symmetry about the sun's axis, on which
the sunbeam's own tables rest.  The observer stands at (0, 0, r), and x points to the sun, y to its right.

A skyline by azimuth is a wall about the observer, of distance D(azimuth) and height H(azimuth).  Where a ray crosses
it, from within or from beyond, its altitude above the wall is what T is taken at: 0 below, 1 above.

Arguments that kernels share: `kernel`; screen: `ScreenInSpace`, not empty.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from twilight.atmosphere.medium import Medium
from twilight.atmosphere.screen import EDGE_KM
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

    power (W,): of T; highest_km: of what screens.  wall (A, 3): azimuth from x [rad], increasing over more than a turn,
    height and distance [km] of a skyline by azimuth, above which altitude_km is counted; A = 0: there is none.
    """

    altitude_km: np.ndarray
    transmission: np.ndarray
    from_km: float
    to_km: float
    bent: bool
    power: np.ndarray
    highest_km: float
    wall: np.ndarray


def screen_in_space(medium: Medium, bent: bool) -> ScreenInSpace:
    """The screen of a medium."""
    screen, wall = medium.screen, np.zeros((0, 3))
    if screen is None:
        return ScreenInSpace(np.zeros(0), np.zeros(0), 0.0, 0.0, bent, np.zeros(0), 0.0, wall)
    z, passed = np.array(screen.altitude_km), np.array(screen.transmission)
    highest = float(z[-1])
    if screen.around:
        around = np.array(screen.around)
        around[:, 0] = np.radians(around[:, 0] % 360.0)
        around = around[np.argsort(around[:, 0])]
        whole_turn = np.array([2.0 * math.pi, 0.0, 0.0])
        wall = np.vstack([around[-1] - whole_turn, around, around[0] + whole_turn])
        highest = float(around[:, 1].max())
        z, passed = np.array([-EDGE_KM, 0.0]), np.array([0.0, 1.0])
    power = screen.powers(medium.wavelength_nm)
    return ScreenInSpace(z, passed, screen.from_km, min(screen.to_km, LONGEST_KM), bent, power, highest, wall)


@njit(inner=True, **INNER)
def wall_at(wall, x, y):
    """(height [km], distance [km]) of the skyline `wall` of `ScreenInSpace` in the azimuth of a point (x, y)."""
    azimuth = math.atan2(y, x)
    if azimuth < 0.0:
        azimuth += 2.0 * math.pi
    low, high = 0, wall.shape[0] - 1
    while high - low > 1:
        middle = (low + high) // 2
        if wall[middle, 0] <= azimuth:
            low = middle
        else:
            high = middle
    f = (azimuth - wall[low, 0]) / (wall[high, 0] - wall[low, 0])
    return (1.0 - f) * wall[low, 1] + f * wall[high, 1], (1.0 - f) * wall[low, 2] + f * wall[high, 2]


@njit(inner=True, **INNER)
def least_altitude(air, screen, w, x, y, z, dx, dy, dz):
    """Least altitude [km] over the screen's air of the ray from a point (x, y, z) [km] in a direction (dx, dy, dz).

    Of a skyline by azimuth: the least above it where it is crossed.
    """
    radius = air.earth_radius_km
    highest = screen.highest_km
    walled = screen.wall.shape[0] > 0
    least = NOT_MET
    travelled = 0.0
    r = math.sqrt(x * x + y * y + z * z)
    h0, d0 = r - radius, radius * math.atan2(math.sqrt(x * x + y * y), z)
    inside0 = wall_at(screen.wall, x, y)[1] - d0 if walled else 0.0
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
        x0, y0 = x, y
        x, y, z = x + step * dx, y + step * dy, z + step * dz
        r = math.sqrt(x * x + y * y + z * z)
        h1, d1 = r - radius, radius * math.atan2(math.sqrt(x * x + y * y), z)
        first, last = max(min(d0, d1), screen.from_km), min(max(d0, d1), screen.to_km)
        if walled:
            inside1 = wall_at(screen.wall, x, y)[1] - d1
            if (inside0 < 0.0) != (inside1 < 0.0):
                f = inside0 / (inside0 - inside1)
                height, _ = wall_at(screen.wall, x0 + f * (x - x0), y0 + f * (y - y0))
                least = min(least, h0 + f * (h1 - h0) - height)
            inside0 = inside1
        elif first <= last:
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
