"""The importance function of `importance`: solved as an approximate field that scatters again isotropically.

The mean light M at the nodes of altitude and local solar zenith angle obeys

    M = S + K M,

with S the sunlight scattered once and K one more isotropic scattering, the ground included: a small dense system, so
that thick and bright air takes no longer than thin air.  K interpolates linearly, which is too bright in the deep
shadow, where the light falls by e per degree.  Sweeps follow that interpolate the logarithm, with blurred phase
functions, and give the radiance and the source function by direction.

In thick air the light goes by diffusion, which the linear system has to get right, for a sweep takes it no farther than
a free path: there scattering is that of the air without forward peaks (similarity), the altitudes are close enough, and
what a piece of a leg scatters is integrated over it, so that none is lost at any of hundreds of events.

Arguments that kernels share: `kernel`.
"""

import math
from functools import partial

import numpy as np

from twilight.atmosphere.medium import Medium
from twilight.base.threads import in_slices
from twilight.jit.kernels import njit
from twilight.solvers.montecarlo.air import N_SMOOTH, SPECIES, MonteCarloAir, prepare_air
from twilight.solvers.montecarlo.importance import (
    LOG_OF_NO_LIGHT,
    N_AZIMUTHS,
    N_DIRECTIONS,
    THICK,
    ImportanceTables,
    altitude_index,
    diffusion_depth,
    empty_importance,
    source_directions,
    sun_index,
)
from twilight.solvers.montecarlo.kernel import INNER, any_normal
from twilight.solvers.montecarlo.leg import (
    DEPTH,
    LEG_PIECES,
    LENGTH,
    SCATTERED,
    START,
    LegOptions,
    new_leg,
    rescattered_light,
    trace,
)
from twilight.solvers.montecarlo.rays import CHORD_COLUMNS, DIRECTION, ORIGIN, REFERENCE, altitude_at
from twilight.solvers.montecarlo.sunlight import SolarBeam

LEG_OPTIONS = LegOptions(max_length_km=80.0, max_depth=1.0, sag_km=0.0, bent=False, polarised=False, random=False)
"""Legs from the nodes are straight, scalar and without random numbers."""
RANDOM_LEG_OPTIONS = LEG_OPTIONS._replace(random=True)
"""Legs in thick air, where sunlight changes within a piece: it is taken at a random point, of a stream per node."""
NEIGHBOUR_RATIO = 2.0
"""A wavelength starts from the field of the one before if their vertical optical depths differ by less than this."""


def solve_importance(
    air: MonteCarloAir, medium: Medium, sun: SolarBeam, sweeps: int, stop: np.ndarray
) -> ImportanceTables:
    """The linear solution and then `sweeps` logarithmic ones; 0: no importance function.

    air: of the medium; stop (1,): once it is not 0, no second sweep is taken, at the cost of noise.  The linear
    solution and one sweep are there in any case: without them paths may miss nearly all light, and agree on it.
    """
    between = diffusion_depth(air, [phase.legendre_moments(1)[:, 1] for phase in medium.phase_functions])
    importance = empty_importance(air, between)
    if sweeps == 0:
        return importance
    is_thick = between[:, -1] > THICK
    diffuse = prepare_air(medium, 1) if is_thick.any() and not air.isotropic_events else air
    shape = (importance.altitude_km.size, importance.cos_sun.size)
    depth = air.moment[:, -1, 0]
    for w in range(air.table.shape[0]):
        phase = _source_phase(air, importance, w)
        todo = sweeps
        near = w > 0 and not is_thick[w]
        if near and sweeps > 1 and 1.0 / NEIGHBOUR_RATIO < depth[w] / max(depth[w - 1], 1e-300) < NEIGHBOUR_RATIO:
            # the field of the wavelength before is a better start than the linear solution, and costs nothing
            importance.log_source[w] = importance.log_source[w - 1]
            importance.log_ground[w] = importance.log_ground[w - 1]
            todo = sweeps - 1
        else:
            thick = bool(is_thick[w])
            _linear(diffuse if thick else air, sun, importance, w, thick)
        for sweep in range(todo):
            radiance = np.zeros((*shape, N_DIRECTIONS))
            flag = np.zeros_like(stop) if sweep == 0 else stop
            in_slices(partial(_sweep, air, sun, importance, w, flag, radiance), math.prod(shape))
            if flag[0]:
                break
            _store(importance, w, phase, radiance)
    return importance


