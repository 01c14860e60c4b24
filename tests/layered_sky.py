"""Light scattered once in layered air without refraction, by a quadrature that shares nothing with the solvers.

Along the line of sight and along every ray to the sun the air is cut at each of its levels, and again where the optical
depth or a coefficient changes; each piece has Gauss-Legendre points.  Optical depths to the sun are integrals over the
chord coordinate t, r^2 = t^2 + (perigee)^2, so that grazing rays have no singularity.
"""

from itertools import pairwise

import numpy as np

from twilight.atmosphere.medium import Medium
from twilight.numerics.phase import PhaseFunction

NODE, WEIGHT = np.polynomial.legendre.leggauss(6)
UNSEEN = 1e-20
"""What a point of a line of sight may add to L/F0 [sr^-1] at most for no ray to the sun to be followed from it."""
RAYS_AT_ONCE = 2000
"""Rays to the sun that are followed together: of 20 levels, some tens of megabytes."""


def layered(base: float, thickness: float, depth: float, ramp_km: float = 0.0, g: float = 0.7) -> Medium:
    """Air of scale height 8 km, vertical optical depth 0.1, and a layer of HG aerosol; `ramp_km` 0: it jumps."""
    top = base + thickness
    edge = ramp_km
    smooth = np.array([0.0, 2.0, 5.0, 10.0, 20.0, 40.0, 70.0, 100.0])
    if edge > 0.0:
        own = [base, base + edge, top - edge, top]
        aerosol_at = {base + edge: 1.0, top - edge: 1.0}
        z = np.array(sorted({*smooth, *own}))
        share = np.array([aerosol_at.get(x, 1.0 if base + edge < x < top - edge else 0.0) for x in z])
        k = depth / (thickness - edge)
    else:
        inner = [x for x in smooth if base < x < top]
        z = np.array(sorted([*(x for x in smooth if not base <= x <= top), base, base, *inner, top, top]))
        share = np.zeros(z.size)
        first, last = np.flatnonzero(z == base)[-1], np.flatnonzero(z == top)[0]
        share[first : last + 1] = 1.0
        if base == 0.0:
            z, share = z[1:], share[1:]
        k = depth / thickness
    one = np.ones((z.size, 1))
    return Medium(
        wavelength_nm=np.array([550.0]),
        altitude_km=z,
        air_scattering_per_km=(0.1 / 8.0 * np.exp(-z / 8.0))[:, None],
        absorption_per_km=0 * one,
        aerosol_extinction_per_km=(k * share)[:, None],
        aerosol_single_scattering_albedo=one,
        aerosol_phase_fraction=one[None],
        phase_functions=(PhaseFunction.henyey_greenstein(np.full(1, g)),),
        refractivity=0 * one,
        depolarisation=np.zeros(1),
        ground_albedo=np.zeros(1),
        overhead_absorption_optical_depth=np.zeros(1),
    )


def _crossings(medium: Medium, perigee: float, low: float, high: float) -> np.ndarray:
    """Chord coordinates [km] in low..high at which a line with this perigee [km] meets a level of the medium."""
    r = medium.earth_radius_km + np.unique(medium.altitude_km)
    t = np.sqrt(np.maximum(0.0, (r - perigee) * (r + perigee)))[r >= perigee]
    marks = np.unique(np.concatenate([[low, high], t, -t, [0.0]]))
    return marks[(marks >= low) & (marks <= high)]


def _extinction(medium: Medium, perigee: float, t: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Extinction [km^-1] and altitude [km] at chord coordinates t."""
    z = (perigee - medium.earth_radius_km) + t * t / (np.hypot(perigee, t) + perigee)
    return medium.at(np.clip(z, 0.0, medium.top_km)).extinction[..., 0], z


def _points(edges: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    half = 0.5 * np.diff(edges)
    return (edges[:-1] + half)[:, None] + half[:, None] * NODE, half[:, None] * WEIGHT


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
        inside = (_extinction(medium, p[ray], at)[0] * WEIGHT).sum(axis=1) * half
        depth[some] = np.bincount(ray, inside, minlength=some.size)
    return depth.reshape(shape)


def scattered_once(medium: Medium, observer_km: float, elevation_deg: float, azimuth_deg: float, sun_deg: float):
    """L/F0 [sr^-1] of light scattered once by the air in one direction, at the one wavelength of the medium."""
    radius = medium.earth_radius_km
    e, a, h = np.radians([elevation_deg, azimuth_deg, sun_deg])
    r0 = radius + observer_km
    perigee, start = r0 * np.cos(e), r0 * np.sin(e)
    top = radius + medium.top_km
    if perigee >= top:
        return 0.0
    far = np.sqrt((top - perigee) * (top + perigee))
    low, high = max(start, -far), far
    if perigee < radius and start < 0.0:
        high = -np.sqrt((radius - perigee) * (radius + perigee))
    marks = _crossings(medium, perigee, low, high)
    edges, depth = [marks[0]], 0.0
    for begin, end in pairwise(marks):
        k = _extinction(medium, perigee, np.array([begin + 1e-9 * (end - begin), end - 1e-9 * (end - begin)]))[0].max()
        # short steps from the near end, while anything can be seen
        s, step = begin, min(2.0, 0.25 / max(k, 1e-9))
        while s < end and depth < 45.0:
            s = min(end, s + step)
            depth += k * step
            edges.append(s)
        if s < end:
            edges.append(end)
    t, weight = _points(np.array(edges))
    k, z = _extinction(medium, perigee, t)
    steps = (k * weight).sum(axis=1)
    power = np.linalg.inv(np.vander(NODE, increasing=True))
    to_node = np.array([[(x ** (m + 1) - (-1.0) ** (m + 1)) / (m + 1) for m in range(NODE.size)] for x in NODE])
    inside = k @ (to_node @ power).T * 0.5 * weight.sum(axis=1, keepdims=True)
    passed = np.concatenate([[0.0], np.cumsum(steps)[:-1]])[:, None] + inside
    c = medium.at(np.clip(z, 0.0, medium.top_km))
    cosine = np.sin(e) * np.sin(h) + np.cos(e) * np.cos(h) * np.cos(a)
    phase = medium.phase_functions[0](np.array([cosine]))[0, 0]
    sigma = c.air_scattering[..., 0] * 3 / (16 * np.pi) * (1 + cosine**2) + c.aerosol_scattering[..., 0] * phase
    source = weight * sigma * np.exp(-passed)
    s = t - start
    r = radius + z
    cos_sun = (r0 * np.sin(h) + s * cosine) / r
    seen = source > UNSEEN
    return float(source[seen] @ np.exp(-depth_to_space(medium, r[seen], cos_sun[seen])))
