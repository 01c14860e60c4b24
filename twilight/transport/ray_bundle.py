"""Many lines of sight at once, as points: what depends on the air alone, for any sun."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from twilight.atmosphere.medium import Medium
from twilight.base.threads import in_slices
from twilight.jit.kernels import njit
from twilight.transport.lines import END_ANGLE, GROUND, new_line, trace_line
from twilight.transport.profile import Profile


class RayBundle(NamedTuple):
    """R rays with P points in all.

    first (R + 1,): where the points of each ray start; place (P, 4), weight (P, W): as in `Line`
    ground_weight (R, W): transmittance to the ground, 0 for rays that miss it; ground_angle_rad (R,): geocentric angle
        from the start of the ray to where it meets the ground
    passed (R, W): transmittance to the end of each ray, whatever it ends on
    """

    first: np.ndarray
    place: np.ndarray
    weight: np.ndarray
    ground_weight: np.ndarray
    ground_angle_rad: np.ndarray
    passed: np.ndarray


@njit(cache=True, nogil=True)
def _trace(profile, altitude_km, cosine, far_km, fineness, pairs, store, rays, begin, end):
    """Trace rays: count their points into rays.first[r + 1], or store them from rays.first[r] on.

    profile: `Profile`; altitude_km (R,), cosine (R,), far_km (R,), fineness, pairs: as `lines.trace_line` has them;
    store: keep the points, else count; rays: `RayBundle`, filled; begin, end: the first ray and the one after the last.
    """
    line = new_line(profile)
    for r in range(begin, end):
        n, status = trace_line(profile, altitude_km[r], cosine[r], fineness, pairs, line, far_km[r])
        if not store:
            rays.first[r + 1] = n
            continue
        # by loops: an assignment of slices brings the text of numba's error with it, 3 s to compile
        for k in range(n):
            for i in range(line.place.shape[1]):
                rays.place[rays.first[r] + k, i] = line.place[k, i]
            for w in range(line.weight.shape[1]):
                rays.weight[rays.first[r] + k, w] = line.weight[k, w]
        rays.ground_angle_rad[r] = line.end[END_ANGLE]
        for w in range(line.transmittance.size):
            rays.passed[r, w] = line.transmittance[w]
            rays.ground_weight[r, w] = line.transmittance[w] if status == GROUND else 0.0


def trace_rays(
    profile: Profile,
    altitude_km: np.ndarray,
    cosine: np.ndarray,
    fineness: float,
    *,
    pairs: bool = False,
    far_km: np.ndarray | None = None,
) -> RayBundle:
    """Rays that start at `altitude_km` (R,) under `cosine` (R,); each is traced twice, to count points and to store.

    pairs: two points for every step; otherwise one for short steps.  far_km (R,): distance at which each ends at the
    latest; None: none does.
    """
    # in C order: the kernel is compiled for each order of its arrays
    far = np.full(altitude_km.size, np.inf) if far_km is None else np.ascontiguousarray(far_km, dtype=float)
    n_rays, n_w = altitude_km.size, profile.extinction.shape[1]
    first = np.zeros(n_rays + 1, np.int64)

    def trace(n_points: int, store: bool) -> RayBundle:
        rays = RayBundle(
            first,
            np.empty((n_points, 4)),
            np.empty((n_points, n_w)),
            np.zeros((n_rays, n_w)),
            np.zeros(n_rays),
            np.ones((n_rays, n_w)),
        )
        in_slices(
            lambda begin, end: _trace(profile, altitude_km, cosine, far, fineness, pairs, store, rays, begin, end),
            n_rays,
        )
        return rays

    trace(1, False)
    np.cumsum(first, out=first)
    return trace(int(first[-1]), True)


def species_fraction(medium: Medium, altitude_km: np.ndarray) -> np.ndarray:
    """Fraction (1 + K, P, W) of air and of each aerosol phase function in the scattering at altitudes (P,) [km]."""
    at = medium.at(altitude_km)
    species = np.concatenate([at.air_scattering[None], at.aerosol_scattering[None] * at.aerosol_phase_fraction])
    total = species.sum(axis=0)
    fraction = np.where(total > 0, species / np.where(total > 0, total, 1.0), 0.0)
    fraction[0] = np.where(total > 0, fraction[0], 1.0)
    return fraction
