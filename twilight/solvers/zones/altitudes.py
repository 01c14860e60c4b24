"""Node altitudes of the field: graded from the ground, one at every jump, closer where air is layered or thick."""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from twilight.transport.profile import Profile

LOWEST_STEP_KM = 0.12
"""Interval between node altitudes at the ground [km], at altitude_density 1."""
STEP_GROWTH = 0.21
"""Growth of the interval between node altitudes with height above the ground, at altitude_density 1."""
RIM_STEP_KM = 0.8
"""Largest interval between node altitudes just above a rim of haze and above jumps higher up [km], at altitude_density
1: seen from there the rim falls away with the root of the height.  It grows by the height above them."""
MAX_LOG_EXTINCTION_BEND = 0.15
"""Largest difference, half-way between two node altitudes, of ln(extinction) from the mean of its values at both."""
MAX_INTERVAL_DEPTH = 0.12
"""Largest vertical optical depth between two node altitudes."""
STRAIGHT_DEPTH = 1e-3
"""Vertical optical depth between two node altitudes below which no bend of ln(extinction) matters."""
MAX_HALVINGS = 14
"""How often an interval between node altitudes is halved at most."""
EDGE_DEPTH = 1.0
"""Vertical optical depth above and below a place from which on it counts as inside thick air."""
DEPTH_GROWTH = 1.0
"""Growth of MAX_INTERVAL_DEPTH per optical depth inside thick air: light changes as slowly there as its edges are
far."""
MAX_DEPTH_GROWTH = 8.0
"""Largest factor by which MAX_INTERVAL_DEPTH grows: intervals of 7 optical depths lose 3 % of what a cloud of depth 100
lets through."""
MAX_INTERVAL_RATIO = 2.1
"""Largest ratio of two neighbouring intervals between node altitudes in layered air: light bends beyond a layer's edges
too, and a cubic over intervals of 1, 2 and 5 km was 5 to 9 % wrong above a volcanic layer."""
LAYERED_FRACTION = 0.3
"""Air is layered where an interval was cut to less than this fraction of its length."""


def altitude_nodes(
    bottom_km: float, top_km: float, jumps_km: np.ndarray, density: float, rims_km: np.ndarray | None = None
) -> np.ndarray:
    """Altitudes [km] with spacing (LOWEST_STEP_KM + STEP_GROWTH x height)/density, closer above rims of haze, and one
    at every jump."""
    edges = [bottom_km, *jumps_km, top_km]
    out = [bottom_km]
    for a, b in pairwise(edges):
        rough = [a]
        near = RIM_STEP_KM if rims_km is not None and np.any(rims_km <= a) else np.inf
        while rough[-1] < b:
            z = rough[-1]
            rough.append(z + min(LOWEST_STEP_KM + STEP_GROWTH * (z - bottom_km), near + z - a) / density)
        # the same grading, stretched to end at b
        out.extend(a + (np.array(rough[1:-1]) - a) * (b - a) / (rough[-1] - a))
        out.append(b)  # to the last digit: `cubic_refinement` finds it by its value
    return np.array(out)


def resolve_layers(altitude_km: np.ndarray, profile: Profile, density: float) -> np.ndarray:
    """The altitudes [km] and more where the air is layered more finely than they are apart."""
    levels = profile.altitude_km

    def extinction(z: np.ndarray) -> np.ndarray:
        return np.array([np.interp(z, levels, column) for column in profile.extinction.T])

    step = np.diff(levels)[:, None]
    through = np.insert(
        np.cumsum(0.5 * step * (profile.extinction[1:] + profile.extinction[:-1]), axis=0), 0, 0, axis=0
    )
    before = out = np.asarray(altitude_km, dtype=float)
    for _ in range(MAX_HALVINGS):
        step = np.diff(out)
        middle = out[:-1] + 0.5 * step
        # just inside the ends, which may be jumps
        nudge = np.minimum(1e-6, 1e-3 * step)
        low, mid, high = (np.maximum(extinction(z), 1e-30) for z in (out[:-1] + nudge, middle, out[1:] - nudge))
        depth = step * (low + 4.0 * mid + high) / 6.0
        bend = np.abs(np.log(mid / np.sqrt(low * high)))
        above = np.array([np.interp(middle, levels, column[-1] - column) for column in through.T])
        deep = np.maximum(0.0, np.minimum(above, through[-1][:, None] - above) - EDGE_DEPTH)
        widest = MAX_INTERVAL_DEPTH * np.minimum(1.0 + DEPTH_GROWTH * deep, MAX_DEPTH_GROWTH) / density
        coarse = (depth > widest) | ((bend > MAX_LOG_EXTINCTION_BEND / density**2) & (depth > STRAIGHT_DEPTH / density))
        if not coarse.any(axis=0).any():
            break
        out = np.sort(np.append(out, middle[coarse.any(axis=0)]))
    whole = np.diff(before)[np.searchsorted(before, out[:-1], side="right") - 1]
    return _graded(out) if np.any(np.diff(out) < LAYERED_FRACTION * whole) else out


def _graded(altitude_km: np.ndarray) -> np.ndarray:
    """The altitudes [km] and more, so that intervals beside each other differ by no more than MAX_INTERVAL_RATIO."""
    out = altitude_km
    while True:
        step = np.diff(out)
        beside = np.minimum(np.append(step[1:], np.inf), np.append(np.inf, step[:-1]))
        coarse = step > MAX_INTERVAL_RATIO * beside
        if not coarse.any():
            return out
        out = np.sort(np.append(out, out[:-1][coarse] + 0.5 * step[coarse]))
