"""Sunlight scattered once: at a point of the air, at the ground, and the phase functions of a leg towards the sun.

The walk looks the sunbeam up in a table of its own, which may be rough: `leg.trace` corrects it without bias.  The
logarithm of the irradiance is tabulated bilinearly over altitude and, for a sun above the horizontal, its cosine; for a
lower sun over the height of the straight ray's lowest point above that of the ray that touches the shadow, because the
limb's features lie at nearly fixed heights there.

What lies beyond the horizon, the screen (`twilight.atmosphere.screen`), is here the air between two distances from the
observer, along the ground.  From a point in sunlight the refracted ray is followed towards the sun step by step in
space, and its least altitude over that air is what T is taken at: no invariant, no tangent altitude and no symmetry
about the sun's axis, on which the sunbeam's own tables rest.  The observer stands at (0, 0, r), and x points to the
sun, y to its right.

Arguments that kernels share: `kernel`; screen: `ScreenInSpace`, not empty.
"""

import math
from typing import NamedTuple

import numpy as np

from twilight.atmosphere.medium import Medium
from twilight.base.threads import in_slices
from twilight.jit.kernels import njit
from twilight.solvers.montecarlo.air import SPECIES, MonteCarloAir, column, interpolate
from twilight.solvers.montecarlo.kernel import INNER, components, double_angle, species_polarising
from twilight.solvers.montecarlo.rays import CHORD_COLUMNS, DIRECTION, LONGEST_KM, ORIGIN, REFERENCE, curvature
from twilight.transport.beam import Beam, beam_at_one

N_ALTITUDE = 64
"""Steps of the root of the relative height."""
N_HIGH = 128
"""Steps of a sun above the horizontal: with 32, a layer of depth 10 had 6 % less sunlight between two of them, which
the exact values of one sample in some made good by twice its light: few samples agreed on too little."""
N_LOW = 128
"""Steps of a lower sun."""
COSINE_SCALE = 0.05
"""Cosine of the zenith angle below which the steps of a sun above the horizontal are dense."""
BLACK = -2000.0
"""Logarithm of irradiance / F0 that stands for the shadow."""
STEP_KM = 2.0
"""Length of a step below the highest altitude of the screen [km]."""
STEP_PER_HEIGHT = 0.3
"""Growth of a step with the height above it [km per km]."""
NOT_MET = 1e9
"""Least altitude of a ray that does not cross the screen's air [km]."""
BENDING_STEP_RAD = 0.01
"""Step [rad] of the sun's bending by which the slope of a phase function is taken."""


class SolarBeamTable(NamedTuple):
    """Tables of the direct beam over W wavelengths and A = N_ALTITUDE + 1 altitudes.

    edge_km (W, A): lowest point [km] of the straight ray that touches the shadow.
    high (W, A, N_HIGH + 1, 2), low (W, A, N_LOW + 1, 2): logarithm of irradiance / F0, and bending [rad].
    """

    bottom_km: float
    depth_km: float
    radius_km: float
    edge_km: np.ndarray
    high: np.ndarray
    low: np.ndarray


def prepare_beam_table(air: MonteCarloAir, beam) -> SolarBeamTable:
    """Tabulate a beam for the altitudes of the air."""
    n_w = air.table.shape[0]
    table = SolarBeamTable(
        float(air.shell_km[0]),
        float(air.shell_km[-1] - air.shell_km[0]),
        float(air.earth_radius_km),
        np.empty((n_w, N_ALTITUDE + 1)),
        np.empty((n_w, N_ALTITUDE + 1, N_HIGH + 1, 2), dtype=np.float32),
        np.empty((n_w, N_ALTITUDE + 1, N_LOW + 1, 2), dtype=np.float32),
    )
    in_slices(lambda a, b: _fill(beam, table, a, b), table.edge_km.size)
    return table


@njit(**INNER)
def _entry(beam, z, cosine, w, row):
    """Fill row (2,): logarithm of irradiance / F0, and bending [rad].

    z [km]: altitude; cosine: of the true sun's zenith angle there.
    """
    irradiance, bending = beam_at_one(beam, z, cosine, w)
    row[0] = math.log(irradiance) if irradiance > 1e-300 else BLACK
    row[1] = bending


