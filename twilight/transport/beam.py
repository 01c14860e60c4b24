"""The direct sun beam at any point of the air: one table per medium that every solver looks up.

Irradiance at normal incidence over F0 is transmittance x spreading of the refracted beam (DESIGN fact 7)

    E/F0 = exp(-tau) n^2 sin(i)/sin(chi) / (d chi/d i),

i the apparent and chi the true zenith angle of the sun.  Its logarithm is tabulated in the coordinates of the ray that
arrives, because these follow the features of the field, which chi does not:

* a ray from above (i <= 90 deg): altitude x apparent cosine.  Only air above the point matters, so nothing is sharper
  than the levels of the medium, and tables end at every jump of a coefficient.
* a ray that has passed its lowest point: invariant p x distance u from the lowest point.  The table holds the sum of the
  logarithms of this ray and of its mirror image from above, which is the whole ray through the limb: nearly independent
  of u.  The sharp features (the limb of an aerosol layer, the ground) lie at fixed p.

In a segment between two jumps a..b the nodes are uniform in sqrt((b - z)/(b - a)): just below a jump optical depths go
like a square root.  Interpolation is cubic and never crosses a jump.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit

from twilight.atmosphere.medium import Medium
from twilight.transport import beam_tables
from twilight.transport.rays import RayProfile, lowest_point, ray_profile, refractivity_at

_FAR_KM = 400.0
_NEAR_KM = 300.0
_COSINE = 0.05
_DEPTH = 0.05
_MAX_DISTANCE_KM = 5.0e4
_HASH = 1024


class Beam(NamedTuple):
    """Tables of the direct sun beam; see the module.  S segments, J altitudes, C cosines, Y limb rays, D distances."""

    radius_km: float
    top_km: float
    refracting: bool
    n_wavelengths: int
    segment_hash: np.ndarray
    segment_bottom_km: np.ndarray
    segment_top_km: np.ndarray
    segment_size: np.ndarray
    segment_start: np.ndarray
    limb_hash: np.ndarray
    limb_bottom_km: np.ndarray
    limb_top_km: np.ndarray
    limb_size: np.ndarray
    limb_start: np.ndarray
    refractivity: np.ndarray
    edge_chi: np.ndarray
    guess: np.ndarray
    log_up: np.ndarray
    up_bending: np.ndarray
    limb_bending: np.ndarray
    log_down: np.ndarray
    shift_km: np.ndarray
    dispersion: np.ndarray
    dispersing: bool
    far_km: float
    overhead: np.ndarray


def _segments(medium: Medium, profile: RayProfile, max_breaks: int) -> np.ndarray:
    """Altitudes [km] where tables must end: jumps and strong bends of the extinction, the rest evenly cut."""
    z = medium.altitude_km
    k = medium.extinction_per_km + 1e-30
    lower, upper = k[:-1], k[1:]
    bends = {}
    # a bend of tau(z) at a level is worth (jump of k) x (half a table step) x (horizontal air mass ~ 40)
    for i in range(1, z.size - 1):
        if z[i] == z[i - 1] or z[i] <= z[0] or z[i] >= z[-1]:
            continue
        j = i
        while j + 1 < z.size and z[j + 1] == z[i]:
            j += 1
        jump = np.max(np.abs(k[j] - k[i]))
        below, above = z[i] - z[i - 1], z[j + 1] - z[j]
        slope_jump = np.max(np.abs((k[i] - lower[i - 1]) / below - (upper[j] - k[j]) / above))
        step = 0.1
        bends[float(z[i])] = 40.0 * (jump * step / 4.0 + slope_jump * step**2 / 16.0)
    strong = sorted((zz for zz, b in bends.items() if b > 1e-3), key=lambda zz: -bends[zz])[:max_breaks]
    edges = [float(z[0]), *sorted(strong), float(z[-1])]
    cut = [edges[0]]
    for b in edges[1:]:
        while True:
            a = cut[-1]
            longest = 2.0 + 0.6 * (a - edges[0])
            if b - a <= 1.5 * longest:
                cut.append(b)
                break
            cut.append(a + longest)
    return np.array(cut)


def _nodes(edges: np.ndarray, profile: RayProfile, per_scale: float, smallest: int, largest: int):
    """Numbers of intervals, first node and node altitudes of every segment."""
    size = np.empty(edges.size - 1, dtype=np.int64)
    for s, (a, b) in enumerate(zip(edges[:-1], edges[1:], strict=True)):
        inside = (profile.top_km > a) & (profile.bottom_km < b)
        share = np.minimum(profile.top_km[inside], b) - np.maximum(profile.bottom_km[inside], a)
        steep = np.zeros(share.size)
        for part in range(4, 13, 3):
            value = profile.coefficient[:, inside, part]
            q = np.abs(profile.coefficient[:, inside, part + 1])
            steep = np.maximum(steep, np.where(value > 1e-6, q, 0.0).max(axis=0))
        folds = float((steep * share / (profile.top_km - profile.bottom_km)[inside]).sum())
        size[s] = int(np.clip(math.ceil(per_scale * max(folds, 0.2 * (b - a) ** 0.5)), smallest, largest))
    start = np.concatenate([[0], np.cumsum(size)]).astype(np.int64)
    nodes = np.empty(start[-1] + 1)
    for s, (a, b) in enumerate(zip(edges[:-1], edges[1:], strict=True)):
        t = 1.0 - np.arange(size[s] + 1) / size[s]
        nodes[start[s] : start[s + 1] + 1] = b - (b - a) * t**2
        nodes[start[s]] = a
    return size, start[:-1], nodes


def _limb_edges(edges: np.ndarray, profile: RayProfile, w: int) -> tuple[np.ndarray, np.ndarray]:
    """Edges that a ray from space can have as its lowest point, and n r there: in a duct n r is not below all above."""
    r = profile.radius_km
    candidates = np.unique(np.concatenate([edges, profile.bottom_km[profile.bottom_km >= edges[0]]]))
    x = np.array([(r + z) * (1.0 + refractivity_at(profile, w, z)) for z in candidates])
    x[-1] = r + candidates[-1]
    lowest_above = np.minimum.accumulate(x[::-1])[::-1]
    first = int(np.flatnonzero(x <= lowest_above)[0])
    keep = np.isin(candidates, edges) & (candidates > candidates[first])
    keep[first] = True
    keep[:-1] &= x[:-1] < lowest_above[1:] - 1e-9 * r
    keep[-1] = True
    return candidates[keep], x[keep]


def _uniform_in_invariant(lowest, edges, x, size, start, profile: RayProfile, w: int) -> np.ndarray:
    """Altitudes [km] of the lowest points of rays uniform in sqrt((x_b - p)/(x_b - x_a)) in every segment a..b."""
    out = np.array(lowest)
    for s in range(size.size):
        for m in range(1, size[s]):
            p = x[s + 1] - (x[s + 1] - x[s]) * (1.0 - m / size[s]) ** 2
            u = math.sqrt((x[s + 1] - p) * (x[s + 1] + p))
            out[start[s] + m] = lowest_point(profile, w, edges[s + 1], u, False)[0]
    return out


def _hash(bottom: np.ndarray, top: np.ndarray) -> np.ndarray:
    """Segment that holds the lower end of each of `_HASH` equal bins, so that a lookup starts next to its segment."""
    bins = bottom[0] + (top[-1] - bottom[0]) * np.arange(_HASH + 1) / _HASH
    return np.clip(np.searchsorted(top, bins, side="right"), 0, top.size - 1).astype(np.int64)


def prepare_beam(
    medium: Medium,
    *,
    refraction: bool = True,
    spreading: bool = True,
    altitude_nodes_per_scale: float = 8.0,
    limb_nodes_per_scale: float = 16.0,
    cosine_nodes: int = 40,
    distance_nodes: int = 12,
    guess_nodes: int = 48,
    spreading_window_km: float = 0.25,
    max_breaks: int = 120,
) -> Beam:
    """Tables of the direct sun beam in `medium`, for every altitude and every position of the sun.

    refraction: bend the rays by `medium.refractivity`; without it they are straight.
    spreading: include the dilution of the beam by differential refraction.
    altitude_nodes_per_scale, limb_nodes_per_scale: nodes per factor e of the steepest coefficient.
    cosine_nodes, distance_nodes, guess_nodes: intervals of the other coordinates.
    spreading_window_km: half-width in altitude over which the bending of limb rays is differentiated.
    """
    refraction = refraction and medium.has_refraction
    profile = ray_profile(medium, refraction=refraction)
    n_w = medium.n_wavelengths
    edges = _segments(medium, profile, max_breaks)
    size, start, altitudes = _nodes(edges, profile, altitude_nodes_per_scale, 6, 64)
    ground = np.array([refractivity_at(profile, w, edges[0]) for w in range(n_w)])
    reference = int(np.argmax(ground))
    limb_edges, limb_x = _limb_edges(edges, profile, reference)
    limb_size, limb_start, lowest = _nodes(limb_edges, profile, limb_nodes_per_scale, 8, 128)
    lowest = _uniform_in_invariant(lowest, limb_edges, limb_x, limb_size, limb_start, profile, reference)
    scale = ground / ground[reference] if ground[reference] > 0 else np.ones(n_w)
    invariant, bending = np.empty((n_w, lowest.size)), np.empty((n_w, lowest.size))
    slope, free = np.empty((n_w, lowest.size)), np.empty((n_w, lowest.size), dtype=np.bool_)
    for w in range(n_w):
        beam_tables.limb_table(profile, w, lowest, spreading_window_km, invariant[w], bending[w], slope[w], free[w])
    lowest_free = float(lowest[int(np.argmax(free[reference]))])
    for m in range(1, lowest.size):
        if not free[reference, m]:
            bending[reference, m] = bending[reference, m - 1]

    edge_chi, edge_cos = np.empty(altitudes.size), np.empty(altitudes.size)
    beam_tables.edge_table(profile, reference, altitudes, lowest_free, edge_chi, edge_cos)
    t = np.arange(guess_nodes + 1) / guess_nodes
    depths = _DEPTH * t / (1.0 + _DEPTH - t)
    guess = np.zeros((altitudes.size, guess_nodes + 1, 2))
    if refraction:
        beam_tables.guess_table(
            profile, reference, altitudes, depths, edge_chi, edge_cos, lowest, slope[reference], guess
        )
    t = np.arange(cosine_nodes + 1) / cosine_nodes
    cosines = _COSINE * t / (1.0 + _COSINE - t)
    log_up = np.empty((altitudes.size, cosine_nodes + 1, n_w))
    up_bending, beta = np.empty(log_up.shape[:2]), np.empty(log_up.shape[:2])
    beam_tables.up_table(
        profile, reference, altitudes, cosines, scale, lowest, slope, spreading and refraction, log_up, up_bending, beta
    )
    t = np.arange(distance_nodes + 1) / distance_nodes * (_MAX_DISTANCE_KM / (_MAX_DISTANCE_KM + _NEAR_KM))
    distances = _NEAR_KM * t / (1.0 - t)
    shift = np.zeros((lowest.size, distance_nodes + 1))
    other = int(np.argmin(scale))
    dispersing = bool(refraction and scale[other] < 1.0 - 1e-9)
    if dispersing:
        beam_tables.shift_table(profile, reference, other, lowest, invariant[reference], distances, slope, shift)
        shift /= 1.0 - scale[other]
    log_down = np.empty((n_w, lowest.size, distance_nodes + 1))
    far = _FAR_KM if spreading and refraction else 1e300
    beam_tables.down_table(
        profile,
        reference,
        lowest,
        invariant[reference],
        distances,
        scale,
        shift,
        slope,
        spreading and refraction,
        far,
        log_down,
    )
    bottoms, tops = limb_x[:-1], limb_x[1:]
    return Beam(
        radius_km=float(medium.earth_radius_km),
        top_km=medium.top_km,
        refracting=bool(refraction),
        n_wavelengths=n_w,
        segment_hash=_hash(edges[:-1], edges[1:]),
        segment_bottom_km=np.ascontiguousarray(edges[:-1]),
        segment_top_km=np.ascontiguousarray(edges[1:]),
        segment_size=size,
        segment_start=start,
        limb_hash=_hash(bottoms, tops),
        limb_bottom_km=np.ascontiguousarray(bottoms),
        limb_top_km=np.ascontiguousarray(tops),
        limb_size=limb_size,
        limb_start=limb_start,
        refractivity=np.array([refractivity_at(profile, reference, z) for z in altitudes]),
        edge_chi=edge_chi,
        guess=guess,
        log_up=log_up,
        up_bending=up_bending,
        limb_bending=np.ascontiguousarray(bending[reference]),
        log_down=log_down,
        shift_km=shift,
        dispersion=1.0 - scale,
        dispersing=dispersing,
        far_km=far,
        overhead=np.ascontiguousarray(medium.overhead_absorption_optical_depth, dtype=float),
    )


@njit(cache=True, inline="always")
def _weights(f):
    """Cubic Lagrange weights for nodes 0, 1, 2, 3 at f."""
    a = f - 1.0
    b = f - 2.0
    c = f - 3.0
    bc = b * c
    fa = f * a
    return a * bc * (-1.0 / 6.0), 0.5 * f * bc, -0.5 * fa * c, fa * b * (1.0 / 6.0)


@njit(cache=True, inline="always")
def _locate(value, hashed, bottom, top, size, start):
    """First of four nodes and the position behind it (0..3) for a coordinate cut in segments."""
    n = bottom.size
    bin_ = int((value - bottom[0]) / (top[n - 1] - bottom[0]) * (hashed.size - 1))
    s = hashed[min(hashed.size - 1, max(0, bin_))]
    while s > 0 and value < bottom[s]:
        s -= 1
    while s < n - 1 and value > top[s]:
        s += 1
    t = 1.0 - math.sqrt(min(1.0, max(0.0, (top[s] - value) / (top[s] - bottom[s]))))
    position = t * size[s]
    first = min(size[s] - 3, max(0, int(position) - 1))
    return start[s] + first, position - first


@njit(cache=True, inline="always")
def _uniform(position, n):
    """First of four nodes of n + 1 and the position behind it."""
    first = min(n - 3, max(0, int(position) - 1))
    return first, position - first


@njit(cache=True, inline="always")
def _blend(table, first, w):
    return w[0] * table[first] + w[1] * table[first + 1] + w[2] * table[first + 2] + w[3] * table[first + 3]


@njit(cache=True, inline="always")
def _blend2(table, row, rows, first, w):
    """Bicubic value of table[row.., first..]."""
    value = 0.0
    for i in range(4):
        k = row + i
        value += rows[i] * (
            w[0] * table[k, first]
            + w[1] * table[k, first + 1]
            + w[2] * table[k, first + 2]
            + w[3] * table[k, first + 3]
        )
    return value


@njit(cache=True)
def _ray(beam, z, c):
    """The ray of the reference wavelength at a point inside the air.

    Returns (lit, bending, invariant p, u = n r cos i, first altitude node, position behind it).
    """
    jz, fz = _locate(
        z, beam.segment_hash, beam.segment_bottom_km, beam.segment_top_km, beam.segment_size, beam.segment_start
    )
    r = beam.radius_km + z
    s = math.sqrt((1.0 - c) * (1.0 + c))
    p_ground = beam.limb_bottom_km[0]
    if not beam.refracting:
        return c >= 0.0 or r * s >= p_ground, 0.0, r * s, r * c, jz, fz
    rows = _weights(fz)
    edge = _blend(beam.edge_chi, jz, rows)
    chi = math.acos(c)
    depth = (edge - chi) / edge
    if depth < -1e-5:
        return False, 0.0, 0.0, 0.0, jz, fz
    depth = max(0.0, depth)
    n_g = beam.guess.shape[1] - 1
    g = depth * (1.0 + _DEPTH) / (depth + _DEPTH) * n_g
    k = min(n_g - 1, int(g))
    g -= k
    j = jz + min(2, int(fz))
    f = fz - (j - jz)
    w00 = (1.0 - f) * (1.0 - g)
    w01 = (1.0 - f) * g
    w10 = f * (1.0 - g)
    w11 = f * g
    t = beam.guess
    bending = w00 * t[j, k, 0] + w01 * t[j, k + 1, 0] + w10 * t[j + 1, k, 0] + w11 * t[j + 1, k + 1, 0]
    slope = w00 * t[j, k, 1] + w01 * t[j, k + 1, 1] + w10 * t[j + 1, k, 1] + w11 * t[j + 1, k + 1, 1]
    x = r * (1.0 + _blend(beam.refractivity, jz, rows))
    # one Newton step from the guess with the finer tables
    sb = math.sin(bending)
    cb = math.cos(bending)
    cos_i = c * cb + s * sb
    a = abs(cos_i)
    n_c = beam.up_bending.shape[1] - 1
    m, fm = _uniform(a * (1.0 + _COSINE) / (a + _COSINE) * n_c, n_c)
    value = _blend2(beam.up_bending, jz, rows, m, _weights(fm))
    if cos_i < 0.0:
        p = x * (s * cb - c * sb)
        if p < p_ground - 1e-4 * x:
            return False, bending, p, x * cos_i, jz, fz
        ky, fy = _locate(p, beam.limb_hash, beam.limb_bottom_km, beam.limb_top_km, beam.limb_size, beam.limb_start)
        value = _blend(beam.limb_bending, ky, _weights(fy)) - value
    bending = max(0.0, bending + (value - bending) / (1.0 + slope))
    sb = math.sin(bending)
    cb = math.cos(bending)
    cos_i = c * cb + s * sb
    p = x * abs(s * cb - c * sb)
    return cos_i >= 0.0 or p >= p_ground * (1.0 - 1e-13), bending, p, x * cos_i, jz, fz


@njit(cache=True)
def _ray_from_space(beam, altitude_km, c):
    """(lit, bending, p, u) of the reference ray at a point above the top of the air."""
    r = beam.radius_km + altitude_km
    p_top = beam.limb_top_km[beam.limb_top_km.size - 1]
    s = math.sqrt((1.0 - c) * (1.0 + c))
    if c >= 0.0 or r * s >= p_top:
        return True, 0.0, r * s, abs(r * c)
    chi = math.acos(c)
    lo = beam.limb_bottom_km[0]
    hi = p_top
    p = lo
    bending = beam.limb_bending[0]
    if math.pi - math.asin(lo / r) + bending < chi:
        return False, 0.0, 0.0, 0.0
    for _ in range(48):
        p = 0.5 * (lo + hi)
        ky, fy = _locate(p, beam.limb_hash, beam.limb_bottom_km, beam.limb_top_km, beam.limb_size, beam.limb_start)
        bending = _blend(beam.limb_bending, ky, _weights(fy)) if beam.refracting else 0.0
        if math.pi - math.asin(p / r) + bending > chi:
            lo = p
        else:
            hi = p
    return True, bending, p, -math.sqrt((r - p) * (r + p))


@njit(cache=True)
def beam_at(beam, altitude_km, cos_sun_zenith, out):
    """Irradiance of the sun beam on a surface normal to it, over F0, at one point and every wavelength.

    beam: from :func:`prepare_beam`.  altitude_km: of the point, below the ground counts as the ground.
    cos_sun_zenith: cosine of the true zenith angle of the sun at the point.
    out (W,): filled; exactly 0 in the shadow of the refracted limb.
    Returns the bending [rad] >= 0: true minus apparent zenith angle of the sun.
    """
    return _look_up(beam, altitude_km, cos_sun_zenith, 0, beam.n_wavelengths, out)


@njit(cache=True)
def beam_at_one(beam, altitude_km, cos_sun_zenith, w):
    """(irradiance over F0, bending [rad]) of :func:`beam_at` at wavelength index `w` alone."""
    out = np.empty(1)
    bending = _look_up(beam, altitude_km, cos_sun_zenith, w, w + 1, out)
    return out[0], bending


@njit(cache=True)
def _look_up(beam, altitude_km, cos_sun_zenith, w_first, w_end, out):
    c = min(1.0, max(-1.0, cos_sun_zenith))
    z = max(altitude_km, beam.segment_bottom_km[0])
    n_w = w_end - w_first
    space = z > beam.top_km
    jz = 0
    fz = 0.0
    if space:
        lit, bending, p, u = _ray_from_space(beam, z, c)
        if lit and u >= 0.0:
            for w in range(n_w):
                out[w] = math.exp(-beam.overhead[w_first + w])
            return bending
    else:
        lit, bending, p, u, jz, fz = _ray(beam, z, c)
    if not lit:
        for w in range(n_w):
            out[w] = 0.0
        return bending
    for w in range(n_w):
        out[w] = -beam.overhead[w_first + w]
    if not space:
        n_c = beam.up_bending.shape[1] - 1
        a = abs(u) / math.sqrt(u * u + p * p)
        m, fm = _uniform(a * (1.0 + _COSINE) / (a + _COSINE) * n_c, n_c)
        rows = _weights(fz)
        columns = _weights(fm)
        sign = 1.0 if u >= 0.0 else -1.0
        table = beam.log_up
        for i in range(4):
            w0 = sign * rows[i] * columns[0]
            w1 = sign * rows[i] * columns[1]
            w2 = sign * rows[i] * columns[2]
            w3 = sign * rows[i] * columns[3]
            k = jz + i
            for w in range(n_w):
                v = w_first + w
                out[w] += (
                    w0 * table[k, m, v] + w1 * table[k, m + 1, v] + w2 * table[k, m + 2, v] + w3 * table[k, m + 3, v]
                )
    if u >= 0.0:
        for w in range(n_w):
            out[w] = math.exp(out[w])
        return bending
    u = -u
    n_d = beam.shift_km.shape[1] - 1
    d, fd = _uniform(min(1.0, u / (u + _NEAR_KM) * ((_MAX_DISTANCE_KM + _NEAR_KM) / _MAX_DISTANCE_KM)) * n_d, n_d)
    columns = _weights(fd)
    ky, fy = _locate(p, beam.limb_hash, beam.limb_bottom_km, beam.limb_top_km, beam.limb_size, beam.limb_start)
    rows = _weights(fy)
    shift = _blend2(beam.shift_km, ky, rows, d, columns) if beam.dispersing else 0.0
    factor = 1.0 / (1.0 + u / beam.far_km)
    down = beam.log_down
    for w in range(n_w):
        v = w_first + w
        if beam.dispersing:
            own = p + beam.dispersion[v] * shift
            if own < beam.limb_bottom_km[0] and beam.dispersion[v] > 0.0:
                out[w] = 0.0
                continue
            ky, fy = _locate(
                own, beam.limb_hash, beam.limb_bottom_km, beam.limb_top_km, beam.limb_size, beam.limb_start
            )
            rows = _weights(fy)
        value = out[w]
        for i in range(4):
            k = ky + i
            value += rows[i] * (
                columns[0] * down[v, k, d]
                + columns[1] * down[v, k, d + 1]
                + columns[2] * down[v, k, d + 2]
                + columns[3] * down[v, k, d + 3]
            )
        out[w] = factor * math.exp(value)
    return bending
