"""`plain_grid`: rows and columns of plain samples, between which straight lines do for the light of a `SkyTable`;
`grid_error`: how far they are off."""

from collections.abc import Callable

import numpy as np

from twilight.numerics.directions import scattering_angle_rad
from twilight.sky.disc import SOLAR_RADIUS_DEG
from twilight.sky.table import BESIDE_BREAK_DEG, SkyTable

PLAIN_ERROR = 0.003
"""Relative error, at 95 % of a row or a column, of light between two neighbours of `plain_grid` on a straight line."""

LARGEST_PLAIN_ERROR = 0.012
"""The same of the largest error."""

CLOSEST_PLAIN_DEG = 0.08
"""Rows and columns of `plain_grid` closer than this are not halved [deg]."""

FAINT = 1e-3
"""Light, of the brightest at a wavelength, whose errors count as if it were so bright."""

CLOSEST_RAISED_DEG = 0.03
"""The same of rows seen from high up, where the air is a thin line."""

PLAIN_TO_BREAK = 0.3
"""Rows of `plain_grid` closer than this part of their distance from a break are not halved."""

CLOSEST_TO_BREAK_DEG = 1e-3
"""Least distance of the other rows of `plain_grid` from a break [deg]."""

AT_BREAK_DEG = 2.0 * CLOSEST_TO_BREAK_DEG
"""Rows closer than this, which are at breaks alone, are not compared with the table between them [deg]."""

BESIDE_DISC_DEG = 0.3
"""Distance from the sun's disc within which samples are not compared with the table [deg]."""


def plain_grid(table: SkyTable) -> tuple[np.ndarray, np.ndarray]:
    """Rows (E,) and columns (A,) over the whole circle [deg], between which straight lines do for the light of one sun.

    They are those of the table and others between them: close at the horizon and the sun.
    """
    rows, columns = table.elevation_deg.copy(), table.azimuth_deg
    breaks = rows[1:][np.diff(rows) == 0.0]

    def away(rows_deg: np.ndarray) -> np.ndarray:
        return np.abs(rows_deg[:, None] - breaks).min(axis=1, initial=np.inf)

    def closest(rows_deg: np.ndarray) -> np.ndarray:
        largest = CLOSEST_RAISED_DEG if breaks.size else CLOSEST_PLAIN_DEG
        return np.clip(PLAIN_TO_BREAK * away(rows_deg), CLOSEST_TO_BREAK_DEG, largest)

    rows = rows[away(rows) > CLOSEST_TO_BREAK_DEG]
    beside = np.minimum(BESIDE_BREAK_DEG, 0.25 * np.diff(breaks).min(initial=np.inf))
    rows = np.sort(np.concatenate([rows, breaks - beside, breaks + beside]))
    rows = _halved(rows, lambda more: table.on_grid(more, columns), 0, closest)
    columns = _halved(columns, lambda more: table.on_grid(rows, more), 1)
    if table.mirrored:
        columns = np.concatenate([columns, 360.0 - columns[-2:0:-1]])
    return rows, columns


def _halved(
    nodes: np.ndarray,
    light: Callable[[np.ndarray], np.ndarray],
    axis: int,
    closest: Callable[[np.ndarray], np.ndarray] = lambda middle: np.full(middle.size, CLOSEST_PLAIN_DEG),
) -> np.ndarray:
    """Nodes with more between them, until the light of `light` (E, A, W) is straight along an axis; closest: the least
    distance of nodes about others [deg]."""

    def far_apart() -> np.ndarray:
        return np.diff(nodes) > 2.0 * closest(0.5 * (nodes[1:] + nodes[:-1]))

    values = np.moveaxis(light(nodes), axis, 0)
    least = FAINT * values.max(axis=(0, 1))
    pending = np.flatnonzero(far_apart())
    while pending.size:
        between = 0.5 * (nodes[pending] + nodes[pending + 1])
        between_values = np.moveaxis(light(between), axis, 0)
        error = np.abs(0.5 * (values[pending] + values[pending + 1]) - between_values) / np.maximum(
            between_values, least
        )
        each = error.reshape(between.size, -1)
        missed = (np.percentile(each, 95, axis=1) > PLAIN_ERROR) | (each.max(axis=1) > LARGEST_PLAIN_ERROR)
        place = pending[missed]
        nodes = np.insert(nodes, place + 1, between[missed])
        values = np.insert(values, place + 1, between_values[missed], axis=0)
        again = ((place + np.arange(place.size))[:, None] + np.arange(2)).ravel()
        pending = again[far_apart()[again]]
    return nodes


def grid_error(table: SkyTable, rows_deg: np.ndarray, columns_deg: np.ndarray) -> tuple[float, float]:
    """Relative error of samples on a grid, read by `SkyTable.of_samples`, beside the light of the table that they are
    of: at 95 % of the cells, at a random place in each, and the largest."""
    random = np.random.default_rng(1)

    def between(nodes: np.ndarray, least: float = 0.0) -> np.ndarray:
        return (nodes[:-1] + random.uniform(0.0, 1.0, nodes.size - 1) * np.diff(nodes))[np.diff(nodes) > least]

    # half of a mirrored sky is all of it
    most = 180.0 if table.mirrored else 360.0
    e, a = between(rows_deg, AT_BREAK_DEG), between(columns_deg[columns_deg <= most])
    light = table.on_grid(e, a)
    samples = SkyTable.of_samples(rows_deg, columns_deg, table.on_grid(rows_deg, columns_deg))
    error = np.abs(samples.on_grid(e, a) - light) / np.maximum(light, FAINT * light.max(axis=(0, 1)))
    away = np.degrees(scattering_angle_rad(table.apparent_sun_deg[0], e[:, None], a))
    error = error[away > SOLAR_RADIUS_DEG + BESIDE_DISC_DEG]
    return float(np.percentile(error, 95)), float(error.max())
