"""One order of scattering: Stokes parameters at every node in every direction from the light of the order before.

Along a ray the source of I is J = mean radiance x sum_lm Y_lm (chi_l r_lm + b_l e_lm), that of Q and U is as in
`polarised`, with the logarithm of the mean and the moments r, e, b relative to it interpolated between nodes: right
where the field falls by e within a degree.  The vertical plane through a ray is the same all along it, straight or bent
by refraction: Q and U add up as they are.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from twilight.kernels import njit
from twilight.lanes import at_least, exp, read, same, write

LEAST = np.float32(1e-3)
"""Least source of I relative to the mean: a truncated series may dip below 0."""
ZERO, ONE, TWO = np.float32(0.0), np.float32(1.0), np.float32(2.0)


class Light(NamedTuple):
    """The light of one or all orders, on fine altitudes Z' and nodes T of solar zenith angle.

    log_mean (Z', T, LANES): logarithm of the mean radiance; ratio (Z', T, C + 2 C', LANES): moments relative to it, of
    I, then of the even and of the odd patterns; log_ground (T', LANES): logarithm of the radiance of the ground that
    the sky lights, on the fine grid of zenith angles; of water that is the light that falls on it, over pi, and
    waves (T', N_COSINES, S, orders, LANES), empty for land, is what it reflects over that.
    """

    log_mean: np.ndarray
    ratio: np.ndarray
    log_ground: np.ndarray
    waves: np.ndarray


class Refinement(NamedTuple):
    """Cubic rule from the nodes of solar zenith angle to a fine grid of T' angles with `per_interval` steps in each
    interval: value = sum_j weight[t, j] node_value[node[t, j]], both (T', 4)."""

    node: np.ndarray
    weight: np.ndarray
    per_interval: int


@njit(cache=True, inline="always")
def slab(point, k, light, rule, series, low, high, fine_log, fine_wave):
    """The source at the altitude and in the polar angle of point k, over nodes low..high of the solar zenith angle.

    fine_log (T', LANES): logarithm of the mean on the fine grid; fine_wave (T', waves, LANES): amplitudes relative to
    the mean, of cos(m azimuth) in I for every order, then of cos(m azimuth) in Q and of sin(m azimuth) in U.
    """
    node = point.node[k]
    f = point.node_share[k]
    g = ONE - f
    highest = point.highest[k]
    polar, chi = point.polar, point.chi
    log_mean, ratio = light.log_mean, light.ratio
    nodes, weight = rule.node, rule.weight
    n_nodes = log_mean.shape[1]
    per_interval = rule.per_interval
    for t in range(low, high + 1):
        c = 0
        for m in range(series.orders):
            if m > highest:
                c += series.degree + 1 - m
                continue
            wave = same(ZERO)
            for n in range(m, series.degree + 1):
                y0, y1 = g * polar[k, c], f * polar[k, c]
                wave += read(chi, (k, n)) * (y0 * read(ratio, (node, t, c)) + y1 * read(ratio, (node + 1, t, c)))
                c += 1
            write(fine_wave, (t * per_interval, m), wave)
    if series.pattern_orders > 0:
        # a cubic between two nodes looks at the next ones too
        add_patterns(
            point, k, ratio, series, (max(0, low - 1), low, high, min(n_nodes, high + 2)), per_interval, fine_wave
        )  # fmt: skip
        refine_patterns(nodes, weight, per_interval, series.orders, low * per_interval, high * per_interval, fine_wave)
    for t in range(low, high):
        base = t * per_interval
        for q in range(1, per_interval):
            b = np.float32(q) / np.float32(per_interval)
            a = ONE - b
            for m in range(highest + 1):
                between = a * read(fine_wave, (base, m)) + b * read(fine_wave, (base + per_interval, m))
                write(fine_wave, (base + q, m), between)
    for t in range(low * per_interval, high * per_interval + 1):
        logarithm = same(ZERO)
        for j in range(4):
            at, y = nodes[t, j], weight[t, j]
            logarithm += g * y * read(log_mean, (node, at)) + f * y * read(log_mean, (node + 1, at))
        write(fine_log, t, logarithm)


@njit(cache=True)
def refine_patterns(nodes, weight, per_interval, first, low, high, fine_wave):
    """Waves of Q and U, `first` and beyond, between the nodes: on the fine grid of solar zenith angles low..high.

    nodes, weight (T', 4), per_interval: as in `Refinement`
    """
    for t in range(low, high + 1):
        if t % per_interval == 0:
            continue
        for m in range(first, fine_wave.shape[1]):
            value = same(ZERO)
            for j in range(4):
                value += weight[t, j] * read(fine_wave, (nodes[t, j] * per_interval, m))
            write(fine_wave, (t, m), value)


@njit(cache=True)
def add_patterns(point, k, ratio, series, nodes, per_interval, fine_wave):
    """The source of Q and U at nodes of the solar zenith angle, set in their rows of fine_wave (T', waves, LANES), and
    what Q and U of the light give to I, added to it.

    ratio (Z', T, C + 2 C', LANES): moments, as in `Light`; nodes: first, first and last with I wanted, end
    """
    even, odd, polar, matrix = point.even, point.odd, point.polar, point.matrix
    n_patterns = even.shape[1]
    n_harmonics = ratio.shape[2] - 2 * n_patterns
    node = point.node[k]
    f = point.node_share[k]
    g = ONE - f
    for t in range(nodes[0], nodes[3]):
        row = t * per_interval
        p = 0
        # where the harmonics of one order begin
        start = 0
        for m in range(series.pattern_orders):
            of_i, of_q, of_u = same(ZERO), same(ZERO), same(ZERO)
            for n in range(max(m, 2), series.pattern_degree + 1):
                c, e, b = start + n - m, n_harmonics + p, n_harmonics + n_patterns + p
                y, x, z = polar[k, c], even[k, p], odd[k, p]
                mean = g * read(ratio, (node, t, c)) + f * read(ratio, (node + 1, t, c))
                upright = g * read(ratio, (node, t, e)) + f * read(ratio, (node + 1, t, e))
                leaning = g * read(ratio, (node, t, b)) + f * read(ratio, (node + 1, t, b))
                of_b = read(matrix, (k, 0, n))
                of_even = of_b * mean + read(matrix, (k, 1, n)) * upright
                of_odd = read(matrix, (k, 2, n)) * leaning
                of_i += y * (of_b * upright)
                of_q += x * of_even + z * of_odd
                of_u += z * of_even + x * of_odd
                p += 1
            if nodes[1] <= t <= nodes[2]:
                write(fine_wave, (row, m), read(fine_wave, (row, m)) + of_i)
            write(fine_wave, (row, series.orders + m), of_q)
            write(fine_wave, (row, series.orders + series.pattern_orders + m), of_u)
            start += series.degree + 1 - m


@njit(cache=True, inline="always")
def wave_of_i(fine_wave, j, b0, b1, c, highest):
    """I over the mean, `Lanes`, at the azimuth of cosine c and b0, b1 of rows j and j + 1 of fine_wave."""
    wave = b0 * read(fine_wave, (j, 0)) + b1 * read(fine_wave, (j + 1, 0))
    before, here = ONE, c
    twice = TWO * c
    for m in range(1, highest + 1):
        y0, y1 = b0 * here, b1 * here
        wave += y0 * read(fine_wave, (j, m)) + y1 * read(fine_wave, (j + 1, m))
        before, here = here, twice * here - before
    return wave


@njit(cache=True, inline="always")
def waves_of_q_and_u(fine_wave, j, b0, b1, c, first, orders):
    """Q and U over the mean, `Lanes` each, as `wave_of_i`; amplitudes of Q begin at `first`, `orders` of each."""
    c = min(ONE, max(-ONE, c))
    sine = np.float32(math.sqrt(max(ZERO, ONE - c * c)))
    twice = TWO * c
    cos_m, cos_before = ONE, c
    sin_m, sin_before = ZERO, -sine
    q, u = same(ZERO), same(ZERO)
    for m in range(first, first + orders):
        q += cos_m * (b0 * read(fine_wave, (j, m)) + b1 * read(fine_wave, (j + 1, m)))
        u += sin_m * (b0 * read(fine_wave, (j, m + orders)) + b1 * read(fine_wave, (j + 1, m + orders)))
        cos_m, cos_before = twice * cos_m - cos_before, cos_m
        sin_m, sin_before = twice * sin_m - sin_before, sin_m
    return q, u


@njit(cache=True, nogil=True, fastmath={"contract", "nsz"})
def scatter(rays_first, point, turning, light, rule, series, ground_weight, ground_angle, n_polar, out, begin, end):
    """Stokes parameters out[node, polar, zenith, azimuth, I Q U, LANES] from the light of the order before.

    rays_first (R + 1,): where the points of each ray start, n_polar rays for each node altitude; point: `Points`;
    turning (N, T, F, 3): as in `Turning`; light: `Light`; rule: `Refinement`; series: `Series`
    ground_weight (R, LANES): transmittance to the ground, a Lambertian one; ground_angle (R,): its place in the turning
    table
    Node altitudes begin..end are computed.  The Stokes axis has one entry where series has no patterns.
    """
    n_zenith, n_azimuth = out.shape[2], out.shape[3]
    n_fine = rule.node.shape[0]
    fine_log = np.zeros((n_fine, out.shape[5]), np.float32)
    fine_wave = np.zeros((n_fine, series.orders + 2 * series.pattern_orders, out.shape[5]), np.float32)
    last = turning.shape[0] - 2
    for node in range(begin, end):
        for i in range(n_polar):
            ray = node * n_polar + i
            for k in range(rays_first[ray], rays_first[ray + 1]):
                slab(point, k, light, rule, series, 0, n_zenith - 1, fine_log, fine_wave)
                place = point.angle[k]
                step = min(int(place), last)
                h1 = place - np.float32(step)
                h0 = ONE - h1
                highest = point.highest[k]
                strength = read(point.weight, k)
                for t in range(n_zenith):
                    for a in range(n_azimuth):
                        x = h0 * turning[step, t, a, 0] + h1 * turning[step + 1, t, a, 0]
                        c = h0 * turning[step, t, a, 1] + h1 * turning[step + 1, t, a, 1]
                        j = min(int(x), n_fine - 2)
                        b1 = x - np.float32(j)
                        b0 = ONE - b1
                        mean = strength * exp(b0 * read(fine_log, j) + b1 * read(fine_log, j + 1))
                        wave = at_least(wave_of_i(fine_wave, j, b0, b1, c, highest), LEAST)
                        write(out, (node, i, t, a, 0), read(out, (node, i, t, a, 0)) + mean * wave)
                        if series.pattern_orders > 0:
                            q, u = waves_of_q_and_u(fine_wave, j, b0, b1, c, series.orders, series.pattern_orders)
                            write(out, (node, i, t, a, 1), read(out, (node, i, t, a, 1)) + mean * q)
                            write(out, (node, i, t, a, 2), read(out, (node, i, t, a, 2)) + mean * u)
            if ground_weight[ray].max() > ZERO:
                add_ground(turning, ground_angle[ray], light.log_ground, ground_weight, ray, out[node, i])


@njit(cache=True, nogil=True)
def add_ground(turning, place, log_ground, transmittance, ray, sums):
    """Light of the Lambertian ground at the end of a ray, unpolarised, added to sums (T, F, Stokes, LANES).

    transmittance (R, LANES): of all rays; place: in the turning table, as in `scatter`
    """
    step = min(int(place), turning.shape[0] - 2)
    h1 = place - np.float32(step)
    h0 = ONE - h1
    passed = read(transmittance, ray)
    for t in range(sums.shape[0]):
        for a in range(sums.shape[1]):
            x = h0 * turning[step, t, a, 0] + h1 * turning[step + 1, t, a, 0]
            j = min(int(x), log_ground.shape[0] - 2)
            b1 = x - np.float32(j)
            lit = exp((ONE - b1) * read(log_ground, j) + b1 * read(log_ground, j + 1))
            write(sums, (t, a, 0), read(sums, (t, a, 0)) + passed * lit)


@njit(cache=True, nogil=True, fastmath={"contract", "nsz"})
def moments_of(radiance, analysis, pattern_analysis, moments, begin, end):
    """Moments (Z, T, C + 2 C', LANES) of Stokes parameters (Z, M, T, F, Stokes, LANES), for altitudes begin..end.

    analysis (Z, C, M, F), pattern_analysis (Z, 2 C', 2, M, F): as in `Angles`.
    """
    n_polar, n_zenith, n_azimuth = radiance.shape[1:4]
    n_harmonics, n_patterns = analysis.shape[1], pattern_analysis.shape[1]
    for z in range(begin, end):
        for t in range(n_zenith):
            for c in range(n_harmonics):
                total = same(ZERO)
                for i in range(n_polar):
                    for a in range(n_azimuth):
                        total += analysis[z, c, i, a] * read(radiance, (z, i, t, a, 0))
                write(moments, (z, t, c), total)
            for c in range(n_patterns):
                total = same(ZERO)
                for i in range(n_polar):
                    for a in range(n_azimuth):
                        total += pattern_analysis[z, c, 0, i, a] * read(radiance, (z, i, t, a, 1))
                        total += pattern_analysis[z, c, 1, i, a] * read(radiance, (z, i, t, a, 2))
                write(moments, (z, t, n_harmonics + c), total)
