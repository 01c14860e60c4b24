"""The rays along which diffuse light is followed from layer to layer, for `diffuse`; by numpy alone.

They are the same in all air: their segments in layers, the zenith angle of the sun at each, and weights.
"""

from __future__ import annotations

import functools
from itertools import pairwise
from math import factorial, sqrt
from typing import NamedTuple

import numpy as np
from numpy.polynomial.legendre import legvander

from .shells import EARTH_RADIUS_KM, Parts, single, sublayers

BOUNDARY_KM = np.array(
    [
        *(0, 0.02, 0.12, 0.25, 0.45, 0.7, 1, 1.35, 2, 2.5, 3.5, 5, 6, 8, 10, 12, 14, 16),
        *(17.5, 19, 20, 21, 22, 24, 26, 30, 36, 45, 60, 78, 100),
    ]
)
"""Boundaries of the layers of diffuse light, all in ALTITUDE_KM; the ground counts as the layer above them."""
START_KM = np.append(0.5 * (BOUNDARY_KM[1:] + BOUNDARY_KM[:-1]), 0.0)
"""Where rays start: in the middle of layers, and on the ground."""
ZENITH_DEG = np.concatenate(
    [[0, 25, 45, 60, 70, 76, 80, 83, 85.5, 87.5], np.arange(89, 92, 0.5), np.arange(92.0, 113.0), [115, 118, 122]]
)
"""Local solar zenith angles of diffuse light [deg]."""
POWER = 4
"""Root of the cosines of rays above the horizontal that follows Gauss's rule."""
POWER_BELOW = 2
"""Root, for rays to the ground, of how far they are beyond its horizon."""
LEAVING_DEG = np.array([-60, -27, -12, -4, 4, 12, 27, 60.0])
"""Elevations into which layers scatter light that was scattered before [deg]."""
CUT = 12
"""Legendre moment that stands for the forward peak, whose light counts as not scattered."""
DEGREE = 8
"""Degree of the moments of radiance that the last scattering takes."""
DECAY_DEG = 88.0
"""Zenith angle from which on `log_reference` falls."""
DECAY = 1.1
"""By how much it falls a degree, from 8 deg beyond it on."""
FINE_DEG = 0.5
"""Steps of local zenith angles along rays [deg]."""
REFRACTIVITY_SCALE_KM = 8.0
"""Scale height of the air that bends rays between scatterings."""
REFRACTIVITY = 2.8e-4
"""Its n - 1 at the ground."""
NEAR_KM = 1e-6
"""Distance at which altitudes count as one."""
ABOVE = 10
"""Rays from a layer above its horizontal."""
GRAZING = 9
"""Rays from a layer between its horizontal and the ground's horizon."""
BELOW = 5
"""Rays from a layer to the ground."""
RAYS = ABOVE + GRAZING + BELOW
"""Rays from a layer under one azimuth."""
SUNLIT_KM = np.unique(np.append(BOUNDARY_KM, [1.7, 3, 4, 4.5, 5.5, 28, 33, 42, 48, 54, 66, 72, 82, 90]))
"""Boundaries of layers of the sunbeam, those of diffuse light among them."""
SEGMENTS_AT_ONCE = 64
"""Segments whose zenith angles are computed at once: they stay in the processor's cache."""
LAYERS = BOUNDARY_KM.size
"""With the ground."""
ANGLES = ZENITH_DEG.size
FINE_ZENITH_DEG = np.arange(0.0, ZENITH_DEG[-1] + 0.5 * FINE_DEG, FINE_DEG)
"""Local solar zenith angles along rays [deg]."""


class Grid(NamedTuple):
    """Rays in A azimuths from the sun over half a turn, through layers between these boundaries [km]; the ground counts
    as one more, the last; whether what a layer sends of the light that it collects has directions; and of how many rays
    segments are summed by one product of matrices."""

    azimuths: int
    boundary_km: tuple[float, ...]
    directed: bool
    at_once: int

    @property
    def azimuth_rad(self) -> np.ndarray:
        """Azimuths (A,)."""
        return (np.arange(self.azimuths) + 0.5) * np.pi / self.azimuths


