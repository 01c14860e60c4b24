"""Ray geometry: chords of the refracted ray, and the stretches in which a chord crosses the air.

Where the refractive index n falls with altitude, a ray curves towards the Earth.  With i its angle to the vertical, its
direction turns in the vertical plane by

    d(omega) / ds = -(dn / dr) sin(i) / n                                   (Bouguer: n r sin(i) is constant),

followed here by the midpoint rule: a *chord* has the direction half-way, and leaves the ray by less than a sag that the
caller sets.  Along a ray L / n^2 is constant, so light from where the index is n counts (n_start / n)^2 at the start.
The reference of the Stokes vector turns with the ray, in its plane: nothing rotates about the ray.

A caller follows a leg with

    stretch = before_leg()
    while stretch.then == ON:
        stretch = next_stretch(...)
        ...                             # from stretch.start to stretch.end of stretch.chord

Arguments that kernels share: `kernel`.
"""

import math
from typing import Any, NamedTuple

import numpy as np

from twilight.jit.kernels import njit
from twilight.solvers.montecarlo.air import locate, shell_of
from twilight.solvers.montecarlo.kernel import INNER

# Columns of a chord, and of a ray: a point [km], unit vectors of the direction and of the reference normal to it.
ORIGIN, DIRECTION, REFERENCE = 0, 3, 6
CHORD_COLUMNS = 9
REFERENCE_RADIUS_KM = 6371.0
"""Radius [km] of the planet that the lengths below are for; they grow with the planet."""
CHORD_KM = 40.0
"""Longest chord [km] at the ground."""
CHORD_PER_HEIGHT = 3.0
"""Growth of the longest chord with the height above the ground [km per km]."""
RISE_KM = 4.0
"""Largest rise along a chord [km] at the ground."""
RISE_PER_HEIGHT = 0.35
"""Growth of the largest rise with the height above the ground [km per km]."""
STEEP = 0.25
"""Cosine to the vertical above which lines bend so little that chords may rise by STEEP_RISE_KM at the least."""
STEEP_RISE_KM = 10.0
"""Largest rise [km] along a chord of such a line at the ground."""
LEAST_CURVATURE = 1e-10
"""Curvature [rad km^-1] below which a climbing ray is straight from there on."""
LONGEST_KM = 2e4
"""Length [km] at which a leg that does not leave the air is given up."""
SMOOTH = 0.2
"""A secant counts as a parabola where the square of the cosine changes by less than this from the middle of a layer."""


@njit(inline="always", **INNER)
def radius_and_cosine(ray):
    """(radius [km] of the start of a ray (9,), cosine of its direction to the vertical there)."""
    x, y, z = ray[ORIGIN], ray[ORIGIN + 1], ray[ORIGIN + 2]
    r = math.sqrt(x * x + y * y + z * z)
    return r, (x * ray[DIRECTION] + y * ray[DIRECTION + 1] + z * ray[DIRECTION + 2]) / r


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
    """n - 1 at an altitude [km], 0 above the air."""
    last = air.level_km.size - 1
    if altitude >= air.level_km[last]:
        return 0.0
    i, f = locate(air, altitude, 0, last)
    return air.refractivity[w, i] * (1.0 - f) + air.refractivity[w, i + 1] * f


@njit(inline="always", **INNER)
def refractivity_on_ray(air, w, ray):
    """n - 1 at the start of a ray (9,), that of the ground below it."""
    r, _ = radius_and_cosine(ray)
    return refractivity_at(air, w, max(air.shell_km[0], r - air.earth_radius_km))


@njit(inline="always", **INNER)
def relative_index(refractivity, i, f, at_start):
    """(n_start / n)^2; refractivity (N,) of one wavelength, (i, f) a place among the levels, at_start: n_start - 1."""
    nu = refractivity[i] * (1.0 - f) + refractivity[i + 1] * f
    ratio = (1.0 + at_start) / (1.0 + nu)
    return ratio * ratio


@njit(**INNER)
def curvature(air, w, altitude, sine):
    """Curvature [rad km^-1] of a ray towards the Earth at an altitude [km]; sine: of its angle to the vertical."""
    last = air.level_km.size - 1
    if altitude >= air.level_km[last]:
        return 0.0
    i, f = locate(air, altitude, 0, last)
    lower = air.refractivity[w, i]
    change = air.refractivity[w, i + 1] - lower
    return -change * air.per_km[i] * sine / (1.0 + lower + f * change)


