"""About the light of a clear sky that is scattered more than once, M_0, by numpy alone: what `clear_air` corrects."""

from __future__ import annotations

import functools
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from twilight.transport.shells import (
    ABSORPTION,
    AIR,
    ALTITUDE_KM,
    DARK,
    EXTINCTION,
    Air,
    Line,
    Shells,
    lit_fraction,
    log_mean,
    single,
    summed,
)

BOUNDARY_KM = np.array(
    [0, 0.25, 0.7, 1.35, 2, 3, 4.5, 6, 8, 10, 12, 14, 16, 19, 22, 26, 30, 36, 42, 48, 54, 63, 72, 82, 100]
)
"""Boundaries of the layers of diffuse light; all are in ALTITUDE_KM."""
ZENITH_DEG = np.concatenate([[0, 25, 45, 60, 70, 76, 80, 83, 85.5, 87.5], np.arange(89.0, 113.0), [115, 118, 122]])
"""Local solar zenith angles of diffuse light [deg]."""
ORDERS = 4
"""Legendre orders of the phase functions in the first scattering of diffuse light."""
AZIMUTHS = 8
"""Azimuths of rays of diffuse light over half a turn."""
SCATTERINGS = 8
"""Orders of scattering that are followed; the rest is a geometric series."""
MOST_RATIO = 0.95
"""Largest ratio of two orders of which that series is summed."""
DECAY_DEG = 88.0
"""Zenith angle from which on `_log_reference` falls [deg]."""
DECAY = 1.1
"""Fall of `_log_reference` for each degree, from 8 deg beyond DECAY_DEG on."""


def _log_reference(zenith_deg: np.ndarray) -> np.ndarray:
    """About the logarithm of the light of the sky over that of day, by which diffuse light is interpolated."""
    beyond = np.maximum(np.asarray(zenith_deg, float) - DECAY_DEG, 0.0)
    return -np.where(beyond < 8.0, DECAY * beyond**2 / 16.0, DECAY * (beyond - 4.0))


class Exchange(NamedTuple):
    """How the rays from one layer bring light to it from all layers: P pairs of zenith angles (chi, chi') of each layer
    that they cross, in order of layers.

    groups: for each layer, the first and after the last of its n segments in the order of `_exchanges`, and operators
        (P, ORDERS n) of them: the mean over azimuths of P_l(ray . sun) x linear interpolation from chi' to the part's
        own angles; and the same times cos(azimuth)
    columns, rows (P,): indices of (layer, chi') and of chi of each pair; starts: of the pairs of each (layer, chi)
    """

    groups: list[tuple[int, int, np.ndarray, np.ndarray]]
    columns: np.ndarray
    rows: np.ndarray
    starts: np.ndarray

    def summed(self, factors: np.ndarray, light: np.ndarray) -> np.ndarray:
        """Light (C, ..., W) that factors (P, ..., W) make of light ((L + 1) C, W)."""
        here = light[self.columns].reshape(-1, *[1] * (factors.ndim - 2), light.shape[-1])
        rows = np.add.reduceat(factors * here, self.starts, axis=0)
        return rows.reshape(-1, ZENITH_DEG.size, *rows.shape[1:]).sum(axis=0)


