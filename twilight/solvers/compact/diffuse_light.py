"""A first estimate of light scattered more than once: orders of scattering in spherical shells, numpy alone.

What is sought is the mean intensity J(z, chi) of light that was scattered at least once, in layers and at local solar
zenith angles chi: one field that serves every sun.  The first scattering has the phase functions up to Legendre order
`ORDERS - 1`; between it and the last, scattering is isotropic, the aerosol's with the similarity rule (extinction less
asymmetry x scattering).  Over rays from a point in `POLAR` zenith angles a side, with weights w whose sum is 1, and the
mean over azimuths,

    J_next(z, chi) = sum_rays w sum_segments T (1 - exp(-tau)) albedo sum_chi' G(chi, chi') J(z', chi')

and with it the mean V of the radiance times the direction that it comes from, upwards and towards the sun: along a line
of sight e the last scattering sends J + 3 g V.e to the observer.  G depends on geometry alone, rays bent by air of
`REFRACTIVITY`, and is computed once.  J falls by orders of magnitude behind the shadow's edge, so it is interpolated in
chi as a multiple of `log_reference`.
"""

from __future__ import annotations

import functools
import math
from typing import NamedTuple

import numpy as np

from twilight.base.conventions import EARTH_RADIUS_KM
from twilight.transport.shells import (
    SUBLAYERS,
    RefractedShells,
    lit_fraction,
    local_zenith,
    log_mean,
    sublayers,
)

BOUNDARY_KM = np.array(
    [0, 0.25, 0.7, 1.35, 2, 3, 4.5, 6, 8, 10, 12, 14, 16, 19, 22, 26, 30, 36, 42, 48, 54, 63, 72, 82, 100]
)
"""Boundaries of the layers above the ground [km]; all of them are among those of the line integrals."""

ZENITH_DEG = np.concatenate([[0, 25, 45, 60, 70, 76, 80, 83, 85.5, 87.5], np.arange(89.0, 113.0), [115, 118, 122]])
"""Local solar zenith angles of the field [deg]."""

ORDERS = 4
"""Legendre orders of the phase functions in the first scattering."""

POLAR = 8
"""Zenith angles of rays a side."""

POWER = 3
"""Gauss's rule runs over the root of this order of the rays' cosine: light in deep twilight comes along the horizon."""

AZIMUTHS = 8
"""Azimuths of rays over half a turn."""

REFRACTIVITY = 2.8e-4
"""n - 1 at the ground of the air that bends rays between scatterings."""

REFRACTIVITY_SCALE_KM = 8.0
"""Scale height of REFRACTIVITY [km]."""

LONGEST = 0.02
"""Longest segment of a ray, as an angle at the Earth's centre [rad]."""

SCATTERINGS = 8
"""Orders of scattering that are followed; a geometric series stands for the rest."""

MOST_RATIO = 0.95
"""Largest ratio of two orders of scattering of which the geometric series is summed."""

DECAY_DEG = 88.0
"""Zenith angle from which on `log_reference` falls."""

DECAY = 1.1
"""Slope of `log_reference` from 8 deg beyond DECAY_DEG on [deg^-1]."""


def log_reference(zenith_deg: np.ndarray) -> np.ndarray:
    """About the logarithm of the light of the sky over that of day."""
    beyond = np.maximum(np.asarray(zenith_deg, float) - DECAY_DEG, 0.0)
    return -np.where(beyond < 8.0, DECAY * beyond**2 / 16.0, DECAY * (beyond - 4.0))


class Rays(NamedTuple):
    """Rays from the middle of a layer, or from the ground: N segments of all of them.

    shape: of arrays over rays and segments, (Q, S)
    layer, length_km, ground (Q, S): layer of a segment, its length, and whether it is the ground itself
    weight (Q,): of the rays in the mean over the sphere, or in the irradiance of the ground over pi
    exists (Q S,): which segments exist
    cosine, sine (N,): of the zenith angle of each segment's ray
    operator: `ORDERS` of (C, N C), from sources at the segments to zenith angles, for each Legendre order
    towards_sun: the same times the cosine of the ray's azimuth from the sun
    """

    shape: tuple[int, int]
    layer: np.ndarray
    length_km: np.ndarray
    ground: np.ndarray
    weight: np.ndarray
    exists: np.ndarray
    cosine: np.ndarray
    sine: np.ndarray
    operator: list[np.ndarray]
    towards_sun: list[np.ndarray]


