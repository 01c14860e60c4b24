"""The first order of scattering: sunlight scattered once by air and aerosol, at exact scattering angles.

The direct beam is tabulated over altitude and, at every altitude, by the angle to the edge of the Earth's shadow, which
is where it is sharp; interpolation is linear in its logarithm and never mixes light with shadow.
"""

import math
from functools import partial
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from twilight.base.threads import in_slices
from twilight.jit.kernels import njit
from twilight.jit.simd import LANES, broadcast, exp, load, store
from twilight.solvers.zones import constants as tuned
from twilight.solvers.zones.next_order import ONE, ZERO
from twilight.solvers.zones.ray_points import ZENITH
from twilight.transport.beam import Beam, beam_at, beam_on_ground, lit_at

LEAST_LOG_LIGHT = np.float32(-690.0)
"""ln(irradiance over F0) that counts as no light."""
N_ANGLE = 1280
"""Number of intervals of the angle to the shadow's edge: 0.01 deg where light that grazes a hazy layer changes by e
within 0.05 deg."""
NEAR_ANGLES, EVERY_ANGLE = 320, 4
"""Number of these angles, to 11 deg from the edge, within which rays graze layers; beyond, the beam is looked up at
every fourth alone: cubics between these move no sky by 0.001 %."""
BELOW_JUMP_KM = 1e-7
"""Distance [km] below a jump of the air at which the table has the jump's lower side."""


class Sunlight(NamedTuple):
    """The direct beam on a grid: altitude_km (A,), doubled at a jump of the air; edge_rad (A,): solar zenith angle of
    the shadow's edge.

    log_light (A, N_ANGLE + 1, W): logarithm of the beam's irradiance over F0 at the angle span_rad (j/N_ANGLE)^2
    inside the edge; ground (N_ANGLE + 1, W): logarithm of the irradiance on the horizontal ground.
    """

    altitude_km: np.ndarray
    edge_rad: np.ndarray
    log_light: np.ndarray
    ground: np.ndarray
    span_rad: float


@njit(cache=True, nogil=True)
def _fill(beam, altitude, span, edge, log_light, ground, begin, end):
    """Fill edge (Z,) [rad], log_light (Z, angles, W) and ground (angles, W) for the altitudes begin..end.

    beam: `Beam`; altitude (Z,) [km]; span [rad]: of the angles from the shadow's edge.
    """
    n_w = log_light.shape[2]
    light = np.empty(n_w)
    for k in range(begin, end):
        z = altitude[k]
        low, high = 0.5 * math.pi, math.pi
        for _ in range(48):
            middle = 0.5 * (low + high)
            if lit_at(beam, z, math.cos(middle)):
                low = middle
            else:
                high = middle
        edge[k] = low
        for j in range(N_ANGLE + 1):
            if j > NEAR_ANGLES and j % EVERY_ANGLE:
                continue
            angle = max(0.0, low - span * (j / N_ANGLE) ** 2)
            beam_at(beam, z, math.cos(angle), light)
            for w in range(n_w):
                log_light[k, j, w] = max(LEAST_LOG_LIGHT, math.log(max(light[w], 1e-300)))
            if k == 0:
                beam_on_ground(beam, z, math.cos(angle), light)
                for w in range(n_w):
                    ground[j, w] = max(LEAST_LOG_LIGHT, math.log(max(light[w], 1e-300)))
        _fill_between(log_light[k])
        if k == 0:
            _fill_between(ground)


@njit(inner=True, cache=True, makes_arrays=False)
def _fill_between(table):
    """Fill the rows of a table (angles, W) between those at every EVERY_ANGLE-th angle, by cubics that stay between
    the rows on both sides."""
    for j in range(NEAR_ANGLES, N_ANGLE, EVERY_ANGLE):
        before, after = j - EVERY_ANGLE, min(N_ANGLE, j + 2 * EVERY_ANGLE)
        for n in range(1, EVERY_ANGLE):
            s = n / EVERY_ANGLE
            bend = s * (1.0 - s) / 6.0
            for w in range(table.shape[1]):
                low, high = table[j, w], table[j + EVERY_ANGLE, w]
                value = low + s * (high - low)
                value -= bend * ((2.0 - s) * (table[before, w] - 2.0 * low + high))
                value -= bend * ((1.0 + s) * (low - 2.0 * high + table[after, w]))
                table[j + n, w] = max(min(low, high), min(max(low, high), value))


