"""Nodes and directions of the exact mode: points on shells around the observer, Gauss angles times equal azimuths.

Rays from every node in every direction, as weights on other nodes, for all orders of scattering and all suns.  A ray
leaves a node of azimuth 0; the same ray of the same node at another azimuth meets the same air, turned about the
observer's vertical.  That is Haber's ring reuse: S times fewer paths.  Left and right of the node's own vertical
plane are mirror images: another factor 2.
"""

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.special import sph_harm_y

from twilight.base.threads import in_slices
from twilight.jit.kernels import njit
from twilight.solvers.cells.settings import CellsSettings
from twilight.transport.lines import ALTITUDE, DISTANCE, END_DISTANCE, GROUND, new_line, trace_line
from twilight.transport.profile import Profile

POLAR_POWER = 1.5
"""Power by which the elevations of the nodes crowd at the horizon."""
LOWEST_STEP_KM = 0.7
"""Interval between altitudes at the ground [km], at node_density 1."""
STEP_GROWTH = 0.22
"""Growth of that interval with height above the ground."""


@dataclass(frozen=True)
class CellNodes:
    """Columns of points on shells around the observer, the same at every azimuth.

    shell_radius_km (J,): distance from the observer; shell_start (J + 1,): first point of each shell in the flat lists
    altitude_km (P,), rising within a shell; x_km, z_km (P,): horizontal distance and height in the observer's frame,
    from the centre of the Earth
    """

    shell_radius_km: np.ndarray
    shell_start: np.ndarray
    altitude_km: np.ndarray
    x_km: np.ndarray
    z_km: np.ndarray


def make_nodes(
    settings: CellsSettings, observer_altitude_km: float, bottom_km: float, top_km: float, earth_radius_km: float
) -> CellNodes:
    """Points at graded altitudes on shells around the observer, whose radii grow by a constant ratio."""
    ratio = 1.0 + 0.6 / settings.node_density
    radius_observer = earth_radius_km + observer_altitude_km
    far = math.sqrt((top_km - bottom_km) * (2 * earth_radius_km + top_km + bottom_km))
    far += math.sqrt(max(observer_altitude_km - bottom_km, 0.0) * (2 * earth_radius_km + observer_altitude_km))
    largest_step_km = 80.0 / settings.node_density
    shells = [1.0]
    while shells[-1] < far:
        shells.append(min(shells[-1] * ratio, shells[-1] + largest_step_km))
    radii, start, altitudes, x, z = [], [0], [], [], []
    graded = graded_altitudes(bottom_km, top_km, settings.node_density)
    for r in shells:
        low = max(bottom_km, observer_altitude_km - r)
        high = min(top_km, observer_altitude_km + r)
        if high - low < 1e-6:
            continue
        h = graded[(graded > low) & (graded < high)]
        h = np.unique(np.concatenate([[low], h, [high]]))
        keep = np.ones(h.size, dtype=bool)
        keep[1:-1] = np.diff(h)[:-1] > 0.05
        h = h[keep]
        rho = earth_radius_km + h
        sine = ((rho - radius_observer) * (rho + radius_observer) - r * r) / (2.0 * radius_observer * r)
        sine = np.clip(sine, -1.0, 1.0)
        radii.append(r)
        altitudes.append(h)
        x.append(r * np.sqrt(1.0 - sine**2))
        z.append(radius_observer + r * sine)
        start.append(start[-1] + h.size)
    return CellNodes(np.array(radii), np.array(start), np.concatenate(altitudes), np.concatenate(x), np.concatenate(z))


def graded_altitudes(bottom_km: float, top_km: float, density: float) -> np.ndarray:
    """Altitudes [km] whose interval is (LOWEST_STEP_KM + STEP_GROWTH x height) / density."""
    out = [bottom_km]
    while out[-1] < top_km:
        out.append(out[-1] + (LOWEST_STEP_KM + STEP_GROWTH * (out[-1] - bottom_km)) / density)
    out[-1] = top_km
    return np.array(out)


@dataclass(frozen=True)
class QuadratureDirections:
    """Gauss points in each hemisphere times equal azimuths; directions look away from the point, towards the light.

    cosine (M,) of the zenith angle in the observer's frame; azimuth (F,) from 0; weight (M,) with sum over all = 4 pi
    harmonics (M * F, (degree + 1)^2): real spherical harmonics, orthonormal; degree_of (that many,)
    """

    cosine: np.ndarray
    azimuth: np.ndarray
    weight: np.ndarray
    harmonics: np.ndarray
    degree_of: np.ndarray


def gauss_directions(per_hemisphere: int, around: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Cosines of the zenith angle, azimuths [rad] and weights of all directions, flat; the weights sum to 4 pi."""
    x, w = np.polynomial.legendre.leggauss(per_hemisphere)
    cosine = np.repeat(np.concatenate([0.5 * (x - 1.0), 0.5 * (x + 1.0)]), around)
    azimuth = np.tile(2.0 * np.pi * np.arange(around) / around, 2 * per_hemisphere)
    return cosine, azimuth, np.repeat(np.concatenate([w, w]) * np.pi / around, around)


def make_directions(settings: CellsSettings) -> QuadratureDirections:
    x, w = np.polynomial.legendre.leggauss(settings.polar_directions)
    # Gauss in u = cosine^(1/1.5): closer to the horizon, where the light of twilight comes from
    u = 0.5 * (x + 1.0)
    w = w * u ** (POLAR_POWER - 1.0)
    w *= 1.0 / w.sum()
    cosine = np.concatenate([-(u[::-1] ** POLAR_POWER), u**POLAR_POWER])
    n_azimuth = settings.azimuth_directions
    weight = np.concatenate([w[::-1], w]) * 2.0 * np.pi / n_azimuth
    azimuth = 2.0 * np.pi * np.arange(n_azimuth) / n_azimuth
    mu, phi = np.meshgrid(cosine, azimuth, indexing="ij")
    harmonics, degree_of = real_harmonics(mu.ravel(), phi.ravel(), settings.degree)
    return QuadratureDirections(cosine, azimuth, weight, harmonics, degree_of)


def real_harmonics(cosine, azimuth, degree: int) -> tuple[np.ndarray, np.ndarray]:
    """Orthonormal real spherical harmonics at directions, (D, (degree + 1)^2), and the degree of each column."""
    columns, degrees = [], []
    theta = np.arccos(np.clip(cosine, -1.0, 1.0))
    for deg in range(degree + 1):
        for order in range(-deg, deg + 1):
            y = sph_harm_y(deg, abs(order), theta, azimuth)
            if order < 0:
                columns.append(math.sqrt(2.0) * y.imag)
            elif order == 0:
                columns.append(y.real)
            else:
                columns.append(math.sqrt(2.0) * y.real)
            degrees.append(deg)
    return np.stack(columns, axis=1), np.array(degrees)


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
