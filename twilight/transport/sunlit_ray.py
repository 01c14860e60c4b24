"""Sunlight scattered once on the way along one line of sight, to the edge of the shadow and through every sharp change.

The points of a ray come in pairs, the two Gauss points of each step (`Line` traced with `pairs`).  With the weight
g = scattering coefficient x transmittance x length of each, what counts of the light is sums over points of

    g x fraction_s x E/F0,

E the sunbeam and fraction_s that of a species in what a point scatters.  The steps follow the air; what the beam does
within one depends on the sun: it begins at the edge of the Earth's shadow, and its logarithm bends where the beam
grazes a layer.  Steps in which such a change matters are cut again.  In a cut step the density of g goes exponentially
through its two points, with the same sum.  Its parts are small at both ends: steps end at edges of layers, beside which
light changes like a square root.  A piece that begins at the edge of the Earth's shadow, found by bisection, has points
spaced like squares from there.

Arguments that the kernels share: air: `SunlitAir`; k: index of the first point of a step; s: one of the species; to_sun
(2,): cosine and sine of the solar zenith angle at the start, cos_azimuth: of the ray from the sun; view: `RayView`, d:
its index among the directions of the phase functions; w: index of the wavelength; work: `Workspace`, filled; moments
(3, S, W): of the light, as of `along`.
"""

import math
from typing import NamedTuple

import numpy as np

from twilight.jit.kernels import njit
from twilight.transport.beam import beam_at
from twilight.transport.beam_lookup import AT_DISPERSION, Beam
from twilight.transport.lines import ALTITUDE, ANGLE, COSINE, DISTANCE, RayBundle
from twilight.transport.steps import GAUSS_HIGH, GAUSS_LOW

STEP_ERROR = 5e-5
"""Fraction of all light in a direction that a step which is not cut may be wrong by."""
MOST_PARTS = 24
"""Most parts that a step is cut into."""
EDGE_PARTS = 8
"""Least parts of a piece of a step that begins or ends on the edge of the Earth's shadow."""
EDGE_HALVINGS = 16
"""Halvings of a step that find the shadow's edge in it."""
_BETWEEN = GAUSS_HIGH - GAUSS_LOW
_FROM_ENDS = np.int64(0)
"""Parts of a step that are small at both its ends: no literal, for which numba would compile `_add_piece` once more."""


class Phases(NamedTuple):
    """What each species makes of sunlight in each direction, (Stokes, D, S, W) [sr^-1]: P11, and P12 turned to the
    vertical plane for Q and for U.

    value: with the sun at its true and the ray at its apparent place; of_sun, of_ray: its change per radian by which
    the sun is lifted and the ray is lowered by refraction.
    """

    value: np.ndarray
    of_sun: np.ndarray
    of_ray: np.ndarray


class SunlitAir(NamedTuple):
    """Rays, and what decides how much sunlight is scattered along them.

    beam; rays: traced with `pairs`, their points P; fraction (S, P, W): of air and of each aerosol in what the points
    scatter; phases: in D directions; floor: least value of a phase function; other (D, W): light over F0 that is there
    besides, of which errors are fractions too
    """

    beam: Beam
    rays: RayBundle
    fraction: np.ndarray
    phases: Phases
    floor: float
    other: np.ndarray


class RayView(NamedTuple):
    """One direction: elevation [rad] of its ray, cosine and sine of the solar zenith angle at the observer, cosine of
    the azimuth from the sun."""

    elevation: float
    to_sun: tuple[float, float]
    cos_azimuth: float


class Workspace(NamedTuple):
    """Room for the points of one ray: light, logarithm, part (P, W); lit (P,); bent (P, 2): by how much the sun is
    lifted and the ray lowered; at_one, total (W,), density (W, 2)."""

    light: np.ndarray
    logarithm: np.ndarray
    part: np.ndarray
    lit: np.ndarray
    bent: np.ndarray
    at_one: np.ndarray
    total: np.ndarray
    density: np.ndarray


