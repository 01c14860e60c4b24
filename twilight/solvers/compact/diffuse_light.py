"""A first estimate of light scattered more than once: isotropic orders of scattering in spherical shells, numpy alone.

What is sought is the mean intensity J(z, chi) of light that was scattered at least once, in layers and at local solar
zenith angles chi: one field that serves every sun.  Light scattered once comes with the phase functions up to Legendre
order `ORDERS - 1`; from then on scattering is isotropic, the aerosol's with the similarity rule (extinction less
asymmetry x scattering).  Over rays from a point in `POLAR` zenith angles a side, and the mean over azimuths,

    J_next(z, chi) = 1/2 sum_rays w sum_segments T (1 - exp(-tau)) albedo sum_chi' G(chi, chi') J(z', chi')

G depends on geometry alone (straight rays) and is computed once.  J falls by orders of magnitude behind the shadow's
edge, so it is interpolated in chi as a multiple of `log_reference`.
"""

from __future__ import annotations

import functools
import math
from typing import NamedTuple

import numpy as np

from twilight.base.conventions import EARTH_RADIUS_KM
from twilight.solvers.compact.refracted_shells import RefractedShells, local_zenith, log_mean

BOUNDARY_KM = np.array(
    [0, 0.25, 0.7, 1.35, 2, 3, 4.5, 6, 8, 10, 12, 14, 16, 19, 22, 26, 30, 36, 42, 48, 54, 63, 72, 82, 100]
)
"""Boundaries of the layers above the ground [km]; all of them are among those of the line integrals."""

ZENITH_DEG = np.concatenate(
    [[0, 25, 45, 60, 70, 76, 80, 83, 85.5, 87.5], np.arange(89.0, 113.0), [115, 118, 122]]
)
"""Local solar zenith angles of the field [deg]."""

ORDERS = 4
"""Legendre orders of the phase functions in the first scattering."""

POLAR = 6
"""Zenith angles of rays a side, in Gauss's rule over the root of their cosine."""

AZIMUTHS = 8
"""Azimuths of rays over half a turn."""

SCATTERINGS = 8
"""Orders of scattering that are followed; a geometric series stands for the rest."""

LEAST_PART = 0.2
"""Light of the second order is at least this part of what isotropic scattering would give: a series of four terms may
be negative."""

MOST_RATIO = 0.95
"""Largest ratio of two orders of scattering of which the geometric series is summed."""

DECAY_DEG = 88.0
"""Zenith angle from which on `log_reference` falls."""

DECAY = 1.1
"""Its slope beyond 8 deg more [deg^-1]."""


def log_reference(zenith_deg: np.ndarray) -> np.ndarray:
    """About the logarithm of the light of the sky over that of day."""
    beyond = np.maximum(np.asarray(zenith_deg, float) - DECAY_DEG, 0.0)
    return -np.where(beyond < 8.0, DECAY * beyond**2 / 16.0, DECAY * (beyond - 4.0))


class Rays(NamedTuple):
    """Rays from the middle of a layer, or from the ground: N segments of all of them.

    shape: of arrays over rays and segments, (Q, S)
    layer, way_km, ground (Q, S): layer of a segment, its length, and whether it is the ground itself
    weight (Q,): of the rays in the mean over the sphere, or in the irradiance of the ground over pi
    there (Q S,): which segments exist
    operator: `ORDERS` of (C, N C), from sources at the segments to zenith angles, for each Legendre order
    """

    shape: tuple[int, int]
    layer: np.ndarray
    way_km: np.ndarray
    ground: np.ndarray
    weight: np.ndarray
    there: np.ndarray
    operator: list[np.ndarray]


@functools.cache
def rays_of_all_layers() -> list[Rays]:
    """Rays from each layer, from the lowest up, then from the ground."""
    return [_rays_from(layer) for layer in [*range(BOUNDARY_KM.size - 1), None]]


def _rays_from(layer: int | None) -> Rays:
    radius = EARTH_RADIUS_KM + BOUNDARY_KM
    start = radius[0] if layer is None else EARTH_RADIUS_KM + 0.5 * (BOUNDARY_KM[layer] + BOUNDARY_KM[layer + 1])
    node, rule = np.polynomial.legendre.leggauss(POLAR)
    root = 0.5 * (node + 1.0)
    up, weight = root**2, root * rule
    cosine = up if layer is None else np.concatenate([-up[::-1], up])
    weight = 2.0 * up * weight if layer is None else 0.5 * np.concatenate([weight[::-1], weight])
    lines = [_segments(radius, start, float(c), layer) for c in cosine]
    shape = (len(lines), max(map(len, lines)))
    number, way, angle = np.zeros(shape, int), np.zeros(shape), np.zeros(shape)
    there = np.zeros(shape, bool)
    for q, line in enumerate(lines):
        for s, (j, length, phi) in enumerate(line):
            number[q, s], way[q, s], angle[q, s], there[q, s] = j, length, phi, True
    ground = there & (number == BOUNDARY_KM.size - 1)
    return Rays(shape, number, way, ground, weight, there.ravel(), _operators(cosine, angle, there))


