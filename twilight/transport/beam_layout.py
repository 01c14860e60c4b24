"""Where the tables of a sunbeam have their nodes, and how they are laid out in the two arrays of `beam_lookup.Beam`.

:mod:`twilight.transport.beam` says what the tables mean.  In a segment between two jumps a..b the nodes of altitude are
uniform in sqrt((b - z)/(b - a)): just below a jump optical depths go like a square root.  Interpolation is cubic and
never crosses a jump.

J nodes of altitude, C + 1 of the apparent cosine, G + 1 of the sun's distance from the shadow's edge, Y of the lowest
point of a ray, D + 1 of the distance u from it, W wavelengths.
"""

import math
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from twilight.atmosphere.medium import Medium
from twilight.base.conventions import DARK, ROUNDING
from twilight.transport import beam_lookup as lookup
from twilight.transport.beam_edges import Edges
from twilight.transport.beam_lookup import Beam
from twilight.transport.ray_profile import AEROSOL, AIR, BOTTOM, GASES, LOG_SLOPE, RayProfile, refractive_radius
from twilight.transport.rays import lowest_point

_LIMB_PATH_KM = 600.0
"""Optical depth of the limb is about extinction x 600 km (sqrt(2 pi R H))."""


class LimbRays(NamedTuple):
    """Rays from space by their lowest points, Y of them, at every wavelength of a profile.

    lowest_km (Y,); invariant (P, Y) [km]: n r at the lowest point; bending (P, Y) [rad]: of the whole ray; slope (P, Y)
    [km^-1]: derivative of the bending by the invariant
    """

    lowest_km: np.ndarray
    invariant: np.ndarray
    bending: np.ndarray
    slope: np.ndarray


def segments(medium: Medium, max_breaks: int, sharp_km: np.ndarray) -> np.ndarray:
    """Altitudes [km] where tables must end: jumps and strong bends of the extinction, `sharp_km` among them, the rest
    evenly cut."""
    z = medium.altitude_km
    k = medium.extinction_per_km + DARK
    lower, upper = k[:-1], k[1:]
    # a jump of k counts as a tenth of its horizontal path over a table step, a bend its air mass x step^2/16
    bends = {}
    for i in range(1, z.size - 1):
        if z[i] == z[i - 1] or z[i] <= z[0] or z[i] >= z[-1]:
            continue
        j = i
        while j + 1 < z.size and z[j + 1] == z[i]:
            j += 1
        jump = np.max(np.abs(k[j] - k[i]))
        below, above = z[i] - z[i - 1], z[j + 1] - z[j]
        slope_jump = np.max(np.abs((k[i] - lower[i - 1]) / below - (upper[j] - k[j]) / above))
        step = 0.1 + 0.02 * (z[i] - z[0])
        bends[float(z[i])] = (
            3.0 * jump * math.sqrt(2.0 * medium.earth_radius_km * step) / 30.0 + 2.5 * slope_jump * 0.01
        )
    strong = sorted((zz for zz, b in bends.items() if b > 1e-3), key=lambda zz: -bends[zz])[:max_breaks]
    strong += [float(e) for e in sharp_km if z[0] < e < z[-1]]
    edges = [float(z[0]), *sorted(set(strong)), float(z[-1])]
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


