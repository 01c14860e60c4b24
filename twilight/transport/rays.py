"""Kernels for one ray of light through spherical air whose refractive index changes with altitude.

A ray keeps Bouguer's invariant p = n r sin i.  With x = n r the kernels carry u = x cos i, so that u^2 = x^2 - p^2, and

    bending  = integral of (-dn/dr)/n * p/u dr      (true zenith angle of the sun = apparent one + bending)
    length   = integral of x/u dr
    tau      = integral of extinction * x/u dr

from a point outwards to the top.  u vanishes at the lowest point of a ray like a square root; with r - r_s = v^2, r_s
the linear estimate of that zero seen from the start of each layer, every integrand is smooth and a few Gauss-Legendre
nodes per layer are enough.  With n = 1 the bending is exactly 0.

`ApparentRays` follows lines of sight backwards to space: where refraction shows what is beyond the air, and how dimmed.

Differences of x are formed from differences of altitude and of n - 1, never by subtracting two numbers near 6371.
Where n r does not grow with r (a duct) u^2 can become negative: such a ray cannot leave the air and is ``TRAPPED``.

Arguments that the kernels share: profile: `RayProfile`; w: index of the wavelength; altitude_km: where the ray starts;
u_km: n r cos i there; path: `RayPath`, what the ray has collected; below_ground: go on in the layer under the ground.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from twilight.jit.kernels import njit
from twilight.transport.ray_profile import (
    BOTTOM,
    INDEX,
    INDEX_TOP,
    extinction_in,
    index_at,
    index_in,
    layer_above,
    ray_profile,
    refractive_radius,
    refractivity_at,
)

if TYPE_CHECKING:
    from twilight.atmosphere.medium import Medium

OUTSIDE = 0
"""The ray comes from the open sky."""
GROUND = 1
"""The ray meets the ground."""
TRAPPED = 2
"""The ray cannot leave a duct."""

_NODE, _WEIGHT = np.polynomial.legendre.leggauss(4)
_FEW, _FEW_WEIGHT = np.polynomial.legendre.leggauss(2)
_GAUSS_NODE = 0.5 * (np.concatenate([_NODE, _FEW]) + 1.0)
"""Nodes on the unit interval: four, then two for thin layers far from the lowest point of the ray."""
_GAUSS_WEIGHT = 0.5 * np.concatenate([_WEIGHT, _FEW_WEIGHT])
"""Weights of _GAUSS_NODE."""

FAR_KM = 1e9
"""A `stop_km` in the vacuum beyond all air."""

_SLIVER_KM = 1e-12
"""Part of a layer that is stepped over: over less, rounding decides whether n r grows."""


class RayPath(NamedTuple):
    """What a ray collects on its way.

    bending_rad: by which it turned towards the Earth; optical_depth; length_km; u_km: n r cos i at its end
    free: it got there; a ray caught in a duct did not, and the rest is what it collected until then, u_km 0
    """

    bending_rad: float
    optical_depth: float
    length_km: float
    u_km: float
    free: bool


@njit(inner=True, cache=True, makes_arrays=False)
def _positive(slope):
    """d(n r)/dr for the estimate of a zero: `slope`, or in a duct, where it is not positive, 1 as without air."""
    return 1.0 if slope < 0.05 else slope


@njit(inner=True, cache=True, makes_arrays=False)
def _snell(p, x, uu, x_beyond, uu_beyond):
    """Bending [rad] at a jump of the index, i' - i, for a ray of invariant p [km].

    x [km], uu [km^2]: n r and u^2 on this side; x_beyond, uu_beyond: on the other.
    sin(i - i') = p (u' - u)/(x x'), with u' - u = (u'^2 - u^2)/(u' + u)
    """
    sine = p * (uu_beyond - uu) / ((math.sqrt(uu_beyond) + math.sqrt(uu)) * x * x_beyond)
    return -math.asin(max(-1.0, min(1.0, sine)))


@njit(inner=True, cache=True, inline=True, makes_arrays=False)
def _through_layer(profile, w, i, z, end, n, x, uu, p, path):
    """`path` with what a ray collects in layer i; its u_km is left as it was.

    z, end [km]: altitudes between which the ray is in the layer; n, x [km], uu [km^2]: n - 1, n r and u^2 at z; p [km].

    With v from r - r_s = v^2, r_s = r - h the zero of u^2 as seen from z, h = u^2 / (2 x dx/dr), the ray goes from
    v = sqrt(h) to sqrt(h + end - z), and dr/u = 2 v dv/u.
    """
    bending, tau, length, u_km, _ = path
    c = profile.coefficient[w, i]
    bottom = profile.bottom_km[i]
    thickness = profile.top_km[i] - bottom
    r = profile.radius_km + z
    _, change = index_in(c, (z - bottom) / thickness)
    h = uu / (2.0 * x * _positive(1.0 + n + r * change / thickness))
    v_start = math.sqrt(h)
    v_end = math.sqrt(h + (end - z))
    panels = profile.panels[i]
    dv = (v_end - v_start) / panels
    few = profile.thin[i] and dv < 0.12 * v_end
    first_node, end_node = (4, 6) if few else (0, 4)
    for k in range(panels):
        for g in range(first_node, end_node):
            v = v_start + (k + _GAUSS_NODE[g]) * dv
            dz = v * v - h
            f = (z + dz - bottom) / thickness
            n_here, change = index_in(c, f)
            dx = dz * (1.0 + n_here) + (n_here - n) * r
            uu_here = uu + dx * (2.0 * x + dx)
            if uu_here <= 0.0:
                return RayPath(bending, tau, length, 0.0, False)
            step = 2.0 * v * dv * _GAUSS_WEIGHT[g] / math.sqrt(uu_here)  # dr/u
            bending -= change / thickness / (1.0 + n_here) * p * step
            step *= x + dx
            length += step
            tau += extinction_in(c, f) * step
    return RayPath(bending, tau, length, u_km, True)


@njit(inner=True, cache=True, makes_arrays=False)
def _in_vacuum(profile, altitude_km, uu, stop_km):
    """u [km] at `stop_km` of a ray that goes straight there from `altitude_km`, where u^2 is `uu` [km^2]."""
    rise = stop_km - altitude_km
    return math.sqrt(max(0.0, uu + rise * (2.0 * (profile.radius_km + altitude_km) + rise)))


@njit(inner=True, cache=True, makes_arrays=False)
def outward(profile, w, altitude_km, u_km, stop_km):
    """Follow a ray up from `altitude_km`, where u = n r cos(zenith angle) >= 0, to `stop_km` or to the vacuum.

    profile: RayProfile; w: index of the wavelength; altitude_km, stop_km (FAR_KM: all the way) [km]; u_km [km].
    Returns a `RayPath`.  A stop at or above the top includes the refraction at the top.

    From z to z + dz in a layer x = n r grows by dx = dz (1 + n') + (n' - n) r (n for n - 1 here), and u^2 by
    dx (2 x + dx); at a jump of the index x grows by r (n' - n).
    """
    n_layers = profile.top_km.size
    first = layer_above(profile, altitude_km)
    if first == n_layers:
        u_end = _in_vacuum(profile, altitude_km, u_km * u_km, stop_km)
        return RayPath(0.0, 0.0, u_end - u_km, u_end, True)
    path = RayPath(0.0, 0.0, 0.0, 0.0, True)
    z = altitude_km
    uu = u_km * u_km
    n = refractivity_at(profile, w, z)
    x = (profile.radius_km + z) * (1.0 + n)
    p = math.sqrt(max(0.0, x * x - uu))
    for i in range(first, n_layers):
        end = min(profile.top_km[i], stop_km)
        if end <= z:
            break
        r = profile.radius_km + z
        n_here = profile.coefficient[w, i, INDEX + BOTTOM] if i > first else n
        if n_here != n:
            x_here = r * (1.0 + n_here)
            uu_here = uu + r * (n_here - n) * (x_here + x)
            if uu_here <= 0.0:
                return _trapped(path)
            path = _turned(path, _snell(p, x, uu, x_here, uu_here))
            uu, x, n = uu_here, x_here, n_here
        sliver = end - z < _SLIVER_KM  # a lowest point within rounding of a level: n r cannot be told apart here
        if sliver:
            n_end = profile.coefficient[w, i, INDEX_TOP] if end == profile.top_km[i] else n
        else:
            path = _through_layer(profile, w, i, z, end, n, x, uu, p, path)
            if not path.free:
                return path
            n_end = index_at(profile, w, i, end)
        dx = (end - z) * (1.0 + n_end) + (n_end - n) * r
        uu += dx * (2.0 * x + dx)
        if uu <= 0.0:
            if not sliver:
                return _trapped(path)
            uu = 0.0
        x, n, z = x + dx, n_end, end
    top = profile.top_km[n_layers - 1]
    if stop_km >= top and n != 0.0:
        r = profile.radius_km + top
        uu_here = uu - r * n * (r + x)
        if uu_here <= 0.0:
            return _trapped(path)
        path = _turned(path, _snell(p, x, uu, r, uu_here))
        uu = uu_here
    u = math.sqrt(uu)
    length = path.length_km
    if stop_km > top and stop_km < FAR_KM:
        u_end = _in_vacuum(profile, top, uu, stop_km)
        length += u_end - u
        u = u_end
    return RayPath(path.bending_rad, path.optical_depth, length, u, True)


@njit(inner=True, cache=True, makes_arrays=False)
def _turned(path, angle_rad):
    """The path with `angle_rad` more of bending."""
    return RayPath(path.bending_rad + angle_rad, path.optical_depth, path.length_km, path.u_km, path.free)


@njit(inner=True, cache=True, makes_arrays=False)
def _trapped(path):
    """The path of a ray that ends in a duct."""
    return RayPath(path.bending_rad, path.optical_depth, path.length_km, 0.0, False)


@njit(inner=True, cache=True, makes_arrays=False)
def _altitude_in_layer(profile, w, i, z, n_here, missing, way):
    """Altitude [km] in a layer up to which n r changes by `missing` [km] on the way from z, by Newton's method.

    i: index of the layer; z [km]: an altitude in it; n_here: n - 1 there; way: 1 upwards, -1 downwards.
    """
    c = profile.coefficient[w, i]
    bottom = profile.bottom_km[i]
    thickness = profile.top_km[i] - bottom
    r = profile.radius_km + z
    low, high = (z, profile.top_km[i]) if way > 0.0 else (bottom, z)
    y = z if way > 0.0 else max(bottom, z - missing)
    for _ in range(40):
        n, change = index_in(c, (y - bottom) / thickness)
        residual = way * ((y - z) * (1.0 + n) + (n - n_here) * r) - missing
        slope = _positive(1.0 + n + (profile.radius_km + y) * change / thickness)
        before, y = y, min(high, max(low, y - way * residual / slope))
        if abs(y - before) < 1e-13:
            break
    return y


@njit(cache=True, makes_arrays=False)
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
        bottom = profile.bottom_km[i]
        r = profile.radius_km + z
        n_here = index_at(profile, w, i, z)
        missing -= r * (n_a - n_here)
        if missing <= 0.0:
            return z, OUTSIDE
        n_bottom = profile.coefficient[w, i, INDEX + BOTTOM]
        fall = (z - bottom) * (1.0 + n_bottom) + (n_here - n_bottom) * r
        if missing <= fall or i == 0:
            return _altitude_in_layer(profile, w, i, z, n_here, missing, -1.0), OUTSIDE
        missing -= fall
        n_a = n_bottom
        z = bottom
        i -= 1
    return z, GROUND


@njit(inner=True, cache=True, makes_arrays=False)
def altitude_along(profile, w, altitude_km, u_km):
    """Altitude [km] of a ray from its lowest point at `altitude_km` where u = n r cos i has grown to `u_km`."""
    n_layers = profile.top_km.size
    r = profile.radius_km + altitude_km
    n_a = refractivity_at(profile, w, altitude_km)
    p = r * (1.0 + n_a)
    missing = u_km * u_km / (p + math.sqrt(p * p + u_km * u_km))
    z = altitude_km
    for i in range(layer_above(profile, z), n_layers):
        n_top = profile.coefficient[w, i, INDEX_TOP]
        r = profile.radius_km + z
        n_here = index_at(profile, w, i, z)
        missing -= r * (n_here - n_a)
        if missing <= 0.0:
            return z
        rise = (profile.top_km[i] - z) * (1.0 + n_top) + (n_top - n_here) * r
        if missing < rise:
            return _altitude_in_layer(profile, w, i, z, n_here, missing, 1.0)
        missing -= rise
        n_a = n_top
        z = profile.top_km[i]
    missing += (profile.radius_km + z) * n_a
    return z + max(0.0, missing)


@njit(cache=True, makes_arrays=False)
def sun_ray(profile, w, altitude_km, u_km, below_ground):
    """Bending [rad] and optical depth of the ray that arrives at `altitude_km` from the apparent direction with
    n r cos i = `u_km` (negative: from below the horizontal), and its status OUTSIDE, GROUND or TRAPPED."""
    if u_km >= 0.0:
        bending, tau, _, _, ok = outward(profile, w, altitude_km, u_km, FAR_KM)
        return bending, tau, (OUTSIDE if ok else TRAPPED)
    lowest, status = lowest_point(profile, w, altitude_km, -u_km, below_ground)
    if status != OUTSIDE:
        return 0.0, 0.0, status
    bending, tau, _, _, ok = outward(profile, w, lowest, 0.0, FAR_KM)
    near, near_tau, _, _, near_ok = outward(profile, w, lowest, 0.0, altitude_km)
    return bending + near, tau + near_tau, (OUTSIDE if ok and near_ok else TRAPPED)


NO_LIGHT = -1.0
"""Transmittance that marks a line of sight which does not leave the air."""


@njit(cache=True, makes_arrays=False)
def _follow(profile, w, altitude_km, elevation_rad, bending, transmittance):
    """Fill bending (H,) [rad] and transmittance (H,), or NO_LIGHT, at one wavelength.

    profile: `RayProfile`; w: index of the wavelength; altitude_km: of the observer; elevation_rad (H,): apparent.
    """
    n = refractivity_at(profile, w, altitude_km)
    x = (profile.radius_km + altitude_km) * (1.0 + n)
    for i in range(elevation_rad.size):
        angle, tau, status = sun_ray(profile, w, altitude_km, x * math.sin(elevation_rad[i]), np.bool_(False))
        bending[i] = angle
        transmittance[i] = (1.0 + n) ** 2 * math.exp(-tau) if status == OUTSIDE else NO_LIGHT


class ApparentRays:
    """Rays of a medium by the apparent elevation under which an observer sees them."""

    def __init__(self, medium: Medium):
        self.medium = medium
        self._profile = ray_profile(medium)

    def follow(
        self, altitude_km: float, elevation_deg: np.ndarray, wavelengths: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """True elevation [deg] and transmittance (H, len(wavelengths)) of apparent elevations (H,) [deg].

        altitude_km: of the observer; wavelengths: indices of wavelengths of the medium.  The transmittance contains the
        square of the observer's refractive index (a path conserves radiance over n^2), and is 0 where a line of sight
        meets the ground or stays in a duct; its true elevation is then that without air.
        """
        z = max(altitude_km, self.medium.bottom_km)
        shape = (elevation_deg.size, len(wavelengths))
        true, passed = np.empty(shape), np.empty(shape)
        angle, transmittance = np.empty(elevation_deg.size), np.empty(elevation_deg.size)
        for k, w in enumerate(wavelengths):
            _follow(self._profile, int(w), z, np.radians(elevation_deg), angle, transmittance)
            free = transmittance >= 0.0
            true[:, k] = elevation_deg - np.where(free, np.degrees(angle), 0.0)
            passed[:, k] = np.where(free, transmittance, 0.0)
        return true, passed


def horizon_dip_deg(medium: Medium, altitude_km: float, level_km: float | None = None) -> float:
    """How far below the horizontal the refracted ray leaves that touches the ground [deg], in the middle wavelength.

    level_km: the altitude that the ray touches; None: the ground's.  Bouguer's invariant n r cos(elevation) is the same
    there and at the observer.
    """
    bottom, z = medium.bottom_km, max(altitude_km, medium.bottom_km)
    w = medium.n_wavelengths // 2
    profile = ray_profile(medium)
    touching = refractive_radius(profile, w, bottom if level_km is None else level_km)
    at_observer = refractive_radius(profile, w, z)
    return float(np.degrees(np.arccos(min(1.0, touching / at_observer))))
