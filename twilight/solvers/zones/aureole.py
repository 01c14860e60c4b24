"""The sky near the sun: light that the forward peak of the aerosol has scattered more than once.

Delta scaling counts light in the peak P'' as not scattered at all: right for the smooth rest of the sky, but within
some degrees of the sun each scattering in the peak widens the glow.  With x the optical depth of scattering in the peak
along the line of sight, n such scatterings have the angular distribution P'' convolved n times with itself and the
weight exp(-x) x^n / n!, while light that is scattered once through scaled air has exp(-x) x exp(x) P'' in their place.
So P'' is replaced by
    Q = exp(-x)/x sum_n x^n/n! P''^(*n),    with the Legendre moments (exp(-x (1 - p_l)) - exp(-x))/x,
p_l being those of P'': 1 up to the degree that is followed, chi_l/f beyond.  To second order in x this is the
correction of Nakajima and Tanaka (1988, J. Quant. Spectrosc. Radiat. Transfer 40, 51, method IMS); all orders are
summed here.  x is that of the way of the light, from the sun to a point of the line of sight and on to the observer, as
a mean over the points weighted with the light that each of them sends.
"""

import math
from functools import partial
from typing import NamedTuple

import numpy as np

from twilight.atmosphere.medium import Medium
from twilight.base.threads import in_slices
from twilight.jit.kernels import njit
from twilight.solvers.zones import constants as tuned
from twilight.transport.azimuth_series import RayDirections
from twilight.transport.beam import Beam, beam_at
from twilight.transport.lines import ALTITUDE, ANGLE, DISTANCE, RayBundle
from twilight.transport.profile import Profile, locate
from twilight.transport.scaling import ScaledMedium
from twilight.transport.steps import chord_depth, distance_to_sphere

MIN_DEPTH = 1e-4
"""Optical depth x of scattering in the peak below which the peak is not widened."""
LEAST_TERM = 1e-9
"""Least term of the series [sr^-1] that is summed."""
AT_ONCE = 64
"""Directions whose series are summed together."""


class ForwardPeak(NamedTuple):
    """moments p_l (L, K, W) of the forward peak of each aerosol; end (L,): the part of each that counts in what is
    scattered several times; strength (K, W): f/(1 - f), 0 where there is no peak;
    profile: of the scaled air, with the coefficient of scattering in the peak [km^-1] as its extinction."""

    moments: np.ndarray
    end: np.ndarray
    strength: np.ndarray
    profile: Profile


def forward_peak(medium: Medium, scaled: ScaledMedium, profile: Profile) -> ForwardPeak | None:
    """The peaks of the aerosol's phase functions that delta scaling has taken away; None where there are none.

    profile: of the scaled medium.
    """
    f = scaled.forward_fraction
    if not f.size or f.max() < tuned.MIN_PEAK_FRACTION or not medium.has_aerosol:
        return None
    n_followed, strong = scaled.moments.shape[1], f > tuned.STRONG_FRACTION

    def moments_to(degree: int) -> np.ndarray:
        moments = np.ones((degree + 1, *f.shape))
        for k, phase in enumerate(medium.phase_functions):
            chi = phase.legendre_moments(degree).T
            # halos and rainbows make moments that exceed f; of a small f they are errors of the quadrature
            low, high = np.where(strong[k], -2.0, 0.0), np.where(strong[k], 2.0, 1.0)
            moments[n_followed:, k] = np.clip(chi[n_followed:] / np.maximum(f[k], tuned.MIN_PEAK_FRACTION), low, high)
        return moments

    moments = moments_to(tuned.HIGHEST_DEGREE)
    end = np.ones(tuned.HIGHEST_DEGREE + 1)
    if np.any(moments[-1][strong] > tuned.MAX_UNRESOLVED):
        moments = moments_to(tuned.ICE_DEGREE)
        end = np.sin(np.minimum(1.0, 2.0 - 2.0 * np.arange(tuned.ICE_DEGREE + 1) / tuned.ICE_DEGREE) * 0.5 * np.pi) ** 2
    # just below a jump, the air below it
    altitude_km = profile.altitude_km
    inside = altitude_km - np.where(np.diff(altitude_km, append=np.inf) <= 0.0, 1e-9, 0.0)
    at = medium.at(inside)
    removed = at.aerosol_extinction - scaled.medium.at(inside).aerosol_extinction
    strength = np.where(f > tuned.MIN_PEAK_FRACTION, f / (1.0 - f), 0.0)
    return ForwardPeak(
        moments, end, strength, profile._replace(extinction=np.ascontiguousarray(np.maximum(0.0, removed)))
    )


