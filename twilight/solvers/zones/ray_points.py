"""Points of rays for the inner loops: made once, used for every sun, azimuth and order.

Altitude, zenith angle and transmittance along a ray do not depend on where the sun is.  What depends on it is the solar
zenith angle and the azimuth at each point, which follow from the geocentric angle alone: they are tabulated once.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from twilight.atmosphere.medium import Medium
from twilight.jit.simd import LANES
from twilight.solvers.zones import constants as tuned
from twilight.solvers.zones.angles import Truncation, even_harmonics, spin2_harmonics
from twilight.transport.lines import ALTITUDE, ANGLE, COSINE, RayBundle, species_fraction
from twilight.transport.profile import Profile
from twilight.transport.scaling import MatrixMoments, ScaledMedium, matrix_moments

POINTS_AT_ONCE = 8192
"""Points that are made at once: intermediate arrays take several times the memory of the result."""


def block_wavelengths(n: int, block: int) -> np.ndarray:
    """Indices (LANES,) of the wavelengths of a block among n; the last one is repeated to fill it."""
    return np.minimum(np.arange(block * LANES, (block + 1) * LANES), n - 1)


def block_values(array: np.ndarray, block: int) -> np.ndarray:
    """Values (..., LANES) at the wavelengths of a block from those at all, (..., W), as float32."""
    return np.ascontiguousarray(array[..., block_wavelengths(array.shape[-1], block)], dtype=np.float32)


class RayPoints(NamedTuple):
    """The points of rays for the inner loops, for one block of wavelengths; P points, C harmonics, C' spin-2 harmonics.

    node (P,), node_fraction (P,): node altitude below and the fraction of the way to the next; angle (P,): place in the
        geometry table
    polar (P, C): harmonics at the ray's local zenith angle; highest (P,): largest order that matters there
    chi (P, degree + 1, LANES): phase moments of the mixture
    weight (P, LANES): scattering coefficient x transmittance x length
    spin2_x, spin2_z (P, C'): polar parts X and Z of the spin-2 harmonics at the same zenith angle
    matrix (P, 3, spin2_degree + 1, LANES): moments b, even and odd of the mixture's phase matrix
    spin2_x, spin2_z and matrix are empty without polarisation.
    """

    node: np.ndarray
    node_fraction: np.ndarray
    angle: np.ndarray
    polar: np.ndarray
    highest: np.ndarray
    chi: np.ndarray
    weight: np.ndarray
    spin2_x: np.ndarray
    spin2_z: np.ndarray
    matrix: np.ndarray


class SpeciesMoments(NamedTuple):
    """Phase moments of scaled air and aerosol: chi (1 + K, degree + 1, W) of I, and those of the phase matrices;
    profile: how much of each there is."""

    profile: Profile
    chi: np.ndarray
    matrix: MatrixMoments

    @staticmethod
    def of(medium: Medium, scaled: ScaledMedium, profile: Profile, spin2_degree: int) -> SpeciesMoments:
        """Of a medium, its scaled air and its profile; spin2_degree: of the harmonics of Q and U, 0 for none."""
        matrix = matrix_moments(medium, scaled.forward_fraction, max(2, spin2_degree))
        return SpeciesMoments(profile, scaled.moments, matrix)


def make_ray_points(
    rays: RayBundle, scattering: SpeciesMoments, nodes_km: np.ndarray, step_rad: float, series: Truncation, block: int
) -> RayPoints:
    """scattering: of the scaled medium; step_rad: of the geocentric angles of the geometry table."""
    n_points = rays.place.shape[0]

    def of_piece(piece: slice) -> RayPoints:
        some = rays._replace(place=rays.place[piece], weight=rays.weight[piece])
        return _points(some, scattering, nodes_km, step_rad, series, block)

    first = of_piece(slice(0, POINTS_AT_ONCE))
    if n_points <= POINTS_AT_ONCE:
        return first
    # without polarisation there is no matrix of every point
    out = RayPoints(
        *(np.empty((n_points, *a.shape[1:]), a.dtype) if a.shape[0] == POINTS_AT_ONCE else a for a in first)
    )
    for start in range(0, n_points, POINTS_AT_ONCE):
        piece = slice(start, start + POINTS_AT_ONCE)
        for whole, part in zip(out, of_piece(piece) if start else first, strict=True):
            if whole.shape[0] == n_points:
                whole[piece] = part
    return out


def _points(
    rays: RayBundle, scattering: SpeciesMoments, nodes_km: np.ndarray, step_rad: float, series: Truncation, block: int
) -> RayPoints:
    z = rays.place[:, ALTITUDE]
    node = np.clip(np.searchsorted(nodes_km, z, side="right") - 1, 0, nodes_km.size - 2)
    fraction = np.clip((z - nodes_km[node]) / np.diff(nodes_km)[node], 0.0, 1.0)
    # of the wavelengths of the block alone: all of a field's would take several gigabytes
    some = slice(block * LANES, min((block + 1) * LANES, scattering.chi.shape[2]))
    species = species_fraction(scattering.profile, z, some)
    chi = np.einsum("spw,slw->plw", species, scattering.chi[:, : series.degree + 1, some])
    polar = even_harmonics(rays.place[:, COSINE], series.degree, series.azimuthal_orders - 1)
    sine = np.sqrt(np.maximum(0.0, 1.0 - rays.place[:, COSINE] ** 2))
    # sin^m: an order that is this weak cannot be seen
    highest = np.clip(np.ceil(np.log(1e-4) / np.log(np.clip(sine, 1e-6, 1.0 - 1e-12))), 1, series.azimuthal_orders - 1)
    n = series.spin2_degree
    spin2_x, spin2_z = spin2_harmonics(rays.place[:, COSINE], n, series.spin2_orders - 1)
    matrix = np.zeros((1, 3, 0, chi.shape[2]))
    if n:
        parts = np.stack([part[:, : n + 1, some] for part in scattering.matrix])
        matrix = np.einsum("spw,jslw->pjlw", species, parts)
    return RayPoints(
        node.astype(np.int32),
        fraction.astype(np.float32),
        (rays.place[:, ANGLE] / step_rad).astype(np.float32),
        polar.astype(np.float32),
        highest.astype(np.int32),
        block_values(chi, 0),
        block_values(rays.weight, block),
        np.ascontiguousarray(spin2_x, dtype=np.float32),
        np.ascontiguousarray(spin2_z, dtype=np.float32),
        block_values(matrix, 0),
    )


class SunlitRayPoints(NamedTuple):
    """What sunlight scattered once needs: angle (P,) and weight (P, LANES) as of `RayPoints`, and the fraction of each
    species in scattering (P, S, LANES)."""

    angle: np.ndarray
    fraction: np.ndarray
    weight: np.ndarray


def make_sunlit_points(rays: RayBundle, scattering: SpeciesMoments, step_rad: float, block: int) -> SunlitRayPoints:
    """Points of rays through the LANES wavelengths of a block; step_rad: as in `make_ray_points`."""
    some = slice(block * LANES, min((block + 1) * LANES, scattering.chi.shape[2]))
    species = species_fraction(scattering.profile, rays.place[:, ALTITUDE], some)
    return SunlitRayPoints(
        (rays.place[:, ANGLE] / step_rad).astype(np.float32),
        block_values(species.transpose(1, 0, 2), 0),
        block_values(rays.weight, 0),
    )


PLACE, COS_AZIMUTH, ZENITH = range(3)
"""Last axis of `RayGeometry.place`."""


class RayGeometry(NamedTuple):
    """Solar zenith angle and azimuth along rays that start at T nodes in F azimuths.

    place (N, T, F, 3) float32 at geocentric angles n step_rad from the start: PLACE, the coordinate on the fine grid of
    solar zenith angles; COS_AZIMUTH, from the sun; ZENITH, the solar zenith angle [rad]
    """

    place: np.ndarray
    step_rad: float


class NodeRays(NamedTuple):
    """R rays, from every node altitude one for each polar angle, for one block of wavelengths; those of an altitude
    are neighbours.

    first (R + 1,): where the points of each ray start; geometry (N, T, F, 3): `RayGeometry.place`
    ground_weight (R, LANES): transmittance to the ground, 0 for rays that miss it; ground_place (R,): fractional index
        of the ray's end in the geometry table
    """

    first: np.ndarray
    geometry: np.ndarray
    ground_weight: np.ndarray
    ground_place: np.ndarray


def make_ray_geometry(
    zenith_rad: np.ndarray, azimuth: np.ndarray, fine_rad: np.ndarray, longest_rad: float
) -> RayGeometry:
    """Table up to the geocentric angle longest_rad; azimuth (F,) [rad]; fine_rad: the fine grid of zenith angles."""
    step = longest_rad / (tuned.GEOMETRY_STEPS - 2)
    psi = np.arange(tuned.GEOMETRY_STEPS)[:, None, None] * step
    t, f = zenith_rad[None, :, None], azimuth[None, None, :]
    ahead = -np.sin(psi) * np.cos(t) + np.cos(psi) * np.sin(t) * np.cos(f)
    up = np.cos(psi) * np.cos(t) + np.sin(psi) * np.sin(t) * np.cos(f)
    side = np.sin(t) * np.sin(f)
    across = np.hypot(ahead, side)
    angle = np.arctan2(across, up)
    cosine = ahead / np.maximum(across, 1e-12)
    place = np.interp(angle, fine_rad, np.arange(fine_rad.size))
    return RayGeometry(np.stack([place, cosine, angle], axis=-1).astype(np.float32), step)