@njit(inner=True, **INNER)
def bend_down(ray, r, mu, angle):
    """Rotate the direction and the reference of a ray (9,) towards the Earth by an angle [rad], in the vertical plane.

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
    """Scalars of one chord.

    altitude, radius [km]: of its start; mu: cosine to the vertical there; length [km]: 1e9 for a straight line;
    half_bending [rad]: half the angle by which the ray bends along it.
    """

    altitude: float
    radius: float
    mu: float
    length: float
    half_bending: float


@njit(inner=True, **INNER)
def begin_chord(air, w, bent, sag_km, ray):
    """The chord that begins at a ray (9,), whose direction becomes the chord's.

    bent: follow the refracted ray; sag_km: how far the chord may leave it.
    """
    r, mu = radius_and_cosine(ray)
    z = max(r - air.earth_radius_km, air.level_km[0])
    if not bent:
        return Chord(z, r, mu, 1e9, 0.0)
    scale = air.earth_radius_km / REFERENCE_RADIUS_KM
    sine = math.sqrt(max(0.0, (1.0 - mu) * (1.0 + mu)))
    at_start = curvature(air, w, z, sine)
    if mu > 0.0 and abs(at_start) < LEAST_CURVATURE / scale:
        return Chord(z, r, mu, 1e9, 0.0)
    height = z - air.level_km[0]
    rise = max((RISE_KM if abs(mu) < STEEP else STEEP_RISE_KM) * scale, RISE_PER_HEIGHT * height)
    length = CHORD_KM * scale + CHORD_PER_HEIGHT * height
    if abs(mu) * length > rise:
        length = rise / abs(mu)
    if abs(at_start) * length * length > 8.0 * sag_km:
        length = math.sqrt(8.0 * sag_km / abs(at_start))
    middle = altitude_at(z, r, mu, 0.5 * length)
    half_bending = 0.5 * length * curvature(air, w, middle, sine * r / (air.earth_radius_km + middle))
    bend_down(ray, r, mu, half_bending)
    _, mu = radius_and_cosine(ray)
    return Chord(z, r, mu, length, half_bending)


@njit(inner=True, **INNER)
def end_chord(chord, ray):
    """Move a ray (9,) from the start of a chord, a `Chord`, to the start of the next one."""
    for m in range(3):
        ray[ORIGIN + m] += chord.length * ray[DIRECTION + m]
    if chord.half_bending != 0.0:
        r, mu = radius_and_cosine(ray)
        bend_down(ray, r, mu, chord.half_bending)


@njit(inner=True, **INNER)
def first_shell(air, altitude, mu):
    """Shell of the air in which a line goes on from an altitude [km]; mu: cosine of the line to the vertical."""
    k = shell_of(air, altitude)
    if mu < 0.0 and altitude <= air.shell_km[k] and k > 0:
        k -= 1
    return k


class Stretch(NamedTuple):
    """Part of a chord that lies within one layer, where the secant is a parabola over it (`by_layer`), or one shell.

    chord: the `Chord` that it lies on; number: row of that chord in `Leg.chords`, -1 before the leg; begins_chord,
        ends_chord: whether it is the chord's beginning, its end.
    travelled [km]: length of the chords before; start, end [km]: along the chord; enter_km, leave_km [km]: altitudes at
        the two.
    first, last: levels that bound the layer or shell; next_shell: the shell that follows (-1: the ground, their number:
        space); falling: whether the line goes down there.
    then: what follows, ON, TO_GROUND, TO_SPACE or NO_ROOM.
    """

    chord: Chord
    number: int
    begins_chord: bool
    ends_chord: bool
    travelled: float
    start: float
    end: float
    enter_km: float
    leave_km: float
    first: int
    last: int
    next_shell: int
    falling: bool
    by_layer: bool
    then: int


ON = 0
"""Another stretch follows."""
TO_GROUND = 1
"""The leg meets the ground."""
TO_SPACE = 2
"""The leg leaves the air."""
NO_ROOM = 3
"""The leg needs more chords than there is memory for, or is longer than LONGEST_KM."""


@njit(inline="always", **INNER)
def before_leg():
    """The `Stretch` that `next_stretch` begins a leg with; another one follows."""
    # plain numbers would be types of their own, and two kinds of Stretch
    none: Any = np.int64(-1)
    zero: Any = np.int64(0)
    false: Any = np.bool_(False)
    true: Any = np.bool_(True)
    chord = Chord(0.0, 0.0, 0.0, 0.0, 0.0)
    return Stretch(chord, none, false, true, 0.0, 0.0, 0.0, 0.0, 0.0, zero, zero, zero, false, false, zero)


@njit(inline="always", **INNER)
def next_stretch(air, w, bent, sag_km, layers, before, ray, chords):
    """The `Stretch` of a leg that follows the stretch `before`; where a new chord begins, it is stored.

    bent: follow the refracted ray; sag_km: how far a chord may leave it; layers: take whole layers where the line is
    steep; ray (9,): start of the present chord, moved on; chords (K, 9): of the `Leg`.
    """
    chord, number, travelled = before.chord, before.number, before.travelled
    s, enter_km, k, falling = before.end, before.leave_km, before.next_shell, before.falling
    begins_chord = before.ends_chord
    has_room = True
    if begins_chord:
        if number >= 0:
            travelled += chord.length
            end_chord(chord, ray)
        number += 1
        chord = begin_chord(air, w, bent, sag_km, ray)
        has_room = number < chords.shape[0] and travelled <= LONGEST_KM * (air.earth_radius_km / REFERENCE_RADIUS_KM)
        if has_room:
            row = chords[number]
            for m in range(CHORD_COLUMNS):
                row[m] = ray[m]
        s, enter_km, falling = 0.0, chord.altitude, chord.mu < 0.0
        k = first_shell(air, enter_km, chord.mu)
    # u: distance from the line's lowest point; (u / r)^2 is the square of its cosine to the vertical
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
    then: Any = np.int64(ON)
    if not has_room:
        then = np.int64(NO_ROOM)
        end = s
    elif not ends_chord and next_k < 0:
        then = np.int64(TO_GROUND)
    elif not ends_chord and next_k >= air.shell_first.size:
        then = np.int64(TO_SPACE)
    return Stretch(
        chord, number, begins_chord, ends_chord, travelled, s, end, enter_km, leave_km, first, last, next_k,
        still_falling, by_layer, then,
    )  # fmt: skip
