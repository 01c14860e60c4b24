"""The adjoint of one order of scattering: from derivatives of a number by the light of an order to those by the light
of the order before.

The scattering operator K interpolates the logarithm of the mean radiance: K(U) is linear in what is interpolated, and
its derivative at the light U is the linear operator K'.  With y the derivatives of a number, of the radiance in a line
of sight for example, by the Stokes parameters that `next_order.scatter` writes, the kernels here return K'^T y, the
derivatives by the `RadianceField` that it reads.  They go through the same points, and from every sum that a point
enters back into it.

Arguments as of `next_order`: rays: `NodeRays`, ray: index of one of them; point: `RayPoints`, k: index of one of them;
light: `RadianceField`; grid: `ZenithGrid`; series: `Truncation`; source: `SlabSource` of one point, low, high: its
first and last node of zenith angle.  Here also adjoint: `RadianceAdjoint`, added to; slab: `SlabAdjoint` of one point.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from twilight.jit.kernels import njit
from twilight.jit.simd import broadcast, exp, load, maximum, store
from twilight.solvers.zones.line_integrals import fine_interval, seen_nodes
from twilight.solvers.zones.next_order import (
    COS_AZIMUTH,
    I_FROM_E,
    MIN_SOURCE,
    ONE,
    PLACE,
    Q_FROM_B,
    Q_FROM_E,
    Q_FROM_I,
    TWO,
    U_FROM_B,
    U_FROM_E,
    U_FROM_I,
    ZERO,
    empty_slab_source,
    fill_slab_source,
    sum_intensity,
    sum_q_and_u,
)
from twilight.transport.lines import ANGLE

STEEP = np.float32(1e6)
"""Slope of the step that is 0 where a source function counts as MIN_SOURCE, and 1 above."""
MINUS = np.float32(-1.0)


class RadianceAdjoint(NamedTuple):
    """Derivatives of a number by each value of a `RadianceField`, in arrays of the same shapes."""

    log_mean: np.ndarray
    ratio: np.ndarray
    log_ground: np.ndarray


class SlabAdjoint(NamedTuple):
    """Derivatives by log_mean (T', LANES) and amplitude (T', A, LANES) of a `SlabSource`."""

    log_mean: np.ndarray
    amplitude: np.ndarray


@njit(inner=True, cache=True, inline=True)
def add(array, index, lanes):
    """Add `lanes` to array[`index`]."""
    store(array, index, load(array, index) + lanes)


@njit(inner=True, cache=True)
def direction_adjoint(source, slab, j, b1, c, highest, series, strength, of_i, of_q, of_u, stokes):
    """Add what one direction at one point does; of_i, of_q, of_u (`Lanes`): derivatives by its Stokes parameters.

    j, b1: interval of the fine grid of solar zenith angles and the way into it; c: cosine of the azimuth; highest:
    azimuthal order; strength: weight of the point; stokes: whether Q and U count.
    """
    b0 = ONE - b1
    mean = strength * exp(b0 * load(source.log_mean, j) + b1 * load(source.log_mean, j + 1))
    shape = maximum(sum_intensity(source.amplitude, j, b0, b1, c, highest), MIN_SOURCE)
    # 1 above MIN_SOURCE, 0 at it: 1 - max(1 - s, 0)
    above = broadcast(ONE) + MINUS * maximum(
        broadcast(ONE) + MINUS * (STEEP * (shape + broadcast(MINUS * MIN_SOURCE))), ZERO
    )
    total = of_i * shape
    amplitude = slab.amplitude
    to_i = mean * of_i * above
    before, here = c, ONE
    twice = TWO * c
    for m in range(highest + 1):
        add(amplitude, (j, m), (b0 * here) * to_i)
        add(amplitude, (j + 1, m), (b1 * here) * to_i)
        before, here = here, twice * here - before
    if stokes:
        n, first = series.spin2_orders, series.azimuthal_orders
        q, u = sum_q_and_u(source.amplitude, j, b0, b1, c, first, n)
        total += of_q * q
        total += of_u * u
        to_q, to_u = mean * of_q, mean * of_u
        c = min(ONE, max(-ONE, c))
        cos_m, cos_before = ONE, c
        sin_m, sin_before = ZERO, -np.float32(math.sqrt(max(ZERO, ONE - c * c)))
        twice = TWO * c
        for m in range(first, first + n):
            add(amplitude, (j, m), (b0 * cos_m) * to_q)
            add(amplitude, (j + 1, m), (b1 * cos_m) * to_q)
            add(amplitude, (j, m + n), (b0 * sin_m) * to_u)
            add(amplitude, (j + 1, m + n), (b1 * sin_m) * to_u)
            cos_m, cos_before = twice * cos_m - cos_before, cos_m
            sin_m, sin_before = twice * sin_m - sin_before, sin_m
    contribution = mean * total
    add(slab.log_mean, j, b0 * contribution)
    add(slab.log_mean, j + 1, b1 * contribution)


@njit(inner=True, cache=True)
def source_adjoint(point, k, grid, series, low, high, source, slab, adjoint):
    """Add to adjoint what the derivatives by a point's source, slab, give at the nodes low..high of solar zenith angle,
    and set slab to 0.

    source: as `fill_slab_source` left it for this point and these nodes.
    """
    node, f = point.node[k], point.node_fraction[k]
    g = ONE - f
    n = grid.per_interval
    first, amplitude = series.azimuthal_orders, slab.amplitude
    highest = point.highest[k]
    for t in range(low, high):
        base = t * n
        for q in range(1, n):
            b = np.float32(q) / np.float32(n)
            a = ONE - b
            for m in range(highest + 1):
                here = load(amplitude, (base + q, m))
                add(amplitude, (base, m), a * here)
                add(amplitude, (base + n, m), b * here)
    if series.spin2_orders > 0:
        for t in range(low * n, high * n + 1):
            if t % n == 0:
                continue
            for m in range(first, amplitude.shape[1]):
                here = load(amplitude, (t, m))
                for j in range(4):
                    add(amplitude, (grid.node[t, j] * n, m), grid.weight[t, j] * here)
        spin2_adjoint(point, k, series, low, high, n, source.by_spin2, amplitude, adjoint.ratio)
    for t in range(low, high + 1):
        c = 0
        for m in range(min(highest + 1, first)):
            here = load(amplitude, (t * n, m))
            for _ in range(m, series.degree + 1):
                part = load(source.by_harmonic, c) * here
                add(adjoint.ratio, (node, t, c), g * part)
                add(adjoint.ratio, (node + 1, t, c), f * part)
                c += 1
    for t in range(low * n, high * n + 1):
        here = load(slab.log_mean, t)
        for j in range(4):
            at, y = grid.node[t, j], grid.weight[t, j]
            add(adjoint.log_mean, (node, at), (g * y) * here)
            add(adjoint.log_mean, (node + 1, at), (f * y) * here)
    zero = broadcast(ZERO)
    # cubics between two nodes reach one node further
    for t in range(max(0, low - 1) * n, min(grid.node.shape[0] - 1, (high + 1) * n) + 1):
        store(slab.log_mean, t, zero)
        for m in range(amplitude.shape[1]):
            store(amplitude, (t, m), zero)


@njit(inner=True, cache=True)
def spin2_adjoint(point, k, series, low, high, n, by_spin2, amplitude, ratio):
    """Add to ratio (Z', T, C + 2 C') what Q and U of the source, and the part of Q and U in I, give.

    n: fine intervals of one of zenith angle; by_spin2 (C', 7, LANES): of the source; amplitude (T', A, LANES): of a
    `SlabAdjoint`
    """
    n_spin2 = point.spin2_x.shape[1]
    n_harmonics = ratio.shape[2] - 2 * n_spin2
    node, f = point.node[k], point.node_fraction[k]
    g = ONE - f
    first = series.azimuthal_orders
    for t in range(max(0, low - 1), min(ratio.shape[1], high + 2)):
        row = t * n
        p = start = 0
        for m in range(series.spin2_orders):
            to_q = load(amplitude, (row, first + m))
            to_u = load(amplitude, (row, first + series.spin2_orders + m))
            to_i = load(amplitude, (row, m)) if low <= t <= high else broadcast(ZERO)
            c = start + max(m, 2) - m
            for _ in range(max(m, 2), series.spin2_degree + 1):
                e, b = n_harmonics + p, n_harmonics + n_spin2 + p
                of_i = load(by_spin2, (p, Q_FROM_I)) * to_q + load(by_spin2, (p, U_FROM_I)) * to_u
                of_e = load(by_spin2, (p, Q_FROM_E)) * to_q + load(by_spin2, (p, U_FROM_E)) * to_u
                of_e += load(by_spin2, (p, I_FROM_E)) * to_i
                of_b = load(by_spin2, (p, Q_FROM_B)) * to_q + load(by_spin2, (p, U_FROM_B)) * to_u
                add(ratio, (node, t, c), g * of_i)
                add(ratio, (node + 1, t, c), f * of_i)
                add(ratio, (node, t, e), g * of_e)
                add(ratio, (node + 1, t, e), f * of_e)
                add(ratio, (node, t, b), g * of_b)
                add(ratio, (node + 1, t, b), f * of_b)
                c += 1
                p += 1
            start += series.degree + 1 - m


@njit(inner=True, cache=True, inline=True)
def empty_slab_adjoint(source):
    """An empty `SlabAdjoint` for a `SlabSource`."""
    return SlabAdjoint(np.zeros_like(source.log_mean), np.zeros_like(source.amplitude))


@njit(cache=True, nogil=True, fastmath={"contract", "nsz"})
def scatter_adjoint(rays, point, light, grid, series, radiance, seen, adjoint):
    """Add K'^T of radiance (Z, M, T, F, Stokes, LANES), derivatives by what `next_order.scatter` writes, to adjoint.

    seen (Z, M, T): where radiance is not 0.
    """
    n_polar, n_zenith, n_azimuth = radiance.shape[1], radiance.shape[2], radiance.shape[3]
    geometry = rays.geometry
    n_fine = grid.node.shape[0]
    per_interval = grid.per_interval
    source = empty_slab_source(point, light, grid, series)
    slab = empty_slab_adjoint(source)
    last = geometry.shape[0] - 2
    stokes = series.spin2_orders > 0
    nothing = broadcast(ZERO)
    for node in range(radiance.shape[0]):
        for i in range(n_polar):
            if not seen[node, i].any():
                continue
            ray = node * n_polar + i
            for k in range(rays.first[ray], rays.first[ray + 1]):
                place = point.angle[k]
                step = min(int(place), last)
                h1 = place - np.float32(step)
                h0 = ONE - h1
                lowest, farthest = n_fine - 2, 0
                for t in range(n_zenith):
                    if seen[node, i, t]:
                        for a in range(n_azimuth):
                            x = h0 * geometry[step, t, a, PLACE] + h1 * geometry[step + 1, t, a, PLACE]
                            j = min(int(x), n_fine - 2)
                            lowest, farthest = min(lowest, j), max(farthest, j)
                low, high = lowest // per_interval, farthest // per_interval + 1
                fill_slab_source(point, k, light, grid, series, low, high, source)
                highest = point.highest[k]
                strength = load(point.weight, k)
                for t in range(n_zenith):
                    if not seen[node, i, t]:
                        continue
                    for a in range(n_azimuth):
                        x = h0 * geometry[step, t, a, PLACE] + h1 * geometry[step + 1, t, a, PLACE]
                        c = h0 * geometry[step, t, a, COS_AZIMUTH] + h1 * geometry[step + 1, t, a, COS_AZIMUTH]
                        j = min(int(x), n_fine - 2)
                        of_i = load(radiance, (node, i, t, a, 0))
                        of_q, of_u = nothing, nothing
                        if stokes:
                            of_q, of_u = load(radiance, (node, i, t, a, 1)), load(radiance, (node, i, t, a, 2))
                        direction_adjoint(
                            source, slab, j, x - np.float32(j), c, highest, series, strength, of_i, of_q, of_u, stokes
                        )
                source_adjoint(point, k, grid, series, low, high, source, slab, adjoint)
            if rays.ground_weight[ray].max() > ZERO:
                ground_adjoint(rays, ray, light.log_ground, radiance[node, i], adjoint.log_ground)


@njit(inner=True, cache=True, nogil=True)
def ground_adjoint(rays, ray, log_ground, radiance, of_ground):
    """Add to of_ground (T', LANES) the derivatives by the ground's log_ground (T', LANES) at the end of a ray, from
    those by the light there, radiance (T, F, Stokes, LANES)."""
    geometry, place = rays.geometry, rays.ground_place[ray]
    step = min(int(place), geometry.shape[0] - 2)
    h1 = place - np.float32(step)
    h0 = ONE - h1
    passed = load(rays.ground_weight, ray)
    for t in range(radiance.shape[0]):
        for a in range(radiance.shape[1]):
            x = h0 * geometry[step, t, a, PLACE] + h1 * geometry[step + 1, t, a, PLACE]
            j = min(int(x), log_ground.shape[0] - 2)
            b1 = x - np.float32(j)
            lit = passed * exp((ONE - b1) * load(log_ground, j) + b1 * load(log_ground, j + 1))
            lit = lit * load(radiance, (t, a, 0))
            add(of_ground, j, (ONE - b1) * lit)
            add(of_ground, j + 1, b1 * lit)


@njit(cache=True, nogil=True, fastmath={"contract", "nsz"})
def view_adjoint(rays, point, directions, light, grid, series, in_lane, adjoint):
    """Add the derivatives of the radiance that `line_integrals.view_multiple` finds in one direction on one ray.

    rays: `RayBundle`, its ground_weight (R, LANES); directions: `RayDirections`; both of one each
    in_lane (LANES,): 1 in the lane of this direction, 0 in others.
    """
    fine, ground_weight = grid.fine_rad, rays.ground_weight
    source = empty_slab_source(point, light, grid, series)
    slab = empty_slab_adjoint(source)
    of_i, nothing = load(in_lane, ()), broadcast(ZERO)
    zenith = directions.zenith_rad
    ct, st = math.cos(zenith), math.sin(zenith)
    around = directions.cos_azimuth[0]
    for k in range(rays.first[0], rays.first[1]):
        psi = rays.place[k, ANGLE]
        low, high = seen_nodes(grid.nodes_rad, zenith, psi)
        fill_slab_source(point, k, light, grid, series, low, high, source)
        cp, sp = math.cos(psi), math.sin(psi)
        ahead = -sp * ct + cp * st * around
        up = cp * ct + sp * st * around
        across = math.sqrt(max(0.0, 1.0 - up * up))
        c = np.float32(min(1.0, max(-1.0, ahead / max(across, 1e-9))))
        angle = math.acos(min(1.0, max(-1.0, up)))
        j, b1 = fine_interval(fine, angle, low * grid.per_interval, high * grid.per_interval - 1)
        direction_adjoint(
            source, slab, j, b1, c, point.highest[k], series, load(point.weight, k), of_i, nothing, nothing, False
        )
        source_adjoint(point, k, grid, series, low, high, source, slab, adjoint)
    if ground_weight[0].max() > ZERO:
        cp, sp = math.cos(rays.ground_angle_rad[0]), math.sin(rays.ground_angle_rad[0])
        angle = math.acos(min(1.0, max(-1.0, cp * ct + sp * st * around)))
        j, b1 = fine_interval(fine, angle, 0, fine.size - 2)
        lit = load(ground_weight, 0) * exp((ONE - b1) * load(light.log_ground, j) + b1 * load(light.log_ground, j + 1))
        add(adjoint.log_ground, j, (ONE - b1) * (lit * of_i))
        add(adjoint.log_ground, j + 1, b1 * (lit * of_i))


@njit(cache=True, nogil=True, fastmath={"contract", "nsz"})
def analysis_adjoint(moments, analysis, spin2_analysis, radiance):
    """Derivatives by Stokes parameters, added to radiance (Z, M, T, F, Stokes, LANES), from those by the moments (Z, T,
    C + 2 C', LANES) that `next_order.moments_of` finds in them.

    analysis (Z, C, M, F), spin2_analysis (Z, C', 2, M, F): weights of the directions
    """
    n_polar, n_zenith, n_azimuth, n_stokes = radiance.shape[1:5]
    n_harmonics, n_spin2 = analysis.shape[1], spin2_analysis.shape[1]
    for z in range(radiance.shape[0]):
        for i in range(n_polar):
            for t in range(n_zenith):
                for a in range(n_azimuth):
                    total = broadcast(ZERO)
                    for c in range(n_harmonics):
                        total += analysis[z, c, i, a] * load(moments, (z, t, c))
                    add(radiance, (z, i, t, a, 0), total)
                    if n_stokes > 1:
                        q, u = broadcast(ZERO), broadcast(ZERO)
                        for c in range(n_spin2):
                            here = load(moments, (z, t, n_harmonics + c))
                            q += spin2_analysis[z, c, 0, i, a] * here
                            u += spin2_analysis[z, c, 1, i, a] * here
                        store(radiance, (z, i, t, a, 1), q)
                        store(radiance, (z, i, t, a, 2), u)
