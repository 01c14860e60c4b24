"""The first order of scattering: sunlight scattered once by air and aerosol, at exact scattering angles."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from twilight.jit.kernels import njit
from twilight.jit.simd import LANES, broadcast, exp, load, store
from twilight.solvers.zones.next_order import ONE, ZERO
from twilight.solvers.zones.ray_points import ZENITH
from twilight.solvers.zones.sunlight import N_ANGLE


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


@njit(cache=True, nogil=True)
def interpolate_phase(table, angle, out):
    """Values out (T, F, S, LANES) of a table (N, S, LANES) at fractional indices angle (T, F), linearly."""
    for t in range(out.shape[0]):
        for a in range(out.shape[1]):
            x = angle[t, a]
            j = min(int(x), table.shape[0] - 2)
            b1 = x - np.float32(j)
            for s in range(out.shape[2]):
                store(out, (t, a, s), (ONE - b1) * load(table, (j, s)) + b1 * load(table, (j + 1, s)))


@njit(inner=True, cache=True, nogil=True)
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