@functools.cache
def rays_of_all_layers() -> list[Rays]:
    """Rays from each layer, from the lowest up, then from the ground."""
    return [_rays_from(layer) for layer in [*range(BOUNDARY_KM.size - 1), None]]


def _rays_from(layer: int | None) -> Rays:
    node, rule = np.polynomial.legendre.leggauss(POLAR)
    root = 0.5 * (node + 1.0)
    up, weight = root**POWER, 0.5 * POWER * root ** (POWER - 1) * rule
    cosine = up if layer is None else np.concatenate([-up[::-1], up])
    weight = 2.0 * up * weight if layer is None else 0.5 * np.concatenate([weight[::-1], weight])
    lines = [_segments(float(c), layer) for c in cosine]
    shape = (len(lines), max(map(len, lines)))
    number, length, angle = np.zeros(shape, int), np.zeros(shape), np.zeros(shape)
    exists = np.zeros(shape, bool)
    for q, line in enumerate(lines):
        exists[q, : len(line)] = True
        for s, segment in enumerate(line):
            number[q, s], length[q, s], angle[q, s] = segment.layer, segment.length_km, segment.angle_rad
    ground = exists & (number == BOUNDARY_KM.size - 1)
    up = cosine[np.nonzero(exists)[0]].astype(np.float32)
    operators = _operators(cosine, angle, exists)
    return Rays(shape, number, length, ground, weight, exists.ravel(), up, np.sqrt(1.0 - up * up), *operators)


class Segment(NamedTuple):
    """Part of a ray in one layer; angle_rad: at the Earth's centre, from the ray's start to the segment's middle."""

    layer: int
    length_km: float
    angle_rad: float