def _segments(radius: np.ndarray, start: float, cosine: float, layer: int | None) -> list[tuple[int, float, float]]:
    """(layer, length [km], angle at the Earth's centre in its middle [rad]) along a ray; the ground counts as the layer
    above the uppermost."""
    layers = radius.size - 1
    b = start * math.sqrt(1.0 - cosine * cosine)

    def angle(r: float) -> float:
        return math.acos(min(1.0, b / r))

    def length(low: float, high: float) -> float:
        return math.sqrt(max(high**2 - b * b, 0.0)) - math.sqrt(max(low**2 - b * b, 0.0))

    out = []
    if cosine > 0.0:
        for j in range(layer or 0, layers):
            low = max(radius[j], start)
            out.append((j, length(low, radius[j + 1]), 0.5 * (angle(low) + angle(radius[j + 1])) - angle(start)))
        return out
    assert layer is not None
    for j in range(layer, -1, -1):
        high = min(radius[j + 1], start)
        if high <= b:
            break
        low = max(radius[j], b)
        out.append((j, length(low, high), angle(start) - 0.5 * (angle(low) + angle(high))))
    if b < radius[0]:
        return [*out, (layers, 0.0, angle(start) - angle(radius[0]))]
    for j in range(layers):
        if radius[j + 1] > b:
            low = max(radius[j], b)
            out.append((j, length(low, radius[j + 1]), angle(start) + 0.5 * (angle(low) + angle(radius[j + 1]))))
    return out


def _operators(cosine: np.ndarray, angle: np.ndarray, there: np.ndarray) -> list[np.ndarray]:
    """G for each Legendre order, (C, N C): linear interpolation in chi at each segment, averaged over azimuths."""
    count = ZENITH_DEG.size
    azimuth = np.cos((np.arange(AZIMUTHS) + 0.5) * np.pi / AZIMUTHS)
    chi = np.radians(ZENITH_DEG)[:, None, None]
    ray, _ = np.nonzero(there)
    phi, mu = angle[there][:, None], cosine[ray][:, None]
    local = np.cos(chi) * np.cos(phi) + np.sin(chi) * np.sin(phi) * azimuth
    zenith = np.minimum(np.degrees(np.arccos(np.clip(local, -1.0, 1.0))), ZENITH_DEG[-1] - 1e-6)  # C N A
    toward_sun = mu * np.cos(chi) + np.sqrt(1.0 - mu * mu) * np.sin(chi) * azimuth
    below = np.clip(np.searchsorted(ZENITH_DEG, zenith, side="right") - 1, 0, count - 2)
    f = (zenith - ZENITH_DEG[below]) / (ZENITH_DEG[below + 1] - ZENITH_DEG[below])
    reference, at_nodes = np.exp(log_reference(zenith)) / AZIMUTHS, np.exp(-log_reference(ZENITH_DEG))
    row = (np.arange(count)[:, None] * phi.size + np.arange(phi.size)[None])[:, :, None] * count
    place = np.concatenate([(row + below).ravel(), (row + below + 1).ravel()])
    low, high = (1.0 - f) * reference * at_nodes[below], f * reference * at_nodes[below + 1]
    out = []
    for order in range(ORDERS):
        series = np.polynomial.legendre.legval(toward_sun, np.eye(ORDERS)[order])
        values = np.concatenate([(low * series).ravel(), (high * series).ravel()])
        summed = np.bincount(place, values, minlength=count * phi.size * count)
        out.append(summed.reshape(count, -1).astype(np.float32))
    return out


