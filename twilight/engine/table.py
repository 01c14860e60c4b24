"""Fills a `SkyTable` with a field's light: nodes are added until interpolation between them is accurate enough.

Rows are halved where the table's rule misses the light of the row between two others, then columns; whatever is
computed for a test becomes a node.  In the end the table is compared with directions drawn at random.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from twilight.engine.block import Answer
from twilight.numerics.directions import scattering_angle_rad
from twilight.sky.table import SkyTable, at_angle, split
from twilight.transport.rays import horizon_dip_deg
from twilight.transport.scattered_once import ScatteredOnce

if TYPE_CHECKING:
    from twilight.atmosphere.medium import Medium
    from twilight.scene.scene import Scene

FIRST_ROWS = 17
"""Rows from the horizon to the zenith that are computed first; all of them are halved once."""

FIRST_COLUMNS = 13
"""Columns from the sun to its opposite that are computed first; all of them are halved once."""

ROW_POWER = 2.0
"""Power of the row's number with which first rows rise above the horizon: they crowd there."""

COLUMN_POWER = 1.5
"""Power of the column's number with which first columns leave the sun: they crowd there."""

USUAL_MISS = 0.012
"""Relative error at 95 % of a new row or column before it is a node, beyond which its neighbours are halved again;
as a node it takes 8 to 16 times less."""

LARGEST_MISS = 0.025
"""The same of the largest error in it."""

CLOSEST_ROWS_DEG = 0.06
"""Rows closer than this are not halved [deg]."""

CLOSEST_COLUMNS_DEG = 0.25
"""Columns closer than this are not halved [deg]."""

MOST_ROWS, MOST_COLUMNS = 140, 70
"""Most rows and columns of a table, which bounds its time in air with edges."""

FAINT = 1e-3
"""Light, of the brightest at a wavelength, whose errors count as if it were so bright."""

CHECKS = (12, 8)
"""Rows and columns drawn at random in which a table is compared with light in the end."""

PROBES = 4
"""Lines of sight, about, across which nodes of another table are tested."""

BESIDE_BREAK_DEG = 1e-3
"""How far from a break the rows next to it stand [deg]."""


HIGH_FROM_KM = 0.1
"""Height above the ground from which rows go below the horizontal; lower down the horizon dips by 0.3 deg at most."""

BREAKS_APART_DEG = 0.1
"""A break closer than this above another one is left out [deg]: from orbit the edge of the haze is at the horizon."""

SUDDEN_FALL = 0.2
"""Part of the extinction that is lost within a hundredth of a kilometre where a layer has an edge."""


def sudden_edges(medium: Medium) -> tuple[np.ndarray, np.ndarray]:
    """Altitudes [km] at which extinction falls suddenly upwards, and by how much [km^-1]."""
    z, extinction = medium.altitude_km, medium.extinction_per_km.max(axis=1)
    fall = extinction[:-1] - extinction[1:]
    sudden = (np.diff(z) <= 0.01) & (fall > SUDDEN_FALL * extinction[:-1])
    return 0.5 * (z[1:] + z[:-1])[sudden], fall[sudden]


def with_ground(scene: Scene, altitude_km: float) -> tuple[float, list[float]]:
    """`row_breaks` of a table that has the ground too, for a solver that can look down."""
    low, breaks = row_breaks(scene, altitude_km)
    return (low, breaks) if breaks else (-90.0, [-horizon_dip_deg(scene.medium, altitude_km)])


def row_breaks(scene: Scene, altitude_km: float) -> tuple[float, list[float]]:
    """The lowest row of a scene's table, and where light of the rows is not smooth [deg].

    Seen from high up by a solver that can look down: the horizon, and the rays that graze the edges of layers below.
    """
    medium = scene.medium
    above_ground_km = altitude_km - medium.bottom_km
    if above_ground_km <= HIGH_FROM_KM or not (scene.capabilities.every_observer and scene.capabilities.looks_down):
        return 0.0, []
    level = sudden_edges(medium)[0]
    edges = [-horizon_dip_deg(medium, altitude_km, float(k)) for k in level[level < altitude_km - 0.01]]
    breaks = [-horizon_dip_deg(medium, altitude_km)]
    for edge in sorted(edges):
        if edge - breaks[-1] > BREAKS_APART_DEG:
            breaks.append(edge)
    return -90.0, breaks


