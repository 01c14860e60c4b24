"""Where a path goes on: the point of the next event on a leg, and the direction of the leg after it."""

from __future__ import annotations

import math

from numba import njit

from twilight.phase import aerosol_phase, rayleigh_phase
from twilight.solvers.montecarlo.air import EVENT, N_SAMPLING, SPECIES, interpolate, locate
from twilight.solvers.montecarlo.kernel import INNER
from twilight.solvers.montecarlo.leg import (
    DEPTH,
    FIRST,
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
    nearest_node,
    sampling_cell,
    weigh_cells,
)


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
def event_weight(air, w, pieces, k, t, z, i, f):
    """Transmittance x scattering x length of a piece, at its fraction t: the weight but for the probability."""
    length = pieces[k, LENGTH]
    depth = pieces[k, DEPTH] + depth_within(pieces[k, LOWER], pieces[k, MIDDLE], pieces[k, UPPER], length, t)
    return length * math.exp(-depth) * interpolate(air, w, i, f, EVENT)


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
    air,
    steering,
    w,
    z,
    cos_sun,
    i,
    f,
    on_ground,
    frame,
    dx,
    dy,
    dz,
    table_fraction,
    cumulative,
    blurred,
    u,
    stream,
    new,
):
    """Draw the next leg's direction into `new`; returns (p / probability density, cell of directions).

    The density is table_fraction x (tabulated light x blurred phase function) + the rest x (phase function, or the
    cosine law on the ground); the weight stays below 1 / (1 - table_fraction).  u: three numbers in [0, 1) that decide.
    """
    horizon = horizon_sine(steering, z)
    total = 0.0
    if table_fraction > 0.0:
        ni, nj = nearest_node(steering, z, cos_sun)
        vx = frame[0, 0] * dx + frame[0, 1] * dy + frame[0, 2] * dz
        vy = frame[1, 0] * dx + frame[1, 1] * dy + frame[1, 2] * dz
        vz = frame[2, 0] * dx + frame[2, 1] * dy + frame[2, 2] * dz
        total = weigh_cells(steering, air, w, ni, nj, i, f, horizon, vx, vy, vz, on_ground, cumulative, blurred)
    from_table = table_fraction if total > 0.0 else 0.0
    if u[0] < from_table:
        cell = draw_from(cumulative, u[0] / from_table * total)
        row = cell // N_AZIMUTHS
        g = steering.row_edges[row]
        # the two sides of the horizon are scaled apart, and a cell lies on one of them
        scale = 1.0 - horizon if g >= 0.0 else 1.0 + horizon
        g += u[1] * (steering.row_edges[row + 1] - g)
        up = horizon + scale * g
        a = cell % N_AZIMUTHS
        psi = steering.azimuth_edges[a]
        psi += u[2] * (steering.azimuth_edges[a + 1] - psi)
        level = math.sqrt(max(0.0, 1.0 - up * up))
        for m in range(3):
            new[m] = level * math.cos(psi) * frame[0, m] + level * math.sin(psi) * frame[1, m] + up * frame[2, m]
    elif on_ground:
        turn(frame[2, 0], frame[2, 1], frame[2, 2], math.sqrt(u[1]), 2.0 * math.pi * u[2], new)
    else:
        cosine = draw_cosine(air, w, i, f, u[1], stream)
        turn(dx, dy, dz, cosine, 2.0 * math.pi * u[2], new)
    lx = frame[0, 0] * new[0] + frame[0, 1] * new[1] + frame[0, 2] * new[2]
    ly = frame[1, 0] * new[0] + frame[1, 1] * new[1] + frame[1, 2] * new[2]
    lz = frame[2, 0] * new[0] + frame[2, 1] * new[1] + frame[2, 2] * new[2]
    cell = cell_of(steering, horizon, lx, ly, lz)
    density = 0.0
    if from_table > 0.0:
        share = cumulative[cell]
        if cell > 0:
            share -= cumulative[cell - 1]
        density = from_table * share / total / cell_solid_angle(steering, horizon, cell)
    if on_ground:
        p = max(0.0, lz) / math.pi
        density += (1.0 - from_table) * p
    else:
        cosine = min(1.0, max(-1.0, dx * new[0] + dy * new[1] + dz * new[2]))
        p, q = phase_and_density(air, w, i, f, cosine)
        density += (1.0 - from_table) * q
    if p <= 0.0 or density <= 0.0:
        return 0.0, cell
    return p / density, cell
