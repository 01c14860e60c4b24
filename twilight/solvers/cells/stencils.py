"""Rays from every node in every direction, as weights on other nodes, for all orders of scattering and all suns.

A ray leaves a node of azimuth 0; the same ray of the same node at another azimuth meets the same air, turned about the
observer's vertical.  That is Haber's ring reuse: S times fewer paths.  Left and right of the node's own vertical
plane are mirror images: another factor 2.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from twilight.base.threads import in_slices
from twilight.jit.kernels import njit
from twilight.solvers.cells.exact_grid import CellNodes, QuadratureDirections
from twilight.transport.lines import ALTITUDE, DISTANCE, END_DISTANCE, GROUND, new_line, trace_line
from twilight.transport.profile import Profile

FINENESS = 1.0
"""Density of the steps of rays between nodes."""


class Mesh(NamedTuple):
    """Nodes on shells as arrays for kernels: as `CellNodes`, with the logarithm of the radii, and the radius [km] of
    the observer from the centre of the Earth."""

    log_radius: np.ndarray
    shell_start: np.ndarray
    altitude_km: np.ndarray
    outer_radius_km: float
    observer_radius_km: float


class Steps(NamedTuple):
    """E points of rays, each between four nodes.

    corner, corner_weight (E, 4): the nodes and their weights, which add up to 1; azimuth (E,) [rad]: of the point from
    the node where its ray begins; weight (E, W): of the light that the point scatters or, of the ground, reflects.
    """

    corner: np.ndarray
    corner_weight: np.ndarray
    azimuth: np.ndarray
    weight: np.ndarray


class Stencils(NamedTuple):
    """Rays between nodes.

    first (rays + 1,): index of each ray's first entry in `steps`; ground: one entry a ray, where it ends on the ground
    (weight 0 where it does not).
    """

    first: np.ndarray
    steps: Steps
    ground: Steps


@njit(cache=True)
def new_steps(n, n_wavelengths):
    """`Steps`, all 0; n: number of points; n_wavelengths: W."""
    return Steps(
        np.zeros((n, 4), np.int32), np.zeros((n, 4), np.float32), np.zeros(n, np.float32),
        np.zeros((n, n_wavelengths), np.float32),
    )  # fmt: skip


def make_mesh(nodes: CellNodes, observer_radius_km: float) -> Mesh:
    """The `Mesh` of the exact mode's nodes."""
    return Mesh(
        np.log(nodes.shell_radius_km),
        nodes.shell_start.astype(np.int64),
        nodes.altitude_km,
        float(nodes.shell_radius_km[-1]),
        float(observer_radius_km),
    )


@njit(inner=True, cache=True)
def _bracket(altitudes, low, high, z):
    """Point below an altitude z [km] within altitudes[low:high] and the fraction to the next one, clamped at both ends.

    altitudes (P,) [km]; low, high: of the shell's points.
    """
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


@njit(inner=True, cache=True)
def corners_at(mesh, x, y, z_centre, altitude, corner, weight):
    """Four points around a position and their weights; its azimuth [rad] is returned.

    mesh: `Mesh`; (x, y, z_centre) [km]: the position, from the centre of the Earth; altitude [km]: its altitude; corner
    (4,), weight (4,): filled.
    """
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
        fraction = 1.0 - f if side == 0 else f
        p, g = _bracket(mesh.altitude_km, mesh.shell_start[j + side], mesh.shell_start[j + side + 1], altitude)
        corner[2 * side] = p
        corner[2 * side + 1] = p + 1
        weight[2 * side] = fraction * (1.0 - g)
        weight[2 * side + 1] = fraction * g
    return math.atan2(y, x)


