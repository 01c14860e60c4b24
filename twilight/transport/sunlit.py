"""Light scattered once along lines of sight, integrated to the edge of the shadow and through every sharp change.

The points of a ray come in pairs, the two Gauss points of each step (`Line` traced with `pairs`).  With the weight
g = scattering coefficient x transmittance x length of each, light scattered once is the sum over points of

    g x E/F0 x sum_s share_s p_s,

E the sunbeam and p_s the phase functions, for Q and U the elements of the matrix in their place.  The steps follow the
air; what the beam does within one depends on the sun: it begins at the edge of the Earth's shadow, and its logarithm
bends where the beam grazes a layer.  Steps in which such a change matters are cut again.  In a cut step the density of
g goes exponentially through its two points, with the same sum; a part that begins at the edge of the shadow, found by
bisection, has points spaced like squares from there, because light grows like a square root behind an edge.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from twilight.kernels import njit
from twilight.transport.beam import beam_at, beam_on_ground
from twilight.transport.beam_lookup import AT_DISPERSION
from twilight.transport.lines import ALTITUDE, ANGLE, COSINE, DISTANCE, GAUSS_HIGH, GAUSS_LOW

WORTH = 5e-5
"""Share of a direction's light that a step may be wrong by."""
MOST_PARTS, EDGE_PARTS = 24, 8
"""Parts that a step is cut into, and a piece of one that ends on the shadow's edge."""
_BETWEEN = GAUSS_HIGH - GAUSS_LOW
_EQUAL = np.int64(0)
"""Parts of a step that are equal: no literal, for which numba would compile `_add_part` once more."""


class Directions(NamedTuple):
    """D directions that one looks in, sorted by the ray (elevation) they belong to; R rays.

    first (R + 1,): where those of each ray start; cos_azimuth (D,): of the azimuth from the sun.
    zenith_rad: solar zenith angle at the observer
    """

    first: np.ndarray
    cos_azimuth: np.ndarray
    zenith_rad: float


class Phases(NamedTuple):
    """What each species makes of sunlight in each direction, (Stokes, D, S, W) [sr^-1]: P11, and P12 turned to the
    vertical plane for Q and for U.

    value: with the sun at its true and the ray at its apparent place; of_sun, of_ray: its change per radian by which
    the sun is lifted and the ray is lowered by refraction.
    """

    value: np.ndarray
    of_sun: np.ndarray
    of_ray: np.ndarray


@njit(cache=True, inline="always")
def _cos_sun(angle, to_sun, cos_azimuth):
    """Cosine of the solar zenith angle at a geocentric `angle` [rad] from the start of a ray.

    to_sun (2,): cosine and sine of the solar zenith angle at the start; cos_azimuth: of the ray from the sun.
    """
    return math.cos(angle) * to_sun[0] + math.sin(angle) * to_sun[1] * cos_azimuth


@njit(cache=True)
def _between(place, k, t):
    """(altitude [km], angle [rad], cosine) at the fraction t of the step whose points are k and k + 1."""
    f = (t - GAUSS_LOW) / _BETWEEN
    length = place[k + 1, DISTANCE] - place[k, DISTANCE]
    z0, z1 = place[k, ALTITUDE], place[k + 1, ALTITUDE]
    c0, c1 = place[k, COSINE], place[k + 1, COSINE]
    # the cubic with these altitudes and slopes
    g = 1.0 - f
    bulge = f * g * (g * (length * c0 - (z1 - z0)) + f * (z1 - z0 - length * c1))
    z = z0 + f * (z1 - z0) + bulge
    return z, place[k, ANGLE] + f * (place[k + 1, ANGLE] - place[k, ANGLE]), c0 + f * (c1 - c0)


@njit(cache=True)
def _edge(beam, place, k, low, high, lit_low, to_sun, cos_azimuth, light):
    """Fraction of step k in low..high at which the light begins or ends; lit_low: whether `low` is lit."""
    for _ in range(30):
        t = 0.5 * (low + high)
        z, angle, _ = _between(place, k, t)
        beam_at(beam, z, _cos_sun(angle, to_sun, cos_azimuth), light)
        if (light.max() > 0.0) == lit_low:
            low = t
        else:
            high = t
    return high if not lit_low else low