@functools.lru_cache(maxsize=2)
def _exchanges(segments: bytes) -> tuple[np.ndarray, list[Exchange]]:
    """Segments in order of the layers that rays start from and cross, (N,); and for each layer that rays start from,
    from the lowest up, the ground last."""
    table = np.frombuffer(segments).reshape(6, -1)
    sequence = np.lexsort((table[1], table[0]))
    count, azimuth = ZENITH_DEG.size, np.cos((np.arange(AZIMUTHS) + 0.5) * np.pi / AZIMUTHS)
    chi, at_nodes = np.radians(ZENITH_DEG)[:, None, None], np.exp(-_log_reference(ZENITH_DEG))
    out: list[Exchange] = []
    for k in range(BOUNDARY_KM.size):
        before, after = np.searchsorted(table[0, sequence], [k, k + 1])
        own = sequence[before:after]
        layer, (phi, mu) = table[1, own].astype(int), table[3:5, own, None]
        local = np.cos(chi) * np.cos(phi) + np.sin(chi) * np.sin(phi) * azimuth
        zenith = np.minimum(np.degrees(np.arccos(np.clip(local, -1.0, 1.0))), ZENITH_DEG[-1] - 1e-6)  # C N A
        toward_sun = mu * np.cos(chi) + np.sqrt(1.0 - mu * mu) * np.sin(chi) * azimuth
        below = np.clip(np.searchsorted(ZENITH_DEG, zenith, side="right") - 1, 0, count - 2)
        f = (zenith - ZENITH_DEG[below]) / (ZENITH_DEG[below + 1] - ZENITH_DEG[below])
        reference = np.exp(_log_reference(zenith)) / AZIMUTHS
        parts = np.stack([(1.0 - f) * reference * at_nodes[below], f * reference * at_nodes[below + 1]])
        # pairs: where any segment of the layer has a part in them
        place = (layer[:, None] * count + np.arange(count)[:, None, None]) * count + np.stack([below, below + 1])
        number = np.zeros(BOUNDARY_KM.size * count * count, int)
        number[place] = 1
        used = np.flatnonzero(number)
        number[used] = np.arange(used.size)
        columns = used // count**2 * count + used % count
        # operators of each layer in a row: its pairs times its segments
        layers, segment, own_layer = np.unique(layer, return_index=True, return_inverse=True)
        edges = np.append(segment, own.size)
        bounds = np.searchsorted(used, np.append(layers, BOUNDARY_KM.size) * count**2)
        sizes = np.diff(edges)
        base = np.concatenate([[0], np.cumsum(np.diff(bounds) * sizes)])
        shift = (base[:-1] - bounds[:-1] * sizes)[own_layer] + np.arange(own.size) - segment[own_layer]
        index = (number[place] * sizes[own_layer][:, None] + shift[:, None]).ravel()
        rows, x = np.empty((2, ORDERS, base[-1]), np.float32), toward_sun
        for order, series in enumerate((np.ones_like(x), x, 1.5 * x * x - 0.5, (2.5 * x * x - 1.5) * x)):
            for n, by in enumerate((series, series * azimuth)):
                rows[n, order] = np.bincount(index, (parts * by).ravel(), minlength=base[-1])
        groups: list[tuple[int, int, np.ndarray, np.ndarray]] = []
        for n, (i, j) in enumerate(pairwise(edges)):
            some = rows[:, :, base[n] : base[n + 1]].reshape(2, ORDERS, -1, j - i)
            upright, turned = np.swapaxes(some, 1, 2).reshape(2, -1, ORDERS * (j - i))
            groups.append((before + i, before + j, upright, turned))
        starts = np.searchsorted(used // count, np.unique(used // count))
        out.append(Exchange(groups, columns, used // count % count, starts))
    return sequence, out


def _positive(first: np.ndarray, further: np.ndarray) -> np.ndarray:
    """The sum of the first term of a series, at least 0, and further ones; never negative, without a kink."""
    ratio = further / np.maximum(first, 1e-35)
    return first * np.where(ratio.real > 0.0, 1.0 + ratio, np.exp(np.minimum(ratio, 0.0)))


def _factors(group: tuple, every: np.ndarray, aside: np.ndarray, sources: np.ndarray, out: np.ndarray) -> None:
    """Sums over the segments of one layer, operators times weights of the segments, into out (P, 7 W)."""
    first, last, upright, turned = group
    n, w = last - first, aside.shape[1]
    here = sources[:, :, first:last].reshape(3, ORDERS * n, w)

    def times(operators: np.ndarray, weights: np.ndarray) -> np.ndarray:
        return (operators @ weights.view(np.float32)).view(weights.dtype)

    both = times(upright[:, :n], every[first:last])
    out[:, : 2 * w], out[:, 3 * w : 4 * w] = both[:, : 2 * w], both[:, 2 * w :]
    out[:, 2 * w : 3 * w] = times(turned[:, :n], aside[first:last])
    out[:, 4 * w : 5 * w] = times(upright[:, n:], here[0, n:])
    out[:, 5 * w : 6 * w], out[:, 6 * w :] = times(upright, here[1]), times(turned, here[2])


def _coefficients(air: Air) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Of the layers between BOUNDARY_KM, by the similarity rule: extinction [km^-1], albedo (L, W); and (2 l + 1) x
    moment l of what scatters the sunbeam x its coefficient, over scattering, (ORDERS, L, W)."""
    rho, peaks = air.depolarisation, air.peaks(air.moments)
    place = np.searchsorted(ALTITUDE_KM, BOUNDARY_KM - 1e-9)
    d = np.diff(summed(np.concatenate([air.depth, air.aerosol_depth]))[:, place], axis=1)
    of_aerosols, moments = d[len(air.depth) :], air.moments
    forwards = np.einsum("kw,klw->lw", moments[:, :, 1], of_aerosols)
    scattering = d[AIR] + of_aerosols.sum(axis=0) - forwards
    extinction = d[AIR] + d[ABSORPTION] + d[EXTINCTION] - forwards
    of_air = [np.ones_like(rho), np.zeros_like(rho), (1.0 - rho) / (5.0 * (2.0 + rho)), np.zeros_like(rho)]
    first = []
    for order in range(ORDERS):
        of_aerosol = np.einsum("kw,klw->lw", moments[:, :, order] - peaks, of_aerosols)
        first.append((2 * order + 1) * (of_air[order] * d[AIR] + of_aerosol) / scattering)
    return extinction / np.diff(BOUNDARY_KM)[:, None], scattering / extinction, np.array(first)


def diffuse_light(air: Air, shells: Shells, segments: np.ndarray) -> np.ndarray:
    """Light scattered at least once, over F0, in layers between BOUNDARY_KM at ZENITH_DEG, (3, L, C, W): its mean
    intensity J, and V, the mean of its radiance times the direction it comes from, upwards and towards the sun.

        J_next(z, chi) = sum_rays w sum_segments T (1 - exp(-tau)) albedo sum_chi' G(chi, chi') J(z', chi')
    """
    extinction, albedo, phases = _coefficients(air)
    zenith = np.radians(ZENITH_DEG)
    places = np.array([int(np.argmin(np.abs(shells.boundary_km - z))) for z in BOUNDARY_KM])
    beam, edge = shells.log_sunbeam(places[:, None], zenith)
    direct = log_mean(beam[:-1], beam[1:]) * lit_fraction(edge[:-1], edge[1:])[..., None]  # L C W
    on_ground = np.maximum(np.cos(zenith), 0.0) * (edge[0] > 0.0)
    layer = segments[1].astype(int)
    length, _, cosine, weight = segments[2:].astype(float)
    top = layer == BOUNDARY_KM.size - 1
    clear = np.zeros((1, extinction.shape[1]))
    depth = np.where(top[:, None], 60.0, np.concatenate([extinction, clear])[layer] * length[:, None])
    passed, ray = np.cumsum(depth, axis=0) - depth, np.cumsum(weight > 0.0) - 1
    passed -= passed[weight > 0.0][ray]
    reaches = np.exp(-passed) * -np.expm1(-depth) * np.concatenate([albedo, clear + 1.0])[layer]
    order, exchanges = _exchanges(segments.astype(float).tobytes())
    reaches = single(reaches * weight[weight > 0.0][ray, None])[order]
    up, layer = cosine.astype(np.float32)[order, None], layer[order]
    aside, n = reaches * np.sqrt(1.0 - up * up), reaches.shape[1]
    ground_alone = np.eye(ORDERS)[:, :1, None] * np.ones(n)  # (ORDERS, 1, W)
    of_order = single(np.concatenate([phases, ground_alone], axis=1))[:, layer]  # ORDERS N W
    every = np.concatenate([reaches, reaches * up, of_order[0] * reaches], axis=1)
    sources = np.stack([of_order * part for part in (reaches, reaches * up, aside)])
    ground = air.ground_albedo / np.pi * np.exp(beam[0]) * on_ground[:, None]
    light = single(np.concatenate([direct / (4.0 * np.pi), ground[None]])).reshape(-1, n)
    first: list[np.ndarray] = []
    vector: list[list[np.ndarray]] = []
    flows, factors, pairs = list(first), list(first), list(first)
    for k, one in enumerate(exchanges):
        made, place = np.empty((one.columns.size, 7 * n), reaches.dtype), 0
        for group in one.groups:
            _factors(group, every, aside, sources, made[place : place + len(group[2])])
            place += len(group[2])
        made = made.reshape(len(made), 7, n)  # of any order: J, V upwards, aside; of the first: J in two parts, V
        zeroth, further, *flow = np.moveaxis(one.summed(made[:, 3:], light), 1, 0)
        first.append(_positive(zeroth, further))
        vector.append(flow)
        flows.append(np.ascontiguousarray(made[:, 1:3]))
        factors.append(made[:, 0].T.copy())
        pairs.append((k * ZENITH_DEG.size + one.rows) * len(light) + one.columns)
    now = np.array(first)
    now[-1] *= air.ground_albedo
    total = _later_orders(air.ground_albedo, np.concatenate(factors, axis=1), np.concatenate(pairs), now.reshape(-1, n))
    more = [one.summed(f, total) for one, f in zip(exchanges, flows, strict=True)]
    directed = np.moveaxis(np.array(vector), 1, 0) + np.moveaxis(np.array(more), 2, 0)
    return np.concatenate([total.reshape(1, *now.shape), directed])[:, :-1]


def _later_orders(ground_albedo: np.ndarray, factors: np.ndarray, pairs: np.ndarray, first: np.ndarray) -> np.ndarray:
    """Light of all orders ((L + 1) C, W) from the first one, by factors (W, P) at pairs in ((L + 1) C)^2."""
    out, count = np.empty_like(first), len(first)
    for w, albedo in enumerate(ground_albedo):
        matrix = np.zeros(count * count, factors.dtype)
        matrix[pairs] = factors[w]
        matrix = matrix.reshape(count, count)
        matrix[-ZENITH_DEG.size :] *= single(np.asarray(albedo))
        now = total = np.ascontiguousarray(first[:, w])
        for _ in range(SCATTERINGS - 1):
            before, now = now, matrix @ now
            total = total + now
        ratio = np.clip(now / np.maximum(before, 1e-30), 0.0, MOST_RATIO)
        out[:, w] = total + now * ratio / (1.0 - ratio)
    return out


def seen_along(
    air: Air,
    shells: Shells,
    light: np.ndarray,
    sun_deg: np.ndarray,
    elevation_deg: np.ndarray,
    azimuth_deg: np.ndarray,
    line: Line,
) -> np.ndarray:
    """M_0 under suns (S,) along lines of sight, (S, E, A, W), from `diffuse_light`: the last scattering has its
    direction, J + 3 g V.e."""
    scattering, forward = _last_scattering(air, shells)
    extinction = shells.extinction[shells.first :]
    inside = line.path[:, :, None] * extinction
    seen = np.where(np.abs(inside) > 1e-6, -np.expm1(-inside) / np.maximum(extinction, 1e-30), line.path[:, :, None])
    weight = np.exp(-line.depth[:, :-1]) * seen * scattering
    zenith = line.zenith(sun_deg, azimuth_deg, middle=True)
    degrees = np.minimum(np.degrees(zenith), ZENITH_DEG[-1] - 1e-6)
    k = np.clip(np.searchsorted(ZENITH_DEG, degrees, side="right") - 1, 0, ZENITH_DEG.size - 2)
    f = ((degrees - ZENITH_DEG[k]) / (ZENITH_DEG[k + 1] - ZENITH_DEG[k]))[..., None].astype(np.float32)
    scaled = single(light * np.exp(-_log_reference(ZENITH_DEG))[:, None])
    middle = 0.5 * (shells.boundary_km[1:] + shells.boundary_km[:-1])[shells.first :]
    layer = np.searchsorted(BOUNDARY_KM, middle) - 1
    mean, up, aside = (part[layer, k] * (1.0 - f) + part[layer, k + 1] * f for part in scaled)
    sun, elevation = np.radians(90.0 - np.atleast_1d(sun_deg))[:, None, None], np.radians(elevation_deg)[:, None]
    upwards = np.sin(elevation + 0.5 * (line.angle[:, 1:] + line.angle[:, :-1]))[:, None]
    from_sun = np.cos(sun) * np.sin(elevation) + np.sin(sun) * np.cos(elevation) * np.cos(np.radians(azimuth_deg))
    towards = (from_sun[..., None] - np.cos(zenith) * upwards) / np.maximum(np.sin(zenith), 1e-3)
    further = up * upwards[..., None].astype(np.float32) + aside * towards[..., None].astype(np.float32)
    source = _positive(mean, forward * further) * np.exp(_log_reference(degrees))[..., None]
    return np.maximum(np.einsum("ekw,seakw->seaw", weight, source, optimize=True), DARK)


def _last_scattering(air: Air, shells: Shells) -> tuple[np.ndarray, np.ndarray]:
    """Of the layers above the observer: scattering without forward peaks [km^-1], and 3 g of it, (K, W)."""
    middle = 0.5 * (shells.boundary_km[1:] + shells.boundary_km[:-1])[shells.first :]
    layer, per_km = np.searchsorted(ALTITUDE_KM, middle) - 1, 1.0 / np.diff(ALTITUDE_KM)[:, None]
    fraction, of_aerosols = air.peaks(air.moments), air.aerosol_depth
    peak = np.einsum("kw,klw->lw", fraction, of_aerosols)
    asymmetry = np.einsum("kw,klw->lw", air.moments[:, :, 1] - fraction, of_aerosols)
    scattering = ((air.depth[AIR] + of_aerosols.sum(axis=0) - peak) * per_km)[layer]
    return scattering, single((3.0 * asymmetry * per_km)[layer] / np.maximum(scattering, 1e-30))
