"""Lines through shells: chords of the refracted ray, and the steps in which a chord crosses the air.

Where the refractive index n falls with altitude, a ray curves towards the Earth.  With i its angle to the vertical, its
direction turns in the vertical plane by

    d(omega) / ds = -(dn / dr) sin(i) / n                                   (Bouguer: n r sin(i) is constant),

followed here by the midpoint rule: a *chord* has the direction half-way, and leaves the ray by less than a sag that the
caller sets.  Along a ray L / n^2 is constant, so light from where the index is n counts (n_start / n)^2 at the start.
The reference of the Stokes vector turns with the ray, in its plane: nothing rotates about the ray.

Arguments that kernels share: `kernel`.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from twilight.kernels import njit
from twilight.solvers.montecarlo.air import locate, shell_of
from twilight.solvers.montecarlo.kernel import INNER

# columns of a chord, and places in an array that describes a ray: a point of it [km], unit vectors
ORIGIN, DIRECTION, REFERENCE = 0, 3, 6
CHORD_COLUMNS = 9
REFERENCE_RADIUS_KM = 6371.0
"""Lengths below are for a planet of this radius, and grow with the planet."""
CHORD_KM, CHORD_PER_HEIGHT = 40.0, 3.0
RISE_KM, RISE_PER_HEIGHT = 4.0, 0.35
"""Longest chord and largest rise along one: at the ground, and for every km above it."""
STEEP_RISE_KM = 10.0
STEEP = 0.25
"""Lines with a larger cosine to the vertical bend so little that chords may rise by STEEP_RISE_KM at the least."""
LEAST_CURVATURE = 1e-10
"""Turning [rad km^-1] below which a climbing ray is straight from there on."""
LONGEST_KM = 2e4
SMOOTH = 0.2
"""A secant counts as a parabola where the square of the cosine changes by less than this from the middle of a layer."""


@njit(inline="always", **INNER)
def altitude_at(z, r, mu, s):
    """Altitude [km] at the distance s [km] of a line.

    z, r [km]: altitude and radius where it starts; mu: its cosine to the vertical there.
    """
    q = s * (s + 2.0 * r * mu)
    return z + q / (r + math.sqrt(max(0.0, r * r + q)))


@njit(inline="always", **INNER)
def distance_up(z, r, mu, z_shell):
    """Distance [km] to a sphere above along a line that climbs, or has mu < 0 and passes its lowest point first.

    z, r [km]: altitude and radius where the line starts; mu: its cosine to the vertical there; z_shell [km]: the
    sphere's altitude.
    """
    c = (z_shell - z) * (z_shell - z + 2.0 * r)
    b = r * mu
    d = math.sqrt(max(0.0, c + b * b))
    if b > 0.0:
        return c / (b + d) if c > 0.0 else 0.0
    return d - b


@njit(inline="always", **INNER)
def distance_down(z, r, mu, z_shell):
    """Distance [km] to a sphere below along a falling line, or -1 if the line does not reach it.

    z, r [km]: altitude and radius where the line starts; mu: its cosine to the vertical there, negative; z_shell [km]:
    the sphere's altitude.
    """
    c = (z - z_shell) * (2.0 * r + z_shell - z)
    b = -r * mu
    d2 = b * b - c
    if d2 < 0.0:
        return -1.0
    return c / (b + math.sqrt(d2))


@njit(**INNER)
def refractivity_at(air, w, altitude):
    """n - 1 at an altitude [km], 0 above the air.

    altitude [km]; air, w: as everywhere.
    """
    last = air.level_km.size - 1
    if altitude >= air.level_km[last]:
        return 0.0
    i, f = locate(air, altitude, 0, last)
    return air.refractivity[w, i] * (1.0 - f) + air.refractivity[w, i + 1] * f


@njit(inline="always", **INNER)
def refractivity_on_ray(air, w, ray):
    """n - 1 at the start of a ray (9,), that of the ground below it."""
    x, y, z = ray[ORIGIN], ray[ORIGIN + 1], ray[ORIGIN + 2]
    return refractivity_at(air, w, max(air.shell_km[0], math.sqrt(x * x + y * y + z * z) - air.earth_radius_km))


@njit(inline="always", **INNER)
def relative_index(refractivity, i, f, at_start):
    """(n_start / n)^2; refractivity (N,) of one wavelength, (i, f) a place among the levels, at_start: n_start - 1."""
    nu = refractivity[i] * (1.0 - f) + refractivity[i + 1] * f
    ratio = (1.0 + at_start) / (1.0 + nu)
    return ratio * ratio


@njit(**INNER)
def curvature(air, w, altitude, sine):
    """Turning [rad km^-1] of a ray towards the Earth.

    altitude [km]: where; sine: of the ray's angle to the vertical.
    """
    last = air.level_km.size - 1
    if altitude >= air.level_km[last]:
        return 0.0
    i, f = locate(air, altitude, 0, last)
    lower = air.refractivity[w, i]
    change = air.refractivity[w, i + 1] - lower
    return -change * air.per_km[i] * sine / (1.0 + lower + f * change)


@njit(inner=True, **INNER)
def turn_down(ray, r, mu, angle):
    """Turn the direction and the reference of a ray (9,) towards the Earth by an angle [rad], in the vertical plane.

    r [km]: radius of its point; mu: cosine of the direction to the vertical there.
    """
    sine = math.sqrt(max(0.0, (1.0 - mu) * (1.0 + mu)))
    if sine < 1e-9:
        return
    per = 1.0 / sine
    # t: the unit vector normal to the direction, in the plane, on the side of the Earth
    tx = (mu * ray[DIRECTION] - ray[ORIGIN] / r) * per
    ty = (mu * ray[DIRECTION + 1] - ray[ORIGIN + 1] / r) * per
    tz = (mu * ray[DIRECTION + 2] - ray[ORIGIN + 2] / r) * per
    c = math.cos(angle)
    s = math.sin(angle)
    along = ray[REFERENCE] * tx + ray[REFERENCE + 1] * ty + ray[REFERENCE + 2] * tz
    a = along * (c - 1.0)
    b = -along * s
    ray[REFERENCE] += a * tx + b * ray[DIRECTION]
    ray[REFERENCE + 1] += a * ty + b * ray[DIRECTION + 1]
    ray[REFERENCE + 2] += a * tz + b * ray[DIRECTION + 2]
    ray[DIRECTION] = c * ray[DIRECTION] + s * tx
    ray[DIRECTION + 1] = c * ray[DIRECTION + 1] + s * ty
    ray[DIRECTION + 2] = c * ray[DIRECTION + 2] + s * tz


class Chord(NamedTuple):
    """Scalars of one chord: altitude and radius of its start [km], cosine to the vertical there, length [km] (1e9 for a
    straight line), and half the angle [rad] by which the ray turns along it."""

    altitude: float
    radius: float
    mu: float
    length: float
    half_turn: float


@njit(inner=True, **INNER)
def begin_chord(air, w, bent, sag_km, ray):
    """The chord that begins at a ray (9,), whose direction becomes the chord's.

    bent: follow the refracted ray; sag_km: how far the chord may leave it.
    """
    r = math.sqrt(ray[ORIGIN] * ray[ORIGIN] + ray[ORIGIN + 1] * ray[ORIGIN + 1] + ray[ORIGIN + 2] * ray[ORIGIN + 2])
    mu = (
        ray[ORIGIN] * ray[DIRECTION] + ray[ORIGIN + 1] * ray[DIRECTION + 1] + ray[ORIGIN + 2] * ray[DIRECTION + 2]
    ) / r
    z = max(r - air.earth_radius_km, air.level_km[0])
    if not bent:
        return Chord(z, r, mu, 1e9, 0.0)
    scale = air.earth_radius_km / REFERENCE_RADIUS_KM
    sine = math.sqrt(max(0.0, (1.0 - mu) * (1.0 + mu)))
    here = curvature(air, w, z, sine)
    if mu > 0.0 and abs(here) < LEAST_CURVATURE / scale:
        return Chord(z, r, mu, 1e9, 0.0)
    height = z - air.level_km[0]
    rise = max((RISE_KM if abs(mu) < STEEP else STEEP_RISE_KM) * scale, RISE_PER_HEIGHT * height)
    length = CHORD_KM * scale + CHORD_PER_HEIGHT * height
    if abs(mu) * length > rise:
        length = rise / abs(mu)
    if abs(here) * length * length > 8.0 * sag_km:
        length = math.sqrt(8.0 * sag_km / abs(here))
    middle = altitude_at(z, r, mu, 0.5 * length)
    half_turn = 0.5 * length * curvature(air, w, middle, sine * r / (air.earth_radius_km + middle))
    turn_down(ray, r, mu, half_turn)
    mu = (
        ray[ORIGIN] * ray[DIRECTION] + ray[ORIGIN + 1] * ray[DIRECTION + 1] + ray[ORIGIN + 2] * ray[DIRECTION + 2]
    ) / r
    return Chord(z, r, mu, length, half_turn)


@njit(inner=True, **INNER)
def end_chord(chord, ray):
    """Move a ray (9,) from the start of a chord, a `Chord`, to the start of the next one.

    chord: that begins at the ray.
    """
    for m in range(3):
        ray[ORIGIN + m] += chord.length * ray[DIRECTION + m]
    if chord.half_turn != 0.0:
        r = math.sqrt(ray[ORIGIN] * ray[ORIGIN] + ray[ORIGIN + 1] * ray[ORIGIN + 1] + ray[ORIGIN + 2] * ray[ORIGIN + 2])
        mu = (
            ray[ORIGIN] * ray[DIRECTION] + ray[ORIGIN + 1] * ray[DIRECTION + 1] + ray[ORIGIN + 2] * ray[DIRECTION + 2]
        ) / r
        turn_down(ray, r, mu, chord.half_turn)


@njit(inner=True, **INNER)
def first_shell(air, altitude, mu):
    """Shell of the air in which a line goes on from an altitude [km].

    mu: cosine of the line to the vertical; air: as everywhere.
    """
    k = shell_of(air, altitude)
    if mu < 0.0 and altitude <= air.shell_km[k] and k > 0:
        k -= 1
    return k


class Step(NamedTuple):
    """One step along a chord: through a whole layer where the secant is a parabola over it (`by_layer`), else a shell.

    end [km]: distance from the chord's start to its end; leave_km: altitude there; first, last: levels that bound it;
    next_shell: shell after it (-1: the ground, the number of shells: space); falling: the line falls from there;
    ends_chord: the chord is at its end, wherever the shell's is.
    """

    end: float
    leave_km: float
    first: int
    last: int
    next_shell: int
    falling: bool
    by_layer: bool
    ends_chord: bool


@njit(inline="always", **INNER)
def step_through(air, chord, s, enter_km, k, falling, layers):
    """The step from a point of a chord onwards.

    chord: `Chord`; s [km]: distance of the point along it; enter_km: its altitude; k: its shell; falling: whether the
    line goes down there; layers: take whole layers where the line is steep.
    """
    r_enter = air.earth_radius_km + enter_km
    layer = air.layer_of_shell[k]
    leave_km = air.layer_km[layer] if falling else air.layer_km[layer + 1]
    u = abs(s + chord.radius * chord.mu)
    rise = leave_km - enter_km
    uu = u * u + rise * (rise + 2.0 * r_enter)
    by_layer = layers and abs(rise) > 1e-9 and uu > 0.0 and abs(rise) * r_enter < SMOOTH * 0.5 * (u * u + uu)
    still_falling = falling
    if by_layer:
        end = s + abs(math.sqrt(uu) - u)
        first = air.layer_first[layer]
        last = air.layer_last[layer]
        next_k = air.layer_shell[layer] - 1 if falling else air.layer_shell[layer + 1]
    else:
        first = air.shell_first[k]
        last = air.shell_last[k]
        if falling:
            leave_km = air.shell_km[k]
            next_k = k - 1
            end = distance_down(chord.altitude, chord.radius, chord.mu, leave_km)
            if end < 0.0:
                end = -chord.radius * chord.mu
                leave_km = altitude_at(chord.altitude, chord.radius, chord.mu, end)
                next_k = k
                still_falling = False
        else:
            leave_km = air.shell_km[k + 1]
            next_k = k + 1
            end = distance_up(chord.altitude, chord.radius, chord.mu, leave_km)
    ends_chord = end >= chord.length
    if ends_chord:
        end = chord.length
        leave_km = altitude_at(chord.altitude, chord.radius, chord.mu, end)
    return Step(end, leave_km, first, last, next_k, still_falling, by_layer, ends_chord)
