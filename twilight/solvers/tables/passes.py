"""The assignments of Algorithm 4.1 (`algorithm`), one kernel each: T, DS, DJ, DE and DS, over all texels.

Eq. 5, 7, 11 and 15 of Bruneton and Neyret 2008.  A texel of S is a ray; its points are the same for every sun.  Sums
over incident light go through spherical harmonics about the local vertical: with L_lm those of the light at a point and
chi_l the moments of a phase function,

    J(v) = sum_l sigma chi_l (2 l + 1)/(4 pi) sum_m (2 - delta_m0) P_lm(mu) cos(m phi) L_lm,

which is the integral of the phase function times the light for all directions at once.

Arguments that the kernels share: profile: `transport.profile.Profile`; mapping: `Mapping`; depth (r, mu, W): -ln T as
`fill_depth` makes it; screen: of `transport.ray_profile.screen_table`; height, height_km [km]: above the ground; mu,
mu_s, nu: cosines of Algorithm 4.1, of the view's zenith angle, the sun's and the angle between them; ground: whether a
view ends there; fineness: density of the steps along a ray; out: filled for the r begin..end.
"""

import math
from typing import NamedTuple

import numpy as np

from twilight.jit.kernels import njit
from twilight.solvers.tables.mapping import (
    distance_to_ground_km,
    distance_to_top_km,
    horizon_km,
    irradiance,
    possible_nu,
    scattering,
    sunlight,
    texel_height_km,
    view_cosine,
)
from twilight.transport.lines import ALTITUDE, DISTANCE, new_line, per_scattering, trace_line, weight_by_species
from twilight.transport.steps import chord_depth, distance_to_sphere

CLEAR_KM = 1e-7
"""How far above or below the ground the lowest point of a ray along the horizon is put."""


class Texels(NamedTuple):
    """Coordinates of the texels of S: heights (r,) [km] above the ground; view (r, mu): mu; sun (mu_s,); nus (nu,)."""

    heights: np.ndarray
    view: np.ndarray
    sun: np.ndarray
    nus: np.ndarray


class Incoming(NamedTuple):
    """Light of the last order: tables (N, r, mu_s, nu, mu, W), of which logarithms may be stored.

    moments (1 + K, degree + 1, W): of the phase functions that light scattered once is multiplied with, N = 1 + K;
    (1, 0, W) where the one table holds radiance.
    """

    tables: np.ndarray
    logarithmic: bool
    moments: np.ndarray


class Scatterers(NamedTuple):
    """moments (1 + K, degree + 1, W) of the phase functions; sigma (r, 1 + K, W): scattering coefficients [km^-1]."""

    moments: np.ndarray
    sigma: np.ndarray


class LitGround(NamedTuple):
    """albedo (W,); sky (r, mu_s, W): irradiance by the sky in the last order; direct: the sun lights it too."""

    albedo: np.ndarray
    sky: np.ndarray
    direct: bool


class SphereQuadrature(NamedTuple):
    """Quadrature over all directions at every height, and harmonics there.

    mu, weight (r, Q); azimuth (A,) [rad]: midpoints over half a turn; polar (r, Q, C), view_polar (r, mu, C): P_lm at
    these mu and at those of the views; orders (2, C): l and m.
    """

    mu: np.ndarray
    weight: np.ndarray
    azimuth: np.ndarray
    polar: np.ndarray
    view_polar: np.ndarray
    orders: np.ndarray


@njit(inner=True, cache=True)
def off_horizon(mapping, height_km, mu, ground):
    """mu of a ray that ends on the ground, or passes above it, as `ground` says: rounding does not decide."""
    rho = horizon_km(mapping, height_km)
    change = 2.0 * mapping.bottom_km * CLEAR_KM
    edge = math.sqrt(max(0.0, rho * rho + change if ground else rho * rho - change)) / (mapping.bottom_km + height_km)
    return min(mu, -edge) if ground else max(mu, -edge)


@njit(cache=True, nogil=True)
def depths(profile, mapping, height_km, mu, ground, length_km, out):
    """Optical depths (D, W) of rays (D,) up to length_km (D,), or to their ends where that is infinite."""
    for d in range(mu.size):
        up = off_horizon(mapping, height_km[d], mu[d], ground[d])
        length = length_km[d]
        if math.isinf(length):
            if ground[d]:
                length = distance_to_ground_km(mapping, height_km[d], up)
            else:
                length = distance_to_top_km(mapping, height_km[d], up)
        chord_depth(profile, profile.altitude_km[0] + height_km[d], up, length, out[d])


@njit(cache=True, nogil=True)
def fill_depth(profile, mapping, depth, begin, end):
    """T <- transmittance to the top (eq. 5): -ln T (r, mu, W) at the texels of T, for those of r from begin to end."""
    far = horizon_km(mapping, mapping.thickness_km)
    for i in range(begin, end):
        height = texel_height_km(mapping, i, mapping.n_t_r)
        rho = horizon_km(mapping, height)
        r = mapping.bottom_km + height
        least = mapping.thickness_km - height
        for j in range(mapping.n_t_mu):
            d = least + (rho + far - least) * j / (mapping.n_t_mu - 1)
            mu = min(1.0, (far * far - rho * rho - d * d) / (2.0 * r * d)) if d > 1e-9 else 1.0
            mu = off_horizon(mapping, height, mu, False)
            z = profile.altitude_km[0] + height
            length = distance_to_sphere(z, mu, profile.stop_km[profile.stop_km.size - 1], profile.earth_radius_km)
            chord_depth(profile, z, mu, length, depth[i, j])


