"""About the light of a clear sky that is scattered more than once, M_0, by numpy alone: what `model` corrects.

Light is followed from layer to layer, under C zenith angles of the sun at the place itself, along the rays of
`rays`: from each layer and the ground in directions dense along the horizon, and A azimuths from the sun.  The
radiance that comes along a ray,

    I = sum over its segments of  T (1 - exp(-tau)) S,

S being what a segment sends of the light that reaches it over what it takes out of the ray: of the sunbeam, albedo
P(ray . sun) B; of light scattered before, the sum over the rays that reach its layer, turned into its direction.  Phase
functions act with all that is left of them when their peak is cut off at the Legendre moment CUT.  FOLLOWED orders are
followed so, the rest is a geometric series.  The moments of I by harmonics up to DEGREE stand for the light of a layer,
and three of the polarisation of what air scattered once.  Along a line of sight the last scattering takes them.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from .rays import (
    ANGLES,
    BOUNDARY_KM,
    CUT,
    DEGREE,
    DIFFUSE,
    LAYERS,
    RAYS,
    REFRACTIVITY_SCALE_KM,
    SUNLIT,
    WAVES,
    ZENITH_DEG,
    Rays,
    at_fine_zeniths,
    between,
    by_azimuth,
    into_azimuths,
    legendre_functions,
    log_reference,
    rays,
    reference_slope,
    sun_legendre,
    turned,
    waves,
)
from .shells import (
    AIR,
    ALTITUDE_KM,
    DARK,
    EXTINCTION,
    Air,
    Line,
    Shells,
    lit_fraction,
    log_means,
    single,
    summed,
)

FOLLOWED = 6
"""Orders of scattering that are followed."""
MOST_RATIO = 0.95
"""Largest ratio of two of them of which a geometric series is summed."""
LEAST_PHASE = 0.02
"""Least value of 4 pi times a phase function whose series is cut off."""
LEAST_PART = 0.1
"""What further moments leave of the mean light at least, before they count less."""
MOST_CHANGE = 1.0
"""By how much ln(light of a layer) changes at most because it is seen nearer or farther than on the average."""
DIRECTIONS_AT_ONCE = 300
"""About how many suns and directions are seen at once: what they take stays in the processor's cache."""
OPAQUE = 60.0
"""Optical depth of the ground."""


def _positive(first: np.ndarray, further: np.ndarray) -> np.ndarray:
    """The sum of the first term of a series, at least 0, and further ones; never negative, without a kink."""
    whole = 1.0 + further / np.maximum(first, 1e-35)
    low = np.nonzero(~(whole.real > LEAST_PART))
    whole[low] = LEAST_PART * np.exp(np.minimum(whole[low], LEAST_PART) / LEAST_PART - 1.0)
    return first * whole


class Scattering(NamedTuple):
    """What scatters light along the rays, W last: light (G, C, W) that the sunbeam lights in layers and on the ground;
    reaching (N, W), of SUNLIT and of DIFFUSE: what comes from each segment to the start of its ray if nothing is
    absorbed; albedo (1 + K, G or L + 1, W) and series (K, CUT, W) of `_Kinds`; depolarised, ground_albedo (W,)."""

    light: np.ndarray
    reaching_once: np.ndarray
    reaching: np.ndarray
    albedo_once: np.ndarray
    albedo: np.ndarray
    series: np.ndarray
    depolarised: np.ndarray
    ground_albedo: np.ndarray


def scattering_of(air: Air, shells: Shells) -> Scattering:
    """What scatters light in an air, in single precision."""
    finer, kinds = (_kinds(air, np.array(grid.boundary_km)) for grid in (SUNLIT, DIFFUSE))
    reaching = _reaching(rays(SUNLIT), finer), _reaching(rays(DIFFUSE), kinds)
    depolarised = (1.0 - air.depolarisation) / (2.0 + air.depolarisation)
    rest = finer.albedo, kinds.albedo, kinds.series, depolarised, air.ground_albedo
    return Scattering(*(single(values) for values in (_sunlit(air, shells), *reaching, *rest)))


