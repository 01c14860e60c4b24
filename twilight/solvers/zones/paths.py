"""Rays from every node altitude in every polar angle, as points: made once, used for every sun, azimuth and order.

Altitude, zenith angle and transmittance along a ray do not depend on where the sun is.  What depends on it is the solar
zenith angle and the azimuth at each point, which follow from the geocentric angle alone: they are tabulated once.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit

from twilight.atmosphere.medium import Medium
from twilight.solvers.zones.grid import Series, even_harmonics
from twilight.solvers.zones.polarised import MatrixMoments, patterns
from twilight.threads import in_slices
from twilight.transport.lines import GROUND, MAX_POINTS, Line, trace_line
from twilight.transport.profile import Profile

LANES = 8
"""Wavelengths that the inner loops take at once: one vector register."""


class Rays(NamedTuple):
    """first (R + 1,): where the points of each ray start; place (P, 4) as in `Line`; weight (P, W);
    ground_weight (R, W): transmittance to the ground, 0 for rays that miss it; ground_angle_rad (R,)."""

    first: np.ndarray
    place: np.ndarray
    weight: np.ndarray
    ground_weight: np.ndarray
    ground_angle_rad: np.ndarray


@njit(cache=True, nogil=True)
def _trace(
    profile, gradient, jumps, altitude, cosine, fineness, first, place, weight, store, ground, angle, begin, end
):
    n_w = profile.extinction.shape[1]
    line = Line(np.empty((MAX_POINTS, 4)), np.empty((MAX_POINTS, n_w)), np.empty(n_w), np.empty(2))
    for r in range(begin, end):
        n, status = trace_line(profile, gradient, jumps, altitude[r], cosine[r], fineness, line)
        if not store:
            first[r + 1] = n
            continue
        at = first[r]
        for k in range(n):
            for c in range(4):
                place[at + k, c] = line.place[k, c]
            for w in range(n_w):
                weight[at + k, w] = line.weight[k, w]
        angle[r] = line.end[0]
        for w in range(n_w):
            ground[r, w] = line.transmittance[w] if status == GROUND else 0.0


def trace_rays(
    profile: Profile,
    gradient: np.ndarray,
    jumps: np.ndarray,
    altitude_km: np.ndarray,
    cosine: np.ndarray,
    fineness: float,
) -> Rays:
    """Rays that start at `altitude_km` (R,) under `cosine` (R,): traced twice, to count and to keep."""
    n_rays, n_w = altitude_km.size, profile.extinction.shape[1]
    first = np.zeros(n_rays + 1, np.int64)
    ground, angle = np.zeros((n_rays, n_w)), np.zeros(n_rays)

    def trace(place, weight, store):
        in_slices(
            lambda begin, end: _trace(
                profile, gradient, jumps, altitude_km, cosine, fineness, first, place, weight, store, ground, angle,
                begin, end,
            ),
            n_rays,
        )  # fmt: skip

    trace(np.empty((1, 4)), np.empty((1, n_w)), False)
    np.cumsum(first, out=first)
    place, weight = np.empty((first[-1], 4)), np.empty((first[-1], n_w))
    trace(place, weight, True)
    return Rays(first, place, weight, ground, angle)


def lanes_of(array: np.ndarray, block: int) -> np.ndarray:
    """Wavelengths of one block of LANES along the last axis, float32; the last one is repeated to fill it."""
    index = np.minimum(np.arange(block * LANES, (block + 1) * LANES), array.shape[-1] - 1)
    return np.ascontiguousarray(array[..., index], dtype=np.float32)


class Points(NamedTuple):
    """The points of rays for the inner loops, for one block of wavelengths; P points, C harmonics, C' patterns.

    node (P,), node_share (P,): node altitude below and the way to the next; angle (P,): place in the turning table
    polar (P, C): harmonics at the ray's local zenith angle; highest (P,): largest order that matters there
    chi (P, degree + 1, LANES): phase moments of the mixture; share (P, S, LANES): of each species in scattering
    weight (P, LANES): scattering coefficient x transmittance x length
    even, odd (P, C'): patterns of Q and U at the same zenith angle; matrix (P, 3, pattern_degree + 1, LANES): moments
    b, even and odd of the mixture's phase matrix.  Both are empty without polarisation.
    """

    node: np.ndarray
    node_share: np.ndarray
    angle: np.ndarray
    polar: np.ndarray
    highest: np.ndarray
    chi: np.ndarray
    share: np.ndarray
    weight: np.ndarray
    even: np.ndarray
    odd: np.ndarray
    matrix: np.ndarray


class Scattering(NamedTuple):
    """What scaled air and aerosol do to each degree: chi (1 + K, degree + 1, W) of I, and of the phase matrices."""

    medium: Medium
    chi: np.ndarray
    matrix: MatrixMoments


def make_points(
    rays: Rays, scattering: Scattering, nodes_km: np.ndarray, step_rad: float, series: Series, block: int
) -> Points:
    """scattering: of the scaled medium; step_rad: of the geocentric angles of the turning table."""
    z = rays.place[:, 0]
    node = np.clip(np.searchsorted(nodes_km, z, side="right") - 1, 0, nodes_km.size - 2)
    share = np.clip((z - nodes_km[node]) / np.diff(nodes_km)[node], 0.0, 1.0)
    species = species_share(scattering.medium, z)
    chi = np.einsum("spw,slw->plw", species, scattering.chi[:, : series.degree + 1])
    polar = even_harmonics(rays.place[:, 2], series.degree, series.orders - 1)
    sine = np.sqrt(np.maximum(0.0, 1.0 - rays.place[:, 2] ** 2))
    # sin^m: an order that is this weak cannot be seen
    highest = np.clip(np.ceil(np.log(1e-4) / np.log(np.clip(sine, 1e-6, 1.0 - 1e-12))), 1, series.orders - 1)
    n = series.pattern_degree
    even, odd = patterns(rays.place[:, 2], n, series.pattern_orders - 1)
    matrix = np.zeros((1, 3, 0, chi.shape[2]))
    if n:
        matrix = np.einsum("spw,jslw->pjlw", species, np.stack([part[:, : n + 1] for part in scattering.matrix]))
    return Points(
        node.astype(np.int32),
        share.astype(np.float32),
        (rays.place[:, 1] / step_rad).astype(np.float32),
        polar.astype(np.float32),
        highest.astype(np.int32),
        lanes_of(chi, block),
        lanes_of(species.transpose(1, 0, 2), block),
        lanes_of(rays.weight, block),
        np.ascontiguousarray(even, dtype=np.float32),
        np.ascontiguousarray(odd, dtype=np.float32),
        lanes_of(matrix, block),
    )


def species_share(medium: Medium, altitude_km: np.ndarray) -> np.ndarray:
    """Share (1 + K, P, W) of air and of each aerosol phase function in what is scattered at altitudes (P,)."""
    at = medium.at(altitude_km)
    species = np.concatenate([at.air_scattering[None], at.aerosol_scattering[None] * at.aerosol_share])
    total = species.sum(axis=0)
    share = np.where(total > 0, species / np.where(total > 0, total, 1.0), 0.0)
    share[0] = np.where(total > 0, share[0], 1.0)
    return share


class Turning(NamedTuple):
    """How solar zenith angle and azimuth turn along a ray: place (N, T, F, 3) float32 at geocentric angles
    n step_rad: coordinate on the fine grid of solar zenith angles, cosine of the azimuth from the sun, and the solar
    zenith angle [rad]; T starts x F azimuths."""

    place: np.ndarray
    step_rad: float


def make_turning(
    zenith_rad: np.ndarray, azimuth: np.ndarray, fine_rad: np.ndarray, longest_rad: float, n: int = 160
) -> Turning:
    step = longest_rad / (n - 2)
    psi = np.arange(n)[:, None, None] * step
    t, f = zenith_rad[None, :, None], azimuth[None, None, :]
    ahead = -np.sin(psi) * np.cos(t) + np.cos(psi) * np.sin(t) * np.cos(f)
    up = np.cos(psi) * np.cos(t) + np.sin(psi) * np.sin(t) * np.cos(f)
    side = np.sin(t) * np.sin(f)
    across = np.hypot(ahead, side)
    angle = np.arctan2(across, up)
    cosine = ahead / np.maximum(across, 1e-12)
    place = np.interp(angle, fine_rad, np.arange(fine_rad.size))
    return Turning(np.stack([place, cosine, angle], axis=-1).astype(np.float32), step)
