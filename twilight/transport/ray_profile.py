"""The air as rays of light meet it: layers with every coefficient in closed form, by the rules of the medium, and the
screen beyond the horizon.

The screen (`twilight.atmosphere.screen`) is a factor on the sunbeam, by the ray that arrives.  With x = n r and
Bouguer's invariant p, u = x cos i grows along the ray towards the sun from its value at the point through 0 at the
tangent point, and x^2 = p^2 + u^2 at every u.  Along the path du = d(n r)/dr ds: 0.83 of the path at the ground, 0.95
at 10 km, 1 where the air does not bend light; here u counts as the distance.  The lowest part of the way between two
distances a and b from the point is where |u| is least in u + a .. u + b,

    u_least = u + a if that is above 0, u + b if that is below 0, else 0;      x_least^2 = p^2 + u_least^2,

and T is tabulated by x, at 550 nm; at another wavelength it is a power of that.
"""

import math
from typing import NamedTuple

import numpy as np

from twilight.atmosphere.levels import log_cubics
from twilight.atmosphere.medium import Medium
from twilight.atmosphere.screen import Screen
from twilight.jit.kernels import njit

BOTTOM, LOG_SLOPE, SLOPE, SQUARE, CUBE = range(5)
"""Columns of a coefficient in a layer: a, q, d, s and c of a exp(q f + s f^2 + c f^3) + d f.

f is the fraction of the layer below the point; gases and aerosol have neither s nor c.
"""
INDEX, INDEX_TOP, AIR, GASES, AEROSOL, N_COLUMNS = 0, 5, 6, 11, 14, 17
"""Columns of `RayProfile.coefficient` where n - 1, its value at the top, and each part of the extinction begin."""

THIN_CHANGE = 0.3
"""Change of ln of a coefficient over a layer, below which the layer is thin: two nodes integrate it."""

_BELOW_GROUND_KM = 5.0
"""Thickness of a layer below the ground [km], for derivatives at the edge of the Earth's shadow alone."""


class RayProfile(NamedTuple):
    """Layers of a medium for the ray kernels: M layers of positive thickness, W wavelengths; layer 0 is underground.

    bottom_km, top_km (M,); panels (M,): quadrature panels of a layer; thin (M,): no coefficient changes by
    more than a factor 1.35; radius_km of the Earth.
    coefficient (W, M, N_COLUMNS): from INDEX on n - 1 (BOTTOM to CUBE) and at INDEX_TOP its value at the top; from AIR
    (BOTTOM to CUBE), GASES and AEROSOL (BOTTOM to SLOPE) on their extinctions [km^-1].
    """

    bottom_km: np.ndarray
    top_km: np.ndarray
    panels: np.ndarray
    thin: np.ndarray
    coefficient: np.ndarray
    radius_km: float


def ray_profile(medium: Medium, *, refraction: bool = True) -> RayProfile:
    """Layers of `medium` for the kernels; without `refraction` the index is 1 everywhere."""
    z = medium.altitude_km
    layer = np.flatnonzero(np.diff(z) > 0)
    bottom = np.concatenate([[z[0] - _BELOW_GROUND_KM], z[layer]])
    top = np.concatenate([[z[0]], z[layer + 1]])
    coefficient = np.zeros((medium.n_wavelengths, layer.size + 1, N_COLUMNS))
    steepest = np.zeros(layer.size + 1)
    tables = (
        medium.refractivity * (1.0 if refraction else 0.0),
        medium.air_scattering_per_km,
        medium.absorption_per_km,
        medium.aerosol_extinction_per_km,
    )
    for first, table in zip((INDEX, AIR, GASES, AEROSOL), tables, strict=True):
        lo = np.concatenate([table[:1], table[layer]]).T
        hi = np.concatenate([table[:1], table[layer + 1]]).T
        cubic = log_cubics(z, table)[:, layer].transpose(0, 2, 1) if first in (INDEX, AIR) else None
        if cubic is not None and first == INDEX:
            # below the ground the index goes on as it falls just above, within the bounds of calm air
            fall = np.clip(-cubic[0, :, 0] / (top[1] - bottom[1]), 0.05, 0.2)
            lo[:, 0] = table[0] * np.exp(_BELOW_GROUND_KM * fall)
        exponential = (lo > 0) & (hi > 0)
        q = np.log(np.where(exponential, hi, 1.0) / np.where(exponential, lo, 1.0))
        coefficient[:, :, first + BOTTOM] = lo
        coefficient[:, :, first + LOG_SLOPE] = q
        coefficient[:, :, first + SLOPE] = np.where(exponential, 0.0, hi - lo)
        if cubic is not None:
            coefficient[:, 1:, first + LOG_SLOPE] = cubic[0]
            coefficient[:, 1:, first + SQUARE] = cubic[1]
            coefficient[:, 1:, first + CUBE] = cubic[2]
        if first == INDEX:
            coefficient[:, :, INDEX_TOP] = hi
        # what cannot reach an optical depth of 1e-6 even along a horizontal path needs no finer panels
        matters = np.maximum(lo, hi) * 1000.0 > 1e-6
        steepest = np.maximum(steepest, np.where(matters, np.abs(q), 0.0).max(axis=0))
    panels = np.clip(np.ceil(np.maximum(steepest / 2.0, (top - bottom) / 10.0)), 1, 64).astype(np.int64)
    return RayProfile(
        np.ascontiguousarray(bottom),
        np.ascontiguousarray(top),
        panels,
        (steepest < THIN_CHANGE) & (panels == 1),
        coefficient,
        float(medium.earth_radius_km),
    )


