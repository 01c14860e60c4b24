"""A medium with changes in single layers: what is differentiated, and by how much it moves.

A layer's change is a box: the coefficient jumps at the layer's two altitudes, which become doubled levels.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from twilight.atmosphere.levels import layer_mean
from twilight.atmosphere.medium import Medium
from twilight.base.errors import TwilightError

MIN_LAYER_KM = 0.01
"""Least thickness [km] of a layer."""
MAX_CHANGE = 0.35
"""Change of the logarithm of a coefficient between two levels: what is added to a layer is then even to 1 %."""
MOST_PARTS = 12
"""Most levels that one is divided into."""


def layer_edges(medium: Medium, edges_km) -> np.ndarray:
    """Altitudes (J + 1,) [km] that bound J layers of a medium.

    Errors: TwilightError for fewer than two, for layers thinner than MIN_LAYER_KM, and for altitudes outside the air.
    """
    edges = np.asarray(edges_km, dtype=float)
    if edges.ndim != 1 or edges.size < 2 or not np.all(np.isfinite(edges)):
        raise TwilightError("edges_km must be two or more altitudes [km], which bound layers")
    if np.any(np.diff(edges) < MIN_LAYER_KM):
        raise TwilightError(f"edges_km must grow by {MIN_LAYER_KM:g} km or more from one to the next")
    if edges[0] < medium.bottom_km - 1e-9 or edges[-1] > medium.top_km + 1e-9:
        raise TwilightError(
            f"edges_km must lie within the air, from {medium.bottom_km:g} to {medium.top_km:g} km; they go from "
            f"{edges[0]:g} to {edges[-1]:g}"
        )
    return np.clip(edges, medium.bottom_km, medium.top_km)


def with_doubled_levels(medium: Medium, edges_km: np.ndarray, like: Medium | None = None) -> Medium:
    """The same air with a doubled level at each of the altitudes (E,) [km] inside it, and with levels in between.

    The rule between two levels is exponential: as much more at both is most in the middle, by q^2 / 8 where the
    coefficients change by exp(q).  Levels in between keep q below MAX_CHANGE.

    like: the same levels at other wavelengths, whose coefficients say where; None: the medium's own.
    """
    z = medium.altitude_km
    whose = like or medium
    inside = edges_km[(edges_km > z[0]) & (edges_km < z[-1])]
    change = np.zeros(z.size - 1)
    for per_km in (whose.absorption_per_km, whose.aerosol_extinction_per_km):
        lower, upper = per_km[:-1], per_km[1:]
        positive = (lower > 0.0) & (upper > 0.0)
        ratio = np.where(positive, upper, 1.0) / np.where(positive, lower, 1.0)
        change = np.maximum(change, np.abs(np.log(ratio)).max(axis=1))
    pieces = [z[:1]]
    for low, high, q in zip(z[:-1], z[1:], change, strict=True):
        parts = min(max(1, int(np.ceil(q / MAX_CHANGE))), MOST_PARTS) if high > low else 1
        within = inside[(inside > low) & (inside < high)]
        between = np.linspace(low, high, parts + 1)[1:-1]
        single = high in inside and np.count_nonzero(z == high) == 1
        new = np.sort(np.concatenate([np.repeat(within, 2), np.setdiff1d(between, within)]))
        pieces.append(np.concatenate([new, [high, high] if single else [high]]))
    return medium.on_levels(pieces)


def of_layer(altitude_km: np.ndarray, low_km: float, high_km: float) -> np.ndarray:
    """Which levels (L,) belong to a layer whose two altitudes are doubled levels, or the ends of the air."""
    z = altitude_km
    inside = (z >= low_km) & (z <= high_km)
    # of a doubled level the upper one belongs to the layer above, the lower one to that below
    first_of_two = np.append(z[1:] == z[:-1], False)
    second_of_two = np.insert(z[1:] == z[:-1], 0, False)
    return inside & ~((z == low_km) & first_of_two) & ~((z == high_km) & second_of_two)


def layer_depth(per_km: np.ndarray, altitude_km: np.ndarray, edges_km: np.ndarray) -> np.ndarray:
    """Vertical optical depth (J, W) of each layer of a coefficient (L, W) [km^-1], at levels that hold the edges."""
    thickness = np.diff(altitude_km)[:, None]
    depth = layer_mean(per_km[:-1], per_km[1:]) * thickness
    middle = 0.5 * (altitude_km[1:] + altitude_km[:-1])
    layer = np.searchsorted(edges_km, middle) - 1
    out = np.zeros((edges_km.size - 1, per_km.shape[1]))
    known = (layer >= 0) & (layer < out.shape[0])
    np.add.at(out, layer[known], depth[known])
    return out


def with_columns(medium: Medium, **fields: Any) -> Medium:
    """The medium with other coefficients, which keeps its grid medium: its grids then are those of before."""
    grid = medium.grid_medium and medium.grid_medium.unbound()
    return replace(medium, grid_medium=grid, **fields)
