"""Looking up the direct sun beam: the inner loop of every solver.

All tables of a beam lie in one array and their sizes and offsets in another: a call that took them as twenty arrays
compiled four times as long (1.2 and 0.3 s for a look-up of four values), at every place that calls it.  Interpolation
is cubic, between four nodes of each coordinate.
:mod:`twilight.transport.beam` says what the tables mean.

Arguments that the kernels share: beam: `Beam`; pool, index: its arrays `pool` and `layout`; w: index of the wavelength;
z, altitude_km [km]: of the point; c, cos_sun_zenith: cosine of the true sun's zenith angle there; ray: `SunRay` of the
reference wavelength; p [km]: Bouguer's invariant n r sin i of a ray, u [km]: its n r cos i at the point, negative where
it has passed its lowest point; at: place in the pool; along, across: weights of four nodes each, as of `weights`;
value: ln(E/F0) of a wavelength so far.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from twilight.jit.kernels import njit
from twilight.transport.beam_edges import dispersion_lag, edge_depth
from twilight.transport.cubics import bicubic, cubic, even_nodes, weights
from twilight.transport.ray_profile import at_wavelength, passing

COSINE_SCALE = 0.05
"""Nodes of the apparent cosine are uniform in c (1 + s)/(c + s): the optical depth is nearly linear in 1/(c + s)."""
DEPTH_SCALE = 0.05
"""s of the nodes of the distance from the shadow's edge in the first guess of the bending."""
NEAR_KM = 300.0
"""Nodes of the distance u from the lowest point of a ray are uniform in u/(u + 300 km)."""
MAX_DISTANCE_KM = 5.0e4
"""Distance u from the lowest point of a ray at the last node [km]."""
LARGEST_LOG = 0.2
"""Bound on log(E/F0): cubic interpolation overshoots next to layers of very large optical depth."""
TOUCHING = 1.0 - 1e-12
"""A ray whose invariant is this part of the ground's touches it and is lit: 6 micrometres, which rounding decides."""

N_INDEX = 28
"""Entries of Beam.layout before its hashes: numbers (N_), flags, and where in Beam.pool each table begins (AT_)."""
(
    N_W,
    REFRACTING,
    DISPERSING,
    N_SEGMENT,
    N_LIMB,
    N_COSINE,
    N_DISTANCE,
    N_GUESS,
    N_LIMB_NODE,
    AT_SEGMENT,
    AT_LIMB,
    AT_ALTITUDE,
    AT_GUESS,
    AT_UP_BENDING,
    AT_LIMB_BENDING,
    AT_SHIFT,
    AT_OVERHEAD,
    AT_DISPERSION,
    AT_UP,
    AT_DOWN,
    AT_SEGMENT_HASH,
    AT_LIMB_HASH,
    N_HASH,
    N_EDGE,
    AT_EDGE,
    AT_EDGE_COEFFICIENT,
    SCREENED,
    AT_SCREEN,
) = range(N_INDEX)

# places in Beam.pool
RADIUS, GROUND, TOP, FAR, P_GROUND, P_TOP, EDGE, SEGMENT_BINS, LIMB_BINS, N_SCALAR = range(10)
_, UPPER, PER_LENGTH, INTERVALS, FIRST_NODE, N_SEGMENT_RECORD = range(6)
"""Columns of a segment's record behind its lower edge: upper edge, 1 / length, number of intervals, first node."""


class SunRay(NamedTuple):
    """The ray of the reference wavelength, the most refracted one, that arrives at a point from the sun.

    lit: whether it does; bending [rad], slope: d bending/d i; p, u [km]: n r sin i and n r cos i at the point
    node: first of four altitude nodes, -1 above the top of the air; position: behind that node, 0 to 3
    """

    lit: bool
    bending: float
    slope: float
    p: float
    u: float
    node: int
    position: float


class Beam(NamedTuple):
    """The direct sun beam in a medium, for kernels; made by :func:`twilight.transport.beam.prepare_beam`.

    pool: every table, float64; layout: sizes, offsets into `pool`, and the hashes of the two segment lists, int64.
    """

    pool: np.ndarray
    layout: np.ndarray

    @property
    def n_wavelengths(self) -> int:
        return int(self.layout[N_W])

    @property
    def n_bytes(self) -> int:
        return int(self.pool.nbytes + self.layout.nbytes)


