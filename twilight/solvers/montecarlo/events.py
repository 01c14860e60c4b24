"""Scattering events: the point of the next event on a leg, the direction of the leg after it, the matrix of the path.

An event is a row of numbers with named columns; rows wait on a stack.  A direction is drawn by the importance function
and the phase function: with p the phase function towards a candidate, L the light that the importance function expects
from there and q the density that candidates are drawn with, one of several is taken in proportion to p L / q.

Arguments that kernels share: `kernel`.
"""

import math
from typing import NamedTuple

import numpy as np

from twilight.jit.kernels import njit
from twilight.solvers.montecarlo.air import N_SAMPLING, N_SMOOTH, SCATTERING, SPECIES, interpolate
from twilight.solvers.montecarlo.importance import (
    N_AZIMUTHS,
    N_DIRECTIONS,
    cell_of,
    cell_solid_angle,
    horizon_sine,
    log_light_from,
    nearest_node,
    sampling_cell,
    weigh_cells,
)
from twilight.solvers.montecarlo.kernel import (
    INNER,
    components,
    depolarise,
    double_angle,
    draw_from,
    next_reference,
    scatter,
    species_matrix,
    species_polarising,
    uniform,
)
from twilight.solvers.montecarlo.leg import DEPTH, LENGTH, RESCATTERED, SCATTERED, depth_inside
from twilight.solvers.montecarlo.rays import CHORD_COLUMNS, DIRECTION, ORIGIN, REFERENCE

# Columns of an event.
# POINT (3) [km]; HEADING (3), ACROSS (3): unit vectors, direction and reference of the leg that the event lies on.
# MATRIX (9): of the path up to the event, see `kernel.scatter`.
# WEIGHT: of the path; ORDER: of scattering of the sunlight that the next leg gathers.
# ALTITUDE [km]; LEVEL, FRACTION: its place among the levels of the air.
# ON_GROUND: 1 on the ground, else 0.
# NUMBERS (3): in [0, 1), decide the direction of the next leg.
POINT, HEADING, ACROSS, MATRIX = 0, 3, 6, 9
WEIGHT, ORDER, ALTITUDE, LEVEL, FRACTION, ON_GROUND, NUMBERS = range(18, 25)
N_ORDERS = 20
"""Orders of scattering with sums of their own; the last one holds all higher ones."""
EVENT_COLUMNS = NUMBERS + 3
DEFENSIVE_FRACTION = 0.05
"""Fraction of the mean light that a direction counts as having at least, so that no weight grows beyond bounds."""
LEAST_POLARISATION_FACTOR = 0.2
"""Least factor by which a direction counts less because its light would arrive polarised the wrong way."""


@njit(inner=True, **INNER)
def choose_point(pieces, n, ground_scattered, ground_rescattered, importance_fraction, number, stream):
    """Draw a piece of a leg, or its ground, by the importance function or by scattering alone.

    The density is importance_fraction x (light scattered again) + the rest x (light scattered once), both over their
    sums along the leg.

    pieces (M, PIECE_COLUMNS); n: how many of them the leg has; ground_scattered, ground_rescattered: the two weights of
    the ground, as in the columns SCATTERED and RESCATTERED; importance_fraction: in [0, 1); number: in [0, 1), decides
    the piece.

    Returns (index of the piece, or n for the ground; its probability; uniform number within the piece).
    """
    all_scattered = ground_scattered
    all_rescattered = ground_rescattered
    if n > 0:
        all_scattered += pieces[n - 1, SCATTERED]
        all_rescattered += pieces[n - 1, RESCATTERED]
    if all_scattered <= 0.0:
        return n, 0.0, 0.0
    by_importance = importance_fraction if all_rescattered > 0.0 else 0.0
    if number < by_importance:
        column = RESCATTERED
        x = number / by_importance * all_rescattered
    else:
        column = SCATTERED
        x = (number - by_importance) / (1.0 - by_importance) * all_scattered
    k = n
    if n > 0 and x < pieces[n - 1, column]:
        k = draw_from(pieces[:n, column], x)
        scattered = pieces[k, SCATTERED]
        rescattered = pieces[k, RESCATTERED]
        if k > 0:
            scattered -= pieces[k - 1, SCATTERED]
            rescattered -= pieces[k - 1, RESCATTERED]
    else:
        scattered = ground_scattered
        rescattered = ground_rescattered
    probability = (1.0 - by_importance) * scattered / all_scattered
    if by_importance > 0.0:
        probability += by_importance * rescattered / all_rescattered
    return k, probability, uniform(stream)


