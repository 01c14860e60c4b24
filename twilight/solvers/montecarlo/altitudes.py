"""The altitudes of the tables of `steering`: dense at the ground, beside the edges of layers, and in thick air."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from twilight.solvers.montecarlo.air import EVENT, SPECIES, Air

N_ALTITUDES = 20
LAYER_FACTOR, LAYER_KM, LAYER_ABOVE_KM, MOST_EDGES = 3.0, 0.5, 3.0, 8
"""An edge of a layer is where scattering changes by LAYER_FACTOR within LAYER_KM, above LAYER_ABOVE_KM; the strongest
MOST_EDGES of them get altitudes of the tables on both sides."""
BESIDE_KM = 0.05
THICK = 3.0
"""Vertical depth of scattering, forward peaks left out, from which air counts as thick: light in it diffuses."""
THICK_STEP, THICK_EDGE, MOST_THICK = 1.2, 0.1, 30
"""Most such depth between altitudes of the tables in thick air; the depth of the altitudes next to where it begins and
ends; and how many altitudes are added at the most."""


def table_altitudes(air: Air) -> np.ndarray:
    """Altitudes [km] of the tables: quadratic, dense at the ground, and beside the edges of layers."""
    z = air.level_km
    bottom, depth = z[0], z[-1] - z[0]
    plain = bottom + depth * np.linspace(0.0, 1.0, N_ALTITUDES) ** 2
    scattering = np.log(np.maximum(air.table[:, :, EVENT], 1e-12))
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
    return np.unique(np.concatenate([plain, beside]))


def diffusing_depth(air: Air, asymmetry: Sequence[np.ndarray]) -> np.ndarray:
    """Vertical depth (W, N) of the scattering of events from the ground to every level, without forward peaks.

    asymmetry: mean cosines (W,) of the aerosols' phase functions, the share that is left out.
    """
    z = air.level_km
    events = air.table[:, :, EVENT].copy()
    if not air.isotropic_events:
        for k, g in enumerate(asymmetry):
            events -= np.clip(g, 0.0, 0.999)[:, None] * air.table[:, :, SPECIES + 1 + k]
    steps = 0.5 * (events[:, 1:] + events[:, :-1]) * np.diff(z)
    return np.concatenate([np.zeros_like(steps[:, :1]), np.cumsum(steps, axis=1)], axis=1)


def thick_altitudes(level_km: np.ndarray, depth: np.ndarray, altitude_km: np.ndarray) -> np.ndarray:
    """Altitudes [km] to add to those of the tables (A,) where the depth between two of them is more than THICK_STEP.

    level_km (N,); depth (W, N): `diffusing_depth`.  None where the air is not THICK.
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