@njit(inner=True, cache=True, inline=True, makes_arrays=False)
def cos_sun(angle, to_sun, cos_azimuth):
    """Cosine of the solar zenith angle at a geocentric `angle` [rad] from the start of a ray.

    to_sun (2,): cosine and sine of the solar zenith angle at the start; cos_azimuth: of the ray from the sun.
    """
    return math.cos(angle) * to_sun[0] + math.sin(angle) * to_sun[1] * cos_azimuth


@njit(inner=True, cache=True, makes_arrays=False)
def _between(place, k, t):
    """(altitude [km], angle [rad], cosine) within the step whose points are k and k + 1; t: fraction of the step.

    place (P, 4): as of `Line`.
    """
    f = (t - GAUSS_LOW) / _BETWEEN
    length = place[k + 1, DISTANCE] - place[k, DISTANCE]
    z0, z1 = place[k, ALTITUDE], place[k + 1, ALTITUDE]
    c0, c1 = place[k, COSINE], place[k + 1, COSINE]
    # the cubic with these altitudes and slopes
    g = 1.0 - f
    bulge = f * g * (g * (length * c0 - (z1 - z0)) + f * (z1 - z0 - length * c1))
    z = z0 + f * (z1 - z0) + bulge
    return z, place[k, ANGLE] + f * (place[k + 1, ANGLE] - place[k, ANGLE]), c0 + f * (c1 - c0)


@njit(inner=True, cache=True, makes_arrays=False)
def _is_lit(air, view, k, t, work):
    """Whether sunlight of some wavelength reaches the point at the fraction `t` of step k."""
    z, angle, _ = _between(air.rays.place, k, t)
    beam_at(air.beam, z, cos_sun(angle, view.to_sun, view.cos_azimuth), work.at_one)
    for w in range(work.at_one.size):
        if work.at_one[w] > 0.0:
            return True
    return False


@njit(inner=True, cache=True, makes_arrays=False)
def _edge(air, view, k, low, high, lit_low, work):
    """Fraction of step k in low..high at which the light begins or ends; lit_low: whether `low` is lit."""
    for _ in range(EDGE_HALVINGS):
        t = 0.5 * (low + high)
        if _is_lit(air, view, k, t, work) == lit_low:
            low = t
        else:
            high = t
    return high if not lit_low else low


@njit(inner=True, cache=True, makes_arrays=False)
def _add_piece(air, view, k, begin, end, square, parts, work, moments):
    """Add to the moments those of the piece begin..end (fractions) of the step of points k and k + 1.

    parts: number of parts, each with two Gauss nodes; square: 0 where parts grow like squares from both ends, -1 from
    the begin alone, 1 from the end; the workspace holds the densities of g.
    """
    light, density, fraction = work.at_one, work.density, air.fraction
    for part in range(parts):
        for side in range(2):
            v = (part + (GAUSS_LOW if side == 0 else GAUSS_HIGH)) / parts
            width = 0.5 * (end - begin) / parts
            if square < 0:
                t = begin + (end - begin) * v * v
                width *= 2.0 * v
            elif square > 0:
                t = end - (end - begin) * v * v
                width *= 2.0 * v
            else:
                t = begin + (end - begin) * v * v * (3.0 - 2.0 * v)
                width *= 6.0 * v * (1.0 - v)
            z, angle, cosine = _between(air.rays.place, k, t)
            lifted = beam_at(air.beam, z, cos_sun(angle, view.to_sun, view.cos_azimuth), light)
            lowered = view.elevation - (math.asin(min(1.0, max(-1.0, cosine))) - angle)
            f = (t - GAUSS_LOW) / _BETWEEN
            g = min(1.0, max(0.0, f))
            for w in range(light.size):
                if light[w] > 0.0:
                    strength = width * density[w, 0] * math.exp(density[w, 1] * f) * light[w]
                    for s in range(fraction.shape[0]):
                        source = strength * ((1.0 - g) * fraction[s, k, w] + g * fraction[s, k + 1, w])
                        moments[0, s, w] += source
                        moments[1, s, w] += source * lifted
                        moments[2, s, w] += source * lowered


