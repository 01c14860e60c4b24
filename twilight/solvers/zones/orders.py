"""Orders of scattering of one block of wavelengths: one by one, or all at once in thick air of conservative scattering.

With U_n the light of order n, and K the scattering operator, U_1 is sunlight scattered once and U_(n+1) = K U_n.  Once
U_(n+1) / U_n has settled to r at every node the rest is the geometric series U_n r / (1 - r).

All light from order n on solves U = K U + s, with s the order n itself.  In a cloud of optical depth 100 a scattering
loses one part in a thousand of the light, and successive orders U <- K U + s need thousands of steps.  Two things cut
that down to tens:

* A column operator: K for light that is the same all around, between node altitudes of one vertical, as the first two
  moments m = (mean, vertical flux) and the ground's radiance.  It is summed from the very rays of K, so the two agree
  where air is thick (synthetic acceleration, Adams & Larsen 2002, consistently discretised).  With r = K U + s - U the
  step is U <- U + r + C (1 - C)^-1 r.
* Anderson mixing of the last few steps, for what the columns do not know: light that travels along the terminator.

Each wavelength has its own columns and its own mixture, and stops by itself.  Both are solved by loops of their own:
LAPACK's blocked LU and BLAS sums differ in the last bits with the number of threads, and a field must not.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache, partial
from typing import NamedTuple

import numpy as np

from twilight.base.conventions import DARK
from twilight.base.progress import Progress
from twilight.base.threads import in_slices
from twilight.jit.kernels import njit
from twilight.solvers.base import Convergence
from twilight.solvers.zones import constants as tuned
from twilight.solvers.zones import scattering
from twilight.solvers.zones.air_needs import reduced_depth
from twilight.solvers.zones.first_order import Sunlight, make_sunlight
from twilight.solvers.zones.grids import FieldGrids
from twilight.solvers.zones.next_order import RadianceField
from twilight.solvers.zones.ray_points import LANES, block_values
from twilight.transport.beam import Beam


@njit(cache=True, nogil=True)
def _column_rows(rays, point, polar_weight, rows, begin, end):
    """Rows of the column operator for node altitudes begin..end: what light that is the same all around sends there.

    rays: `NodeRays`; point: `RayPoints`
    polar_weight (Z, N, M): weight of each polar angle in each of N results, the mean and the vertical flux for example
    rows (Z, N, 2 Z' + 1, LANES): from the moments 0 and 1 at the Z' fine altitudes, and from the ground
    """
    n_results, n_polar = polar_weight.shape[1:]
    n_fine = (rows.shape[2] - 1) // 2
    for z in range(begin, end):
        for i in range(n_polar):
            ray = z * n_polar + i
            for result in range(n_results):
                fraction = polar_weight[z, result, i]
                out = rows[z, result]
                for w in range(LANES):
                    out[2 * n_fine, w] += fraction * rays.ground_weight[ray, w]
                for k in range(rays.first[ray], rays.first[ray + 1]):
                    j, f = point.node[k], point.node_fraction[k]
                    for moment in range(2):
                        low, high = out[moment * n_fine + j], out[moment * n_fine + j + 1]
                        received = fraction * point.polar[k, moment]
                        for w in range(LANES):
                            sent = received * point.weight[k, w] * point.chi[k, moment, w]
                            low[w] += sent * (1.0 - f)
                            high[w] += sent * f


@njit(cache=True, nogil=True)
def _factor(matrices, swaps, begin, end):
    """LU factors of the matrices (L, N, N) begin..end in place; pivots are the largest entries below the diagonal, row
    k being exchanged with row swaps[w, k] of swaps (L, N)."""
    n = matrices.shape[1]
    for w in range(begin, end):
        matrix = matrices[w]
        for k in range(n):
            best = k
            for i in range(k + 1, n):
                if abs(matrix[i, k]) > abs(matrix[best, k]):
                    best = i
            swaps[w, k] = best
            if best != k:
                for j in range(n):
                    matrix[k, j], matrix[best, j] = matrix[best, j], matrix[k, j]
            for i in range(k + 1, n):
                factor = matrix[i, k] / matrix[k, k]
                matrix[i, k] = factor
                for j in range(k + 1, n):
                    matrix[i, j] -= factor * matrix[k, j]


@njit(cache=True, nogil=True)
def _solve(factors, swaps, right_sides, begin, end):
    """Solve for right_sides (L, N, T) in place, those begin..end; factors (L, N, N), swaps (L, N): of `_factor`."""
    n, n_columns = right_sides.shape[1:]
    for w in range(begin, end):
        values = right_sides[w]
        for k in range(n):
            p = swaps[w, k]
            if p != k:
                for t in range(n_columns):
                    values[k, t], values[p, t] = values[p, t], values[k, t]
            for i in range(k):
                factor = factors[w, k, i]
                for t in range(n_columns):
                    values[k, t] -= factor * values[i, t]
        for k in range(n - 1, -1, -1):
            for i in range(k + 1, n):
                factor = factors[w, k, i]
                for t in range(n_columns):
                    values[k, t] -= factor * values[i, t]
            for t in range(n_columns):
                values[k, t] /= factors[w, k, k]


class ColumnOperator:
    """(1 - C)^-1 at some wavelengths (L,) of one block, with C the column operator of a `ScatteringOperator`."""

    def __init__(self, operator: scattering.ScatteringOperator, wavelengths: np.ndarray) -> None:
        a, nodes = operator.angles, operator.nodes
        self.n = nodes.altitude_km.size
        n, n_fine = self.n, nodes.fine_altitude_km.size
        # harmonics are sorted by order: those of degree 0 and 1, the same all around, are the first two
        of_nodes = np.ascontiguousarray(a.analysis[:, :2].sum(axis=3))
        of_ground = operator.ground_fraction()[None, None]
        rows = np.zeros((n, 2, 2 * n_fine + 1, LANES))
        ground_row = np.zeros((1, 1, 2 * n_fine + 1, LANES))
        rays = operator.node_rays()
        in_slices(partial(_column_rows, rays, operator.points, of_nodes, rows), n)
        _column_rows(rays, operator.points, of_ground, ground_row, 0, 1)
        albedo = block_values(operator.medium.ground_albedo, operator.block)
        # results (2 Z + 1): mean at all altitudes, flux at all altitudes, ground
        fine = np.concatenate([rows[:, 0], rows[:, 1], ground_row[0] * albedo])
        column = np.zeros((2 * n + 1, 2 * n + 1, LANES))
        node, weight = nodes.altitude_rule
        for moment in range(2):
            for k in range(n_fine):
                for j in range(4):
                    column[:, moment * n + node[k, j]] += weight[k, j] * fine[:, moment * n_fine + k]
        column[:, -1] = fine[:, -1]
        self.factors = np.ascontiguousarray(np.eye(2 * n + 1) - column.transpose(2, 0, 1)[wavelengths])
        self.swaps = np.zeros((wavelengths.size, 2 * n + 1), np.int64)
        in_slices(partial(_factor, self.factors, self.swaps), wavelengths.size)

    def rest(self, moments: np.ndarray, ground: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """All light after an order, C (1 - C)^-1 times it: (moments (Z, T, 2, L), ground (T, L)) of the rest from the
        moments (Z, T, 2, L) and the ground (T, L) of an order."""
        values = np.ascontiguousarray(
            np.concatenate([moments[:, :, 0], moments[:, :, 1], ground[None]]).transpose(2, 0, 1), dtype=float
        )
        before = values.copy()
        in_slices(partial(_solve, self.factors, self.swaps, values), values.shape[0])
        remaining = (values - before).transpose(1, 2, 0)
        return np.stack([remaining[: self.n], remaining[self.n : -1]], axis=2), remaining[-1]


class RemainingOrders(NamedTuple):
    """All light from one order on, at L wavelengths of a block: moments (Z, T, C, L), ground (T, L); steps of its
    solution; residual (L,), the largest fraction of the total by which the light may still be wrong."""

    moments: np.ndarray
    ground: np.ndarray
    steps: int
    residual: np.ndarray


class _Step(NamedTuple):
    """Moments (Z, T, C, L) and ground (T, L) before a step, their changes without mixing, and the change of the mean
    over the total light (Z, T, L)."""

    light: np.ndarray
    ground: np.ndarray
    change: np.ndarray
    ground_change: np.ndarray
    relative: np.ndarray


def all_orders_from(
    operator: scattering.ScatteringOperator,
    wavelengths: np.ndarray,
    order: tuple[np.ndarray, np.ndarray],
    mean_before: np.ndarray,
    faint: float,
    tolerance: float,
    max_steps: int,
    progress: Callable[[int, float], None],
) -> RemainingOrders:
    """Solve U = K U + s for the light U of an order s and all that follow it.

    order: moments (Z, T, C, LANES) and ground (T, LANES) of s; wavelengths (L,): those of the block to solve;
    mean_before (Z, T, LANES): mean radiance of the orders before, which with U makes the total that errors are relative
    to, above `faint`
    """
    columns = ColumnOperator(operator, wavelengths)
    s, s_ground = (x[..., wavelengths].astype(float) for x in order)
    base = mean_before[..., wavelengths].astype(float)
    whole, whole_ground = np.zeros(order[0].shape, np.float32), np.zeros(order[1].shape, np.float32)

    def corrected(moments: np.ndarray, ground: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        more, more_ground = columns.rest(moments[:, :, :2], ground)
        moments = moments.copy()
        moments[:, :, :2] += more
        return moments, ground + more_ground

    light, light_ground = corrected(s, s_ground)
    # differences between steps: of moments and ground after them, and of their relative changes
    history: list[tuple[np.ndarray, np.ndarray, np.ndarray]] = []
    residual = np.ones(wavelengths.size)
    unfinished = np.ones(wavelengths.size, bool)
    last: _Step | None = None
    steps = 0
    while steps < max_steps and unfinished.any():
        whole[..., wavelengths], whole_ground[..., wavelengths] = light, light_ground
        _, moments, ground = operator.analyse(operator.next_order(whole[:, :, 0], whole, whole_ground))
        after = moments[..., wavelengths] + s
        after_ground = ground[..., wavelengths] + s_ground
        change, change_ground = corrected(after - light, after_ground - light_ground)
        steps += 1
        total = base + after[:, :, 0]
        lit = total > faint
        relative = np.where(lit, change[:, :, 0] / np.where(lit, total, 1.0), 0.0)
        residual = np.where(unfinished, np.abs(relative).max(axis=(0, 1)), residual)
        progress(steps, float(residual.max()))
        if last is not None:
            moved = light - last.light + change - last.change
            moved_ground = light_ground - last.ground + change_ground - last.ground_change
            history.append((moved, moved_ground, relative - last.relative))
            del history[: -tuned.HISTORY]
        last = _Step(light, light_ground, change, change_ground, relative)
        factors = _mixture([changed for _, _, changed in history], relative)
        new, new_ground = light + change, light_ground + change_ground
        for factor, (moved, moved_ground, _) in zip(factors, history, strict=True):
            new -= factor * moved
            new_ground -= factor * moved_ground
        new[:, :, 0] = np.maximum(new[:, :, 0], tuned.MIN_STEP * after[:, :, 0])
        new_ground = np.maximum(new_ground, tuned.MIN_STEP * after_ground)
        # a wavelength that is done stays as its last step left it
        light = np.where(unfinished, new, light)
        light_ground = np.where(unfinished, new_ground, light_ground)
        unfinished &= ~(residual < tolerance)
    return RemainingOrders(light.astype(np.float32), light_ground.astype(np.float32), steps, residual)


def _mixture(steps: list[np.ndarray], change: np.ndarray) -> np.ndarray:
    """Factors (H, L) of the steps (Z, T, L) whose sum comes closest to the change (Z, T, L), for each wavelength."""
    n = len(steps)
    out = np.zeros((n, change.shape[-1]))
    if n == 0:
        return out
    for w in range(out.shape[1]):
        columns = [x[..., w].ravel() for x in steps]
        target = change[..., w].ravel()
        # sums of products without a linear algebra library, whose threads might change the last digits
        gram = np.array([[np.sum(a * b) for b in columns] for a in columns])
        side = np.array([np.sum(a * target) for a in columns])
        scale = np.trace(gram)
        if scale > 0.0:
            out[:, w] = np.linalg.solve(gram + 1e-9 * scale * np.eye(n), side)
    return out


def solve_orders(
    early: scattering.ScatteringOperator,
    late: Callable[[], scattering.ScatteringOperator],
    thick: Callable[[], scattering.ScatteringOperator],
    slow: np.ndarray,
    early_orders: int,
    sunlight: Sunlight,
    max_orders: int,
    tolerance: float,
    progress: Callable[[int, float], None],
) -> scattering.Solution:
    """Follow orders until the missing rest is known to `tolerance`, and add it as a geometric series.

    Every wavelength stops by itself.  All orders after the early ones are solved at once, unless max_orders or a
    tolerance of 0 says how many orders are wanted; those of thick air from the first on.
    early: operator of the first `early_orders` orders; late: gives that of later orders, whose light is smooth: fewer
    directions and harmonics do; thick: gives that of light that decays slowly; slow (LANES,): wavelengths at which the
    air is thick; tolerance: relative, 0 follows max_orders and adds no rest."""
    all_at_once = max_orders > tuned.FEW_ORDERS and tolerance > 0.0
    slow = slow & all_at_once
    first = early.first_order(sunlight)
    mean, order, ground = early.analyse(first)
    total, total_ground = order.copy(), ground.copy()
    retained = np.arange(order.shape[2])
    orders, steps, residual, unfinished = 1, 0, np.ones(LANES), ~slow
    if slow.any():
        # what single orders do here is known beforehand
        some = np.flatnonzero(slow)
        operators = early.conserving(), thick().conserving()
        total[..., some], total_ground[..., some], steps, residual[some] = _stiff_wavelengths(
            *operators, first, early_orders, some, max_orders, tolerance, progress
        )
    del first
    previous, decay = None, np.zeros(LANES)
    while orders + 1 < max_orders and unfinished.any():
        operator = early if orders < early_orders else late()
        if operator is not early and orders == max(early_orders, 1):
            retained = early.angles.shared_with(operator.angles)
            order = np.ascontiguousarray(order[:, :, retained])
        if all_at_once and (orders >= max(early_orders, 2) or orders == tuned.SETTLED_ORDER):
            # faster with the same operator; or where its small losses would add up, with one that conserves
            settled = orders == tuned.SETTLED_ORDER
            weak = unfinished & (decay <= (tuned.CONSERVED_DECAY if settled else tuned.FAST_DECAY))
            strong = unfinished & ~weak & settled
            for some in (np.flatnonzero(weak), np.flatnonzero(strong)):
                if not some.size:
                    continue
                rest_operator, enough = operator, tuned.STEP_TOLERANCE * tolerance
                if strong[some[0]]:
                    rest_operator = (early if operator is early else thick()).conserving()
                    enough = min(tolerance, tuned.STIFF_TOLERANCE)
                remaining = all_orders_from(
                    rest_operator, some, (order, ground), total[:, :, 0] - mean, tuned.FAINT, enough,
                    max(1, max_orders - orders),
                    partial(lambda before, steps, left: progress(before + steps, left), orders),
                )  # fmt: skip
                total[:, :, retained[:, None], some] += remaining.moments - order[..., some]
                total_ground[..., some] += remaining.ground - ground[..., some]
                steps, residual[some] = max(steps, orders + remaining.steps), remaining.residual
            unfinished &= ~(weak | strong)
            if not unfinished.any():
                break
        before = mean
        mean, order, ground = operator.analyse(operator.next_order(mean, order, ground))
        counts = unfinished.astype(np.float32)
        total[:, :, retained] += order * counts
        total_ground += ground * counts
        orders += 1
        decay = _decay(mean, before)
        # written so that nothing overflows where there was no light before
        ratio = np.clip(mean, 0.0, 0.97 * np.maximum(before, 0.0)) / np.maximum(before, DARK)
        # what is left behaves like a geometric series at every node; two such guesses in a row show how well
        guess = total[:, :, 0] + mean * (ratio / (1.0 - ratio))
        if previous is not None:
            lit = guess > tuned.FAINT
            moved = np.where(lit, np.abs(previous / np.where(lit, guess, 1.0) - 1.0), 0.0).max(axis=(0, 1))
            residual = np.where(unfinished, moved, residual)
        previous = guess
        progress(orders, float(residual[unfinished].max()))
        if tolerance > 0.0:
            done = unfinished & (residual < tolerance)
            rest = ratio / (1.0 - ratio) * done
            total[:, :, retained] += order * rest[:, :, None]
            total_ground += ground * rest[0]
            unfinished &= ~done
    return _solution(early, total, total_ground, max(orders, steps) + 1, residual)


def _solution(
    early: scattering.ScatteringOperator, total: np.ndarray, ground: np.ndarray, orders: int, residual: np.ndarray
) -> scattering.Solution:
    """The solution from the moments (Z, T, C, LANES) of all light and the radiance of the ground (T, LANES)."""
    log_mean, relative = early.nodes.refine_altitude(*scattering.normalised(total[:, :, 0], total))
    light = RadianceField(log_mean, relative, early.log_ground(ground))
    return scattering.Solution(light, orders, float(residual.max()))


def _stiff_wavelengths(early, late, first, early_orders, wavelengths, max_orders, tolerance, progress):
    """All orders at some wavelengths (L,) of the block: the early ones one by one, all later ones at once.

    first: Stokes parameters of sunlight scattered once.
    Returns (moments (Z, T, C, L), radiance of the ground (T, L), steps, largest fraction that may be missing (L,)).
    """
    mean, order, ground = early.analyse(first)
    total, total_ground = order.copy(), ground.copy()
    steps = 0
    while steps + 1 < min(early_orders, tuned.MAX_EARLY_ORDERS):
        mean, order, ground = early.analyse(early.next_order(mean, order, ground))
        total += order
        total_ground += ground
        steps += 1
        progress(steps, 1.0)
    retained = early.angles.shared_with(late.angles)
    seed = np.ascontiguousarray(order[:, :, retained])
    remaining = all_orders_from(
        late, wavelengths, (seed, ground), total[:, :, 0] - mean, tuned.FAINT, min(tolerance, tuned.STIFF_TOLERANCE),
        max(1, max_orders - steps), lambda n, r: progress(steps + n, r),
    )  # fmt: skip
    total = total[..., wavelengths]
    total[:, :, retained] += remaining.moments - seed[..., wavelengths]
    total_ground = total_ground[..., wavelengths] + remaining.ground - ground[..., wavelengths]
    return total, total_ground, steps + remaining.steps, remaining.residual


def _decay(mean: np.ndarray, before: np.ndarray) -> np.ndarray:
    """Light of an order (Z, T, LANES) over that of the order before, over all nodes, (LANES,)."""
    light, light_before = mean.sum(axis=(0, 1), dtype=float), before.sum(axis=(0, 1), dtype=float)
    return light / np.where(light_before > 0.0, light_before, 1.0)


def solve(grids: FieldGrids, beam: Beam, progress: Progress) -> tuple[list[scattering.Solution], Convergence]:
    """Solutions for each block of LANES wavelengths, and how well the worst of them converged."""
    s = grids.directions
    progress("rays", 0.05)
    early = scattering.early_operators(grids)
    thick_polar = max(s.late_polar_directions, tuned.POLAR_PER_DEGREE * s.late_degree)

    # made where they are needed: with thick_polar in thick air of conservative scattering alone
    of_polar = cache(partial(scattering.late_operators, grids))

    def late_operator(polar: int, block: int) -> scattering.ScatteringOperator:
        return of_polar(polar)(block)

    sunlight = make_sunlight(beam, grids.nodes.altitude_km, grids.profile.break_km)
    n_blocks = -(-grids.medium.n_wavelengths // LANES)
    slow = reduced_depth(grids.scaled, grids.profile) > tuned.SLOW_DEPTH
    solutions: list[scattering.Solution] = []
    for block in range(n_blocks):

        def report(order: int, residual: float, block: int = block) -> None:
            progress(f"order of scattering {order}", 0.1 + 0.9 * (block + min(0.95, order / 12)) / n_blocks)

        # dropped with its block
        late = cache(partial(late_operator, s.late_polar_directions, block))
        solutions.append(
            solve_orders(
                early(block), late, partial(late_operator, thick_polar, block), block_values(slow, block) > 0.0,
                s.early_orders, sunlight, s.max_orders, s.tolerance, report,
            )
        )  # fmt: skip
    return solutions, Convergence(max(x.orders for x in solutions), max(x.residual for x in solutions))