@njit(cache=True)
def _add_part(
    beam, rays, share, k, begin, end, square, parts, elevation, to_sun, cos_azimuth, phases, d, floor, light, density,
    total,
):  # fmt: skip
    """Add to total (Stokes, W) the light of the piece begin..end (fractions) of the step of points k and k + 1.

    square: 0 for equal parts, -1 where they grow like squares from the begin, 1 from the end; density (W, 2): value at
    the first point and logarithmic slope of g per step; for the others see `scattered_once`.
    """
    place = rays.place
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
                t = begin + (end - begin) * v
            z, angle, cosine = _between(place, k, t)
            lifted = beam_at(beam, z, _cos_sun(angle, to_sun, cos_azimuth), light)
            lowered = elevation - (math.asin(min(1.0, max(-1.0, cosine))) - angle)
            f = (t - GAUSS_LOW) / _BETWEEN
            g = min(1.0, max(0.0, f))
            for w in range(light.size):
                if light[w] > 0.0:
                    strength = width * density[w, 0] * math.exp(density[w, 1] * f) * light[w]
                    for i in range(total.shape[0]):
                        source = 0.0
                        for s in range(share.shape[0]):
                            here = (1.0 - g) * share[s, k, w] + g * share[s, k + 1, w]
                            source += here * _turned(beam, phases, i, d, s, w, lifted, lowered, floor)
                        total[i, w] += strength * source


@njit(cache=True, inline="always")
def _turned(beam, phases, stokes, d, s, w, lifted, lowered, floor):
    """Element `stokes` of the matrix of species s in direction d, sun lifted and ray lowered by so much [rad].

    lifted: at the most refracted wavelength of the beam; at the others by as much less as the air refracts less.
    """
    own = lifted * (1.0 - beam.pool[beam.layout[AT_DISPERSION] + w])
    value = phases.value[stokes, d, s, w] + own * phases.of_sun[stokes, d, s, w]
    value += lowered * phases.of_ray[stokes, d, s, w]
    return max(floor, value) if stokes == 0 else value


@njit(cache=True)
def _densities(weight, k, density):
    """Exponentials through the weights of points k and k + 1 with their sum over the step, into density (W, 2)."""
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