@njit(cache=True, nogil=True)
def _fill(beam, table, first, end):
    """Fill rows of the table: every altitude of every wavelength is one, counted through altitudes first.

    table: `SolarBeamTable`; first, end: the first row and the one after the last.
    """
    for job in range(first, end):
        w = job // (N_ALTITUDE + 1)
        a = job % (N_ALTITUDE + 1)
        # just inside the air, so that no altitude counts as space
        z = table.bottom_km + table.depth_km * min((a / N_ALTITUDE) ** 2, 1.0 - 1e-12)
        r = table.radius_km + z
        dark = -1.0
        lit = 0.0
        for _ in range(60):
            middle = 0.5 * (dark + lit)
            irradiance, _ = beam_at_one(beam, z, middle, w)
            if irradiance > 1e-300:
                lit = middle
            else:
                dark = middle
        drop = lowest_drop(r, lit)
        table.edge_km[w, a] = z - drop
        for n in range(N_LOW + 1):
            # height above the edge's lowest point, quadratic: y = (n / N)^2 of the whole drop
            d = drop * (1.0 - (n / N_LOW) ** 2)
            sine = 1.0 - d / r
            _entry(beam, z, max(lit, -math.sqrt(max(0.0, (1.0 - sine) * (1.0 + sine)))), w, table.low[w, a, n])
        for n in range(N_HIGH + 1):
            t = n / N_HIGH
            _entry(beam, z, COSINE_SCALE * t / (1.0 + COSINE_SCALE - t), w, table.high[w, a, n])


@njit(inline="always", **INNER)
def lowest_drop(r, cosine):
    """How far [km] the lowest point of a straight line lies below a point at the radius r [km]: r (1 - sine).

    cosine: of the line's angle to the vertical at the point.
    """
    c2 = cosine * cosine
    return r * c2 / (1.0 + math.sqrt(max(0.0, 1.0 - c2)))


@njit(inner=True, **INNER)
def tabulated_beam(edge_km, high, low, radius_km, z, root, cosine):
    """(logarithm of irradiance / F0, bending [rad]) at a point of the air; BLACK in the shadow.

    edge_km (A,), high (A, N_HIGH + 1, 2), low (A, N_LOW + 1, 2): of `SolarBeamTable` at one wavelength, as arrays
    because this is the innermost loop; radius_km: of the Earth; z [km]: altitude; root: of the altitude above the
    ground over the depth of the air; cosine: of the true sun's zenith angle.
    """
    x = root * N_ALTITUDE
    a = min(int(x), N_ALTITUDE - 1)
    x = min(1.0, x - a)
    if cosine >= 0.0:
        y = cosine * (1.0 + COSINE_SCALE) / (cosine + COSINE_SCALE) * N_HIGH
        b = min(int(y), N_HIGH - 1)
        t = high
    else:
        edge = edge_km[a] * (1.0 - x) + edge_km[a + 1] * x
        height = z - lowest_drop(radius_km + z, cosine) - edge
        if height < 0.0 or edge >= z:
            return BLACK, 0.0
        y = math.sqrt(height / (z - edge)) * N_LOW
        b = min(int(y), N_LOW - 1)
        t = low
    y -= b
    w00 = (1.0 - x) * (1.0 - y)
    w01 = (1.0 - x) * y
    w10 = x * (1.0 - y)
    w11 = x * y
    light = w00 * t[a, b, 0] + w01 * t[a, b + 1, 0] + w10 * t[a + 1, b, 0] + w11 * t[a + 1, b + 1, 0]
    bending = w00 * t[a, b, 1] + w01 * t[a, b + 1, 1] + w10 * t[a + 1, b, 1] + w11 * t[a + 1, b + 1, 1]
    return light, bending


class ScreenInSpace(NamedTuple):
    """T (N,) by altitude_km (N,), none where nothing screens; from_km, to_km: from the observer; bent: rays are.

    power (W,): of T.
    """

    altitude_km: np.ndarray
    transmission: np.ndarray
    from_km: float
    to_km: float
    bent: bool
    power: np.ndarray


def screen_in_space(medium: Medium, bent: bool) -> ScreenInSpace:
    """The screen of a medium."""
    screen = medium.screen
    if screen is None:
        return ScreenInSpace(np.zeros(0), np.zeros(0), 0.0, 0.0, bent, np.zeros(0))
    z, passed = np.array(screen.altitude_km), np.array(screen.transmission)
    power = screen.powers(medium.wavelength_nm)
    return ScreenInSpace(z, passed, screen.from_km, min(screen.to_km, LONGEST_KM), bent, power)