Light = Callable[[np.ndarray, np.ndarray], Answer]
"""What a table is filled with: the answer of rows (E,) and columns (A,) [deg], (E, A, W), under one sun."""


def first_rows(low_deg: float, breaks_deg: Sequence[float], count: int = FIRST_ROWS) -> np.ndarray:
    """Rows from low_deg to the zenith, closest at the last break; every break stands twice."""
    edges = [low_deg, *(b for b in sorted(breaks_deg) if low_deg < b < 90.0), 90.0]
    parts = []
    for n, (below, above) in enumerate(pairwise(edges)):
        last = n == len(edges) - 2
        u = np.linspace(0.0, 1.0, count if last else max(5, count // 2))
        rise = u**ROW_POWER if last else 1.0 - (1.0 - u) ** ROW_POWER
        parts.append(below + (above - below) * rise)
        parts[-1][-1] = above  # both rows of a break are the same to the last bit
    return np.concatenate(parts)


def beside_breaks(rows_deg: np.ndarray) -> np.ndarray:
    """Rows where light is asked for: of two equal ones one is just below the break, the other just above."""
    twice = np.diff(rows_deg) == 0.0
    below, above = np.append(twice, False), np.concatenate([[False], twice])
    return rows_deg - BESIDE_BREAK_DEG * below + BESIDE_BREAK_DEG * above


def first_columns(count: int = FIRST_COLUMNS) -> np.ndarray:
    """Columns from the sun to its opposite [deg], closest at the sun."""
    return 180.0 * np.linspace(0.0, 1.0, count) ** COLUMN_POWER


class _Samples:
    """Light at rows and columns, `nodes`, to which more are added."""

    def __init__(self, light: Light, rows: np.ndarray, columns: np.ndarray):
        self._light, self.nodes = light, [rows, columns]
        self.answer = self.asked(rows, columns)

    def asked(self, rows: np.ndarray, columns: np.ndarray) -> Answer:
        """Light on a grid."""
        return self._light(beside_breaks(rows), columns)

    def insert(self, place: np.ndarray, nodes: np.ndarray, answer: Answer, axis: int) -> None:
        """Put new rows (axis 0) or columns (axis 1) before the places of others."""
        self.nodes[axis] = np.insert(self.nodes[axis], place, nodes)
        parts = zip(vars(self.answer).values(), vars(answer).values(), strict=True)
        both = [None if a is None or b is None else np.insert(a, place, b, axis=axis) for a, b in parts]
        self.answer = Answer(*both)  # type: ignore[arg-type]


def fill(
    light: Light,
    once: ScatteredOnce,
    sun_elevation_deg: float,
    rows_deg: np.ndarray,
    columns_deg: np.ndarray | None = None,
    *,
    widening: tuple[np.ndarray, np.ndarray] | None = None,
    refine: bool = True,
    closest_rows_deg: float = CLOSEST_ROWS_DEG,
    most: tuple[int, int] = (MOST_ROWS, MOST_COLUMNS),
) -> SkyTable:
    """The table of one sun.

    rows_deg: the first rows, `first_rows`, or those of another table
    columns_deg: columns of another table, whose nodes are then halved only where a few lines of sight miss; None: the
        usual first ones, which are halved once
    widening: `ScatteredOnce.widening` of this sun, and the one that the table's phase function has; None: no aureole
    refine: whether nodes are halved at all, and the table is compared with lines of sight that it has not used
    closest_rows_deg: rows closer than this are not halved [deg]; most: rows and columns
    """
    samples = _Samples(light, rows_deg, first_columns() if columns_deg is None else columns_deg)

    def table() -> SkyTable:
        return _table(samples, once, sun_elevation_deg, widening)

    if not refine:
        return table()
    for axis, closest in ((0, closest_rows_deg), (1, CLOSEST_COLUMNS_DEG)):
        nodes = samples.nodes[axis]
        halves = np.flatnonzero(np.diff(nodes) > 2.0 * closest)
        if columns_deg is not None:
            few = samples.nodes[1 - axis][:: max(1, samples.nodes[1 - axis].size // PROBES)]
            halves = halves[_missed(table(), light, 0.5 * (nodes[halves] + nodes[halves + 1]), few, axis)[0]]
        while halves.size and samples.nodes[axis].size < most[axis]:
            nodes = samples.nodes[axis]
            missed, answer = _missed(table(), samples.asked, 0.5 * (nodes[halves] + nodes[halves + 1]), None, axis)
            samples.insert(halves + 1, 0.5 * (nodes[halves] + nodes[halves + 1]), answer, axis)
            place = (halves + np.arange(halves.size))[missed]
            halves = (place[:, None] + np.arange(2)).ravel()
            halves = halves[np.diff(samples.nodes[axis])[halves] > closest]
    return _checked(table(), light)


def _missed(
    table: SkyTable, light: Light, nodes: np.ndarray, across: np.ndarray | None, axis: int
) -> tuple[np.ndarray, Answer]:
    """Which new rows (axis 0) or columns (axis 1) a table misses, and their light; across: nodes of the other axis,
    None: those of the table."""
    if across is None:
        across = table.azimuth_deg if axis == 0 else table.elevation_deg
    if not nodes.size:
        return np.zeros(0, bool), Answer(np.zeros((0, 0, 0)))
    grid = (nodes, across) if axis == 0 else (across, nodes)
    answer = light(*grid)
    least = FAINT * np.exp(table.smooth[0].max(axis=(0, 1)))
    error = np.abs(table.on_grid(*grid) - answer.radiance) / np.maximum(answer.radiance, np.maximum(least, 1e-37))
    each = np.moveaxis(error, axis, 0).reshape(nodes.size, -1)
    return (np.percentile(each, 95, axis=1) > USUAL_MISS) | (each.max(axis=1) > LARGEST_MISS), answer


def _checked(table: SkyTable, light: Light) -> SkyTable:
    """The table with its error, beside light in directions drawn at random."""
    random = np.random.default_rng(1)
    rows = table.elevation_deg
    e = np.sort(rows[0] + (rows[-1] - rows[0]) * random.uniform(size=CHECKS[0]) ** 2)
    a = np.sort(random.uniform(table.azimuth_deg[0], table.azimuth_deg[-1], CHECKS[1]))
    radiance = light(e, a).radiance
    least = np.maximum(FAINT * np.exp(table.smooth[0].max(axis=(0, 1))), 1e-37)
    error = np.abs(table.on_grid(e, a) - radiance) / np.maximum(radiance, least)
    return replace(table, error=float(np.percentile(error, 95)), worst=float(error.max()))


def _table(
    samples: _Samples,
    once: ScatteredOnce,
    sun_elevation_deg: float,
    widening: tuple[np.ndarray, np.ndarray] | None,
) -> SkyTable:
    (rows, columns), answer = samples.nodes, samples.answer
    apparent = once.apparent_sun_deg(sun_elevation_deg)
    angle = scattering_angle_rad(apparent, rows[:, None], columns)[None]
    part = once.light(sun_elevation_deg, beside_breaks(rows), columns)
    log_phase = once.log_phase
    if part is not None and log_phase is not None and widening is not None:
        part = part * np.exp(at_angle(widening[0], angle[0]))
        log_phase = log_phase + widening[1]
    smooth, aureole = split(answer.radiance[None], None if part is None else part[None], angle, log_phase)
    stokes = None
    if answer.polarisation is not None:
        total = answer.radiance[..., None, :]
        stokes = np.divide(answer.polarisation, total, out=np.zeros(answer.polarisation.shape), where=total > 0.0)
        stokes = stokes.astype(np.float32)[None]
    return SkyTable(
        np.array([float(sun_elevation_deg)]),
        np.array([apparent]),
        rows,
        columns,
        smooth,
        aureole,
        None if aureole is None else log_phase,
        stokes,
    )
