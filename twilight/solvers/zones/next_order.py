"""The next order of scattering: Stokes parameters at every node in every direction from the light of the order before.

Along a ray the source function of I is J = mean radiance x sum_lm Y_lm (chi_l r_lm + b_l e_lm), that of Q and U is as
in `angles`.  The logarithm of the mean and the moments r, e, b relative to it are interpolated between nodes,
which is right where the field falls by e within a degree.  The vertical plane through a ray is the same all along it,
straight or bent by refraction: Q and U add up as they are.

Arguments that the kernels share: rays: `NodeRays`, ray: index of one of them; point: `RayPoints`, k: index of one of
them; light: `RadianceField`; grid: `ZenithGrid`; series: `Truncation`; source: `SlabSource`; amplitudes (T', A, LANES):
as `SlabSource.amplitude`, A of I, Q and U together; c: cosine of the azimuth from the sun.
"""

import math
from typing import NamedTuple

import numpy as np

from twilight.jit.kernels import njit
from twilight.jit.simd import LANES, broadcast, exp, load, maximum, store
from twilight.solvers.zones.ray_points import COS_AZIMUTH, PLACE

MIN_SOURCE = np.float32(1e-3)
"""Least source function of I over the mean radiance: a truncated series may dip below 0."""
ZERO, ONE, TWO = np.float32(0.0), np.float32(1.0), np.float32(2.0)
_FIRST = np.int64(0)
"""First node; no literal, for which numba would compile `add_spin2` once more."""
MATRIX_B, MATRIX_EVEN, MATRIX_ODD = range(3)
"""Second axis of `RayPoints.matrix`."""
I_FROM_E, Q_FROM_I, Q_FROM_E, Q_FROM_B, U_FROM_I, U_FROM_E, U_FROM_B = range(7)
"""Second axis of `SlabSource.by_spin2`."""


class RadianceField(NamedTuple):
    """The light of one order of scattering or of all, on fine altitudes Z' and nodes T of solar zenith angle.

    log_mean (Z', T, LANES): logarithm of the mean radiance; ratio (Z', T, C + 2 C', LANES): moments relative to it, of
    I, then E, then B; log_ground (T', LANES): logarithm of the radiance of the ground that the sky lights, on the fine
    grid of zenith angles
    """

    log_mean: np.ndarray
    ratio: np.ndarray
    log_ground: np.ndarray


class ZenithGrid(NamedTuple):
    """Solar zenith angles of a field: nodes_rad (T,), and fine_rad (T',) with `per_interval` steps in each interval.

    node, weight (T', 4): of the cubics from the nodes to the fine grid,
        value[t] = sum_j weight[t, j] node_value[node[t, j]]
    """

    nodes_rad: np.ndarray
    fine_rad: np.ndarray
    node: np.ndarray
    weight: np.ndarray
    per_interval: int


class SlabSource(NamedTuple):
    """Workspace: the source function at one altitude, light scattered into one polar angle.

    log_mean (T', LANES): logarithm of the mean radiance on the fine grid of solar zenith angles; amplitude (T', A,
    LANES): amplitudes relative to the mean, of cos(m azimuth) in I for every order, then of cos(m azimuth) in Q and of
    sin(m azimuth) in U.  by_harmonic (C, LANES), by_spin2 (C', 7, LANES): what a moment of the light gives to them.
    """

    log_mean: np.ndarray
    amplitude: np.ndarray
    by_harmonic: np.ndarray
    by_spin2: np.ndarray


