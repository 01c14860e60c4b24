"""Light scattered once, seen along lines of sight: every direction of a ray from few azimuths where that is right.

What the light along one ray is made of, the moments of `sunlit_ray.along`, depends smoothly on the azimuth from the
sun; the phase functions, which do not, are multiplied to it in every direction by itself:

    sum_s (moment 0)_s x p_s(sun lifted, ray lowered by the mean angles of the light that s scatters).

The moments of a ray are a series in azimuth where half its azimuths already tell the rest; where they do
not, for light beyond the edge of the shadow for example, every direction is followed by itself.

Arguments that kernels share: `sunlit_ray`; r: index of a ray; elevation [rad]: its apparent one; directions:
`RayDirections`; n: intervals of a series in azimuth; moments (3, S, W): at one azimuth; cos_azimuth: of the azimuth
from the sun; series: `MomentSeries`.

The direct sun for an observer on the ground, by quadrature along one ray for each wavelength, in numpy alone.

It is what :mod:`twilight.transport.beam` tabulates for every point of the air, found without tables and compiled code.
With the apparent zenith angle i of the sun at radius r_0, x = n r and Bouguer's invariant p = x_0 sin i, the
bending and the optical depth of the ray to space are

    chi - i = - int dln(n)/dx  p dx / sqrt(x^2 - p^2),        tau = int k (dr/dx) x dx / sqrt(x^2 - p^2).

On a fine grid of radii ln(n), r and the mean of k are taken as linear in x from node to node; what is left has the
integrals p arcosh(x/p) and sqrt(x^2 - p^2), exact at the horizon too, where the integrands are infinite.  The ray that
arrives from a true zenith angle chi is found by Newton's method, and

    E/F0 = exp(-tau) n_0^2 sin(i)/sin(chi) / (d chi/d i)

is 0 where chi is larger than that of the horizontal ray: behind the edge of the Earth's shadow.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from twilight.jit.kernels import njit
from twilight.transport.azimuth_series import MOST, at_azimuth, cosine_series, nearest
from twilight.transport.beam import beam_on_ground
from twilight.transport.sunlit_ray import RayView, Workspace, along, cos_sun, refracted_phase

if TYPE_CHECKING:
    from twilight.atmosphere.medium import Medium

FINEST_KM = 0.005
"""Distance of nodes at the ground [km]."""
GROWTH = 0.03
"""By how much of the height the distance of nodes grows."""
STEP_RAD = 1e-5
"""Difference of apparent zenith angles over which d chi/d i is taken [rad]."""
NEWTON_STEPS = 12
"""Newton steps at most for the apparent zenith angle of the sun."""
CLOSE_RAD = 1e-13
"""Newton's method ends when that angle changes by less [rad]."""
HORIZONTAL = 0.5 * math.pi
"""Zenith angle of a level ray [rad]."""


class GroundSun:
    """The rays from the ground of a medium to space, asked for the sun at any elevation."""

    def __init__(self, medium: Medium):
        low, high = medium.bottom_km, medium.top_km
        height = [0.0]
        while low + height[-1] < high:
            height.append(height[-1] + FINEST_KM + GROWTH * height[-1])
        z = np.unique(np.clip(np.concatenate([low + np.array(height), medium.altitude_km]), low, high))
        # the two Gauss points between nodes, none of which lies on a jump
        between = 0.5 * np.diff(z)[:, None] * (1.0 + np.array([-1.0, 1.0]) / math.sqrt(3.0)) + z[:-1, None]
        per_km = medium.at(between).extinction.mean(axis=1)
        index = 1.0 + medium.at(z).refractivity
        radius = medium.earth_radius_km + z
        x = index * radius[:, None]
        rise = np.diff(x, axis=0)
        self._x = x
        self._log_index_slope = -np.diff(np.log(index), axis=0) / rise
        self._per_x = per_km * np.diff(radius)[:, None] / rise
        self._overhead = medium.overhead_absorption_optical_depth
        self._index = index[0]
        self._screen = medium.screen
        self._altitude_km, self._wavelength_nm = z, medium.wavelength_nm

    def _chi(self, apparent: np.ndarray) -> np.ndarray:
        """True zenith angle (W,) [rad] of the rays under apparent ones (W,)."""
        p = self._x[0] * np.sin(apparent)
        safe = np.maximum(p, 1e-9)
        turned = safe * np.arccosh(np.maximum(self._x / safe, 1.0))
        return apparent + (self._log_index_slope * np.diff(turned, axis=0)).sum(axis=0)

    def at(self, sun_elevation_deg: float) -> tuple[np.ndarray, float]:
        """(irradiance at normal incidence over F0 (W,), bending [deg] at the most refracted wavelength; 0 in the dark).

        sun_elevation_deg: true elevation.
        """
        chi = math.radians(90.0 - sun_elevation_deg)
        i = np.full(self._index.size, min(chi, HORIZONTAL))
        lit = self._chi(np.full(i.size, HORIZONTAL)) >= chi
        if not lit.any():
            return np.zeros(i.size), 0.0
        for _ in range(NEWTON_STEPS):
            last, i = i, np.clip(i + (chi - self._chi(i)) / self._slope(i), 0.0, HORIZONTAL)
            if np.abs(i - last).max() < CLOSE_RAD:
                break
        spread = self._index**2 / self._slope(i)
        if chi > 1e-4:
            spread *= np.sin(i) / math.sin(chi)
        else:
            spread /= self._slope(i)  # sin(i)/sin(chi) of two small angles
        p = self._x[0] * np.sin(i)
        path = np.diff(np.sqrt(np.maximum(self._x**2 - p**2, 0.0)), axis=0)
        depth = (self._per_x * path).sum(axis=0) + self._overhead
        most = int(np.argmax(self._index))
        passed = self._passed(p, self._x[0] * np.cos(i))
        return np.where(lit, spread * np.exp(-depth) * passed, 0.0), float(np.degrees(max(0.0, chi - i[most])))

    def _passed(self, p: np.ndarray, u: np.ndarray) -> np.ndarray:
        """What a screen beyond the horizon lets pass (W,), of rays from above (`beam_screen`)."""
        if self._screen is None:
            return np.ones(p.size)
        x = np.hypot(p, u + self._screen.from_km)
        lowest = [np.interp(xx, column, self._altitude_km) for xx, column in zip(x, self._x.T, strict=True)]
        return self._screen.at(np.array(lowest)) ** self._screen.powers(self._wavelength_nm)

    def _slope(self, apparent: np.ndarray) -> np.ndarray:
        """d chi/d i, from angles on the near side of the horizontal."""
        upper = np.minimum(apparent + 0.5 * STEP_RAD, HORIZONTAL)
        return (self._chi(upper) - self._chi(upper - STEP_RAD)) / STEP_RAD


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
