"""The transmittance of the Prague Sky Model: its root at places in the air, as factors.

Places are given by altitude and distance along the ground, on the reader's sphere, whose 50 m above the viewpoint are
the lowest 0 m of the air here: both ends of a line move up with it.  Lines of sight are straight.
"""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from twilight.atmosphere.medium import ON_LEVELS
from twilight.studies.export.prague_air import ChannelNodes
from twilight.studies.export.prague_file import PragueTransmittance
from twilight.studies.export.prague_sky import RADIUS_M, SAFETY_M, altitude_nodes_m, distance_nodes_m
from twilight.transport.profile import prepare_profile
from twilight.transport.steps import chord_depth

DISTANCES = 128
"""Places along the ground."""
ALTITUDES = 32
"""Places in height."""
DEPTH_KM = 2.0
"""How far below the ground the air of `_without_ground` goes; lines that sink deeper are dark, all in air of the
ground."""
ROOT_ERROR = 3e-4
"""Largest error of a stored root that the rank may leave."""


def transmittance_roots(field: Any, altitude_m: np.ndarray, nodes: ChannelNodes) -> np.ndarray:
    """Square roots of the transmittance (H, D, A, C) from altitudes (H,) to the places of the file.

    field: a `Field`, whose wavelengths are the nodes of the channels.
    """
    found = []
    for altitude in altitude_m:
        passed = field.of_terms(partial(_passed, altitude_m=altitude))
        found.append(np.sqrt(nodes.mean(passed) / nodes.irradiance.sum(axis=-1)))
    return np.array(found)


def _passed(medium: Any, altitude_m: float) -> np.ndarray:
    """Transmittance (D, A, W) from `altitude_m`, the reader's 50 m included."""
    below = 1e-3 * SAFETY_M
    deep = _without_ground(medium, 1e-3 * RADIUS_M + below - medium.bottom_km)
    profile = prepare_profile(deep)
    high = medium.bottom_km - below + 1e-3 * altitude_nodes_m(ALTITUDES)
    here = medium.bottom_km - below + 1e-3 * altitude_m
    start = deep.earth_radius_km + here
    out, depth = np.ones((DISTANCES, ALTITUDES, medium.n_wavelengths)), np.zeros(medium.n_wavelengths)
    for d, angle in enumerate(distance_nodes_m(DISTANCES) / RADIUS_M):
        for a, altitude in enumerate(high):
            r = deep.earth_radius_km + altitude
            across, up = r * np.sin(angle), r * np.cos(angle) - start
            length = float(np.hypot(across, up))
            if length > 1e-9:
                mu = up / length
                to_top = -start * mu + np.sqrt((start * mu) ** 2 + (start + medium.top_km - here) ** 2 - start**2)
                length = min(length, to_top)
                seen = chord_depth(profile, here, mu, length, depth)
                out[d, a] = np.exp(-depth if seen else -length * medium.extinction_per_km[0])
    return out


def _without_ground(medium: Any, earth_radius_km: float) -> Any:
    """The medium on another sphere, with the air of the ground going on below it: lines that the ground hides are
    asked for beside those that it does not."""

    def continued(values: np.ndarray, axis: int = 0) -> np.ndarray:
        first = np.take(values, [0, 0], axis=axis)
        return np.concatenate([first, values], axis=axis)

    on_levels = {name: continued(getattr(medium, name)) for name in ON_LEVELS}
    for name in ("air_scattering_per_km", "refractivity"):  # a jump, so that the cubics above begin anew
        on_levels[name][:2] *= 1.0 + 1e-6
    return replace(
        medium,
        altitude_km=np.concatenate([[medium.bottom_km - DEPTH_KM], medium.altitude_km[:1], medium.altitude_km]),
        aerosol_phase_fraction=continued(medium.aerosol_phase_fraction, 1),
        earth_radius_km=earth_radius_km,
        grid_medium=None,
        **on_levels,
    )


def transmittance_of(roots: list[np.ndarray], altitude_m: np.ndarray, visibility_km: np.ndarray) -> PragueTransmittance:
    """Factors of the roots of all airs by singular values, of the least rank that keeps `ROOT_ERROR`."""
    stacked = np.array(roots)
    v, h, d, a, c = stacked.shape
    cut = []
    for k in range(h):
        table = stacked[:, k].transpose(1, 2, 0, 3).reshape(d * a, v * c)
        left, size, right = np.linalg.svd(table, full_matrices=False)
        cut.append((table, left * size, right))
    rank = next(
        r
        for r in range(1, v * c + 1)
        if all(np.abs(left[:, :r] @ right[:r] - table).max() < ROOT_ERROR for table, left, right in cut) or r == v * c
    )
    factors = np.array([left[:, :rank].reshape(d, a, rank) for _, left, _ in cut])
    weights = np.array([right[:rank].reshape(rank, v, c) for _, _, right in cut])
    return PragueTransmittance(altitude_m, visibility_km, factors, weights.transpose(2, 0, 3, 1))
