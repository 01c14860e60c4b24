"""A coarse solution of the light field that tells paths where the light is; it changes the noise, never the mean.

The field of a spherical atmosphere in a parallel beam depends on altitude and local solar zenith angle only, so one
small table serves every observer and every sun.  `coarse.py` fills it.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit

from twilight.solvers.montecarlo.air import N_SAMPLING, N_SMOOTH, SPECIES, Air, interpolate
from twilight.solvers.montecarlo.random import uniform

N_ALTITUDES = 20
N_HINTS = 4096
DARK = -80.0
SUN_ZENITH_DEG = np.concatenate(
    [
        [0.0, 25.0, 40.0, 52.0, 61.0, 68.0, 74.0, 78.0, 81.0, 84.0, 86.0, 87.5],
        np.arange(89.0, 112.0, 1.0),
        np.arange(112.0, 132.1, 2.0),
        [140.0, 155.0, 180.0],
    ]
)
ELEVATION_EDGES_DEG = np.array([-90.0, -40.0, -16.0, -8.0, -3.0, 0.0, 3.0, 8.0, 16.0, 30.0, 52.0, 90.0])
N_AZIMUTHS = 12
N_DIRECTIONS = (ELEVATION_EDGES_DEG.size - 1) * N_AZIMUTHS


class Steering(NamedTuple):
    """Tables over A altitudes, Z cosines of the local solar zenith angle, D directions of the local sky.

    log_light (W, A, Z): logarithm of the mean diffuse radiance [sr^-1]; log_ground (W, Z): of the diffuse downward
    irradiance at the ground; log_radiance (W, A, Z, D): of the diffuse radiance; share (W, A, Z, D): radiance times
    solid angle, sums to 1.  Directions are cells of elevation and azimuth from the sun: centre (D, 3) in the frame
    (towards the sun, sideways, up), solid_angle (D,).
    """

    bottom_km: float
    depth_km: float
    cos_sun: np.ndarray
    hint: np.ndarray
    log_light: np.ndarray
    log_ground: np.ndarray
    log_radiance: np.ndarray
    share: np.ndarray
    sine_edges: np.ndarray
    centre: np.ndarray
    solid_angle: np.ndarray


def empty_steering(air: Air) -> Steering:
    """Tables that know of no light: every event is drawn by transmittance and scattering alone."""
    n_wavelengths = air.table.shape[0]
    cos_sun = np.sort(np.cos(np.radians(SUN_ZENITH_DEG)))
    sine = np.sin(np.radians(ELEVATION_EDGES_DEG))
    middle = 0.5 * (sine[1:] + sine[:-1])
    azimuth = 2 * np.pi * (np.arange(N_AZIMUTHS) + 0.5) / N_AZIMUTHS
    level = np.sqrt(1 - middle**2)
    centre = np.stack(
        [
            (level[:, None] * np.cos(azimuth)).ravel(),
            (level[:, None] * np.sin(azimuth)).ravel(),
            np.repeat(middle, N_AZIMUTHS),
        ],
        axis=-1,
    )
    solid_angle = np.repeat(np.diff(sine) * 2 * np.pi / N_AZIMUTHS, N_AZIMUTHS)
    shape = (n_wavelengths, N_ALTITUDES, cos_sun.size)
    starts = -1 + 2 * np.arange(N_HINTS) / N_HINTS
    return Steering(
        float(air.shell_km[0]),
        float(air.shell_km[-1] - air.shell_km[0]),
        cos_sun,
        np.clip(np.searchsorted(cos_sun, starts, side="right") - 1, 0, cos_sun.size - 2).astype(np.int64),
        np.full(shape, DARK),
        np.full((n_wavelengths, cos_sun.size), DARK),
        np.full((*shape, N_DIRECTIONS), DARK, dtype=np.float32),
        np.broadcast_to((solid_angle / (4 * np.pi)).astype(np.float32), (*shape, N_DIRECTIONS)).copy(),
        sine,
        np.ascontiguousarray(centre),
        solid_angle,
    )


def altitudes(steering: Steering) -> np.ndarray:
    """Altitudes [km] of the tables: quadratic, dense at the ground."""
    return steering.bottom_km + steering.depth_km * np.linspace(0.0, 1.0, N_ALTITUDES) ** 2


@njit(cache=True, inline="always")
def altitude_index(steering, z):
    """(i, fraction) of an altitude in the tables."""
    x = math.sqrt(max(0.0, (z - steering.bottom_km) / steering.depth_km)) * (N_ALTITUDES - 1)
    i = min(int(x), N_ALTITUDES - 2)
    return i, min(1.0, x - i)


@njit(cache=True, inline="always")
def sun_index(steering, cos_sun):
    """(i, fraction) of the cosine of the local solar zenith angle in the tables."""
    nodes = steering.cos_sun
    j = steering.hint[min(N_HINTS - 1, int((cos_sun + 1.0) * (0.5 * N_HINTS)))]
    while j < nodes.size - 2 and nodes[j + 1] < cos_sun:
        j += 1
    return j, (cos_sun - nodes[j]) / (nodes[j + 1] - nodes[j])


@njit(cache=True, inline="always")
def log_mean_light(steering, w, z, cos_sun):
    """Logarithm of the mean diffuse radiance [sr^-1] at a point."""
    i, a = altitude_index(steering, z)
    j, b = sun_index(steering, cos_sun)
    t = steering.log_light
    return (t[w, i, j] * (1 - b) + t[w, i, j + 1] * b) * (1 - a) + (
        t[w, i + 1, j] * (1 - b) + t[w, i + 1, j + 1] * b
    ) * a


@njit(cache=True, inline="always")
def log_ground_light(steering, w, cos_sun):
    """Logarithm of the diffuse irradiance on the ground."""
    j, b = sun_index(steering, cos_sun)
    return steering.log_ground[w, j] * (1 - b) + steering.log_ground[w, j + 1] * b


@njit(cache=True)
def log_light_from(steering, w, z, cos_sun, cell):
    """Logarithm of the diffuse radiance [sr^-1] from one cell of directions."""
    i, a = altitude_index(steering, z)
    j, b = sun_index(steering, cos_sun)
    t = steering.log_radiance
    lower = t[w, i, j, cell] * (1 - b) + t[w, i, j + 1, cell] * b
    upper = t[w, i + 1, j, cell] * (1 - b) + t[w, i + 1, j + 1, cell] * b
    return lower * (1 - a) + upper * a


@njit(cache=True)
def cell_of(steering, x, y, z):
    """Cell of directions that holds a unit vector of the local frame."""
    e = 0
    n = steering.sine_edges.size - 1
    while e < n - 1 and steering.sine_edges[e + 1] < z:
        e += 1
    turn = math.atan2(y, x) / (2.0 * math.pi)
    if turn < 0.0:
        turn += 1.0
    return e * N_AZIMUTHS + min(N_AZIMUTHS - 1, int(turn * N_AZIMUTHS))


@njit(cache=True)
def pick_node(steering, z, cos_sun, stream):
    """A table node near a point, drawn so that the mean over draws is linear interpolation."""
    i, a = altitude_index(steering, z)
    j, b = sun_index(steering, cos_sun)
    if uniform(stream) < a:
        i += 1
    if uniform(stream) < b:
        j += 1
    return i, j


@njit(cache=True)
def weigh_cells(steering, air, w, node_i, node_j, air_i, air_f, vx, vy, vz, on_ground, cumulative):
    """Running sums over the cells of share x blurred phase function (x cosine on the ground); returns the total.

    (vx, vy, vz) is the leg's direction in the local frame, (air_i, air_f) where in the air the event happens.
    """
    total = 0.0
    if on_ground:
        for d in range(N_DIRECTIONS):
            up = steering.centre[d, 2]
            if up > 0.0:
                total += steering.share[w, node_i, node_j, d] * up
            cumulative[d] = total
        return total
    n_species = air.table.shape[2] - SPECIES
    for d in range(N_DIRECTIONS):
        cosine = vx * steering.centre[d, 0] + vy * steering.centre[d, 1] + vz * steering.centre[d, 2]
        cell = min(N_SMOOTH - 1, max(0, int((cosine + 1.0) * (0.5 * N_SMOOTH))))
        p = 0.0
        if air.isotropic_events:
            p = 1.0
        else:
            for c in range(n_species):
                beta = interpolate(air, w, air_i, air_f, SPECIES + c)
                if beta > 0.0:
                    p += beta * air.smooth[w, c, cell]
        total += steering.share[w, node_i, node_j, d] * p
        cumulative[d] = total
    return total


@njit(cache=True, inline="always")
def draw_from(cumulative, x):
    """First index whose running sum exceeds x."""
    lo = 0
    hi = cumulative.size - 1
    while lo < hi:
        mid = (lo + hi) // 2
        if cumulative[mid] > x:
            hi = mid
        else:
            lo = mid + 1
    return lo


@njit(cache=True, inline="always")
def sampling_cell(cosine):
    """Cell of the sampling tables of `air` that holds a cosine."""
    x = math.sqrt(math.sqrt(max(0.0, 0.5 * (1.0 - cosine))))
    return min(N_SAMPLING - 1, int(x * N_SAMPLING))