@njit(inner=True, cache=True, inline=True, makes_arrays=False)
def _locate(pool, index, value, low, bins, at, n, at_hash):
    """First of four nodes and the position behind it (0..3) for the value of a coordinate that is cut in segments.

    value, low: of the coordinate and the least one, in its own unit; bins: of its hash per unit; at_hash: the hash's
    place in the index; at: place of the first segment record in the pool; n: number of segments.
    """
    h = int((value - low) * bins)
    h = min(index[N_HASH], max(0, h))
    s = index[at_hash + h]
    k = at + N_SEGMENT_RECORD * s
    while s > 0 and value < pool[k]:
        s -= 1
        k -= N_SEGMENT_RECORD
    while s < n - 1 and value > pool[k + UPPER]:
        s += 1
        k += N_SEGMENT_RECORD
    size = int(pool[k + INTERVALS])
    t = 1.0 - math.sqrt(min(1.0, max(0.0, (pool[k + UPPER] - value) * pool[k + PER_LENGTH])))
    first, position = even_nodes(t * size, size)
    return int(pool[k + FIRST_NODE]) + first, position


@njit(inner=True, cache=True, inline=True, makes_arrays=False)
def _limb_node(pool, index, p):
    """First of four nodes among the rays' lowest points, and the position behind it, of the invariant p [km]."""
    return _locate(pool, index, p, pool[P_GROUND], pool[LIMB_BINS], index[AT_LIMB], index[N_LIMB], index[AT_LIMB_HASH])


@njit(inner=True, cache=True, inline=True, makes_arrays=False)
def _ray(pool, index, z, c):
    """The ray of the reference wavelength at a point inside the air.

    Returns (lit, bending, d bending/d i, invariant p, u = n r cos i, first altitude node, position behind it).
    """
    jz, fz = _locate(
        pool, index, z, pool[GROUND], pool[SEGMENT_BINS], index[AT_SEGMENT], index[N_SEGMENT], index[AT_SEGMENT_HASH]
    )
    r = pool[RADIUS] + z
    s = math.sqrt((1.0 - c) * (1.0 + c))
    p_ground = pool[P_GROUND]
    bending = slope = 0.0
    p = r * s
    u = r * c
    lit = c >= 0.0 or p >= p_ground * TOUCHING
    if index[REFRACTING] == 1:
        w0, w1, w2, w3 = weights(fz)
        k = index[AT_ALTITUDE] + 2 * jz
        edge = w0 * pool[k + 1] + w1 * pool[k + 3] + w2 * pool[k + 5] + w3 * pool[k + 7]
        edge = pool[EDGE] + math.copysign(math.sqrt(abs(edge)), edge)
        depth = 1.0 - math.acos(c) / edge
        lit = depth >= -1e-5
        if lit:
            x = r * (1.0 + w0 * pool[k] + w1 * pool[k + 2] + w2 * pool[k + 4] + w3 * pool[k + 6])
            # the guess: bilinear in altitude and in the distance from the edge of the shadow
            depth = max(0.0, depth)
            n_g = index[N_GUESS]
            g = depth * (1.0 + DEPTH_SCALE) / (depth + DEPTH_SCALE) * n_g
            m = min(n_g - 1, int(g))
            g -= m
            step = min(2, int(fz))
            f = fz - step
            k = index[AT_GUESS] + 2 * ((jz + step) * (n_g + 1) + m)
            above = k + 2 * (n_g + 1)
            f0 = (1.0 - f) * (1.0 - g)
            f1 = (1.0 - f) * g
            f2 = f * (1.0 - g)
            f3 = f * g
            bending = f0 * pool[k] + f1 * pool[k + 2] + f2 * pool[above] + f3 * pool[above + 2]
            slope = f0 * pool[k + 1] + f1 * pool[k + 3] + f2 * pool[above + 1] + f3 * pool[above + 3]
            # one Newton step with the finer tables
            sb = math.sin(bending)
            cb = math.cos(bending)
            cos_i = c * cb + s * sb
            a = abs(cos_i)
            n_c = index[N_COSINE]
            m, fm = even_nodes(a * (1.0 + COSINE_SCALE) / (a + COSINE_SCALE) * n_c, n_c)
            along = weights(fm)
            row = n_c + 1
            k = index[AT_UP_BENDING] + jz * row + m
            value = w0 * cubic(pool, k, along)
            value += w1 * cubic(pool, k + row, along)
            value += w2 * cubic(pool, k + 2 * row, along)
            value += w3 * cubic(pool, k + 3 * row, along)
            if cos_i < 0.0:
                p = x * (s * cb - c * sb)
                ky, fy = _limb_node(pool, index, p)
                value = cubic(pool, index[AT_LIMB_BENDING] + ky, weights(fy)) - value
            bending = max(0.0, bending + (value - bending) / (1.0 + slope))
            sb = math.sin(bending)
            cb = math.cos(bending)
            p = x * abs(s * cb - c * sb)
            u = x * (c * cb + s * sb)
            lit = u >= 0.0 or p >= p_ground * TOUCHING
    return lit, bending, slope, p, u, jz, fz


