"""Exact values behind the table of the direct sun beam: one kernel per table.

See :mod:`twilight.transport.beam` for what the tables mean and how they are looked up.

Arguments that the kernels share: profile: `RayProfile`; w: index of the wavelength, reference: of the one whose rays
the coordinates follow; altitude_km: of the point; u_km: n r cos i of the ray there; chi, apparent [rad]: true and
apparent zenith angle of the sun; widening: d(chi)/d(apparent); spreading: whether the refracted beam thins out; scale
(W,): refractivity over the reference's; altitudes (J,) [km]; cosines (C,): apparent; distances (D,) [km]: u of the
reference ray; lowest_km (Y,): lowest points of rays, invariant (Y,) [km]: their n r there, slope (Y,) [km^-1]:
derivative of the whole bending by it; edge_chi (J,) [rad], edge_cos (J,): true zenith angle and apparent cosine of the
shadow's edge; alike (W,): the first wavelength of the same refractive index, whose rays each shares (terms of one
wavelength differ in what a gas absorbs); edges: of `beam_edges.Edges.flat`, and n_edges: how many pieces it holds.
"""

from __future__ import annotations

import math

import numpy as np

from twilight.jit.kernels import njit
from twilight.transport.beam_edges import N_EDGE_RECORD, edge_depth
from twilight.transport.ray_profile import refractivity_at
from twilight.transport.rays import FAR_KM, OUTSIDE, TRAPPED, altitude_along, lowest_point, outward, sun_ray

_SMALLEST_WIDENING = 0.05
"""Bound on d(true zenith angle)/d(apparent): below it rays cross (a mirage), which the table does not follow."""
_FIRST = np.int64(0)
"""No literal, for which numba would compile `log_irradiance_from_above` once more."""


@njit(inner=True, cache=True)
def up_slope(profile, w, altitude_km, u_km):
    """d(bending)/d(apparent zenith angle) of a ray that comes from above, by a difference over 0.001 of the radius."""
    x = (profile.radius_km + altitude_km) * (1.0 + refractivity_at(profile, w, altitude_km))
    h = 1e-3 * x
    p = math.sqrt(max(0.0, x * x - u_km * u_km))
    if u_km > 0.9 * x:  # near the zenith the bending is proportional to the tangent
        bending, _, _, _, _ = outward(profile, w, altitude_km, u_km, FAR_KM)
        return bending * x * x / (p * u_km) if p > 1e-6 * x else up_slope(profile, w, altitude_km, 0.9999 * x)
    if u_km >= h:
        a, _, _, _, ok_a = outward(profile, w, altitude_km, u_km - h, FAR_KM)
        b, _, _, _, ok_b = outward(profile, w, altitude_km, u_km + h, FAR_KM)
        slope = (b - a) / (2.0 * h)
        if ok_a and ok_b:
            return -p * slope
    a, _, _, _, ok_a = outward(profile, w, altitude_km, u_km, FAR_KM)
    b, _, _, _, ok_b = outward(profile, w, altitude_km, u_km + h, FAR_KM)
    c, _, _, _, _ = outward(profile, w, altitude_km, u_km + 2.0 * h, FAR_KM)
    if not (ok_a and ok_b):
        return 0.0
    return -p * (-3.0 * a + 4.0 * b - c) / (2.0 * h)


@njit(cache=True)
def full_bending(profile, w, lowest_km):
    """Invariant p [km] and bending [rad] of the whole ray with its lowest point at `lowest_km`, and if it is free."""
    p = (profile.radius_km + lowest_km) * (1.0 + refractivity_at(profile, w, lowest_km))
    bending, _, _, _, ok = outward(profile, w, lowest_km, 0.0, FAR_KM)
    return p, 2.0 * bending, ok