@njit(inner=True, cache=True, inline=True, makes_arrays=False)
def refracted_phase(air, stokes, d, s, w, lifted, lowered):
    """Element `stokes` of the matrix of species s in direction d, sun lifted and ray lowered.

    lifted [rad]: of the sun, at the most refracted wavelength of the beam; at the others by as much less as the air
    refracts less; lowered [rad]: of the ray.
    """
    own = lifted * (1.0 - air.beam.pool[air.beam.layout[AT_DISPERSION] + w])
    value = air.phases.value[stokes, d, s, w] + own * air.phases.of_sun[stokes, d, s, w]
    value += lowered * air.phases.of_ray[stokes, d, s, w]
    return max(air.floor, value) if stokes == 0 else value


@njit(inner=True, cache=True, makes_arrays=False)
def _densities(weight, k, density):
    """Exponentials through the weights of points k and k + 1 with their sum over the step.

    weight (P, W): of `RayBundle`; density (W, 2): filled, value at the first point and logarithmic slope per step.
    """
    f0, f1 = -GAUSS_LOW / _BETWEEN, (1.0 - GAUSS_LOW) / _BETWEEN
    for w in range(density.shape[0]):
        a, b = weight[k, w], weight[k + 1, w]
        slope = math.log(b / a) if a > 0.0 and b > 0.0 else 0.0
        slope = min(3.0, max(-3.0, slope))
        mean = 1.0
        if abs(slope) > 1e-6:
            mean = _BETWEEN * (math.exp(slope * f1) - math.exp(slope * f0)) / slope
        density[w, 0] = (a + b) / mean
        density[w, 1] = slope


@njit(inner=True, cache=True, makes_arrays=False)
def along(air, r, view, d, work, moments):
    """Moments (3, S, W) of the light along ray r in the direction `view`: sums over points of g fraction_s E/F0, and of
    that times the angles by which the sun is lifted and the ray is lowered.

    The phase functions of direction d, and the other light in it, say which steps matter.

    r: index of the ray; moments: filled.
    """
    light, logarithm, part, lit, bent = work.light, work.logarithm, work.part, work.lit, work.bent
    place, weight, irradiance, total = air.rays.place, air.rays.weight, work.at_one, work.total
    fraction, first = air.fraction, air.rays.first
    n_s, n_w = fraction.shape[0], weight.shape[1]
    k0 = first[r]
    n = first[r + 1] - k0
    for w in range(n_w):
        total[w] = air.other[d, w]
    moments[:] = 0.0
    for i in range(n):
        k = k0 + i
        # not into a row of `light`: an array made here would be counted in and out at every point
        lifted = beam_at(
            air.beam, place[k, ALTITUDE], cos_sun(place[k, ANGLE], view.to_sun, view.cos_azimuth), irradiance
        )
        lowered = view.elevation - (math.asin(min(1.0, max(-1.0, place[k, COSINE]))) - place[k, ANGLE])
        bent[i, 0], bent[i, 1] = lifted, lowered
        lit[i] = False
        for w in range(n_w):
            light[i, w] = irradiance[w]
            logarithm[i, w] = -80.0
            source = 0.0
            if irradiance[w] > 0.0:
                lit[i] = True
                logarithm[i, w] = max(-80.0, math.log(irradiance[w]))
                for s in range(n_s):
                    source += fraction[s, k, w] * refracted_phase(air, 0, d, s, w, lifted, lowered)
            part[i, w] = weight[k, w] * irradiance[w] * source
            total[w] += part[i, w]
    for i in range(0, n, 2):
        before, after = max(i - 1, 0), min(i + 2, n - 1)
        some_lit = lit[before] or lit[i] or lit[i + 1] or lit[after]
        if not some_lit:
            continue
        all_lit = lit[before] and lit[i] and lit[i + 1] and lit[after]
        error, change = _error(air.rays, work, k0, before, i, after, all_lit)
        if error > STEP_ERROR:
            _cut(air, view, k0 + i, all_lit, change, work, moments)
            continue
        for j in range(i, i + 2):
            for s in range(n_s):
                for w in range(n_w):
                    source = weight[k0 + j, w] * light[j, w] * fraction[s, k0 + j, w]
                    moments[0, s, w] += source
                    moments[1, s, w] += source * bent[j, 0]
                    moments[2, s, w] += source * bent[j, 1]