def _segments(cosine: float, layer: int | None) -> list[Segment]:
    """Segments of a ray bent by air of `REFRACTIVITY`; the ground counts as the layer above the uppermost.

    layer: where the ray starts, in the middle; None: from the ground
    """
    part = sublayers(BOUNDARY_KM)
    radius = EARTH_RADIUS_KM + part
    index = 1.0 + REFRACTIVITY * np.exp(-part / REFRACTIVITY_SCALE_KM)
    x, mean = index * radius, 0.5 * (index[1:] + index[:-1])
    slope = np.diff(x) / np.diff(radius)
    first = 0 if layer is None else SUBLAYERS * layer + SUBLAYERS // 2
    b = x[first] * math.sqrt(1.0 - cosine * cosine)
    beyond = np.maximum(x, b)
    path = np.diff(np.sqrt(beyond * beyond - b * b)) / slope
    angle = np.diff(np.arccos(b / beyond)) * mean / slope
    passed = list(range(first, path.size))
    if cosine < 0.0:
        below = [i for i in range(first - 1, -1, -1) if path[i] > 0.0]
        hit = b < x[0]
        passed = below if hit else below + below[::-1] + passed
    else:
        hit = False
    groups: list[list[Segment]] = []
    total = spanned = 0.0  # angles of the ray so far, and of the last group, which is of one layer and at most LONGEST
    for i in passed:
        segment = Segment(i // SUBLAYERS, float(path[i]), total + 0.5 * angle[i])
        if not groups or groups[-1][0].layer != segment.layer or spanned + angle[i] > LONGEST:
            groups.append([])
            spanned = 0.0
        groups[-1].append(segment)
        spanned += angle[i]
        total += angle[i]
    out = []
    for group in groups:
        length = sum(one.length_km for one in group)
        mean_angle = sum(one.length_km * one.angle_rad for one in group) / length
        out.append(Segment(group[0].layer, length, mean_angle))
    return [*out, Segment(BOUNDARY_KM.size - 1, 0.0, total)] if hit else out


def _operators(cosine: np.ndarray, angle: np.ndarray, exists: np.ndarray) -> tuple[list[np.ndarray], list[np.ndarray]]:
    """G for each Legendre order, (C, N C): linear interpolation in chi at each segment, averaged over azimuths; and the
    same times the cosine of azimuth."""
    count = ZENITH_DEG.size
    azimuth = np.cos((np.arange(AZIMUTHS) + 0.5) * np.pi / AZIMUTHS)
    chi = np.radians(ZENITH_DEG)[:, None, None]
    ray, _ = np.nonzero(exists)
    phi, mu = angle[exists][:, None], cosine[ray][:, None]
    local = np.cos(chi) * np.cos(phi) + np.sin(chi) * np.sin(phi) * azimuth
    zenith = np.minimum(np.degrees(np.arccos(np.clip(local, -1.0, 1.0))), ZENITH_DEG[-1] - 1e-6)  # C N A
    toward_sun = mu * np.cos(chi) + np.sqrt(1.0 - mu * mu) * np.sin(chi) * azimuth
    below = np.clip(np.searchsorted(ZENITH_DEG, zenith, side="right") - 1, 0, count - 2)
    f = (zenith - ZENITH_DEG[below]) / (ZENITH_DEG[below + 1] - ZENITH_DEG[below])
    reference, at_nodes = np.exp(log_reference(zenith)) / AZIMUTHS, np.exp(-log_reference(ZENITH_DEG))
    row = (np.arange(count)[:, None] * phi.size + np.arange(phi.size)[None])[:, :, None] * count
    index = np.concatenate([(row + below).ravel(), (row + below + 1).ravel()])
    low, high = (1.0 - f) * reference * at_nodes[below], f * reference * at_nodes[below + 1]
    out: tuple[list[np.ndarray], list[np.ndarray]] = ([], [])
    for order in range(ORDERS):
        series = np.polynomial.legendre.legval(toward_sun, np.eye(ORDERS)[order])
        for operators, by in zip(out, (series, series * azimuth), strict=True):
            values = np.concatenate([(low * by).ravel(), (high * by).ravel()])
            summed = np.bincount(index, values, minlength=count * phi.size * count)
            operators.append(summed.reshape(count, -1).astype(np.float32))
    return out


def diffuse_light(shells: RefractedShells, coefficients: DiffuseCoefficients, ground_albedo: np.ndarray) -> np.ndarray:
    """Light scattered at least once, over F0, in layers between BOUNDARY_KM, (3, L, C, W): its mean intensity, and the
    mean of its radiance times the direction that it comes from, upwards and horizontally towards the sun."""
    c = coefficients
    places = [int(np.argmin(np.abs(shells.boundary_km - z))) for z in BOUNDARY_KM]
    zenith = np.radians(ZENITH_DEG)
    at_boundaries = [shells.log_sunbeam(k, zenith) for k in places]
    beam, edge = np.array([one[0] for one in at_boundaries]), np.array([one[1] for one in at_boundaries])
    direct = log_mean(beam[:-1], beam[1:]) * lit_fraction(edge[:-1], edge[1:])[..., None]  # L C W
    wavelengths = direct.shape[-1]
    albedo = np.concatenate([c.scattering / c.extinction, np.ones((1, wavelengths))])
    extinction = np.concatenate([c.extinction, np.zeros((1, wavelengths))])
    ground = ground_albedo / np.pi * np.exp(beam[0]) * (np.maximum(np.cos(zenith), 0.0) * (edge[0] > 0.0))[:, None]
    first = [
        np.concatenate([direct * c.first[n][:, None] / (4.0 * np.pi), (ground if n == 0 else 0.0 * ground)[None]])
        for n in range(ORDERS)
    ]
    all_rays = rays_of_all_layers()
    weights = [_weights(rays, extinction, albedo) for rays in all_rays]
    total = before = now = np.zeros_like(first[0], dtype=np.float32)
    vector = np.zeros((2, *total.shape), np.float32)
    for n in range(SCATTERINGS):
        after = np.empty_like(total)
        for k, (rays, weight) in enumerate(zip(all_rays, weights, strict=True)):
            if n == 0:
                sources = [_sources(rays, light, weight) for light in first]
                parts = [operator @ source for operator, source in zip(rays.operator, sources, strict=True)]
                after[k] = positive(parts[0], sum(parts[1:]))
                vector[:, k] = sum(_vector(rays, order, source) for order, source in enumerate(sources))
            else:
                after[k] = rays.operator[0] @ _sources(rays, now, weight)
        after[-1] *= ground_albedo
        total, before, now = total + after, now, after
    ratio = np.clip(now / np.maximum(before, 1e-30), 0.0, MOST_RATIO)
    total += now * ratio / (1.0 - ratio)
    for k, (rays, weight) in enumerate(zip(all_rays, weights, strict=True)):
        vector[:, k] += _vector(rays, 0, _sources(rays, total, weight))
    return np.concatenate([total[None], vector])[:, :-1]


def positive(first: np.ndarray, further: np.ndarray) -> np.ndarray:
    """The sum of the first term of a series, at least 0, and further ones; never negative, without a kink."""
    ratio = further / np.maximum(first, 1e-35)
    return first * np.where(ratio > 0.0, 1.0 + ratio, np.exp(np.minimum(ratio, 0.0)))


def _vector(rays: Rays, order: int, source: np.ndarray) -> np.ndarray:
    """Mean of the radiance times its direction, (2, C, W), from sources (N C, W) of a Legendre order."""
    by_segment = source.reshape(rays.cosine.size, -1)
    up, aside = ((by_segment * part[:, None]).reshape(source.shape) for part in (rays.cosine, rays.sine))
    return np.stack([rays.operator[order] @ up, rays.towards_sun[order] @ aside])


class DiffuseCoefficients(NamedTuple):
    """Coefficients of the layers between BOUNDARY_KM.

    extinction, scattering (L, W) [km^-1]: by the similarity rule
    first (ORDERS, L, W): (2 l + 1) x moment l of what scatters the sunbeam x its coefficient, over `scattering`
    """

    extinction: np.ndarray
    scattering: np.ndarray
    first: np.ndarray


def _weights(rays: Rays, extinction: np.ndarray, albedo: np.ndarray) -> np.ndarray:
    """Radiance that a ray brings per mean intensity in each segment, times the weight of the ray, (N, W)."""
    depth = np.where(rays.ground[..., None], 60.0, extinction[rays.layer] * rays.length_km[..., None])
    passed = np.cumsum(depth, axis=1) - depth
    out = np.exp(-passed) * -np.expm1(-depth) * albedo[rays.layer] * rays.weight[:, None, None]
    return out.reshape(-1, out.shape[-1])[rays.exists].astype(np.float32)


def _sources(rays: Rays, light: np.ndarray, weight: np.ndarray) -> np.ndarray:
    """Sources (N C, W) at the segments, from light (L + 1, C, W)."""
    here = light[rays.layer.ravel()[rays.exists]].astype(np.float32, copy=False) * weight[:, None, :]
    return here.reshape(-1, here.shape[-1])


def line_of_sight_radiance(
    shells: RefractedShells,
    light: np.ndarray,
    coefficients: tuple[np.ndarray, np.ndarray],
    sun_elevation_deg: float,
    elevation_deg: np.ndarray,
    azimuth_deg: np.ndarray,
) -> np.ndarray:
    """Light (3, L, C, W) of `diffuse_light` scattered into lines of sight, (E, A, W).

    coefficients: of scattering, and that times three times its asymmetry, (layers of shells, W) each [km^-1]
    """
    weight, angle = shells.emission_weights(elevation_deg, coefficients[0])
    zenith = local_zenith(sun_elevation_deg, angle, azimuth_deg)
    degrees = np.minimum(np.degrees(zenith), ZENITH_DEG[-1] - 1e-6)
    k = np.clip(np.searchsorted(ZENITH_DEG, degrees, side="right") - 1, 0, ZENITH_DEG.size - 2)
    f = ((degrees - ZENITH_DEG[k]) / (ZENITH_DEG[k + 1] - ZENITH_DEG[k]))[..., None].astype(np.float32)
    scaled = (light * np.exp(-log_reference(ZENITH_DEG))[None, None, :, None]).astype(np.float32)
    middle = 0.5 * (shells.boundary_km[1:] + shells.boundary_km[:-1])[shells.first :]
    layer = (np.searchsorted(BOUNDARY_KM, middle) - 1)[None, None, :]
    mean, up, aside = (part[layer, k] * (1.0 - f) + part[layer, k + 1] * f for part in scaled)
    # the line of sight where it scatters: cosine of its zenith angle, and part of it towards the sun
    sun, elevation, azimuth = (np.radians(a) for a in (90.0 - sun_elevation_deg, elevation_deg, azimuth_deg))
    upwards = np.sin(elevation[:, None] + angle)[:, None]
    from_sun = np.cos(sun) * np.sin(elevation)[:, None] + np.sin(sun) * np.cos(elevation)[:, None] * np.cos(azimuth)
    towards = (from_sun[..., None] - np.cos(zenith) * upwards) / np.maximum(np.sin(zenith), 1e-3)
    forward = coefficients[1][shells.first :] / np.maximum(coefficients[0][shells.first :], 1e-30)
    further = up * upwards[..., None].astype(np.float32) + aside * towards[..., None].astype(np.float32)
    source = positive(mean, forward.astype(np.float32) * further) * np.exp(log_reference(degrees))[..., None]
    return np.einsum("ekw,eakw->eaw", weight, source, optimize=True)