def segment_nodes(
    edges: np.ndarray, profile: RayProfile, per_scale: float, smallest: int, largest: int, step_km: float = 0.0
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Numbers of intervals, first node and node altitudes of every segment."""
    size = np.empty(edges.size - 1, dtype=np.int64)
    for s, (a, b) in enumerate(pairwise(edges)):
        inside = (profile.top_km > a) & (profile.bottom_km < b)
        fraction = np.minimum(profile.top_km[inside], b) - np.maximum(profile.bottom_km[inside], a)
        folds = 0.0
        for part in (AIR, GASES, AEROSOL):
            # an error of interpolation goes like optical depth x step^4
            weight = (_LIMB_PATH_KM * profile.coefficient[:, inside, part + BOTTOM]) ** 0.25
            q = np.abs(profile.coefficient[:, inside, part + LOG_SLOPE]) / (profile.top_km - profile.bottom_km)[inside]
            folds = max(folds, float((np.minimum(weight, 2.0) * q * fraction).sum(axis=1).max()))
        # a thin layer just above is seen from within its thickness: sqrt(b - z) must resolve that
        above = (edges[s + 2] - b) if s + 2 < edges.size else b - a
        needed = max(per_scale * max(folds, 0.2 * (b - a) ** 0.5), 2.5 * ((b - a) / above) ** 0.5)
        if step_km > 0.0:  # nodes are twice the mean distance apart at the bottom of a segment
            needed = max(needed, 2.0 * (b - a) / (step_km + 0.1 * max(0.0, a - 15.0)))
        size[s] = int(np.clip(math.ceil(needed), smallest, largest))
    start = np.concatenate([[0], np.cumsum(size)]).astype(np.int64)
    nodes = np.empty(start[-1] + 1)
    for s, (a, b) in enumerate(pairwise(edges)):
        t = 1.0 - np.arange(size[s] + 1) / size[s]
        nodes[start[s] : start[s + 1] + 1] = b - (b - a) * t**2
        nodes[start[s]] = a
    return size, start[:-1], nodes


def limb_edges(edges: np.ndarray, profile: RayProfile, w: int) -> tuple[np.ndarray, np.ndarray]:
    """Edges that a ray from space can have as its lowest point, and n r there: in a duct n r is not below all above."""
    r = profile.radius_km
    candidates = np.unique(np.concatenate([edges, profile.bottom_km[profile.bottom_km >= edges[0]]]))
    x = np.array([refractive_radius(profile, w, z) for z in candidates])
    x[-1] = r + candidates[-1]
    lowest_above = np.minimum.accumulate(x[::-1])[::-1]
    first = int(np.flatnonzero(x <= lowest_above)[0])
    keep = np.isin(candidates, edges) & (candidates > candidates[first])
    keep[first] = True
    keep[:-1] &= x[:-1] < lowest_above[1:] - ROUNDING * r
    keep[-1] = True
    return candidates[keep], x[keep]


def uniform_in_invariant(lowest, edges, x, size, start, profile: RayProfile, w: int) -> np.ndarray:
    """Altitudes [km] of the lowest points of rays uniform in sqrt((x_b - p)/(x_b - x_a)) in every segment a..b."""
    out = np.array(lowest)
    for s in range(size.size):
        for m in range(1, size[s]):
            p = x[s + 1] - (x[s + 1] - x[s]) * (1.0 - m / size[s]) ** 2
            u = math.sqrt((x[s + 1] - p) * (x[s + 1] + p))
            out[start[s] + m] = lowest_point(profile, w, edges[s + 1], u, False)[0]
    return out


_HASH = 1024
"""Equal bins of a coordinate, each of which knows the segment that its start lies in."""


class Segments(NamedTuple):
    """A coordinate cut into S segments: edges (S + 1,) [km]; size (S,): intervals of each; start (S,): first node."""

    edges: np.ndarray
    size: np.ndarray
    start: np.ndarray

    @property
    def bins_per_km(self) -> float:
        """0 where no ray from space turns inside the air, so that all edges are one."""
        span = self.edges[-1] - self.edges[0]
        return _HASH / span if span > 0.0 else 0.0

    def hashed(self) -> np.ndarray:
        """(_HASH + 1,): the segment at the start of every bin, and at the end of the last."""
        return np.searchsorted(self.edges[1:-1], np.linspace(self.edges[0], self.edges[-1], _HASH + 1), side="right")

    def records(self) -> np.ndarray:
        """(S, N_SEGMENT_RECORD): lower edge, upper edge, 1 / length, intervals, first node."""
        edges = self.edges
        return np.stack([edges[:-1], edges[1:], 1.0 / np.diff(edges), self.size, self.start], axis=1)


class Tables(NamedTuple):
    """What `prepare_beam` computes; everything but log_up, log_down and overhead at the reference wavelength.

    radius_km of the Earth; ground_km, top_km: altitudes; far_km: unit of the distance u behind the limb.
    edge_rad: true zenith angle of the shadow's edge at the ground; refracting, dispersing: flags.
    altitude_segments: of the altitude [km]; limb_segments: of the invariant p of limb rays [km].
    refractivity (J,): n - 1; edge_dip (J,): signed square of the edge's sinking since the ground [rad^2].
    guess (J, G + 1, 2): bending [rad] and its derivative by the apparent zenith angle.
    up_bending (J, C + 1): bending of rays from above [rad]; limb_bending (Y,): of whole limb rays [rad].
    shift_km (Y, D + 1): of the lowest point, per dispersion; dispersion (W,): 1 - (n - 1)/(n - 1 at the reference).
    overhead (W,): optical depth above the top; log_up (J, C + 1, W): log of the irradiance over F0 of rays from above;
    log_down (W, Y, D + 1): log of the irradiance of a limb ray and of its mirror image, with log(1 + u/far_km).
    edges: what is sharp at edges of layers, and missing in log_up and log_down.
    screen: of `beam_screen.screen_table`, and in none of the tables.
    """

    radius_km: float
    ground_km: float
    top_km: float
    far_km: float
    edge_rad: float
    refracting: bool
    dispersing: bool
    altitude_segments: Segments
    limb_segments: Segments
    refractivity: np.ndarray
    edge_dip: np.ndarray
    guess: np.ndarray
    up_bending: np.ndarray
    limb_bending: np.ndarray
    shift_km: np.ndarray
    overhead: np.ndarray
    dispersion: np.ndarray
    log_up: np.ndarray
    log_down: np.ndarray
    edges: Edges
    screen: np.ndarray


def pack(t: Tables) -> Beam:
    """All tables in one array, their sizes and places in another."""
    sizes = {
        lookup.N_W: t.dispersion.size,
        lookup.REFRACTING: t.refracting,
        lookup.DISPERSING: t.dispersing,
        lookup.N_SEGMENT: t.altitude_segments.size.size,
        lookup.N_LIMB: t.limb_segments.size.size,
        lookup.N_COSINE: t.up_bending.shape[1] - 1,
        lookup.N_DISTANCE: t.shift_km.shape[1] - 1,
        lookup.N_GUESS: t.guess.shape[1] - 1,
        lookup.N_LIMB_NODE: t.limb_bending.size,
        lookup.N_HASH: _HASH,
        lookup.N_EDGE: t.edges.record.shape[0],
        lookup.SCREENED: t.screen.size > 0,
        # the hashes stand behind the index itself
        lookup.AT_SEGMENT_HASH: lookup.N_INDEX,
        lookup.AT_LIMB_HASH: lookup.N_INDEX + _HASH + 1,
    }
    scalars = {
        lookup.RADIUS: t.radius_km,
        lookup.GROUND: t.ground_km,
        lookup.TOP: t.top_km,
        lookup.FAR: t.far_km,
        lookup.P_GROUND: t.limb_segments.edges[0],
        lookup.P_TOP: t.limb_segments.edges[-1],
        lookup.EDGE: t.edge_rad,
        lookup.SEGMENT_BINS: t.altitude_segments.bins_per_km,
        lookup.LIMB_BINS: t.limb_segments.bins_per_km,
    }
    tables = {
        lookup.AT_SEGMENT: t.altitude_segments.records(),
        lookup.AT_LIMB: t.limb_segments.records(),
        lookup.AT_ALTITUDE: np.stack([t.refractivity, t.edge_dip], axis=1),
        lookup.AT_GUESS: t.guess,
        lookup.AT_UP_BENDING: t.up_bending,
        lookup.AT_LIMB_BENDING: t.limb_bending,
        lookup.AT_SHIFT: t.shift_km,
        lookup.AT_OVERHEAD: t.overhead,
        lookup.AT_DISPERSION: t.dispersion,
        lookup.AT_UP: t.log_up,
        lookup.AT_DOWN: t.log_down,
        lookup.AT_EDGE: t.edges.record,
        lookup.AT_EDGE_COEFFICIENT: t.edges.coefficient,
        lookup.AT_SCREEN: t.screen,
    }
    index = np.zeros(lookup.N_INDEX, dtype=np.int64)
    for place, size in sizes.items():
        index[place] = size
    pieces = [np.array([scalars[place] for place in range(lookup.N_SCALAR)], dtype=float)]
    at = lookup.N_SCALAR
    for place, table in tables.items():
        index[place] = at
        pieces.append(np.asarray(table, dtype=float).ravel())
        at += pieces[-1].size
    layout = np.concatenate([index, t.altitude_segments.hashed(), t.limb_segments.hashed()])
    return Beam(pool=np.concatenate(pieces), layout=layout.astype(np.int64))