@njit(inner=True, **INNER)
def least_altitude(air, screen, w, x, y, z, dx, dy, dz):
    """Least altitude [km] over the screen's air of the ray from a point (x, y, z) [km] in a direction (dx, dy, dz)."""
    radius = air.earth_radius_km
    highest = screen.altitude_km[screen.altitude_km.size - 1]
    least = NOT_MET
    travelled = 0.0
    r = math.sqrt(x * x + y * y + z * z)
    h0, d0 = r - radius, radius * math.atan2(math.sqrt(x * x + y * y), z)
    while travelled < LONGEST_KM:
        mu = (x * dx + y * dy + z * dz) / r
        if mu >= 0.0 and h0 > highest:
            break
        step = STEP_KM + STEP_PER_HEIGHT * max(0.0, h0 - highest)
        half = 0.0
        sine = math.sqrt(max(0.0, (1.0 - mu) * (1.0 + mu)))
        if screen.bent and sine > 1e-6:
            middle = h0 + 0.5 * step * (mu + 0.5 * step * sine * sine / (2.0 * r))
            half = 0.5 * step * curvature(air, w, middle, sine)
            # towards the Earth, in the vertical plane: half of the bending before the step, half of it after
            c, s = math.cos(half), math.sin(half) / sine
            dx, dy, dz = (c + s * mu) * dx - s * x / r, (c + s * mu) * dy - s * y / r, (c + s * mu) * dz - s * z / r
        x, y, z = x + step * dx, y + step * dy, z + step * dz
        r = math.sqrt(x * x + y * y + z * z)
        h1, d1 = r - radius, radius * math.atan2(math.sqrt(x * x + y * y), z)
        first, last = max(min(d0, d1), screen.from_km), min(max(d0, d1), screen.to_km)
        if first <= last:
            slope = (h1 - h0) / (d1 - d0) if d1 != d0 else 0.0
            least = min(least, h0 + slope * (first - d0), h0 + slope * (last - d0))
        if half != 0.0:
            mu = (x * dx + y * dy + z * dz) / r
            sine = math.sqrt(max(1e-12, (1.0 - mu) * (1.0 + mu)))
            c, s = math.cos(half), math.sin(half) / sine
            dx, dy, dz = (c + s * mu) * dx - s * x / r, (c + s * mu) * dy - s * y / r, (c + s * mu) * dz - s * z / r
        h0, d0 = h1, d1
        travelled += step
    return least


@njit(**INNER)
def passing_in_space(air, screen, w, x, y, z, sx, sy, sz):
    """T of the beam from the apparent sun (sx, sy, sz) to a point (x, y, z) [km]."""
    h = least_altitude(air, screen, w, x, y, z, sx, sy, sz)
    altitude, transmission = screen.altitude_km, screen.transmission
    last = altitude.size - 1
    if h <= altitude[0]:
        passed = transmission[0]
    elif h >= altitude[last]:
        passed = transmission[last]
    else:
        k = 0
        while altitude[k + 1] < h:
            k += 1
        f = (h - altitude[k]) / (altitude[k + 1] - altitude[k])
        passed = (1.0 - f) * transmission[k] + f * transmission[k + 1]
    return passed ** screen.power[w]


class SolarBeam(NamedTuple):
    """The direct beam, exact but for what lies beyond the horizon, its table, and that screen at its place.

    exact_beam_fraction: how often the difference of the table and what is exact is asked for.
    """

    beam: Beam
    table: SolarBeamTable
    exact_beam_fraction: float
    screen: ScreenInSpace


@njit(inline="always", **INNER)
def lifted_sun(x, y, z, to_sun, mu_sun, bending):
    """The apparent direction of the sun at (x, y, z), lifted by `bending` [rad] towards the vertical, at most to it.

    to_sun (3,): unit vector to the true sun; mu_sun: cosine of its zenith angle there.
    """
    sine = math.sqrt(max(0.0, (1.0 - mu_sun) * (1.0 + mu_sun)))
    if bending == 0.0 or sine == 0.0:
        return to_sun[0], to_sun[1], to_sun[2]
    if mu_sun > 0.0:
        bending = min(bending, sine)
    per = 1.0 / math.sqrt(x * x + y * y + z * z)
    a = math.cos(bending) - mu_sun * math.sin(bending) / sine
    b = math.sin(bending) / sine * per
    return a * to_sun[0] + b * x, a * to_sun[1] + b * y, a * to_sun[2] + b * z


class ChordPoint(NamedTuple):
    """A point of a chord: s [km], its distance from the chord's start; z [km], its altitude; mu_sun: cosine of the true
    sun's zenith angle there; (i, f): its place among the levels."""

    s: float
    z: float
    mu_sun: float
    i: int
    f: float


