"""The importance function of the random walk: an approximate field of diffuse light, in tables.

A path that runs backwards from the observer is drawn with the least noise in proportion to the light that it will meet:
for such paths the radiance itself is the importance function (the adjoint of what the observer measures).  An
approximate radiance serves as well, for every choice is divided by its probability: its errors change the noise, never
the mean.  The light of a spherical atmosphere in a parallel beam depends on altitude, local solar zenith angle and
direction only, so that one table serves every observer and every sun.  `importance_solution` fills it.

Altitudes of the tables are dense at the ground, beside the edges of layers, and in thick air.

Arguments that kernels share: `kernel`.
"""

import math
from collections.abc import Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from twilight.jit.kernels import njit
from twilight.solvers.montecarlo.air import N_SAMPLING, N_SMOOTH, SCATTERING, SPECIES, MonteCarloAir, interpolate
from twilight.solvers.montecarlo.kernel import INNER

N_ALTITUDES = 20
"""Altitudes at quadratic distances from the ground."""
LAYER_FACTOR = 3.0
"""Factor by which scattering changes within LAYER_KM at an edge of a layer."""
LAYER_KM = 0.5
"""Distance [km] over which that change is looked for, and least distance between two edges."""
LAYER_ABOVE_KM = 3.0
"""Height [km] above the ground from which edges count: below, altitudes are dense in any case."""
MOST_EDGES = 8
"""Most edges; the strongest ones get altitudes of the tables on both sides."""
BESIDE_KM = 0.05
"""Distance [km] of those altitudes from the edge."""
THICK = 3.0
"""Vertical diffusion depth (see `diffusion_depth`) from which air counts as thick: light in it diffuses."""
THICK_STEP = 1.2
"""Largest diffusion depth between altitudes of the tables in thick air."""
THICK_EDGE = 0.1
"""Diffusion depth between the edge of thick air and the altitude next to it."""
MOST_THICK = 30
"""Most altitudes added for thick air."""
N_ROOTS = 1024
"""Steps of the root of the relative height in which altitudes are looked up."""
N_ROOTS_THICK = 16384
"""Steps of that root in thick air, whose tables have altitudes closer to one another."""
N_HINTS = 4096
"""Parts of -1 .. 1 in which the cosine of the solar zenith angle is looked up."""
N_SOURCE_ROWS = 12
"""Cells of the source function in the sine of the elevation."""
N_SOURCE_AZIMUTHS = 10
"""Cells of the source function in the sine of half the azimuth from the sun."""
N_SOURCE = N_SOURCE_ROWS * N_SOURCE_AZIMUTHS
LOG_OF_NO_LIGHT = -80.0
"""Logarithm of the light [sr^-1] that stands for none."""
SUN_ZENITH_DEG = np.concatenate(
    [
        [0.0, 25.0, 40.0, 52.0, 61.0, 68.0, 74.0, 78.0, 81.0, 84.0, 86.0, 87.5],
        np.arange(89.0, 112.0, 1.0),
        np.arange(112.0, 132.1, 2.0),
        [140.0, 155.0, 180.0],
    ]
)
"""Nodes of the local solar zenith angle, closest about the terminator."""
ABOVE_HORIZON_DEG = np.array(
    [-90, -40, -18, -8, -4, -2, -0.8, 0, 0.4, 0.8, 1.3, 1.9, 2.6, 3.5, 4.7, 6.2, 8.5, 12, 17, 25, 36, 48, 61, 75, 90.0]
)
"""Edges of the rows of cells of directions: asin of g, see `ImportanceTables`."""
_HALF_DEG = np.array([0.0, 10.0, 22.0, 38.0, 60.0, 90.0, 130.0, 180.0])
AZIMUTH_EDGES_RAD = np.radians(np.concatenate([_HALF_DEG, 360.0 - _HALF_DEG[-2::-1]]))
N_AZIMUTHS = AZIMUTH_EDGES_RAD.size - 1
N_DIRECTIONS = (ABOVE_HORIZON_DEG.size - 1) * N_AZIMUTHS
"""Number D of cells of directions: rows of N_AZIMUTHS cells of azimuth from the sun."""


