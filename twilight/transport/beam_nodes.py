"""Where the tables of a sunbeam have their nodes: segments of altitude, nodes in them, lowest points of limb rays.

In a segment between two jumps a..b the nodes are uniform in sqrt((b - z)/(b - a)): just below a jump optical depths go
like a square root.  Interpolation is cubic and never crosses a jump.
"""

from __future__ import annotations

import math
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from twilight.atmosphere.medium import Medium
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
    k = medium.extinction_per_km + 1e-30
    lower, upper = k[:-1], k[1:]
    # a jump of k is worth a tenth of its horizontal path over a table step, a bend its air mass x step^2/16
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
    keep[:-1] &= x[:-1] < lowest_above[1:] - 1e-9 * r
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
