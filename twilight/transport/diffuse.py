"""About the light of a clear sky that is scattered more than once, M_0, by numpy alone: what `clear_air` corrects.

Light is followed from layer to layer, under C zenith angles of the sun at the place itself: rays leave each layer and
the ground in directions of a Gaussian rule that is dense along the horizon, and A azimuths from the sun.  The radiance
that comes along a ray,

    I = sum over its segments of  T (1 - exp(-tau)) albedo P(ray . sun) B  /  of later orders: albedo J,

B being the sunbeam, is summed for air, both aerosols and the ground apart, so phase functions act with all that is
left of them when their peak is cut off at the Legendre moment CUT.  Nine moments of it stand for the light of a layer:
J, the mean of I; the means of I u, I s, I u^2, I u s, I s^2, with u and s the parts upwards and towards the sun of the
direction it comes from; and three of the polarisation of what air scattered once.  Along a line of sight the last
scattering takes the moments of phase functions up to the second.
"""

from __future__ import annotations

import functools
from math import factorial
from typing import NamedTuple

import numpy as np

from twilight.transport.shells import (
    AIR,
    ALTITUDE_KM,
    DARK,
    EARTH_RADIUS_KM,
    HIGH,
    LOW,
    SUBLAYERS,
    Air,
    Line,
    Shells,
    lit_fraction,
    log_mean,
    single,
    summed,
)

BOUNDARY_KM = np.array([0, 0.45, 1.35, 2, 3, 4.5, 6, 8, 10, 13, 16, 19, 24, 30, 39, 60, 100])
"""Boundaries of the layers of diffuse light, all in ALTITUDE_KM; the ground counts as the layer above them."""
ZENITH_DEG = np.concatenate([[0, 25, 45, 60, 70, 76, 80, 83, 85.5, 87.5], np.arange(89.0, 113.0), [115, 118, 122]])
"""Local solar zenith angles of diffuse light [deg]."""
POLAR = 7
"""Rays on each side of the horizon."""
POWER = 4
"""Root of their cosines that follows Gauss's rule."""
AZIMUTHS = 6
"""Azimuths over half a turn."""
CUT = 8
"""Legendre moment that stands for the forward peak, whose light counts as not scattered."""
DEGREE = 4
"""Degree of the moments of radiance that the last scattering takes."""
SCATTERINGS = 8
"""Orders of scattering that are followed."""
MOST_RATIO = 0.95
"""Largest ratio of two of them of which a geometric series is summed."""
DECAY_DEG = 88.0
"""Zenith angle from which on `_log_reference` falls."""
DECAY = 1.1
"""By how much it falls a degree, from 8 deg beyond it on."""
LEAST_PHASE = 0.02
"""Least value of 4 pi times a phase function whose series is cut off."""
FINE_DEG = 0.25
"""Steps of local zenith angles along rays [deg]."""
OPAQUE = 60.0
"""Optical depth of the ground."""
REFRACTIVITY_SCALE_KM = 8.0
"""Scale height of the air that bends rays between scatterings."""
REFRACTIVITY = 2.8e-4
"""Its n - 1 at the ground."""
LONGEST = 0.1
"""Longest segment of a ray, as an angle at the Earth's centre [rad]."""
LAYERS = BOUNDARY_KM.size
"""With the ground."""
ANGLES = ZENITH_DEG.size