@njit(inner=True, cache=True, inline=True, makes_arrays=False)
def fill_slab_source(point, k, light, grid, series, low, high, source):
    """Fill the `SlabSource` at the altitude and in the polar angle of point k, over nodes low..high of the solar zenith
    angle."""
    node = point.node[k]
    f = point.node_fraction[k]
    g = ONE - f
    highest = point.highest[k]
    log_mean, ratio, amplitude = light.log_mean, light.ratio, source.amplitude
    by_harmonic = source.by_harmonic
    per_interval = grid.per_interval
    c = 0
    for m in range(series.azimuthal_orders):
        for n in range(m, series.degree + 1):
            store(by_harmonic, c, point.polar[k, c] * load(point.chi, (k, n)))
            c += 1
    for t in range(low, high + 1):
        c = 0
        for m in range(min(highest + 1, series.azimuthal_orders)):
            total = broadcast(ZERO)
            for _ in range(m, series.degree + 1):
                moment = g * load(ratio, (node, t, c)) + f * load(ratio, (node + 1, t, c))
                total += load(by_harmonic, c) * moment
                c += 1
            store(amplitude, (t * per_interval, m), total)
    if series.spin2_orders > 0:
        # a cubic between two nodes looks at the next ones too
        nodes = (max(0, low - 1), low, high, min(log_mean.shape[1], high + 2))
        add_spin2(point, k, ratio, series, nodes, per_interval, source.by_spin2, amplitude)
        refine_spin2(grid, series.azimuthal_orders, low * per_interval, high * per_interval, amplitude)
    for t in range(low, high):
        base = t * per_interval
        for q in range(1, per_interval):
            b = np.float32(q) / np.float32(per_interval)
            a = ONE - b
            for m in range(highest + 1):
                between = a * load(amplitude, (base, m)) + b * load(amplitude, (base + per_interval, m))
                store(amplitude, (base + q, m), between)
    for t in range(low * per_interval, high * per_interval + 1):
        lower, upper = broadcast(ZERO), broadcast(ZERO)
        for j in range(4):
            at, y = grid.node[t, j], grid.weight[t, j]
            lower += y * load(log_mean, (node, at))
            upper += y * load(log_mean, (node + 1, at))
        store(source.log_mean, t, g * lower + f * upper)


@njit(inner=True, cache=True, makes_arrays=False)
def refine_spin2(grid, first, low, high, amplitude):
    """Fill amplitude (T', A, LANES) of Q and U, its columns from `first` on, between the nodes by cubics: on the fine
    grid of solar zenith angles low..high."""
    n = grid.per_interval
    for t in range(low, high + 1):
        if t % n == 0:
            continue
        j0, j1, j2, j3 = grid.node[t, 0] * n, grid.node[t, 1] * n, grid.node[t, 2] * n, grid.node[t, 3] * n
        y0, y1, y2, y3 = grid.weight[t, 0], grid.weight[t, 1], grid.weight[t, 2], grid.weight[t, 3]
        for m in range(first, amplitude.shape[1]):
            near = y1 * load(amplitude, (j1, m)) + y2 * load(amplitude, (j2, m))
            store(amplitude, (t, m), near + (y0 * load(amplitude, (j0, m)) + y3 * load(amplitude, (j3, m))))


@njit(inner=True, cache=True, makes_arrays=False)
def add_spin2(point, k, ratio, series, nodes, per_interval, by_spin2, amplitude):
    """The source of Q and U at nodes of the solar zenith angle, set in their rows of amplitude (T', A, LANES), and what
    Q and U of the light give to I, added to its rows.

    ratio (Z', T, C + 2 C', LANES): moments, as in `RadianceField`; nodes: first, first and last with I wanted, end;
    per_interval: as in `ZenithGrid`; by_spin2 (C', 7, LANES): as in `SlabSource`.
    """
    spin2_x, spin2_z, polar, matrix = point.spin2_x, point.spin2_z, point.polar, point.matrix
    n_spin2 = spin2_x.shape[1]
    n_harmonics = ratio.shape[2] - 2 * n_spin2
    node = point.node[k]
    f = point.node_fraction[k]
    g = ONE - f
    p = 0
    # where the harmonics of one order begin
    start = 0
    for m in range(series.spin2_orders):
        for n in range(max(m, 2), series.spin2_degree + 1):
            y, x, z = polar[k, start + n - m], spin2_x[k, p], spin2_z[k, p]
            of_b, of_even, of_odd = (
                load(matrix, (k, MATRIX_B, n)),
                load(matrix, (k, MATRIX_EVEN, n)),
                load(matrix, (k, MATRIX_ODD, n)),
            )
            store(by_spin2, (p, I_FROM_E), y * of_b)
            store(by_spin2, (p, Q_FROM_I), x * of_b)
            store(by_spin2, (p, Q_FROM_E), x * of_even)
            store(by_spin2, (p, Q_FROM_B), z * of_odd)
            store(by_spin2, (p, U_FROM_I), z * of_b)
            store(by_spin2, (p, U_FROM_E), z * of_even)
            store(by_spin2, (p, U_FROM_B), x * of_odd)
            p += 1
        start += series.degree + 1 - m
    for t in range(nodes[0], nodes[3]):
        row = t * per_interval
        p = start = 0
        for m in range(series.spin2_orders):
            of_i, of_q, of_u = broadcast(ZERO), broadcast(ZERO), broadcast(ZERO)
            c = start + max(m, 2) - m
            for _ in range(max(m, 2), series.spin2_degree + 1):
                e, b = n_harmonics + p, n_harmonics + n_spin2 + p
                mean = g * load(ratio, (node, t, c)) + f * load(ratio, (node + 1, t, c))
                moment_e = g * load(ratio, (node, t, e)) + f * load(ratio, (node + 1, t, e))
                moment_b = g * load(ratio, (node, t, b)) + f * load(ratio, (node + 1, t, b))
                of_i += load(by_spin2, (p, I_FROM_E)) * moment_e
                of_q += load(by_spin2, (p, Q_FROM_I)) * mean
                of_u += load(by_spin2, (p, U_FROM_I)) * mean
                of_q += load(by_spin2, (p, Q_FROM_E)) * moment_e
                of_u += load(by_spin2, (p, U_FROM_E)) * moment_e
                of_q += load(by_spin2, (p, Q_FROM_B)) * moment_b
                of_u += load(by_spin2, (p, U_FROM_B)) * moment_b
                c += 1
                p += 1
            if nodes[1] <= t <= nodes[2]:
                store(amplitude, (row, m), load(amplitude, (row, m)) + of_i)
            store(amplitude, (row, series.azimuthal_orders + m), of_q)
            store(amplitude, (row, series.azimuthal_orders + series.spin2_orders + m), of_u)
            start += series.degree + 1 - m