@njit(cache=True, nogil=True)
def widen(beam, peak, rays, fraction, directions, cosine, narrow, out, begin, end):
    """Add to out (V, D, K, W) what the phase functions over 1 - f change by, at V scattering angles `cosine` (V, D).

    beam: `Beam`; peak: `ForwardPeak`; rays: `RayBundle`, of which begin..end are followed; directions: `RayDirections`
    fraction (1 + K, P, W): of air and of each aerosol in what points scatter
    narrow (V, D, K, W): f/(1 - f) P'' at the scattering angles
    """
    moments, strength = peak.moments, peak.strength
    place, zenith = rays.place, directions.zenith_rad
    n_l, n_k, n_w = moments.shape
    air = peak.profile
    top_km = air.altitude_km[air.altitude_km.size - 1]
    light, depth = np.empty(n_w), np.empty(n_w)
    series = np.empty((n_l, n_k, n_w))
    sums, lower, legendre = np.empty((n_k, n_w, AT_ONCE)), np.empty(AT_ONCE), np.empty(AT_ONCE)
    for r in range(begin, end):
        by_kind = np.zeros((n_k, n_w))
        total, x = np.zeros(n_w), np.zeros(n_w)
        passed, before_per_km, per_km = np.zeros(n_w), np.zeros(n_w), np.zeros(n_w)
        travelled = -1.0
        for q in range(rays.first[r], rays.first[r + 1]):
            i, g = locate(air, place[q, ALTITUDE])
            # from the observer to this point
            for w in range(n_w):
                per_km[w] = (1.0 - g) * air.extinction[i, w] + g * air.extinction[i + 1, w]
                before = per_km[w] if travelled < 0.0 else before_per_km[w]
                passed[w] += 0.5 * (place[q, DISTANCE] - max(travelled, 0.0)) * (per_km[w] + before)
                before_per_km[w] = per_km[w]
            travelled = place[q, DISTANCE]
            # the sky near the sun is what matters: the sunlight on the ray as if it went towards the sun's azimuth
            bending = beam_at(beam, place[q, ALTITUDE], math.cos(zenith - place[q, ANGLE]), light)
            if light.max() <= 0.0:
                continue
            # from the sun to this point, straight along its apparent direction
            up = math.cos(zenith - place[q, ANGLE] - bending)
            length = distance_to_sphere(place[q, ALTITUDE], up, top_km, air.earth_radius_km)
            if not chord_depth(air, place[q, ALTITUDE], up, length, depth):
                depth[:] = 0.0
            for w in range(n_w):
                for k in range(n_k):
                    part = rays.weight[q, w] * light[w] * fraction[1 + k, q, w] * strength[k, w]
                    by_kind[k, w] += part
                    total[w] += part
                    x[w] += part * (passed[w] + depth[w])
        for w in range(n_w):
            x[w] = x[w] / total[w] if total[w] > 0.0 else 0.0
        if x.max() < MIN_DEPTH:
            continue
        last = n_l
        for n in range(n_l):
            largest = 0.0
            for w in range(n_w):
                mixed = 0.0
                for k in range(n_k):
                    mixed += by_kind[k, w] * moments[n, k, w]
                factor = 0.0
                if total[w] > 0.0 and x[w] >= MIN_DEPTH:
                    mixed /= total[w]
                    none = math.exp(-x[w])
                    if abs(mixed) * x[w] > 1e-6:
                        factor = (math.exp(-x[w] * (1.0 - mixed)) - none) / (x[w] * mixed) - none
                    else:
                        factor = 0.5 * none * x[w] * mixed
                for k in range(n_k):
                    part = peak.end[n] * (2 * n + 1) / (4.0 * math.pi) * moments[n, k, w]
                    series[n, k, w] = part * strength[k, w] * factor
                    largest = max(largest, abs(series[n, k, w]))
            if n > 40 and largest < 1e-7:
                last = n
                break
        for v in range(cosine.shape[0]):
            for start in range(directions.first[r], directions.first[r + 1], AT_ONCE):
                count = min(AT_ONCE, directions.first[r + 1] - start)
                # directions innermost: their sums and Legendre polynomials are neighbours in memory
                sums[:], lower[:], legendre[:] = 0.0, 0.0, 1.0
                for n in range(last):
                    for k in range(n_k):
                        for w in range(n_w):
                            of_degree = series[n, k, w]
                            if abs(of_degree) > LEAST_TERM:
                                for j in range(count):
                                    sums[k, w, j] += legendre[j] * of_degree
                    for j in range(count):
                        following = ((2 * n + 1) * cosine[v, start + j] * legendre[j] - n * lower[j]) / (n + 1)
                        lower[j], legendre[j] = legendre[j], following
                for j in range(count):
                    for k in range(n_k):
                        for w in range(n_w):
                            out[v, start + j, k, w] += sums[k, w, j]
                            if x[w] >= MIN_DEPTH:
                                out[v, start + j, k, w] += math.expm1(-x[w]) * narrow[v, start + j, k, w]


def widen_peaks(
    peak: ForwardPeak,
    scaled: ScaledMedium,
    beam: Beam,
    phases: np.ndarray,
    cosine: np.ndarray,
    rays: RayBundle,
    fraction: np.ndarray,
    directions: RayDirections,
) -> None:
    """Change the aerosol's phase functions (V, D, 1 + K, W) at `cosine` (V, D) to those of the widened forward peak.

    fraction (1 + K, P, W): of air and of each aerosol in what the points of the rays scatter.
    """
    degree = np.arange(scaled.moments.shape[1])
    legendre = np.polynomial.legendre.legvander(cosine, degree.size - 1) * (2 * degree + 1) / (4 * np.pi)
    smooth = np.einsum("vdl,klw->vdkw", legendre, scaled.moments[1:], optimize=True)
    narrow = np.ascontiguousarray(np.where(peak.strength > 0.0, phases[:, :, 1:] - smooth, 0.0))
    change = np.zeros_like(narrow)
    in_slices(partial(widen, beam, peak, rays, fraction, directions, cosine, narrow, change), directions.first.size - 1)
    phases[:, :, 1:] = np.maximum(0.0, phases[:, :, 1:] + change)