@njit(**INNER)
def sunlight(air, sun, w, point, chord, to_sun, polarised):
    """(I, Q, U) of sunlight scattered at a point against a chord: sum over species of beta_s P_s E / F0 [sr^-1 km^-1].

    point: `ChordPoint`; chord (9,): its start, direction and reference; to_sun (3,).
    """
    s, z, mu_sun, i, f = point
    irradiance, bending = beam_at_one(sun.beam, z, mu_sun, w)
    if irradiance <= 0.0:
        return 0.0, 0.0, 0.0
    d = chord[DIRECTION:REFERENCE]
    e = chord[REFERENCE:CHORD_COLUMNS]
    x, y, h = lifted_sun(
        chord[ORIGIN] + s * d[0], chord[ORIGIN + 1] + s * d[1], chord[ORIGIN + 2] + s * d[2], to_sun, mu_sun, bending
    )
    if sun.screen.altitude_km.size > 0:
        irradiance *= passing_in_space(
            air, sun.screen, w,
            chord[ORIGIN] + s * d[0], chord[ORIGIN + 1] + s * d[1], chord[ORIGIN + 2] + s * d[2], x, y, h,
        )  # fmt: skip
    cosine = min(1.0, max(-1.0, d[0] * x + d[1] * y + d[2] * h))
    total = 0.0
    polarising = 0.0
    for c in range(air.table.shape[2] - SPECIES):
        beta = interpolate(air, w, i, f, SPECIES + c)
        if beta > 0.0:
            p11, p12 = species_polarising(air, w, c, cosine)
            total += beta * p11
            polarising += beta * p12
    total *= irradiance
    if not polarised:
        return total, 0.0, 0.0
    polarising *= irradiance
    a, b = components(e, d, x, y, h)
    cos_2phi, sin_2phi = double_angle(a, b)
    return total, polarising * cos_2phi, polarising * sin_2phi


@njit(inner=True, **INNER)
def ground_sunlight(air, sun, w, x, y, z, mu_sun, to_sun):
    """Radiance [sr^-1] of the sunlight that the Lambertian ground at a point (x, y, z) [km] sends back, unpolarised.

    mu_sun: cosine of the true sun's zenith angle there.
    """
    irradiance, bending = beam_at_one(sun.beam, air.shell_km[0], mu_sun, w)
    if irradiance <= 0.0:
        return 0.0
    sx, sy, sz = lifted_sun(x, y, z, to_sun, mu_sun, bending)
    if sun.screen.altitude_km.size > 0:
        irradiance *= passing_in_space(air, sun.screen, w, x, y, z, sx, sy, sz)
    # the sun stands higher by its bending
    mu_in = math.cos(math.acos(min(1.0, max(-1.0, mu_sun))) - bending)
    return irradiance * (air.ground_albedo[w] * max(0.0, mu_in) / math.pi)


@njit(inner=True, **INNER)
def fill_phases(air, w, ray, to_sun, polarised, phases):
    """Fill phases (C, 3, 2) of a `Leg` for the direction of a ray (9,): without bending, and with BENDING_STEP_RAD of
    it.
    """
    x, y, z = ray[ORIGIN], ray[ORIGIN + 1], ray[ORIGIN + 2]
    d = ray[DIRECTION:REFERENCE]
    e = ray[REFERENCE:CHORD_COLUMNS]
    mu_sun = (x * to_sun[0] + y * to_sun[1] + z * to_sun[2]) / math.sqrt(x * x + y * y + z * z)
    for m in range(2):
        lx, ly, lz = lifted_sun(x, y, z, to_sun, mu_sun, m * BENDING_STEP_RAD)
        cosine = min(1.0, max(-1.0, d[0] * lx + d[1] * ly + d[2] * lz))
        a, b = components(e, d, lx, ly, lz)
        cos_2phi, sin_2phi = double_angle(a, b)
        for c in range(phases.shape[0]):
            p11, p12 = species_polarising(air, w, c, cosine)
            phases[c, 0, m] = p11
            if polarised:
                phases[c, 1, m] = p12 * cos_2phi
                phases[c, 2, m] = p12 * sin_2phi
    for c in range(phases.shape[0]):
        for k in range(3 if polarised else 1):
            phases[c, k, 1] = (phases[c, k, 1] - phases[c, k, 0]) / BENDING_STEP_RAD


@njit(inline="always", **INNER)
def tabulated_sunlight(table, i, f, phases, irradiance, bending, polarised):
    """(I, Q, U) [sr^-1 km^-1] as `sunlight`, from phases (C, 3, 2) of a `Leg`, linear in the sun's bending [rad].

    table (N, 2 + C) [km^-1]: of the air at the wavelength; (i, f): the point's place among its levels; irradiance: over
    F0 there.
    """
    light_i, light_q, light_u = 0.0, 0.0, 0.0
    for c in range(phases.shape[0]):
        beta = column(table, i, f, SPECIES + c)
        light_i += beta * max(0.0, phases[c, 0, 0] + bending * phases[c, 0, 1])
        if polarised:
            light_q += beta * (phases[c, 1, 0] + bending * phases[c, 1, 1])
            light_u += beta * (phases[c, 2, 0] + bending * phases[c, 2, 1])
    return irradiance * light_i, irradiance * light_q, irradiance * light_u
