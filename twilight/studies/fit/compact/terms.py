"""From computed skies to the terms of a compact sky: coefficients over the sky, the light that the ground adds."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from twilight.solvers.compact.compact_sky import SkySplines
from twilight.solvers.compact.splines import spline_coefficients
from twilight.studies.fit.compact.training import Skies

GROUND_ALBEDOS = (0.5, 0.9)
"""Two albedos give the ground's light A L / (1 - s A): its amount L and the fraction s that comes back."""


def splines_of(grid: SkySplines, where: Skies, radiance: Sequence[Sequence[np.ndarray]]) -> np.ndarray:
    """Coefficients (K, S, W, N) of the logarithms of N sets of skies, all of the suns and directions of `where`."""
    made = []
    for s, sun in enumerate(where.sun_elevation_deg):
        values = np.log(np.stack([one[s] for one in radiance], axis=-1))
        flat = values.reshape(values.shape[0], -1)
        found = spline_coefficients(grid, sun, where.elevation_deg[s], where.azimuth_deg[s], flat)
        made.append(found.reshape(-1, *values.shape[1:]))
    return np.stack(made, axis=1)


def added_light(black: Skies, bright: Skies, albedo: float) -> list[np.ndarray]:
    """What ground of that albedo adds to each sky, over the albedo."""
    return [(b - a) / albedo for a, b in zip(black.radiance, bright.radiance, strict=True)]


def ground_light(added: Sequence[list[np.ndarray]]) -> tuple[np.ndarray, list[np.ndarray]]:
    """(r (W,), light of the ground at albedo -> 0) from (L(A) - L(0)) / A = light / (1 - A r) at two albedos."""
    low, high = GROUND_ALBEDOS
    found = []
    for one, other in zip(*added, strict=True):
        slope = (1.0 / one - 1.0 / other) / (high - low)
        found.append(slope / (1.0 / one + low * slope))
    fraction = np.median(np.concatenate(found), axis=0)
    return fraction, [one * (1.0 - low * fraction) for one in added[0]]
