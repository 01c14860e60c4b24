"""Light scattered once, seen along lines of sight: every direction of a ray from few azimuths where that is right.

What the light along one ray is made of, the moments of `sunlit_ray.along`, depends smoothly on the azimuth from the
sun; the phase functions, which do not, are multiplied to it in every direction by itself:

    sum_s (moment 0)_s x p_s(sun lifted, ray lowered by the mean angles of the light that s scatters).

The moments of a ray are a series in azimuth (`around`) where half its azimuths already tell the rest; where they do
not, for light beyond the edge of the shadow for example, every direction is followed by itself.

Arguments that kernels share: `sunlit_ray`; r: index of a ray; elevation [rad]: its apparent one; directions:
`Directions`; n: intervals of a series in azimuth; values (MOST + 1, 3, S, W): moments at the azimuths, moments (3, S,
W): at one; cos_azimuth: of the azimuth from the sun; least (S, W): what is added to the light; series (MOST + 1, 3 S
W): coefficients; room: `Room`.
"""

from __future__ import annotations

import math

import numpy as np

from twilight.jit.kernels import njit
from twilight.transport.azimuth_series import MOST, at_azimuth, cosine_series, nearest
from twilight.transport.beam import beam_on_ground
from twilight.transport.sunlit_ray import Room, Row, along, cos_sun, turned

SERIES_ERROR = 3e-4
"""How wrong a series from half the azimuths may be for the series from all of them to be taken, as a fraction of all
light in the direction: the sum over points is itself rough to some 1e-4 from one direction to the next."""
DIM_FRACTION = 1e-3
"""Fraction of the brightest azimuth's light that counts as light of every azimuth when errors are judged."""
LEAST_INTERVALS_BY_DAY = 8
"""Fewest intervals of a series with the sun above the horizon: with fewer, azimuths between happen to be right."""
LEAST_INTERVALS_IN_TWILIGHT = 16
"""Fewest intervals of a series with the sun below the horizon, where azimuths between happen to be right more often."""
CERTAIN_ERROR = 3e-5
"""Error of a series with which the next is taken, however few its intervals, where the sun stands high: there azimuths
between are not right to this by accident."""
HIGH_SUN_COSINE = 0.035
"""Cosine of the solar zenith angle from which on the sun stands high, 2 deg above the horizon: nearer to it series of
four intervals were 4e-4 off in dust, above by 4e-5 at most."""
HOPELESS_ERROR = 0.1
"""Error, from nine azimuths on, that more azimuths will not mend: every direction is then followed by itself."""
FLOOR_FRACTION = 1e-3
"""What is added to the light for its logarithm, as a fraction of the most light at any azimuth."""
FLOOR_LEAST = 1e-100
"""The least that is added to the light for its logarithm [km^-1]."""
_INTENSITY = np.int64(0)
"""Stokes element I: no literal, for which numba would compile what it is handed to once more."""
_FIRST_INTERVALS = np.int64(2)
"""Intervals of the first series that is tried: no literal, as _INTENSITY."""


@njit(inner=True, cache=True)
def _seen(beam, phases, stokes, d, floor, moments, w):
    """Light of one wavelength in direction d of moments (3, S, W), and the sum of the sizes of its parts.

    stokes: 0, 1 or 2, of I, Q, U.
    """
    total = size = 0.0
    for s in range(moments.shape[1]):
        light = moments[0, s, w]
        if light > 0.0:
            lifted, lowered = moments[1, s, w] / light, moments[2, s, w] / light
            part = light * turned(beam, phases, stokes, d, s, w, lifted, lowered, floor)
            total += part
            size += abs(part)
    return total, size


@njit(inner=True, cache=True)
def _series_of(values, n, least, series):
    """The series of n intervals for moments (MOST + 1, 3, S, W) at as many of the azimuths, into series (., 3 S W).

    What is smooth: the logarithm of the light and a little more, least (S, W), and the other moments over that.
    """
    stride = MOST // n
    n_s, n_w = least.shape
    form = np.empty((n + 1, 3 * n_s * n_w))
    for s in range(n_s):
        for w in range(n_w):
            most = 0.0
            for j in range(n + 1):
                most = max(most, values[j * stride, 0, s, w])
            least[s, w] = max(FLOOR_FRACTION * most, FLOOR_LEAST)
            i = s * n_w + w
            for j in range(n + 1):
                light = values[j * stride, 0, s, w] + least[s, w]
                form[j, i] = math.log(light)
                form[j, n_s * n_w + i] = values[j * stride, 1, s, w] / light
                form[j, 2 * n_s * n_w + i] = values[j * stride, 2, s, w] / light
    cosine_series(form, n, series)


@njit(inner=True, cache=True)
def _from_series(series, n, least, cos_azimuth, form, moments):
    """Moments (3, S, W) at one azimuth; form (3 S W,): room."""
    at_azimuth(series, n, cos_azimuth, form)
    n_s, n_w = least.shape
    for s in range(n_s):
        for w in range(n_w):
            i = s * n_w + w
            light = math.exp(form[i])
            moments[0, s, w] = max(0.0, light - least[s, w])
            moments[1, s, w] = light * form[n_s * n_w + i]
            moments[2, s, w] = light * form[2 * n_s * n_w + i]


