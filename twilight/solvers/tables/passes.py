"""The passes of Algorithm 4.1: T, single scattering, J, E and S, each over all texels.

A texel of S is a ray; its points are the same for every sun.  Sums over incident light go through spherical harmonics
about the local vertical: with L_lm those of the light at a point and chi_l the moments of a phase function,

    J(v) = sum_l sigma chi_l (2 l + 1)/(4 pi) sum_m (2 - delta_m0) P_lm(mu) cos(m phi) L_lm,

which is the integral of the phase function times the light for all directions at once.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from twilight.geometry import altitude_along
from twilight.solvers.tables.lookup import irradiance, optical_depth_to_top, scattering, sunlight
from twilight.solvers.tables.mapping import (
    distance_to_ground_km,
    distance_to_top_km,
    horizon_km,
    possible_nu,
    texel_height_km,
    view_cosine,
)
from twilight.solvers.tables.steps import GAUSS_HIGH, GAUSS_LOW, MAX_STEPS, march, step_transmission

MAX_POINTS = 2 * (MAX_STEPS + 2)


@njit(cache=True)
def ray_depth(profile, jumps, altitude_km, mu, fineness, stop_km, out):
    """Optical depth (W,) from altitude_km along a straight ray up to stop_km, or to its end; into out."""
    edges = np.empty(MAX_STEPS + 2)
    depth = np.empty(out.size)
    levels = np.empty(2, np.int64)
    fractions = np.empty(2)
    out[:] = 0.0
    n, _ = march(profile, jumps, altitude_km, mu, fineness, edges)
    radius = profile.earth_radius_km
    for k in range(n):
        begin, end = edges[k], min(edges[k + 1], stop_km)
        if end <= begin:
            break
        z_low = altitude_along(altitude_km, mu, begin + GAUSS_LOW * (end - begin), radius)
        z_high = altitude_along(altitude_km, mu, begin + GAUSS_HIGH * (end - begin), radius)
        step_transmission(profile, z_low, z_high, end - begin, levels, fractions, depth)
        for w in range(out.size):
            out[w] += depth[w]


@njit(cache=True, nogil=True)
def fill_depth(profile, jumps, mapping, depth, begin, end):
    """-ln T (r, mu, W) at the texels of T, for those of r from begin to end."""
    far = horizon_km(mapping, mapping.thickness_km)
    bottom = profile.altitude_km[0]
    for i in range(begin, end):
        height = texel_height_km(mapping, i, mapping.n_t_r)
        rho = horizon_km(mapping, height)
        r = mapping.bottom_km + height
        least = mapping.thickness_km - height
        for j in range(mapping.n_t_mu):
            d = least + (rho + far - least) * j / (mapping.n_t_mu - 1)
            mu = (far * far - rho * rho - d * d) / (2.0 * r * d) if d > 1e-9 else 1.0
            # one that grazes the ground stays above it
            mu = max(-rho / r * (1.0 - 1e-12), min(1.0, mu))
            ray_depth(profile, jumps, bottom + height, mu, 2.0, 1e300, depth[i, j])


@njit(cache=True)
def ray_points(profile, jumps, altitude_km, mu, fineness, distance, altitude, weight, levels, fractions):
    """Quadrature points of a ray: distance, altitude (P,), weight (P, W) with the transmittance to them, and the levels
    and fractions between them; returns their number."""
    n_w = weight.shape[1]
    edges = np.empty(MAX_STEPS + 2)
    depth = np.empty(n_w)
    passed = np.zeros(n_w)
    two_levels = np.empty(2, np.int64)
    two_fractions = np.empty(2)
    n, _ = march(profile, jumps, altitude_km, mu, fineness, edges)
    radius = profile.earth_radius_km
    count = 0
    for k in range(n):
        length = edges[k + 1] - edges[k]
        s_low = edges[k] + GAUSS_LOW * length
        s_high = edges[k] + GAUSS_HIGH * length
        z_low = altitude_along(altitude_km, mu, s_low, radius)
        z_high = altitude_along(altitude_km, mu, s_high, radius)
        step_transmission(profile, z_low, z_high, length, two_levels, two_fractions, depth)
        for g in range(2):
            part = GAUSS_LOW if g == 0 else GAUSS_HIGH
            distance[count] = s_low if g == 0 else s_high
            altitude[count] = z_low if g == 0 else z_high
            levels[count], fractions[count] = two_levels[g], two_fractions[g]
            for w in range(n_w):
                weight[count, w] = 0.5 * length * math.exp(-passed[w] - part * depth[w])
            count += 1
        for w in range(n_w):
            passed[w] += depth[w]
    return count


@njit(cache=True, nogil=True)
def fill_single(profile, jumps, mapping, depth, heights, view, sun, nus, fineness, out, begin, end):
    """Light scattered once (1 + K, r, mu_s, nu, mu, W), without its phase function, by air and by each aerosol."""
    n_species, n_w = out.shape[0], out.shape[5]
    bottom = profile.altitude_km[0]
    distance, altitude = np.empty(MAX_POINTS), np.empty(MAX_POINTS)
    weight = np.empty((MAX_POINTS, n_w))
    source = np.empty((MAX_POINTS, n_species, n_w))
    levels, fractions = np.empty(MAX_POINTS, np.int64), np.empty(MAX_POINTS)
    light = np.empty(n_w)
    total = np.empty((n_species, n_w))
    for i in range(begin, end):
        r = mapping.bottom_km + heights[i]
        for m in range(mapping.n_mu):
            mu = view[i, m]
            n = ray_points(
                profile, jumps, bottom + heights[i], mu, fineness, distance, altitude, weight, levels, fractions
            )
            for p in range(n):
                low, f = levels[p], fractions[p]
                for s in range(n_species):
                    for w in range(n_w):
                        sigma = profile.species_scattering[s, low, w] * (1.0 - f)
                        sigma += profile.species_scattering[s, low + 1, w] * f
                        source[p, s, w] = weight[p, w] * sigma
            for j in range(mapping.n_mu_s):
                for k in range(mapping.n_nu):
                    nu = possible_nu(mu, sun[j], nus[k])
                    total[:] = 0.0
                    for p in range(n):
                        height = altitude[p] - bottom
                        mu_s = (r * sun[j] + distance[p] * nu) / (mapping.bottom_km + height)
                        if sunlight(mapping, depth, height, mu_s, light):
                            for s in range(n_species):
                                for w in range(n_w):
                                    total[s, w] += source[p, s, w] * light[w]
                    for s in range(n_species):
                        for w in range(n_w):
                            out[s, i, j, k, m, w] = total[s, w]


@njit(cache=True)
def incident(mapping, tables, logarithmic, moments, cosines, light, height, mu, mu_s, nu, ground, scratch):
    """Radiance (W,) of light that comes to a point, into light: one table as it is, or single scattering by species.

    moments (1 + K, degree + 1, W): of the phase functions that singly scattered light is multiplied with; an empty one
    says that the table holds radiance.  cosines (degree + 1,): scratch.
    """
    if moments.shape[1] == 0:
        scattering(mapping, tables[0], logarithmic, height, mu, mu_s, nu, ground, light)
        return
    degree = moments.shape[1] - 1
    cosines[0] = 1.0
    cosines[1] = nu
    for n in range(1, degree):
        cosines[n + 1] = ((2 * n + 1) * nu * cosines[n] - n * cosines[n - 1]) / (n + 1)
    light[:] = 0.0
    for s in range(tables.shape[0]):
        scattering(mapping, tables[s], logarithmic, height, mu, mu_s, nu, ground, scratch)
        for w in range(light.size):
            phase = 0.0
            for n in range(degree + 1):
                phase += (2 * n + 1) / (4.0 * math.pi) * moments[s, n, w] * cosines[n]
            light[w] += phase * scratch[w]


@njit(cache=True, nogil=True)
def fill_source(
    profile, jumps, mapping, depth, tables, logarithmic, single_moments, moments, sky_irradiance, direct, albedo,
    heights, view, sun, nus, polar, node_mu, node_weight, azimuth, view_polar, orders, sigma, out, begin, end,
):  # fmt: skip
    """J (r, mu_s, nu, mu, W) from the last order: all species, and the ground lit by it.

    moments (1 + K, degree + 1, W): of the phase functions; sigma (r, 1 + K, W): scattering coefficients
    polar (r, Q, C), view_polar (r, mu, C): P_lm at the quadrature's cosines node_mu (r, Q) and at the texels; orders
    (2, C): l and m; azimuth (A,): midpoints over half a turn; direct: the ground is lit by the sun too
    """
    n_w = out.shape[4]
    n_coefficient = orders.shape[1]
    degree = moments.shape[1] - 1
    bottom = profile.altitude_km[0]
    light, scratch, tau, sunlit = np.empty(n_w), np.empty(n_w), np.empty(n_w), np.empty(n_w)
    cosines = np.empty(max(2, single_moments.shape[1]))
    wave = np.empty((degree + 1, n_w))
    harmonic = np.empty((n_coefficient, n_w))
    gain = np.empty((degree + 1, n_w))
    turn = math.pi / azimuth.size * 2.0
    for i in range(begin, end):
        r = mapping.bottom_km + heights[i]
        for n in range(degree + 1):
            for w in range(n_w):
                gain[n, w] = 0.0
                for s in range(moments.shape[0]):
                    gain[n, w] += (2 * n + 1) / (4.0 * math.pi) * sigma[i, s, w] * moments[s, n, w]
        for j in range(mapping.n_mu_s):
            mu_s = sun[j]
            harmonic[:] = 0.0
            for q in range(node_mu.shape[1]):
                mu = node_mu[i, q]
                ground = 2 * q < node_mu.shape[1]
                far = distance_to_ground_km(mapping, heights[i], mu) if ground else 0.0
                if ground:
                    ray_depth(profile, jumps, bottom + heights[i], mu, 1.0, 1e300, tau)
                wave[:] = 0.0
                for p in range(azimuth.size):
                    c = math.cos(azimuth[p])
                    nu = mu * mu_s + c * math.sqrt(max(0.0, (1.0 - mu * mu) * (1.0 - mu_s * mu_s)))
                    incident(
                        mapping, tables, logarithmic, single_moments, cosines, light, heights[i], mu, mu_s, nu, ground,
                        scratch,
                    )  # fmt: skip
                    if ground:
                        mu_g = min(1.0, max(-1.0, (r * mu_s + far * nu) / mapping.bottom_km))
                        irradiance(mapping, sky_irradiance, 0.0, mu_g, scratch)
                        if direct and sunlight(mapping, depth, 0.0, mu_g, sunlit):
                            for w in range(n_w):
                                scratch[w] += sunlit[w] * mu_g
                        for w in range(n_w):
                            light[w] += math.exp(-tau[w]) * albedo[w] / math.pi * scratch[w]
                    before, here = 1.0, c
                    for n in range(degree + 1):
                        for w in range(n_w):
                            wave[n, w] += before * light[w]
                        before, here = here, 2.0 * c * here - before
                for e in range(n_coefficient):
                    factor = turn * node_weight[i, q] * polar[i, q, e]
                    for w in range(n_w):
                        harmonic[e, w] += factor * wave[orders[1, e], w]
            for m in range(mapping.n_mu):
                wave[:] = 0.0
                for e in range(n_coefficient):
                    factor = view_polar[i, m, e] * (1.0 if orders[1, e] == 0 else 2.0)
                    for w in range(n_w):
                        wave[orders[1, e], w] += factor * gain[orders[0, e], w] * harmonic[e, w]
                mu = view[i, m]
                across = math.sqrt(max(0.0, (1.0 - mu * mu) * (1.0 - mu_s * mu_s)))
                for k in range(mapping.n_nu):
                    nu = possible_nu(mu, mu_s, nus[k])
                    c = min(1.0, max(-1.0, (nu - mu * mu_s) / across)) if across > 1e-12 else 1.0
                    light[:] = 0.0
                    before, here = 1.0, c
                    for n in range(degree + 1):
                        for w in range(n_w):
                            light[w] += before * wave[n, w]
                        before, here = here, 2.0 * c * here - before
                    for w in range(n_w):
                        out[i, j, k, m, w] = max(0.0, light[w])


@njit(cache=True, nogil=True)
def fill_irradiance(
    mapping, tables, logarithmic, single_moments, node_mu, node_weight, azimuth, out, begin, end
):  # fmt: skip
    """E (r, mu_s, W) of the last order of light from the sky; node_mu, node_weight (Q,): over the upper hemisphere."""
    n_w = out.shape[2]
    light, scratch = np.empty(n_w), np.empty(n_w)
    cosines = np.empty(max(2, single_moments.shape[1]))
    turn = math.pi / azimuth.size * 2.0
    for i in range(begin, end):
        height = mapping.thickness_km * i / (mapping.n_e_r - 1)
        for j in range(mapping.n_e_mu_s):
            mu_s = 2.0 * j / (mapping.n_e_mu_s - 1) - 1.0
            for q in range(node_mu.size):
                mu = node_mu[q]
                for p in range(azimuth.size):
                    nu = mu * mu_s + math.cos(azimuth[p]) * math.sqrt((1.0 - mu * mu) * max(0.0, 1.0 - mu_s * mu_s))
                    incident(
                        mapping, tables, logarithmic, single_moments, cosines, light, height, mu, mu_s, nu, False,
                        scratch,
                    )  # fmt: skip
                    for w in range(n_w):
                        out[i, j, w] += turn * node_weight[q] * mu * light[w]


@njit(cache=True, nogil=True)
def fill_scattering(
    profile, jumps, mapping, source, logarithmic, heights, view, sun, nus, fineness, out, begin, end
):  # fmt: skip
    """S (r, mu_s, nu, mu, W): the line integral of J, interpolated between its texels."""
    n_w = out.shape[4]
    bottom = profile.altitude_km[0]
    distance, altitude = np.empty(MAX_POINTS), np.empty(MAX_POINTS)
    weight = np.empty((MAX_POINTS, n_w))
    levels, fractions = np.empty(MAX_POINTS, np.int64), np.empty(MAX_POINTS)
    light, total = np.empty(n_w), np.empty(n_w)
    for i in range(begin, end):
        r = mapping.bottom_km + heights[i]
        for m in range(mapping.n_mu):
            mu = view[i, m]
            ground = view_cosine(mapping, heights[i], m)[1]
            n = ray_points(
                profile, jumps, bottom + heights[i], mu, fineness, distance, altitude, weight, levels, fractions
            )
            for j in range(mapping.n_mu_s):
                for k in range(mapping.n_nu):
                    nu = possible_nu(mu, sun[j], nus[k])
                    total[:] = 0.0
                    for p in range(n):
                        height = altitude[p] - bottom
                        there = mapping.bottom_km + height
                        mu_p = min(1.0, max(-1.0, (r * mu + distance[p]) / there))
                        mu_s = min(1.0, max(-1.0, (r * sun[j] + distance[p] * nu) / there))
                        scattering(mapping, source, logarithmic, height, mu_p, mu_s, nu, ground, light)
                        for w in range(n_w):
                            total[w] += weight[p, w] * light[w]
                    for w in range(n_w):
                        out[i, j, k, m, w] = total[w]


@njit(cache=True, nogil=True)
def read(mapping, table, logarithmic, height, mu, mu_s, nu, ground, out, begin, end):
    """S (D, W) of one table at heights, cosines and halves (D,)."""
    for d in range(begin, end):
        scattering(mapping, table, logarithmic, height[d], mu[d], mu_s[d], nu[d], ground[d], out[d])


@njit(cache=True)
def depths(profile, jumps, altitude_km, mu, stop_km, fineness, out):
    """Optical depths (D, W) along rays (D,) up to stop_km (D,) or their ends."""
    for d in range(mu.size):
        ray_depth(profile, jumps, altitude_km[d], mu[d], fineness, stop_km[d], out[d])


__all__ = [
    "depths", "distance_to_top_km", "fill_depth", "fill_irradiance", "fill_scattering", "fill_single", "fill_source",
    "optical_depth_to_top", "read",
]  # fmt: skip