def table_altitudes(air: MonteCarloAir) -> np.ndarray:
    """Altitudes [km] of the tables: quadratic, dense at the ground, and beside the edges of layers."""
    z = air.level_km
    bottom, depth = z[0], z[-1] - z[0]
    quadratic = bottom + depth * np.linspace(0.0, 1.0, N_ALTITUDES) ** 2
    scattering = np.log(np.maximum(air.table[:, :, SCATTERING], 1e-12))
    # the change over LAYER_KM around each level: from just above the level below to just below the one above
    lower = np.maximum(np.searchsorted(z, z - 0.5 * LAYER_KM, side="right") - 1, 0)
    upper = np.minimum(np.searchsorted(z, z + 0.5 * LAYER_KM, side="left"), z.size - 1)
    step = np.abs(np.diff(scattering, axis=1)).max(axis=0)
    change = np.abs(scattering[:, upper] - scattering[:, lower]).max(axis=0)
    # where levels are far apart, nothing happens between them
    change[z[upper] - z[lower] > 4 * LAYER_KM] = 0.0
    change[(z < bottom + LAYER_ABOVE_KM) | (z > z[-1] - 2 * BESIDE_KM)] = 0.0
    edges: list[float] = []
    for i in np.argsort(-change, kind="stable"):
        if change[i] < np.log(LAYER_FACTOR) or len(edges) == MOST_EDGES:
            break
        k = lower[i] + int(np.argmax(step[lower[i] : upper[i]]))
        edge = float(0.5 * (z[k] + z[k + 1]))
        if all(abs(edge - other) > LAYER_KM for other in edges):
            edges.append(edge)
    beside = [edge + side * BESIDE_KM for edge in edges for side in (-1.0, 1.0)]
    return np.unique(np.concatenate([quadratic, beside]))


def diffusion_depth(air: MonteCarloAir, asymmetry: Sequence[np.ndarray]) -> np.ndarray:
    """Diffusion depth (W, N): integral from the ground to every level of (1 - g) x scattering coefficient.

    asymmetry: mean cosines g (W,) of the aerosols' phase functions.
    """
    z = air.level_km
    scattering = air.table[:, :, SCATTERING].copy()
    if not air.isotropic_events:
        for k, g in enumerate(asymmetry):
            scattering -= np.clip(g, 0.0, 0.999)[:, None] * air.table[:, :, SPECIES + 1 + k]
    steps = 0.5 * (scattering[:, 1:] + scattering[:, :-1]) * np.diff(z)
    return np.concatenate([np.zeros_like(steps[:, :1]), np.cumsum(steps, axis=1)], axis=1)


def thick_altitudes(level_km: np.ndarray, depth: np.ndarray, altitude_km: np.ndarray) -> np.ndarray:
    """Altitudes [km] to add to those of the tables (A,) where the depth between two of them is more than THICK_STEP.

    level_km (N,); depth (W, N): `diffusion_depth`.  None where the air is not THICK.
    """
    which = depth[:, -1] > THICK
    if not which.any():
        return np.zeros(0)
    most = depth[which].max(axis=0)
    step = max(THICK_STEP, most[-1] / MOST_THICK)
    added: list[float] = []
    at = np.interp(altitude_km, level_km, most)
    for begin, end in pairwise(at):
        if end - begin > step:
            inside = np.linspace(begin, end, int(np.ceil((end - begin) / step)) + 1)[1:-1]
            added += [begin + THICK_EDGE, *inside, end - THICK_EDGE]
    rises = np.concatenate([[True], np.diff(most) > 0.0])
    return np.interp(added, most[rises], level_km[rises])


class ImportanceTables(NamedTuple):
    """Tables over A altitudes, Z cosines of the local solar zenith angle and D cells of directions, W wavelengths.

    bottom_km, depth_km: altitude of the ground, and from there to the top of the air; ground_radius_km: of the ground.
    altitude_km (A,): nodes; place_of_root (R + 1,): place among them (2.5: between the third and the fourth) over the
        root of the relative height above the ground, in R equal steps.
    cos_sun (Z,): nodes, ascending; hint (N_HINTS,): node at or below the start of each of as many equal parts of
        -1 .. 1.
    log_mean (W, A, Z): logarithm of the mean diffuse radiance [sr^-1].
    log_source (W, A, Z, N_SOURCE): logarithm of the source function, the diffuse light that an event scatters per unit
        of scattering [sr^-1].
    log_ground (W, Z): logarithm of the diffuse irradiance on the ground, over F0.
    log_radiance (W, A, Z, D): logarithm of the diffuse radiance [sr^-1].
    cell_fraction (W, A, Z, D): fraction of the diffuse light (radiance x solid angle) that comes from a cell.
    row_edges (D / N_AZIMUTHS + 1,): of g in [-1, 1]; azimuth_edges (N_AZIMUTHS + 1,) [rad], azimuth_cos_sin
        (N_AZIMUTHS, 2): of the middles of the cells.
    centre (A, D, 3): of the cells, in the frame (towards the sun, sideways, up); solid_angle (A, D) [sr].

    Directions are cells of azimuth from the sun and of height g above the horizon of the altitude, where the light and
    the dark ground meet: with h the sine of the horizon's elevation, the sine of a direction's elevation is
    h + (1 - h) g above and h + (1 + h) g below.
    """

    bottom_km: float
    depth_km: float
    altitude_km: np.ndarray
    place_of_root: np.ndarray
    cos_sun: np.ndarray
    hint: np.ndarray
    log_mean: np.ndarray
    log_source: np.ndarray
    log_ground: np.ndarray
    log_radiance: np.ndarray
    cell_fraction: np.ndarray
    ground_radius_km: float
    row_edges: np.ndarray
    azimuth_edges: np.ndarray
    azimuth_cos_sin: np.ndarray
    centre: np.ndarray
    solid_angle: np.ndarray


