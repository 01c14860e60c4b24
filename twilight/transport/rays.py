"""Kernels for one ray of light through spherical air whose refractive index changes with altitude.

A ray keeps Bouguer's invariant p = n r sin i.  With x = n r the kernels carry u = x cos i, so that u^2 = x^2 - p^2, and

    bending  = integral of (-dn/dr)/n * p/u dr      (true zenith angle of the sun = apparent one + bending)
    length   = integral of x/u dr
    tau      = integral of extinction * x/u dr

from a point outwards to the top.  u vanishes at the lowest point of a ray like a square root; with r - r_s = v^2, r_s
the linear estimate of that zero seen from the start of each layer, every integrand is smooth and a few Gauss-Legendre
nodes per layer are enough.  With n = 1 the bending is exactly 0.

Differences of x are formed from differences of altitude and of n - 1, never by subtracting two numbers near 6371.
Where n r does not grow with r (a duct) u^2 can become negative: such a ray cannot leave the air and is ``TRAPPED``.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit

from twilight.atmosphere.medium import Medium

OUTSIDE = 0
"""The ray comes from the open sky."""
GROUND = 1
"""The ray meets the ground."""
TRAPPED = 2
"""The ray cannot leave a duct."""

_NODE, _WEIGHT = np.polynomial.legendre.leggauss(4)
_FEW, _FEW_WEIGHT = np.polynomial.legendre.leggauss(2)
# four nodes on the unit interval, then two for thin layers far from the lowest point of the ray
_GAUSS_NODE = 0.5 * (np.concatenate([_NODE, _FEW]) + 1.0)
_GAUSS_WEIGHT = 0.5 * np.concatenate([_WEIGHT, _FEW_WEIGHT])

# columns of RayProfile.coefficient: value a at the bottom, logarithmic slope q and linear slope d of a exp(q f) + d f
_N_TOP, _PARTS = 3, 4

_SLIVER_KM = 1e-12
"""Part of a layer that is stepped over: over less, rounding decides whether n r grows."""
_BELOW_GROUND_KM = 5.0
"""Thickness of a layer below the ground, which only derivatives at the edge of the Earth's shadow look into."""


