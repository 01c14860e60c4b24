"""The diffuse light of `clear_air.diffuse`, of eight wavelengths at once, compiled.

What numpy does there for one wavelength after the other, a gather of light along rays and a product of matrices, are
here loops over `Lanes`: a place along a ray is looked up once for eight wavelengths.  The light is that of numpy but
for rounding, 1e-5 (tests/solvers/test_clear_air.py).  In memory wavelengths come last, after zenith angles.

Arguments that the kernels share: place (U, C A), row (N,), first (R + 1,): of `Rays`; source (places, LANES): what
`place` counts; sums (p, C A, LANES): workspace; radiance (L + 1, A r, C, LANES): along the rays
"""

from __future__ import annotations

import functools

import numpy as np

from twilight.clear_air import diffuse
from twilight.clear_air.rays import (
    ANGLES,
    CUT,
    DIFFUSE,
    FINE_ZENITH_DEG,
    LAYERS,
    LEAVING_DEG,
    RAYS,
    SUNLIT,
    ZENITH_DEG,
    Grid,
    at_fine_zeniths,
    rays,
    sun_legendre,
    turned,
)
from twilight.clear_air.shells import Air, Shells
from twilight.jit.kernels import njit
from twilight.jit.simd import LANES, broadcast, load, maximum, store

ZERO = np.float32(0.0)
LEAST_PHASE = np.float32(diffuse.LEAST_PHASE)


def diffuse_light(air: Air, shells: Shells) -> np.ndarray:
    """`diffuse.diffuse_light` of real air."""
    s, count = diffuse.scattering_of(air, shells), air.degree.size
    some = (np.minimum(np.arange(a, a + LANES), count - 1) for a in range(0, count, LANES))
    moments = np.concatenate([_of_lanes(_selected(s, columns)) for columns in some], axis=-1)[..., :count]
    return np.ascontiguousarray(np.moveaxis(moments, -1, 1)) * diffuse.reference()


def _selected(s: diffuse.Scattering, columns: np.ndarray) -> diffuse.Scattering:
    """Some wavelengths."""
    return diffuse.Scattering(*(np.ascontiguousarray(values[..., columns]) for values in s))


def _of_lanes(s: diffuse.Scattering) -> np.ndarray:
    """The moments of eight wavelengths, (L, m + 3, C, LANES)."""
    once, again = rays(SUNLIT), rays(DIFFUSE)
    degree = (s.albedo[1:, :-1, None] * s.series[:, None]).sum(axis=0)  # L CUT LANES
    degree[:, 0] += s.albedo[0, :-1]
    degree[:, 2] += s.albedo[0, :-1] * s.depolarised
    into = (turned().reshape(LAYERS - 1, -1, CUT) @ degree).reshape(*turned().shape[:-1], LANES)

    place, row, first = _tables(SUNLIT)
    shape = LAYERS, SUNLIT.azimuths * RAYS, ANGLES, LANES
    radiance, by_air = np.empty(shape, np.float32), np.empty(shape, np.float32)
    source = np.ascontiguousarray(np.moveaxis(np.tensordot(at_fine_zeniths(), s.light, (1, 1)), 0, 1))
    sums = np.empty((len(s.albedo_once) + 1, place.shape[1], LANES), np.float32)
    air = source.reshape(-1, LANES), s.reaching_once, s.albedo_once, s.albedo_once.any(axis=2), s.series
    scatter_once(place, row, first, once.layer, *air, s.depolarised[None], _legendre(), sums, radiance, by_air)
    mean, polarised = once.moments[:, :-9], once.moments[:, -9:]
    out = _product(mean, radiance)
    high, between, low = np.split(_product(polarised, by_air) * (np.float32(0.75) * s.depolarised), 3, axis=1)
    up, aside = (f(np.radians(ZENITH_DEG))[:, None].astype(np.float32) for f in (np.cos, np.sin))
    towards = (up * up - up * aside) * high + 2.0 * up * aside * between + (aside * aside - up * aside) * low

    last, total = radiance, np.zeros((LAYERS, DIFFUSE.azimuths * RAYS, ANGLES, LANES), np.float32)
    place, row, first = _tables(DIFFUSE)
    sums, count = np.empty((place.shape[1], LANES), np.float32), DIFFUSE.azimuths * LEAVING_DEG.size
    source = np.empty((LAYERS * count * FINE_ZENITH_DEG.size, LANES), np.float32)
    leaving = np.empty((count, ANGLES, LANES), np.float32)
    waves = np.empty((ANGLES, DIFFUSE.azimuths, RAYS, LANES), np.float32)
    before = last
    for n in range(diffuse.FOLLOWED - 1):
        grid = SUNLIT if n == 0 else DIFFUSE
        ground = _product(rays(grid).moments[-1:, :1], last[-1:])[0, 0] * s.ground_albedo
        leave(last, into, ground, _along(grid), _around(DIFFUSE), *_fine(), waves, leaving, source)
        before, last = last, np.empty_like(total)
        scatter_again(place, row, first, source, s.reaching, sums, last, total)
    now, before = (_product(again.moments[:, :1], order)[:, 0] for order in (last, before))
    ratio = np.clip(now / np.maximum(before, 1e-30), 0.0, diffuse.MOST_RATIO)
    ratio = 0.5 * (ratio + np.minimum(ratio, ratio[:, :1]))
    total += last * (ratio / (1.0 - ratio))[:, None]
    return np.concatenate([out + _product(again.moments[:, :-9], total), towards], axis=1)[:-1]