@njit(inner=True, cache=True)
def trace_view(profile, mapping, height_km, mu, ground, fineness, line):
    """Both points of every step along a view into `line`, which carry light scattered there; returns their number."""
    up = off_horizon(mapping, height_km, mu, ground)
    return trace_line(profile, profile.altitude_km[0] + height_km, up, fineness, np.bool_(True), line, math.inf)[0]


@njit(cache=True, nogil=True)
def fill_single(profile, mapping, depth, screen, texels, fineness, out, begin, end):
    """DS <- S[L0] (eq. 11): light scattered once (1 + K, r, mu_s, nu, mu, W), by air and by each aerosol, without phase
    functions.

    texels: `Texels`.
    """
    heights, view, sun, nus = texels
    n_species, n_w = out.shape[0], out.shape[5]
    bottom = profile.altitude_km[0]
    line = new_line(profile)
    source = np.empty((line.place.shape[0], n_species, n_w))
    light = np.empty(n_w)
    total = np.empty((n_species, n_w))
    for i in range(begin, end):
        r = mapping.bottom_km + heights[i]
        for m in range(mapping.n_mu):
            mu = view[i, m]
            n = trace_view(profile, mapping, heights[i], mu, 2 * m < mapping.n_mu, fineness, line)
            for p in range(n):
                weight_by_species(profile, line.place[p, ALTITUDE], line.weight[p], source[p])
            for j in range(mapping.n_mu_s):
                for k in range(mapping.n_nu):
                    nu = possible_nu(mu, sun[j], nus[k])
                    total[:] = 0.0
                    for p in range(n):
                        height = line.place[p, ALTITUDE] - bottom
                        mu_s = (r * sun[j] + line.place[p, DISTANCE] * nu) / (mapping.bottom_km + height)
                        if sunlight(mapping, depth, screen, height, mu_s, light):
                            for s in range(n_species):
                                for w in range(n_w):
                                    total[s, w] += source[p, s, w] * light[w]
                    for s in range(n_species):
                        for w in range(n_w):
                            out[s, i, j, k, m, w] = total[s, w]


@njit(inner=True, cache=True)
def incident(mapping, incoming, cosines, light, height, mu, mu_s, nu, ground, scratch):
    """Radiance (W,) of light that comes to a point, into light: one table as it is, or single scattering by species.

    incoming: `Incoming`; cosines (degree + 1,), scratch (W,): work space.
    """
    tables, logarithmic, moments = incoming
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
def fill_source(profile, mapping, depth, screen, incoming, scatterers, lit_ground, texels, directions, out, begin, end):
    """DJ <- J[T a/pi DE + DS] (eq. 7): J (r, mu_s, nu, mu, W) of the last order, with the ground that it lights.

    incoming: `Incoming`; scatterers: `Scatterers`; lit_ground: `LitGround`; texels: `Texels`; directions:
    `SphereQuadrature`.
    """
    moments, sigma = scatterers
    albedo, sky_irradiance, direct = lit_ground
    heights, view, sun, nus = texels
    node_mu, node_weight, azimuth, polar, view_polar, orders = directions
    n_w = out.shape[4]
    n_coefficient = orders.shape[1]
    degree = moments.shape[1] - 1
    bottom = profile.altitude_km[0]
    light, scratch, tau, sunlit = np.empty(n_w), np.empty(n_w), np.empty(n_w), np.empty(n_w)
    cosines = np.empty(max(2, incoming.moments.shape[1]))
    amplitude = np.empty((degree + 1, n_w))
    harmonic = np.empty((n_coefficient, n_w))
    gain = np.empty((degree + 1, n_w))
    azimuth_weight = math.pi / azimuth.size * 2.0
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
                    chord_depth(profile, bottom + heights[i], mu, far, tau)
                amplitude[:] = 0.0
                for p in range(azimuth.size):
                    c = math.cos(azimuth[p])
                    nu = mu * mu_s + c * math.sqrt(max(0.0, (1.0 - mu * mu) * (1.0 - mu_s * mu_s)))
                    incident(mapping, incoming, cosines, light, heights[i], mu, mu_s, nu, ground, scratch)
                    if ground:
                        mu_g = min(1.0, max(-1.0, (r * mu_s + far * nu) / mapping.bottom_km))
                        irradiance(mapping, sky_irradiance, 0.0, mu_g, scratch)
                        if direct and sunlight(mapping, depth, screen, 0.0, mu_g, sunlit):
                            for w in range(n_w):
                                scratch[w] += sunlit[w] * mu_g
                        for w in range(n_w):
                            light[w] += math.exp(-tau[w]) * albedo[w] / math.pi * scratch[w]
                    before, current = 1.0, c
                    for n in range(degree + 1):
                        for w in range(n_w):
                            amplitude[n, w] += before * light[w]
                        before, current = current, 2.0 * c * current - before
                for e in range(n_coefficient):
                    factor = azimuth_weight * node_weight[i, q] * polar[i, q, e]
                    for w in range(n_w):
                        harmonic[e, w] += factor * amplitude[orders[1, e], w]
            for m in range(mapping.n_mu):
                amplitude[:] = 0.0
                for e in range(n_coefficient):
                    factor = view_polar[i, m, e] * (1.0 if orders[1, e] == 0 else 2.0)
                    for w in range(n_w):
                        amplitude[orders[1, e], w] += factor * gain[orders[0, e], w] * harmonic[e, w]
                mu = view[i, m]
                across = math.sqrt(max(0.0, (1.0 - mu * mu) * (1.0 - mu_s * mu_s)))
                for k in range(mapping.n_nu):
                    nu = possible_nu(mu, mu_s, nus[k])
                    c = min(1.0, max(-1.0, (nu - mu * mu_s) / across)) if across > 1e-12 else 1.0
                    light[:] = 0.0
                    before, current = 1.0, c
                    for n in range(degree + 1):
                        for w in range(n_w):
                            light[w] += before * amplitude[n, w]
                        before, current = current, 2.0 * c * current - before
                    for w in range(n_w):
                        out[i, j, k, m, w] = max(0.0, light[w])


