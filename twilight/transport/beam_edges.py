"""The part of the sunbeam's optical depth that is sharp at edges of layers, in closed form.

The extinction K(x) per length of a straight path, as a function of x = n r, is cut in two: S(x), which holds every
jump and every strong bend of K, and K - S, which is smooth.  The tables of :mod:`twilight.transport.beam` hold what
K - S does; what S does is added by formula, because beside an edge the depth of a grazing ray falls from tens to
nothing within hundredths of a degree, which no table follows.

S is a cubic in x^2 on each of a few pieces of the air and 0 elsewhere.  With s^2 = x^2 - p^2 along a ray of invariant
p, the top of a piece at s_e and its span D = x_e^2 - x_d^2, the depth from s to the top is

    int_s^s_e sum_k c_k (t/D)^k ds,    t = s_e^2 - s^2 = q (2 s_e - q),    q = s_e - s,

sums of powers of q with no difference of large numbers.  A thin layer is a piece by itself, on which S is K less a
smooth passage from the air above to the air below; in a thick one S falls from the jump at the top to 0 smoothly.
"""

import math
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from twilight.jit.kernels import njit
from twilight.transport.ray_profile import (
    AEROSOL,
    AIR,
    BOTTOM,
    CUBE,
    GASES,
    INDEX,
    INDEX_TOP,
    LOG_SLOPE,
    SLOPE,
    SQUARE,
    RayProfile,
)

JUMP_PER_KM = 2e-4
"""Smallest jump of the extinction [km^-1] that is an edge: a grazing ray has some km within a table's step of it."""
BEND_PER_KM2 = 0.01
"""Smallest change of the extinction's slope [km^-2] that is an edge."""
SMOOTH_BEND_PER_KM2 = 0.003
"""Bend [km^-2] that the passage between the airs above and below a thin layer may have."""
THIN_KM = 3.0
"""Thickness [km] at the ground up to which a layer is one piece, and length of the piece below the top of others."""
THIN_GROWTH = 0.25
"""Growth of `THIN_KM` per height."""
PIECE_CHANGE = 0.5
"""Change of the logarithm of the extinction within a piece: its cubic is right to 2e-4 of the extinction."""
MOST_CUTS = 32
"""Pieces that a layer of the medium may be cut into."""
N_POWER = 4
"""Coefficients of a piece's cubic."""

X_TOP, SPAN, TOP_KM, BOTTOM_KM, N_EDGE_RECORD = range(5)
"""Columns of `Edges.record`: x at the top [km], D = x_top^2 - x_bottom^2 [km^2], altitudes of top and bottom [km]."""


class Edges(NamedTuple):
    """Pieces of S from the ground up.  record (B, N_EDGE_RECORD); coefficient (B, N_POWER, W) [km^-1]: c_k above.

    altitude_km: of all edges.
    """

    record: np.ndarray
    coefficient: np.ndarray
    altitude_km: np.ndarray

    def flat(self) -> np.ndarray:
        """Records, then coefficients, as `edge_depth` reads them."""
        return np.concatenate([self.record.ravel(), self.coefficient.ravel()])


def _part(c: np.ndarray, first: int, f: np.ndarray, cubic: bool) -> tuple[np.ndarray, np.ndarray]:
    """Value and change per layer (W, ...) at the fractions f of a part of the coefficients c (W, N_COLUMNS)."""
    c = c[:, :, None]
    q, d = c[:, first + LOG_SLOPE], c[:, first + SLOPE]
    s, t = (c[:, first + SQUARE], c[:, first + CUBE]) if cubic else (0.0, 0.0)
    exponential = c[:, first + BOTTOM] * np.exp(f * (q + f * (s + f * t)))
    return exponential + d * f, exponential * (q + f * (2.0 * s + 3.0 * f * t)) + d


