"""The first order: sunlight that air and aerosol scatter once, with exact scattering angles."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from twilight.kernels import njit
from twilight.lanes import LANES, exp, read, same, write
from twilight.solvers.zones.passes import ONE, ZERO
from twilight.solvers.zones.sunlight import N_ANGLE


class Beams(NamedTuple):
    """Sunlight for the points of rays, for one block of wavelengths; A altitudes of the table of the beam.

    row (P,), share (P,): place of each point between these altitudes; edge_rad (A,): solar zenith angle of the shadow's
    edge; span_rad: of the table; log_light (A, N_ANGLE + 1, LANES), log_ground (N_ANGLE + 1, LANES): as in `Sunlight`.
    """

    row: np.ndarray
    share: np.ndarray
    edge_rad: np.ndarray
    span_rad: float
    log_light: np.ndarray
    log_ground: np.ndarray


class Scattered(NamedTuple):
    """How each species turns sunlight into the nodes' directions.

    p11, p12 (N, S, LANES): elements of the scaled phase matrices at N cosines of the scattering angle from -1 to 1
    angle (Z, M, T, F): place among these cosines; turn (Z, M, T, F, 2): cosine and sine of twice the angle from the
    vertical to the scattering plane; p12 and turn are empty without polarisation.
    """

    p11: np.ndarray
    p12: np.ndarray
    angle: np.ndarray
    turn: np.ndarray


@njit(cache=True, nogil=True, fastmath={"contract", "nsz"})
def scatter_sunlight(
    rays_first, point, turning, beams, scattered, ground_weight, ground_angle, ground_factor, n_polar, out, begin, end
):  # fmt: skip
    """Stokes parameters out[node, polar, zenith, azimuth, I Q U, LANES] of sunlight scattered once.

    rays_first, point, turning, ground_weight, ground_angle, n_polar, begin, end: as in `passes.scatter`
    beams: `Beams`; scattered: `Scattered`; ground_factor (LANES,): albedo / pi
    """
    n_zenith, n_azimuth, n_stokes = out.shape[2], out.shape[3], out.shape[4]
    n_species = point.share.shape[1]
    share, log_light = point.share, beams.log_light
    of_ray = np.zeros((n_zenith, n_azimuth, n_species, LANES), np.float32)
    of_ray_12 = np.zeros((n_zenith, n_azimuth, n_species, LANES) if n_stokes > 1 else (1, 1, 1, LANES), np.float32)
    last = turning.shape[0] - 2
    scale = np.float32(N_ANGLE / math.sqrt(beams.span_rad))
    for node in range(begin, end):
        for i in range(n_polar):
            ray = node * n_polar + i
            look_up(scattered.p11, scattered.angle[node, i], of_ray)
            if n_stokes > 1:
                look_up(scattered.p12, scattered.angle[node, i], of_ray_12)
            for k in range(rays_first[ray], rays_first[ray + 1]):
                row = beams.row[k]
                f = beams.share[k]
                g = ONE - f
                shadow = g * np.float32(beams.edge_rad[row]) + f * np.float32(beams.edge_rad[row + 1])
                place = point.angle[k]
                step = min(int(place), last)
                h1 = place - np.float32(step)
                h0 = ONE - h1
                strength = read(point.weight, k)
                for t in range(n_zenith):
                    for a in range(n_azimuth):
                        inside = shadow - (h0 * turning[step, t, a, 2] + h1 * turning[step + 1, t, a, 2])
                        if inside < ZERO:
                            continue
                        x = scale * math.sqrt(inside)
                        j = min(int(x), N_ANGLE - 1)
                        b1 = x - np.float32(j)
                        b0 = ONE - b1
                        low = b0 * read(log_light, (row, j)) + b1 * read(log_light, (row, j + 1))
                        high = b0 * read(log_light, (row + 1, j)) + b1 * read(log_light, (row + 1, j + 1))
                        light = strength * exp(g * low + f * high)
                        source = same(ZERO)
                        for s in range(n_species):
                            source += read(share, (k, s)) * read(of_ray, (t, a, s))
                        write(out, (node, i, t, a, 0), read(out, (node, i, t, a, 0)) + light * source)
                        if n_stokes > 1:
                            source = same(ZERO)
                            for s in range(n_species):
                                source += read(share, (k, s)) * read(of_ray_12, (t, a, s))
                            light = light * source
                            of_q, of_u = scattered.turn[node, i, t, a, 0], scattered.turn[node, i, t, a, 1]
                            write(out, (node, i, t, a, 1), read(out, (node, i, t, a, 1)) + of_q * light)
                            write(out, (node, i, t, a, 2), read(out, (node, i, t, a, 2)) + of_u * light)
            if ground_weight[ray].max() > ZERO:
                add_sunlit_ground(turning, ground_angle[ray], beams, ground_weight, ray, ground_factor, out[node, i])


@njit(cache=True, nogil=True)
def look_up(table, angle, out):
    """Values out (T, F, S, LANES) of a table (N, S, LANES) at places angle (T, F), linearly."""
    for t in range(out.shape[0]):
        for a in range(out.shape[1]):
            x = angle[t, a]
            j = min(int(x), table.shape[0] - 2)
            b1 = x - np.float32(j)
            for s in range(out.shape[2]):
                write(out, (t, a, s), (ONE - b1) * read(table, (j, s)) + b1 * read(table, (j + 1, s)))


@njit(inner=True, cache=True, nogil=True)
def add_sunlit_ground(turning, place, beams, transmittance, ray, ground_factor, sums):
    """Sunlight that the Lambertian ground sends back at the end of a ray, added to I in sums (T, F, Stokes, LANES).

    turning (N, T, F, 3): as in `Turning`; beams: `Beams`; transmittance (R, LANES): of all rays; place: in the turning
    table, ground_factor: as in `scatter_sunlight`.
    """
    step = min(int(place), turning.shape[0] - 2)
    log_ground = beams.log_ground
    reflected = read(transmittance, ray) * read(ground_factor, ())
    h1 = place - np.float32(step)
    scale = np.float32(N_ANGLE / math.sqrt(beams.span_rad))
    for t in range(sums.shape[0]):
        for a in range(sums.shape[1]):
            inside = np.float32(beams.edge_rad[0]) - (
                (ONE - h1) * turning[step, t, a, 2] + h1 * turning[step + 1, t, a, 2]
            )
            if inside < ZERO:
                continue
            x = scale * math.sqrt(inside)
            j = min(int(x), N_ANGLE - 1)
            b1 = x - np.float32(j)
            light = exp((ONE - b1) * read(log_ground, j) + b1 * read(log_ground, j + 1))
            write(sums, (t, a, 0), read(sums, (t, a, 0)) + reflected * light)
