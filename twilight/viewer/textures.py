"""A `SkyTable` of four channels as the two textures that `web/table.glsl` and `web/export/sky.wgsl` read."""

from __future__ import annotations

import numpy as np

from twilight.numerics.directions import PHASE_COUNT
from twilight.sky.table import SkyTable
from twilight.viewer.colours import CHANNELS

NO_LIGHT = -200.0
"""Logarithm that stands for no light."""


def padded_columns(azimuth_deg: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Columns with a mirrored one beyond either end [deg], and which column of the table each of them is."""
    n = azimuth_deg.size
    places = np.concatenate([-azimuth_deg[1:2], azimuth_deg, 360.0 - azimuth_deg[-2:-1]])
    return places, np.concatenate([[1], np.arange(n), [n - 2]])


def layers(table: SkyTable) -> np.ndarray:
    """S of every sun, then A of every sun, (2 S, R, C, 4) float32."""
    _, column = padded_columns(table.azimuth_deg)
    aureole = np.full_like(table.smooth, NO_LIGHT) if table.aureole is None else table.aureole
    return np.concatenate([table.smooth, aureole])[:, :, column].astype(np.float32)


def node_lines(table: SkyTable) -> np.ndarray:
    """Nodes of sun, row and column, and what refraction lifts the sun [deg]; then ln P: (2, PHASE_COUNT, 4) float32."""
    columns, _ = padded_columns(table.azimuth_deg)
    out = np.zeros((2, PHASE_COUNT, CHANNELS), np.float32)
    lift = table.apparent_sun_deg - table.sun_elevation_deg
    for axis, nodes in enumerate((table.sun_elevation_deg, table.elevation_deg, columns, lift)):
        out[0, : nodes.size, axis] = nodes
    if table.log_phase is not None:
        out[1] = table.log_phase
    return out
