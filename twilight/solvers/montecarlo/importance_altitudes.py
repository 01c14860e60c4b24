"""Altitudes of the tables of `importance`: dense at the ground, beside the edges of layers, and in thick air."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from twilight.solvers.montecarlo.air import SCATTERING, SPECIES, MonteCarloAir

N_ALTITUDES = 20
"""Altitudes at quadratic distances from the ground."""
LAYER_FACTOR = 3.0
"""Factor by which scattering changes within LAYER_KM at an edge of a layer."""
LAYER_KM = 0.5
"""Distance [km] over which that change is looked for, and least distance between two edges."""
LAYER_ABOVE_KM = 3.0
"""Height [km] above the ground from which edges count: below, altitudes are dense in any case."""
MOST_EDGES = 8
"""Most edges; the strongest ones get altitudes of the tables on both sides."""
BESIDE_KM = 0.05
"""Distance [km] of those altitudes from the edge."""
THICK = 3.0
"""Vertical diffusion depth (see `diffusion_depth`) from which air counts as thick: light in it diffuses."""
THICK_STEP = 1.2
"""Largest diffusion depth between altitudes of the tables in thick air."""
THICK_EDGE = 0.1
"""Diffusion depth between the edge of thick air and the altitude next to it."""
MOST_THICK = 30
"""Most altitudes added for thick air."""


def table_altitudes(air: MonteCarloAir) -> np.ndarray:
    """Altitudes [km] of the tables: quadratic, dense at the ground, and beside the edges of layers."""
    z = air.level_km
    bottom, depth = z[0], z[-1] - z[0]
    quadratic = bottom + depth * np.linspace(0.0, 1.0, N_ALTITUDES) ** 2
    scattering = np.log(np.maximum(air.table[:, :, SCATTERING], 1e-12))
    # the change over LAYER_KM around each level: from just above the level below to just below the one above
    lower = np.maximum(np.searchsorted(z, z - 0.5 * LAYER_KM, side="right") - 1, 0)
    upper = np.minimum(np.searchsorted(z, z + 0.5 * LAYER_KM, side="left"), z.size - 1)
    step = np.abs(np.diff(scattering, axis=1)).max(axis=0)
    change = np.abs(scattering[:, upper] - scattering[:, lower]).max(axis=0)
    # where levels are far apart, nothing happens between them
    change[z[upper] - z[lower] > 4 * LAYER_KM] = 0.0
    change[(z < bottom + LAYER_ABOVE_KM) | (z > z[-1] - 2 * BESIDE_KM)] = 0.0
    edges: list[float] = []
    for i in np.argsort(-change, kind="stable"):
        if change[i] < np.log(LAYER_FACTOR) or len(edges) == MOST_EDGES:
            break
        k = lower[i] + int(np.argmax(step[lower[i] : upper[i]]))
        edge = float(0.5 * (z[k] + z[k + 1]))
        if all(abs(edge - other) > LAYER_KM for other in edges):
            edges.append(edge)
    beside = [edge + side * BESIDE_KM for edge in edges for side in (-1.0, 1.0)]
    return np.unique(np.concatenate([quadratic, beside]))


def diffusion_depth(air: MonteCarloAir, asymmetry: Sequence[np.ndarray]) -> np.ndarray:
    """Diffusion depth (W, N): integral from the ground to every level of (1 - g) x scattering coefficient.

    asymmetry: mean cosines g (W,) of the aerosols' phase functions.
    """
    z = air.level_km
    scattering = air.table[:, :, SCATTERING].copy()
    if not air.isotropic_events:
        for k, g in enumerate(asymmetry):
            scattering -= np.clip(g, 0.0, 0.999)[:, None] * air.table[:, :, SPECIES + 1 + k]
    steps = 0.5 * (scattering[:, 1:] + scattering[:, :-1]) * np.diff(z)
    return np.concatenate([np.zeros_like(steps[:, :1]), np.cumsum(steps, axis=1)], axis=1)


def thick_altitudes(level_km: np.ndarray, depth: np.ndarray, altitude_km: np.ndarray) -> np.ndarray:
    """Altitudes [km] to add to those of the tables (A,) where the depth between two of them is more than THICK_STEP.

    level_km (N,); depth (W, N): `diffusion_depth`.  None where the air is not THICK.
    """
    which = depth[:, -1] > THICK
    if not which.any():
        return np.zeros(0)
    most = depth[which].max(axis=0)
    step = max(THICK_STEP, most[-1] / MOST_THICK)
    added: list[float] = []
    at = np.interp(altitude_km, level_km, most)
    for begin, end in pairwise(at):
        if end - begin > step:
            inside = np.linspace(begin, end, int(np.ceil((end - begin) / step)) + 1)[1:-1]
            added += [begin + THICK_EDGE, *inside, end - THICK_EDGE]
    rises = np.concatenate([[True], np.diff(most) > 0.0])
    return np.interp(added, most[rises], level_km[rises])