def table_altitudes(node_km: np.ndarray, jumps_km: np.ndarray) -> np.ndarray:
    """Altitudes [km] of the table: MIN_SUNLIT_ROWS in every interval of the field's nodes, more in a long one.

    Nodes crowd where the air is layered, and there the grazing beam's logarithm bends most.  A jump is doubled.
    """
    rows = []
    for a, b in pairwise(node_km):
        longest = tuned.MAX_SUNLIT_STEP_KM + tuned.SUNLIT_STEP_GROWTH * (a - node_km[0])
        rows.append(np.linspace(a, b, max(tuned.MIN_SUNLIT_ROWS, math.ceil((b - a) / longest)), endpoint=False))
    # a value on a jump is the one above it: stay just below
    return np.sort(np.concatenate([*rows, jumps_km - BELOW_JUMP_KM, node_km[-1:] - BELOW_JUMP_KM]))


def make_sunlight(beam: Beam, node_km: np.ndarray, jumps_km: np.ndarray) -> Sunlight:
    """Tabulate `beam` for a field with these node altitudes, of which some are jumps of the air."""
    altitude = table_altitudes(node_km, jumps_km)
    n_w = beam.n_wavelengths
    edge = np.empty(altitude.size)
    log_light = np.empty((altitude.size, N_ANGLE + 1, n_w), np.float32)
    ground = np.empty((N_ANGLE + 1, n_w), np.float32)
    span = math.pi
    in_slices(partial(_fill, beam, altitude, span, edge, log_light, ground), altitude.size)
    return Sunlight(altitude, edge, log_light, ground, span)


class BeamAtPoints(NamedTuple):
    """Sunlight at the points of rays, for one block of wavelengths; the table of the beam has A altitudes.

    row (P,), fraction (P,): the altitude below each point and the fraction of the way to the next; edge_rad (A,): solar
        zenith angle of the shadow's edge; span_rad: of the table; log_light (A, N_ANGLE + 1, LANES), log_ground
        (N_ANGLE + 1, LANES): as in `Sunlight`.
    """

    row: np.ndarray
    fraction: np.ndarray
    edge_rad: np.ndarray
    span_rad: float
    log_light: np.ndarray
    log_ground: np.ndarray


class PhaseTables(NamedTuple):
    """How each species scatters sunlight into the nodes' directions.

    p11, p12 (N, S, LANES): elements of the scaled phase matrices at N cosines of the scattering angle from -1 to 1
    angle (Z, M, T, F): fractional index among these cosines; rotation (Z, M, T, F, 2): cosine and sine of twice the
    angle from the vertical to the scattering plane; p12 and rotation are empty without polarisation.
    """

    p11: np.ndarray
    p12: np.ndarray
    angle: np.ndarray
    rotation: np.ndarray