def diffuse_light(
    shells: RefractedShells,
    coefficients: DiffuseCoefficients,
    ground_albedo: np.ndarray,
) -> np.ndarray:
    """Mean intensity over F0 of light scattered at least once, in layers between BOUNDARY_KM, (L, C, W)."""
    c = coefficients
    places = [int(np.argmin(np.abs(shells.boundary_km - z))) for z in BOUNDARY_KM]
    zenith = np.radians(ZENITH_DEG)
    beam = np.maximum(np.array([shells.log_sunbeam(k, zenith) for k in places]), -200.0)
    direct = log_mean(beam[:-1], beam[1:])  # L C W
    wavelengths = direct.shape[-1]
    albedo = np.concatenate([c.scattering / c.extinction, np.ones((1, wavelengths))])
    extinction = np.concatenate([c.extinction, np.zeros((1, wavelengths))])
    ground = ground_albedo / np.pi * np.exp(beam[0]) * np.maximum(np.cos(zenith), 0.0)[:, None]
    first = [
        np.concatenate([direct * c.first[n][:, None] / (4.0 * np.pi), (ground if n == 0 else 0.0 * ground)[None]])
        for n in range(ORDERS)
    ]
    all_rays = rays_of_all_layers()
    weights = [_weights(rays, extinction, albedo) for rays in all_rays]
    total = before = now = np.zeros_like(first[0], dtype=np.float32)
    for n in range(SCATTERINGS):
        after = np.empty_like(total)
        for k, (rays, weight) in enumerate(zip(all_rays, weights, strict=True)):
            if n == 0:
                parts = [
                    operator @ _sources(rays, light, weight) for operator, light in zip(rays.operator, first, strict=True)
                ]
                after[k] = np.maximum(sum(parts), LEAST_PART * parts[0])
            else:
                after[k] = rays.operator[0] @ _sources(rays, now, weight)
        after[-1] *= ground_albedo
        total, before, now = total + after, now, after
    ratio = np.clip(now / np.maximum(before, 1e-30), 0.0, MOST_RATIO)
    return (total + now * ratio / (1.0 - ratio))[:-1]


class DiffuseCoefficients(NamedTuple):
    """Coefficients of the layers between BOUNDARY_KM.

    extinction, scattering (L, W) [km^-1]: by the similarity rule
    first (ORDERS, L, W): (2 l + 1) x moment l of what scatters the sunbeam x its coefficient, over `scattering`
    """

    extinction: np.ndarray
    scattering: np.ndarray
    first: np.ndarray


def _weights(rays: Rays, extinction: np.ndarray, albedo: np.ndarray) -> np.ndarray:
    """Part of the source of each segment in what a ray brings, times its weight, (N, W)."""
    depth = np.where(rays.ground[..., None], 60.0, extinction[rays.layer] * rays.way_km[..., None])
    passed = np.cumsum(depth, axis=1) - depth
    out = np.exp(-passed) * -np.expm1(-depth) * albedo[rays.layer] * rays.weight[:, None, None]
    return out.reshape(-1, out.shape[-1])[rays.there].astype(np.float32)


def _sources(rays: Rays, light: np.ndarray, weight: np.ndarray) -> np.ndarray:
    """Sources (N C, W) at the segments, from light (L + 1, C, W)."""
    here = light[rays.layer.ravel()[rays.there]].astype(np.float32, copy=False) * weight[:, None, :]
    return here.reshape(-1, here.shape[-1])


def seen(
    shells: RefractedShells,
    light: np.ndarray,
    coefficient: np.ndarray,
    sun_elevation_deg: float,
    elevation_deg: np.ndarray,
    azimuth_deg: np.ndarray,
) -> np.ndarray:
    """Light (L, C, W) of `diffuse_light` scattered into lines of sight by a coefficient (layers of shells, W), as if
    isotropically, (E, A, W)."""
    weight, angle = shells.emission_weights(elevation_deg, coefficient)
    zenith = np.minimum(np.degrees(local_zenith(sun_elevation_deg, angle, azimuth_deg)), ZENITH_DEG[-1] - 1e-6)
    k = np.clip(np.searchsorted(ZENITH_DEG, zenith, side="right") - 1, 0, ZENITH_DEG.size - 2)
    f = ((zenith - ZENITH_DEG[k]) / (ZENITH_DEG[k + 1] - ZENITH_DEG[k]))[..., None]
    scaled = light * np.exp(-log_reference(ZENITH_DEG))[None, :, None]
    middle = 0.5 * (shells.boundary_km[1:] + shells.boundary_km[:-1])[shells.first :]
    layer = (np.searchsorted(BOUNDARY_KM, middle) - 1)[None, None, :]
    source = (scaled[layer, k] * (1.0 - f) + scaled[layer, k + 1] * f) * np.exp(log_reference(zenith))[..., None]
    return np.einsum("ekw,eakw->eaw", weight, source, optimize=True)