SUNLIT = Grid(7, tuple(SUNLIT_KM.tolist()), directed=False, at_once=2)
"""Of light of the sunbeam."""
DIFFUSE = Grid(4, tuple(BOUNDARY_KM.tolist()), directed=True, at_once=4)
"""Of light scattered before, which is smoother."""
WAVES = SUNLIT.azimuths
"""Orders of waves around the zenith that these azimuths tell apart."""


class Rays(NamedTuple):
    """N segments of R rays, RAYS from each layer between BOUNDARY_KM and from the ground, under C zenith angles of the
    sun and A azimuths from it; of a grid with G layers.

    at_once: of how many rays, Z, segments are summed at once
    ray, layer, length_km (N,): of each segment its ray, layer of the grid and length
    first (R + 1,): first segment of each ray, and N; on_ground: segments that are the ground
    place (U, C A): of the U different segments, indices of (layer, fine zenith angle) of what one sends to the start of
        its ray; where it has directions, of (layer, azimuth, elevation LEAVING_DEG, fine zenith angle); row (N,): which
        of them each segment is
    moments (L + 1, m + 9, A r): weights of these rays in the m moments of radiance, and in the three of polarisation
        with the sun in the zenith, 45 deg from it and on the horizon
    """

    at_once: int
    ray: np.ndarray
    layer: np.ndarray
    length_km: np.ndarray
    first: np.ndarray
    on_ground: np.ndarray
    place: np.ndarray
    row: np.ndarray
    moments: np.ndarray

    def weights(self, parts: np.ndarray) -> list[tuple[np.ndarray, np.ndarray]]:
        """Parts (N, p) that segments send to the start of their rays, by Z rays in the rows of these, (p Z, n), with
        their `row` (n,)."""
        out = np.zeros((*parts.shape, self.at_once), parts.dtype)
        out[np.arange(self.ray.size), :, self.ray % self.at_once] = parts
        out, first = out.reshape(self.ray.size, -1), self.first[:: self.at_once].tolist()
        return [(out[a:b].T, self.row[a:b]) for a, b in pairwise(first)]

    def arriving(
        self, source: np.ndarray, weights: list[tuple[np.ndarray, np.ndarray]], sent: np.ndarray
    ) -> np.ndarray:
        """What segments send, by `place`, times `weights` of p parts, summed over each ray, (p, R / Z, Z, C A); sent
        (U, C A) is overwritten."""
        source.take(self.place, out=sent, mode="clip")
        out = np.empty((len(weights), len(weights[0][0]), sent.shape[1]), sent.dtype)
        segments = np.empty((max(row.size for _, row in weights), sent.shape[1]), sent.dtype)
        for (part, row), one in zip(weights, out, strict=True):
            np.matmul(part, sent.take(row, axis=0, out=segments[: row.size], mode="clip"), out=one)
        return np.moveaxis(out.reshape(len(out), -1, self.at_once, sent.shape[1]), 1, 0)

    def mean(self, radiance: np.ndarray) -> np.ndarray:
        """The m moments (L + 1, C, m) of radiance by azimuths and rays (L + 1, C, A r)."""
        return radiance @ self.moments[:, :-9].swapaxes(1, 2)

    def polarised(self, radiance: np.ndarray) -> np.ndarray:
        """The three moments of polarisation (L + 1, C, 3) of what air scatters once, (L + 1, C, A r)."""
        high, between, low = np.split(radiance @ self.moments[:, -9:].swapaxes(1, 2), 3, axis=2)
        c, s = (f(np.radians(ZENITH_DEG))[:, None].astype(np.float32) for f in (np.cos, np.sin))
        return (c * c - c * s) * high + 2.0 * c * s * between + (s * s - c * s) * low


def by_azimuth(radiance: np.ndarray) -> np.ndarray:
    """Radiance (R / Z, Z, C A) in the order of `Rays.moments`, (L + 1, C, A r)."""
    parted = radiance.reshape(LAYERS, RAYS, ANGLES, -1)
    return np.ascontiguousarray(parted.transpose(0, 2, 3, 1)).reshape(LAYERS, ANGLES, -1)


def gauss(count: int, power: int = 1) -> tuple[np.ndarray, np.ndarray]:
    """Nodes and weights of Gauss's rule from 0 to 1 over the root of this power."""
    node, weight = np.polynomial.legendre.leggauss(count)
    root = 0.5 * (node + 1.0)
    return root**power, 0.5 * power * root ** (power - 1) * weight


