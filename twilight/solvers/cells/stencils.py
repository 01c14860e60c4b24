"""Rays from every node in every direction, kept as weights on other nodes: made once, used by every pass and every sun.

A ray leaves a node of azimuth 0; the same ray of the same node at another azimuth meets the same air, turned about the
observer's vertical.  That is Haber's ring reuse: S times fewer paths.  Left and right of the node's own vertical
plane are
mirror images: another factor 2.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit

from twilight.geometry import altitude_along
from twilight.solvers.cells.nodes import Directions, Nodes
from twilight.threads import in_slices
from twilight.transport.march import GAUSS_HIGH, GAUSS_LOW, MAX_STEPS, march, step_transmission
from twilight.transport.profile import Profile


class Mesh(NamedTuple):
    """Nodes as arrays for kernels."""

    log_radius: np.ndarray
    shell_start: np.ndarray
    altitude_km: np.ndarray
    outer_radius_km: float
    observer_radius_km: float


class Stencils(NamedTuple):
    """first (rays + 1,): where each ray's entries start.  An entry is one step: corner (E, 4) points, corner_weight
    (E, 4),
    azimuth (E,) of the step [rad, relative to the ray's node], weight (E, W) on the mean scattered source.
    ground_* (rays, ...): the same for the point where the ray ends on the ground (weight 0 where it does not)."""

    first: np.ndarray
    corner: np.ndarray
    corner_weight: np.ndarray
    azimuth: np.ndarray
    weight: np.ndarray
    ground_corner: np.ndarray
    ground_corner_weight: np.ndarray
    ground_azimuth: np.ndarray
    ground_weight: np.ndarray


def make_mesh(nodes: Nodes, observer_radius_km: float) -> Mesh:
    return Mesh(
        np.log(nodes.shell_radius_km),
        nodes.shell_start.astype(np.int64),
        nodes.altitude_km,
        float(nodes.shell_radius_km[-1]),
        float(observer_radius_km),
    )


@njit(cache=True)
def _bracket(altitudes, low, high, z):
    """Point below z within altitudes[low:high] and the fraction to the next one, clamped at both ends."""
    if z <= altitudes[low]:
        return low, 0.0
    if z >= altitudes[high - 1]:
        return high - 2, 1.0
    a = low
    b = high - 1
    while b - a > 1:
        mid = (a + b) // 2
        if altitudes[mid] <= z:
            a = mid
        else:
            b = mid
    return a, (z - altitudes[a]) / (altitudes[a + 1] - altitudes[a])


@njit(cache=True)
def corners_at(mesh, x, y, z_centre, altitude, corner, weight):
    """Four points around a position (x, y, z from the centre of the Earth) and their weights; azimuth is returned."""
    dz = z_centre - mesh.observer_radius_km
    r = math.sqrt(x * x + y * y + dz * dz)
    log_r = math.log(max(r, 1e-9))
    n = mesh.log_radius.size
    j = int(np.searchsorted(mesh.log_radius, log_r, side="right")) - 1
    if j < 0:
        j, f = 0, 0.0
    elif j >= n - 1:
        j, f = n - 2, 1.0
    else:
        f = (log_r - mesh.log_radius[j]) / (mesh.log_radius[j + 1] - mesh.log_radius[j])
    for side in range(2):
        share = 1.0 - f if side == 0 else f
        p, g = _bracket(mesh.altitude_km, mesh.shell_start[j + side], mesh.shell_start[j + side + 1], altitude)
        corner[2 * side] = p
        corner[2 * side + 1] = p + 1
        weight[2 * side] = share * (1.0 - g)
        weight[2 * side + 1] = share * g
    return math.atan2(y, x)


@njit(cache=True)
def trace(profile, jumps, mesh, x0, z0, altitude0, dx, dy, dz, fineness, store, out, at, ground):
    """One ray from (x0, 0, z0) along (dx, dy, dz).  Counts its steps, or stores them from index `at`; returns the
    count.

    `out` and `ground` are tuples of the arrays of :class:`Stencils`.
    """
    corner, corner_weight, azimuth, weight = out
    radius = profile.earth_radius_km
    rho0 = math.sqrt(x0 * x0 + z0 * z0)
    mu = (x0 * dx + z0 * dz) / rho0
    edges = np.empty(MAX_STEPS + 2)
    n, hits = march(profile, jumps, altitude0, mu, fineness, edges)
    n_wavelengths = profile.extinction.shape[1]
    depth = np.empty(n_wavelengths)
    passed = np.zeros(n_wavelengths)
    collected = np.zeros(n_wavelengths)
    levels = np.empty(2, np.int64)
    fractions = np.empty(2)
    row = np.empty(n_wavelengths)
    stored = 0
    for k in range(n):
        s0 = edges[k]
        length = edges[k + 1] - s0
        s_low = s0 + GAUSS_LOW * length
        s_high = s0 + GAUSS_HIGH * length
        z_low = altitude_along(altitude0, mu, s_low, radius)
        z_high = altitude_along(altitude0, mu, s_high, radius)
        step_transmission(profile, z_low, z_high, length, levels, fractions, depth)
        moment = 0.0
        total = 0.0
        useful = False
        for w in range(n_wavelengths):
            i0, f0, i1, f1 = levels[0], fractions[0], levels[1], fractions[1]
            sigma_low = profile.scattering[i0, w] * (1 - f0) + profile.scattering[i0 + 1, w] * f0
            sigma_high = profile.scattering[i1, w] * (1 - f1) + profile.scattering[i1 + 1, w] * f1
            t = math.exp(-passed[w])
            low = 0.5 * length * sigma_low * t * math.exp(-GAUSS_LOW * depth[w])
            high = 0.5 * length * sigma_high * t * math.exp(-GAUSS_HIGH * depth[w])
            row[w] = low + high
            total += low + high
            moment += low * s_low + high * s_high
            if low + high > 1e-9 * collected[w] and low + high > 1e-12:
                useful = True
            collected[w] += low + high
            passed[w] += depth[w]
        if not useful:
            continue
        s = moment / total
        x = x0 + s * dx
        y = s * dy
        z = z0 + s * dz
        outside = x * x + y * y + (z - mesh.observer_radius_km) ** 2 > mesh.outer_radius_km**2
        if outside:
            continue
        if store:
            e = at + stored
            azimuth[e] = corners_at(
                mesh, x, y, z, altitude_along(altitude0, mu, s, radius), corner[e], corner_weight[e]
            )
            for w in range(n_wavelengths):
                weight[e, w] = row[w]
        stored += 1
    if store:
        g_corner, g_corner_weight, g_azimuth, g_weight, ray = ground
        for w in range(n_wavelengths):
            g_weight[ray, w] = math.exp(-passed[w]) if hits else 0.0
        if hits:
            s = edges[n]
            g_azimuth[ray] = corners_at(
                mesh, x0 + s * dx, s * dy, z0 + s * dz, profile.altitude_km[0], g_corner[ray], g_corner_weight[ray]
            )
    return stored


@njit(cache=True, nogil=True)
def _trace_all(
    profile, jumps, mesh, x, z, cosine, n_relative, n_azimuth, fineness, store, first, out, ground, begin, end
):
    n_cos = cosine.size
    for p in range(begin, end):
        for m in range(n_cos):
            sine = math.sqrt(1.0 - cosine[m] * cosine[m])
            for a in range(n_relative):
                ray = (p * n_cos + m) * n_relative + a
                phi = 2.0 * math.pi * a / n_azimuth
                count = trace(
                    profile,
                    jumps,
                    mesh,
                    x[p],
                    z[p],
                    mesh.altitude_km[p],
                    sine * math.cos(phi),
                    sine * math.sin(phi),
                    cosine[m],
                    fineness,
                    store,
                    out,
                    first[ray],
                    (ground[0], ground[1], ground[2], ground[3], ray),
                )
                if not store:
                    first[ray + 1] = count


def make_stencils(
    profile: Profile,
    jumps: np.ndarray,
    nodes: Nodes,
    mesh: Mesh,
    directions: Directions,
    n_azimuth: int,
    fineness: float,
) -> Stencils:
    """Trace all rays twice: once to count their steps, once to keep them."""
    n_relative = n_azimuth // 2 + 1
    n_rays = nodes.altitude_km.size * directions.cosine.size * n_relative
    n_wavelengths = profile.extinction.shape[1]

    def arrays(n):
        return (
            np.zeros((n, 4), np.int32),
            np.zeros((n, 4), np.float32),
            np.zeros(n, np.float32),
            np.zeros((n, n_wavelengths), np.float32),
        )

    first = np.zeros(n_rays + 1, np.int64)
    common = (profile, jumps, mesh, nodes.x_km, nodes.z_km, directions.cosine, n_relative, n_azimuth, fineness)
    dummy = arrays(1)
    in_slices(lambda begin, end: _trace_all(*common, False, first, dummy, dummy, begin, end), nodes.altitude_km.size)
    start = np.cumsum(first)
    out, ground = arrays(start[-1]), arrays(n_rays)
    in_slices(lambda begin, end: _trace_all(*common, True, start, out, ground, begin, end), nodes.altitude_km.size)
    return Stencils(start, *out, *ground)