@njit(cache=True)
def limb_table(profile, w, lowest_km, below_km, above_km, invariant, bending, slope, free):
    """For rays by their lowest point (Y,): invariant, bending of the whole ray, its derivative by p [km^-1], free.

    The derivative is the mean over lowest points from `below_km` to `above_km`, (Y,) each.  invariant (Y,) [km],
    bending (Y,) [rad], slope (Y,) [km^-1], free (Y,): filled; free: whether the ray leaves the air.
    """
    n = lowest_km.size
    for m in range(n):
        invariant[m], bending[m], free[m] = full_bending(profile, w, lowest_km[m])
        p_a, a, ok_a = full_bending(profile, w, below_km[m])
        p_b, b, ok_b = full_bending(profile, w, above_km[m])
        slope[m] = (b - a) / (p_b - p_a) if ok_a and ok_b and p_b > p_a else np.nan
    for m in range(n):  # next to a duct: the slope of the nearest ray below, then above
        if math.isnan(slope[m]):
            slope[m] = slope[m - 1] if m > 0 and not math.isnan(slope[m - 1]) else 0.0


@njit(cache=True)
def interpolate(x, xs, ys):
    """Piecewise linear through the points (xs, ys) (N,), at x, constant outside.

    x, xs: in one unit, xs ascending.
    """
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
    width = xs[hi] - xs[lo]
    return ys[lo] + (ys[hi] - ys[lo]) * (x - xs[lo]) / width if width > 0.0 else ys[lo]


@njit(inner=True, cache=True)
def _own_angle(profile, w, altitude_km, chi, apparent, widening):
    """Apparent zenith angle of the sun at a point from a guess `apparent` of it, by a Newton step, and whether the ray
    is free; widening = d(chi)/d(i)."""
    x = (profile.radius_km + altitude_km) * (1.0 + refractivity_at(profile, w, altitude_km))
    bending, _, _, _, ok = outward(profile, w, altitude_km, max(0.0, x * math.cos(apparent)), FAR_KM)
    if not ok:
        return apparent, False
    residual = min(0.5 * math.pi, apparent) + bending - chi
    if apparent <= 0.5 * math.pi:
        apparent = max(0.0, apparent - residual / widening)
    return apparent, True


@njit(inner=True, cache=True)
def _log_irradiance(profile, w, altitude_km, chi, apparent, widening, spreading):
    """Logarithm of (irradiance at normal incidence)/F0 at a point, for a ray that comes from above.

    irradiance = T n^2 sin(i)/sin(chi) / (d chi/d i): the flux F0 p dp of the annulus of invariants p..p+dp spread over
    r^2 sin(chi) d chi cos(i), with p = n r sin i.  chi is the true zenith angle of the sun, `apparent` the apparent
    one, widening = d(chi)/d(i).  Where the ray comes from a little below the horizontal, because another wavelength
    sees the sun there exactly, T is continued linearly from above: what lies below is not part of this table.  Not a
    number where the ray is not free.
    """
    n = 1.0 + refractivity_at(profile, w, altitude_km)
    u = (profile.radius_km + altitude_km) * n * math.cos(apparent)
    _, tau, _, _, ok = outward(profile, w, altitude_km, abs(u), FAR_KM)
    if not ok:
        return np.nan
    if u < 0.0:
        _, level, _, _, ok = outward(profile, w, altitude_km, 0.0, FAR_KM)
        if not ok:
            return np.nan
        tau = 2.0 * level - tau
    if not spreading:
        return -tau
    ratio = math.sin(apparent) / math.sin(chi) if math.sin(chi) > 1e-7 else 1.0 / widening
    return -tau + math.log(max(1e-300, n * n * ratio / max(_SMALLEST_WIDENING, widening)))