@njit(inner=True, cache=True, inline=True)
def empty_slab_source(point, light, grid, series):
    """An empty `SlabSource`."""
    n_fine, n_spin2 = grid.node.shape[0], point.spin2_x.shape[1]
    return SlabSource(
        np.zeros((n_fine, LANES), np.float32),
        np.zeros((n_fine, series.azimuthal_orders + 2 * series.spin2_orders, LANES), np.float32),
        np.zeros((light.ratio.shape[2] - 2 * n_spin2, LANES), np.float32),
        np.zeros((n_spin2, 7, LANES), np.float32),
    )


@njit(inner=True, cache=True, inline=True, makes_arrays=False)
def sum_intensity(amplitudes, j, b0, b1, c, highest):
    """I over the mean, `Lanes`, at an azimuth, by Clenshaw's recurrence.

    j: row of amplitudes, b0, b1: weights of this row and of the next; highest: largest order that counts.
    """
    twice = TWO * c
    after, value = broadcast(ZERO), broadcast(ZERO)
    for m in range(highest, 0, -1):
        amplitude = b0 * load(amplitudes, (j, m)) + b1 * load(amplitudes, (j + 1, m))
        after, value = value, amplitude + twice * value - after
    return b0 * load(amplitudes, (j, 0)) + b1 * load(amplitudes, (j + 1, 0)) + c * value - after


@njit(inner=True, cache=True, inline=True, makes_arrays=False)
def sum_q_and_u(amplitudes, j, b0, b1, c, first, azimuthal_orders):
    """Q and U over the mean, `Lanes` each; amplitudes of Q begin at column `first`, azimuthal_orders: of each.

    j, b0, b1: as in `sum_intensity`.
    """
    c = min(ONE, max(-ONE, c))
    sine = np.float32(math.sqrt(max(ZERO, ONE - c * c)))
    twice = TWO * c
    q_after, q, u_after, u = broadcast(ZERO), broadcast(ZERO), broadcast(ZERO), broadcast(ZERO)
    for m in range(first + azimuthal_orders - 1, first, -1):
        n = m + azimuthal_orders
        of_q = b0 * load(amplitudes, (j, m)) + b1 * load(amplitudes, (j + 1, m))
        of_u = b0 * load(amplitudes, (j, n)) + b1 * load(amplitudes, (j + 1, n))
        q_after, q = q, of_q + twice * q - q_after
        u_after, u = u, of_u + twice * u - u_after
    return b0 * load(amplitudes, (j, first)) + b1 * load(amplitudes, (j + 1, first)) + c * q - q_after, sine * u


