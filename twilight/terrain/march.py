"""Lines of sight and sunbeams over a field of heights.

Places are distances along the sphere from the observer, x to the right of the sun and y towards it.  A straight line
that leaves altitude h [km] under the elevation a is, after the distance s, at the altitude

    z = h + (2 (R + h) s sin a + s^2) / (sqrt(...) + R + h)

above the place atan2(s cos a, R + h + s sin a) R away.  The shadow of the terrain is a field of its own: over a place,
air lower than

    shadow = max over t of [height(place + t towards the sun) - t tan e - t^2 / 2 R]

does not see the sun, e its apparent elevation there (the sun's bends are those of the light that passes the place).
Mountains far beyond the horizon towards the sun are in it like any others.

Arguments that the kernels share: field: `Heights`; radius_km: the Earth's; start_km: altitude of the observer; x, y
[km]: of a place, along the ground to the right of the sun's azimuth and towards it; lines: `Lines`; (begin, end): the
first row and the one after the last.
"""

import math
from typing import NamedTuple

import numpy as np

from twilight.jit.kernels import njit
from twilight.transport.beam import beam_at

SHADOW_STEP = 0.5
"""Steps towards the sun near a place, over a cell of the field; they grow with the distance."""
SHADOW_GROWTH = 0.002
"""Length of a step towards the sun over the distance from the place."""
NOTHING_KM = -1e9
"""Altitude that stands for no ground and no shadow [km]."""
BEYOND_KM = -1e8
"""Lower altitudes than this are beyond the field [km]."""
MOST_STEPS = 20_000
"""Bound on the steps of a search along a line: after so many it has grown by exp(0.002 x 19,500), past any length."""


@njit(cache=True, inline="always")
def bilinear(z, u, v):
    """z (rows, columns) at the place (u, v), column u and row v; far below beyond its edges and beside gaps."""
    rows, columns = z.shape
    if not (0.0 <= u <= columns - 1.0 and 0.0 <= v <= rows - 1.0):
        return NOTHING_KM
    i, j = min(int(v), rows - 2), min(int(u), columns - 2)
    if min(min(z[i, j], z[i, j + 1]), min(z[i + 1, j], z[i + 1, j + 1])) < BEYOND_KM:
        return NOTHING_KM
    f, g = v - i, u - j
    return (1 - f) * ((1 - g) * z[i, j] + g * z[i, j + 1]) + f * ((1 - g) * z[i + 1, j] + g * z[i + 1, j + 1])


@njit(cache=True, inline="always")
def height_at(field, x, y):
    """Altitude [km] of the ground at a place [km], bilinear; far below beyond the field."""
    u = (field.cos_turn * x - field.sin_turn * y - field.low_x_km) / field.step_x_km
    v = (field.sin_turn * x + field.cos_turn * y - field.low_y_km) / field.step_y_km
    return bilinear(field.altitude_km, u, v)


class Lines(NamedTuple):
    """Straight lines from the observer: elevation, azimuth (D,) [rad], azimuth from the sun to the right; far_km (D,):
    how far they go."""

    radius_km: float
    start_km: float
    elevation: np.ndarray
    azimuth: np.ndarray
    far_km: np.ndarray


@njit(inner=True, cache=True)
def place_on(start_km, radius_km, sine, cosine, s):
    """(altitude [km], distance along the sphere [km]) after s km of a line from altitude start_km above the sphere.

    sine, cosine: of the line's elevation at its start; s [km].
    """
    r = radius_km + start_km
    change = s * (2.0 * r * sine + s)
    altitude = start_km + change / (math.sqrt(r * r + change) + r)
    return altitude, radius_km * math.atan2(s * cosine, r + s * sine)


@njit(cache=True)
def first_hits(field, bottom_km, lines, out, begin, end):
    """Distance [km] of the ground along lines, into out (D,); inf: there is none.

    bottom_km: altitude of the ground beyond the field.
    """
    radius_km, start_km, elevation, azimuth, far_km = lines
    finest = 0.5 * min(field.step_x_km, field.step_y_km)
    for d in range(begin, end):
        sine, cosine = math.sin(elevation[d]), math.cos(elevation[d])
        sine_azimuth, cosine_azimuth = math.sin(azimuth[d]), math.cos(azimuth[d])
        out[d] = np.inf
        s, before = 0.0, 0.0
        for _ in range(MOST_STEPS):
            if s >= far_km[d]:
                break
            s += max(finest, 0.002 * s)
            z, along = place_on(start_km, radius_km, sine, cosine, s)
            if z > field.highest_km and sine >= 0.0:
                break
            if max(bottom_km, height_at(field, along * sine_azimuth, along * cosine_azimuth)) > z:
                low, high = before, s
                for _halving in range(24):
                    middle = 0.5 * (low + high)
                    z, along = place_on(start_km, radius_km, sine, cosine, middle)
                    if max(bottom_km, height_at(field, along * sine_azimuth, along * cosine_azimuth)) > z:
                        high = middle
                    else:
                        low = middle
                out[d] = high
                break
            before = s


