"""One order of scattering: Stokes parameters at every node in every direction from the light of the order before.

Along a ray the source of I is J = mean radiance x sum_lm Y_lm (chi_l r_lm + b_l e_lm), that of Q and U is as in
`polarised`, with the logarithm of the mean and the moments r, e, b relative to it interpolated between nodes: right
where the field falls by e within a degree.  The vertical plane through a ray is the same all along it, straight or bent
by refraction: Q and U add up as they are.

Arguments that the kernels share: point: `Points`, k: index of one of them; light: `Light`; rule: `Refinement`; series:
`Series`; turning (N, T, F, 3): as in `Turning`, place: of a point or of the end of a ray in it; transmittance (LANES,):
of a ray to its end.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from twilight.kernels import njit
from twilight.solvers.zones.paths import LANES

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
    below, above = light.ratio[node], light.ratio[node + 1]
    polar, chi = point.polar[k], point.chi[k]
    here, there = light.log_mean[node], light.log_mean[node + 1]
    n_nodes = here.shape[0]
    per_interval = rule.per_interval
    for t in range(low, high + 1):
        c = 0
        for m in range(series.orders):
            wave = fine_wave[t * per_interval, m]
            if m > highest:
                c += series.degree + 1 - m
                continue
            for w in range(LANES):
                wave[w] = ZERO
            for n in range(m, series.degree + 1):
                y0, y1 = g * polar[c], f * polar[c]
                r0, r1, x = below[t, c], above[t, c], chi[n]
                for w in range(LANES):
                    wave[w] += x[w] * (y0 * r0[w] + y1 * r1[w])
                c += 1
    if series.pattern_orders > 0:
        # a cubic between two nodes looks at the next ones too
        for t in range(max(0, low - 1), min(n_nodes, high + 2)):
            inside = low <= t <= high
            add_patterns(point, k, below[t], above[t], series, inside, fine_wave[t * per_interval])
        refine_patterns(rule, series, low * per_interval, high * per_interval, fine_wave)
    for t in range(low, high):
        base = t * per_interval
        for q in range(1, per_interval):
            b = np.float32(q) / np.float32(per_interval)
            a = ONE - b
            for m in range(highest + 1):
                u, v, out = fine_wave[base, m], fine_wave[base + per_interval, m], fine_wave[base + q, m]
                for w in range(LANES):
                    out[w] = a * u[w] + b * v[w]
    for t in range(low * per_interval, high * per_interval + 1):
        out = fine_log[t]
        for w in range(LANES):
            out[w] = ZERO
        for j in range(4):
            y0, y1 = g * rule.weight[t, j], f * rule.weight[t, j]
            r0, r1 = here[rule.node[t, j]], there[rule.node[t, j]]
            for w in range(LANES):
                out[w] += y0 * r0[w] + y1 * r1[w]


@njit(inner=True, cache=True)
def refine_patterns(rule, series, low, high, fine_wave):
    """Waves of Q and U between the nodes, by cubics: on the fine grid of solar zenith angles low..high.

    fine_wave (T', waves, LANES): filled there, as in `slab`.
    """
    for t in range(low, high + 1):
        if t % rule.per_interval == 0:
            continue
        for m in range(series.orders, fine_wave.shape[1]):
            out = fine_wave[t, m]
            for w in range(LANES):
                out[w] = ZERO
            for j in range(4):
                y = rule.weight[t, j]
                value = fine_wave[rule.node[t, j] * rule.per_interval, m]
                for w in range(LANES):
                    out[w] += y * value[w]


@njit(inner=True, cache=True)
def add_patterns(point, k, below, above, series, with_i, wave):
    """The source of Q and U, set in wave (waves, LANES), and what Q and U of the light give to I, added to it.

    below, above (C + 2 C', LANES): moments at the node altitudes around point k; with_i: is the wave of I wanted?
    """
    n_harmonics = below.shape[0] - 2 * point.even.shape[1]
    f = point.node_share[k]
    g = ONE - f
    matrix, polar = point.matrix[k], point.polar[k]
    even, odd = point.even[k], point.odd[k]
    n_patterns = even.size
    p = 0
    # where the harmonics of one order begin
    start = 0
    for m in range(series.pattern_orders):
        of_i, of_q, of_u = wave[m], wave[series.orders + m], wave[series.orders + series.pattern_orders + m]
        for w in range(LANES):
            of_q[w] = ZERO
            of_u[w] = ZERO
        for n in range(max(m, 2), series.pattern_degree + 1):
            c = start + n - m
            y, x, z = polar[c], even[p], odd[p]
            i0, i1 = below[c], above[c]
            e0, e1 = below[n_harmonics + p], above[n_harmonics + p]
            b0, b1 = below[n_harmonics + n_patterns + p], above[n_harmonics + n_patterns + p]
            of_b, of_even, of_odd = matrix[0, n], matrix[1, n], matrix[2, n]
            for w in range(LANES):
                e = g * e0[w] + f * e1[w]
                a = of_b[w] * (g * i0[w] + f * i1[w]) + of_even[w] * e
                b = of_odd[w] * (g * b0[w] + f * b1[w])
                if with_i:
                    of_i[w] += y * of_b[w] * e
                of_q[w] += x * a + z * b
                of_u[w] += z * a + x * b
            p += 1
        start += series.degree + 1 - m


@njit(cache=True, inline="always")
def add_waves(near, far, b0, b1, c, first, orders, scale, total):
    """Add Q and U of one point to total (3, LANES): scale (LANES,) x (b0 near + b1 far) at an azimuth.

    near, far (waves, LANES): amplitudes on the fine grid; those of Q begin at `first`, `orders` of each; (b0, b1):
    shares of the two; c: cosine of the azimuth from the sun.
    """
    c = min(ONE, max(-ONE, c))
    sine = np.float32(math.sqrt(max(ZERO, ONE - c * c)))
    cos_m, cos_before = ONE, c
    sin_m, sin_before = ZERO, -sine
    q, u = total[1], total[2]
    for m in range(orders):
        q0, q1, u0, u1 = near[first + m], far[first + m], near[first + orders + m], far[first + orders + m]
        y0, y1, z0, z1 = b0 * cos_m, b1 * cos_m, b0 * sin_m, b1 * sin_m
        for w in range(LANES):
            q[w] += scale[w] * (y0 * q0[w] + y1 * q1[w])
            u[w] += scale[w] * (z0 * u0[w] + z1 * u1[w])
        cos_m, cos_before = TWO * c * cos_m - cos_before, cos_m
        sin_m, sin_before = TWO * c * sin_m - sin_before, sin_m


@njit(cache=True, nogil=True, fastmath={"contract", "nsz"})
def scatter(rays_first, point, turning, light, rule, series, ground_weight, ground_angle, n_polar, out, begin, end):
    """Stokes parameters out[node, polar, zenith, azimuth, I Q U, LANES] from the light of the order before.

    rays_first (R + 1,): where the points of each ray start; n_polar: rays for each node altitude; ground_weight (R,
    LANES): transmittance to the ground, a Lambertian one; ground_angle (R,): its place in the turning table.  Node
    altitudes begin..end are computed.  The Stokes axis has one entry where series has no patterns.
    """
    n_zenith, n_azimuth = out.shape[2], out.shape[3]
    n_fine = rule.node.shape[0]
    fine_log = np.zeros((n_fine, LANES), np.float32)
    fine_wave = np.zeros((n_fine, series.orders + 2 * series.pattern_orders, LANES), np.float32)
    exponent = np.zeros(LANES, np.float32)
    wave = np.zeros(LANES, np.float32)
    last = turning.shape[0] - 2
    for node in range(begin, end):
        for i in range(n_polar):
            ray = node * n_polar + i
            sums = out[node, i]
            for k in range(rays_first[ray], rays_first[ray + 1]):
                slab(point, k, light, rule, series, 0, n_zenith - 1, fine_log, fine_wave)
                place = point.angle[k]
                step = min(int(place), last)
                h1 = place - np.float32(step)
                h0 = ONE - h1
                near, far = turning[step], turning[step + 1]
                highest = point.highest[k]
                strength = point.weight[k]
                for t in range(n_zenith):
                    for a in range(n_azimuth):
                        p, q = near[t, a], far[t, a]
                        x = h0 * p[0] + h1 * q[0]
                        c = h0 * p[1] + h1 * q[1]
                        j = min(int(x), n_fine - 2)
                        b1 = x - np.float32(j)
                        b0 = ONE - b1
                        u, v = fine_log[j], fine_log[j + 1]
                        for w in range(LANES):
                            exponent[w] = b0 * u[w] + b1 * v[w]
                        u2, v2 = fine_wave[j], fine_wave[j + 1]
                        for w in range(LANES):
                            wave[w] = b0 * u2[0, w] + b1 * v2[0, w]
                        before, here = ONE, c
                        for m in range(1, highest + 1):
                            y0, y1 = b0 * here, b1 * here
                            r0, r1 = u2[m], v2[m]
                            for w in range(LANES):
                                wave[w] += y0 * r0[w] + y1 * r1[w]
                            before, here = here, TWO * c * here - before
                        total = sums[t, a, 0]
                        if series.pattern_orders == 0:
                            for w in range(LANES):
                                total[w] += strength[w] * math.exp(exponent[w]) * max(LEAST, wave[w])
                        else:
                            for w in range(LANES):
                                exponent[w] = strength[w] * math.exp(exponent[w])
                                total[w] += exponent[w] * max(LEAST, wave[w])
                            add_waves(u2, v2, b0, b1, c, series.orders, series.pattern_orders, exponent, sums[t, a])
            if ground_weight[ray].max() > ZERO:
                add_ground(turning, ground_angle[ray], light.log_ground, ground_weight[ray], sums)


@njit(inner=True, cache=True, nogil=True)
def add_ground(turning, place, log_ground, transmittance, sums):
    """Light of the Lambertian ground at the end of a ray, unpolarised, added to sums (T, F, Stokes, LANES).

    log_ground (T', LANES): as in `Light`.
    """
    step = min(int(place), turning.shape[0] - 2)
    h1 = place - np.float32(step)
    h0 = ONE - h1
    for t in range(sums.shape[0]):
        for a in range(sums.shape[1]):
            x = h0 * turning[step, t, a, 0] + h1 * turning[step + 1, t, a, 0]
            j = min(int(x), log_ground.shape[0] - 2)
            b1 = x - np.float32(j)
            for w in range(LANES):
                sums[t, a, 0, w] += transmittance[w] * math.exp(
                    (ONE - b1) * log_ground[j, w] + b1 * log_ground[j + 1, w]
                )


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
            out = moments[z, t]
            for i in range(n_polar):
                for a in range(n_azimuth):
                    row = radiance[z, i, t, a]
                    for c in range(n_harmonics):
                        factor = analysis[z, c, i, a]
                        for w in range(LANES):
                            out[c, w] += factor * row[0, w]
                    for c in range(n_patterns):
                        of_q, of_u = pattern_analysis[z, c, 0, i, a], pattern_analysis[z, c, 1, i, a]
                        for w in range(LANES):
                            out[n_harmonics + c, w] += of_q * row[1, w] + of_u * row[2, w]
