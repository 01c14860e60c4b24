"""Exact values behind the table of the direct sun beam: one kernel per table.

See :mod:`twilight.transport.beam` for what the tables mean and how they are looked up.

Arguments that the kernels share: profile: `RayProfile`; w: index of the wavelength, reference: of the one whose rays
the coordinates follow; air: `BeamAir`; limb: `beam_layout.LimbRays`; altitude_km: of the point; u_km, xx [km^2]: n r
cos i of the ray and (n r)^2 there; chi, apparent [rad]: true and apparent zenith angle of the sun; widening:
d(chi)/d(apparent); altitudes (J,) [km]; cosines (C,): apparent; distances (D,) [km]: u of the reference ray; edge_chi
(J,) [rad], edge_cos (J,): true zenith angle and apparent cosine of the shadow's edge.
"""

import math
from typing import NamedTuple

import numpy as np

from twilight.jit.kernels import njit
from twilight.transport.beam_edges import N_EDGE_RECORD, edge_depth
from twilight.transport.ray_profile import RayProfile, refractive_radius, refractivity_at
from twilight.transport.rays import FAR_KM, OUTSIDE, TRAPPED, altitude_along, lowest_point, outward, sun_ray

_SMALLEST_WIDENING = 0.05
"""Bound on d(true zenith angle)/d(apparent): below it rays cross (a mirage), which the table does not follow."""


class BeamAir(NamedTuple):
    """What the beam goes through at W wavelengths.

    profile: `RayProfile`, of these and perhaps of others; reference: index in it of the wavelength whose rays the
        coordinates follow
    scale (W,): refractivity over the reference's; rays_of (W,): the first wavelength of the same refractive index,
        whose rays each shares (terms of one wavelength differ in what a gas absorbs)
    least, least_scale: index in the profile of the least refracted wavelength, and its refractivity over the
        reference's; between the two a ray turns in proportion to that
    spreading: whether the refracted beam thins out
    edges: of `beam_edges.Edges.flat`, and n_edges: how many pieces it holds
    """

    profile: RayProfile
    reference: int
    scale: np.ndarray
    rays_of: np.ndarray
    least: int
    least_scale: float
    spreading: bool
    edges: np.ndarray
    n_edges: int


@njit(inner=True, cache=True, makes_arrays=False)
def up_slope(profile, w, altitude_km, u_km):
    """d(bending)/d(apparent zenith angle) of a ray that comes from above, by a difference over 0.001 of the radius."""
    x = refractive_radius(profile, w, altitude_km)
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


@njit(inner=True, cache=True, makes_arrays=False)
def full_bending(profile, w, lowest_km):
    """Invariant p [km] and bending [rad] of the whole ray with its lowest point at `lowest_km`, and if it is free."""
    p = refractive_radius(profile, w, lowest_km)
    bending, _, _, _, ok = outward(profile, w, lowest_km, 0.0, FAR_KM)
    return p, 2.0 * bending, ok