@njit(inner=True, **INNER)
def event_weight(air, w, piece, t, i, f):
    """Transmittance x scattering x length of a piece (its row), at its fraction t: the weight but for the probability.

    (i, f): the place of the point among the levels.
    """
    within = depth_inside(air, w, piece, t, i, f)
    return piece[LENGTH] * math.exp(-piece[DEPTH] - within) * interpolate(air, w, i, f, SCATTERING)


@njit(inner=True, **INNER)
def mean_matrix(air, w, i, f, cosine):
    """(P12, P22, P33) over P11 at the place (i, f) of the levels; `cosine`: of the scattering angle."""
    if air.isotropic_events:
        return 0.0, 0.0, 0.0
    total = 0.0
    m12 = 0.0
    m22 = 0.0
    m33 = 0.0
    for c in range(air.table.shape[2] - SPECIES):
        beta = interpolate(air, w, i, f, SPECIES + c)
        if beta > 0.0:
            p11, p12, p22, p33 = species_matrix(air, w, c, cosine)
            total += beta * p11
            m12 += beta * p12
            m22 += beta * p22
            m33 += beta * p33
    return m12 / total, m22 / total, m33 / total


@njit(inner=True, **INNER)
def begin_leg(air, w, event, polarised, work):
    """Complete work.new, whose direction is drawn, and work.matrix; returns the factor on the weight of the path.

    event (EVENT_COLUMNS,): where the leg begins; work: `DirectionWorkspace`, with its frame filled.
    """
    new = work.new
    for m in range(3):
        new[ORIGIN + m] = event[POINT + m]
    d = event[HEADING:ACROSS]
    e = event[ACROSS:MATRIX]
    direction = new[DIRECTION:REFERENCE]
    next_reference(d, e, direction, new[REFERENCE:CHORD_COLUMNS])
    if not polarised or event[ON_GROUND] > 0.0:
        depolarise(work.matrix, event[MATRIX:WEIGHT])
        return 1.0
    cosine = min(1.0, max(-1.0, d[0] * direction[0] + d[1] * direction[1] + d[2] * direction[2]))
    m12, m22, m33 = mean_matrix(air, w, int(event[LEVEL]), event[FRACTION], cosine)
    a, b = components(e, d, direction[0], direction[1], direction[2])
    cos_2phi, sin_2phi = double_angle(a, b)
    return scatter(event[MATRIX:WEIGHT], cos_2phi, sin_2phi, m12, m22, m33, work.matrix)


class DirectionWorkspace(NamedTuple):
    """Work space of `choose_direction`.

    cumulative (N_DIRECTIONS,); blurred (N_SMOOTH,); trial (3,); frame (3, 3): rows towards the sun along the horizon,
    sideways, up; new (9,): the next leg as a ray; matrix (9,): of the path on that leg.
    """

    cumulative: np.ndarray
    blurred: np.ndarray
    trial: np.ndarray
    frame: np.ndarray
    new: np.ndarray
    matrix: np.ndarray


@njit(inner=True, cache=True)
def new_workspace():
    """Work space of one thread."""
    return DirectionWorkspace(
        np.empty(N_DIRECTIONS), np.empty(N_SMOOTH), np.empty(3), np.empty((3, 3)), np.empty(9), np.empty(9)
    )


@njit(inner=True, **INNER)
def mean_phase(air, w, i, f, cosine):
    """(P11, q, P12) [sr^-1] at the place (i, f): of the mixture of species; q: the tabulated P11 that is drawn from.

    cosine: of the scattering angle.
    """
    if air.isotropic_events:
        return 0.25 / math.pi, 0.25 / math.pi, 0.0
    cell = sampling_cell(cosine)
    p = 0.0
    q = 0.0
    p12 = 0.0
    total = 0.0
    for c in range(air.table.shape[2] - SPECIES):
        beta = interpolate(air, w, i, f, SPECIES + c)
        if beta > 0.0:
            total += beta
            q += beta * air.sample_density[w, c, cell]
            p11, polarising = species_polarising(air, w, c, cosine)
            p += beta * p11
            p12 += beta * polarising
    return p / total, q / total, p12 / total


