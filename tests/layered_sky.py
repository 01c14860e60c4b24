"""Air with a layer, and optical depths of straight rays to space by a quadrature that shares nothing with the solvers.

Along every ray the air is cut at each of its levels, and again where pieces are long; each piece has Gauss-Legendre
points of the chord coordinate t, r^2 = t^2 + (perigee)^2, so that grazing rays have no singularity.
"""

import numpy as np

from twilight.atmosphere.medium import Medium
from twilight.numerics.phase import PhaseFunction

NODE, WEIGHT = np.polynomial.legendre.leggauss(6)
RAYS_AT_ONCE = 2000
"""Rays to the sun that are followed together: of 20 levels, some tens of megabytes."""


def layered(base: float, thickness: float, depth: float, ramp_km: float = 0.0, g: float = 0.7) -> Medium:
    """Air of scale height 8 km, vertical optical depth 0.1, and a layer of HG aerosol; `ramp_km` 0: it jumps."""
    top = base + thickness
    smooth = np.array([0.0, 2.0, 5.0, 10.0, 20.0, 40.0, 70.0, 100.0])
    if ramp_km > 0.0:
        own = [base, base + ramp_km, top - ramp_km, top]
        aerosol_at = {base + ramp_km: 1.0, top - ramp_km: 1.0}
        z = np.array(sorted({*smooth, *own}))
        fraction = np.array([aerosol_at.get(x, 1.0 if base + ramp_km < x < top - ramp_km else 0.0) for x in z])
        k = depth / (thickness - ramp_km)
    else:
        inner = [x for x in smooth if base < x < top]
        z = np.array(sorted([*(x for x in smooth if not base <= x <= top), base, base, *inner, top, top]))
        fraction = np.zeros(z.size)
        first, last = np.flatnonzero(z == base)[-1], np.flatnonzero(z == top)[0]
        fraction[first : last + 1] = 1.0
        if base == 0.0:
            z, fraction = z[1:], fraction[1:]
        k = depth / thickness
    one = np.ones((z.size, 1))
    return Medium(
        wavelength_nm=np.array([550.0]),
        altitude_km=z,
        air_scattering_per_km=(0.1 / 8.0 * np.exp(-z / 8.0))[:, None],
        absorption_per_km=0 * one,
        aerosol_extinction_per_km=(k * fraction)[:, None],
        aerosol_single_scattering_albedo=one,
        aerosol_phase_fraction=one[None],
        phase_functions=(PhaseFunction.henyey_greenstein(np.full(1, g)),),
        refractivity=0 * one,
        depolarisation=np.zeros(1),
        ground_albedo=np.zeros(1),
        overhead_absorption_optical_depth=np.zeros(1),
    )


def _extinction(medium: Medium, perigee: np.ndarray, t: np.ndarray) -> np.ndarray:
    """Extinction [km^-1] at chord coordinates t."""
    z = (perigee - medium.earth_radius_km) + t * t / (np.hypot(perigee, t) + perigee)
    return medium.at(np.clip(z, 0.0, medium.top_km)).extinction[..., 0]


def depth_to_space(medium: Medium, r, cos_zenith) -> np.ndarray:
    """Optical depths from the radii r [km] along straight rays; infinite where one meets the ground.

    All rays at once: pieces of no length do nothing.
    """
    r, cos_zenith = np.broadcast_arrays(np.asarray(r, dtype=float), np.asarray(cos_zenith, dtype=float))
    shape, r, cos_zenith = r.shape, r.ravel(), cos_zenith.ravel()
    perigee, start = r * np.sqrt(np.maximum(0.0, 1.0 - cos_zenith**2)), r * cos_zenith
    depth = np.where((cos_zenith < 0.0) & (perigee < medium.earth_radius_km), np.inf, 0.0)
    free = np.flatnonzero(np.isfinite(depth))
    levels = medium.earth_radius_km + np.unique(medium.altitude_km)
    for some in np.array_split(free, 1 + free.size // RAYS_AT_ONCE):
        p, low = perigee[some, None], start[some, None]
        t = np.sqrt(np.maximum(0.0, (levels - p) * (levels + p)))  # (rays, levels), up to the top
        marks = np.sort(np.clip(np.hstack([t, -t, 0.0 * low, low]), low, t[:, -1:]), axis=1)
        begin, length = marks[:, :-1].ravel(), np.diff(marks, axis=1).ravel()
        parts = np.where(length > 0.0, 1 + (length / 20.0).astype(int), 0)
        piece = np.repeat(np.arange(length.size), parts)
        part = np.arange(piece.size) - np.repeat(np.cumsum(parts) - parts, parts)
        half = 0.5 * (length / np.maximum(parts, 1))[piece]
        ray = piece // (marks.shape[1] - 1)
        at = (begin[piece] + (2 * part + 1) * half)[:, None] + half[:, None] * NODE
        inside = (_extinction(medium, p[ray], at) * WEIGHT).sum(axis=1) * half
        depth[some] = np.bincount(ray, inside, minlength=some.size)
    return depth.reshape(shape)