@njit(cache=True)
def shadow_over(field, radius_km, x, y, sun):
    """Altitude [km] below which the air over a place does not see the sun; sun: apparent elevation at the origin."""
    slope = math.tan(sun + y / radius_km)
    finest = SHADOW_STEP * min(field.step_x_km, field.step_y_km)
    highest = NOTHING_KM
    rows, columns = field.altitude_km.shape
    across, up = field.step_x_km * (columns - 1), field.step_y_km * (rows - 1)
    # the field's circle around its middle, in the axes of the sun
    circle_km = 0.5 * math.sqrt(across * across + up * up)
    u, v = field.low_x_km + 0.5 * across, field.low_y_km + 0.5 * up
    middle_x, middle_y = field.cos_turn * u + field.sin_turn * v, -field.sin_turn * u + field.cos_turn * v
    if abs(x - middle_x) > circle_km:
        return highest
    t = max(finest, middle_y - circle_km - y)
    last = middle_y + circle_km - y
    for _ in range(MOST_STEPS):
        if t >= last:
            break
        z = height_at(field, x, y + t)
        if z > BEYOND_KM:
            highest = max(highest, z - t * slope - t * t / (2.0 * radius_km))
        t += max(finest, SHADOW_GROWTH * t)
    return highest


@njit(cache=True)
def shadow_field(field, radius_km, sun, x, y, out, begin, end):
    """`shadow_over` at places x (M,) and y (N,), rows begin..end of out (N, M)."""
    for i in range(begin, end):
        for j in range(x.size):
            out[i, j] = shadow_over(field, radius_km, x[j], y[i], sun)


@njit(cache=True, inline="always")
def neighbour(field, x, y, here):
    """Altitude [km] of the ground at a place [km]; beyond the field `here`, that of the place beside it."""
    z = height_at(field, x, y)
    return here if z < BEYOND_KM else z


@njit(inner=True, cache=True)
def slopes(field, x, y, step_km):
    """Rise of the ground per km to the right and towards the sun at a place; step_km: between the places compared."""
    height = height_at(field, x, y)
    rise_x = neighbour(field, x + step_km, y, height) - neighbour(field, x - step_km, y, height)
    rise_y = neighbour(field, x, y + step_km, height) - neighbour(field, x, y - step_km, height)
    return rise_x / (2.0 * step_km), rise_y / (2.0 * step_km)


class TerrainAir(NamedTuple):
    """What lines of sight need of the air, at altitudes step_km apart from bottom_km on.

    extinction (Z, W), scattering (S, Z, W) [km^-1]: of air and each aerosol, forward peaks counted as passed.
    """

    bottom_km: float
    step_km: float
    extinction: np.ndarray
    scattering: np.ndarray


class SunlightSums(NamedTuple):
    """Sums over the parts of lines, into whole, dark (D, S, W) [1] for lines with a shadow on them, for all where
    `every` is set; length (D,) [km]: of the dark parts; steps: parts of each line."""

    whole: np.ndarray
    dark: np.ndarray
    length: np.ndarray
    steps: int
    every: bool


class ShadowGrid(NamedTuple):
    """`shadow_over` on a grid: altitude_km (N, M) at rows low_y_km + i step_km, columns low_x_km + j step_km."""

    altitude_km: np.ndarray
    low_x_km: float
    low_y_km: float
    step_km: float
    highest_km: float


@njit(cache=True, inline="always")
def shadow_at(shadow, x, y):
    """The shadow's altitude [km] over a place, bilinear; none beyond its grid.  shadow: `ShadowGrid`."""
    u, v = (x - shadow.low_x_km) / shadow.step_km, (y - shadow.low_y_km) / shadow.step_km
    return bilinear(shadow.altitude_km, u, v)