@njit(inner=True, cache=True, inline=True, makes_arrays=False)
def _error(rays, work, k0, before, i, after, all_lit):
    """By how much of all light in the direction a step that is not cut may be wrong, and how much the logarithm of the
    sunlight changes in it where that is too much.

    rays: `RayBundle`; k0: index of the ray's first point; before, i, i + 1, after: of the step's points and their
    neighbours among those of the ray; all_lit: whether they all are.
    """
    place, weight, logarithm, part, total = rays.place, rays.weight, work.logarithm, work.part, work.total
    k = k0 + i
    length = place[k + 1, DISTANCE] - place[k, DISTANCE]
    error = change = 0.0
    if length > 0.0:
        for w in range(total.size):
            if total[w] <= 0.0:
                continue
            slope = (logarithm[i + 1, w] - logarithm[i, w]) / length
            bend = 0.0
            if before < i:
                gap = place[k, DISTANCE] - place[k0 + before, DISTANCE]
                bend = abs((logarithm[i, w] - logarithm[before, w]) / gap - slope)
            if after > i + 1:
                gap = place[k0 + after, DISTANCE] - place[k + 1, DISTANCE]
                bend = max(bend, abs((logarithm[after, w] - logarithm[i + 1, w]) / gap - slope))
            bend *= length / _BETWEEN
            step = abs(slope) * length / _BETWEEN
            # as bright as the brighter end would make it
            brightest = max(
                max(part[i, w], part[i + 1, w]),
                max(
                    part[before, w] * weight[k, w] / max(weight[k0 + before, w], 1e-300),
                    part[after, w] * weight[k + 1, w] / max(weight[k0 + after, w], 1e-300),
                ),
            )
            wrong = min(1.0, 0.02 * bend + min(step, 10.0) ** 4 / 4320.0) * 2.0 * brightest / total[w]
            if not all_lit:
                wrong = 2.0 * brightest / total[w]
            if wrong > error:
                error = wrong
            if wrong > STEP_ERROR:
                change = max(change, max(bend, step))
    return error, change


@njit(inner=True, cache=True, makes_arrays=False)
def _cut(air, view, k, all_lit, change, work, moments):
    """Add the light of the step of points k and k + 1, cut in parts, to the moments.

    all_lit: whether they are, and so are their neighbours; change: of `_error`.
    """
    _densities(air.rays.weight, k, work.density)
    parts = int(min(MOST_PARTS, 2.0 + math.ceil(4.0 * min(change, 10.0))))
    if all_lit:
        _add_piece(air, view, k, 0.0, 1.0, _FROM_ENDS, parts, work, moments)
        return
    mark = (0.0, GAUSS_LOW, GAUSS_HIGH, 1.0)
    start, square = 0.0, 0
    here_lit = _is_lit(air, view, k, 0.0, work)
    for m in range(4):
        next_lit, stop = here_lit, 1.0
        if m < 3:
            next_lit = _is_lit(air, view, k, mark[m + 1], work)
            if next_lit == here_lit:
                continue
            stop = _edge(air, view, k, mark[m], mark[m + 1], here_lit, work)
        if here_lit and stop > start:
            cuts = parts
            if m < 3 or square != 0:
                cuts = max(cuts, EDGE_PARTS)
            kind = -1 if square != 0 else (1 if m < 3 else 0)
            _add_piece(air, view, k, start, stop, kind, cuts, work, moments)
        start, square, here_lit = stop, 1, next_lit
