"""Exact values behind the table of the direct sun beam: one kernel per table.

See :mod:`twilight.transport.beam` for what the tables mean and how they are looked up.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from twilight.transport.rays import (
    OUTSIDE,
    TRAPPED,
    altitude_along,
    lowest_point,
    outward,
    refractivity_at,
    sun_ray,
)

_SMALLEST_WIDENING = 0.05
"""Bound on d(true zenith angle)/d(apparent): below it rays cross (a mirage), which the table does not follow."""


@njit(cache=True)
def up_slope(profile, w, altitude_km, u_km):
    """d(bending)/d(apparent zenith angle) of a ray that comes from above, by a difference over 0.001 of the radius."""
    x = (profile.radius_km + altitude_km) * (1.0 + refractivity_at(profile, w, altitude_km))
    h = 1e-3 * x
    p = math.sqrt(max(0.0, x * x - u_km * u_km))
    if u_km > 0.9 * x:  # near the zenith the bending is proportional to the tangent
        bending, _, _, _, _ = outward(profile, w, altitude_km, u_km, 1e9)
        return bending * x * x / (p * u_km) if p > 1e-6 * x else up_slope(profile, w, altitude_km, 0.9999 * x)
    if u_km >= h:
        a, _, _, _, ok_a = outward(profile, w, altitude_km, u_km - h, 1e9)
        b, _, _, _, ok_b = outward(profile, w, altitude_km, u_km + h, 1e9)
        slope = (b - a) / (2.0 * h)
        if ok_a and ok_b:
            return -p * slope
    a, _, _, _, ok_a = outward(profile, w, altitude_km, u_km, 1e9)
    b, _, _, _, ok_b = outward(profile, w, altitude_km, u_km + h, 1e9)
    c, _, _, _, _ = outward(profile, w, altitude_km, u_km + 2.0 * h, 1e9)
    if not (ok_a and ok_b):
        return 0.0
    return -p * (-3.0 * a + 4.0 * b - c) / (2.0 * h)


@njit(cache=True)
def full_bending(profile, w, lowest_km):
    """Invariant p [km] and bending [rad] of the whole ray whose lowest point is at `lowest_km`, and whether it is free."""
    p = (profile.radius_km + lowest_km) * (1.0 + refractivity_at(profile, w, lowest_km))
    bending, _, _, _, ok = outward(profile, w, lowest_km, 0.0, 1e9)
    return p, 2.0 * bending, ok


@njit(cache=True)
def limb_table(profile, w, lowest_km, window_km, invariant, bending, slope, free):
    """For rays by their lowest point (Y,): invariant, bending of the whole ray, its derivative by p [rad km^-1], free."""
    n = lowest_km.size
    for m in range(n):
        invariant[m], bending[m], free[m] = full_bending(profile, w, lowest_km[m])
        p_a, a, ok_a = full_bending(profile, w, lowest_km[m] - window_km)
        p_b, b, ok_b = full_bending(profile, w, lowest_km[m] + window_km)
        slope[m] = (b - a) / (p_b - p_a) if ok_a and ok_b and p_b > p_a else np.nan
    for m in range(n):  # next to a duct: the slope of the nearest ray below, then above
        if math.isnan(slope[m]):
            slope[m] = slope[m - 1] if m > 0 and not math.isnan(slope[m - 1]) else 0.0


@njit(cache=True)
def interpolate(x, xs, ys):
    """Piecewise linear, constant outside."""
    n = xs.size
    if x <= xs[0]:
        return ys[0]
    if x >= xs[n - 1]:
        return ys[n - 1]
    lo = 0
    hi = n - 1
    while hi - lo > 1:
        mid = (lo + hi) // 2
        if xs[mid] <= x:
            lo = mid
        else:
            hi = mid
    return ys[lo] + (ys[hi] - ys[lo]) * (x - xs[lo]) / (xs[hi] - xs[lo])


@njit(cache=True)
def log_irradiance(profile, w, altitude_km, chi, apparent, widening, up_widening, lowest_km, slope, spreading):
    """Logarithm of (irradiance at normal incidence)/F0 at a point, for the true zenith angle `chi` of the sun.

    `apparent` is a guess of the apparent zenith angle, `widening` of d(chi)/d(apparent): two Newton steps follow.
    irradiance = T n^2 sin(i)/sin(chi) / (d chi/d i): the flux F0 p dp of the annulus of invariants p..p+dp spread over
    r^2 sin(chi) d chi cos(i), with p = n r sin i.  `up_widening` is d(chi)/d(i) of the part of the air above the point.
    Returns also whether the ray is free.
    """
    n = 1.0 + refractivity_at(profile, w, altitude_km)
    x = (profile.radius_km + altitude_km) * n
    tau = 0.0
    status = OUTSIDE
    for k in range(3):
        bending, tau, status = sun_ray(profile, w, altitude_km, x * math.cos(apparent), True)
        if status == TRAPPED:
            return 0.0, False
        residual = apparent + bending - chi
        if k == 2 or abs(residual) < 1e-9:
            break
        apparent -= residual / widening
        apparent = max(0.0, apparent)
    if not spreading:
        return -tau, True
    u = x * math.cos(apparent)
    ratio = 1.0 / up_widening
    if math.sin(chi) > 1e-7:
        ratio = math.sin(apparent) / math.sin(chi)
    if u < 0.0:
        lowest, _ = lowest_point(profile, w, altitude_km, -u, True)
        d = up_widening + interpolate(lowest, lowest_km, slope) * u
    else:
        d = up_widening
    return -tau + math.log(max(1e-300, n * n * ratio / max(_SMALLEST_WIDENING, d))), True


@njit(cache=True)
def log_irradiance_from_above(profile, reference, altitude_km, u_km, scale, lowest_km, slope, spreading, out):
    """`log_irradiance` at every wavelength for the direction that is apparent at n r cos i = `u_km` >= 0 at `reference`.

    `scale` (W,): n-1 relative to that of the reference.  Returns (bending, d bending/d i, free) at the reference.
    """
    x = (profile.radius_km + altitude_km) * (1.0 + refractivity_at(profile, reference, altitude_km))
    apparent = math.atan2(math.sqrt(max(0.0, (x - u_km) * (x + u_km))), u_km)
    bending, _, _, _, ok = outward(profile, reference, altitude_km, u_km, 1e9)
    if not ok:
        return 0.0, 0.0, False
    beta = up_slope(profile, reference, altitude_km, u_km)
    chi = apparent + bending
    for w in range(scale.size):
        beta_w = beta * scale[w]
        guess = apparent + bending * (1.0 - scale[w])
        out[w], ok_w = log_irradiance(
            profile, w, altitude_km, chi, guess, 1.0 + beta_w, 1.0 + beta_w, lowest_km, slope[w], spreading
        )
        if not ok_w:
            out[w] = np.nan
    return bending, beta, True


@njit(cache=True)
def up_table(profile, reference, altitudes, cosines, scale, lowest_km, slope, spreading, log_up, bending, beta):
    """Tables over (altitude J, apparent cosine C): log irradiance (J, C, W), bending and its slope at the reference."""
    n_c = cosines.size
    for j in range(altitudes.size):
        x = (profile.radius_km + altitudes[j]) * (1.0 + refractivity_at(profile, reference, altitudes[j]))
        for m in range(n_c - 1, -1, -1):
            bending[j, m], beta[j, m], ok = log_irradiance_from_above(
                profile, reference, altitudes[j], x * cosines[m], scale, lowest_km, slope, spreading, log_up[j, m]
            )
            for w in range(scale.size):
                if (not ok or math.isnan(log_up[j, m, w])) and m < n_c - 1:
                    log_up[j, m, w] = log_up[j, m + 1, w]
            if not ok and m < n_c - 1:
                bending[j, m] = bending[j, m + 1]
                beta[j, m] = beta[j, m + 1]


@njit(cache=True)
def down_table(profile, reference, lowest_km, distances, scale, slope, spreading, far, log_down, edge):
    """Table over (lowest point Y, u = distance from it D): log irradiance + that of the mirrored ray + log(1 + u/far).

    edge (D, W): invariant of the reference ray at which wavelength w begins to graze the ground, found linearly.
    """
    n_w = scale.size
    mirror = np.empty(n_w)
    for m in range(lowest_km.size):
        p, whole, free = full_bending(profile, reference, lowest_km[m])
        for d in range(distances.size):
            u = distances[d]
            if not free:
                for w in range(n_w):
                    log_down[m, d, w] = log_down[m - 1, d, w] if m > 0 else 0.0
                continue
            z = altitude_along(profile, reference, lowest_km[m], u)
            up, beta, _ = log_irradiance_from_above(
                profile, reference, z, u, scale, lowest_km, slope, spreading, mirror
            )
            apparent = math.atan2(p, -u)
            bending = whole - up
            chi = apparent + bending
            d_up = 1.0 + beta
            for w in range(n_w):
                beta_w = beta * scale[w]
                widening = max(0.2, 1.0 + beta_w - slope[w, m] * u)
                guess = apparent + bending * (1.0 - scale[w])
                value, ok = log_irradiance(
                    profile, w, z, chi, guess, widening, 1.0 + beta_w, lowest_km, slope[w], spreading
                )
                if not ok or math.isnan(mirror[w]):
                    log_down[m, d, w] = log_down[m - 1, d, w] if m > 0 else 0.0
                else:
                    log_down[m, d, w] = value + mirror[w] + math.log1p(u / far)
                if m == 0:
                    # p_w changes with chi like cos(i) n r / widening; the reference p like its own
                    n_ref = 1.0 + refractivity_at(profile, reference, z)
                    n_w_here = 1.0 + refractivity_at(profile, w, z)
                    r = profile.radius_km + z
                    ground = profile.radius_km + lowest_km[0]
                    p_graze = ground * (1.0 + refractivity_at(profile, w, lowest_km[0]))
                    i_graze = math.pi - math.asin(min(1.0, p_graze / (r * n_w_here)))
                    _, whole_w, _ = full_bending(profile, w, lowest_km[0])
                    up_w, _, _, _, _ = outward(profile, w, z, -r * n_w_here * math.cos(i_graze), 1e9)
                    chi_graze = i_graze + whole_w - up_w
                    own = max(0.2, d_up - slope[reference, m] * u)
                    i_ref = apparent - (chi - chi_graze) / own
                    edge[d, w] = r * n_ref * math.sin(i_ref) if u > 0.0 else p


@njit(cache=True)
def edge_table(profile, reference, altitudes, lowest_free_km, edge_chi, edge_cos):
    """True zenith angle [rad] of the edge of the shadow and the apparent cosine there, at each altitude."""
    p0 = (profile.radius_km + lowest_free_km) * (1.0 + refractivity_at(profile, reference, lowest_free_km))
    for j in range(altitudes.size):
        x = (profile.radius_km + altitudes[j]) * (1.0 + refractivity_at(profile, reference, altitudes[j]))
        u = -math.sqrt(max(0.0, (x - p0) * (x + p0)))
        bending, _, status = sun_ray(profile, reference, altitudes[j], u, True)
        if status != OUTSIDE or x < p0:
            lo = 0.0
            hi = x
            for _ in range(60):
                mid = 0.5 * (lo + hi)
                _, _, status = sun_ray(profile, reference, altitudes[j], mid, True)
                if status == OUTSIDE:
                    hi = mid
                else:
                    lo = mid
            u = hi
            bending, _, _ = sun_ray(profile, reference, altitudes[j], u, True)
        edge_chi[j] = math.acos(max(-1.0, min(1.0, u / x))) + bending
        edge_cos[j] = u / x


@njit(cache=True)
def guess_table(profile, reference, altitudes, depths, edge_chi, edge_cos, lowest_km, slope, guess):
    """guess (J, G, 2): bending and d(bending)/d(apparent) at true zenith angles edge - depth * edge, exact to 1e-6."""
    for j in range(altitudes.size):
        x = (profile.radius_km + altitudes[j]) * (1.0 + refractivity_at(profile, reference, altitudes[j]))
        apparent = math.acos(max(-1.0, min(1.0, edge_cos[j])))
        bending = edge_chi[j] - apparent
        derivative = 0.0
        for g in range(depths.size):
            chi = edge_chi[j] * (1.0 - depths[g])
            for _ in range(4):
                u = x * math.cos(apparent)
                value, _, status = sun_ray(profile, reference, altitudes[j], u, True)
                if status == OUTSIDE:
                    bending = value
                    derivative = up_slope(profile, reference, altitudes[j], abs(u))
                    if u < 0.0:
                        lowest, _ = lowest_point(profile, reference, altitudes[j], -u, True)
                        derivative += interpolate(lowest, lowest_km, slope) * u
                residual = apparent + bending - chi
                if abs(residual) < 1e-7:
                    break
                apparent = max(0.0, apparent - residual / max(0.2, 1.0 + derivative))
            guess[j, g, 0] = bending
            guess[j, g, 1] = max(-0.8, derivative)
