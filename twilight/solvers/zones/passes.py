"""One order of scattering: the radiance at every node in every direction from the light of the order before.

Along a ray the source is J = mean radiance x sum_lm chi_l r_lm Y_lm, with the logarithm of the mean and the relative
moments r_lm interpolated between nodes: positive everywhere, and right where the field falls by e within a degree.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from twilight.solvers.zones.paths import LANES
from twilight.solvers.zones.sunlight import N_ANGLE

LEAST = np.float32(1e-3)
"""Least source relative to the mean: a truncated series may dip below 0."""
ZERO, ONE = np.float32(0.0), np.float32(1.0)


@njit(cache=True, inline="always")
def slab(point, k, log_mean, ratio, rule_node, rule_weight, per_interval, degree, low, high, fine_log, fine_wave):
    """The field at the altitude and in the polar angle of point k, over solar zenith angles low..high of the nodes.

    fine_log (T', LANES): logarithm of the mean on the fine grid; fine_wave (T', orders, LANES): amplitude of
    cos(m azimuth) relative to the mean.
    """
    node = point.node[k]
    f = point.node_share[k]
    g = ONE - f
    highest = point.highest[k]
    below, above = ratio[node], ratio[node + 1]
    polar, chi = point.polar[k], point.chi[k]
    here, there = log_mean[node], log_mean[node + 1]
    for t in range(low, high + 1):
        c = 0
        for m in range(fine_wave.shape[1]):
            wave = fine_wave[t * per_interval, m]
            if m > highest:
                c += degree + 1 - m
                continue
            for w in range(LANES):
                wave[w] = ZERO
            for n in range(m, degree + 1):
                y0, y1 = g * polar[c], f * polar[c]
                r0, r1, x = below[t, c], above[t, c], chi[n]
                for w in range(LANES):
                    wave[w] += x[w] * (y0 * r0[w] + y1 * r1[w])
                c += 1
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
            y0, y1 = g * rule_weight[t, j], f * rule_weight[t, j]
            r0, r1 = here[rule_node[t, j]], there[rule_node[t, j]]
            for w in range(LANES):
                out[w] += y0 * r0[w] + y1 * r1[w]


@njit(cache=True, nogil=True, fastmath={"contract", "nsz"})
def scatter(
    rays_first, point, turning, log_mean, ratio, log_ground, ground_weight, ground_angle, rule_node, rule_weight,
    per_interval, n_polar, degree, n_order, out, begin, end,
):  # fmt: skip
    """Radiance out[node, polar, zenith, azimuth, LANES] from the moments of the order before, for nodes begin..end.

    log_mean (Z', T, LANES), ratio (Z', T, C, LANES), log_ground (T', LANES): logarithm of the radiance of the ground on
    the fine grid.
    """
    n_zenith, n_azimuth = out.shape[2], out.shape[3]
    n_fine = rule_node.shape[0]
    fine_log = np.zeros((n_fine, LANES), np.float32)
    fine_wave = np.zeros((n_fine, n_order, LANES), np.float32)
    exponent = np.zeros(LANES, np.float32)
    series = np.zeros(LANES, np.float32)
    last = turning.shape[0] - 2
    for node in range(begin, end):
        for i in range(n_polar):
            ray = node * n_polar + i
            sums = out[node, i]
            for k in range(rays_first[ray], rays_first[ray + 1]):
                slab(
                    point,
                    k,
                    log_mean,
                    ratio,
                    rule_node,
                    rule_weight,
                    per_interval,
                    degree,
                    0,
                    n_zenith - 1,
                    fine_log,
                    fine_wave,
                )
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
                            series[w] = b0 * u2[0, w] + b1 * v2[0, w]
                        before, here = ONE, c
                        for m in range(1, highest + 1):
                            y0, y1 = b0 * here, b1 * here
                            r0, r1 = u2[m], v2[m]
                            for w in range(LANES):
                                series[w] += y0 * r0[w] + y1 * r1[w]
                            before, here = here, np.float32(2.0) * c * here - before
                        total = sums[t, a]
                        for w in range(LANES):
                            total[w] += strength[w] * math.exp(exponent[w]) * max(LEAST, series[w])
            if ground_weight[ray].max() > ZERO:
                add_ground(turning, ground_angle[ray], log_ground, ground_weight[ray], sums)


@njit(cache=True, nogil=True)
def add_ground(turning, place, log_ground, transmittance, sums):
    """Light of the ground at the end of a ray."""
    step = min(int(place), turning.shape[0] - 2)
    h1 = place - np.float32(step)
    h0 = ONE - h1
    for t in range(sums.shape[0]):
        for a in range(sums.shape[1]):
            x = h0 * turning[step, t, a, 0] + h1 * turning[step + 1, t, a, 0]
            j = min(int(x), log_ground.shape[0] - 2)
            b1 = x - np.float32(j)
            for w in range(LANES):
                sums[t, a, w] += transmittance[w] * math.exp((ONE - b1) * log_ground[j, w] + b1 * log_ground[j + 1, w])


@njit(cache=True, nogil=True, fastmath={"contract", "nsz"})
def scatter_sunlight(
    rays_first, point, turning, sun_row, sun_share, edge, log_light, log_ground_light, ground_edge, span, phase, cosine,
    ground_weight, ground_angle, ground_factor, n_polar, out, begin, end,
):  # fmt: skip
    """The first order: sunlight scattered once, out[node, polar, zenith, azimuth, LANES].

    sun_row (P,), sun_share (P,): place of a point between the altitudes of the sunlight table; edge: of the shadow
    phase (N, S, LANES): phase function of each species at cosines from -1 to 1
    cosine (node, polar, zenith, azimuth): of the scattering angle from the sun into each direction, a place in `phase`
    ground_factor (LANES,): albedo / pi
    """
    n_zenith, n_azimuth = out.shape[2], out.shape[3]
    n_species = point.share.shape[1]
    light = np.zeros((N_ANGLE + 1, LANES), np.float32)
    of_ray = np.zeros((n_zenith, n_azimuth, n_species, LANES), np.float32)
    exponent = np.zeros(LANES, np.float32)
    series = np.zeros(LANES, np.float32)
    last = turning.shape[0] - 2
    scale = np.float32(N_ANGLE / math.sqrt(span))
    for node in range(begin, end):
        for i in range(n_polar):
            ray = node * n_polar + i
            sums = out[node, i]
            for t in range(n_zenith):
                for a in range(n_azimuth):
                    x = cosine[node, i, t, a]
                    j = min(int(x), phase.shape[0] - 2)
                    b1 = x - np.float32(j)
                    for s in range(n_species):
                        for w in range(LANES):
                            of_ray[t, a, s, w] = (ONE - b1) * phase[j, s, w] + b1 * phase[j + 1, s, w]
            for k in range(rays_first[ray], rays_first[ray + 1]):
                row = sun_row[k]
                f = sun_share[k]
                g = ONE - f
                lower, upper = log_light[row], log_light[row + 1]
                for j in range(N_ANGLE + 1):
                    for w in range(LANES):
                        light[j, w] = g * lower[j, w] + f * upper[j, w]
                shadow = g * np.float32(edge[row]) + f * np.float32(edge[row + 1])
                place = point.angle[k]
                step = min(int(place), last)
                h1 = place - np.float32(step)
                h0 = ONE - h1
                near, far = turning[step], turning[step + 1]
                strength, share = point.weight[k], point.share[k]
                for t in range(n_zenith):
                    for a in range(n_azimuth):
                        inside = shadow - (h0 * near[t, a, 2] + h1 * far[t, a, 2])
                        if inside < ZERO:
                            continue
                        x = scale * math.sqrt(inside)
                        j = min(int(x), N_ANGLE - 1)
                        b1 = x - np.float32(j)
                        b0 = ONE - b1
                        u, v = light[j], light[j + 1]
                        for w in range(LANES):
                            exponent[w] = b0 * u[w] + b1 * v[w]
                            series[w] = ZERO
                        of_species = of_ray[t, a]
                        for s in range(n_species):
                            r0, r1 = share[s], of_species[s]
                            for w in range(LANES):
                                series[w] += r0[w] * r1[w]
                        total = sums[t, a]
                        for w in range(LANES):
                            total[w] += strength[w] * math.exp(exponent[w]) * series[w]
            if ground_weight[ray].max() > ZERO:
                place = ground_angle[ray]
                step = min(int(place), last)
                h1 = place - np.float32(step)
                for t in range(n_zenith):
                    for a in range(n_azimuth):
                        inside = np.float32(ground_edge) - (
                            (ONE - h1) * turning[step, t, a, 2] + h1 * turning[step + 1, t, a, 2]
                        )
                        if inside < ZERO:
                            continue
                        x = scale * math.sqrt(inside)
                        j = min(int(x), N_ANGLE - 1)
                        b1 = x - np.float32(j)
                        for w in range(LANES):
                            sums[t, a, w] += (
                                ground_weight[ray, w]
                                * ground_factor[w]
                                * math.exp((ONE - b1) * log_ground_light[j, w] + b1 * log_ground_light[j + 1, w])
                            )


@njit(cache=True, nogil=True, fastmath={"contract", "nsz"})
def moments_of(radiance, analysis, moments, begin, end):
    """Moments (Z, T, C, LANES) of a radiance (Z, M, T, F, LANES), for node altitudes begin..end."""
    n_polar, n_zenith, n_azimuth = radiance.shape[1:4]
    for z in range(begin, end):
        for t in range(n_zenith):
            out = moments[z, t]
            for i in range(n_polar):
                for a in range(n_azimuth):
                    row = radiance[z, i, t, a]
                    for c in range(out.shape[0]):
                        factor = analysis[z, c, i, a]
                        for w in range(LANES):
                            out[c, w] += factor * row[w]