def empty_importance(air: MonteCarloAir, depth: np.ndarray) -> ImportanceTables:
    """Tables without light: every event is drawn by transmittance and scattering alone.

    depth (W, N): `importance_altitudes.diffusion_depth`, which says where altitudes are wanted.
    """
    n_wavelengths = air.table.shape[0]
    cos_sun = np.sort(np.cos(np.radians(SUN_ZENITH_DEG)))
    rows = np.sin(np.radians(ABOVE_HORIZON_DEG))
    bottom, height = float(air.shell_km[0]), float(air.shell_km[-1] - air.shell_km[0])
    ground_radius = air.earth_radius_km + bottom
    altitude = table_altitudes(air)
    altitude = np.union1d(altitude, thick_altitudes(air.level_km, depth, altitude))
    root = np.sqrt((altitude - bottom) / height)
    n_roots = N_ROOTS_THICK if (depth[:, -1] > THICK).any() else N_ROOTS
    place = np.interp(np.linspace(0.0, 1.0, n_roots + 1), root, np.arange(altitude.size))
    ratio = ground_radius / (ground_radius + altitude - bottom)
    horizon = -np.sqrt(np.maximum(0.0, 1.0 - ratio**2))[:, None]
    edges = horizon + np.where(rows < 0, 1 + horizon, 1 - horizon) * rows
    middle = np.repeat(0.5 * (edges[:, 1:] + edges[:, :-1]), N_AZIMUTHS, axis=1)
    azimuth = np.tile(0.5 * (AZIMUTH_EDGES_RAD[1:] + AZIMUTH_EDGES_RAD[:-1]), rows.size - 1)
    level = np.sqrt(1 - middle**2)
    centre = np.stack([level * np.cos(azimuth), level * np.sin(azimuth), middle], axis=-1)
    solid_angle = (np.diff(edges)[:, :, None] * np.diff(AZIMUTH_EDGES_RAD)).reshape(altitude.size, -1)
    shape = (n_wavelengths, altitude.size, cos_sun.size)
    starts = -1 + 2 * np.arange(N_HINTS) / N_HINTS
    return ImportanceTables(
        bottom,
        height,
        altitude,
        place,
        cos_sun,
        np.clip(np.searchsorted(cos_sun, starts, side="right") - 1, 0, cos_sun.size - 2).astype(np.int64),
        np.full(shape, LOG_OF_NO_LIGHT),
        np.full((*shape, N_SOURCE), LOG_OF_NO_LIGHT, dtype=np.float32),
        np.full((n_wavelengths, cos_sun.size), LOG_OF_NO_LIGHT),
        np.full((*shape, N_DIRECTIONS), LOG_OF_NO_LIGHT, dtype=np.float32),
        np.broadcast_to((solid_angle / (4 * np.pi)).astype(np.float32)[:, None], (*shape, N_DIRECTIONS)).copy(),
        float(ground_radius),
        rows,
        AZIMUTH_EDGES_RAD,
        np.stack([np.cos(azimuth[:N_AZIMUTHS]), np.sin(azimuth[:N_AZIMUTHS])], axis=-1),
        np.ascontiguousarray(centre),
        solid_angle,
    )


@njit(inline="always", **INNER)
def altitude_place(place_of_root, n_altitudes, root):
    """(i, fraction) among the altitudes of the tables.

    place_of_root (R + 1,): of `ImportanceTables`; n_altitudes: how many there are; root: of the height above the
    ground over the depth of the air, 0 to 1.
    """
    n_roots = place_of_root.size - 1
    x = root * n_roots
    k = min(int(x), n_roots - 1)
    f = min(1.0, x - k)
    place = place_of_root[k] * (1.0 - f) + place_of_root[k + 1] * f
    i = min(int(place), n_altitudes - 2)
    return i, min(1.0, place - i)