def segments(grid: Grid) -> np.ndarray:
    """Segments of rays, each in one layer, (N, 6): number of the ray (RAYS from each layer, the ground last), layer of
    the grid, length [km], angle at the Earth's centre from start to middle [rad], cosine of the ray's zenith angle,
    weight."""
    boundary = np.array(grid.boundary_km)
    altitude = np.unique(np.append(sublayers(boundary), START_KM).round(9))
    parts = Parts.of(altitude, _refractive_index(altitude), EARTH_RADIUS_KM)
    first, (cosine, weight) = np.searchsorted(altitude, START_KM - NEAR_KM), directions()
    b = (parts.x[first][:, None] * np.sqrt(1.0 - cosine * cosine)).ravel()
    path, angle = parts.through(b)
    cosine, weight, part = cosine.ravel(), weight.ravel(), np.arange(altitude.size - 1)
    above, falls = part >= np.repeat(first, RAYS)[:, None], (cosine < 0.0)[:, None]
    below, hit = ~above & falls & (path > 0.0), falls[:, 0] & (b < parts.x[0])
    # down to the lowest point, and up again
    ray, place = np.nonzero(np.concatenate([below[:, ::-1], (above | below) & ~hit[:, None]], axis=1))
    place = np.where(place < part.size, part.size - 1 - place, place - part.size)
    path, angle = path[ray, place], angle[ray, place]
    layer = (np.searchsorted(boundary, 0.5 * (altitude[1:] + altitude[:-1])) - 1)[place]
    end, other_ray = np.cumsum(angle), np.diff(ray, prepend=-1) != 0
    total = end - (end - angle)[other_ray][np.cumsum(other_ray) - 1]  # from the start of the ray to the end of a part
    begin = np.flatnonzero(other_ray | (np.diff(layer, prepend=-1) != 0))
    length, moment = (np.add.reduceat(values, begin) for values in (path, path * (total - 0.5 * angle)))
    last = np.flatnonzero(np.append(other_ray[1:], True))[hit]
    ground = np.array([np.flatnonzero(hit), np.full(last.size, boundary.size - 1), np.zeros(last.size), total[last]])
    rows = np.concatenate([[ray[begin], layer[begin], length, moment / length], ground], axis=1)
    rows = rows[:, np.argsort(rows[0], kind="stable")]
    return np.concatenate([rows, [cosine[rows[0].astype(int)], weight[rows[0].astype(int)]]]).T


@functools.cache
def directions() -> tuple[np.ndarray, np.ndarray]:
    """Cosines of the zenith angles of the rays from layers and, last, the ground, and their weights in means, (L + 1,
    r)."""
    x = _refractive_index(START_KM) * (EARTH_RADIUS_KM + START_KM)
    horizon = np.sqrt(1.0 - (x[-1] / x[:-1]) ** 2)[:, None]
    (up, w_up), (grazing, w_grazing), (down, w_down) = gauss(ABOVE, POWER), gauss(GRAZING), gauss(BELOW, POWER_BELOW)
    cosine = [-horizon - (1.0 - horizon) * down[::-1], -horizon * grazing[::-1], up + 0.0 * horizon]
    weight = [(1.0 - horizon) * w_down[::-1], horizon * w_grazing[::-1], w_up + 0.0 * horizon]
    ground, of_ground = gauss(RAYS)
    cosines, weights = np.concatenate(cosine, axis=1), 0.5 * np.concatenate(weight, axis=1)
    return np.vstack([cosines, ground]), np.vstack([weights, 2.0 * ground * of_ground])


def _refractive_index(altitude_km: np.ndarray) -> np.ndarray:
    return 1.0 + REFRACTIVITY * np.exp(-altitude_km / REFRACTIVITY_SCALE_KM)