class Rays(NamedTuple):
    """N segments of R rays, under C zenith angles of the sun and A azimuths from it.

    ray, layer, length_km (N,): of each segment its ray, layer and length; first (R,): first segment of each ray
    start (L + 2,): first segment of the rays from each layer; on_ground (G,): segments that are the ground
    fine (F, C): light at F local zenith angles, FINE_DEG apart, from that at ZENITH_DEG; place (C A, N): index of
        (layer, fine angle) of each segment
    legendre (L + 1, C A, r, CUT): Legendre polynomials of the cosine between the sun and the r rays of each layer
    moments (L + 1, C, m + 3, A r): weights of these rays in the m moments of radiance, and the three of polarisation
    pair_weight, pair_segment (P,): entries of the matrix of mean light, ordered by place in it; pairs, starts: these
        places, in ((L + 1) C)^2, and their first entries
    """

    ray: np.ndarray
    layer: np.ndarray
    length_km: np.ndarray
    first: np.ndarray
    start: np.ndarray
    on_ground: np.ndarray
    fine: np.ndarray
    place: np.ndarray
    legendre: np.ndarray
    moments: np.ndarray
    pair_weight: np.ndarray
    pair_segment: np.ndarray
    pairs: np.ndarray
    starts: np.ndarray

    def collected(self, light: np.ndarray, parts: np.ndarray) -> np.ndarray:
        """Light ((L + 1) C,) at the segments times parts of it (N, p), summed over each ray, (L + 1, C A, r, p)."""
        count, p = 2 * POLAR, parts.shape[1]
        by_ray = np.zeros((len(parts), count, p), parts.dtype)
        by_ray[np.arange(len(parts)), self.ray % count] = parts
        at_segments = np.take(light.reshape(LAYERS, ANGLES) @ self.fine.T, self.place)
        out = np.empty((LAYERS, len(self.place), count * p), np.result_type(light, parts))
        for k, some in enumerate(map(slice, self.start[:-1], self.start[1:])):
            np.matmul(at_segments[:, some], by_ray[some].reshape(-1, count * p), out=out[k])
        return out.reshape(LAYERS, -1, count, p)

    def mean(self, rows: slice, radiance: np.ndarray) -> np.ndarray:
        """Some of the moments, (L + 1, C, m), of radiance (L + 1, C A, r)."""
        return (self.moments[:, :, rows] @ radiance.reshape(LAYERS, ANGLES, -1, 1))[..., 0]


def gauss(count: int, power: int = 1) -> tuple[np.ndarray, np.ndarray]:
    """Nodes and weights of Gauss's rule from 0 to 1 over the root of this power."""
    node, weight = np.polynomial.legendre.leggauss(count)
    root = 0.5 * (node + 1.0)
    return root**power, 0.5 * power * root ** (power - 1) * weight


def segments() -> np.ndarray:
    """Segments of rays, (N, 6): the layer where the ray starts, its number, the layer that is crossed, length [km],
    angle at the Earth's centre from start to middle [rad], cosine of the ray's zenith angle; and the ray's weight."""
    up, weight = gauss(POLAR, POWER)
    around = np.concatenate([-up[::-1], up]), 0.5 * np.concatenate([weight[::-1], weight])
    up, weight = gauss(2 * POLAR)
    above, rows = (up, 2.0 * up * weight), []
    for k in range(LAYERS):
        ground = k == LAYERS - 1
        for n, (c, w) in enumerate(zip(*(above if ground else around), strict=True)):
            rows += [(2 * POLAR * k + n, *part, c, w) for part in _segments_of(float(c), None if ground else k)]
    return np.array(rows)