@njit(inner=True, **INNER)
def altitude_index(importance, z):
    """(i, fraction) of the altitude z [km] in the tables."""
    return altitude_place(
        importance.place_of_root,
        importance.altitude_km.size,
        math.sqrt(max(0.0, (z - importance.bottom_km) / importance.depth_km)),
    )


@njit(inner=True, **INNER)
def sun_index(nodes, hint, cos_sun):
    """(i, fraction) of the cosine of the local solar zenith angle in the tables.

    nodes (Z,): cosines of the tables, ascending; hint (N_HINTS,): node at or below the start of each of as many equal
    parts of -1 .. 1; cos_sun: the cosine looked for.
    """
    j = hint[min(N_HINTS - 1, int((cos_sun + 1.0) * (0.5 * N_HINTS)))]
    while j < nodes.size - 2 and nodes[j + 1] < cos_sun:
        j += 1
    return j, (cos_sun - nodes[j]) / (nodes[j + 1] - nodes[j])


def source_directions() -> np.ndarray:
    """Middles (N_SOURCE, 3) of the cells of directions of the source, in the frame (towards the sun, sideways, up)."""
    up = -1.0 + 2.0 * (np.arange(N_SOURCE_ROWS) + 0.5) / N_SOURCE_ROWS
    azimuth = 2.0 * np.arcsin((np.arange(N_SOURCE_AZIMUTHS) + 0.5) / N_SOURCE_AZIMUTHS)
    level = np.sqrt(1.0 - up**2)[:, None]
    parts = (level * np.cos(azimuth), level * np.sin(azimuth), up[:, None] + 0.0 * azimuth)
    return np.stack(parts, axis=-1).reshape(N_SOURCE, 3)


@njit(inline="always", **INNER)
def log_source_light(source, place_of_root, nodes, hint, root, mu_sun, up, cos_to_sun):
    """Logarithm of the source function [sr^-1]: diffuse light scattered towards the viewer per unit of scattering.

    source (A, Z, N_SOURCE): log_source of one wavelength; place_of_root (R + 1,), nodes (Z,), hint (N_HINTS,): of
    `ImportanceTables`, as arrays because this is the innermost loop; root: of the relative altitude; mu_sun, up:
    cosines to the vertical of the sun and of the direction of view; cos_to_sun: cosine between the two.
    """
    i, a = altitude_place(place_of_root, source.shape[0], root)
    j, b = sun_index(nodes, hint, mu_sun)
    levels = math.sqrt(max(1e-20, (1.0 - up * up) * (1.0 - mu_sun * mu_sun)))
    half = math.sqrt(min(1.0, max(0.0, 0.5 - 0.5 * (cos_to_sun - up * mu_sun) / levels)))
    row = min(N_SOURCE_ROWS - 1, max(0, int((up + 1.0) * (0.5 * N_SOURCE_ROWS))))
    d = row * N_SOURCE_AZIMUTHS + min(N_SOURCE_AZIMUTHS - 1, int(half * N_SOURCE_AZIMUTHS))
    t = source
    return (t[i, j, d] * (1 - b) + t[i, j + 1, d] * b) * (1 - a) + (
        t[i + 1, j, d] * (1 - b) + t[i + 1, j + 1, d] * b
    ) * a


@njit(inline="always", **INNER)
def log_ground_light(importance, w, cos_sun):
    """Logarithm of the diffuse irradiance on the ground, over F0; `cos_sun`: of the local solar zenith angle."""
    j, b = sun_index(importance.cos_sun, importance.hint, cos_sun)
    return importance.log_ground[w, j] * (1 - b) + importance.log_ground[w, j + 1] * b


@njit(inner=True, **INNER)
def log_light_from(importance, w, z, cos_sun, cell):
    """Logarithm of the diffuse radiance [sr^-1] from one cell of directions.

    z [km]: altitude; cos_sun: of the local solar zenith angle; cell: 0 ..  D - 1.
    """
    i, a = altitude_index(importance, z)
    j, b = sun_index(importance.cos_sun, importance.hint, cos_sun)
    t = importance.log_radiance
    lower = t[w, i, j, cell] * (1 - b) + t[w, i, j + 1, cell] * b
    upper = t[w, i + 1, j, cell] * (1 - b) + t[w, i + 1, j + 1, cell] * b
    return lower * (1 - a) + upper * a


@njit(inline="always", **INNER)
def horizon_sine(importance, z):
    """Sine of the elevation of the geometric horizon at the altitude z [km]: 0 or less."""
    height = max(0.0, z - importance.bottom_km)
    r = importance.ground_radius_km + height
    return -math.sqrt(height * (r + importance.ground_radius_km)) / r


