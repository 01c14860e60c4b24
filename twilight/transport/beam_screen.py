"""The factor of a screen beyond the horizon on the sunbeam, by the ray that arrives (`twilight.atmosphere.screen`).

With x = n r and Bouguer's invariant p, u = x cos i grows along the ray towards the sun from its value at the point
through 0 at the tangent point, and x^2 = p^2 + u^2 at every u.  Along the path du = d(n r)/dr ds: 0.83 of the path at
the ground, 0.95 at 10 km, 1 where the air does not bend light; here u counts as the distance.  The lowest part of the
way between two distances a and b from the point is where |u| is least in u + a .. u + b,

    u_least = u + a if that is above 0, u + b if that is below 0, else 0;      x_least^2 = p^2 + u_least^2,

and T is tabulated by x, at 550 nm; at another wavelength it is a power of that.
"""

from __future__ import annotations

import math

import numpy as np

from twilight.atmosphere.screen import Screen
from twilight.jit.kernels import njit
from twilight.transport.ray_profile import RayProfile, refractive_radius

N_NODE, FROM_KM, TO_KM, AT_NODES = range(4)
"""Places in the table of a screen: number of nodes, distances, then x [km] of the nodes, T there, and the powers."""
FARTHEST_KM = 1e9
"""Stands for the end of the way [km]."""


def screen_table(screen: Screen | None, profile: RayProfile, w: int, wavelength_nm: np.ndarray) -> np.ndarray:
    """What `passing` reads, for the refractive index of wavelength w of a profile; no number where nothing screens.

    wavelength_nm (W,): of the light that is screened.
    """
    if screen is None:
        return np.zeros(0)
    z = screen.refined_km
    x = np.array([refractive_radius(profile, w, h) for h in z])
    # in a duct n r falls: the ray is then as high as the highest air of that n r
    x = np.maximum.accumulate(x)
    head = [float(z.size), screen.from_km, min(screen.to_km, FARTHEST_KM)]
    return np.concatenate([head, x, screen.at(z), screen.powers(wavelength_nm)])


@njit(inner=True, cache=True, inline=True)
def passing(pool, at, p, u):
    """T at 550 nm of the ray of invariant p [km] that arrives where n r cos i is u [km], negative past its lowest.

    pool: holds a table of `screen_table`, at: its place there.
    """
    near, far = u + pool[at + FROM_KM], u + pool[at + TO_KM]
    least = near if near > 0.0 else (far if far < 0.0 else 0.0)
    x = math.sqrt(p * p + least * least)
    n = int(pool[at + N_NODE])
    first = at + AT_NODES
    if x <= pool[first]:
        return pool[first + n]
    if x >= pool[first + n - 1]:
        return pool[first + 2 * n - 1]
    low, high = 0, n - 1
    while high - low > 1:
        middle = (low + high) // 2
        if pool[first + middle] <= x:
            low = middle
        else:
            high = middle
    f = (x - pool[first + low]) / (pool[first + high] - pool[first + low])
    return (1.0 - f) * pool[first + n + low] + f * pool[first + n + high]


@njit(inner=True, cache=True, inline=True)
def at_wavelength(pool, at, w, passed):
    """T at wavelength `w` from `passed`, what passes at 550 nm; pool, at: as of `passing`."""
    power = pool[at + AT_NODES + 2 * int(pool[at + N_NODE]) + w]
    return passed if power == 1.0 else math.pow(passed, power)


def passing_at(
    screen: Screen, profile: RayProfile, w: int, wavelength_nm: float, p_km: np.ndarray, u_km: np.ndarray
) -> np.ndarray:
    """T (...) of rays at wavelength w of a profile, in numpy alone; wavelength_nm: of that."""
    table = screen_table(screen, profile, w, np.array([wavelength_nm]))
    n = int(table[N_NODE])
    near, far = u_km + table[FROM_KM], u_km + table[TO_KM]
    least = np.where(near > 0.0, near, np.where(far < 0.0, far, 0.0))
    passed = np.interp(np.hypot(p_km, least), table[AT_NODES : AT_NODES + n], table[AT_NODES + n : -1])
    return passed ** table[-1]
