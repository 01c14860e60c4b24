"""One straight leg of a path: cut into pieces, single scattering gathered on the way, weights for the next event.

A leg starts at a point and runs against the light until it leaves the air or meets the ground.  Every piece lies in one
layer or, close to the horizontal, in one shell; see :mod:`twilight.solvers.montecarlo.air` for how its optical depth
follows.  One point per piece, drawn uniformly, carries the sunlight scattered there towards the start of the leg, so
the estimate is unbiased whatever the length of the pieces.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from numba import njit

from twilight.phase import aerosol_phase, rayleigh_phase
from twilight.solvers.montecarlo.air import (
    EVENT,
    EXTINCTION,
    SPECIES,
    interpolate,
    locate_level,
    shell_of,
    weighted_depth,
)
from twilight.solvers.montecarlo.kernel import INNER
from twilight.solvers.montecarlo.random import uniform
from twilight.solvers.montecarlo.steering import log_ground_light, log_source_light
from twilight.solvers.montecarlo.suntable import BLACK, SunTable, quick_sun
from twilight.transport.beam import Beam, beam_at_one

# columns of the buffer that holds the pieces of a leg; a piece is one row, which keeps it in one or two cache lines
START, LENGTH, DEPTH, LOWER, MIDDLE, UPPER, BASE, FIRST, LAST, STEERED, PLAIN = range(11)
BUFFER_COLUMNS = 11
IN_SHELL = -1.0
"""In BASE: the piece lies in a shell, LOWER, MIDDLE, UPPER are extinctions; else they are c0, c1, c2 of the secant."""
BUFFER_PIECES = 4096
OPAQUE_DEPTH = 60.0
REFERENCE_RADIUS_KM = 6371.0
BENDING_STEP_RAD = 0.01
SMOOTH = 0.2
"""A secant counts as a parabola where the square of the cosine changes by less than this from the middle of a layer."""


@njit(inline="always", **INNER)
def altitude_at(z, r, mu, s):
    """Altitude [km] at the distance s of a line that starts at altitude z, radius r with the cosine mu."""
    q = s * (s + 2.0 * r * mu)
    return z + q / (r + math.sqrt(max(0.0, r * r + q)))


@njit(inline="always", **INNER)
def distance_up(z, r, mu, z_shell):
    """Distance [km] to a sphere above along a line that climbs or has mu < 0 and passes its lowest point first."""
    c = (z_shell - z) * (z_shell - z + 2.0 * r)
    b = r * mu
    d = math.sqrt(max(0.0, c + b * b))
    if b > 0.0:
        return c / (b + d) if c > 0.0 else 0.0
    return d - b


@njit(inline="always", **INNER)
def distance_down(z, r, mu, z_shell):
    """Distance [km] to a sphere below along a falling line (mu < 0), or -1 if the line does not reach it."""
    c = (z - z_shell) * (2.0 * r + z_shell - z)
    b = -r * mu
    d2 = b * b - c
    if d2 < 0.0:
        return -1.0
    return c / (b + math.sqrt(d2))


@njit(inline="always", **INNER)
def depth_within(lower, middle, upper, length, f):
    """Optical depth from the start of a piece to its fraction f."""
    return (
        length
        * f
        * (lower + f * (0.5 * (4.0 * middle - 3.0 * lower - upper) + f * (2.0 / 3.0) * (lower + upper - 2.0 * middle)))
    )


class Sun(NamedTuple):
    """The direct beam twice: exact (slow) and quick (rough); check_rate: how often the difference is asked for."""

    beam: Beam
    table: SunTable
    check_rate: float


@njit(**INNER)
def species_phase(air, w, c, cosine):
    """Phase function [sr^-1] of species c, 0 being air."""
    if c == 0:
        return rayleigh_phase(cosine, air.depolarisation[w])
    return aerosol_phase(air.phase_kind[c - 1], air.phase_asymmetry[c - 1, w], air.phase_log_table[c - 1, w], cosine)


@njit(inline="always", **INNER)
def cosine_to_sun(ex, ey, ez, ux, uy, uz, sx, sy, sz, mu_sun, bending):
    """Cosine between the unit vector e and the sun s as seen through `bending` [rad], where u is up."""
    cosine = ex * sx + ey * sy + ez * sz
    if bending > 0.0:
        # the sun is lifted in the plane of s and u
        sine = math.sqrt(max(1e-300, 1.0 - mu_sun * mu_sun))
        across = (ex * ux + ey * uy + ez * uz - mu_sun * cosine) / sine
        cosine = cosine * math.cos(bending) + across * math.sin(bending)
    return min(1.0, max(-1.0, cosine))


@njit(**INNER)
def sunlight(air, beam, w, z, mu_sun, ex, ey, ez, px, py, pz, sx, sy, sz, i, f):
    """Sunlight scattered at a point against the unit vector e: sum over species of beta_s p E / F0 [sr^-1 km^-1].

    p is the point (its length is the radius), s the unit vector to the true sun, (i, f) from `locate`.
    """
    irradiance, bending = beam_at_one(beam, z, mu_sun, w)
    if irradiance <= 0.0:
        return 0.0
    r = math.sqrt(px * px + py * py + pz * pz)
    cosine = cosine_to_sun(ex, ey, ez, px / r, py / r, pz / r, sx, sy, sz, mu_sun, bending)
    total = 0.0
    for c in range(air.table.shape[2] - SPECIES):
        beta = interpolate(air, w, i, f, SPECIES + c)
        if beta > 0.0:
            total += beta * species_phase(air, w, c, cosine)
    return total * irradiance


@njit(**INNER)
def ground_sunlight(air, beam, w, mu_sun):
    """Sunlight on the ground: irradiance / F0 on the horizontal."""
    irradiance, bending = beam_at_one(beam, air.shell_km[0], mu_sun, w)
    if irradiance <= 0.0:
        return 0.0
    apparent = math.acos(min(1.0, max(-1.0, mu_sun))) - bending
    return irradiance * max(0.0, math.cos(apparent))


@njit(inline="always", **INNER)
def column(table, i, f, c):
    """One coefficient [km^-1] of the table of one wavelength."""
    return table[i, c] * (1.0 - f) + table[i + 1, c] * f


@njit(**INNER)
def trace(
    air, sun, steering, w, px, py, pz, dx, dy, dz, sx, sy, sz,
    max_length, max_depth, jitter, stream, pieces, phases, out,
):  # fmt: skip
    """Walk one leg from the point p along d; returns the number of pieces, or -1 if the buffer is too short.

    `pieces` is filled (columns START..PLAIN; STEERED and PLAIN are running sums of the two weights for the next event).
    out[0]: sunlight scattered once along the leg, seen from its start [sr^-1]; out[1]: the same from the ground;
    out[2]: distance to the ground or -1; out[3]: transmittance of the whole leg;
    out[4]: steering's estimate of the light scattered again at the ground [sr^-1].
    With `jitter` 0 (else 1) the middle of each piece is used, and the quick look-up of the sun alone.
    phases (C, 2) is work space.

    The sun is looked up roughly at every piece (quick table; phase functions linear in the bending).  With the
    probability check_rate the exact value is asked for too, and the difference, divided by that probability, is added:
    the mean is the exact one, whatever the table.
    """
    levels = air.level_km
    bin_start = air.bin_start
    bins_per_km = air.bins_per_km
    per_km = air.per_km
    table = air.table[w]
    moment = air.moment[w]
    shell_km = air.shell_km
    shell_first = air.shell_first
    shell_last = air.shell_last
    layer_km = air.layer_km
    earth_radius = air.earth_radius_km
    edge_km = sun.table.edge_km[w]
    high = sun.table.high[w]
    low = sun.table.low[w]
    source = steering.log_source[w]
    nodes = steering.cos_sun
    hint = steering.hint
    check_rate = sun.check_rate
    bottom = shell_km[0]
    n_shells = shell_first.size
    top = shell_km[n_shells]
    per_depth = 1.0 / (top - bottom)
    r = math.sqrt(px * px + py * py + pz * pz)
    z = r - earth_radius
    mu = (px * dx + py * dy + pz * dz) / r
    out[0] = 0.0
    out[1] = 0.0
    out[2] = -1.0
    out[3] = 1.0
    out[4] = 0.0
    s = 0.0
    if z >= top:
        if mu >= 0.0:
            return 0
        k = n_shells - 1
        if z > top:
            s = distance_down(z, r, mu, top)
            if s < 0.0:
                return 0
        z_enter = top
    else:
        z = max(z, bottom)
        z_enter = z
        k = shell_of(air, z)
        if mu < 0.0 and z <= shell_km[k] and k > 0:
            k -= 1
    longest = max_length * earth_radius / REFERENCE_RADIUS_KM
    cos_sun_start = px * sx + py * sy + pz * sz
    cos_sun_slope = dx * sx + dy * sy + dz * sz
    s_lowest = -r * mu
    falling = mu < 0.0
    n_species = air.table.shape[2] - SPECIES
    for c in range(n_species):
        for m in range(2):
            cosine = cosine_to_sun(
                dx, dy, dz, px / r, py / r, pz / r, sx, sy, sz, cos_sun_start / r, m * BENDING_STEP_RAD
            )
            phases[c, m] = species_phase(air, w, c, cosine)
        phases[c, 1] = (phases[c, 1] - phases[c, 0]) / BENDING_STEP_RAD
    n = 0
    depth = 0.0
    steered = 0.0
    plain = 0.0
    while True:
        # a whole layer where the secant is smooth over it, else one shell
        lands = False
        layer = air.layer_of_shell[k]
        u = abs(s - s_lowest)
        r_enter = earth_radius + z_enter
        smooth = False
        z_leave = layer_km[layer] if falling else layer_km[layer + 1]
        rise = z_leave - z_enter
        uu = u * u + rise * (rise + 2.0 * r_enter)
        if abs(rise) > 1e-9 and uu > 0.0:
            mid_uu = 0.5 * (u * u + uu)
            smooth = abs(rise) * r_enter < SMOOTH * mid_uu
        if smooth:
            u_leave = math.sqrt(uu)
            end = s + abs(u_leave - u)
            first = air.layer_first[layer]
            last = air.layer_last[layer]
            next_k = air.layer_shell[layer] - 1 if falling else air.layer_shell[layer + 1]
            still_falling = falling
            lands = next_k < 0
        else:
            first = shell_first[k]
            last = shell_last[k]
            next_k = k + 1
            still_falling = False
            if falling:
                z_leave = shell_km[k]
                end = distance_down(z, r, mu, z_leave)
                if end < 0.0:
                    end = s_lowest
                    z_leave = altitude_at(z, r, mu, end)
                    next_k = k
                else:
                    next_k = k - 1
                    still_falling = True
                    lands = next_k < 0
            else:
                z_leave = shell_km[k + 1]
                end = distance_up(z, r, mu, z_leave)
        if end > s:
            stretch = end - s
            lower = 0.0
            middle = 0.0
            upper = 0.0
            base = IN_SHELL
            if smooth:
                z_middle = 0.5 * (z_enter + z_leave)
                f0 = r_enter / u
                f1 = (earth_radius + z_middle) / math.sqrt(
                    u * u + (z_middle - z_enter) * (z_middle - z_enter + 2.0 * r_enter)
                )
                f2 = (earth_radius + z_leave) / u_leave
                h = z_enter - bottom
                upper = 2.0 * (f0 + f2 - 2.0 * f1) / (rise * rise)
                slope = (4.0 * f1 - 3.0 * f0 - f2) / rise
                middle = slope - 2.0 * upper * h
                lower = f0 - slope * h + upper * h * h
                i, f = locate_level(levels, bin_start, bins_per_km, per_km, z_enter, first, last)
                base = weighted_depth(table, moment, levels[i] - bottom, 1.0 / per_km[i], i, f, lower, middle, upper)
                i = first if falling else last
                final = lower * moment[i, 0] + middle * moment[i, 1] + upper * moment[i, 2]
                dense = abs(final - base)
            else:
                i, f = locate_level(levels, bin_start, bins_per_km, per_km, z_enter, first, last)
                after = column(table, i, f, EXTINCTION)
                i, f = locate_level(levels, bin_start, bins_per_km, per_km, z_leave, first, last)
                leave = column(table, i, f, EXTINCTION)
                i, f = locate_level(
                    levels, bin_start, bins_per_km, per_km, altitude_at(z, r, mu, s + 0.5 * stretch), first, last
                )
                middle = column(table, i, f, EXTINCTION)
                dense = stretch * max(after, middle, leave)
            parts = int(max(1.0, min(math.ceil(max(stretch / longest, dense / max_depth)), 100000.0)))
            length = stretch / parts
            for part in range(parts):
                if n >= pieces.shape[0]:
                    return -1
                start = s + part * length
                if not smooth:
                    lower = after
                    if parts > 1:
                        i, f = locate_level(
                            levels, bin_start, bins_per_km, per_km,
                            altitude_at(z, r, mu, start + 0.5 * length), first, last,
                        )  # fmt: skip
                        middle = column(table, i, f, EXTINCTION)
                    if part == parts - 1:
                        upper = leave
                    else:
                        i, f = locate_level(
                            levels, bin_start, bins_per_km, per_km, altitude_at(z, r, mu, start + length), first, last
                        )
                        upper = column(table, i, f, EXTINCTION)
                    after = upper
                    through = length * (lower + 4.0 * middle + upper) / 6.0
                elif part == parts - 1:
                    after = final
                    through = abs(after - base)
                else:
                    i, f = locate_level(
                        levels, bin_start, bins_per_km, per_km, altitude_at(z, r, mu, start + length), first, last
                    )
                    after = weighted_depth(
                        table, moment, levels[i] - bottom, 1.0 / per_km[i], i, f, lower, middle, upper
                    )
                    through = abs(after - base)
                t = uniform(stream) if jitter > 0 else 0.5
                here = start + t * length
                zp = altitude_at(z, r, mu, here)
                mu_sun = min(1.0, max(-1.0, (cos_sun_start + here * cos_sun_slope) / (earth_radius + zp)))
                i, f = locate_level(levels, bin_start, bins_per_km, per_km, zp, first, last)
                scattering = column(table, i, f, EVENT)
                if scattering > 0.0:
                    if smooth:
                        within = abs(
                            weighted_depth(
                                table, moment, levels[i] - bottom, 1.0 / per_km[i], i, f, lower, middle, upper
                            )
                            - base
                        )
                    else:
                        within = depth_within(lower, middle, upper, length, t)
                    weight = length * math.exp(-depth - within)
                    root = math.sqrt(max(0.0, (zp - bottom) * per_depth))
                    light, bending = quick_sun(edge_km, high, low, earth_radius, zp, root, mu_sun)
                    quick = 0.0
                    if light > BLACK:
                        for c in range(n_species):
                            quick += column(table, i, f, SPECIES + c) * max(0.0, phases[c, 0] + bending * phases[c, 1])
                        quick *= math.exp(light)
                    if jitter > 0 and uniform(stream) < check_rate:
                        exact = sunlight(
                            air, sun.beam, w, zp, mu_sun, dx, dy, dz,
                            px + here * dx, py + here * dy, pz + here * dz, sx, sy, sz, i, f,
                        )  # fmt: skip
                        quick += (exact - quick) / check_rate
                    out[0] += weight * quick
                    plain += weight * scattering
                    up = (here - s_lowest) / (earth_radius + zp)
                    steered += (
                        weight
                        * scattering
                        * math.exp(log_source_light(source, nodes, hint, root, mu_sun, up, cos_sun_slope))
                    )
                row = pieces[n]
                row[START] = start
                row[LENGTH] = length
                row[DEPTH] = depth
                row[LOWER] = lower
                row[MIDDLE] = middle
                row[UPPER] = upper
                row[BASE] = base
                row[FIRST] = first
                row[LAST] = last
                row[STEERED] = steered
                row[PLAIN] = plain
                depth += through
                if smooth:
                    base = after
                n += 1
                if depth > OPAQUE_DEPTH:
                    out[3] = 0.0
                    return n
            s = end
        z_enter = z_leave
        if lands:
            transmittance = math.exp(-depth)
            out[2] = end
            out[3] = transmittance
            albedo = air.ground_albedo[w]
            if albedo > 0.0:
                mu_sun = (cos_sun_start + end * cos_sun_slope) / (earth_radius + bottom)
                mu_sun = min(1.0, max(-1.0, mu_sun))
                reflected = transmittance * albedo / math.pi
                out[1] = reflected * ground_sunlight(air, sun.beam, w, mu_sun)
                out[4] = reflected * math.exp(log_ground_light(steering, w, mu_sun))
            return n
        k = next_k
        falling = still_falling
        if k >= n_shells:
            out[3] = math.exp(-depth)
            return n
