"""Sunlight scattered once: at a point of the air, at the ground, and the phase functions of a leg towards the sun.

Arguments that kernels share: `kernel`.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from twilight.jit.kernels import njit
from twilight.solvers.montecarlo.air import SPECIES, column, interpolate
from twilight.solvers.montecarlo.beam_table import SolarBeamTable
from twilight.solvers.montecarlo.kernel import INNER
from twilight.solvers.montecarlo.matrix import components, double_angle, species_polarising
from twilight.solvers.montecarlo.rays import CHORD_COLUMNS, DIRECTION, ORIGIN, REFERENCE
from twilight.solvers.montecarlo.screen import ScreenInSpace, passing_in_space
from twilight.transport.beam import Beam, beam_at_one

BENDING_STEP_RAD = 0.01
"""Step [rad] of the sun's bending by which the slope of a phase function is taken."""


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
    """The apparent direction of the sun at a point (x, y, z), lifted by `bending` [rad] towards the vertical.

    to_sun (3,): unit vector to the true sun; mu_sun: cosine of its zenith angle there.
    """
    if bending == 0.0:
        return to_sun[0], to_sun[1], to_sun[2]
    per = 1.0 / math.sqrt(x * x + y * y + z * z)
    sine = math.sqrt(max(1e-300, (1.0 - mu_sun) * (1.0 + mu_sun)))
    a = math.cos(bending) - mu_sun * math.sin(bending) / sine
    b = math.sin(bending) / sine * per
    return a * to_sun[0] + b * x, a * to_sun[1] + b * y, a * to_sun[2] + b * z


@njit(**INNER)
def sunlight(air, sun, w, z, mu_sun, chord, s, to_sun, i, f, polarised):
    """(I, Q, U) of sunlight scattered at a point against a chord: sum over species of beta_s P_s E / F0 [sr^-1 km^-1].

    chord (9,): its start, direction and reference; s [km]: the point's distance; z [km] its altitude; mu_sun: cosine of
    the true sun's zenith angle there; (i, f): its place among the levels; to_sun (3,).
    """
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