@functools.cache
def rays(grid: Grid) -> Rays:
    """The rays between scatterings."""
    ray, layer, length, phi, cosine, _ = segments(grid).T
    ray, layer = ray.astype(int), layer.astype(int)
    start = layer[:, None]
    if grid.directed:  # into azimuths of the rays and elevations near theirs at each segment
        elevation = np.degrees(np.arcsin(cosine) + phi)
        near = np.abs(elevation[:, None] - LEAVING_DEG).argmin(axis=1)
        start = (start * grid.azimuths + np.arange(grid.azimuths)) * LEAVING_DEG.size + near[:, None]
    up = np.cos(np.radians(ZENITH_DEG))[:, None]
    aside = np.sin(np.radians(ZENITH_DEG))[:, None] * np.cos(grid.azimuth_rad)
    place = np.empty((ray.size, ANGLES, grid.azimuths), np.int32)
    for some in (slice(first, first + SEGMENTS_AT_ONCE) for first in range(0, ray.size, SEGMENTS_AT_ONCE)):
        local = np.cos(phi[some, None, None]) * up + np.sin(phi[some, None, None]) * aside
        fine = np.rint(np.degrees(np.arccos(np.clip(local, -1.0, 1.0))) / FINE_DEG)
        place[some] = start[some, None] * FINE_ZENITH_DEG.size + np.minimum(fine, FINE_ZENITH_DEG.size - 1)
    place = place.reshape(ray.size, -1)
    _, unique, row = np.unique(place.view(f"V{place[0].nbytes}"), return_index=True, return_inverse=True)
    return Rays(
        grid.at_once,
        ray,
        layer,
        length,
        np.searchsorted(ray, np.arange(LAYERS * RAYS + 1)),
        np.flatnonzero(layer == len(grid.boundary_km) - 1),
        place[unique].astype(int),
        row.ravel(),
        _moments(grid),
    )


def _moments(grid: Grid) -> np.ndarray:
    """`Rays.moments`."""
    mu, weight = (values[:, None] for values in directions())
    azimuth = np.cos(grid.azimuth_rad)[:, None]
    # parts of the ray's direction upwards and towards the sun
    u, s = mu + 0.0 * azimuth, np.sqrt(1.0 - mu * mu) * azimuth
    order = [m for n in range(DEGREE + 1) for m in range(n + 1)]
    # waves shorter than twice the distance of azimuths look like longer ones
    parts = [part * (m < grid.azimuths) for m, part in zip(order, harmonics(u, s), strict=True)]
    for chi in np.radians([0.0, 45.0, 90.0]):
        towards = u * np.cos(chi) + s * np.sin(chi)
        sine2, across_u, across_s = 1.0 - towards**2, np.cos(chi) - u * towards, np.sin(chi) - s * towards
        parts.append(sine2 * (1.0 - u * u) - 2.0 * across_u * across_u)
        parts.append(-sine2 * u * s - 2.0 * across_u * across_s)
        parts.append(sine2 * (1.0 - s * s) - 2.0 * across_s * across_s)
    moments = np.stack(parts, axis=1) * (weight / grid.azimuths)[:, None]
    return moments.reshape(LAYERS, len(parts), -1).astype(np.float32)


@functools.cache
def sun_legendre(grid: Grid) -> np.ndarray:
    """Legendre polynomials of the cosine between the sun and the r rays of each layer, (CUT, R / Z, Z, C A)."""
    mu, chi = directions()[0].reshape(-1, grid.at_once)[:, :, None, None], np.radians(ZENITH_DEG)[:, None]
    towards = mu * np.cos(chi) + np.sqrt(1.0 - mu * mu) * np.cos(grid.azimuth_rad) * np.sin(chi)
    towards = single(towards.reshape(*mu.shape[:2], -1))
    out = [np.ones_like(towards), towards]
    for n in range(1, CUT - 1):
        out.append(((2 * n + 1) * towards * out[n] - n * out[n - 1]) / (n + 1))
    return np.stack(out)


@functools.cache
def turned() -> np.ndarray:
    """Weights of the waves of light along rays in those of light that leaves into LEAVING_DEG, times Legendre
    polynomials of the angles between them, (L, waves, O, r, CUT)."""
    mu, weight = (values[:-1] for values in directions())
    up, flat = (f(np.radians(LEAVING_DEG))[:, None, None] for f in (np.sin, np.cos))
    apart = (np.arange(2 * CUT) + 0.5) * np.pi / (2 * CUT)
    mu, level = mu[:, None, :, None], np.sqrt(1.0 - mu * mu)[:, None, :, None]
    cosine = np.clip(up * mu + flat * level * np.cos(apart), -1.0, 1.0)  # L O r
    waves = np.cos(np.outer(np.arange(DIFFUSE.azimuths), apart)) / apart.size
    out = np.moveaxis(waves @ legvander(cosine, CUT - 1), 3, 1)
    return (out * weight[:, None, None, :, None]).astype(np.float32)