@njit(cache=True, nogil=True, fastmath={"contract", "nsz"})
def scatter(rays, point, sequence, light, grid, series, out, begin, end):
    """Stokes parameters out[node, polar, zenith, azimuth, I Q U, LANES] from the light of the order before.

    Node altitudes begin..end are computed; the ground is Lambertian.  The Stokes axis has one entry where series has no
    spin-2 harmonics.

    sequence (P, 2): points and the polar angles of their rays, those of a node altitude by their own altitudes: the
    light there is read from memory once
    """
    n_polar, n_zenith, n_azimuth = out.shape[1], out.shape[2], out.shape[3]
    n_fine = grid.node.shape[0]
    geometry = rays.geometry
    source = empty_slab_source(point, light, grid, series)
    log_mean, amplitudes = source.log_mean, source.amplitude
    last = geometry.shape[0] - 2
    for node in range(begin, end):
        for n in range(rays.first[node * n_polar], rays.first[(node + 1) * n_polar]):
            k, i = sequence[n, 0], sequence[n, 1]
            fill_slab_source(point, k, light, grid, series, _FIRST, n_zenith - 1, source)
            place = point.angle[k]
            step = min(int(place), last)
            h1 = place - np.float32(step)
            h0 = ONE - h1
            highest = point.highest[k]
            strength = load(point.weight, k)
            for t in range(n_zenith):
                for a in range(n_azimuth):
                    x = h0 * geometry[step, t, a, PLACE] + h1 * geometry[step + 1, t, a, PLACE]
                    c = h0 * geometry[step, t, a, COS_AZIMUTH] + h1 * geometry[step + 1, t, a, COS_AZIMUTH]
                    j = min(int(x), n_fine - 2)
                    b1 = x - np.float32(j)
                    b0 = ONE - b1
                    mean = strength * exp(b0 * load(log_mean, j) + b1 * load(log_mean, j + 1))
                    amplitude = maximum(sum_intensity(amplitudes, j, b0, b1, c, highest), MIN_SOURCE)
                    store(out, (node, i, t, a, 0), load(out, (node, i, t, a, 0)) + mean * amplitude)
                    if series.spin2_orders > 0:
                        q, u = sum_q_and_u(amplitudes, j, b0, b1, c, series.azimuthal_orders, series.spin2_orders)
                        store(out, (node, i, t, a, 1), load(out, (node, i, t, a, 1)) + mean * q)
                        store(out, (node, i, t, a, 2), load(out, (node, i, t, a, 2)) + mean * u)
        for i in range(n_polar):
            ray = node * n_polar + i
            if rays.ground_weight[ray].max() > ZERO:
                add_ground(rays, ray, light.log_ground, out[node, i])


@njit(inner=True, cache=True, nogil=True, makes_arrays=False)
def add_ground(rays, ray, log_ground, sums):
    """Light of the Lambertian ground at the end of a ray, unpolarised, added to sums (T, F, Stokes, LANES).

    log_ground (T', LANES): as in `RadianceField`.
    """
    geometry, place = rays.geometry, rays.ground_place[ray]
    step = min(int(place), geometry.shape[0] - 2)
    h1 = place - np.float32(step)
    h0 = ONE - h1
    passed = load(rays.ground_weight, ray)
    for t in range(sums.shape[0]):
        for a in range(sums.shape[1]):
            x = h0 * geometry[step, t, a, PLACE] + h1 * geometry[step + 1, t, a, PLACE]
            j = min(int(x), log_ground.shape[0] - 2)
            b1 = x - np.float32(j)
            lit = exp((ONE - b1) * load(log_ground, j) + b1 * load(log_ground, j + 1))
            store(sums, (t, a, 0), load(sums, (t, a, 0)) + passed * lit)


@njit(cache=True, nogil=True, fastmath={"contract", "nsz"})
def moments_of(radiance, analysis, spin2_analysis, moments, begin, end):
    """Moments (Z, T, C + 2 C', LANES), added to, of Stokes parameters, for altitudes begin..end.

    radiance (Z, M, T, F, Stokes, LANES); moments (Z, T, C + 2 C', LANES); analysis (Z, C, M, F), spin2_analysis (Z, 2
    C', 2, M, F): as in `Angles`.
    """
    n_polar, n_zenith, n_azimuth = radiance.shape[1:4]
    n_harmonics, n_spin2 = analysis.shape[1], spin2_analysis.shape[1]
    for z in range(begin, end):
        for t in range(n_zenith):
            for c in range(n_harmonics):
                total = broadcast(ZERO)
                for i in range(n_polar):
                    for a in range(n_azimuth):
                        total += analysis[z, c, i, a] * load(radiance, (z, i, t, a, 0))
                store(moments, (z, t, c), total)
            for c in range(n_spin2):
                total = broadcast(ZERO)
                for i in range(n_polar):
                    for a in range(n_azimuth):
                        total += spin2_analysis[z, c, 0, i, a] * load(radiance, (z, i, t, a, 1))
                        total += spin2_analysis[z, c, 1, i, a] * load(radiance, (z, i, t, a, 2))
                store(moments, (z, t, n_harmonics + c), total)