def _segments_of(cosine: float, layer: int | None) -> list[tuple[int, float, float]]:
    """Layer, length [km] and angle at the Earth's centre from the ray's start to its middle [rad] of the parts of a ray
    in one layer each.  layer: where it starts, in the middle; None: from the ground"""
    low, high = BOUNDARY_KM[:-1, None], BOUNDARY_KM[1:, None]
    part = np.append((low + np.arange(SUBLAYERS) / SUBLAYERS * (high - low)).ravel(), BOUNDARY_KM[-1])
    radius, index = EARTH_RADIUS_KM + part, 1.0 + REFRACTIVITY * np.exp(-part / REFRACTIVITY_SCALE_KM)
    x, mean = index * radius, 0.5 * (index[1:] + index[:-1])
    slope = np.diff(x) / np.diff(radius)
    first = 0 if layer is None else SUBLAYERS * layer + SUBLAYERS // 2
    b = x[first] * np.sqrt(1.0 - cosine * cosine)
    beyond = np.maximum(x, b)
    path = np.diff(np.sqrt(beyond * beyond - b * b)) / slope
    angle = np.diff(np.arccos(b / beyond)) * mean / slope
    passed = list(range(first, path.size))
    hit = cosine < 0.0 and bool(b < x[0])
    if cosine < 0.0:
        below = [i for i in range(first - 1, -1, -1) if path[i] > 0.0]
        passed = below if hit else below + below[::-1] + passed
    groups: list[list[tuple[int, float, float]]] = []
    total = spanned = 0.0  # angles of the ray so far, and of the last group, which is of one layer and at most LONGEST
    for i in passed:
        if not groups or groups[-1][0][0] != i // SUBLAYERS or spanned + angle[i] > LONGEST:
            groups.append([])
            spanned = 0.0
        groups[-1].append((i // SUBLAYERS, float(path[i]), total + 0.5 * float(angle[i])))
        spanned += angle[i]
        total += float(angle[i])
    out = []
    for group in groups:
        length = sum(one[1] for one in group)
        out.append((group[0][0], length, sum(one[1] * one[2] for one in group) / length))
    return [*out, (LAYERS - 1, 0.0, total)] if hit else out


@functools.lru_cache(maxsize=1)
def rays() -> Rays:
    """The rays between scatterings."""
    ray, layer, length, angle, cosine, weight = segments().T
    ray, layer, phi = ray.astype(int), layer.astype(int), angle
    first = np.flatnonzero(np.diff(ray, prepend=-1))
    azimuth = np.cos((np.arange(AZIMUTHS) + 0.5) * np.pi / AZIMUTHS)
    chi = np.radians(ZENITH_DEG)[:, None, None]
    local = np.cos(chi) * np.cos(phi) + np.sin(chi) * np.sin(phi) * azimuth[:, None]
    angles_deg = np.arange(0.0, ZENITH_DEG[-1] + 0.5 * FINE_DEG, FINE_DEG)
    rounded = np.rint(np.degrees(np.arccos(np.clip(local, -1.0, 1.0))) / FINE_DEG).astype(int)  # C A N
    rounded = np.minimum(rounded, angles_deg.size - 1)
    below, f = _between(angles_deg)
    fine = np.zeros((angles_deg.size, ANGLES))
    fine[np.arange(angles_deg.size), below] = 1.0 - f
    fine[np.arange(angles_deg.size), below + 1] = f
    fine *= np.exp(_log_reference(angles_deg)[:, None] - _log_reference(ZENITH_DEG))
    place = layer * ANGLES + below[rounded]
    # the matrix of mean light: entries of one segment at one place, of all azimuths together
    from_layer = ray // (2 * POLAR)
    row = (from_layer * ANGLES + np.arange(ANGLES)[:, None, None]) * (LAYERS * ANGLES)
    key = np.concatenate([((row + place + more) * ray.size + np.arange(ray.size)).ravel() for more in (0, 1)])
    entries, inverse = np.unique(key, return_inverse=True)
    both = np.concatenate([fine[rounded, below[rounded] + more].ravel() for more in (0, 1)]) / AZIMUTHS
    pair, segment = np.divmod(entries, ray.size)
    pair_weight = np.bincount(inverse, both) * weight[segment]
    starts = np.flatnonzero(np.diff(pair, prepend=-1))
    # moments: u and s are the parts of the ray's direction upwards and towards the sun
    mu, sun = cosine[first], azimuth[:, None]
    u, s = mu + 0.0 * sun, np.sqrt(1.0 - mu * mu) * sun
    w, towards = weight[first] / AZIMUTHS, u * np.cos(chi) + s * np.sin(chi)  # C A R
    flat, sine2 = np.ones_like(towards), 1.0 - towards**2
    across_u, across_s = np.cos(chi) - u * towards, np.sin(chi) - s * towards
    parts = [part * flat for part in harmonics(u, s)]
    parts.append(sine2 * (1.0 - u * u) - 2.0 * across_u * across_u)
    parts.append(-sine2 * u * s - 2.0 * across_u * across_s)
    parts.append(sine2 * (1.0 - s * s) - 2.0 * across_s * across_s)
    moments = np.array([w * part for part in parts]).reshape(len(parts), ANGLES, AZIMUTHS, LAYERS, -1)
    moments = moments.transpose(3, 1, 0, 2, 4).reshape(LAYERS, ANGLES, len(parts), -1)
    legendre = np.polynomial.legendre.legvander(towards.reshape(-1, LAYERS, 2 * POLAR), CUT - 1)
    return Rays(
        ray,
        layer,
        length,
        first,
        np.append(first[:: 2 * POLAR], ray.size),
        np.flatnonzero(layer == LAYERS - 1),
        fine.astype(np.float32),
        (layer * angles_deg.size + rounded).reshape(-1, ray.size),
        np.ascontiguousarray(np.swapaxes(legendre, 0, 1), np.float32),
        moments.astype(np.float32),
        pair_weight.astype(np.float32),
        segment,
        pair[starts],
        starts,
    )


def _between(degrees: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Index of the zenith angle before each, and the part of the way to the next."""
    degrees = np.minimum(degrees, ZENITH_DEG[-1])
    below = np.clip(np.searchsorted(ZENITH_DEG, degrees, side="right") - 1, 0, ANGLES - 2)
    return below, (degrees - ZENITH_DEG[below]) / (ZENITH_DEG[below + 1] - ZENITH_DEG[below])


def harmonics(up: np.ndarray, aside: np.ndarray) -> list[np.ndarray]:
    """Harmonics of directions by their parts upwards and towards the sun, of degree 0 to DEGREE, each with its orders:
    those of one degree, times each other for two directions and summed, are the mean of the Legendre polynomials of the
    angle between the first direction and the second or its mirror image."""
    x, y = aside, np.sqrt(np.maximum(1.0 - up * up - aside * aside, 0.0))
    # sin^m cos(m azimuth), sin^m sin(m azimuth), and the Legendre functions over sin^m
    cosine, sine = np.ones_like(x), np.zeros_like(x)
    functions = {}
    for m in range(DEGREE + 1):
        before, now = 0.0, float(np.prod(np.arange(1, 2 * m, 2))) + 0.0 * up
        for n in range(m, DEGREE + 1):
            scale = np.sqrt((2.0 if m else 1.0) * factorial(n - m) / factorial(n + m))
            functions[n, m] = scale * now * cosine
            before, now = now, ((2 * n + 1) * up * now - (n + m) * before) / (n - m + 1)
        cosine, sine = cosine * x - sine * y, sine * x + cosine * y
    return [functions[n, m] for n in range(DEGREE + 1) for m in range(n + 1)]


def _log_reference(zenith_deg: np.ndarray) -> np.ndarray:
    """About the logarithm of the light of the sky over that of day, by which diffuse light is interpolated."""
    beyond = np.maximum(np.asarray(zenith_deg, float) - DECAY_DEG, 0.0)
    return -np.where(beyond < 8.0, DECAY * beyond**2 / 16.0, DECAY * (beyond - 4.0))


def _positive(first: np.ndarray, further: np.ndarray) -> np.ndarray:
    """The sum of the first term of a series, at least 0, and further ones; never negative, without a kink."""
    ratio = further / np.maximum(first, 1e-35)
    return first * np.where(ratio.real > 0.0, 1.0 + ratio, np.exp(np.minimum(ratio, 0.0)))


def diffuse_light(air: Air, shells: Shells) -> np.ndarray:
    """The moments of light scattered at least once, over F0, in layers between BOUNDARY_KM at ZENITH_DEG, the
    reference taken off, (L C, 9, W)."""
    r, kinds = rays(), _kinds(air)
    # the sunbeam, and what it lights
    zenith = np.radians(ZENITH_DEG)
    places = np.array([int(np.argmin(np.abs(shells.boundary_km - z))) for z in BOUNDARY_KM])
    beam, edge = shells.log_sunbeam(places[:, None], zenith)
    direct = log_mean(beam[:-1], beam[1:]) * lit_fraction(edge[:-1], edge[1:])[..., None] / (4.0 * np.pi)
    lit = np.maximum(np.cos(zenith), 0.0) * (edge[0] > 0.0)
    ground = air.ground_albedo / np.pi * np.exp(beam[0]) * lit[:, None]
    light = single(np.concatenate([direct, ground[None]])).reshape(LAYERS * ANGLES, -1)
    # what comes from each segment to the start of its ray
    tau = kinds.extinction_per_km[r.layer] * r.length_km[:, None]
    tau[r.on_ground] = OPAQUE
    passed = np.cumsum(tau, axis=0) - tau
    passed -= passed[r.first][r.ray]
    reaching = np.exp(-passed) * -np.expm1(-tau)
    parts = np.concatenate([kinds.albedo[:, r.layer] * reaching, np.zeros_like(reaching)[None]])
    parts[-1, r.on_ground] = reaching[r.on_ground]
    parts = np.ascontiguousarray(single(parts).transpose(2, 1, 0))
    depolarised = single((1.0 - air.depolarisation) / (2.0 + air.depolarisation))
    ground_albedo, series = single(air.ground_albedo), single(kinds.series)
    out = [
        _of_wavelength(r, light[:, w], parts[w], series[..., w], depolarised[w], ground_albedo[w])
        for w in range(depolarised.size)
    ]
    moments = np.stack(out, axis=-1)[:-1]
    moments *= np.exp(-_log_reference(ZENITH_DEG)).astype(np.float32)[:, None, None]
    return moments.reshape(-1, *moments.shape[2:])


def _of_wavelength(
    r: Rays,
    light: np.ndarray,
    parts: np.ndarray,
    series: np.ndarray,
    depolarised: np.floating,
    ground_albedo: np.floating,
) -> np.ndarray:
    """The moments (L + 1, C, m + 3) at one wavelength.

    light ((L + 1) C,): what the sunbeam lights; parts (N, 4): part of it that each segment sends to the start of its
    ray, scattered by air, by both aerosols and by the ground; series (2, CUT): of the phase functions of aerosols
    """
    by_air, *by_aerosols, radiance = np.moveaxis(r.collected(light, parts), -1, 0)
    radiance = radiance + by_air * (1.0 + depolarised * r.legendre[..., 2])
    phases = r.legendre @ series.T
    for n, scattered in enumerate(by_aerosols):
        radiance += scattered * np.maximum(phases[..., n], LEAST_PHASE)
    first = r.mean(slice(0, -3), radiance)
    polarised = r.mean(slice(-3, None), by_air) * (np.float32(0.75) * depolarised)
    every = parts.sum(axis=1)
    now = first[..., 0].copy()
    now[-1] *= ground_albedo
    total = _all_orders(r, every, ground_albedo, now.ravel())
    more = r.mean(slice(1, -3), r.collected(total, every[:, None]))
    return np.concatenate([total.reshape(LAYERS, ANGLES, 1), first[..., 1:] + more, polarised], axis=2)


class _Kinds(NamedTuple):
    """extinction_per_km (L + 1, W), 0 of the ground; albedo (3, L + 1, W) of air, of aerosol low and high, 0 of the
    ground; series (2, CUT, W): (2 l + 1) x moments of both aerosols; all without the peaks."""

    extinction_per_km: np.ndarray
    albedo: np.ndarray
    series: np.ndarray


def _kinds(air: Air) -> _Kinds:
    """What scatters in the layers between BOUNDARY_KM."""
    place = np.searchsorted(ALTITUDE_KM, BOUNDARY_KM - 1e-9)
    of_air, absorption, extinction, low, high = np.diff(summed(air.depth)[:, place], axis=1)
    moments = air.mixed_moments[:, :, : CUT + 1]
    peak = np.where(moments[..., CUT].real > 0.0, moments[..., CUT], 0.0)
    scattering = np.stack([of_air, (1.0 - peak[0]) * low, (1.0 - peak[1]) * high])
    depth = of_air + absorption + extinction - peak[0] * low - peak[1] * high
    degree = 2.0 * np.arange(CUT) + 1.0
    series = degree * (moments[..., :CUT] - peak[..., None]) / (1.0 - peak[..., None])
    albedo = np.pad(scattering / depth, ((0, 0), (0, 1), (0, 0)))
    return _Kinds(np.pad(depth / np.diff(BOUNDARY_KM)[:, None], ((0, 1), (0, 0))), albedo, np.swapaxes(series, 1, 2))


def _all_orders(r: Rays, every: np.ndarray, ground_albedo: np.floating, first: np.ndarray) -> np.ndarray:
    """Mean light of all orders ((L + 1) C,) from the first one, by what reaches from each segment (N,)."""
    matrix = np.zeros(first.size**2, every.dtype)
    matrix[r.pairs] = np.add.reduceat(r.pair_weight * every[r.pair_segment], r.starts)
    matrix = matrix.reshape(first.size, first.size)
    matrix[-ANGLES:] *= ground_albedo
    now = total = first
    for _ in range(SCATTERINGS - 1):
        before, now = now, matrix @ now
        total = total + now
    ratio = np.clip(now / np.maximum(before, 1e-30), 0.0, MOST_RATIO)
    return total + now * ratio / (1.0 - ratio)


def seen_along(
    air: Air,
    shells: Shells,
    light: np.ndarray,
    sun_deg: np.ndarray,
    elevation_deg: np.ndarray,
    azimuth_deg: np.ndarray,
    line: Line,
) -> np.ndarray:
    """M_0 under suns (S,) in directions, (S, E, A, W), from `diffuse_light`: what it scatters along lines of sight."""
    weights, angle, layer = _last_scattering(air, shells, line)
    sun = np.radians(90.0 - np.atleast_1d(sun_deg))[:, None, None, None]
    azimuth = np.cos(np.radians(azimuth_deg))[:, None]
    cosine = np.cos(angle)[:, None] * np.cos(sun) + np.sin(angle)[:, None] * azimuth * np.sin(sun)
    zenith = np.arccos(np.clip(cosine, -1.0, 1.0))  # S E A K
    degrees = np.degrees(zenith)
    below, f = _between(degrees)
    f = f.astype(np.float32)[..., None]
    place = layer * ANGLES + below
    at_points = light[place] * (1.0 - f[..., None]) + light[place + 1] * f[..., None]
    elevation = np.radians(elevation_deg)[:, None]
    u = np.sin(elevation + angle)[:, None] + np.zeros_like(azimuth)
    from_sun = np.cos(sun) * np.sin(elevation)[:, None] + np.sin(sun) * np.cos(elevation)[:, None] * azimuth
    s = np.clip((from_sun - np.cos(zenith) * u) / np.maximum(np.sin(zenith), 1e-3), -1.0, 1.0)
    u, s = (part.astype(np.float32)[..., None] for part in (u, s))
    beside = np.maximum(1.0 - u * u - s * s, 0.0)
    moments = np.moveaxis(at_points, -2, 0)
    q_up2, q_up_aside, q_aside2 = moments[-3:]
    crossed = u * u * q_up2 + 2.0 * u * s * q_up_aside + s * s * q_aside2 - beside * (q_up2 + q_aside2)
    functions = harmonics(u, s)
    weights = weights[:, None, :, None]
    further = -3.0 * weights[-1] * crossed
    for n in range(1, DEGREE + 1):
        first = n * (n + 1) // 2
        of_degree = sum(functions[k] * moments[k] for k in range(first, first + n + 1))
        further = further + (weights[n] + weights[-1] if n == 2 else weights[n]) * of_degree
    source = _positive(weights[0] * moments[0], further) * np.exp(_log_reference(degrees)).astype(np.float32)[..., None]
    return np.maximum(source.sum(axis=3), DARK)


def _last_scattering(air: Air, shells: Shells, line: Line) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Of lines of sight in the layers of diffuse light above the observer: what scattering of J, of the first and the
    second moments by all and of the second by air alone adds, (4, E, K, W); angle at the Earth's centre from him to the
    mean point (E, K) [rad]; layer (K,)."""
    middle = 0.5 * (shells.boundary_km[1:] + shells.boundary_km[:-1])[shells.first :]
    own = np.searchsorted(ALTITUDE_KM, middle) - 1
    peak, moments = air.peaks(air.mixed_moments), air.mixed_moments
    of_air, low, high = air.depth[AIR], air.depth[LOW], air.depth[HIGH]
    followed = moments - peak[..., None]
    by_moment = [(2 * n + 1) * (low * followed[0, :, n] + high * followed[1, :, n]) for n in range(DEGREE + 1)]
    by_moment[0] = by_moment[0] + of_air
    by_moment.append(of_air * (1.0 - air.depolarisation) / (2.0 + air.depolarisation))
    per_km = np.array(by_moment)[:, own] / np.diff(ALTITUDE_KM)[own, None]
    extinction, path = shells.extinction[shells.first :], line.path[:, :, None]
    inside = path * extinction
    thin = np.abs(inside) < 1e-6
    seen = np.where(thin, path, -np.expm1(-inside) / np.where(np.abs(extinction) > 1e-30, extinction, 1.0))
    weights = (np.exp(-line.depth[:, :-1]) * seen) * per_km[:, None]
    layer = np.searchsorted(BOUNDARY_KM, middle) - 1
    first = np.flatnonzero(np.diff(layer, prepend=-1))
    share = line.path * np.exp(-middle / REFRACTIVITY_SCALE_KM)
    angle = 0.5 * (line.angle[:, 1:] + line.angle[:, :-1])
    mean_angle = np.add.reduceat(angle * share, first, axis=1) / np.add.reduceat(share, first, axis=1)
    return single(np.add.reduceat(weights, first, axis=2)), mean_angle, layer[first]