@njit(inner=True, **INNER)
def draw_cosine(air, w, i, f, number, stream):
    """Cosine of a scattering angle, drawn from the tabulated phase function at the place (i, f).

    number: in [0, 1), decides.
    """
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
def scattered_direction(dx, dy, dz, cosine, psi, out):
    """Write into out (3,) the unit vector at the angle acos(cosine) from (dx, dy, dz), at the azimuth psi [rad]."""
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


@njit(inner=True, **INNER)
def local_frame(px, py, pz, to_sun, frame):
    """Fill the frame (3, 3) at the point (px, py, pz) [km]; returns the cosine of the sun's zenith angle."""
    sx, sy, sz = to_sun[0], to_sun[1], to_sun[2]
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


@njit(inner=True, **INNER)
def draw_lambertian(frame, a, b, out):
    """Draw a direction after the Lambertian ground into out (3,), of the density cos(zenith angle) / pi.

    frame (3, 3): two horizontal unit vectors and the vertical; a, b: in [0, 1), decide.
    """
    up = math.sqrt(a)
    level = math.sqrt(max(0.0, 1.0 - up * up))
    x, y = level * math.cos(2.0 * math.pi * b), level * math.sin(2.0 * math.pi * b)
    for m in range(3):
        out[m] = x * frame[0, m] + y * frame[1, m] + up * frame[2, m]


@njit(inner=True, **INNER)
def draw_direction(air, importance, w, event, mixture, numbers, stream, work):
    """Draw a candidate into work.trial from the mixture of `choose_direction`; returns its cell of directions.

    event (EVENT_COLUMNS,); mixture: sine of the horizon's elevation, fraction of the draws by the table, and the sum of
    its weights; numbers (3): in [0, 1), decide between table and phase function, and the two angles; work:
    `DirectionWorkspace`, with its frame and, for the table, its running sums filled.
    """
    horizon, from_table, total = mixture
    number, a, b = numbers
    frame = work.frame
    trial = work.trial
    if number < from_table:
        cell = draw_from(work.cumulative, number / from_table * total)
        row = cell // N_AZIMUTHS
        g = importance.row_edges[row]
        # the two sides of the horizon are scaled apart, and a cell lies on one of them
        scale = 1.0 - horizon if g >= 0.0 else 1.0 + horizon
        g += a * (importance.row_edges[row + 1] - g)
        up = horizon + scale * g
        k = cell % N_AZIMUTHS
        psi = importance.azimuth_edges[k]
        psi += b * (importance.azimuth_edges[k + 1] - psi)
        level = math.sqrt(max(0.0, 1.0 - up * up))
        cos_psi = level * math.cos(psi)
        sin_psi = level * math.sin(psi)
        for m in range(3):
            trial[m] = cos_psi * frame[0, m] + sin_psi * frame[1, m] + up * frame[2, m]
        return cell
    if event[ON_GROUND] > 0.0:
        draw_lambertian(frame, a, b, trial)
    else:
        cosine = draw_cosine(air, w, int(event[LEVEL]), event[FRACTION], a, stream)
        dx, dy, dz = event[HEADING], event[HEADING + 1], event[HEADING + 2]
        scattered_direction(dx, dy, dz, cosine, 2.0 * math.pi * b, trial)
    x = frame[0, 0] * trial[0] + frame[0, 1] * trial[1] + frame[0, 2] * trial[2]
    y = frame[1, 0] * trial[0] + frame[1, 1] * trial[1] + frame[1, 2] * trial[2]
    up = frame[2, 0] * trial[0] + frame[2, 1] * trial[1] + frame[2, 2] * trial[2]
    return cell_of(importance, horizon, x, y, up)


