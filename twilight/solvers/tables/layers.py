"""Layers of air that lie between two heights of the tables."""

from __future__ import annotations

import numpy as np

from twilight.atmosphere.medium import Medium
from twilight.base.errors import TwilightError
from twilight.solvers.tables.mapping import Mapping, texel_height_km

MOST_UNSEEN = 0.1
"""Vertical optical depth that may be missing or too much between two heights.

The climates of the program have up to 0.05; a layer of 1 that scatters conservatively between two heights, over white
ground, makes the sky three times too bright.
"""

EDGE_KM = 1e-7
"""Distance below and above a level at which coefficients may jump [km]."""


def refuse_unseen_layers(medium: Medium, mapping: Mapping) -> None:
    """Errors: TwilightError where the air at the heights of S, taken as exponential between them, has another vertical
    optical depth than the air has."""
    bottom = medium.bottom_km
    height = bottom + np.array([texel_height_km(mapping, k, mapping.n_r) for k in range(mapping.n_r)])
    height[-1] = medium.top_km
    seen = _optical_depth(medium, height)
    levels = np.concatenate([medium.altitude_km - EDGE_KM, medium.altitude_km + EDGE_KM, height])
    fine = np.unique(np.clip(levels, bottom, medium.top_km))
    up_to = np.cumsum(_optical_depth(medium, fine), axis=0)[np.searchsorted(fine, height[1:]) - 1]
    unseen = np.abs(np.diff(up_to, axis=0, prepend=0.0) - seen)
    k, w = np.unravel_index(unseen.argmax(), unseen.shape)
    if unseen[k, w] > MOST_UNSEEN:
        raise TwilightError(
            f"the tables solver cannot hold this air: between {height[k]:.3g} and {height[k + 1]:.3g} km, two of its "
            f"{mapping.n_r} heights, the optical depth at {medium.wavelength_nm[w]:g} nm is off by {unseen[k, w]:.2g}; "
            f"allowed is {MOST_UNSEEN:g}; more heights (solver.expert.scattering_r) may do, solver zones does"
        )


def _optical_depth(medium: Medium, altitude_km: np.ndarray) -> np.ndarray:
    """Vertical, of every interval (Z - 1, W), of air that is exponential in it."""
    k = np.maximum(medium.at(altitude_km).extinction, 1e-300)
    low, high = k[:-1], k[1:]
    ratio = np.log(high / low)
    flat = np.abs(ratio) < 1e-6
    mean = np.where(flat, 0.5 * (low + high), (high - low) / np.where(flat, 1.0, ratio))
    return mean * np.diff(altitude_km)[:, None]
