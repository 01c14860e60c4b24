"""Lines of sight as a few points each: straight or bent by refraction, short steps where the air changes.

A step is never longer than about 0.7 optical depths and never crosses a jump of the medium.  A bent line is followed by
fourth-order Runge-Kutta steps in altitude z, geocentric angle psi and the elevation a of the ray above the local
horizontal,
    dz/ds = sin a,   dpsi/ds = cos a / (R + z),   da/ds = cos a (1/(R + z) + d ln n/dz),
which pass a lowest point without a singularity; with n = 1 the line is straight.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit

from twilight.atmosphere.medium import Medium
from twilight.geometry import distance_to_sphere
from twilight.transport.march import GAUSS_HIGH, GAUSS_LOW
from twilight.transport.profile import Profile, locate

MAX_POINTS = 1200
LONG_STEP_KM = 5.0
"""A longer step is two points: the sunbeam changes by e within tens of km along a line near the terminator."""
NEGLIGIBLE = 1e-13
"""Scattering optical depth of a step below which it is left out."""

OUT, GROUND = 0, 1


class Line(NamedTuple):
    """One line of sight for kernels to fill; the first `count` rows hold its points, from the start outwards.

    place (P, 4): altitude [km], geocentric angle from the start [rad], cosine of the local zenith angle, path length
    from the start [km]; weight (P, W): scattering coefficient x transmittance x length.
    transmittance (W,): to the end of the line; end (2,): geocentric angle there, and its local zenith cosine.
    """

    place: np.ndarray
    weight: np.ndarray
    transmittance: np.ndarray
    end: np.ndarray


def refractive_gradient(medium: Medium, profile: Profile, *, bent: bool) -> np.ndarray:
    """d ln n/dz [km^-1] between the levels of `profile`, (N - 1,), for the middle one of the wavelengths.

    Dispersion across the visible moves a line at the horizon by 0.01 deg.  An index that jumps between layers is
    joined by straight pieces between the middles of the layers: a jump would reflect every grazing ray.
    """
    z = profile.altitude_km
    if not bent or not medium.has_refraction:
        return np.zeros(z.size - 1)
    levels = medium.altitude_km
    index = medium.refractivity[:, medium.n_wavelengths // 2]
    same = np.diff(levels) <= 0
    if np.count_nonzero(~same) > 1 and np.any(same & (np.abs(np.diff(index)) > 1e-3 * index[:-1])):
        thick = ~same
        middle = 0.5 * (levels[1:] + levels[:-1])[thick]
        value = 0.5 * (index[1:] + index[:-1])[thick]
        lowest = value[0] * (value[0] / value[1]) ** ((middle[0] - levels[0]) / (middle[1] - middle[0]))
        levels = np.concatenate([levels[:1], middle, levels[-1:]])
        index = np.concatenate([[lowest], value, index[-1:]])
    n = np.exp(np.interp(z, levels, np.log(np.maximum(index, 1e-30))))
    step = np.diff(z)
    return np.where(step > 0, np.diff(n) / np.where(step > 0, step, 1.0), 0.0)


@njit(cache=True, inline="always")
def _turning(profile, gradient, z):
    """Curvature of the Earth under the ray: 1/(R + z) + d ln n/dz, and 1/(R + z)."""
    i, _ = locate(profile, z)
    flat = 1.0 / (profile.earth_radius_km + z)
    return flat + gradient[i], flat


@njit(cache=True)
def advance(profile, gradient, z, psi, a, h):
    """One Runge-Kutta step of length h [km]; returns (z, psi, a) at its end."""
    k1, f1 = _turning(profile, gradient, z)
    c1, s1 = math.cos(a), math.sin(a)
    a2 = a + 0.5 * h * c1 * k1
    k2, f2 = _turning(profile, gradient, z + 0.5 * h * s1)
    c2, s2 = math.cos(a2), math.sin(a2)
    a3 = a + 0.5 * h * c2 * k2
    k3, f3 = _turning(profile, gradient, z + 0.5 * h * s2)
    c3, s3 = math.cos(a3), math.sin(a3)
    a4 = a + h * c3 * k3
    k4, f4 = _turning(profile, gradient, z + h * s3)
    c4, s4 = math.cos(a4), math.sin(a4)
    return (
        z + h / 6.0 * (s1 + 2.0 * s2 + 2.0 * s3 + s4),
        psi + h / 6.0 * (c1 * f1 + 2.0 * c2 * f2 + 2.0 * c3 * f3 + c4 * f4),
        a + h / 6.0 * (c1 * k1 + 2.0 * c2 * k2 + 2.0 * c3 * k3 + c4 * k4),
    )


@njit(cache=True)
def _reaches(z, a, turning, target, h):
    """Length after which the ray meets the sphere at `target` [km], or -1 when not within h; locally a parabola."""
    b = math.sin(a)
    q = 0.5 * turning * math.cos(a) ** 2
    c = z - target
    disc = b * b - 4.0 * q * c
    if disc < 0.0:
        return -1.0
    root = math.sqrt(disc)
    # both roots without cancellation
    t = -0.5 * (b + (root if b >= 0.0 else -root))
    s1 = t / q if abs(q) > 1e-300 else -1.0
    s2 = c / t if abs(t) > 1e-300 else -1.0
    best = -1.0
    for s in (s1, s2):
        if 0.0 < s <= h and (best < 0.0 or s < best):
            best = s
    return best


@njit(cache=True)
def _meet(profile, gradient, z, a, turning, target, h):
    """The same, made exact by Newton steps along the ray itself."""
    s = _reaches(z, a, turning, target, h)
    if s < 0.0:
        return s
    for _ in range(4):
        z_s, _, a_s = advance(profile, gradient, z, 0.0, a, s)
        slope = math.sin(a_s)
        if abs(slope) < 1e-9 or abs(z_s - target) < 1e-10:
            break
        s = min(h, max(0.0, s - (z_s - target) / slope))
    return s


@njit(cache=True)
def step_length(profile, z, slope, travelled, fineness, depth, depth_max):
    """Length [km] of the next step at altitude z, for a ray whose altitude changes by `slope` per length.

    travelled [km]; depth, depth_max: optical depth so far at the clearest and at the darkest wavelength.
    """
    bottom = profile.altitude_km[0]
    height = max(z - bottom, 0.0)
    ds = min(30.0, max(0.4, 0.25 * travelled + 0.02 * height)) / fineness
    i, f = locate(profile, z)
    layer = profile.layer_step_km[i] * (1.0 - f) + profile.layer_step_km[i + 1] * f
    dz = min(0.5 + 0.08 * height, layer) / fineness
    # |slope| ds + ds^2 / 2R is the change of altitude
    ds = min(ds, 2.0 * dz / (abs(slope) + math.sqrt(slope * slope + 2.0 * dz / profile.earth_radius_km)))
    k_max = 0.0
    for w in range(profile.extinction.shape[1]):
        k_max = max(k_max, profile.extinction[i, w] * (1.0 - f) + profile.extinction[i + 1, w] * f)
    if k_max * ds * fineness > 0.7:
        limit = 0.7 if depth < 12.0 else 3.0
        shortest = max(limit / (k_max * fineness), 1e-4)
        if depth_max > 30.0:
            # a wavelength that is black by now must not use up the steps of the others
            shortest = max(shortest, 0.25 * travelled / fineness)
        ds = min(ds, shortest)
    return ds


@njit(cache=True)
def trace_line(profile, gradient, jumps, altitude_km, cos_zenith, fineness, line):
    """Follow a line of sight and fill `line`; returns (number of points, OUT or GROUND).

    Steps grow once a line has used up half of MAX_POINTS, so that its end is reached in any air.

    altitude_km: of the start, in the air, on the ground or above the top (then the line begins where it enters;
    one that misses the air has no points); cos_zenith: of the direction there.
    """
    place, weight, transmittance, end = line
    levels = profile.altitude_km
    bottom, top = levels[0], levels[levels.size - 1]
    radius = profile.earth_radius_km
    n_w = transmittance.size
    z, psi, a = altitude_km, 0.0, math.asin(min(1.0, max(-1.0, cos_zenith)))
    for w in range(n_w):
        transmittance[w] = 1.0
    travelled = 0.0
    end[0], end[1] = 0.0, cos_zenith
    if z > top:
        s = distance_to_sphere(z, cos_zenith, top, radius)
        if s < 0.0:
            return 0, OUT
        across = s * math.cos(a)
        psi = math.atan2(across, radius + z + s * cos_zenith)
        a = a + psi
        z = top
        travelled = s
    elif z <= bottom and cos_zenith < 0.0:
        return 0, GROUND
    passed = np.zeros(n_w)
    start = travelled
    n = 0
    depth = depth_max = 0.0
    while n < MAX_POINTS - 2:
        slope = math.sin(a)
        left = max(0.02, min(1.0, 2.0 - 2.0 * n / MAX_POINTS))
        h = step_length(profile, z, slope, travelled - start, fineness * left, depth, depth_max)
        turning, _ = _turning(profile, gradient, z)
        status = -1
        if slope < 0.0 and z > bottom:
            s = _meet(profile, gradient, z, a, turning, bottom, h)
            if s >= 0.0:
                h, status = s, GROUND
        s = _meet(profile, gradient, z, a, turning, top, h) if z < top or slope > 0.0 else -1.0
        if z >= top and slope >= 0.0:
            s = 0.0
        if s >= 0.0:
            h, status = s, OUT
        for j in range(jumps.size):
            if abs(jumps[j] - z) > 1e-7 and abs(jumps[j] - z) < abs(slope) * h + h * h / radius:
                s = _reaches(z, a, turning, jumps[j], h)
                if s >= 0.0:
                    # just across, so that the next step starts on the other side
                    h, status = min(h, s + 1e-8 / max(abs(slope), 1e-4)), -1
        if h <= 0.0:
            end[0], end[1] = psi, slope
            return n, OUT
        z0, psi0, a0 = advance(profile, gradient, z, psi, a, GAUSS_LOW * h)
        z1, psi1, a1 = advance(profile, gradient, z0, psi0, a0, (GAUSS_HIGH - GAUSS_LOW) * h)
        z, psi, a = advance(profile, gradient, z1, psi1, a1, (1.0 - GAUSS_HIGH) * h)
        i0, f0 = locate(profile, z0)
        i1, f1 = locate(profile, z1)
        two = h > LONG_STEP_KM
        low_sum = high_sum = strongest = 0.0
        clearest, darkest = 1e300, 0.0
        k, sigma = profile.extinction, profile.scattering
        for w in range(n_w):
            tau = 0.5 * h * (
                k[i0, w] * (1 - f0) + k[i0 + 1, w] * f0 + k[i1, w] * (1 - f1) + k[i1 + 1, w] * f1
            )  # fmt: skip
            t = 0.5 * h * math.exp(-passed[w])
            low = t * math.exp(-GAUSS_LOW * tau) * (sigma[i0, w] * (1 - f0) + sigma[i0 + 1, w] * f0)
            high = t * math.exp(-GAUSS_HIGH * tau) * (sigma[i1, w] * (1 - f1) + sigma[i1 + 1, w] * f1)
            passed[w] += tau
            low_sum += low
            high_sum += high
            strongest = max(strongest, low + high)
            clearest = min(clearest, passed[w])
            darkest = max(darkest, passed[w])
            if two:
                weight[n, w] = low
                weight[n + 1, w] = high
            else:
                weight[n, w] = low + high
        s_low, s_high = travelled + GAUSS_LOW * h, travelled + GAUSS_HIGH * h
        travelled += h
        depth, depth_max = clearest, darkest
        if strongest > NEGLIGIBLE:
            if two:
                place[n, 0], place[n, 1], place[n, 2], place[n, 3] = z0, psi0, math.sin(a0), s_low
                n += 1
                place[n, 0], place[n, 1], place[n, 2], place[n, 3] = z1, psi1, math.sin(a1), s_high
            else:
                g = high_sum / (low_sum + high_sum)
                place[n, 0] = z0 + g * (z1 - z0)
                place[n, 1] = psi0 + g * (psi1 - psi0)
                place[n, 2] = math.sin(a0 + g * (a1 - a0))
                place[n, 3] = s_low + g * (s_high - s_low)
            n += 1
        if status >= 0 or clearest > 25.0:
            break
    for w in range(n_w):
        transmittance[w] = math.exp(-passed[w])
    end[0], end[1] = psi, math.sin(a)
    return n, (GROUND if status == GROUND else OUT)


def new_line(n_wavelengths: int) -> Line:
    """Room for one line."""
    return Line(np.empty((MAX_POINTS, 4)), np.empty((MAX_POINTS, n_wavelengths)), np.empty(n_wavelengths), np.empty(2))
