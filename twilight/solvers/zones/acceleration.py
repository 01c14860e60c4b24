"""Conservative scattering in thick air: all orders at once, in tens of steps where single orders would take thousands.

All light from order n on solves U = K U + s, with s the order n itself and K the scattering operator.  In a cloud of
optical depth 100 a scattering loses one part in a thousand of the light, and successive orders U <- K U + s need
thousands of steps.  Two things cut that down:

* A column operator: K for light that is the same all around, between node altitudes of one vertical, as the first two
  moments m = (mean, vertical flux) and the ground's radiance.  It is summed from the very rays of K, so the two agree
  where air is thick (synthetic acceleration, Adams & Larsen 2002, consistently discretised).  With r = K U + s - U the
  step is U <- U + r + C (1 - C)^-1 r.
* Anderson mixing of the last few steps, for what the columns do not know: light that travels along the terminator.

Each wavelength has its own columns and its own mixture, and stops by itself.

Both are solved by loops of their own: LAPACK's blocked LU and BLAS sums differ in the last bits with the number of
threads, and a field must not.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import NamedTuple

import numpy as np

from twilight.base.threads import in_slices
from twilight.jit.kernels import njit
from twilight.solvers.zones.ray_points import LANES, block_values
from twilight.solvers.zones.solution import ScatteringOperator

HISTORY = 5
"""Number of steps that are mixed."""
MIN_STEP = 0.2
"""Least mean radiance after a step, over that which one scattering makes of the light before."""


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

    def __init__(self, operator: ScatteringOperator, wavelengths: np.ndarray) -> None:
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
        found = (values - before).transpose(1, 2, 0)
        return np.stack([found[: self.n], found[self.n : -1]], axis=2), found[-1]


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
    operator: ScatteringOperator,
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
            del history[:-HISTORY]
        last = _Step(light, light_ground, change, change_ground, relative)
        factors = _mixture([changed for _, _, changed in history], relative)
        new, new_ground = light + change, light_ground + change_ground
        for factor, (moved, moved_ground, _) in zip(factors, history, strict=True):
            new -= factor * moved
            new_ground -= factor * moved_ground
        new[:, :, 0] = np.maximum(new[:, :, 0], MIN_STEP * after[:, :, 0])
        new_ground = np.maximum(new_ground, MIN_STEP * after_ground)
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