@njit(cache=True, nogil=True, fastmath={"contract", "nsz"})
def scatter_sunlight(rays, point, beams, phases, ground_factor, out, begin, end):
    """Stokes parameters out[node, polar, zenith, azimuth, I Q U, LANES] of sunlight scattered once, for node altitudes
    begin..end.

    rays: `NodeRays`; point: `SunlitRayPoints`; beams: `BeamAtPoints`; phases: `PhaseTables`; ground_factor (LANES,):
    albedo / pi
    """
    n_polar, n_zenith, n_azimuth, n_stokes = out.shape[1], out.shape[2], out.shape[3], out.shape[4]
    geometry = rays.geometry
    n_species = point.fraction.shape[1]
    fraction, log_light = point.fraction, beams.log_light
    of_ray = np.zeros((n_zenith, n_azimuth, n_species, LANES), np.float32)
    of_ray_12 = np.zeros((n_zenith, n_azimuth, n_species, LANES) if n_stokes > 1 else (1, 1, 1, LANES), np.float32)
    last = geometry.shape[0] - 2
    scale = np.float32(N_ANGLE / math.sqrt(beams.span_rad))
    for node in range(begin, end):
        for i in range(n_polar):
            ray = node * n_polar + i
            interpolate_phase(phases.p11, phases.angle[node, i], of_ray)
            if n_stokes > 1:
                interpolate_phase(phases.p12, phases.angle[node, i], of_ray_12)
            for k in range(rays.first[ray], rays.first[ray + 1]):
                row = beams.row[k]
                f = beams.fraction[k]
                g = ONE - f
                shadow = g * np.float32(beams.edge_rad[row]) + f * np.float32(beams.edge_rad[row + 1])
                place = point.angle[k]
                step = min(int(place), last)
                h1 = place - np.float32(step)
                h0 = ONE - h1
                strength = load(point.weight, k)
                for t in range(n_zenith):
                    for a in range(n_azimuth):
                        inside = shadow - (h0 * geometry[step, t, a, ZENITH] + h1 * geometry[step + 1, t, a, ZENITH])
                        if inside < ZERO:
                            continue
                        x = scale * math.sqrt(inside)
                        j = min(int(x), N_ANGLE - 1)
                        b1 = x - np.float32(j)
                        b0 = ONE - b1
                        low = b0 * load(log_light, (row, j)) + b1 * load(log_light, (row, j + 1))
                        high = b0 * load(log_light, (row + 1, j)) + b1 * load(log_light, (row + 1, j + 1))
                        light = strength * exp(g * low + f * high)
                        source = broadcast(ZERO)
                        for s in range(n_species):
                            source += load(fraction, (k, s)) * load(of_ray, (t, a, s))
                        store(out, (node, i, t, a, 0), load(out, (node, i, t, a, 0)) + light * source)
                        if n_stokes > 1:
                            source = broadcast(ZERO)
                            for s in range(n_species):
                                source += load(fraction, (k, s)) * load(of_ray_12, (t, a, s))
                            light = light * source
                            of_q, of_u = phases.rotation[node, i, t, a, 0], phases.rotation[node, i, t, a, 1]
                            store(out, (node, i, t, a, 1), load(out, (node, i, t, a, 1)) + of_q * light)
                            store(out, (node, i, t, a, 2), load(out, (node, i, t, a, 2)) + of_u * light)
            if rays.ground_weight[ray].max() > ZERO:
                add_sunlit_ground(rays, ray, beams, ground_factor, out[node, i])


@njit(inner=True, cache=True, makes_arrays=False)
def interpolate_phase(table, angle, out):
    """Values out (T, F, S, LANES) of a table (N, S, LANES) at fractional indices angle (T, F), linearly."""
    for t in range(out.shape[0]):
        for a in range(out.shape[1]):
            x = angle[t, a]
            j = min(int(x), table.shape[0] - 2)
            b1 = x - np.float32(j)
            for s in range(out.shape[2]):
                store(out, (t, a, s), (ONE - b1) * load(table, (j, s)) + b1 * load(table, (j + 1, s)))


@njit(inner=True, cache=True, nogil=True, makes_arrays=False)
def add_sunlit_ground(rays, ray, beams, ground_factor, sums):
    """Sunlight that the Lambertian ground sends back at the end of a ray, added to I in sums (T, F, Stokes, LANES).

    rays, beams, ground_factor: as in `scatter_sunlight`; ray: index of the ray.
    """
    geometry, place = rays.geometry, rays.ground_place[ray]
    step = min(int(place), geometry.shape[0] - 2)
    log_ground = beams.log_ground
    reflected = load(rays.ground_weight, ray) * load(ground_factor, ())
    h1 = place - np.float32(step)
    scale = np.float32(N_ANGLE / math.sqrt(beams.span_rad))
    for t in range(sums.shape[0]):
        for a in range(sums.shape[1]):
            inside = np.float32(beams.edge_rad[0]) - (
                (ONE - h1) * geometry[step, t, a, ZENITH] + h1 * geometry[step + 1, t, a, ZENITH]
            )
            if inside < ZERO:
                continue
            x = scale * math.sqrt(inside)
            j = min(int(x), N_ANGLE - 1)
            b1 = x - np.float32(j)
            light = exp((ONE - b1) * load(log_ground, j) + b1 * load(log_ground, j + 1))
            store(sums, (t, a, 0), load(sums, (t, a, 0)) + reflected * light)