@njit(cache=True, nogil=True)
def scattered_once(beam, rays, share, elevation, directions, phases, floor, ground_km, ground_albedo, out, begin, end):
    """Light scattered once, by air or by the ground in view, added to out (D, Stokes, W) for rays begin..end.

    beam: of :func:`twilight.transport.beam.prepare_beam`; rays: traced with `pairs`
    share (1 + K, P, W): of air and of each aerosol in what the points scatter
    elevation (R,) [rad]: apparent, of each ray; directions: `Directions`; phases: `Phases`
    floor: least value of a phase function
    ground_km: altitude of the ground; ground_albedo (W,)
    """
    n_stokes, n_w = out.shape[1], out.shape[2]
    most = 0
    for r in range(begin, end):
        most = max(most, rays.first[r + 1] - rays.first[r])
    light, logarithm, parts_of = np.empty((most, n_w)), np.empty((most, n_w)), np.empty((n_stokes, most, n_w))
    part = parts_of[0]
    lit = np.empty(most, np.bool_)
    total, piece, at_one = np.empty(n_w), np.empty((n_stokes, n_w)), np.empty(n_w)
    density = np.empty((n_w, 2))
    mark, mark_lit = np.empty(4), np.empty(4, np.bool_)
    to_sun = (math.cos(directions.zenith_rad), math.sin(directions.zenith_rad))
    cos_azimuth = directions.cos_azimuth
    place, weight = rays.place, rays.weight
    for r in range(begin, end):
        k0 = rays.first[r]
        n = rays.first[r + 1] - k0
        for d in range(directions.first[r], directions.first[r + 1]):
            total[:] = 0.0
            for i in range(n):
                k = k0 + i
                lifted = beam_at(beam, place[k, ALTITUDE], _cos_sun(place[k, ANGLE], to_sun, cos_azimuth[d]), light[i])
                lowered = elevation[r] - (math.asin(min(1.0, max(-1.0, place[k, COSINE]))) - place[k, ANGLE])
                lit[i] = False
                for w in range(n_w):
                    logarithm[i, w] = -80.0
                    if light[i, w] > 0.0:
                        lit[i] = True
                        logarithm[i, w] = max(-80.0, math.log(light[i, w]))
                    for stokes in range(n_stokes):
                        source = 0.0
                        if light[i, w] > 0.0:
                            for s in range(share.shape[0]):
                                source += share[s, k, w] * _turned(
                                    beam, phases, stokes, d, s, w, lifted, lowered, floor
                                )
                        parts_of[stokes, i, w] = weight[k, w] * light[i, w] * source
                        out[d, stokes, w] += parts_of[stokes, i, w]
                    total[w] += part[i, w]
            for i in range(0, n, 2):
                k = k0 + i
                before = max(i - 1, 0)
                after = min(i + 2, n - 1)
                some = lit[before] or lit[i] or lit[i + 1] or lit[after]
                if not some:
                    continue
                all_lit = lit[before] and lit[i] and lit[i + 1] and lit[after]
                length = place[k + 1, DISTANCE] - place[k, DISTANCE]
                if length <= 0.0:
                    continue
                error = change = 0.0
                for w in range(n_w):
                    if total[w] <= 0.0:
                        continue
                    here = (logarithm[i + 1, w] - logarithm[i, w]) / length
                    bend = 0.0
                    if before < i:
                        gap = place[k, DISTANCE] - place[k0 + before, DISTANCE]
                        bend = abs((logarithm[i, w] - logarithm[before, w]) / gap - here)
                    if after > i + 1:
                        gap = place[k0 + after, DISTANCE] - place[k + 1, DISTANCE]
                        bend = max(bend, abs((logarithm[after, w] - logarithm[i + 1, w]) / gap - here))
                    bend *= length / _BETWEEN
                    step = abs(here) * length / _BETWEEN
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
                    if wrong > WORTH:
                        change = max(change, max(bend, step))
                if error <= WORTH:
                    continue
                _densities(weight, k, density)
                parts = int(min(MOST_PARTS, 2.0 + math.ceil(4.0 * min(change, 10.0))))
                piece[:] = 0.0
                if all_lit:
                    _add_part(
                        beam, rays, share, k, 0.0, 1.0, _EQUAL, parts, elevation[r], to_sun, cos_azimuth[d], phases, d,
                        floor, at_one, density, piece,
                    )  # fmt: skip
                else:
                    mark[0], mark[1], mark[2], mark[3] = 0.0, GAUSS_LOW, GAUSS_HIGH, 1.0
                    for m in range(4):
                        z, angle, _ = _between(place, k, mark[m])
                        beam_at(beam, z, _cos_sun(angle, to_sun, cos_azimuth[d]), at_one)
                        mark_lit[m] = at_one.max() > 0.0
                    start = 0.0
                    square = 0
                    for m in range(4):
                        if m < 3 and mark_lit[m] == mark_lit[m + 1]:
                            continue
                        stop = 1.0
                        if m < 3:
                            stop = _edge(
                                beam, place, k, mark[m], mark[m + 1], mark_lit[m], to_sun, cos_azimuth[d], at_one
                            )
                        if mark_lit[m] and stop > start:
                            cuts = parts
                            if m < 3 or square != 0:
                                cuts = max(cuts, EDGE_PARTS)
                            _add_part(
                                beam, rays, share, k, start, stop, -1 if square != 0 else (1 if m < 3 else 0), cuts,
                                elevation[r], to_sun, cos_azimuth[d], phases, d, floor, at_one, density, piece,
                            )  # fmt: skip
                        start = stop
                        square = 1
                for stokes in range(n_stokes):
                    for w in range(n_w):
                        coarse = parts_of[stokes, i, w] + parts_of[stokes, i + 1, w]
                        out[d, stokes, w] += piece[stokes, w] - coarse
        if rays.ground_weight[r].max() > 0.0:
            for d in range(directions.first[r], directions.first[r + 1]):
                up = _cos_sun(rays.ground_angle_rad[r], to_sun, cos_azimuth[d])
                beam_on_ground(beam, ground_km, up, at_one)
                for w in range(n_w):
                    out[d, 0, w] += rays.ground_weight[r, w] * ground_albedo[w] / math.pi * at_one[w]