def _at(profile: RayProfile, i: int, f: np.ndarray) -> tuple[np.ndarray, ...]:
    """Refractivity, its slope, extinction, its slope (F, W) at the fractions f (F,) of layer i."""
    c = profile.coefficient[:, i]
    thickness = profile.top_km[i] - profile.bottom_km[i]
    n, n_change = _part(c, INDEX, f, True)
    parts = [_part(c, AIR, f, True), _part(c, GASES, f, False), _part(c, AEROSOL, f, False)]
    k, change = (np.sum([part[column] for part in parts], axis=0) for column in (0, 1))
    return n.T, n_change.T / thickness, k.T, change.T / thickness


def _candidates(layout: RayProfile, most: int) -> np.ndarray:
    """Altitudes [km] from the ground up between which the extinction of `layout` neither jumps nor bends strongly."""
    ends = np.array([0.0, 1.0])
    values = [_at(layout, i, ends)[2:] for i in range(1, layout.top_km.size)]
    candidates = []
    for i in range(len(values)):
        k, slope = values[i]
        above, above_slope = (values[i + 1][0][0], values[i + 1][1][0]) if i + 1 < len(values) else (0.0, 0.0)
        jump, bend = np.max(np.abs(k[1] - above)), np.max(np.abs(slope[1] - above_slope))
        if jump > JUMP_PER_KM or bend > BEND_PER_KM2:
            candidates.append((jump / JUMP_PER_KM + bend / BEND_PER_KM2, float(layout.top_km[i + 1])))
    strongest = sorted(candidates, reverse=True)[:most]
    return np.array(sorted(z for _, z in strongest))


def _hermite(v0, v1, d0, d1) -> np.ndarray:
    """Coefficients (4, W) of the cubic with values v and slopes d at 0 and at 1."""
    return np.stack([v0, d0, 3.0 * (v1 - v0) - 2.0 * d0 - d1, 2.0 * (v0 - v1) + d0 + d1])


class _Maker:
    """Makes the pieces of one profile from the top down."""

    def __init__(self, profile: RayProfile, layout: RayProfile, reference: int, n_w: int):
        self.profile, self.layout, self.reference = profile, layout, reference
        # wavelengths by which is decided what is an edge: not those of the tables, which must not depend on each other
        self.deciding = slice(n_w, None) if profile.coefficient.shape[0] > n_w else slice(None)
        self.records: list[tuple[float, ...]] = []
        self.coefficients: list[np.ndarray] = []

    def k_at(self, i: int, f) -> tuple[np.ndarray, np.ndarray, float, float]:
        """K and its slope by altitude (W,) at a fraction of layer i, x and dx/dz of the reference."""
        n, n_slope, k, slope = (a[0] for a in _at(self.profile, i, np.array([f])))
        r = self.profile.radius_km + self.profile.bottom_km[i]
        r += f * (self.profile.top_km[i] - self.profile.bottom_km[i])
        if f == 1.0:
            n = self.profile.coefficient[:, i, INDEX_TOP]
        rise = np.maximum(0.05, 1.0 + n + r * n_slope)
        per_x = 1.0 / np.sqrt(rise * rise[self.reference])
        return k * per_x, slope * per_x, r * (1.0 + n[self.reference]), rise[self.reference]

    def largest(self, values: np.ndarray) -> float:
        """Largest size among the deciding wavelengths of values (W,)."""
        return float(np.max(np.abs(values[self.deciding])))

    def add(self, z: tuple[float, float], x: tuple[float, float], rise, values, slopes) -> None:
        """A piece from its bottom to its top: altitudes, x, dx/dz, S and its slope by altitude at both."""
        span = (x[1] - x[0]) * (x[1] + x[0])
        if span <= 0.0:
            return
        # d/d(t/D) = -D/(2 x) d/dx
        d0, d1 = (-span / (2.0 * x[e] * rise[e]) * slopes[e] for e in (1, 0))
        self.records.append((x[1], span, z[1], z[0]))
        self.coefficients.append(_hermite(values[1], values[0], d0, d1))

    def layers_between(self, low: float, high: float) -> list[tuple[int, float, float]]:
        """Layers and fractions of them from the top down, with the extinction's change cut as fine as a cubic takes."""
        bottom, top = self.profile.bottom_km, self.profile.top_km
        out = []
        for i in range(top.size - 1, 0, -1):
            if top[i] <= low + 1e-12 or bottom[i] >= high - 1e-12:
                continue
            k = _at(self.layout, i, np.array([0.0, 0.25, 0.5, 0.75, 1.0]))[2]
            small = 1e-3 * k.max() + 1e-30
            change = float(np.max(np.abs(np.diff(np.log(k + small), axis=0)).sum(axis=0)))
            cuts = int(np.clip(math.ceil(change / PIECE_CHANGE), 1, MOST_CUTS))
            f = np.linspace(1.0, 0.0, cuts + 1)
            out += [(i, float(b), float(a)) for a, b in pairwise(f)]
        return out