@njit(inner=True, cache=True, makes_arrays=False)
def _ray_from_space(pool, index, z, c):
    """(lit, bending, p, u) of the reference ray at a point above the top of the air."""
    r = pool[RADIUS] + z
    s = math.sqrt((1.0 - c) * (1.0 + c))
    if c >= 0.0 or r * s >= pool[P_TOP]:
        return True, 0.0, r * s, abs(r * c)
    chi = math.acos(c)
    lo = pool[P_GROUND]
    hi = pool[P_TOP]
    p = lo
    bending = pool[index[AT_LIMB_BENDING]]
    if math.pi - math.asin(lo / r) + bending < chi:
        return False, 0.0, 0.0, 0.0
    for _ in range(48):
        p = 0.5 * (lo + hi)
        ky, fy = _limb_node(pool, index, p)
        bending = cubic(pool, index[AT_LIMB_BENDING] + ky, weights(fy))
        if math.pi - math.asin(p / r) + bending > chi:
            lo = p
        else:
            hi = p
    return True, bending, p, -math.sqrt((r - p) * (r + p))


@njit(inner=True, cache=True, inline=True, makes_arrays=False)
def _place(pool, index, altitude_km, cos_sun_zenith):
    """The `SunRay` that arrives at a point."""
    c = min(1.0, max(-1.0, cos_sun_zenith))
    z = max(altitude_km, pool[GROUND])
    if z > pool[TOP]:
        lit, bending, p, u = _ray_from_space(pool, index, z, c)
        slope = 0.0
        jz = -1
        fz = 0.0
    else:
        lit, bending, slope, p, u, jz, fz = _ray(pool, index, z, c)
    return SunRay(lit, bending, slope, p, u, jz, fz)


@njit(inner=True, cache=True, inline=True, makes_arrays=False)
def _place_up(index, ray):
    """Offset of the first of the sixteen values from above at wavelength 0, and the weights of its cosine nodes."""
    n_c = index[N_COSINE]
    a = abs(ray.u) / math.sqrt(ray.u * ray.u + ray.p * ray.p)
    m, fm = even_nodes(a * (1.0 + COSINE_SCALE) / (a + COSINE_SCALE) * n_c, n_c)
    return index[AT_UP] + (ray.node * (n_c + 1) + m) * index[N_W], weights(fm)


class _BehindLimb(NamedTuple):
    """Where a ray that has passed its lowest point is in the tables, the same at every wavelength.

    distance, limb: first of four nodes of the distance and, for the reference, of the lowest point, with their weights;
    shift [km]: of the lowest point per unit of dispersion
    factor: 1/(1 + |u|/far), and limit: bound on ln(E/F0) without it
    """

    distance: int
    distance_weights: tuple[float, float, float, float]
    limb: int
    limb_weights: tuple[float, float, float, float]
    shift: float
    factor: float
    limit: float


@njit(inner=True, cache=True, inline=True, makes_arrays=False)
def _place_down(pool, index, ray):
    """The `_BehindLimb` of a ray."""
    n_d = index[N_DISTANCE]
    a = ray.u / (ray.u - NEAR_KM) * ((MAX_DISTANCE_KM + NEAR_KM) / MAX_DISTANCE_KM)
    d, fd = even_nodes(min(1.0, a) * n_d, n_d)
    along = weights(fd)
    ky, fy = _limb_node(pool, index, ray.p)
    across = weights(fy)
    shift = 0.0
    if index[DISPERSING] == 1:
        row = n_d + 1
        shift = bicubic(pool, index[AT_SHIFT] + ky * row + d, 1, row, across, along)
    factor = 1.0 / (1.0 - ray.u / pool[FAR])
    return _BehindLimb(d, along, ky, across, shift, factor, LARGEST_LOG - math.log(factor))


@njit(inner=True, cache=True, inline=True, makes_arrays=False)
def _of_edges(pool, index, w, z, xx, u):
    """Optical depth at edges of layers of a wavelength's own ray, of n r cos i = `u` [km], to a point of (n r)^2 = `xx`
    [km^2]."""
    c = index[AT_EDGE_COEFFICIENT] + w
    return edge_depth(pool, index[N_EDGE], index[AT_EDGE], c, index[N_W], z, xx, u)


@njit(inner=True, cache=True, inline=True, makes_arrays=False)
def _light_from_above(pool, index, w, z, ray, value):
    """E/F0 at a wavelength of a ray that comes from above."""
    p, u = ray.p, ray.u
    own_u = u - p * dispersion_lag(pool[index[AT_DISPERSION] + w], ray.bending, ray.slope)
    if ray.node >= 0:
        value -= _of_edges(pool, index, w, z, p * p + u * u, own_u)
    light = math.exp(min(value, LARGEST_LOG))
    if index[SCREENED] == 1:
        passed = passing(pool, index[AT_SCREEN], math.sqrt(max(0.0, u * u + (p - own_u) * (p + own_u))), own_u)
        light *= at_wavelength(pool, index[AT_SCREEN], w, passed)
    return light