def diffuse_light(air: Air, shells: Shells) -> np.ndarray:
    """The moments of light scattered at least once, over F0, in layers between BOUNDARY_KM at ZENITH_DEG, the
    reference taken off, (L, W, m + 3, C)."""
    once, again, s = rays(SUNLIT), rays(DIFFUSE), scattering_of(air, shells)
    parts = s.albedo_once[:, once.layer] * s.reaching_once
    parts = np.concatenate([parts, np.zeros_like(parts[:1])])  # of air, of each aerosol and of the ground
    parts[-1, once.on_ground] = s.reaching_once[once.on_ground]
    parts, reaching = (np.ascontiguousarray(x.T) for x in (parts, s.reaching))
    of_wavelengths, dtype = [], np.result_type(s.light, parts)
    sent = np.empty(once.place.shape, dtype), np.empty(again.place.shape, dtype)
    for w, depolarised in enumerate(s.depolarised):
        series = s.series[..., w]
        radiance, by_air = _scattered_once(once, s.light[..., w], parts[w], series, depolarised, sent[0])
        into = _into(s.albedo[..., w], series, depolarised)
        further = _scattered_again(again, radiance, reaching[w, :, None], into, s.ground_albedo[w], sent[1])
        polarised = once.polarised(by_air) * (np.float32(0.75) * depolarised)
        of_wavelengths.append(np.concatenate([once.mean(radiance) + again.mean(further), polarised], axis=2)[:-1])
    return np.stack(of_wavelengths, axis=1).swapaxes(2, 3) * reference()


def reference() -> np.ndarray:
    """What takes the reference off at ZENITH_DEG, (C,)."""
    return np.exp(-log_reference(ZENITH_DEG)).astype(np.float32)


def _reaching(r: Rays, kinds: _Kinds) -> np.ndarray:
    """What comes from each segment to the start of its ray if nothing is absorbed, (N, W)."""
    tau = kinds.extinction_per_km[r.layer] * r.length_km[:, None]
    tau[r.on_ground] = OPAQUE
    passed = np.cumsum(tau, axis=0) - tau
    passed -= passed[r.first[:-1]][r.ray]
    return np.exp(-passed) * -np.expm1(-tau)


def _sunlit(air: Air, shells: Shells) -> np.ndarray:
    """The sunbeam in layers, over 4 pi, as the mean over what scatters there, and what the ground sends of it,
    (L + 1, C, W)."""
    zenith, z = np.radians(ZENITH_DEG), shells.boundary_km
    beam, edge = shells.log_sunbeam(np.arange(z.size)[:, None], zenith)
    within = log_means(beam, 0) * lit_fraction(edge[:-1], edge[1:])[..., None]
    scattered = np.diff(z)[:, None] * shells.scattering.sum(axis=0)
    first = np.searchsorted(z, np.array(SUNLIT.boundary_km[:-1]) - 1e-4)
    direct = np.add.reduceat(within * scattered[:, None], first) / np.add.reduceat(scattered, first)[:, None]
    lit = np.maximum(np.cos(zenith), 0.0) * (edge[0] > 0.0)
    ground = air.ground_albedo / np.pi * np.exp(beam[0]) * lit[:, None]
    return np.concatenate([direct / (4.0 * np.pi), ground[None]])