@njit(inner=True, cache=True)
def dark_fractions(shadow, radius_km, start_km, sine, cosine, sine_azimuth, cosine_azimuth, ds, fraction):
    """The fraction of every step of a line that lies in shadow, into fraction (N,); returns the dark length [km].

    The edge of the shadow is found by linear interpolation within a step of ds [km].  shadow: `ShadowGrid`; sine,
    cosine: of the line's elevation; sine_azimuth, cosine_azimuth: of its azimuth from the sun.
    """
    z, along = place_on(start_km, radius_km, sine, cosine, 0.0)
    above = z - shadow_at(shadow, 0.0, 0.0)
    length = 0.0
    for n in range(fraction.size):
        z, along = place_on(start_km, radius_km, sine, cosine, (n + 1) * ds)
        after = z - shadow_at(shadow, along * sine_azimuth, along * cosine_azimuth)
        fraction[n] = 0.0
        if above < 0.0 and after < 0.0:
            fraction[n] = 1.0
        elif above < 0.0:
            fraction[n] = above / (above - after)
        elif after < 0.0:
            fraction[n] = after / (after - above)
        above = after
        length += fraction[n] * ds
    return length


@njit(cache=True)
def sunlight_on_lines(shadow, air, beam, lines, to_sun, sums, begin, end):
    """Sunlight that each species would scatter once towards the eye along lines, without its phase function.

        whole = sum over steps of ds sigma_s E exp(-depth),      dark: the same over the parts that lie in shadow.

    shadow: `ShadowGrid`; air: `TerrainAir`; beam: `Beam`; to_sun (2,): sine and cosine of the sun's true elevation at
    the observer; sums: `SunlightSums`.
    """
    radius_km, start_km, elevation, azimuth, end_km = lines
    whole, dark, length, steps, every = sums
    n_w = whole.shape[2]
    light, depth = np.empty(n_w), np.empty(n_w)
    fraction = np.empty(steps)
    for d in range(begin, end):
        sine, cosine = math.sin(elevation[d]), math.cos(elevation[d])
        sine_azimuth, cosine_azimuth = math.sin(azimuth[d]), math.cos(azimuth[d])
        ds = end_km[d] / steps
        length[d] = dark_fractions(
            shadow, radius_km, start_km, sine, cosine, sine_azimuth, cosine_azimuth, ds, fraction
        )
        if length[d] == 0.0 and not every:
            continue
        depth[:] = 0.0
        for n in range(steps):
            z, along = place_on(start_km, radius_km, sine, cosine, (n + 0.5) * ds)
            u = (z - air.bottom_km) / air.step_km
            k = min(max(int(u), 0), air.extinction.shape[0] - 2)
            f = min(1.0, max(0.0, u - k))
            psi = along / radius_km
            beam_at(beam, z, math.cos(psi) * to_sun[0] + math.sin(psi) * to_sun[1] * cosine_azimuth, light)
            for w in range(n_w):
                segment_depth = ds * ((1 - f) * air.extinction[k, w] + f * air.extinction[k + 1, w])
                arriving = ds * light[w] * math.exp(-depth[w] - 0.5 * segment_depth)
                for s in range(whole.shape[1]):
                    scattered = arriving * ((1 - f) * air.scattering[s, k, w] + f * air.scattering[s, k + 1, w])
                    whole[d, s, w] += scattered
                    dark[d, s, w] += fraction[n] * scattered
                depth[w] += segment_depth


@njit(cache=True)
def lit_ground(field, beam, lines, sun, true_sun, direct, about, begin, end):
    """The sun's irradiance of the ground where lines (D,) end, over F0, direct (D, W).

    sun, true_sun [rad]: apparent and true elevation at the observer; about (D, 3): cosine of the slope of the ground,
    how far towards the sun it lies [km], and whether it is within the field.  direct (D, W): filled where the sun
    reaches the ground; beam: `Beam`.
    """
    radius_km, start_km, elevation, azimuth, far_km = lines
    step = 0.75 * min(field.step_x_km, field.step_y_km)
    light = np.empty(direct.shape[1])
    for d in range(begin, end):
        z, along = place_on(start_km, radius_km, math.sin(elevation[d]), math.cos(elevation[d]), far_km[d])
        x, y = along * math.sin(azimuth[d]), along * math.cos(azimuth[d])
        rise_x, rise_y = slopes(field, x, y, step)
        about[d, 0] = 1.0 / math.sqrt(1.0 + rise_x * rise_x + rise_y * rise_y)
        about[d, 1] = y
        about[d, 2] = height_at(field, x, y) > BEYOND_KM
        local = sun + y / radius_km
        incidence = (math.sin(local) - rise_y * math.cos(local)) * about[d, 0]
        # a cell is no sharper than its size: its own slope does not shade it
        if incidence > 0.0 and z + 0.02 * step > shadow_over(field, radius_km, x, y, sun):
            beam_at(beam, z, math.sin(true_sun + y / radius_km), light)
            for w in range(light.size):
                direct[d, w] = incidence * light[w]