@functools.cache
def into_azimuths(grid: Grid) -> np.ndarray:
    """Weights of waves of `turned` in light that comes along azimuths of a grid and leaves into those of DIFFUSE, on
    both sides of the sun, (A', A, waves)."""
    wave = np.arange(DIFFUSE.azimuths)
    into, along = (np.cos(np.outer(one.azimuth_rad, wave)) for one in (DIFFUSE, grid))
    both = np.where(wave > 0, 2.0, 1.0) * into[:, None] * along / grid.azimuths
    return both.astype(np.float32)


@functools.cache
def at_fine_zeniths() -> np.ndarray:
    """Light at FINE_ZENITH_DEG from that at ZENITH_DEG, (F, C): linear, the reference taken off."""
    below, f = between(FINE_ZENITH_DEG)
    out, row = np.zeros((f.size, ANGLES)), np.arange(f.size)
    out[row, below] = 1.0 - f
    out[row, below + 1] = f
    return (out * np.exp(log_reference(FINE_ZENITH_DEG)[:, None] - log_reference(ZENITH_DEG))).astype(np.float32)


_BEFORE = np.clip(np.searchsorted(ZENITH_DEG, FINE_ZENITH_DEG, side="right") - 1, 0, ANGLES - 2)
"""Index of the zenith angle before each of FINE_ZENITH_DEG, all of ZENITH_DEG among them."""


def between(degrees: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Index of the zenith angle before each, and the part of the way to the next."""
    degrees = np.minimum(degrees, ZENITH_DEG[-1])
    below = _BEFORE[(degrees / FINE_DEG).astype(int)]
    return below, (degrees - ZENITH_DEG[below]) / np.diff(ZENITH_DEG)[below]


def harmonics(up: np.ndarray, aside: np.ndarray) -> list[np.ndarray]:
    """Harmonics of directions by their parts upwards and towards the sun, of degree 0 to DEGREE, each with its orders:
    those of one degree, times each other for two directions and summed, are the mean of the Legendre polynomials of the
    angle between the first direction and the second or its mirror image."""
    functions, around = legendre_functions(up), waves(up, aside)
    return [functions[n, m] * around[m] for n in range(DEGREE + 1) for m in range(n + 1)]


def legendre_functions(up: np.ndarray) -> dict[tuple[int, int], np.ndarray]:
    """What `harmonics` of a degree and order are over the `waves` of this order."""
    functions: dict[tuple[int, int], np.ndarray] = {}
    for m in range(DEGREE + 1):
        before, now = np.zeros_like(up), float(np.prod(np.arange(1, 2 * m, 2))) + 0.0 * up
        for n in range(m, DEGREE + 1):
            functions[n, m] = sqrt((2.0 if m else 1.0) * factorial(n - m) / factorial(n + m)) * now
            before, now = now, ((2 * n + 1) * up * now - (n + m) * before) / (n - m + 1)
    return functions


def waves(up: np.ndarray, aside: np.ndarray) -> list[np.ndarray]:
    """sin^m(zenith angle) cos(m azimuth) of directions, m from 0 to DEGREE."""
    across = np.sqrt(np.maximum(1.0 - up * up - aside * aside, 0.0))
    cosine, sine = [np.ones_like(aside), aside], across
    for _ in range(DEGREE - 1):
        cosine.append(cosine[-1] * aside - sine * across)
        sine = sine * aside + cosine[-2] * across
    return cosine


def log_reference(zenith_deg: np.ndarray) -> np.ndarray:
    """About the logarithm of the light of the sky over that of day, by which diffuse light is interpolated."""
    beyond = np.maximum(np.asarray(zenith_deg, float) - DECAY_DEG, 0.0)
    return -np.where(beyond < 8.0, DECAY * beyond**2 / 16.0, DECAY * (beyond - 4.0))


def reference_slope(zenith_deg: np.ndarray) -> np.ndarray:
    """By how much `log_reference` changes a degree."""
    return -DECAY * np.clip((zenith_deg - DECAY_DEG) / 8.0, 0.0, 1.0)
