"""Where a path goes on: the point of the next event on a leg, and the direction of the leg after it."""

from __future__ import annotations

import math

from numba import njit

from twilight.phase import aerosol_phase, rayleigh_phase
from twilight.solvers.montecarlo.air import EVENT, N_SAMPLING, SPECIES, interpolate, locate, weighted_depth
from twilight.solvers.montecarlo.kernel import INNER
from twilight.solvers.montecarlo.leg import (
    BASE,
    DEPTH,
    FIRST,
    IN_SHELL,
    LAST,
    LENGTH,
    LOWER,
    MIDDLE,
    PLAIN,
    START,
    STEERED,
    UPPER,
    depth_within,
)
from twilight.solvers.montecarlo.random import uniform
from twilight.solvers.montecarlo.steering import (
    N_AZIMUTHS,
    cell_of,
    cell_solid_angle,
    draw_from,
    horizon_sine,
    log_light_from,
    nearest_node,
    sampling_cell,
    weigh_cells,
)

DEFENCE = 0.05
"""Share of the mean light that a direction counts as having at least, so that no weight can grow beyond bounds."""


@njit(**INNER)
def draw_piece(pieces, column, n, x):
    """First of n pieces whose running sum in a column exceeds x."""
    lo = 0
    hi = n - 1
    while lo < hi:
        mid = (lo + hi) // 2
        if pieces[mid, column] > x:
            hi = mid
        else:
            lo = mid + 1
    return lo


@njit(**INNER)
def choose_point(pieces, n, ground_plain, ground_steered, steered_fraction, number, stream):
    """Draw a piece of the leg, or its ground, from a mixture of steered and plain weights; `number` in [0, 1).

    Returns (index of the piece, or n for the ground; its probability; uniform number within the piece).
    """
    all_plain = ground_plain
    all_steered = ground_steered
    if n > 0:
        all_plain += pieces[n - 1, PLAIN]
        all_steered += pieces[n - 1, STEERED]
    if all_plain <= 0.0:
        return n, 0.0, 0.0
    steer = steered_fraction if all_steered > 0.0 else 0.0
    if number < steer:
        column = STEERED
        x = number / steer * all_steered
    else:
        column = PLAIN
        x = (number - steer) / (1.0 - steer) * all_plain
    k = n
    if n > 0 and x < pieces[n - 1, column]:
        k = draw_piece(pieces, column, n, x)
        plain = pieces[k, PLAIN]
        steered = pieces[k, STEERED]
        if k > 0:
            plain -= pieces[k - 1, PLAIN]
            steered -= pieces[k - 1, STEERED]
    else:
        plain = ground_plain
        steered = ground_steered
    probability = (1.0 - steer) * plain / all_plain
    if steer > 0.0:
        probability += steer * steered / all_steered
    return k, probability, uniform(stream)


@njit(**INNER)
def event_weight(air, w, pieces, k, t, i, f):
    """Transmittance x scattering x length of a piece, at its fraction t: the weight but for the probability."""
    length = pieces[k, LENGTH]
    lower = pieces[k, LOWER]
    middle = pieces[k, MIDDLE]
    upper = pieces[k, UPPER]
    base = pieces[k, BASE]
    if base == IN_SHELL:
        within = depth_within(lower, middle, upper, length, t)
    else:
        h = air.level_km[i] - air.shell_km[0]
        d = 1.0 / air.per_km[i]
        within = abs(weighted_depth(air.table[w], air.moment[w], h, d, i, f, lower, middle, upper) - base)
    return length * math.exp(-pieces[k, DEPTH] - within) * interpolate(air, w, i, f, EVENT)


@njit(**INNER)
def event_distance(pieces, k, t):
    """Distance [km] from the start of the leg to the fraction t of a piece."""
    return pieces[k, START] + t * pieces[k, LENGTH]


@njit(**INNER)
def event_level(air, pieces, k, z):
    """`locate` within the shell of a piece."""
    return locate(air, z, int(pieces[k, FIRST]), int(pieces[k, LAST]))