@njit(cache=True, nogil=True)
def fill_irradiance(mapping, incoming, node_mu, node_weight, azimuth, out, begin, end):
    """DE <- E[DS] (eq. 15): E (r, mu_s, W) of the last order of light from the sky.

    incoming: `Incoming`; node_mu, node_weight (Q,): over the upper hemisphere; azimuth (A,) [rad]: over half a turn.
    """
    n_w = out.shape[2]
    light, scratch = np.empty(n_w), np.empty(n_w)
    cosines = np.empty(max(2, incoming.moments.shape[1]))
    azimuth_weight = math.pi / azimuth.size * 2.0
    for i in range(begin, end):
        height = mapping.thickness_km * i / (mapping.n_e_r - 1)
        for j in range(mapping.n_e_mu_s):
            mu_s = 2.0 * j / (mapping.n_e_mu_s - 1) - 1.0
            for q in range(node_mu.size):
                mu = node_mu[q]
                for p in range(azimuth.size):
                    nu = mu * mu_s + math.cos(azimuth[p]) * math.sqrt((1.0 - mu * mu) * max(0.0, 1.0 - mu_s * mu_s))
                    incident(mapping, incoming, cosines, light, height, mu, mu_s, nu, False, scratch)
                    for w in range(n_w):
                        out[i, j, w] += azimuth_weight * node_weight[q] * mu * light[w]


@njit(cache=True, nogil=True)
def fill_scattering(profile, mapping, source, logarithmic, texels, fineness, out, begin, end):
    """DS <- integral of T DJ (eq. 11): S (r, mu_s, nu, mu, W), J interpolated between its texels.

    source (r, mu_s, nu, mu, W): J, or, where logarithmic, ln J; texels: `Texels`.
    """
    heights, view, sun, nus = texels
    n_w = out.shape[4]
    bottom = profile.altitude_km[0]
    line = new_line(profile)
    weight = np.empty(line.weight.shape)
    light, total = np.empty(n_w), np.empty(n_w)
    for i in range(begin, end):
        r = mapping.bottom_km + heights[i]
        for m in range(mapping.n_mu):
            mu = view[i, m]
            ground = view_cosine(mapping, heights[i], m)[1]
            n = trace_view(profile, mapping, heights[i], mu, ground, fineness, line)
            for p in range(n):
                per_scattering(profile, line.place[p, ALTITUDE], line.weight[p], weight[p])
            for j in range(mapping.n_mu_s):
                for k in range(mapping.n_nu):
                    nu = possible_nu(mu, sun[j], nus[k])
                    total[:] = 0.0
                    for p in range(n):
                        height = line.place[p, ALTITUDE] - bottom
                        there = mapping.bottom_km + height
                        mu_p = min(1.0, max(-1.0, (r * mu + line.place[p, DISTANCE]) / there))
                        mu_s = min(1.0, max(-1.0, (r * sun[j] + line.place[p, DISTANCE] * nu) / there))
                        scattering(mapping, source, logarithmic, height, mu_p, mu_s, nu, ground, light)
                        for w in range(n_w):
                            total[w] += weight[p, w] * light[w]
                    for w in range(n_w):
                        out[i, j, k, m, w] = total[w]


@njit(cache=True, nogil=True)
def read(mapping, table, logarithmic, height, mu, mu_s, nu, ground, out, begin, end):
    """S out (D, W) of one table at height (D,) [km], cosines mu, mu_s, nu (D,) and halves ground (D,).

    table (r, mu_s, nu, mu, W); logarithmic: whether it holds logarithms.
    """
    for d in range(begin, end):
        scattering(mapping, table, logarithmic, height[d], mu[d], mu_s[d], nu[d], ground[d], out[d])