@njit(inline="always", **INNER)
def row_sine(g, horizon):
    """Sine of the elevation at a height of the cells; see :class:`ImportanceTables`.

    g: the height, in [-1, 1]; horizon: sine of the horizon's elevation.
    """
    return horizon + (1.0 - horizon if g >= 0.0 else 1.0 + horizon) * g


@njit(inner=True, **INNER)
def cell_of(importance, horizon, x, y, z):
    """Cell of directions that holds the unit vector (x, y, z) of the local frame.

    horizon: sine of the horizon's elevation there.
    """
    above = z - horizon
    g = above / (1.0 - horizon if above >= 0.0 else 1.0 + horizon)
    e = 0
    n = importance.row_edges.size - 1
    while e < n - 1 and importance.row_edges[e + 1] < g:
        e += 1
    azimuth = math.atan2(y, x)
    if azimuth < 0.0:
        azimuth += 2.0 * math.pi
    a = 0
    while a < N_AZIMUTHS - 1 and importance.azimuth_edges[a + 1] < azimuth:
        a += 1
    return e * N_AZIMUTHS + a


@njit(inner=True, **INNER)
def cell_solid_angle(importance, horizon, cell):
    """Solid angle [sr] of a cell of directions.

    horizon: sine of the horizon's elevation at the altitude; cell: 0 ..  D - 1.
    """
    e = cell // N_AZIMUTHS
    a = cell % N_AZIMUTHS
    lower = row_sine(importance.row_edges[e], horizon)
    # the two sides of the horizon are scaled apart, and a cell lies on one of them
    upper = lower + (1.0 - horizon if importance.row_edges[e] >= 0.0 else 1.0 + horizon) * (
        importance.row_edges[e + 1] - importance.row_edges[e]
    )
    return (upper - lower) * (importance.azimuth_edges[a + 1] - importance.azimuth_edges[a])


@njit(inner=True, **INNER)
def nearest_node(importance, z, cos_sun):
    """Indices (altitude, sun) of the table node nearest to a point.

    z [km]: altitude; cos_sun: of the local solar zenith angle.
    """
    i, a = altitude_index(importance, z)
    j, b = sun_index(importance.cos_sun, importance.hint, cos_sun)
    return i + (1 if a > 0.5 else 0), j + (1 if b > 0.5 else 0)


@njit(inner=True, **INNER)
def weigh_cells(importance, air, w, node, place, horizon, heading, on_ground, work):
    """Running sums over the cells of the fraction of the light x the blurred phase function; returns their total.

    On the ground the cosine of the zenith angle takes the place of the phase function.

    node (2): indices of altitude and sun in the tables; place: (i, f) of the event among the levels of the air;
    horizon: sine of the horizon's elevation; heading (3): direction of the leg in the local frame; on_ground: whether
    the event is on the ground; work: `DirectionWorkspace`, whose running sums (D,) are filled.
    """
    cumulative, blurred = work.cumulative, work.blurred
    air_i, air_f = place
    vx, vy, vz = heading
    if not on_ground:
        for cell in range(N_SMOOTH):
            blurred[cell] = 1.0 if air.isotropic_events else 0.0
        if not air.isotropic_events:
            for c in range(air.table.shape[2] - SPECIES):
                beta = interpolate(air, w, air_i, air_f, SPECIES + c)
                if beta > 0.0:
                    for cell in range(N_SMOOTH):
                        blurred[cell] += beta * air.smooth[w, c, cell]
    total = 0.0
    d = 0
    rows = importance.row_edges
    azimuths = importance.azimuth_cos_sin
    fraction = importance.cell_fraction[w, node[0], node[1]]
    for e in range(rows.size - 1):
        up = row_sine(0.5 * (rows[e] + rows[e + 1]), horizon)
        level = math.sqrt(max(0.0, 1.0 - up * up))
        for a in range(N_AZIMUTHS):
            if on_ground:
                p = max(0.0, up)
            else:
                cosine = level * (vx * azimuths[a, 0] + vy * azimuths[a, 1]) + vz * up
                p = blurred[min(N_SMOOTH - 1, max(0, int((cosine + 1.0) * (0.5 * N_SMOOTH))))]
            total += fraction[d] * p
            cumulative[d] = total
            d += 1
    return total


@njit(inline="always", **INNER)
def sampling_cell(cosine):
    """Cell of the sampling tables of `air` that holds a scattering angle; `cosine`: of that angle."""
    x = math.sqrt(math.sqrt(max(0.0, 0.5 * (1.0 - cosine))))
    return min(N_SAMPLING - 1, int(x * N_SAMPLING))