@njit(inner=True, cache=True)
def log_irradiance_from_above(profile, reference, altitude_km, u_km, scale, spreading, alike, out, own, first):
    """`_log_irradiance` at every wavelength for the direction that `reference` sees at n r cos i = `u_km` >= 0.

    out (W,): filled; own (W,) [rad]: filled, apparent zenith angle of the sun at each wavelength; first: index in the
    profile of the first wavelength of `scale`, `alike` and `out`.  Returns (bending, d bending/d i, free, true zenith
    angle of the sun) at the reference.
    """
    x = (profile.radius_km + altitude_km) * (1.0 + refractivity_at(profile, reference, altitude_km))
    apparent = math.atan2(math.sqrt(max(0.0, (x - u_km) * (x + u_km))), u_km)
    bending, _, _, _, ok = outward(profile, reference, altitude_km, u_km, FAR_KM)
    if not ok:
        return 0.0, 0.0, False, 0.0
    beta = up_slope(profile, reference, altitude_km, u_km)
    chi = apparent + bending
    for w in range(scale.size):
        widening = 1.0 + beta * scale[w]
        if alike[w] < w:
            own[w], free = own[alike[w]], not math.isnan(out[alike[w]])
        else:
            guess = apparent + bending * (1.0 - scale[w])
            own[w], free = _own_angle(profile, first + w, altitude_km, chi, guess, widening)
        out[w] = np.nan
        if free:
            out[w] = _log_irradiance(profile, first + w, altitude_km, chi, own[w], widening, spreading)
    return bending, beta, True, chi


@njit(inner=True, cache=True)
def _edges_from_above(edges, n_edges, first, n_w, altitude_km, xx, u_km):
    """`edge_depth` as `log_irradiance` sees it: for a ray from below the horizontal continued linearly from above.

    first: place of the first coefficient of the wavelength; n_w: their number; xx [km^2]: (n r)^2 at the point.
    """
    depth = edge_depth(edges, n_edges, 0, first, n_w, altitude_km, xx, abs(u_km))
    if u_km < 0.0:
        depth = 2.0 * edge_depth(edges, n_edges, 0, first, n_w, altitude_km, xx, 0.0) - depth
    return depth


@njit(cache=True)
def up_table(profile, reference, altitudes, cosines, scale, spreading, alike, edges, n_edges, log_up, bending, beta):
    """Tables over altitudes and apparent cosines of rays from above.

    log_up (J, C, W): log irradiance without what `edges` take, filled; bending (J, C) [rad], beta (J, C): bending and
    its derivative by the apparent zenith angle at the reference, filled.
    """
    n_c = cosines.size
    own = np.empty(scale.size)
    for j in range(altitudes.size):
        x = (profile.radius_km + altitudes[j]) * (1.0 + refractivity_at(profile, reference, altitudes[j]))
        for m in range(n_c - 1, -1, -1):
            bending[j, m], beta[j, m], ok, _ = log_irradiance_from_above(
                profile, reference, altitudes[j], x * cosines[m], scale, spreading, alike, log_up[j, m], own, _FIRST
            )
            for w in range(scale.size):
                if (not ok or math.isnan(log_up[j, m, w])) and m < n_c - 1:
                    log_up[j, m, w] = log_up[j, m + 1, w]
                elif n_edges > 0:
                    first = N_EDGE_RECORD * n_edges + w
                    log_up[j, m, w] += _edges_from_above(
                        edges, n_edges, first, scale.size, altitudes[j], x * x, x * math.cos(own[w])
                    )
            if not ok and m < n_c - 1:
                bending[j, m] = bending[j, m + 1]
                beta[j, m] = beta[j, m + 1]


@njit(inner=True, cache=True)
def apparent_angle(profile, w, altitude_km, chi, apparent, widening):
    """Apparent zenith angle [rad] of a sun whose true one is `chi`: two Newton steps from a near guess."""
    x = (profile.radius_km + altitude_km) * (1.0 + refractivity_at(profile, w, altitude_km))
    for _ in range(2):
        bending, _, status = sun_ray(profile, w, altitude_km, x * math.cos(apparent), np.bool_(True))
        if status == TRAPPED:
            break
        residual = apparent + bending - chi
        apparent = max(0.0, apparent - residual / widening)
        if abs(residual) < 1e-9:
            break
    return apparent


