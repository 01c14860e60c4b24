"""Haber section 5: only every n-th shell takes part in the passes; the others are interpolated.

The shells in between get their light by linear interpolation along radius; what is interpolated is the mean radiance
P / (4 pi sigma_s V), which does not jump with the size of the cells.  "The total amount of energy received by every
target cell has to be scaled by the ratio I_all / I_active", of what all cells and those of active shells send out.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from twilight.solvers.cells.grid import CellGrid


class ActiveShells(NamedTuple):
    """Which of G rings take part, and how the others follow.

    ring (A,): indices of those that do; inner, outer (G,): the two of them (indices into `ring`) between which each
    ring lies; part (G,): 0 at the inner one, 1 at the outer
    """

    ring: np.ndarray
    inner: np.ndarray
    outer: np.ndarray
    part: np.ndarray

    def spread(self, values: np.ndarray, rings: slice = slice(None)) -> np.ndarray:
        """From the active rings (A, ...) to all (G, ...), or to some of these."""
        part = self.part[rings].reshape(-1, *(1,) * (values.ndim - 1))
        return values[self.inner[rings]] * (1.0 - part) + values[self.outer[rings]] * part


def make_active_shells(grid: CellGrid, step: int) -> ActiveShells:
    """Every `step`-th shell of a grid, counted so that the outermost one takes part.

    Where a row of cells has no active cell on one side the other side serves; where it has none, the nearest row's.
    """
    ring = np.nonzero((grid.n_shells - 1 - grid.ring_shell) % step == 0)[0]
    rows, shells = grid.ring_row[ring], grid.ring_shell[ring]
    inner, outer = np.zeros(grid.n_rings, int), np.zeros(grid.n_rings, int)
    part = np.zeros(grid.n_rings)
    for row in np.unique(grid.ring_row):
        here = np.nonzero(np.abs(rows - row) == np.abs(rows - row).min())[0]
        here = here[np.argsort(shells[here], kind="stable")]
        followers = np.nonzero(grid.ring_row == row)[0]
        place = np.clip(grid.ring_shell[followers], shells[here[0]], shells[here[-1]])
        k = np.clip(np.searchsorted(shells[here], place, side="right") - 1, 0, max(here.size - 2, 0))
        following = np.minimum(k + 1, here.size - 1)
        inner[followers], outer[followers] = here[k], here[following]
        distance = np.maximum(shells[here[following]] - shells[here[k]], 1)
        part[followers] = (place - shells[here[k]]) / distance
    return ActiveShells(ring, inner, outer, part)


def energy_ratio(energy: np.ndarray, active: ActiveShells) -> np.ndarray:
    """I_all / I_active (W,) of the energy (G, W) that all cells of each ring send out."""
    among_active = energy[active.ring].sum(axis=0)
    return np.where(among_active > 0.0, energy.sum(axis=0) / np.where(among_active > 0.0, among_active, 1.0), 1.0)