@njit(**INNER)
def phase_and_density(air, w, i, f, cosine):
    """(p, q) [sr^-1]: phase function of an event at a point and the density of its stand-in that is drawn from."""
    if air.isotropic_events:
        return 0.25 / math.pi, 0.25 / math.pi
    cell = sampling_cell(cosine)
    p = 0.0
    q = 0.0
    total = 0.0
    for c in range(air.table.shape[2] - SPECIES):
        beta = interpolate(air, w, i, f, SPECIES + c)
        if beta > 0.0:
            total += beta
            q += beta * air.sample_density[w, c, cell]
            if c == 0:
                p += beta * rayleigh_phase(cosine, air.depolarisation[w])
            else:
                p += beta * aerosol_phase(
                    air.phase_kind[c - 1], air.phase_asymmetry[c - 1, w], air.phase_log_table[c - 1, w], cosine
                )
    return p / total, q / total


@njit(**INNER)
def draw_cosine(air, w, i, f, number, stream):
    """Cosine of a scattering angle from the stand-in of the local phase function; `number` in [0, 1) decides."""
    if air.isotropic_events:
        return 2.0 * number - 1.0
    n_species = air.table.shape[2] - SPECIES
    total = 0.0
    for c in range(n_species):
        total += interpolate(air, w, i, f, SPECIES + c)
    x = uniform(stream) * total
    species = -1
    for c in range(n_species):
        beta = interpolate(air, w, i, f, SPECIES + c)
        if beta > 0.0:
            species = c
            x -= beta
            if x < 0.0:
                break
    cell = draw_from(air.sample_cdf[w, species], number)
    a = cell / N_SAMPLING
    b = (cell + 1) / N_SAMPLING
    a = 2.0 * a * a * a * a
    b = 2.0 * b * b * b * b
    return 1.0 - (a + (b - a) * uniform(stream))


@njit(**INNER)
def turn(dx, dy, dz, cosine, psi, out):
    """Unit vector at the angle acos(cosine) from d, at the azimuth psi about it."""
    sine = math.sqrt(max(0.0, 1.0 - cosine * cosine))
    if abs(dz) < 0.9:
        h = math.sqrt(dx * dx + dy * dy)
        ax, ay, az = -dy / h, dx / h, 0.0
    else:
        h = math.sqrt(dx * dx + dz * dz)
        ax, ay, az = -dz / h, 0.0, dx / h
    bx = dy * az - dz * ay
    by = dz * ax - dx * az
    bz = dx * ay - dy * ax
    u = sine * math.cos(psi)
    v = sine * math.sin(psi)
    x = cosine * dx + u * ax + v * bx
    y = cosine * dy + u * ay + v * by
    z = cosine * dz + u * az + v * bz
    h = 1.0 / math.sqrt(x * x + y * y + z * z)
    out[0] = x * h
    out[1] = y * h
    out[2] = z * h


@njit(**INNER)
def local_frame(px, py, pz, sx, sy, sz, frame):
    """Rows of `frame`: towards the sun along the horizon, sideways, up; returns cos(solar zenith angle)."""
    r = math.sqrt(px * px + py * py + pz * pz)
    ux, uy, uz = px / r, py / r, pz / r
    cos_sun = min(1.0, max(-1.0, ux * sx + uy * sy + uz * sz))
    hx, hy, hz = sx - cos_sun * ux, sy - cos_sun * uy, sz - cos_sun * uz
    h = math.sqrt(hx * hx + hy * hy + hz * hz)
    if h < 1e-9:
        if abs(ux) < 0.9:
            hx, hy, hz = 1.0 - ux * ux, -ux * uy, -ux * uz
        else:
            hx, hy, hz = -uy * ux, 1.0 - uy * uy, -uy * uz
        h = math.sqrt(hx * hx + hy * hy + hz * hz)
    hx, hy, hz = hx / h, hy / h, hz / h
    frame[0, 0], frame[0, 1], frame[0, 2] = hx, hy, hz
    frame[1, 0], frame[1, 1], frame[1, 2] = uy * hz - uz * hy, uz * hx - ux * hz, ux * hy - uy * hx
    frame[2, 0], frame[2, 1], frame[2, 2] = ux, uy, uz
    return cos_sun


