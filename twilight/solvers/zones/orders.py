"""All orders of scattering of one block of wavelengths, summed until what is missing is known."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from twilight.solvers.zones.acceleration import all_orders_from
from twilight.solvers.zones.paths import LANES
from twilight.solvers.zones.solution import TINY, Passes, Solution, normalised
from twilight.solvers.zones.sunlight import Sunlight

FAINT = 1e-12
"""Radiance over F0 that convergence does not look at: about a thousandth of a moonless night's own light."""
STIFF_DECAY = 0.72
"""Light that keeps more than this share from one event to the next is not followed event by event."""
FEW_EVENTS = 30
"""A user who sets max_events to this or less wants just so many."""
SETTLED = 5
"""Events after which the decay from order to order tells how many will be needed."""
MOST_EARLY = 20
"""Events that are followed with many directions before."""
STIFF_TOLERANCE = 1e-3
"""Of what is solved all at once, whatever looser tolerance is asked for: each step gains a digit."""


def solve_orders(
    early: Passes,
    late: Passes,
    thick: Callable[[], Passes],
    slow: np.ndarray,
    early_events: int,
    sunlight: Sunlight,
    max_events: int,
    tolerance: float,
    progress: Callable[[int, float], None],
) -> Solution:
    """Follow orders until what is missing is known to `tolerance`, and add it as a geometric series.

    `early` computes the first `early_events` orders; light that has been scattered more often is smooth, and `late` may
    do with fewer directions and harmonics.  `thick()` computes those of light that decays slowly.

    Every lane stops by itself.  Those whose light decays slowly, and those that are `slow` (LANES,) because they are
    thick, where the first events say little, are solved all at once, unless max_events or a tolerance of 0 says how
    many events are wanted.
    """
    mean, order, ground = early.analyse(early.first(sunlight))
    total, total_ground = order.copy(), ground.copy()
    kept = np.arange(order.shape[2])
    events, residual = 1, np.ones(LANES)
    open_lanes, stiff = np.ones(LANES, bool), np.zeros(LANES, bool)
    all_at_once = max_events > FEW_EVENTS and early.water is None
    slow = slow & all_at_once
    previous = None
    while events + 1 < max_events and open_lanes.any():
        passes = early if events < early_events else late
        if passes is late and events == max(early_events, 1) and late is not early:
            kept = early.angles.shared_with(late.angles)
            order = np.ascontiguousarray(order[:, :, kept])
        before = mean
        mean, order, ground = passes.analyse(passes.next(mean, order, ground))
        wanted = open_lanes.astype(np.float32)
        total[:, :, kept] += order * wanted
        total_ground += ground * wanted
        events += 1
        # written so that nothing overflows where there was no light before
        ratio = np.clip(mean, 0.0, 0.97 * np.maximum(before, 0.0)) / np.maximum(before, TINY)
        # what is left behaves like a geometric series at every node; two such guesses in a row show how well
        guess = total[:, :, 0] + mean * (ratio / (1.0 - ratio))
        if previous is not None:
            lit = guess > FAINT
            moved = np.where(lit, np.abs(previous / np.where(lit, guess, 1.0) - 1.0), 0.0).max(axis=(0, 1))
            residual = np.where(open_lanes, moved, residual)
        previous = guess
        progress(events, float(residual[open_lanes].max()))
        if tolerance > 0.0:
            done = open_lanes & ~slow & (residual < tolerance)
            rest = ratio / (1.0 - ratio) * done
            total[:, :, kept] += order * rest[:, :, None]
            total_ground += ground * rest[0]
            open_lanes &= ~done
            if events == SETTLED and all_at_once:
                stiff = open_lanes & (slow | (_decay(mean, before) > STIFF_DECAY))
                open_lanes &= ~stiff
    if stiff.any():
        lanes = np.flatnonzero(stiff)
        whole, whole_ground, steps, missing = _stiff_lanes(
            early.conserving(), thick().conserving(), early_events, lanes, sunlight, max_events, tolerance,
            lambda n, r: progress(events + n, r),
        )  # fmt: skip
        total[..., lanes], total_ground[..., lanes] = whole, whole_ground
        residual[lanes] = missing
        events += steps
    nodes = early.nodes
    log_mean, relative = nodes.refine_altitude(*normalised(total[:, :, 0], total))
    return Solution(log_mean, relative, *early.ground_light(total_ground), events + 1, float(residual.max()))


def _stiff_lanes(early, late, early_events, lanes, sunlight, max_events, tolerance, progress):
    """All orders of some lanes (L,), those after the early ones all at once.

    Returns (moments (Z, T, C, L), radiance of the ground (T, L), steps, largest share that may be missing (L,)).
    """
    mean, order, ground = early.analyse(early.first(sunlight))
    total, total_ground = order.copy(), ground.copy()
    steps = 0
    while steps + 1 < min(early_events, MOST_EARLY):
        mean, order, ground = early.analyse(early.next(mean, order, ground))
        total += order
        total_ground += ground
        steps += 1
        progress(steps, 1.0)
    kept = early.angles.shared_with(late.angles)
    seed = np.ascontiguousarray(order[:, :, kept])
    found = all_orders_from(
        late, lanes, (seed, ground), total[:, :, 0] - mean, FAINT, min(tolerance, STIFF_TOLERANCE),
        max(1, max_events - steps), lambda n, r: progress(steps + n, r),
    )  # fmt: skip
    total = total[..., lanes]
    total[:, :, kept] += found.moments - seed[..., lanes]
    return total, total_ground[..., lanes] + found.ground - ground[..., lanes], steps + found.steps, found.residual


def _decay(mean: np.ndarray, before: np.ndarray) -> np.ndarray:
    """Light of an order (Z, T, LANES) over that of the order before, over all nodes, (LANES,)."""
    here, there = mean.sum(axis=(0, 1), dtype=float), before.sum(axis=(0, 1), dtype=float)
    return here / np.where(there > 0.0, there, 1.0)