def _scattered_once(
    r: Rays, light: np.ndarray, parts: np.ndarray, series: np.ndarray, depolarised: np.floating, sent: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Radiance along the rays of light scattered once, at one wavelength, and that by air alone, (L + 1, C, A r).

    light (G, C): what the sunbeam lights in layers and on the ground; parts (N, K + 2): part of it that each segment
    sends to the start of its ray, scattered by air, by each aerosol and by the ground; series (K, CUT): of the phase
    functions of aerosols; sent: as of `Rays.arriving`
    """
    by_air, *by_aerosols, last = r.arriving(light @ at_fine_zeniths().T, r.weights(parts), sent)
    legendre = sun_legendre(SUNLIT)
    phases = (series @ legendre.reshape(CUT, -1)).reshape(-1, *last.shape)
    last = last + by_air * (1.0 + depolarised * legendre[2])
    for scattered, phase in zip(by_aerosols, phases, strict=True):
        last += scattered * np.maximum(phase, LEAST_PHASE)
    return by_azimuth(last), by_azimuth(by_air)


def _into(albedo: np.ndarray, series: np.ndarray, depolarised: np.floating) -> list[np.ndarray]:
    """What layers scatter into azimuths of DIFFUSE and LEAVING_DEG of radiance along the rays of SUNLIT and of DIFFUSE,
    at one wavelength, (L, A' O, A r) each.

    albedo (1 + K, L + 1) of `_Kinds`; series (K, CUT)
    """
    by_degree = albedo[1:, :-1].T @ series
    by_degree[:, 0] += albedo[0, :-1]
    by_degree[:, 2] += albedo[0, :-1] * depolarised
    waves = (turned().reshape(LAYERS - 1, -1, CUT) @ by_degree[..., None]).reshape(LAYERS - 1, DIFFUSE.azimuths, -1)
    out = []
    for grid in (SUNLIT, DIFFUSE):
        both = into_azimuths(grid)
        each = (both.reshape(-1, DIFFUSE.azimuths) @ waves).reshape(LAYERS - 1, *both.shape[:2], -1, RAYS)
        out.append(each.transpose(0, 1, 3, 2, 4).reshape(LAYERS - 1, -1, grid.azimuths * RAYS))
    return out


def _scattered_again(
    r: Rays,
    last: np.ndarray,
    reaching: np.ndarray,
    into: list[np.ndarray],
    ground_albedo: np.floating,
    sent: np.ndarray,
) -> np.ndarray:
    """Radiance along the rays (L + 1, C, A r) of light scattered more than once, from that of light scattered once, at
    one wavelength.

    reaching (N, 1): what comes from each segment to the start of its ray if nothing is absorbed; into: of `_into`;
    sent: as of `Rays.arriving`
    """
    total, mean = np.zeros(1, np.float32), [rays(grid).moments[-1, 0] for grid in (SUNLIT, DIFFUSE)]
    weights = r.weights(reaching)
    for n in range(FOLLOWED - 1):
        before, first = last, min(n, 1)
        leaving = np.empty((LAYERS, into[first].shape[1], ANGLES), last.dtype)
        np.matmul(into[first], np.swapaxes(last, 1, 2)[:-1], out=leaving[:-1])
        leaving[-1] = ground_albedo * (last[-1] @ mean[first])
        source = np.where(leaving.real > 0.0, leaving, 0.0).reshape(-1, ANGLES) @ at_fine_zeniths().T
        last = by_azimuth(r.arriving(source, weights, sent)[0])
        total = total + last
    now, before = ((order @ r.moments[:, 0, :, None])[..., 0] for order in (last, before))
    ratio = np.clip(now / np.maximum(before, 1e-30), 0.0, MOST_RATIO)
    # where the sun is low it falls later towards that of a high one
    ratio = 0.5 * (ratio + np.where(ratio.real < ratio[:, :1].real, ratio, ratio[:, :1]))
    return total + last * (ratio / (1.0 - ratio))[..., None]


class _Kinds(NamedTuple):
    """extinction_per_km (L + 1, W), 0 of the ground; albedo (1 + K, L + 1, W) of air and of each aerosol, 0 of the
    ground; series (K, CUT, W): (2 l + 1) x moments of the aerosols; all without the peaks."""

    extinction_per_km: np.ndarray
    albedo: np.ndarray
    series: np.ndarray


def _kinds(air: Air, boundary_km: np.ndarray) -> _Kinds:
    """What scatters in layers between boundaries that are some of ALTITUDE_KM."""
    place = np.searchsorted(ALTITUDE_KM, boundary_km - 1e-9)
    of_air, absorption, extinction = np.diff(summed(air.depth[: EXTINCTION + 1])[:, place], axis=1)
    aerosols = np.diff(summed(air.aerosol_depth)[:, place], axis=1)
    peak = np.where(air.moments[..., CUT].real > 0.0, air.moments[..., CUT], 0.0)
    in_peaks = peak[:, None] * aerosols
    depth = of_air + absorption + extinction - in_peaks.sum(axis=0)
    degree = 2.0 * np.arange(CUT) + 1.0
    series = degree * (air.moments[..., :CUT] - peak[..., None]) / (1.0 - peak[..., None])
    albedo = np.pad(np.concatenate([of_air[None], aerosols - in_peaks]) / depth, ((0, 0), (0, 1), (0, 0)))
    return _Kinds(np.pad(depth / np.diff(boundary_km)[:, None], ((0, 1), (0, 0))), albedo, np.swapaxes(series, 1, 2))


class LastScattering(NamedTuple):
    """Of lines of sight (E,) in K layers of diffuse light at zenith angles C of the sun: light (E, K, C, WAVES + 1,
    W), what is seen of its mean and its further moments, by waves around the zenith, the reference taken off; slope (W,
    K (C - 1)), change of ln(mean light) a degree; elevation [deg]; angle (E, K) [rad] at the Earth's centre from the
    observer to the mean point, and by how much nearer the light is that he sees, (W, E, K)."""

    light: np.ndarray
    slope: np.ndarray
    elevation_deg: np.ndarray
    angle: np.ndarray
    nearer: np.ndarray


def seen_along(sun_deg: np.ndarray, azimuth_deg: np.ndarray, scattering: LastScattering) -> np.ndarray:
    """M_0 under suns (S,) along lines of sight in azimuths (A,), (S, E, A, W)."""
    at_once = max(1, DIRECTIONS_AT_ONCE // (sun_deg.size * azimuth_deg.size))
    rows = [slice(first, first + at_once) for first in range(0, scattering.elevation_deg.size, at_once)]
    return np.concatenate([_seen_along(sun_deg, azimuth_deg, scattering, row) for row in rows], axis=1)


def _seen_along(sun_deg: np.ndarray, azimuth_deg: np.ndarray, scattering: LastScattering, rows: slice) -> np.ndarray:
    """`seen_along` of some elevations."""
    light, elevation, angle = scattering.light[rows], scattering.elevation_deg[rows], scattering.angle[rows]
    sun, azimuth = np.radians(90.0 - sun_deg)[:, None, None, None], np.cos(np.radians(azimuth_deg))[:, None]
    elevation, angle = np.radians(elevation)[:, None, None], angle[:, None]
    along, across = np.cos(angle) * np.cos(sun), np.sin(angle) * azimuth * np.sin(sun)
    cosine = np.clip(along + across, -1.0, 1.0)  # S E A K
    degrees, sine = np.degrees(np.arccos(cosine)), np.maximum(np.sqrt(1.0 - cosine * cosine), 1e-3)
    below, f = between(degrees)
    # an angle at the Earth's centre towards the sun takes as much from that between the sun and the zenith
    towards = (np.cos(angle) * azimuth * np.sin(sun) - np.sin(angle) * np.cos(sun)) / sine
    layer = np.arange(angle.shape[2])
    slope = scattering.slope.take(layer * (ANGLES - 1) + below, axis=1, mode="clip")  # W S E A K
    slope += single(reference_slope(degrees))
    change = slope * (single(np.degrees(towards)) * scattering.nearer[:, None, rows, None])
    change = np.where(
        change.real < -MOST_CHANGE, -MOST_CHANGE, np.where(change.real > MOST_CHANGE, MOST_CHANGE, change)
    )
    reference = np.exp(change) * single(np.exp(log_reference(degrees)))
    u = np.sin(elevation + angle)
    from_sun = np.cos(sun) * np.sin(elevation) + np.sin(sun) * np.cos(elevation) * azimuth
    s = single(np.clip((from_sun - cosine * u) / sine, -1.0, 1.0))
    around = np.stack(waves(single(u + np.zeros_like(azimuth)), s)[:WAVES], axis=-1)
    place = (np.arange(len(light))[:, None, None] * layer.size + layer) * ANGLES + below
    flat = light.reshape(-1, light[0, 0, 0].size)
    before, after = (np.take(flat, (place + n).ravel(), axis=0, mode="clip") for n in (0, 1))
    after -= before
    after *= f.astype(np.float32).reshape(-1, 1)
    before += after
    first, further = np.split(before.reshape(*place.shape, *light.shape[3:]), [1], axis=-2)
    source = _positive(first[..., 0, :], (around[..., None, :] @ further)[..., 0, :])
    return np.maximum(np.einsum("seakw,wseak->seaw", source, reference), DARK)


def last_scattering(
    diffuse: np.ndarray, air: Air, shells: Shells, line: Line, elevation_deg: np.ndarray
) -> LastScattering:
    """What of diffuse light (`diffuse_light`) is scattered along lines of sight towards the observer."""
    middle = 0.5 * (shells.boundary_km[1:] + shells.boundary_km[:-1])[shells.first :]
    own = np.searchsorted(ALTITUDE_KM, middle) - 1
    of_air, followed = air.depth[AIR], air.moments[..., : DEGREE + 1] - air.peaks(air.moments)[..., None]
    by_moment = [(2 * n + 1) * np.einsum("klw,kw->lw", air.aerosol_depth, followed[..., n]) for n in range(DEGREE + 1)]
    by_moment[0] = by_moment[0] + of_air
    by_moment.append(of_air * (1.0 - air.depolarisation) / (2.0 + air.depolarisation))
    per_km = np.array(by_moment)[:, own] / np.diff(ALTITUDE_KM)[own, None]
    extinction, path = shells.extinction[shells.first :], line.path[:, :, None]
    inside = path * extinction
    thin = np.abs(inside) < 1e-6
    seen = np.where(thin, path, -np.expm1(-inside) / np.where(np.abs(extinction) > 1e-30, extinction, 1.0))
    weights = (np.exp(-line.depth[:, :-1]) * seen) * per_km[:, None]
    shares, layer = _between_middles(middle)
    share = line.path * np.exp(-middle / REFRACTIVITY_SCALE_KM)
    low, whole = line.angle[:, :-1], np.diff(line.angle, axis=1)
    mean_angle = (((low + 0.5 * whole) * share) @ shares) / (share @ shares)
    near = np.where(thin, 1.0, inside)
    near = np.where(np.abs(inside) < 1e-3, 0.5 - inside / 12.0, 1.0 / near - 1.0 / np.expm1(near))
    seen_share = weights[0] + 1e-20 * path
    seen_angle = (shares.T @ ((low[..., None] + whole[..., None] * near) * seen_share)) / (shares.T @ seen_share)
    up = np.sin(np.radians(elevation_deg)[:, None] + mean_angle)
    light = _by_waves(diffuse[layer], single(shares.T @ weights), single(up))
    log = np.log(np.maximum(diffuse[layer, :, 0], DARK))
    slope = np.swapaxes(np.diff(log) / single(np.diff(ZENITH_DEG)), 0, 1).reshape(log.shape[1], -1)
    nearer = np.ascontiguousarray(np.moveaxis(single(mean_angle[..., None] - seen_angle), -1, 0))
    return LastScattering(light, slope, elevation_deg, mean_angle, nearer)


def _by_waves(diffuse: np.ndarray, weights: np.ndarray, up: np.ndarray) -> np.ndarray:
    """`LastScattering.light` from moments (K, W, m + 3, C) and what scattering of the mean light, of the moments of
    each further degree by aerosols and of the second by air alone adds, (DEGREE + 2, E, K, W); up (E, K): sines of the
    elevations."""
    weights, functions = weights.transpose(0, 2, 3, 1), legendre_functions(up)
    weights[2] += weights[-1]
    up, by_air = up.T[:, None], -3.0 * weights[-1]
    out = np.empty((up.shape[2], len(diffuse), ANGLES, WAVES + 1, diffuse.shape[1]), np.result_type(diffuse, weights))

    def take(row: int, terms: list[tuple[int, np.ndarray]]) -> None:
        some, factors = zip(*terms, strict=True)
        out[..., row, :] = (np.stack(factors, axis=-1) @ diffuse[:, :, some]).transpose(2, 0, 3, 1)

    polarised = {
        0: [(-3, by_air * (1.5 * up * up - 0.5))],
        1: [(-2, by_air * 2.0 * up)],
        2: [(-3, 0.5 * by_air), (-1, by_air)],
    }
    take(0, [(0, weights[0])])
    for m in range(WAVES):
        degrees = range(max(m, 1), DEGREE + 1)
        of_degrees = [(n * (n + 1) // 2 + m, functions[n, m].T[:, None] * weights[n]) for n in degrees]
        take(m + 1, of_degrees + polarised.get(m, []))
    return out


def _between_middles(altitude_km: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Shares of the light of layers (J,), linear in altitude between their middles, at altitudes (K,) upwards, (K, J);
    the layers (J,)."""
    centre = 0.5 * (BOUNDARY_KM[1:] + BOUNDARY_KM[:-1])
    place = np.clip(np.searchsorted(centre, altitude_km) - 1, 0, centre.size - 2)
    part = np.clip((altitude_km - centre[place]) / (centre[place + 1] - centre[place]), 0.0, 1.0)
    out = np.zeros((altitude_km.size, LAYERS - 1))
    out[np.arange(altitude_km.size), place] = 1.0 - part
    out[np.arange(altitude_km.size), place + 1] = part
    layer = np.flatnonzero(out.any(axis=0))
    return out[:, layer], layer