@njit(inner=True, cache=True, makes_arrays=False)
def layer_above(profile, altitude_km):
    """Index of the layer that a ray going up from `altitude_km` enters; M above the top, 0 underground.

    profile: `RayProfile`.
    """
    lo = 0
    hi = profile.top_km.size
    while lo < hi:
        mid = (lo + hi) // 2
        if profile.top_km[mid] > altitude_km:
            hi = mid
        else:
            lo = mid + 1
    return lo


@njit(inner=True, cache=True, inline=True, makes_arrays=False)
def index_in(c, f):
    """n - 1 in a layer and its change dn/df.

    c (N_COLUMNS,): the layer's row of `RayProfile.coefficient`; f: fraction of the layer below the point.
    """
    q, s, t = c[INDEX + LOG_SLOPE], c[INDEX + SQUARE], c[INDEX + CUBE]
    exponential = c[INDEX + BOTTOM] * math.exp(f * (q + f * (s + f * t)))
    change = exponential * (q + f * (2.0 * s + 3.0 * f * t)) + c[INDEX + SLOPE]
    return exponential + c[INDEX + SLOPE] * f, change


@njit(inner=True, cache=True, inline=True, makes_arrays=False)
def extinction_in(c, f):
    """Extinction [km^-1] in a layer; c, f: as of `index_in`."""
    extinction = c[AIR + SLOPE] * f
    if c[AIR + BOTTOM] > 0.0:
        q, s, t = c[AIR + LOG_SLOPE], c[AIR + SQUARE], c[AIR + CUBE]
        extinction += c[AIR + BOTTOM] * math.exp(f * (q + f * (s + f * t)))
    for part in (GASES, AEROSOL):
        if c[part + BOTTOM] > 0.0:
            extinction += c[part + BOTTOM] * math.exp(c[part + LOG_SLOPE] * f)
        extinction += c[part + SLOPE] * f
    return extinction


@njit(cache=True, makes_arrays=False)
def refractivity_at(profile, w, altitude_km):
    """n - 1 at an altitude (on a jump: above it), 0 above the top; below the ground the lowest layer goes on.

    profile: `RayProfile`; w: index of the wavelength; `altitude_km`: where.
    """
    i = layer_above(profile, altitude_km)
    if i == profile.top_km.size:
        return 0.0
    bottom = profile.bottom_km[i]
    return index_in(profile.coefficient[w, i], (altitude_km - bottom) / (profile.top_km[i] - bottom))[0]


@njit(cache=True, makes_arrays=False)
def refractive_radius(profile, w, altitude_km):
    """n r [km] at an altitude; arguments as of `refractivity_at`: profile, w, `altitude_km`."""
    return (profile.radius_km + altitude_km) * (1.0 + refractivity_at(profile, w, altitude_km))


@njit(inner=True, cache=True, makes_arrays=False)
def index_at(profile, w, i, altitude_km):
    """n - 1 at an altitude in a layer, at its top the value that the medium has there.

    profile: `RayProfile`; w: index of the wavelength; i: of the layer; `altitude_km`: in it.
    """
    c = profile.coefficient[w, i]
    if altitude_km == profile.top_km[i]:
        return c[INDEX_TOP]
    return index_in(c, (altitude_km - profile.bottom_km[i]) / (profile.top_km[i] - profile.bottom_km[i]))[0]


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


@njit(inner=True, cache=True, inline=True, makes_arrays=False)
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