@njit(cache=True)
def trace(profile, line, mesh, x0, z0, altitude0, dx, dy, dz, fineness, store, steps, at, ground, ray):
    """Number of entries of one ray from (x0, 0, z0) [km from the centre of the Earth] along the unit vector (dx, dy,
    dz); `store`: the entries are stored in `steps` from index `at` on, and the ray's end in row `ray` of `ground`.

    profile: `Profile`; line: room for its points; mesh: `Mesh`; altitude0 [km]: of the start; fineness: density of
    steps; steps, ground: `Steps`.
    """
    mu = (x0 * dx + z0 * dz) / math.sqrt(x0 * x0 + z0 * z0)
    n, status = trace_line(profile, altitude0, mu, fineness, np.bool_(False), line, math.inf)
    n_wavelengths = profile.extinction.shape[1]
    collected = np.zeros(n_wavelengths)
    stored = 0
    for k in range(n):
        useful = False
        for w in range(n_wavelengths):
            if line.weight[k, w] > 1e-9 * collected[w] and line.weight[k, w] > 1e-12:
                useful = True
            collected[w] += line.weight[k, w]
        if not useful:
            continue
        s = line.place[k, DISTANCE]
        x, y, z = x0 + s * dx, s * dy, z0 + s * dz
        if x * x + y * y + (z - mesh.observer_radius_km) ** 2 > mesh.outer_radius_km**2:
            continue
        if store:
            e = at + stored
            steps.azimuth[e] = corners_at(
                mesh, x, y, z, line.place[k, ALTITUDE], steps.corner[e], steps.corner_weight[e]
            )
            for w in range(n_wavelengths):
                steps.weight[e, w] = line.weight[k, w]
        stored += 1
    if store:
        for w in range(n_wavelengths):
            ground.weight[ray, w] = line.transmittance[w] if status == GROUND else 0.0
        if status == GROUND:
            s = line.end[END_DISTANCE]
            x, y, z = x0 + s * dx, s * dy, z0 + s * dz
            ground.azimuth[ray] = corners_at(
                mesh, x, y, z, profile.altitude_km[0], ground.corner[ray], ground.corner_weight[ray]
            )
    return stored


@njit(cache=True, nogil=True)
def _trace_all(profile, mesh, x, z, cosine, n_azimuth, store, first, steps, ground, begin, end):
    """`trace` from the nodes begin..end along all directions; counts each ray's entries into `first`, or stores them.

    profile: `Profile`; mesh: `Mesh`; x, z (P,) [km]: of the nodes from the centre of the Earth; cosine (M,): of the
    directions' zenith angles; n_azimuth: azimuths of a whole turn, from the node's; one side of it is traced; first
    (rays + 1,): index of each ray's first entry; store: whether entries are stored in steps, ground, both `Steps`.
    """
    n_cos = cosine.size
    n_relative = n_azimuth // 2 + 1
    line = new_line(profile)
    for p in range(begin, end):
        for m in range(n_cos):
            sine = math.sqrt(1.0 - cosine[m] * cosine[m])
            for a in range(n_relative):
                ray = (p * n_cos + m) * n_relative + a
                phi = 2.0 * math.pi * a / n_azimuth
                dx, dy = sine * math.cos(phi), sine * math.sin(phi)
                count = trace(
                    profile, line, mesh, x[p], z[p], mesh.altitude_km[p], dx, dy, cosine[m], FINENESS, store, steps,
                    first[ray], ground, ray,
                )  # fmt: skip
                if not store:
                    first[ray + 1] = count


def make_stencils(
    profile: Profile, nodes: CellNodes, mesh: Mesh, directions: QuadratureDirections, n_azimuth: int
) -> Stencils:
    """Trace all rays twice: first to count their entries, then to store them."""
    n_nodes = nodes.altitude_km.size
    n_rays = n_nodes * directions.cosine.size * (n_azimuth // 2 + 1)
    n_wavelengths = profile.extinction.shape[1]
    count = np.zeros(n_rays + 1, np.int64)
    common = (profile, mesh, nodes.x_km, nodes.z_km, directions.cosine, n_azimuth)
    none = new_steps(1, n_wavelengths)
    in_slices(lambda begin, end: _trace_all(*common, False, count, none, none, begin, end), n_nodes)
    first = np.cumsum(count)
    steps, ground = new_steps(first[-1], n_wavelengths), new_steps(n_rays, n_wavelengths)
    in_slices(lambda begin, end: _trace_all(*common, True, first, steps, ground, begin, end), n_nodes)
    return Stencils(first, steps, ground)