@njit(**INNER)
def choose_direction(
    air, steering, w, z, cos_sun, i, f, on_ground, frame, dx, dy, dz, table_fraction, n_candidates,
    cumulative, blurred, u, stream, trial, new,
):  # fmt: skip
    """Draw the next leg's direction into `new`; returns (p / probability density, its cell of directions).

    Candidates have the density table_fraction x (tabulated light x blurred phase function) + the rest x (phase
    function, or the cosine law on the ground).  Of n_candidates one is taken in proportion to g / density, where g is
    the exact phase function x (interpolated light + a share of its mean), and counts mean(g / density) / g instead of
    1 / density (importance resampling, Talbot, Cline & Egbert 2005): unbiased whatever the tables say.
    u: three numbers in [0, 1) that decide the first candidate; trial (3,): work space.
    """
    horizon = horizon_sine(steering, z)
    total = 0.0
    floor = 1.0
    if table_fraction > 0.0:
        ni, nj = nearest_node(steering, z, cos_sun)
        floor = DEFENCE * math.exp(steering.log_mean[w, ni, nj])
        vx = frame[0, 0] * dx + frame[0, 1] * dy + frame[0, 2] * dz
        vy = frame[1, 0] * dx + frame[1, 1] * dy + frame[1, 2] * dz
        vz = frame[2, 0] * dx + frame[2, 1] * dy + frame[2, 2] * dz
        total = weigh_cells(steering, air, w, ni, nj, i, f, horizon, vx, vy, vz, on_ground, cumulative, blurred)
    from_table = table_fraction if total > 0.0 else 0.0
    if from_table == 0.0:
        n_candidates = 1
    sum_weights = 0.0
    taken = -1
    ratio = 0.0
    for candidate in range(n_candidates):
        x = u[0] if candidate == 0 else uniform(stream)
        a = u[1] if candidate == 0 else uniform(stream)
        b = u[2] if candidate == 0 else uniform(stream)
        if x < from_table:
            cell = draw_from(cumulative, x / from_table * total)
            row = cell // N_AZIMUTHS
            g = steering.row_edges[row]
            # the two sides of the horizon are scaled apart, and a cell lies on one of them
            scale = 1.0 - horizon if g >= 0.0 else 1.0 + horizon
            g += a * (steering.row_edges[row + 1] - g)
            up = horizon + scale * g
            k = cell % N_AZIMUTHS
            psi = steering.azimuth_edges[k]
            psi += b * (steering.azimuth_edges[k + 1] - psi)
            level = math.sqrt(max(0.0, 1.0 - up * up))
            cos_psi = level * math.cos(psi)
            sin_psi = level * math.sin(psi)
            for m in range(3):
                trial[m] = cos_psi * frame[0, m] + sin_psi * frame[1, m] + up * frame[2, m]
        else:
            if on_ground:
                turn(frame[2, 0], frame[2, 1], frame[2, 2], math.sqrt(a), 2.0 * math.pi * b, trial)
            else:
                cosine = draw_cosine(air, w, i, f, a, stream)
                turn(dx, dy, dz, cosine, 2.0 * math.pi * b, trial)
            lx = frame[0, 0] * trial[0] + frame[0, 1] * trial[1] + frame[0, 2] * trial[2]
            ly = frame[1, 0] * trial[0] + frame[1, 1] * trial[1] + frame[1, 2] * trial[2]
            up = frame[2, 0] * trial[0] + frame[2, 1] * trial[1] + frame[2, 2] * trial[2]
            cell = cell_of(steering, horizon, lx, ly, up)
        density = 0.0
        if from_table > 0.0:
            share = cumulative[cell]
            if cell > 0:
                share -= cumulative[cell - 1]
            density = from_table * share / total / cell_solid_angle(steering, horizon, cell)
        if on_ground:
            p = max(0.0, up) / math.pi
            density += (1.0 - from_table) * p
        else:
            cosine = min(1.0, max(-1.0, dx * trial[0] + dy * trial[1] + dz * trial[2]))
            p, q = phase_and_density(air, w, i, f, cosine)
            density += (1.0 - from_table) * q
        if p <= 0.0 or density <= 0.0:
            continue
        if n_candidates == 1:
            taken = cell
            ratio = p / density
            for m in range(3):
                new[m] = trial[m]
            break
        light = floor + math.exp(log_light_from(steering, w, z, cos_sun, cell))
        weight = p * light / density
        sum_weights += weight
        if uniform(stream) * sum_weights < weight:
            taken = cell
            ratio = 1.0 / light
            for m in range(3):
                new[m] = trial[m]
    if n_candidates > 1:
        ratio *= sum_weights / n_candidates
    return ratio, taken