def _linear(air: MonteCarloAir, sun: SolarBeam, importance: ImportanceTables, w: int, integrated: bool) -> None:
    """Mean light at the nodes from the linear system of one wavelength, the same in all directions."""
    n_sun = importance.cos_sun.size
    n = importance.altitude_km.size * n_sun
    # unknowns: mean light at the nodes, then diffuse irradiance on the ground
    source = np.zeros(n + n_sun)
    kernel = np.zeros((n + n_sun, n + n_sun))
    in_slices(partial(_system, air, sun, importance, w, integrated, source, kernel), n)
    light = np.linalg.solve(np.eye(n + n_sun) - kernel, source)
    floor = math.exp(LOG_OF_NO_LIGHT)
    importance.log_source[w] = np.log(np.maximum(light[:n], floor)).reshape(-1, n_sun, 1)
    importance.log_ground[w] = np.log(np.maximum(light[n:], floor))


def _source_phase(air: MonteCarloAir, importance: ImportanceTables, w: int) -> np.ndarray:
    """Mean blurred phase function (A, N_SOURCE, D) between the directions of the source and those of the light."""
    cosine = np.einsum("sk,adk->asd", source_directions(), importance.centre)
    cell = np.clip((0.5 * N_SMOOTH * (cosine + 1.0)).astype(int), 0, N_SMOOTH - 1)
    if air.isotropic_events:
        return np.full(cosine.shape, 0.25 / np.pi)
    z = importance.altitude_km
    beta = np.stack([np.interp(z, air.level_km, b) for b in air.table[w, :, SPECIES:].T], axis=-1)
    total = beta.sum(axis=-1, keepdims=True)
    beta = np.where(total > 0, beta / np.where(total > 0, total, 1.0), 1.0 / beta.shape[1])
    return np.stack([(b @ air.smooth[w])[c] for b, c in zip(beta, cell, strict=True)])


def _store(importance: ImportanceTables, w: int, phase: np.ndarray, radiance: np.ndarray) -> None:
    """Fill the tables of one wavelength from radiance (A, Z, D); phase: of `_source_phase`."""
    weighted = radiance * importance.solid_angle[:, None, :]
    total = weighted.sum(axis=-1)
    floor = math.exp(LOG_OF_NO_LIGHT)
    importance.log_mean[w] = np.log(np.maximum(total / (4 * np.pi), floor))
    source = np.einsum("asd,azd->azs", phase, weighted)
    importance.log_source[w] = np.log(np.maximum(source, floor))
    down = (weighted[0] * np.maximum(importance.centre[0, :, 2], 0.0)).sum(axis=-1)
    importance.log_ground[w] = np.log(np.maximum(down, floor))
    importance.log_radiance[w] = np.log(np.maximum(radiance, floor))
    lit = total > 1e3 * floor
    isotropic = (importance.solid_angle / (4 * np.pi))[:, None, :]
    importance.cell_fraction[w] = np.where(lit[..., None], weighted / np.where(lit, total, 1.0)[..., None], isotropic)


@njit(inline="always", **INNER)
def _to_node(importance, node, to_sun):
    """Indices (i, j) of a node among altitudes and suns; to_sun (3,): filled with the sun's direction there.

    node: its number, 0 to A Z - 1, counted through the suns first.
    """
    i, j = divmod(node, importance.cos_sun.size)
    cosine = importance.cos_sun[j]
    to_sun[0], to_sun[1], to_sun[2] = math.sqrt(max(0.0, 1.0 - cosine * cosine)), 0.0, cosine
    return i, j


@njit(inner=True, **INNER)
def _leg_from_node(air, sun, importance, w, options, to_sun, i, d, stream, leg, ray):
    """Trace a leg from a node towards the centre of a cell of directions.

    i: index of the node's altitude; d: of the cell; to_sun (3,): in the node's frame (towards the sun, sideways, up);
    ray (9,): work space; options, stream, leg: as for `leg.trace`, whose `LegTotals` is returned.
    """
    ray[ORIGIN], ray[ORIGIN + 1], ray[ORIGIN + 2] = 0.0, 0.0, air.earth_radius_km + importance.altitude_km[i]
    for m in range(3):
        ray[DIRECTION + m] = importance.centre[i, d, m]
    any_normal(ray[DIRECTION:REFERENCE], ray[REFERENCE:CHORD_COLUMNS])
    return trace(air, sun, importance, w, ray, to_sun, options, stream, leg)


