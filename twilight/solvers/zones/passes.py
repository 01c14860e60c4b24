"""One order of scattering: Stokes parameters at every node in every direction from the light of the order before.

Along a ray the source of I is J = mean radiance x sum_lm Y_lm (chi_l r_lm + b_l e_lm), that of Q and U is as in
`polarised`, with the logarithm of the mean and the moments r, e, b relative to it interpolated between nodes: right
where the field falls by e within a degree.  The vertical plane through a ray is the same all along it, straight or bent
by refraction: Q and U add up as they are.

Arguments that the kernels share: point: `Points`, k: index of one of them; light: `Light`; rule: `Refinement`; series:
`Series`; source: `Source`, room; turning (N, T, F, 3): as in `Turning`; waves (T', waves, LANES): amplitudes, as
`Source.wave`; c: cosine of the azimuth from the sun.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from twilight.kernels import njit
from twilight.lanes import LANES, at_least, exp, read, same, write

LEAST = np.float32(1e-3)
"""Least source of I relative to the mean: a truncated series may dip below 0."""
ZERO, ONE, TWO = np.float32(0.0), np.float32(1.0), np.float32(2.0)
_FIRST = np.int64(0)
"""No literal, for which numba would compile `add_patterns` once more."""


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


class Source(NamedTuple):
    """Room for the source along one slab of air, what light there is scattered into one polar angle.

    log_mean (T', LANES): logarithm of the mean radiance on the fine grid of solar zenith angles; wave (T', waves,
    LANES): amplitudes relative to the mean, of cos(m azimuth) in I for every order, then of cos(m azimuth) in Q and of
    sin(m azimuth) in U.  by_harmonic (C, LANES), by_pattern (C', 7, LANES): what a moment of the light gives to them.
    """

    log_mean: np.ndarray
    wave: np.ndarray
    by_harmonic: np.ndarray
    by_pattern: np.ndarray


@njit(cache=True, inline="always")
def slab(point, k, light, rule, series, low, high, source):
    """Fill the `Source` at the altitude and in the polar angle of point k, over nodes low..high of the solar zenith
    angle."""
    node = point.node[k]
    f = point.node_share[k]
    g = ONE - f
    highest = point.highest[k]
    log_mean, ratio, wave = light.log_mean, light.ratio, source.wave
    by_harmonic = source.by_harmonic
    per_interval = rule.per_interval
    c = 0
    for m in range(series.orders):
        for n in range(m, series.degree + 1):
            write(by_harmonic, c, point.polar[k, c] * read(point.chi, (k, n)))
            c += 1
    for t in range(low, high + 1):
        c = 0
        for m in range(min(highest + 1, series.orders)):
            total = same(ZERO)
            for _ in range(m, series.degree + 1):
                here = g * read(ratio, (node, t, c)) + f * read(ratio, (node + 1, t, c))
                total += read(by_harmonic, c) * here
                c += 1
            write(wave, (t * per_interval, m), total)
    if series.pattern_orders > 0:
        # a cubic between two nodes looks at the next ones too
        nodes = (max(0, low - 1), low, high, min(log_mean.shape[1], high + 2))
        add_patterns(point, k, ratio, series, nodes, per_interval, source.by_pattern, wave)
        refine_patterns(rule, series.orders, low * per_interval, high * per_interval, wave)
    for t in range(low, high):
        base = t * per_interval
        for q in range(1, per_interval):
            b = np.float32(q) / np.float32(per_interval)
            a = ONE - b
            for m in range(highest + 1):
                between = a * read(wave, (base, m)) + b * read(wave, (base + per_interval, m))
                write(wave, (base + q, m), between)
    for t in range(low * per_interval, high * per_interval + 1):
        lower, upper = same(ZERO), same(ZERO)
        for j in range(4):
            at, y = rule.node[t, j], rule.weight[t, j]
            lower += y * read(log_mean, (node, at))
            upper += y * read(log_mean, (node + 1, at))
        write(source.log_mean, t, g * lower + f * upper)


@njit(inner=True, cache=True)
def refine_patterns(rule, first, low, high, wave):
    """Waves (T', waves, LANES) of Q and U, `first` and beyond, between the nodes, by cubics: on the fine grid of solar
    zenith angles low..high.

    wave (T', waves, LANES): filled between the nodes.
    """
    n = rule.per_interval
    for t in range(low, high + 1):
        if t % n == 0:
            continue
        j0, j1, j2, j3 = rule.node[t, 0] * n, rule.node[t, 1] * n, rule.node[t, 2] * n, rule.node[t, 3] * n
        y0, y1, y2, y3 = rule.weight[t, 0], rule.weight[t, 1], rule.weight[t, 2], rule.weight[t, 3]
        for m in range(first, wave.shape[1]):
            near = y1 * read(wave, (j1, m)) + y2 * read(wave, (j2, m))
            write(wave, (t, m), near + (y0 * read(wave, (j0, m)) + y3 * read(wave, (j3, m))))


@njit(inner=True, cache=True)
def add_patterns(point, k, ratio, series, nodes, per_interval, by_pattern, wave):
    """The source of Q and U at nodes of the solar zenith angle, set in their rows of wave (T', waves, LANES), and what
    Q and U of the light give to I, added to it.

    ratio (Z', T, C + 2 C', LANES): moments, as in `Light`; nodes: first, first and last with I wanted, end;
    per_interval: as in `Refinement`; by_pattern (C', 7, LANES): room.
    """
    even, odd, polar, matrix = point.even, point.odd, point.polar, point.matrix
    n_patterns = even.shape[1]
    n_harmonics = ratio.shape[2] - 2 * n_patterns
    node = point.node[k]
    f = point.node_share[k]
    g = ONE - f
    p = 0
    # where the harmonics of one order begin
    start = 0
    for m in range(series.pattern_orders):
        for n in range(max(m, 2), series.pattern_degree + 1):
            y, x, z = polar[k, start + n - m], even[k, p], odd[k, p]
            of_b, of_even, of_odd = read(matrix, (k, 0, n)), read(matrix, (k, 1, n)), read(matrix, (k, 2, n))
            write(by_pattern, (p, 0), y * of_b)
            write(by_pattern, (p, 1), x * of_b)
            write(by_pattern, (p, 2), x * of_even)
            write(by_pattern, (p, 3), z * of_odd)
            write(by_pattern, (p, 4), z * of_b)
            write(by_pattern, (p, 5), z * of_even)
            write(by_pattern, (p, 6), x * of_odd)
            p += 1
        start += series.degree + 1 - m
    for t in range(nodes[0], nodes[3]):
        row = t * per_interval
        p = start = 0
        for m in range(series.pattern_orders):
            of_i, of_q, of_u = same(ZERO), same(ZERO), same(ZERO)
            c = start + max(m, 2) - m
            for _ in range(max(m, 2), series.pattern_degree + 1):
                e, b = n_harmonics + p, n_harmonics + n_patterns + p
                mean = g * read(ratio, (node, t, c)) + f * read(ratio, (node + 1, t, c))
                upright = g * read(ratio, (node, t, e)) + f * read(ratio, (node + 1, t, e))
                leaning = g * read(ratio, (node, t, b)) + f * read(ratio, (node + 1, t, b))
                of_i += read(by_pattern, (p, 0)) * upright
                of_q += read(by_pattern, (p, 1)) * mean
                of_u += read(by_pattern, (p, 4)) * mean
                of_q += read(by_pattern, (p, 2)) * upright
                of_u += read(by_pattern, (p, 5)) * upright
                of_q += read(by_pattern, (p, 3)) * leaning
                of_u += read(by_pattern, (p, 6)) * leaning
                c += 1
                p += 1
            if nodes[1] <= t <= nodes[2]:
                write(wave, (row, m), read(wave, (row, m)) + of_i)
            write(wave, (row, series.orders + m), of_q)
            write(wave, (row, series.orders + series.pattern_orders + m), of_u)
            start += series.degree + 1 - m


@njit(cache=True, inline="always")
def source_room(point, light, rule, series):
    """An empty `Source`."""
    n_fine, n_patterns = rule.node.shape[0], point.even.shape[1]
    return Source(
        np.zeros((n_fine, LANES), np.float32),
        np.zeros((n_fine, series.orders + 2 * series.pattern_orders, LANES), np.float32),
        np.zeros((light.ratio.shape[2] - 2 * n_patterns, LANES), np.float32),
        np.zeros((n_patterns, 7, LANES), np.float32),
    )


@njit(cache=True, inline="always")
def wave_of_i(waves, j, b0, b1, c, highest):
    """I over the mean, `Lanes`, at an azimuth.

    j: row of waves, (b0, b1): shares of it and of the next; highest: largest order that counts.
    """
    wave = b0 * read(waves, (j, 0)) + b1 * read(waves, (j + 1, 0))
    before, here = ONE, c
    twice = TWO * c
    for m in range(1, highest + 1):
        y0, y1 = b0 * here, b1 * here
        wave += y0 * read(waves, (j, m)) + y1 * read(waves, (j + 1, m))
        before, here = here, twice * here - before
    return wave


@njit(cache=True, inline="always")
def waves_of_q_and_u(waves, j, b0, b1, c, first, orders):
    """Q and U over the mean, `Lanes` each; amplitudes of Q begin at `first`, `orders` of each.

    j, b0, b1: as in `wave_of_i`.
    """
    c = min(ONE, max(-ONE, c))
    sine = np.float32(math.sqrt(max(ZERO, ONE - c * c)))
    twice = TWO * c
    cos_m, cos_before = ONE, c
    sin_m, sin_before = ZERO, -sine
    q, u = same(ZERO), same(ZERO)
    for m in range(first, first + orders):
        q += cos_m * (b0 * read(waves, (j, m)) + b1 * read(waves, (j + 1, m)))
        u += sin_m * (b0 * read(waves, (j, m + orders)) + b1 * read(waves, (j + 1, m + orders)))
        cos_m, cos_before = twice * cos_m - cos_before, cos_m
        sin_m, sin_before = twice * sin_m - sin_before, sin_m
    return q, u


@njit(cache=True, nogil=True, fastmath={"contract", "nsz"})
def scatter(rays_first, point, turning, light, rule, series, ground_weight, ground_angle, n_polar, out, begin, end):
    """Stokes parameters out[node, polar, zenith, azimuth, I Q U, LANES] from the light of the order before.

    rays_first (R + 1,): where the points of each ray start; n_polar: rays for each node altitude; ground_weight (R,
    LANES): transmittance to the ground, a Lambertian one; ground_angle (R,): its place in the turning table.  Node
    altitudes begin..end are computed.  The Stokes axis has one entry where series has no patterns.
    """
    n_zenith, n_azimuth = out.shape[2], out.shape[3]
    n_fine = rule.node.shape[0]
    source = source_room(point, light, rule, series)
    log_mean, waves = source.log_mean, source.wave
    last = turning.shape[0] - 2
    for node in range(begin, end):
        for i in range(n_polar):
            ray = node * n_polar + i
            for k in range(rays_first[ray], rays_first[ray + 1]):
                slab(point, k, light, rule, series, _FIRST, n_zenith - 1, source)
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
                        mean = strength * exp(b0 * read(log_mean, j) + b1 * read(log_mean, j + 1))
                        wave = at_least(wave_of_i(waves, j, b0, b1, c, highest), LEAST)
                        write(out, (node, i, t, a, 0), read(out, (node, i, t, a, 0)) + mean * wave)
                        if series.pattern_orders > 0:
                            q, u = waves_of_q_and_u(waves, j, b0, b1, c, series.orders, series.pattern_orders)
                            write(out, (node, i, t, a, 1), read(out, (node, i, t, a, 1)) + mean * q)
                            write(out, (node, i, t, a, 2), read(out, (node, i, t, a, 2)) + mean * u)
            if ground_weight[ray].max() > ZERO:
                add_ground(turning, ground_angle[ray], light.log_ground, ground_weight, ray, out[node, i])


@njit(inner=True, cache=True, nogil=True)
def add_ground(turning, place, log_ground, transmittance, ray, sums):
    """Light of the Lambertian ground at the end of a ray, unpolarised, added to sums (T, F, Stokes, LANES).

    transmittance (R, LANES): of all rays; place: in the turning table, as in `scatter`; log_ground (T', LANES): as in
    `Light`.
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
    """Moments (Z, T, C + 2 C', LANES), added to, of Stokes parameters, for altitudes begin..end.

    radiance (Z, M, T, F, Stokes, LANES); moments (Z, T, C + 2 C', LANES); analysis (Z, C, M, F), pattern_analysis (Z, 2
    C', 2, M, F): as in `Angles`.
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