def make_edges(profile: RayProfile, layout: RayProfile, reference: int, n_w: int, most: int) -> Edges:
    """The pieces of S for the first `n_w` wavelengths of a profile.

    layout: the same layers at the wavelengths that decide where edges are; reference: the wavelength whose n r is x;
    most: the greatest number of edges.
    """
    edges = _candidates(layout, most)
    make = _Maker(profile, layout, reference, n_w)
    ground = float(profile.bottom_km[1])
    layer_below = {float(z): i for i, z in enumerate(profile.top_km)}
    bounds = [ground, *edges]
    nothing = np.zeros(profile.coefficient.shape[0])
    rest = rest_slope = nothing
    if edges.size and edges[-1] < profile.top_km[-1]:
        rest, rest_slope, _, _ = make.k_at(layer_below[float(edges[-1])] + 1, 0.0)
    for p in range(len(bounds) - 1, 0, -1):
        low, high = bounds[p - 1], bounds[p]
        i = layer_below[high]
        k, slope, x, rise = make.k_at(i, 1.0)
        jump, bend = k - rest, slope - rest_slope
        longest = THIN_KM + THIN_GROWTH * (high - ground)
        first = layer_below[low] + 1 if p > 1 else 1
        below, below_slope, _, _ = make.k_at(first, 0.0)
        if make.largest(jump) <= 0.1 * JUMP_PER_KM and make.largest(bend) <= 0.1 * BEND_PER_KM2:
            rest, rest_slope = below, below_slope
        elif high - low > longest:
            z_low = high - longest
            j = int(np.searchsorted(profile.top_km, z_low, side="right"))
            f = (z_low - profile.bottom_km[j]) / (profile.top_km[j] - profile.bottom_km[j])
            _, _, x_low, rise_low = make.k_at(j, f)
            make.add((z_low, high), (x_low, x), (rise_low, rise), (nothing, jump), (nothing, bend))
            rest, rest_slope = below, below_slope
        else:
            passage = _passage(make, p, first, low, high, rest, rest_slope)
            for i, f_low, f_high in make.layers_between(low, high):
                ends = [make.k_at(i, f) for f in (f_low, f_high)]
                z = [(1.0 - f) * profile.bottom_km[i] + f * profile.top_km[i] for f in (f_low, f_high)]  # exact at ends
                smooth = [passage((high - zz) / (high - low)) for zz in z]
                make.add(
                    (z[0], z[1]),
                    (ends[0][2], ends[1][2]),
                    (ends[0][3], ends[1][3]),
                    [e[0] - s[0] for e, s in zip(ends, smooth, strict=True)],
                    [e[1] - s[1] for e, s in zip(ends, smooth, strict=True)],
                )
            rest, rest_slope = passage(1.0)
    records = np.array(make.records[::-1]).reshape(-1, N_EDGE_RECORD)
    coefficient = np.array(make.coefficients[::-1]).reshape(-1, N_POWER, nothing.size)
    return Edges(records, np.ascontiguousarray(coefficient[:, :, :n_w]), edges)