def _product(weights: np.ndarray, radiance: np.ndarray) -> np.ndarray:
    """Sums over rays (L + 1, m, C, LANES)."""
    return (weights @ radiance.reshape(*radiance.shape[:2], -1)).reshape(*weights.shape[:2], ANGLES, LANES)


@functools.cache
def _tables(grid: Grid) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Place, row and first of `Rays` as the kernels read them."""
    r = rays(grid)
    return r.place.astype(np.int32), r.row.astype(np.int32), r.first.astype(np.int32)


@functools.cache
def _legendre() -> np.ndarray:
    """`sun_legendre`, (R, C A, CUT)."""
    return np.ascontiguousarray(np.moveaxis(sun_legendre(SUNLIT).reshape(CUT, LAYERS * RAYS, -1), 0, -1))


@functools.cache
def _fine() -> tuple[np.ndarray, np.ndarray]:
    """Of FINE_ZENITH_DEG the zenith angle before each (F,) and the weights of it and the next (F, 2)."""
    every = at_fine_zeniths()
    before = np.minimum((every != 0.0).argmax(axis=1), ANGLES - 2)
    return before, np.stack([every[np.arange(before.size), before + k] for k in (0, 1)], axis=1)


@functools.cache
def _around(grid: Grid) -> np.ndarray:
    """Of waves around the zenith, their values in the azimuths of a grid, (A, waves)."""
    return np.cos(np.outer(grid.azimuth_rad, np.arange(DIFFUSE.azimuths))).astype(np.float32)


@functools.cache
def _along(grid: Grid) -> np.ndarray:
    """Weights of light that comes along azimuths of a grid in waves around the zenith, (A, waves)."""
    return _around(grid) * (np.where(np.arange(DIFFUSE.azimuths) > 0, 2.0, 1.0) / grid.azimuths).astype(np.float32)


@njit(cache=True, makes_arrays=False)
def scatter_once(
    place,
    row,
    first,
    layer_of,
    source,
    reaching,
    albedo,
    scatters,
    series,
    depolarised,
    legendre,
    sums,
    radiance,
    by_air,
):
    """Radiance along rays of light scattered once, and that by air alone.

    layer_of (N,): `Rays.layer`; reaching (N, LANES), albedo (1 + K, G, LANES): of `Scattering`; scatters (1 + K, G):
    where albedo is not 0; series (K, CUT, LANES), depolarised (1, LANES): of the phase functions; legendre (R, C A,
    CUT): Legendre polynomials of the angle from the sun
    """
    kinds, n = sums.shape[0], sums.shape[1]
    angles, per_layer = radiance.shape[2], legendre.shape[0] // radiance.shape[0]
    azimuths = n // angles
    for ray in range(legendre.shape[0]):
        for k in range(kinds):
            for i in range(n):
                store(sums, (k, i), broadcast(ZERO))
        for segment in range(first[ray], first[ray + 1]):
            u, at_layer = row[segment], layer_of[segment]
            for k in range(kinds):
                ground = at_layer == albedo.shape[1] - 1
                if (k == kinds - 1 and ground) or (k < kinds - 1 and scatters[k, at_layer]):
                    part = load(reaching, segment)
                    if not ground:
                        part = part * load(albedo, (k, at_layer))
                    for i in range(n):
                        store(sums, (k, i), load(sums, (k, i)) + part * load(source, place[u, i]))
        layer, of_layer = ray // per_layer, ray % per_layer
        for i in range(n):
            at = (layer, (i % azimuths) * per_layer + of_layer, i // azimuths)
            air = load(sums, (0, i))
            total = load(sums, (kinds - 1, i)) + air + legendre[ray, i, 2] * (air * load(depolarised, 0))
            for k in range(kinds - 2):
                phase = broadcast(ZERO)
                for degree in range(legendre.shape[2]):
                    phase += legendre[ray, i, degree] * load(series, (k, degree))
                total += maximum(phase, LEAST_PHASE) * load(sums, (k + 1, i))
            store(radiance, at, total)
            store(by_air, at, air)


@njit(cache=True, makes_arrays=False)
def scatter_again(place, row, first, source, reaching, sums, radiance, total):
    """Radiance along rays of light scattered before, which is added to a total; reaching (N, LANES)."""
    n, angles, per_layer = sums.shape[0], radiance.shape[2], (first.size - 1) // radiance.shape[0]
    azimuths = n // angles
    for ray in range(first.size - 1):
        for i in range(n):
            store(sums, i, broadcast(ZERO))
        for segment in range(first[ray], first[ray + 1]):
            u, part = row[segment], load(reaching, segment)
            for i in range(n):
                store(sums, i, load(sums, i) + part * load(source, place[u, i]))
        for i in range(n):
            at = (ray // per_layer, (i % azimuths) * per_layer + ray % per_layer, i // azimuths)
            store(radiance, at, load(sums, i))
            store(total, at, load(total, at) + load(sums, i))


@njit(cache=True, makes_arrays=False)
def leave(radiance, into, ground, along, around, before, weight, waves, leaving, source):
    """Fill the source (places, LANES) with what layers and the ground send of radiance along rays.

    into (L, waves, O, r, LANES): what layers scatter into elevations; ground (C, LANES): what the ground sends; along
    (A, waves), around (A', waves): of azimuths of the rays, and of those in which it leaves; before (F,), weight (F,
    2): of fine zenith angles; waves (C, waves, r, LANES), leaving (A' O, C, LANES): workspace
    """
    azimuths, orders = along.shape
    elevations, per_layer = into.shape[2], into.shape[3]
    count, angles, fine = leaving.shape[0], leaving.shape[1], before.size
    for layer in range(radiance.shape[0]):
        if layer < into.shape[0]:
            for m in range(orders):
                for ray in range(per_layer):
                    for c in range(angles):
                        total = broadcast(ZERO)
                        for a in range(azimuths):
                            total += along[a, m] * load(radiance, (layer, a * per_layer + ray, c))
                        store(waves, (c, m, ray), total)
            for c in range(angles):
                for k in range(count):
                    store(leaving, (k, c), broadcast(ZERO))
                for o in range(elevations):
                    for m in range(orders):
                        total = broadcast(ZERO)
                        for ray in range(per_layer):
                            total += load(into, (layer, m, o, ray)) * load(waves, (c, m, ray))
                        for a in range(around.shape[0]):
                            k = a * elevations + o
                            store(leaving, (k, c), load(leaving, (k, c)) + around[a, m] * total)
        else:
            for k in range(count):
                for c in range(angles):
                    store(leaving, (k, c), load(ground, c))
        for k in range(count):
            for c in range(angles):
                store(leaving, (k, c), maximum(load(leaving, (k, c)), ZERO))
            for f in range(fine):
                c = before[f]
                between = weight[f, 0] * load(leaving, (k, c)) + weight[f, 1] * load(leaving, (k, c + 1))
                store(source, (layer * count + k) * fine + f, between)