@njit(cache=True)
def shift_table(profile, reference, other, lowest_km, invariant, distances, slope, shift):
    """How far the lowest point of a ray of `other` lies from that of the reference ray with the same true direction.

    other: index of a wavelength; slope (W, Y) [km^-1]: here of every wavelength; shift (Y, D) [km]: filled, difference
    of the reference's n r at the two lowest points, by the lowest point of the reference ray and the distance u from
    it.
    """
    for m in range(lowest_km.size):
        p, whole, free = full_bending(profile, reference, lowest_km[m])
        for d in range(distances.size):
            shift[m, d] = shift[m - 1, d] if m > 0 else 0.0
            if not free:
                continue
            u = distances[d]
            z = altitude_along(profile, reference, lowest_km[m], u)
            up, _, _, _, ok = outward(profile, reference, z, u, FAR_KM)
            if not ok:
                continue
            apparent = math.atan2(p, -u)
            chi = apparent + whole - up
            widening = max(0.2, 1.0 + up_slope(profile, reference, z, u) - slope[reference, m] * u)
            own = apparent_angle(profile, other, z, chi, apparent, widening)
            x = (profile.radius_km + z) * (1.0 + refractivity_at(profile, other, z))
            lowest, _ = lowest_point(profile, other, z, max(0.0, -x * math.cos(own)), np.bool_(True))
            p_own = (profile.radius_km + lowest) * (1.0 + refractivity_at(profile, reference, lowest))
            shift[m, d] = min(0.0, p_own - p)


@njit(cache=True)
def down_table(
    profile, reference, lowest_km, invariant, distances, scale, shift, slope, spreading, far, alike, edges, n_edges,
    log_down,
):  # fmt: skip
    """log_down (W, Y, D): log irradiance + that of the mirrored ray + log(1 + u/far), of rays that have passed below,
    both without what `edges` take.

    lowest_km (Y,): of a wavelength's own rays; shift (Y, D) [km]: of `shift_table`; slope (W, Y) [km^-1]: here of every
    wavelength; far [km]; log_down: filled.
    """
    n_w = scale.size
    mirror, angle, alone = np.empty(n_w), np.empty(1), np.zeros(1, np.int64)
    half_tau = np.empty(n_w)
    for w in range(n_w):
        if alike[w] < w:
            continue
        for m in range(lowest_km.size):
            half, half_tau[w], _, _, free = outward(profile, w, lowest_km[m], 0.0, FAR_KM)
            for v in range(w + 1, n_w):
                if alike[v] == w:
                    half_tau[v] = outward(profile, v, lowest_km[m], 0.0, FAR_KM).optical_depth
            p_own = (profile.radius_km + lowest_km[m]) * (1.0 + refractivity_at(profile, w, lowest_km[m]))
            for d in range(distances.size):
                for v in range(w, n_w):
                    if alike[v] == w:
                        log_down[v, m, d] = log_down[v, m - 1, d] if m > 0 else 0.0
                if not free:
                    continue
                u = distances[d]
                # the reference ray with the same true direction has its lowest point a little higher
                p = invariant[m] - (1.0 - scale[w]) * shift[m, d]
                y = lowest_km[m]
                if p > invariant[m]:
                    y = altitude_along(
                        profile, reference, lowest_km[m], math.sqrt((p - invariant[m]) * (p + invariant[m]))
                    )
                z = altitude_along(profile, reference, y, u)
                x = (profile.radius_km + z) * (1.0 + refractivity_at(profile, w, z))
                u_own = math.sqrt(max(0.0, (x - p_own) * (x + p_own)))
                up, up_tau, _, _, ok = outward(profile, w, z, u_own, FAR_KM)
                if not ok:
                    continue
                apparent = math.atan2(p_own, -u_own)
                chi = apparent + 2.0 * half - up
                # the mirrored ray as the table of rays from above holds it
                _, beta, mirrored, mirror_chi = log_irradiance_from_above(
                    profile, reference, z, u, scale[w : w + 1], spreading, alone, mirror[w : w + 1], angle, w
                )
                widening = max(_SMALLEST_WIDENING, 1.0 + beta * scale[w] - slope[w, m] * u_own)
                spread = 0.0
                if spreading:
                    n = 1.0 + refractivity_at(profile, w, z)
                    spread = math.log(max(1e-300, n * n * math.sin(apparent) / max(1e-12, math.sin(chi)) / widening))
                xx = p * p + u * u
                own_u = -math.sqrt(max(0.0, u * u + (p - invariant[m]) * (p + invariant[m])))
                x_there = (profile.radius_km + z) * (1.0 + refractivity_at(profile, reference, z))
                for v in range(w, n_w):
                    if alike[v] != w:
                        continue
                    if v > w:
                        up_tau = outward(profile, v, z, u_own, FAR_KM).optical_depth
                        if mirrored:
                            mirror[v] = _log_irradiance(
                                profile, v, z, mirror_chi, angle[0], 1.0 + beta * scale[w], spreading
                            )
                    value = up_tau - 2.0 * half_tau[v] + spread
                    if n_edges > 0:
                        first = N_EDGE_RECORD * n_edges + v
                        value += _edges_from_above(edges, n_edges, first, n_w, z, xx, x_there * math.cos(angle[0]))
                        value += edge_depth(edges, n_edges, 0, first, n_w, z, xx, own_u)
                    if not math.isnan(mirror[v]):
                        log_down[v, m, d] = value + mirror[v] + math.log1p(u / far)