@njit(inner=True, cache=True)
def _few_azimuths(
    beam, rays, fraction, r, elevation, directions, phases, floor, other, room, moments, values, least, series
):  # fmt: skip
    """The moments along ray r as a series in azimuth; returns its number of intervals, 0 where none was found.

    values (MOST + 1, 3, S, W): room; least (S, W), series (MOST + 1, 3 S W): filled, as of `_series_of`.  A set of
    azimuths is good enough where the set before it, half as many, is right within SERIES_ERROR at the azimuths between.
    other (D, W): light that is there besides.
    """
    first, end = directions.first[r], directions.first[r + 1]
    form, brightest = np.empty(series.shape[1]), np.zeros(least.shape[1])
    to_sun = (math.cos(directions.zenith_rad), math.sin(directions.zenith_rad))
    least_intervals = LEAST_INTERVALS_BY_DAY if to_sun[0] > 0.0 else LEAST_INTERVALS_IN_TWILIGHT
    # fewer directions than a series takes
    n = _FIRST_INTERVALS if end - first > least_intervals + 1 else MOST + 1
    while n <= MOST and n + 1 < end - first:
        stride = MOST // n
        error = 0.0
        for j in range(n + 1):
            if n > 2 and j % 2 == 0:
                continue
            cos_azimuth = math.cos(math.pi * j / n)
            d = nearest(directions.cos_azimuth, first, end, cos_azimuth)
            row = Row(elevation, to_sun, cos_azimuth)
            here = values[j * stride]
            along(beam, rays, fraction, r, row, phases, d, floor, other, room, here)
            if n > 2:
                _from_series(series, n // 2, least, cos_azimuth, form, moments)
            for w in range(brightest.size):
                light, size = _seen(beam, phases, _INTENSITY, d, floor, here, w)
                brightest[w] = max(brightest[w], size)
                if n > 2 and brightest[w] > 0.0:
                    wrong = abs(_seen(beam, phases, _INTENSITY, d, floor, moments, w)[0] - light)
                    error = max(error, wrong / (size + DIM_FRACTION * brightest[w] + other[d, w]))
        _series_of(values, n, least, series)
        if n >= least_intervals and error < SERIES_ERROR:
            return n
        if n > _FIRST_INTERVALS and to_sun[0] > HIGH_SUN_COSINE and error < CERTAIN_ERROR:
            return n
        if n >= 8 and error > HOPELESS_ERROR:
            break
        n *= 2
    return 0


@njit(cache=True, nogil=True)
def scattered_once(
    beam, rays, fraction, elevation, directions, phases, floor, other, ground_km, ground_albedo, out, begin, end
):  # fmt: skip
    """Light scattered once, by air or by the ground in view, added to out (D, Stokes, W) for rays begin..end.

    beam: of :func:`twilight.transport.beam.prepare_beam`; rays: traced with `pairs`
    fraction (1 + K, P, W): of air and of each aerosol in what the points scatter
    elevation (R,) [rad]: apparent, of each ray; directions: `Directions`; phases: `Phases`
    floor: least value of a phase function; other (D, W): light that is there besides, of which errors are fractions too
    ground_km: altitude of the ground; ground_albedo (W,)
    """
    n_stokes, n_w = out.shape[1], out.shape[2]
    n_s = fraction.shape[0]
    most = 0
    for r in range(begin, end):
        most = max(most, rays.first[r + 1] - rays.first[r])
    room = Room(
        np.empty((most, n_w)), np.empty((most, n_w)), np.empty((most, n_w)), np.empty(most, np.bool_),
        np.empty((most, 2)), np.empty(n_w), np.empty(n_w), np.empty((n_w, 2)),
    )  # fmt: skip
    moments, form = np.empty((3, n_s, n_w)), np.empty(3 * n_s * n_w)
    values, series = np.empty((MOST + 1, 3, n_s, n_w)), np.empty((MOST + 1, form.size))
    least = np.empty((n_s, n_w))
    to_sun = (math.cos(directions.zenith_rad), math.sin(directions.zenith_rad))
    for r in range(begin, end):
        n = _few_azimuths(
            beam, rays, fraction, r, elevation[r], directions, phases, floor, other, room, moments, values, least,
            series,
        )  # fmt: skip
        for d in range(directions.first[r], directions.first[r + 1]):
            cos_azimuth = directions.cos_azimuth[d]
            if n > 0:
                _from_series(series, n, least, cos_azimuth, form, moments)
            else:
                row = Row(elevation[r], to_sun, cos_azimuth)
                along(beam, rays, fraction, r, row, phases, d, floor, other, room, moments)
            for stokes in range(n_stokes):
                for w in range(n_w):
                    out[d, stokes, w] += _seen(beam, phases, stokes, d, floor, moments, w)[0]
        if rays.ground_weight[r].max() > 0.0:
            for d in range(directions.first[r], directions.first[r + 1]):
                up = cos_sun(rays.ground_angle_rad[r], to_sun, directions.cos_azimuth[d])
                beam_on_ground(beam, ground_km, up, room.at_one)
                for w in range(n_w):
                    out[d, 0, w] += rays.ground_weight[r, w] * ground_albedo[w] / math.pi * room.at_one[w]
