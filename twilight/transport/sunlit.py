"""Light scattered once, seen along lines of sight: every direction of a ray from few azimuths where that is right.

What the light along one ray is made of, the moments of `sunlit_ray.along`, depends smoothly on the azimuth from the
sun; the phase functions, which do not, are multiplied to it in every direction by itself:

    sum_s (moment 0)_s x p_s(sun lifted, ray lowered by the mean angles of the light that s scatters).

The moments of a ray are a series in azimuth where half its azimuths already tell the rest; where they do
not, for light beyond the edge of the shadow for example, every direction is followed by itself.

Arguments that kernels share: `sunlit_ray`; r: index of a ray; elevation [rad]: its apparent one; directions:
`RayDirections`; n: intervals of a series in azimuth; moments (3, S, W): at one azimuth; cos_azimuth: of the azimuth
from the sun; series: `MomentSeries`.
"""

import math
from typing import NamedTuple

import numpy as np

from twilight.jit.kernels import njit
from twilight.transport.azimuth_series import MOST, at_azimuth, cosine_series, nearest
from twilight.transport.beam import beam_on_ground
from twilight.transport.sunlit_ray import RayView, Workspace, along, cos_sun, refracted_phase

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


class MomentSeries(NamedTuple):
    """The moments along one ray as a series in azimuth.

    values (MOST + 1, 3, S, W): moments at the azimuths; least (S, W): what is added to the light for its logarithm;
    coefficient (MOST + 1, 3 S W); at_one (3 S W,): work space, its sum at one azimuth
    """

    values: np.ndarray
    least: np.ndarray
    coefficient: np.ndarray
    at_one: np.ndarray


@njit(inner=True, cache=True, makes_arrays=False)
def _light_of(air, stokes, d, moments, w):
    """Light of one wavelength in direction d of moments (3, S, W), and the sum of the sizes of its parts.

    stokes: 0, 1 or 2, of I, Q, U.
    """
    total = size = 0.0
    for s in range(moments.shape[1]):
        light = moments[0, s, w]
        if light > 0.0:
            lifted, lowered = moments[1, s, w] / light, moments[2, s, w] / light
            part = light * refracted_phase(air, stokes, d, s, w, lifted, lowered)
            total += part
            size += abs(part)
    return total, size


@njit(inner=True, cache=True)
def _fit(series, n):
    """Fill the coefficients of n intervals for the values at as many of the azimuths.

    What is smooth: the logarithm of the light and a little more, `least`, and the other moments over that.
    """
    values, least = series.values, series.least
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
    cosine_series(form, n, series.coefficient)


@njit(inner=True, cache=True, makes_arrays=False)
def _from_series(series, n, cos_azimuth, moments):
    """Fill the moments at one azimuth from a series of n intervals."""
    least, form = series.least, series.at_one
    at_azimuth(series.coefficient, n, cos_azimuth, form)
    n_s, n_w = least.shape
    for s in range(n_s):
        for w in range(n_w):
            i = s * n_w + w
            light = math.exp(form[i])
            moments[0, s, w] = max(0.0, light - least[s, w])
            moments[1, s, w] = light * form[n_s * n_w + i]
            moments[2, s, w] = light * form[2 * n_s * n_w + i]


@njit(inner=True, cache=True)
def _few_azimuths(air, r, elevation, directions, work, moments, series):
    """Fill the moments along ray r as a series in azimuth; returns its number of intervals, 0 where none was found.

    A set of azimuths is good enough where the set before it, half as many, is right within SERIES_ERROR at the azimuths
    between.  moments: work space.
    """
    first, end = directions.first[r], directions.first[r + 1]
    brightest = np.zeros(series.least.shape[1])
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
            at_node = series.values[j * stride]
            along(air, r, RayView(elevation, to_sun, cos_azimuth), d, work, at_node)
            if n > 2:
                _from_series(series, n // 2, cos_azimuth, moments)
            for w in range(brightest.size):
                light, size = _light_of(air, _INTENSITY, d, at_node, w)
                brightest[w] = max(brightest[w], size)
                if n > 2 and brightest[w] > 0.0:
                    wrong = abs(_light_of(air, _INTENSITY, d, moments, w)[0] - light)
                    error = max(error, wrong / (size + DIM_FRACTION * brightest[w] + air.other[d, w]))
        _fit(series, n)
        if n >= least_intervals and error < SERIES_ERROR:
            return n
        if n > _FIRST_INTERVALS and to_sun[0] > HIGH_SUN_COSINE and error < CERTAIN_ERROR:
            return n
        if n >= 8 and error > HOPELESS_ERROR:
            break
        n *= 2
    return 0


@njit(cache=True, nogil=True)
def scattered_once(air, elevation, directions, ground_km, ground_albedo, out, begin, end):
    """Light scattered once, by air or by the ground in view, added to out (D, Stokes, W) for rays begin..end.

    elevation (R,) [rad]: apparent, of each ray; ground_km: altitude of the ground; ground_albedo (W,)
    """
    rays = air.rays
    n_stokes, n_w = out.shape[1], out.shape[2]
    n_s = air.fraction.shape[0]
    most = 0
    for r in range(begin, end):
        most = max(most, rays.first[r + 1] - rays.first[r])
    work = Workspace(
        np.empty((most, n_w)), np.empty((most, n_w)), np.empty((most, n_w)), np.empty(most, np.bool_),
        np.empty((most, 2)), np.empty(n_w), np.empty(n_w), np.empty((n_w, 2)),
    )  # fmt: skip
    size = 3 * n_s * n_w
    moments = np.empty((3, n_s, n_w))
    series = MomentSeries(
        np.empty((MOST + 1, 3, n_s, n_w)), np.empty((n_s, n_w)), np.empty((MOST + 1, size)), np.empty(size)
    )
    to_sun = (math.cos(directions.zenith_rad), math.sin(directions.zenith_rad))
    for r in range(begin, end):
        n = _few_azimuths(air, r, elevation[r], directions, work, moments, series)
        for d in range(directions.first[r], directions.first[r + 1]):
            cos_azimuth = directions.cos_azimuth[d]
            if n > 0:
                _from_series(series, n, cos_azimuth, moments)
            else:
                along(air, r, RayView(elevation[r], to_sun, cos_azimuth), d, work, moments)
            for stokes in range(n_stokes):
                for w in range(n_w):
                    out[d, stokes, w] += _light_of(air, stokes, d, moments, w)[0]
        if rays.ground_weight[r].max() > 0.0:
            for d in range(directions.first[r], directions.first[r + 1]):
                up = cos_sun(rays.ground_angle_rad[r], to_sun, directions.cos_azimuth[d])
                beam_on_ground(air.beam, ground_km, up, work.at_one)
                for w in range(n_w):
                    out[d, 0, w] += rays.ground_weight[r, w] * ground_albedo[w] / math.pi * work.at_one[w]