@njit(inner=True, cache=True, inline=True, makes_arrays=False)
def _light_behind_limb(pool, index, w, z, ray, behind, value):
    """E/F0 at a wavelength of a ray that has passed its lowest point; behind: its `_BehindLimb`."""
    p, u = ray.p, ray.u
    own, node, across = p, behind.limb, behind.limb_weights
    dispersion = pool[index[AT_DISPERSION] + w]
    if dispersion > 0.0:
        own = p + dispersion * behind.shift
        if own < pool[P_GROUND] * TOUCHING:
            return 0.0
        node, position = _limb_node(pool, index, own)
        across = weights(position)
    row = index[N_DISTANCE] + 1
    k = index[AT_DOWN] + (w * index[N_LIMB_NODE] + node) * row + behind.distance
    value += bicubic(pool, k, 1, row, across, behind.distance_weights)
    own_u = -math.sqrt(max(0.0, u * u + (p - own) * (p + own)))
    value -= _of_edges(pool, index, w, z, p * p + u * u, own_u)
    light = behind.factor * math.exp(min(value, behind.limit))
    if index[SCREENED] == 1:
        light *= at_wavelength(pool, index[AT_SCREEN], w, passing(pool, index[AT_SCREEN], own, own_u))
    return light


@njit(inner=True, cache=True, makes_arrays=False)
def lit_at(beam, altitude_km, cos_sun_zenith):
    """Whether the most refracted wavelength that the tables know reaches a point; arguments as of `beam_at`."""
    return _place(beam.pool, beam.layout, altitude_km, cos_sun_zenith).lit


@njit(cache=True, makes_arrays=False)
def beam_at(beam, altitude_km, cos_sun_zenith, out):
    """Irradiance of the sun beam on a surface normal to it, over F0, at one point and every wavelength.

    beam: from :func:`twilight.transport.beam.prepare_beam`.
    altitude_km: of the point; below the ground counts as the ground, above the top is vacuum.
    cos_sun_zenith: cosine of the true zenith angle of the sun at the point.
    out (W,): filled with transmittance x spreading of the refracted beam; exactly 0 in the refracted limb's shadow.
    Returns the bending [rad] >= 0: true minus apparent zenith angle of the sun.
    """
    pool, index = beam.pool, beam.layout
    n_w = index[N_W]
    ray = _place(pool, index, altitude_km, cos_sun_zenith)
    if not ray.lit:
        for w in range(n_w):
            out[w] = 0.0
        return ray.bending
    k = index[AT_OVERHEAD]
    for w in range(n_w):
        out[w] = -pool[k + w]
    if ray.node >= 0:
        at, along = _place_up(index, ray)
        across = weights(ray.position)
        sign = 1.0 if ray.u >= 0.0 else -1.0
        row = (index[N_COSINE] + 1) * n_w
        for w in range(n_w):
            out[w] += sign * bicubic(pool, at + w, n_w, row, across, along)
    if ray.u >= 0.0:
        for w in range(n_w):
            out[w] = _light_from_above(pool, index, w, altitude_km, ray, out[w])
    else:
        behind = _place_down(pool, index, ray)
        for w in range(n_w):
            out[w] = _light_behind_limb(pool, index, w, altitude_km, ray, behind, out[w])
    return ray.bending


@njit(cache=True, makes_arrays=False)
def beam_at_one(beam, altitude_km, cos_sun_zenith, w):
    """(irradiance over F0, bending [rad]) of :func:`beam_at` at wavelength index `w` alone."""
    pool, index = beam.pool, beam.layout
    n_w = index[N_W]
    ray = _place(pool, index, altitude_km, cos_sun_zenith)
    if not ray.lit:
        return 0.0, ray.bending
    value = -pool[index[AT_OVERHEAD] + w]
    if ray.node >= 0:
        at, along = _place_up(index, ray)
        sign = 1.0 if ray.u >= 0.0 else -1.0
        row = (index[N_COSINE] + 1) * n_w
        value += sign * bicubic(pool, at + w, n_w, row, weights(ray.position), along)
    if ray.u >= 0.0:
        return _light_from_above(pool, index, w, altitude_km, ray, value), ray.bending
    behind = _place_down(pool, index, ray)
    return _light_behind_limb(pool, index, w, altitude_km, ray, behind, value), ray.bending