class RayProfile(NamedTuple):
    """Layers of a medium for the ray kernels: M layers of positive thickness, W wavelengths; layer 0 is underground.

    bottom_km, top_km (M,); panels (M,): quadrature panels of a layer; thin (M,): no coefficient changes by
    more than a factor 1.35; coefficient (W, M, 13); radius_km of the Earth.
    Columns: n-1 (value, log slope, linear slope, value at the top), then three columns for each of air, gases, aerosol.
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
    coefficient = np.zeros((medium.n_wavelengths, layer.size + 1, 13))
    steepest = np.zeros(layer.size + 1)
    tables = (
        medium.refractivity * (1.0 if refraction else 0.0),
        medium.air_scattering_per_km,
        medium.absorption_per_km,
        medium.aerosol_extinction_per_km,
    )
    for k, table in enumerate(tables):
        lo = np.concatenate([table[:1], table[layer]]).T
        hi = np.concatenate([table[:1], table[layer + 1]]).T
        if k == 0:  # below the ground the index goes on as it falls over the lowest 2 km, within the bounds of calm air
            n0, n2 = table[0], np.array([np.interp(z[0] + 2.0, z, column) for column in table.T])
            fall = np.log(np.where(n2 > 0, n0, 1.0) / np.where(n2 > 0, n2, 1.0)) / 2.0
            lo[:, 0] = n0 * np.exp(_BELOW_GROUND_KM * np.clip(fall, 0.05, 0.2))
        exponential = (lo > 0) & (hi > 0)
        q = np.log(np.where(exponential, hi, 1.0) / np.where(exponential, lo, 1.0))
        column = 0 if k == 0 else _PARTS + 3 * (k - 1)
        coefficient[:, :, column] = lo
        coefficient[:, :, column + 1] = q
        coefficient[:, :, column + 2] = np.where(exponential, 0.0, hi - lo)
        if k == 0:
            coefficient[:, :, _N_TOP] = hi
        # what cannot reach an optical depth of 1e-6 even along a horizontal path needs no finer panels
        matters = np.maximum(lo, hi) * 1000.0 > 1e-6
        steepest = np.maximum(steepest, np.where(matters, np.abs(q), 0.0).max(axis=0))
    panels = np.clip(np.ceil(np.maximum(steepest / 2.0, (top - bottom) / 10.0)), 1, 64).astype(np.int64)
    return RayProfile(
        np.ascontiguousarray(bottom),
        np.ascontiguousarray(top),
        panels,
        (steepest < 0.3) & (panels == 1),
        coefficient,
        float(medium.earth_radius_km),
    )


@njit(cache=True)
def layer_above(profile, altitude_km):
    """Index of the layer that a ray going up from `altitude_km` enters; M above the top, 0 underground."""
    lo = 0
    hi = profile.top_km.size
    while lo < hi:
        mid = (lo + hi) // 2
        if profile.top_km[mid] > altitude_km:
            hi = mid
        else:
            lo = mid + 1
    return lo


@njit(cache=True)
def refractivity_at(profile, w, altitude_km):
    """n - 1 at an altitude (on a jump: above it), 0 above the top; below the ground the lowest layer goes on."""
    i = layer_above(profile, altitude_km)
    if i == profile.top_km.size:
        return 0.0
    c = profile.coefficient[w, i]
    f = (altitude_km - profile.bottom_km[i]) / (profile.top_km[i] - profile.bottom_km[i])
    return c[0] * math.exp(c[1] * f) + c[2] * f


@njit(cache=True)
def outward(profile, w, altitude_km, u_km, stop_km):
    """Follow a ray up from `altitude_km`, where u = n r cos(zenith angle) >= 0, to `stop_km` or to the vacuum.

    Returns (bending [rad], optical depth, length [km], u at the end, ok); not ok: the ray is trapped.
    At or above the top the refraction at the top is included.
    """
    n_layers = profile.top_km.size
    first = layer_above(profile, altitude_km)
    bending = 0.0
    tau = 0.0
    length = 0.0
    if first == n_layers:
        r = profile.radius_km + altitude_km
        dz = stop_km - altitude_km
        u_end = math.sqrt(max(0.0, u_km * u_km + dz * (2.0 * r + dz)))
        return bending, tau, u_end - u_km, u_end, True
    z = altitude_km
    uu = u_km * u_km
    c = profile.coefficient[w, first]
    f = (z - profile.bottom_km[first]) / (profile.top_km[first] - profile.bottom_km[first])
    n_a = c[0] * math.exp(c[1] * f) + c[2] * f
    x = (profile.radius_km + z) * (1.0 + n_a)
    p = math.sqrt(max(0.0, x * x - uu))
    for i in range(first, n_layers):
        bottom = profile.bottom_km[i]
        thickness = profile.top_km[i] - bottom
        end = min(profile.top_km[i], stop_km)
        if end <= z:
            break
        c = profile.coefficient[w, i]
        f = (z - bottom) / thickness
        e = c[0] * math.exp(c[1] * f)
        n_here = e + c[2] * f
        r = profile.radius_km + z
        if i > first:
            if n_here != n_a:  # a jump of the index: Snell's law
                x_here = r * (1.0 + n_here)
                step = r * (n_here - n_a)
                uu_here = uu + step * (x_here + x)
                if uu_here <= 0.0:
                    return bending, tau, length, 0.0, False
                bending -= math.asin(
                    max(-1.0, min(1.0, p * (uu_here - uu) / ((math.sqrt(uu_here) + math.sqrt(uu)) * x * x_here)))
                )
                uu = uu_here
                x = x_here
            n_a = n_here
        slope = 1.0 + n_a + r * (e * c[1] + c[2]) / thickness
        if slope < 0.05:
            slope = 1.0
        if end - z < _SLIVER_KM:  # a lowest point within rounding of a level: n r cannot be told apart here
            n = c[_N_TOP] if end == profile.top_km[i] else n_a
            dx = (end - z) * (1.0 + n) + (n - n_a) * r
            uu = max(0.0, uu + dx * (2.0 * x + dx))
            x += dx
            n_a = n
            z = end
            continue
        h = uu / (2.0 * x * slope)
        v_a = math.sqrt(h)
        v_b = math.sqrt(h + (end - z))
        m = profile.panels[i]
        dv = (v_b - v_a) / m
        first_node = 0
        end_node = 4
        if profile.thin[i] and dv < 0.12 * v_b:
            first_node = 4
            end_node = 6
        for k in range(m):
            for g in range(first_node, end_node):
                v = v_a + (k + _GAUSS_NODE[g]) * dv
                dz = v * v - h
                f = (z + dz - bottom) / thickness
                e = c[0] * math.exp(c[1] * f)
                n = e + c[2] * f
                dx = dz * (1.0 + n) + (n - n_a) * r
                uu_here = uu + dx * (2.0 * x + dx)
                if uu_here <= 0.0:
                    return bending, tau, length, 0.0, False
                step = 2.0 * v * dv * _GAUSS_WEIGHT[g] / math.sqrt(uu_here)
                bending -= (e * c[1] + c[2]) / thickness / (1.0 + n) * p * step
                step *= x + dx
                length += step
                extinction = 0.0
                for part in range(4, 13, 3):
                    if c[part] > 0.0:
                        extinction += c[part] * math.exp(c[part + 1] * f)
                    extinction += c[part + 2] * f
                tau += extinction * step
        f = (end - bottom) / thickness
        n = c[_N_TOP] if end == profile.top_km[i] else c[0] * math.exp(c[1] * f) + c[2] * f
        dx = (end - z) * (1.0 + n) + (n - n_a) * r
        uu = uu + dx * (2.0 * x + dx)
        if uu <= 0.0:
            return bending, tau, length, 0.0, False
        x += dx
        n_a = n
        z = end
    top = profile.top_km[n_layers - 1]
    if stop_km >= top:
        if n_a != 0.0:
            r = profile.radius_km + top
            uu_here = uu - r * n_a * (r + x)
            if uu_here <= 0.0:
                return bending, tau, length, 0.0, False
            bending += math.asin(
                max(-1.0, min(1.0, p * (uu - uu_here) / ((math.sqrt(uu_here) + math.sqrt(uu)) * x * r)))
            )
            uu = uu_here
        if stop_km > top and stop_km < 1e9:
            r = profile.radius_km + top
            dz = stop_km - top
            before = math.sqrt(uu)
            uu += dz * (2.0 * r + dz)
            length += math.sqrt(uu) - before
    return bending, tau, length, math.sqrt(uu), True


@njit(cache=True)
def lowest_point(profile, w, altitude_km, u_km, below_ground):
    """Altitude [km] of the lowest point of a ray that goes down from `altitude_km` with |u| = `u_km`, and GROUND or
    OUTSIDE; with `below_ground` the layer below the ground is entered too, and its bottom is the lowest answer."""
    n_layers = profile.top_km.size
    uu = u_km * u_km
    r = profile.radius_km + altitude_km
    n_a = refractivity_at(profile, w, altitude_km)
    x = r * (1.0 + n_a)
    p = math.sqrt(max(0.0, x * x - uu))
    missing = uu / (x + p)  # x must still fall by this much
    z = altitude_km
    top = profile.top_km[n_layers - 1]
    if z >= top:
        fall = z - top
        if missing <= fall:
            return z - missing, OUTSIDE
        missing -= fall
        z = top
        n_a = 0.0
        i = n_layers - 1
    else:
        i = layer_above(profile, z)
        if z <= profile.bottom_km[i] and i > 0:
            i -= 1
    last = 0 if below_ground else 1
    while i >= last:
        c = profile.coefficient[w, i]
        bottom = profile.bottom_km[i]
        thickness = profile.top_km[i] - bottom
        r = profile.radius_km + z
        f = (z - bottom) / thickness
        n_here = c[_N_TOP] if z == profile.top_km[i] else c[0] * math.exp(c[1] * f) + c[2] * f
        missing -= r * (n_a - n_here)
        if missing <= 0.0:
            return z, OUTSIDE
        n_bottom = c[0]
        fall = (z - bottom) * (1.0 + n_bottom) + (n_here - n_bottom) * r
        if missing <= fall or i == 0:
            # Newton for x(z) - x(y) = missing inside the layer
            y = max(bottom, z - missing)
            for _ in range(40):
                f = (y - bottom) / thickness
                e = c[0] * math.exp(c[1] * f)
                n = e + c[2] * f
                residual = (z - y) * (1.0 + n) + (n_here - n) * r - missing
                slope = 1.0 + n + (profile.radius_km + y) * (e * c[1] + c[2]) / thickness
                if slope < 0.05:
                    slope = 1.0
                y_new = y + residual / slope
                y_new = min(z, max(bottom, y_new))
                if abs(y_new - y) < 1e-13:
                    y = y_new
                    break
                y = y_new
            return y, OUTSIDE
        missing -= fall
        n_a = n_bottom
        z = bottom
        i -= 1
    return z, GROUND


@njit(cache=True)
def altitude_along(profile, w, altitude_km, u_km):
    """Altitude [km] of a ray from its lowest point at `altitude_km` where u = n r cos i has grown to `u_km`."""
    n_layers = profile.top_km.size
    r = profile.radius_km + altitude_km
    n_a = refractivity_at(profile, w, altitude_km)
    p = r * (1.0 + n_a)
    missing = u_km * u_km / (p + math.sqrt(p * p + u_km * u_km))
    z = altitude_km
    for i in range(layer_above(profile, z), n_layers):
        c = profile.coefficient[w, i]
        bottom = profile.bottom_km[i]
        thickness = profile.top_km[i] - bottom
        r = profile.radius_km + z
        f = (z - bottom) / thickness
        n_here = c[0] * math.exp(c[1] * f) + c[2] * f
        missing -= r * (n_here - n_a)
        if missing <= 0.0:
            return z
        rise = (profile.top_km[i] - z) * (1.0 + c[_N_TOP]) + (c[_N_TOP] - n_here) * r
        if missing < rise:
            y = z
            for _ in range(40):
                f = (y - bottom) / thickness
                e = c[0] * math.exp(c[1] * f)
                n = e + c[2] * f
                residual = (y - z) * (1.0 + n) + (n - n_here) * r - missing
                slope = 1.0 + n + (profile.radius_km + y) * (e * c[1] + c[2]) / thickness
                if slope < 0.05:
                    slope = 1.0
                y_new = min(profile.top_km[i], max(z, y - residual / slope))
                if abs(y_new - y) < 1e-13:
                    y = y_new
                    break
                y = y_new
            return y
        missing -= rise
        n_a = c[_N_TOP]
        z = profile.top_km[i]
    missing += (profile.radius_km + z) * n_a
    return z + max(0.0, missing)


@njit(cache=True)
def sun_ray(profile, w, altitude_km, u_km, below_ground):
    """Bending [rad] and optical depth of the ray that arrives at `altitude_km` from the apparent direction with
    n r cos i = `u_km` (negative: from below the horizontal), and its status OUTSIDE, GROUND or TRAPPED."""
    if u_km >= 0.0:
        bending, tau, _, _, ok = outward(profile, w, altitude_km, u_km, 1e9)
        return bending, tau, (OUTSIDE if ok else TRAPPED)
    lowest, status = lowest_point(profile, w, altitude_km, -u_km, below_ground)
    if status != OUTSIDE:
        return 0.0, 0.0, status
    bending, tau, _, _, ok = outward(profile, w, lowest, 0.0, 1e9)
    near, near_tau, _, _, near_ok = outward(profile, w, lowest, 0.0, altitude_km)
    return bending + near, tau + near_tau, (OUTSIDE if ok and near_ok else TRAPPED)