def _passage(make: _Maker, p: int, first: int, low: float, high: float, rest, rest_slope):
    """K - S in a thin layer as a function of the fraction from its top: value and slope by altitude (W,).

    To the air below where that is smooth, or else on as above, so that the piece below takes the step.
    """
    thickness = high - low
    if p > 1:
        below, below_slope, _, _ = make.k_at(first - 1, 1.0)
    else:  # nothing grazes below the ground
        below, below_slope, _, _ = make.k_at(first, 0.0)
    linear = rest - rest_slope * thickness
    off = np.abs(below - linear) / thickness + np.abs(below_slope - rest_slope)
    if p > 1 and make.largest(off) < SMOOTH_BEND_PER_KM2 * max(1.0, thickness):
        c = _hermite(rest, below, -rest_slope * thickness, -below_slope * thickness)
    else:
        largest = 0.5 * np.maximum(np.abs(rest), JUMP_PER_KM) / thickness
        c = _hermite(rest, rest, 0.0 * rest, 0.0 * rest)
        slope = np.clip(rest_slope, -largest, largest)
        c[1] = -slope * thickness

    def at(f: float):
        value = c[0] + f * (c[1] + f * (c[2] + f * c[3]))
        return value, -(c[1] + f * (2.0 * c[2] + 3.0 * f * c[3])) / thickness

    return at


@njit(inner=True, cache=True, inline=True, makes_arrays=False)
def _in_piece(pool, c, step, s_top, fall, span):
    """Depth of S from the top of a piece, where s is `s_top` [km], down to where s^2 is less by `fall` [km^2].

    c: place of the piece's coefficients in the pool, `step` apart; span [km^2].
    """
    q = fall / (s_top + math.sqrt(max(0.0, s_top * s_top - fall)))
    # t/D = a f - b f^2 at the fraction f of q
    a, b = 2.0 * s_top * q / span, q * q / span
    aa, ab, bb = a * a, a * b, b * b
    value = pool[c] + pool[c + step] * (a / 2.0 - b / 3.0)
    value += pool[c + 2 * step] * (aa / 3.0 - ab / 2.0 + bb / 5.0)
    value += pool[c + 3 * step] * (aa * a / 4.0 - 0.6 * aa * b + 0.5 * a * bb - b * bb / 7.0)
    return q * value


@njit(inner=True, cache=True, inline=True, makes_arrays=False)
def edge_depth(pool, n, at, c, n_w, z, xx, u):
    """Optical depth of S on the way of a ray from space to a point.

    pool: of a `Beam`; n: number of pieces; at, c: places in it of their records and of their first coefficient of a
    wavelength, n_w: number of wavelengths; z [km]: altitude of the point; xx [km^2]: (n r)^2 there; u [km]: n r cos i
    there, negative where the ray has passed its lowest point.
    """
    depth = 0.0
    uu = u * u
    for i in range(n - 1, -1, -1):
        k = at + N_EDGE_RECORD * i
        rise = pool[k + X_TOP] * pool[k + X_TOP] - xx
        ss = rise + uu
        if ss <= 0.0 or (u >= 0.0 and z >= pool[k + TOP_KM]):
            break
        span = pool[k + SPAN]
        first = c + N_POWER * n_w * i
        s_top = math.sqrt(ss)
        above = z <= pool[k + BOTTOM_KM]
        if above or u < 0.0:
            whole = _in_piece(pool, first, n_w, s_top, min(span, ss), span)
            depth += whole if above else 2.0 * whole
        if not above and z < pool[k + TOP_KM]:
            part = _in_piece(pool, first, n_w, s_top, min(ss, min(span, max(0.0, rise))), span)
            depth += part if u >= 0.0 else -part
    return depth


@njit(inner=True, cache=True, inline=True, makes_arrays=False)
def dispersion_lag(dispersion, bending, slope):
    """By how much less than the reference's ray that of another wavelength is lifted [rad], the sun being the same.

    dispersion: of the wavelength; bending [rad] and slope, d bending/d i: of the reference's ray, from above.
    """
    return dispersion * bending / (1.0 + (1.0 - dispersion) * slope)