@njit(cache=True, nogil=True)
def _system(air, sun, importance, w, integrated, source, kernel, first, end):
    """S and K of the module's equation, rows of some nodes.

    integrated: whether what a piece scatters is integrated over the piece, not taken from its middle; source (N,)
    [sr^-1], kernel (N, N): S and K, added to, for N = A Z mean lights and Z irradiances on the ground; first, end: the
    first node and the one after the last.
    """
    altitude_km = importance.altitude_km
    n_sun = importance.cos_sun.size
    n_nodes = altitude_km.size * n_sun
    leg = new_leg(air.table.shape[2] - SPECIES, LEG_PIECES, 1)
    other = new_leg(air.table.shape[2] - SPECIES, LEG_PIECES if integrated else 1, 1)
    pieces = leg.pieces
    ray = np.empty(CHORD_COLUMNS)
    to_sun = np.zeros(3)
    stream = np.zeros(1, dtype=np.uint64)
    for node in range(first, end):
        stream[0] = node
        i, j = _to_node(importance, node, to_sun)
        sx, sz = to_sun[0], to_sun[2]
        r = air.earth_radius_km + altitude_km[i]
        for d in range(N_DIRECTIONS):
            azimuth = d % N_AZIMUTHS
            if azimuth >= N_AZIMUTHS // 2:
                continue
            totals = _leg_from_node(air, sun, importance, w, LEG_OPTIONS, to_sun, i, d, stream, leg, ray)
            up = importance.centre[i, d, 2]
            solid_angle = 2.0 * importance.solid_angle[i, d]
            mean = solid_angle / (4.0 * math.pi)
            down = solid_angle * up if i == 0 and up > 0.0 else 0.0
            single = totals.sun_i + totals.sun_ground
            if integrated:
                again = _leg_from_node(air, sun, importance, w, RANDOM_LEG_OPTIONS, to_sun, i, d, stream, other, ray)
                single = again.sun_i + again.sun_ground
            source[node] += mean * single
            if i == 0:
                source[n_nodes + j] += down * single
            before = 0.0
            for k in range(totals.n_pieces):
                weight = pieces[k, SCATTERED] - before
                before = pieces[k, SCATTERED]
                if integrated:
                    # of exp(-t) over a piece of the depth x, beside x times its value in the middle
                    passed = -math.log(max(1e-30, totals.transmittance))
                    if k + 1 < totals.n_pieces:
                        passed = pieces[k + 1, DEPTH]
                    half = 0.5 * (passed - pieces[k, DEPTH])
                    if 1e-6 < half < 1.0:
                        weight *= math.sinh(half) / half
                s = pieces[k, START] + 0.5 * pieces[k, LENGTH]
                z = altitude_at(altitude_km[i], r, up, s)
                cos_sun = (r * sz + s * (importance.centre[i, d, 0] * sx + up * sz)) / (air.earth_radius_km + z)
                cos_sun = min(1.0, max(-1.0, cos_sun))
                ia, fa = altitude_index(importance, z)
                ja, ga = sun_index(importance.cos_sun, importance.hint, cos_sun)
                for a in range(2):
                    for b in range(2):
                        fraction_of_node = (fa if a else 1.0 - fa) * (ga if b else 1.0 - ga)
                        column = (ia + a) * n_sun + ja + b
                        kernel[node, column] += mean * weight * fraction_of_node
                        if i == 0:
                            kernel[n_nodes + j, column] += down * weight * fraction_of_node
            reflectance = air.ground_albedo[w]
            if totals.ground_km >= 0.0 and reflectance > 0.0:
                s = totals.ground_km
                cos_sun = (r * sz + s * (importance.centre[i, d, 0] * sx + up * sz)) / (
                    air.earth_radius_km + altitude_km[0]
                )
                ja, ga = sun_index(importance.cos_sun, importance.hint, min(1.0, max(-1.0, cos_sun)))
                reflected = mean * totals.transmittance * reflectance / math.pi
                kernel[node, n_nodes + ja] += reflected * (1.0 - ga)
                kernel[node, n_nodes + ja + 1] += reflected * ga


@njit(cache=True, nogil=True)
def _sweep(air, sun, importance, w, stop, radiance, first, end):
    """Diffuse radiance at nodes from every cell's centre: sunlight plus the light of the tables.

    stop (1,): no node is begun once it is not 0; radiance (A, Z, D) [sr^-1]: filled; first, end: the first node and the
    one after the last.
    """
    leg = new_leg(air.table.shape[2] - SPECIES, LEG_PIECES, 1)
    ray = np.empty(CHORD_COLUMNS)
    to_sun = np.zeros(3)
    stream = np.zeros(1, dtype=np.uint64)
    for node in range(first, end):
        if stop[0] != 0:
            break
        i, j = _to_node(importance, node, to_sun)
        for d in range(N_DIRECTIONS):
            azimuth = d % N_AZIMUTHS
            if azimuth >= N_AZIMUTHS // 2:
                radiance[i, j, d] = radiance[i, j, d - 2 * azimuth + N_AZIMUTHS - 1]
                continue
            totals = _leg_from_node(air, sun, importance, w, LEG_OPTIONS, to_sun, i, d, stream, leg, ray)
            radiance[i, j, d] = totals.sun_i + totals.sun_ground + rescattered_light(leg, totals)
