"""Successive orders of scattering of one block of wavelengths, summed until the missing rest is known.

With U_n the light of order n, and K the scattering operator, U_1 is sunlight scattered once and U_(n+1) = K U_n.  Once
U_(n+1) / U_n has settled to r at every node the rest is the geometric series U_n r / (1 - r).
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from twilight.solvers.zones.acceleration import all_orders_from
from twilight.solvers.zones.next_order import RadianceField
from twilight.solvers.zones.ray_points import LANES
from twilight.solvers.zones.solution import TINY, ScatteringOperator, Solution, normalised
from twilight.solvers.zones.sunlight import Sunlight

FAINT = 1e-12
"""Radiance over F0 [sr^-1] below which convergence does not matter: a thousandth of a moonless night's own light."""
STIFF_DECAY = 0.72
"""Fraction of an order's light left in the next beyond which light is solved for all orders at once."""
FEW_ORDERS = 30
"""Largest max_orders that is taken literally: so few orders are followed one by one, however thick the air."""
SETTLED_ORDER = 5
"""Order after which the decay from order to order tells how many will be needed."""
MAX_EARLY_ORDERS = 20
"""Most orders that are followed with the directions of the early orders before all others are solved at once."""
STIFF_TOLERANCE = 1e-3
"""Largest tolerance of the solution for all orders at once: each of its steps gains a digit, so that it costs
little."""


def solve_orders(
    early: ScatteringOperator,
    late: Callable[[], ScatteringOperator],
    thick: Callable[[], ScatteringOperator],
    slow: np.ndarray,
    early_orders: int,
    sunlight: Sunlight,
    max_orders: int,
    tolerance: float,
    progress: Callable[[int, float], None],
) -> Solution:
    """Follow orders until the missing rest is known to `tolerance`, and add it as a geometric series.

    Every wavelength stops by itself.  Where the light decays slowly, or the air is thick, all orders are solved at
    once, unless max_orders or a tolerance of 0 says how many orders are wanted.

    Parameters
    ----------
    early
        Operator of the first `early_orders` orders.
    late
        Gives the operator of later orders, whose light is smooth: fewer directions and harmonics do.
    thick
        Gives the operator of light that decays slowly.
    slow
        (LANES,) wavelengths at which the air is thick.
    tolerance
        Relative; 0 follows max_orders and adds no rest.
    progress
        Called with the number of orders and the residual.
    """
    all_at_once = max_orders > FEW_ORDERS

    def solve_at_once(wavelengths: np.ndarray, progress: Callable[[int, float], None]):
        operators = early.conserving(), thick().conserving()
        return _stiff_wavelengths(*operators, early_orders, wavelengths, sunlight, max_orders, tolerance, progress)

    if all_at_once and tolerance > 0.0 and slow.all():
        # what single orders do here is known beforehand
        total, total_ground, steps, missing = solve_at_once(np.arange(LANES), progress)
        return _solution(early, total, total_ground, steps + 1, missing)
    mean, order, ground = early.analyse(early.first_order(sunlight))
    total, total_ground = order.copy(), ground.copy()
    retained = np.arange(order.shape[2])
    orders, residual = 1, np.ones(LANES)
    unfinished, stiff = np.ones(LANES, bool), np.zeros(LANES, bool)
    slow = slow & all_at_once
    previous = None
    while orders + 1 < max_orders and unfinished.any():
        operator = early if orders < early_orders else late()
        if operator is not early and orders == max(early_orders, 1):
            retained = early.angles.shared_with(operator.angles)
            order = np.ascontiguousarray(order[:, :, retained])
        before = mean
        mean, order, ground = operator.analyse(operator.next_order(mean, order, ground))
        counts = unfinished.astype(np.float32)
        total[:, :, retained] += order * counts
        total_ground += ground * counts
        orders += 1
        # written so that nothing overflows where there was no light before
        ratio = np.clip(mean, 0.0, 0.97 * np.maximum(before, 0.0)) / np.maximum(before, TINY)
        # what is left behaves like a geometric series at every node; two such guesses in a row show how well
        guess = total[:, :, 0] + mean * (ratio / (1.0 - ratio))
        if previous is not None:
            lit = guess > FAINT
            moved = np.where(lit, np.abs(previous / np.where(lit, guess, 1.0) - 1.0), 0.0).max(axis=(0, 1))
            residual = np.where(unfinished, moved, residual)
        previous = guess
        progress(orders, float(residual[unfinished].max()))
        if tolerance > 0.0:
            done = unfinished & ~slow & (residual < tolerance)
            rest = ratio / (1.0 - ratio) * done
            total[:, :, retained] += order * rest[:, :, None]
            total_ground += ground * rest[0]
            unfinished &= ~done
            if orders == SETTLED_ORDER and all_at_once:
                stiff = unfinished & (slow | (_decay(mean, before) > STIFF_DECAY))
                unfinished &= ~stiff
    if stiff.any():
        some = np.flatnonzero(stiff)
        total[..., some], total_ground[..., some], steps, residual[some] = solve_at_once(
            some, lambda n, r: progress(orders + n, r)
        )
        orders += steps
    return _solution(early, total, total_ground, orders + 1, residual)


def _solution(
    early: ScatteringOperator, total: np.ndarray, ground: np.ndarray, orders: int, residual: np.ndarray
) -> Solution:
    """The solution from the moments (Z, T, C, LANES) of all light and the radiance of the ground (T, LANES)."""
    log_mean, relative = early.nodes.refine_altitude(*normalised(total[:, :, 0], total))
    light = RadianceField(log_mean, relative, early.log_ground(ground))
    return Solution(light, orders, float(residual.max()))


def _stiff_wavelengths(early, late, early_orders, wavelengths, sunlight, max_orders, tolerance, progress):
    """All orders at some wavelengths (L,) of the block: the early ones one by one, all later ones at once.

    Returns (moments (Z, T, C, L), radiance of the ground (T, L), steps, largest fraction that may be missing (L,)).
    """
    mean, order, ground = early.analyse(early.first_order(sunlight))
    total, total_ground = order.copy(), ground.copy()
    steps = 0
    while steps + 1 < min(early_orders, MAX_EARLY_ORDERS):
        mean, order, ground = early.analyse(early.next_order(mean, order, ground))
        total += order
        total_ground += ground
        steps += 1
        progress(steps, 1.0)
    retained = early.angles.shared_with(late.angles)
    seed = np.ascontiguousarray(order[:, :, retained])
    found = all_orders_from(
        late, wavelengths, (seed, ground), total[:, :, 0] - mean, FAINT, min(tolerance, STIFF_TOLERANCE),
        max(1, max_orders - steps), lambda n, r: progress(steps + n, r),
    )  # fmt: skip
    total = total[..., wavelengths]
    total[:, :, retained] += found.moments - seed[..., wavelengths]
    total_ground = total_ground[..., wavelengths] + found.ground - ground[..., wavelengths]
    return total, total_ground, steps + found.steps, found.residual


def _decay(mean: np.ndarray, before: np.ndarray) -> np.ndarray:
    """Light of an order (Z, T, LANES) over that of the order before, over all nodes, (LANES,)."""
    here, there = mean.sum(axis=(0, 1), dtype=float), before.sum(axis=(0, 1), dtype=float)
    return here / np.where(there > 0.0, there, 1.0)