@njit(inner=True, **INNER)
def choose_direction(air, importance, w, walk, event, cos_sun, stream, work):
    """Draw the next leg's direction into work.new; returns (p / probability density, light expected from there).

    Candidates have the density direction_fraction x (tabulated light x blurred phase function) + the rest x (phase
    function, or `draw_lambertian`).  Of n_candidates one is taken in proportion to g / density, g being the exact phase
    function x (interpolated light + a fraction of its mean) x what the path's matrix makes of unpolarised light from
    there, and counts mean(g / density) / g instead of 1 / density: importance resampling (Talbot, Cline & Egbert 2005),
    unbiased whatever the tables say.

    walk: `WalkOptions`, of which direction_fraction counts up to N_ORDERS events; event (EVENT_COLUMNS,); cos_sun:
    cosine of the sun's zenith angle there; work: `DirectionWorkspace`, with its frame filled.
    """
    direction_fraction = walk.importance_direction_fraction if event[ORDER] <= N_ORDERS else 0.0
    n_candidates = walk.direction_candidates
    frame = work.frame
    trial = work.trial
    on_ground = event[ON_GROUND] > 0.0
    i, f = int(event[LEVEL]), event[FRACTION]
    z = event[ALTITUDE]
    d = event[HEADING:ACROSS]
    e = event[ACROSS:MATRIX]
    vector = walk.later.polarised and not on_ground
    horizon = horizon_sine(importance, z)
    total = 0.0
    floor = 1.0
    if direction_fraction > 0.0:
        node = nearest_node(importance, z, cos_sun)
        floor = DEFENSIVE_FRACTION * math.exp(importance.log_mean[w, node[0], node[1]])
        vx = frame[0, 0] * d[0] + frame[0, 1] * d[1] + frame[0, 2] * d[2]
        vy = frame[1, 0] * d[0] + frame[1, 1] * d[1] + frame[1, 2] * d[2]
        vz = frame[2, 0] * d[0] + frame[2, 1] * d[1] + frame[2, 2] * d[2]
        total = weigh_cells(importance, air, w, node, (i, f), horizon, (vx, vy, vz), on_ground, work)
    from_table = direction_fraction if total > 0.0 else 0.0
    if from_table == 0.0:
        n_candidates = 1
    sum_weights = 0.0
    expected = 1.0
    ratio = 0.0
    for candidate in range(n_candidates):
        x = event[NUMBERS] if candidate == 0 else uniform(stream)
        a = event[NUMBERS + 1] if candidate == 0 else uniform(stream)
        b = event[NUMBERS + 2] if candidate == 0 else uniform(stream)
        cell = draw_direction(air, importance, w, event, (horizon, from_table, total), (x, a, b), stream, work)
        density = 0.0
        if from_table > 0.0:
            of_cell = work.cumulative[cell]
            if cell > 0:
                of_cell -= work.cumulative[cell - 1]
            density = from_table * of_cell / total / cell_solid_angle(importance, horizon, cell)
        favour = 1.0
        cosine = min(1.0, max(-1.0, d[0] * trial[0] + d[1] * trial[1] + d[2] * trial[2]))
        p12 = 0.0
        if on_ground:
            up = frame[2, 0] * trial[0] + frame[2, 1] * trial[1] + frame[2, 2] * trial[2]
            q = max(0.0, up) / math.pi
            # a Lambertian ground's albedo is in the weight already
            p = q
        else:
            p, q, p12 = mean_phase(air, w, i, f, cosine)
        density += (1.0 - from_table) * q
        if vector and p > 0.0:
            along, across = components(e, d, trial[0], trial[1], trial[2])
            c2, s2 = double_angle(along, across)
            favour = max(LEAST_POLARISATION_FACTOR, 1.0 + (event[MATRIX + 1] * c2 + event[MATRIX + 2] * s2) * p12 / p)
        if p <= 0.0 or density <= 0.0:
            continue
        if n_candidates == 1:
            ratio = p / density
            if direction_fraction > 0.0:
                expected = floor + math.exp(log_light_from(importance, w, z, cos_sun, cell))
            for m in range(3):
                work.new[DIRECTION + m] = trial[m]
            break
        light = floor + math.exp(log_light_from(importance, w, z, cos_sun, cell))
        weight = p * light * favour / density
        sum_weights += weight
        if uniform(stream) * sum_weights < weight:
            expected = light
            ratio = 1.0 / (light * favour)
            for m in range(3):
                work.new[DIRECTION + m] = trial[m]
    if n_candidates > 1:
        ratio *= sum_weights / n_candidates
    return ratio, expected