@njit(cache=True)
def edge_table(profile, reference, altitudes, lowest_free_km, edge_chi, edge_cos):
    """True zenith angle of the edge of the shadow and the apparent cosine there, at each altitude.

    The edge is the ray whose lowest point is `lowest_free_km`, followed outwards from there: a search for that point
    from the altitude would decide by rounding whether the ray is free.  edge_chi (J,), edge_cos (J,): filled.
    """
    p0 = (profile.radius_km + lowest_free_km) * (1.0 + refractivity_at(profile, reference, lowest_free_km))
    half, _, _, _, free = outward(profile, reference, lowest_free_km, 0.0, FAR_KM)
    for j in range(altitudes.size):
        x = (profile.radius_km + altitudes[j]) * (1.0 + refractivity_at(profile, reference, altitudes[j]))
        u = -math.sqrt(max(0.0, (x - p0) * (x + p0)))
        near, _, _, _, ok = outward(profile, reference, lowest_free_km, 0.0, altitudes[j])
        bending = half + near
        if not (free and ok) or x < p0 or altitudes[j] < lowest_free_km:
            lo = 0.0
            hi = x
            for _ in range(60):
                mid = 0.5 * (lo + hi)
                _, _, status = sun_ray(profile, reference, altitudes[j], mid, np.bool_(True))
                if status == OUTSIDE:
                    hi = mid
                else:
                    lo = mid
            u = hi
            bending, _, _ = sun_ray(profile, reference, altitudes[j], u, np.bool_(True))
        edge_chi[j] = math.acos(max(-1.0, min(1.0, u / x))) + bending
        edge_cos[j] = u / x


@njit(cache=True)
def guess_table(profile, reference, altitudes, depths, edge_chi, edge_cos, lowest_km, slope, guess):
    """Bending and d(bending)/d(apparent) at true zenith angles edge - depth * edge, exact to 1e-6.

    depths (G,): 0 to 1; guess (J, G, 2): filled, bending [rad] first.
    """
    for j in range(altitudes.size):
        x = (profile.radius_km + altitudes[j]) * (1.0 + refractivity_at(profile, reference, altitudes[j]))
        apparent = math.acos(max(-1.0, min(1.0, edge_cos[j])))
        bending = edge_chi[j] - apparent
        derivative = 0.0
        for g in range(depths.size):
            chi = edge_chi[j] * (1.0 - depths[g])
            for _ in range(4):
                u = x * math.cos(apparent)
                value, _, status = sun_ray(profile, reference, altitudes[j], u, np.bool_(True))
                if status == OUTSIDE:
                    bending = value
                    derivative = up_slope(profile, reference, altitudes[j], abs(u))
                    if u < 0.0:
                        lowest, _ = lowest_point(profile, reference, altitudes[j], -u, np.bool_(True))
                        derivative += interpolate(lowest, lowest_km, slope) * u
                residual = apparent + bending - chi
                if abs(residual) < 1e-7:
                    break
                apparent = max(0.0, apparent - residual / max(0.2, 1.0 + derivative))
            guess[j, g, 0] = bending
            guess[j, g, 1] = max(-0.8, derivative)