@njit(cache=True, makes_arrays=False)
def limb_table(profile, w, lowest_km, below_km, above_km, invariant, bending, slope, free):
    """Fill invariant, bending, slope (Y,) of rays with lowest points lowest_km (Y,), as `LimbRays` has them at one
    wavelength, and free (Y,): whether they leave the air.

    The slope is the mean over lowest points from `below_km` to `above_km`, (Y,) each.
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


@njit(inner=True, cache=True, makes_arrays=False)
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


@njit(inner=True, cache=True, makes_arrays=False)
def _lowering(air, altitude_km, apparent, bending, beta):
    """By how much the sun's apparent zenith angle is larger [rad] at the least refracted wavelength than at the
    reference, over 1 - `least_scale`, by a Newton step, and whether the ray is free.

    apparent, bending [rad], beta: of the reference's ray, as of `_reference_ray`.
    """
    if air.least_scale >= 1.0:
        return 0.0, True
    chi, own = apparent + bending, apparent + bending * (1.0 - air.least_scale)
    x = refractive_radius(air.profile, air.least, altitude_km)
    own_bending, _, _, _, ok = outward(air.profile, air.least, altitude_km, max(0.0, x * math.cos(own)), FAR_KM)
    if ok and own <= 0.5 * math.pi:
        own = max(0.0, own - (own + own_bending - chi) / (1.0 + beta * air.least_scale))
    return (own - apparent) / (1.0 - air.least_scale), ok


@njit(inner=True, cache=True, makes_arrays=False)
def _log_irradiance(air, w, altitude_km, chi, apparent, widening):
    """Logarithm of (irradiance at normal incidence)/F0 at a point, for a ray that comes from above.

    irradiance = T n^2 sin(i)/sin(chi) / (d chi/d i): the flux F0 p dp of the annulus of invariants p..p+dp spread over
    r^2 sin(chi) d chi cos(i), with p = n r sin i.  chi is the true zenith angle of the sun, `apparent` the apparent
    one, widening = d(chi)/d(i).  Where the ray comes from a little below the horizontal, because another wavelength
    sees the sun there exactly, T is continued linearly from above: what lies below is not part of this table.  Not a
    number where the ray is not free.
    """
    n = 1.0 + refractivity_at(air.profile, w, altitude_km)
    u = (air.profile.radius_km + altitude_km) * n * math.cos(apparent)
    _, tau, _, _, ok = outward(air.profile, w, altitude_km, abs(u), FAR_KM)
    if not ok:
        return np.nan
    if u < 0.0:
        _, level, _, _, ok = outward(air.profile, w, altitude_km, 0.0, FAR_KM)
        if not ok:
            return np.nan
        tau = 2.0 * level - tau
    if not air.spreading:
        return -tau
    ratio = math.sin(apparent) / math.sin(chi) if math.sin(chi) > 1e-7 else 1.0 / widening
    return -tau + math.log(max(1e-300, n * n * ratio / max(_SMALLEST_WIDENING, widening)))


@njit(inner=True, cache=True, makes_arrays=False)
def _reference_ray(air, altitude_km, u_km):
    """(Apparent zenith angle [rad], bending [rad], its derivative by that angle, free) of the reference's ray from
    above with n r cos i = `u_km` >= 0; bending and derivative are 0 where the ray is not free."""
    x = refractive_radius(air.profile, air.reference, altitude_km)
    apparent = math.atan2(math.sqrt(max(0.0, (x - u_km) * (x + u_km))), u_km)
    bending, _, _, _, free = outward(air.profile, air.reference, altitude_km, u_km, FAR_KM)
    if not free:
        return apparent, 0.0, 0.0, False
    return apparent, bending, up_slope(air.profile, air.reference, altitude_km, u_km), True


@njit(inner=True, cache=True, makes_arrays=False)
def _edge_depth(air, w, altitude_km, xx, u_km):
    """`edge_depth` at a wavelength."""
    first = N_EDGE_RECORD * air.n_edges + w
    return edge_depth(air.edges, air.n_edges, 0, first, air.scale.size, altitude_km, xx, u_km)


@njit(inner=True, cache=True, makes_arrays=False)
def _edges_from_above(air, w, altitude_km, xx, u_km):
    """`_edge_depth` as `_log_irradiance` sees it: for a ray from below the horizontal continued linearly from above."""
    depth = _edge_depth(air, w, altitude_km, xx, abs(u_km))
    if u_km < 0.0:
        depth = 2.0 * _edge_depth(air, w, altitude_km, xx, 0.0) - depth
    return depth


@njit(cache=True)
def up_table(air, altitudes, cosines, log_up, bending, beta):
    """Tables over altitudes and apparent cosines of rays from above.

    log_up (J, C, W): log irradiance without the edges of `air`, filled; bending (J, C) [rad], beta (J, C): bending and
    its derivative by the apparent zenith angle at the reference, filled.
    """
    own = np.empty(air.scale.size)
    for j in range(altitudes.size):
        z = altitudes[j]
        x = refractive_radius(air.profile, air.reference, z)
        for m in range(cosines.size - 1, -1, -1):
            apparent, bending[j, m], beta[j, m], ok = _reference_ray(air, z, x * cosines[m])
            if ok:
                chi = apparent + bending[j, m]
                lowering, free = _lowering(air, z, apparent, bending[j, m], beta[j, m])
                for w in range(own.size):
                    own[w] = apparent + lowering * (1.0 - air.scale[w])
                    widening = 1.0 + beta[j, m] * air.scale[w]
                    log_up[j, m, w] = _log_irradiance(air, w, z, chi, own[w], widening) if free else np.nan
            for w in range(own.size):
                if (not ok or math.isnan(log_up[j, m, w])) and m < cosines.size - 1:
                    log_up[j, m, w] = log_up[j, m + 1, w]
                elif air.n_edges > 0:
                    log_up[j, m, w] += _edges_from_above(air, w, z, x * x, x * math.cos(own[w]))
            if not ok and m < cosines.size - 1:
                bending[j, m] = bending[j, m + 1]
                beta[j, m] = beta[j, m + 1]


@njit(inner=True, cache=True, makes_arrays=False)
def apparent_angle(profile, w, altitude_km, chi, apparent, widening):
    """Apparent zenith angle [rad] of a sun whose true one is `chi`: two Newton steps from a near guess."""
    x = refractive_radius(profile, w, altitude_km)
    for _ in range(2):
        bending, _, status = sun_ray(profile, w, altitude_km, x * math.cos(apparent), np.bool_(True))
        if status == TRAPPED:
            break
        residual = apparent + bending - chi
        apparent = max(0.0, apparent - residual / widening)
        if abs(residual) < 1e-9:
            break
    return apparent


@njit(cache=True, makes_arrays=False)
def shift_table(profile, reference, other, limb, distances, shift):
    """How far the lowest point of a ray of `other` lies from that of the reference ray with the same true direction.

    other: index of a wavelength; shift (Y, D) [km]: filled, difference of the reference's n r at the two lowest points,
    by the lowest point of the reference ray and the distance u from it.
    """
    for m in range(limb.lowest_km.size):
        p, whole, free = full_bending(profile, reference, limb.lowest_km[m])
        for d in range(distances.size):
            shift[m, d] = shift[m - 1, d] if m > 0 else 0.0
            if not free:
                continue
            u = distances[d]
            z = altitude_along(profile, reference, limb.lowest_km[m], u)
            up, _, _, _, ok = outward(profile, reference, z, u, FAR_KM)
            if not ok:
                continue
            apparent = math.atan2(p, -u)
            chi = apparent + whole - up
            widening = max(0.2, 1.0 + up_slope(profile, reference, z, u) - limb.slope[reference, m] * u)
            own = apparent_angle(profile, other, z, chi, apparent, widening)
            x = refractive_radius(profile, other, z)
            lowest, _ = lowest_point(profile, other, z, max(0.0, -x * math.cos(own)), np.bool_(True))
            p_own = refractive_radius(profile, reference, lowest)
            shift[m, d] = min(0.0, p_own - p)


@njit(inner=True, cache=True, makes_arrays=False)
def _altitude_behind(profile, w, lowest_km, invariant_km, p, u_km):
    """Altitude [km] at u = `u_km` behind the lowest point of a ray of invariant p [km], not below that of another ray,
    of `invariant_km`, whose lowest point is at `lowest_km`."""
    if p > invariant_km:
        lowest_km = altitude_along(profile, w, lowest_km, math.sqrt((p - invariant_km) * (p + invariant_km)))
    return altitude_along(profile, w, lowest_km, u_km)


@njit(cache=True)
def down_table(air, limb, distances, shift, far, log_down):
    """log_down (W, Y, D): log irradiance + that of the mirrored ray + log(1 + u/far), of rays that have passed below,
    both without the edges of `air`.

    limb: the lowest points are those of a wavelength's own rays; shift (Y, D) [km]: of `shift_table`; far [km];
    log_down: filled.
    """
    profile, reference, scale, rays_of = air.profile, air.reference, air.scale, air.rays_of
    lowest_km, invariant = limb.lowest_km, limb.invariant[reference]
    n_w = scale.size
    half, half_tau = np.empty(n_w), np.empty(n_w)
    free = np.empty(n_w, np.bool_)
    whole = max(1e-300, 1.0 - air.least_scale)
    for m in range(lowest_km.size):
        lowest = lowest_km[m]
        for w in range(n_w):
            half[w], half_tau[w], _, _, free[w] = outward(profile, w, lowest, 0.0, FAR_KM)
        for d in range(distances.size):
            for w in range(n_w):
                log_down[w, m, d] = log_down[w, m - 1, d] if m > 0 else 0.0
            u = distances[d]
            # the mirrored ray as the table of rays from above holds it, at the reference and where light is refracted
            # least; in between it is in proportion
            p = invariant[m] - (1.0 - air.least_scale) * shift[m, d]
            far_km = _altitude_behind(profile, reference, lowest, invariant[m], p, u)
            far_angle, far_bending, far_beta, far_free = _reference_ray(air, far_km, u)
            lowering, ok = _lowering(air, far_km, far_angle, far_bending, far_beta)
            _, bending, beta, mirrored = _reference_ray(air, altitude_along(profile, reference, lowest, u), u)
            if not (mirrored and far_free and ok):  # the row holds the light of the one below
                continue
            for w in range(n_w):
                if rays_of[w] < w or not free[w]:
                    continue
                # the reference ray with the same true direction has its lowest point a little higher
                p = invariant[m] - (1.0 - scale[w]) * shift[m, d]
                z = _altitude_behind(profile, reference, lowest, invariant[m], p, u)
                x = refractive_radius(profile, w, z)
                p_own = refractive_radius(profile, w, lowest)
                u_own = math.sqrt(max(0.0, (x - p_own) * (x + p_own)))
                up, up_tau, _, _, ok = outward(profile, w, z, u_own, FAR_KM)
                if not ok:
                    continue
                apparent = math.atan2(p_own, -u_own)
                chi = apparent + 2.0 * half[w] - up
                part = (1.0 - scale[w]) / whole
                x_there = refractive_radius(profile, reference, z)
                above = math.atan2(math.sqrt(max(0.0, (x_there - u) * (x_there + u))), u)
                mirror_apparent = above + lowering * (1.0 - scale[w])
                mirror_chi = above + bending + part * (far_bending - bending)
                mirror_widening = 1.0 + (beta + part * (far_beta - beta)) * scale[w]
                widening = max(_SMALLEST_WIDENING, mirror_widening - limb.slope[w, m] * u_own)
                spread = 0.0
                if air.spreading:
                    n = 1.0 + refractivity_at(profile, w, z)
                    spread = math.log(max(1e-300, n * n * math.sin(apparent) / max(1e-12, math.sin(chi)) / widening))
                xx = p * p + u * u
                own_u = -math.sqrt(max(0.0, u * u + (p - invariant[m]) * (p + invariant[m])))
                for v in range(w, n_w):
                    if rays_of[v] != w:
                        continue
                    if v > w:
                        up_tau = outward(profile, v, z, u_own, FAR_KM).optical_depth
                    mirror = _log_irradiance(air, v, z, mirror_chi, mirror_apparent, mirror_widening)
                    value = up_tau - 2.0 * half_tau[v] + spread
                    if air.n_edges > 0:
                        value += _edges_from_above(air, v, z, xx, x_there * math.cos(mirror_apparent))
                        value += _edge_depth(air, v, z, xx, own_u)
                    if not math.isnan(mirror):
                        log_down[v, m, d] = value + mirror + math.log1p(u / far)


@njit(cache=True, makes_arrays=False)
def edge_table(profile, reference, altitudes, lowest_free_km, edge_chi, edge_cos):
    """True zenith angle of the edge of the shadow and the apparent cosine there, at each altitude.

    The edge is the ray whose lowest point is `lowest_free_km`, followed outwards from there: a search for that point
    from the altitude would decide by rounding whether the ray is free.  edge_chi (J,), edge_cos (J,): filled.
    """
    p0 = refractive_radius(profile, reference, lowest_free_km)
    half, _, _, _, free = outward(profile, reference, lowest_free_km, 0.0, FAR_KM)
    for j in range(altitudes.size):
        x = refractive_radius(profile, reference, altitudes[j])
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


@njit(cache=True, makes_arrays=False)
def guess_table(profile, reference, altitudes, depths, edge_chi, edge_cos, limb, guess):
    """Bending and d(bending)/d(apparent) at true zenith angles edge - depth * edge, exact to 1e-6.

    depths (G,): 0 to 1; guess (J, G, 2): filled, bending [rad] first.
    """
    for j in range(altitudes.size):
        x = refractive_radius(profile, reference, altitudes[j])
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
                        derivative += interpolate(lowest, limb.lowest_km, limb.slope[reference]) * u
                residual = apparent + bending - chi
                if abs(residual) < 1e-7:
                    break
                apparent = max(0.0, apparent - residual / max(0.2, 1.0 + derivative))
            guess[j, g, 0] = bending
            guess[j, g, 1] = max(-0.8, derivative)
