"""Fills a `SkyTable` with a field's light: nodes are added until interpolation between them is accurate enough.

Rows are halved where the table's rule misses the light of the row between two others, then columns, the worst first
where their number ends; whatever is computed for a test becomes a node.  From high up, and in air without aerosol,
edges of light, that of the Earth's shadow above all, go slantwise over the sky: there the middles of cells are tried
too.  In the end the table is
compared with light at the visible horizon and the other edges, about the sun, opposite to it, over the sky, and in the
middle of the worst cells.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from twilight.base.conventions import TINY_SINGLE
from twilight.engine.block import Stokes
from twilight.numerics.directions import scattering_angle_rad
from twilight.sky.table import SkyTable, at_angle, split
from twilight.transport.rays import horizon_dip_deg
from twilight.transport.scattered_once import ScatteredOnce, faint_edges

if TYPE_CHECKING:
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

CLOSEST_TO_BREAK = 0.3
"""Rows closer than this part of their distance from a break are not halved."""

CLOSEST_ROWS_AT_BREAK_DEG = 1e-3
"""Rows closer than this are not halved next to a break [deg]: light falls as the root of the distance from a ray that
grazes the edge of a layer."""

CLOSEST_COLUMNS_DEG = 0.25
"""Columns closer than this are not halved [deg]."""

MOST_ROWS, MOST_COLUMNS = 140, 70
"""Most rows and columns of a table, which bounds its time in air with edges."""

ROWS_FOR_BREAK = 20
"""Rows that a table may have more for each break."""

TRIES_OF_CELLS = 4
"""How often at most the middles of cells are tried from high up: of all, then of those that a table missed."""

LARGEST_IN_CELL = 0.01
"""Relative error in the middle of a cell beyond which its rows, or its columns, are halved."""

MORE_ROWS, MORE_COLUMNS = 60, 60
"""Rows and columns that a table may have more for its cells."""

CLOSEST_ROWS_OF_CELLS_DEG = 0.01
"""Rows closer than this are not halved for a cell [deg]."""

FAINT = 1e-3
"""Light, of the brightest at a wavelength, whose errors count as if it were so bright."""

CHECKS = (6, 4)
"""Rows about each edge and over the sky, and columns about the sun and over the sky, in which a table is compared with
light in the end."""

NEAR_HORIZON = (-1.7, 0.5)
"""Logarithms of the least and largest distance of those rows from an edge [deg]."""

PROBES = 4
"""Lines of sight, about, across which nodes of another table are tested."""

BESIDE_BREAK_DEG = 1e-4
"""How far from a break the rows next to it stand [deg]."""


HIGH_FROM_KM = 0.1
"""Height above the ground from which rows go below the horizontal; lower down the horizon dips by 0.3 deg at most."""

BREAKS_APART_DEG = 0.02
"""A break closer than this above another one is left out [deg]: from afar the edge of the haze is at the horizon."""


def with_ground(scene: Scene, altitude_km: float) -> tuple[float, list[float]]:
    """`row_breaks` of a table that has the ground too, for a solver that can look down."""
    low, breaks = row_breaks(scene, altitude_km)
    return (low, breaks) if breaks else (-90.0, [-horizon_dip_deg(scene.medium, altitude_km)])


def row_breaks(scene: Scene, altitude_km: float) -> tuple[float, list[float]]:
    """The lowest row of a scene's table, and where light of the rows is not smooth [deg].

    Seen from high up by a solver that can look down: the horizon, and the rays that graze the edges of layers below and
    the top of the air.
    """
    medium = scene.medium
    above_ground_km = altitude_km - medium.bottom_km
    if above_ground_km <= HIGH_FROM_KM or not (scene.capabilities.every_observer and scene.capabilities.looks_down):
        return 0.0, []
    level = faint_edges(medium)
    level = np.append(level[level < medium.top_km], medium.top_km)
    edges = [-horizon_dip_deg(medium, altitude_km, float(k)) for k in level[level < altitude_km - 0.01]]
    breaks = [-horizon_dip_deg(medium, altitude_km)]
    for edge in sorted(edges):
        if edge - breaks[-1] > BREAKS_APART_DEG:
            breaks.append(edge)
    return -90.0, breaks


AEROSOL_OVER_SHADOW = 0.02
"""Aerosol optical depth, at the wavelength where it is least, from which on the edge of the Earth's shadow is smooth:
in `maritime-clean` (0.09) shared rows hold it within 0.7 %."""

SHADOW_HEIGHTS_DEG = (3.7, 1.9, 0.8)
"""Heights above the horizon up to which the gaps of shared rows are halved in turn for that edge [deg]."""

LEAST_SHADOW_DEG = 0.1
"""Height from which on they are [deg]."""


Light = Callable[[np.ndarray, np.ndarray], Stokes]
"""What a table is filled with: the light of rows (E,) and columns (A,) [deg], (E, A, S, W), under one sun."""


def first_rows(low_deg: float, breaks_deg: Sequence[float], count: int = FIRST_ROWS) -> np.ndarray:
    """Rows from low_deg to the zenith, closest at the last break; every break stands twice."""
    edges = [low_deg, *(b for b in sorted(breaks_deg) if low_deg < b < 90.0), 90.0]
    parts = []
    for n, (below, above) in enumerate(pairwise(edges)):
        last = n == len(edges) - 2
        u = np.linspace(0.0, 1.0, count if last else max(5, count // 2))
        rise = u**ROW_POWER if last else 1.0 - (1.0 - u) ** ROW_POWER if n == 0 else 0.5 - 0.5 * np.cos(np.pi * u)
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


def shared_columns(count: int) -> np.ndarray:
    """Columns that many suns share [deg]: those of `first_columns`, and two more, halves of the gaps beside the sun."""
    columns = first_columns(count - 2)
    return np.sort(np.append(columns, _middles(columns[:3])))


def shared_rows(scene: Scene, altitude_km: float, count: int, *, ground: bool = False) -> np.ndarray:
    """Rows that many suns share [deg], so many above the last break, and more for a sharp edge of the Earth's shadow;
    ground: whether it is seen from low down, too."""
    low, breaks = with_ground(scene, altitude_km) if ground else row_breaks(scene, altitude_km)
    rows = first_rows(low, breaks, count)
    if shows_shadow(scene):
        for top in SHADOW_HEIGHTS_DEG:
            above = _middles(rows) - (breaks[-1] if breaks else low)
            rows = np.sort(np.append(rows, _middles(rows)[(above > LEAST_SHADOW_DEG) & (above < top)]))
    return rows


def shows_shadow(scene: Scene) -> bool:
    """Whether no aerosol hides the edge of the Earth's shadow opposite to the sun."""
    return bool(scene.medium.optical_depth("aerosol").min() < AEROSOL_OVER_SHADOW)


class _Samples:
    """Light at rows and columns, `nodes`, to which more are added."""

    def __init__(self, light: Light, rows: np.ndarray, columns: np.ndarray):
        self._light, self.nodes = light, [rows, columns]
        self.stokes = self.asked(rows, columns)

    def asked(self, rows: np.ndarray, columns: np.ndarray) -> Stokes:
        """Light on a grid."""
        return self._light(beside_breaks(rows), columns)

    def insert(self, place: np.ndarray, nodes: np.ndarray, stokes: Stokes, axis: int) -> None:
        """Put new rows (axis 0) or columns (axis 1) before the places of others."""
        self.nodes[axis] = np.insert(self.nodes[axis], place, nodes)
        self.stokes = np.insert(self.stokes, place, stokes, axis=axis)


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
    breaks = rows_deg[1:][np.diff(rows_deg) == 0.0]

    most = most[0] + ROWS_FOR_BREAK * breaks.size, most[1]

    def table() -> SkyTable:
        return _table(samples, once, sun_elevation_deg, widening)

    def far_apart(axis: int, times: float = 1.0) -> np.ndarray:
        """Of each two neighbours, whether they may be halved."""
        nodes = samples.nodes[axis]
        if axis == 1:
            return np.diff(nodes) > times * CLOSEST_COLUMNS_DEG
        closest = np.full(nodes.size - 1, closest_rows_deg)
        for one in breaks:
            away = np.abs(0.5 * (nodes[1:] + nodes[:-1]) - one)
            closest = np.minimum(closest, np.maximum(CLOSEST_TO_BREAK * away, CLOSEST_ROWS_AT_BREAK_DEG))
        return np.diff(nodes) > times * closest

    def halve(halves: np.ndarray, axis: int) -> None:
        """Nodes between those that begin at some places, and between these where the table missed them."""
        while halves.size and samples.nodes[axis].size < most[axis]:
            nodes = samples.nodes[axis]
            middle = 0.5 * (nodes[halves] + nodes[halves + 1])
            miss, stokes = _misses(table(), samples.asked, middle, None, axis)
            samples.insert(halves + 1, middle, stokes, axis)
            place = halves + np.arange(halves.size)
            room = max(0, most[axis] - samples.nodes[axis].size)
            worst = np.sort(np.argsort(-miss)[: max(1, room // 2)])
            place = place[worst[miss[worst] > 1.0]]
            halves = (place[:, None] + np.arange(2)).ravel()
            halves = halves[far_apart(axis)[halves]]

    def look_again(axis: int) -> None:
        """Halve where lines of sight across a few of the other nodes miss."""
        nodes, few = samples.nodes[axis], samples.nodes[1 - axis]
        halves = np.flatnonzero(far_apart(axis, 2.0))
        few = few[:: max(1, few.size // PROBES)]
        miss, _ = _misses(table(), samples.asked, 0.5 * (nodes[halves] + nodes[halves + 1]), few, axis)
        halve(halves[miss > 1.0], axis)

    if not refine:
        return table()
    for axis in (0, 1):
        if columns_deg is None:
            halve(np.flatnonzero(far_apart(axis, 2.0)), axis)
        else:
            look_again(axis)
    cells = np.zeros(0), np.zeros(0)
    if breaks.size or once.log_phase is None:
        cells = _mended(samples, table, (most[0] + MORE_ROWS, most[1] + MORE_COLUMNS))
    return _checked(table(), light, breaks, cells)


def _mended(samples: _Samples, table: Callable[[], SkyTable], most: tuple[int, int]) -> tuple[np.ndarray, np.ndarray]:
    """Halve rows and columns of cells in whose middle a table misses light; rows and columns to check it in.

    With a cell's new row in the table, what it still misses in the middle is for columns.
    """
    tried = [_middles(nodes) for nodes in samples.nodes]
    tried[0] = tried[0][np.diff(samples.nodes[0]) > CLOSEST_ROWS_AT_BREAK_DEG]
    for left in range(TRIES_OF_CELLS, 0, -1):
        light = samples.asked(*tried)[..., 0, :]
        first = error = _errors(table(), light, *tried).max(axis=-1)
        for axis, closest in enumerate((CLOSEST_ROWS_OF_CELLS_DEG, CLOSEST_COLUMNS_DEG)):
            nodes, miss = samples.nodes[axis], error.max(axis=1 - axis)
            place = np.searchsorted(nodes, tried[axis])
            miss = np.where(nodes[place] - nodes[place - 1] > closest, miss, 0.0)
            worst = np.argsort(-miss)[: max(0, most[axis] - nodes.size) // left]
            new = np.sort(worst[miss[worst] > LARGEST_IN_CELL])
            if new.size:
                grid = [*samples.nodes]
                grid[axis] = tried[axis][new]
                samples.insert(place[new], grid[axis], samples.asked(*grid), axis)
                error = _errors(table(), light, *tried).max(axis=-1)
        bad = first > LARGEST_IN_CELL
        if not bad.any() or left == 1:
            break
        tried = [_cells_at(samples.nodes[axis], tried[axis][bad.any(axis=1 - axis)]) for axis in (0, 1)]
    worst_of = [np.argsort(-first.max(axis=1 - axis))[: CHECKS[axis]] for axis in (0, 1)]
    rows, columns = (_cells_at(samples.nodes[axis], tried[axis][worst_of[axis]]) for axis in (0, 1))
    return rows, columns


def _middles(nodes: np.ndarray) -> np.ndarray:
    return 0.5 * (nodes[1:] + nodes[:-1])


def _cells_at(nodes: np.ndarray, places: np.ndarray) -> np.ndarray:
    """Middles of the intervals between nodes that hold or touch some places, but for those of no width."""
    held = np.union1d(np.searchsorted(nodes, places) - 1, np.searchsorted(nodes, places, side="right") - 1)
    held = held[(held >= 0) & (held < nodes.size - 1)]
    return _middles(nodes)[held[np.diff(nodes)[held] > 0.0]]


def _misses(
    table: SkyTable, light: Light, nodes: np.ndarray, across: np.ndarray | None, axis: int
) -> tuple[np.ndarray, Stokes]:
    """How far a table misses new rows (axis 0) or columns (axis 1), over what it may, and their light; across: nodes of
    the other axis, None: those of the table."""
    if across is None:
        across = table.azimuth_deg if axis == 0 else table.elevation_deg
    if not nodes.size:
        return np.zeros(0), np.zeros((0, 0, 0, 0))
    grid = (nodes, across) if axis == 0 else (across, nodes)
    stokes = light(*grid)
    each = _errors(table, stokes[..., 0, :], *grid)
    # a break's rows are beside it, where only they know the light
    smooth = (np.diff(grid[0], prepend=-np.inf) > 0.0) & (np.diff(grid[0], append=np.inf) > 0.0)
    each = np.moveaxis(each[smooth], axis, 0).reshape(nodes.size, -1)
    return np.maximum(np.percentile(each, 95, axis=1) / USUAL_MISS, each.max(axis=1) / LARGEST_MISS), stokes


def _errors(table: SkyTable, radiance: np.ndarray, elevation_deg: np.ndarray, azimuth_deg: np.ndarray) -> np.ndarray:
    """Relative errors of a table beside light on rows and columns, (E, A, W)."""
    least = np.maximum(FAINT * np.exp(table.smooth[0].max(axis=(0, 1))), TINY_SINGLE)
    return np.abs(table.on_grid(elevation_deg, azimuth_deg) - radiance) / np.maximum(radiance, least)


def _checked(
    table: SkyTable, light: Light, breaks_deg: np.ndarray, worst_of_cells: tuple[np.ndarray, np.ndarray]
) -> SkyTable:
    """The table with its error, beside light where eyes look: about the visible horizon and the edges of layers below
    the observer, about the sun, opposite to it, over the sky, and in the worst of its cells."""
    random, rows, columns = np.random.default_rng(1), table.elevation_deg, table.azimuth_deg
    lowest = breaks_deg if breaks_deg.size else rows[:1]
    near = [edge + 10.0 ** random.uniform(*NEAR_HORIZON, CHECKS[0]) for edge in lowest]
    near += [edge - 10.0 ** random.uniform(*NEAR_HORIZON, CHECKS[0]) for edge in breaks_deg]
    high = np.degrees(np.arcsin(random.uniform(np.sin(np.radians(lowest[0])), 1.0, CHECKS[0])))
    sun = table.apparent_sun_deg[0] + random.normal(0.0, 3.0, CHECKS[0] // 2)
    # rows are closest where light changes most
    gaps = np.diff(rows)
    closest = np.argsort(gaps + 180.0 * (gaps < 3.0 * CLOSEST_ROWS_AT_BREAK_DEG))[: CHECKS[0]]
    e = np.concatenate([*near, high, sun, _middles(rows)[closest], worst_of_cells[0]])
    away = np.abs(random.normal(0.0, 15.0, CHECKS[1]))
    a = np.concatenate([away, 180.0 - away[::2], random.uniform(0.0, 180.0, CHECKS[1]), worst_of_cells[1]])
    e, a = np.unique(e.clip(rows[0], rows[-1])), np.unique(a.clip(columns[0], columns[-1]))
    error = _errors(table, light(e, a)[..., 0, :], e, a)
    # the worst places are no sample of directions
    usual = error[~np.isin(e, worst_of_cells[0])][:, ~np.isin(a, worst_of_cells[1])]
    return replace(table, error=float(np.percentile(usual, 95)), worst=float(error.max()))


def _table(
    samples: _Samples,
    once: ScatteredOnce,
    sun_elevation_deg: float,
    widening: tuple[np.ndarray, np.ndarray] | None,
) -> SkyTable:
    (rows, columns), radiance = samples.nodes, samples.stokes[..., 0, :]
    apparent = once.apparent_sun_deg(sun_elevation_deg)
    angle = scattering_angle_rad(apparent, rows[:, None], columns)[None]
    part = once.light(sun_elevation_deg, beside_breaks(rows), columns)
    log_phase = once.log_phase
    if part is not None and log_phase is not None and widening is not None:
        part = part * np.exp(at_angle(widening[0], angle[0]))
        log_phase = log_phase + widening[1]
    smooth, aureole = split(radiance[None], None if part is None else part[None], angle, log_phase)
    stokes = None
    if samples.stokes.shape[2] > 1:
        total, polarisation = radiance[..., None, :], samples.stokes[:, :, 1:]
        stokes = np.divide(polarisation, total, out=np.zeros(polarisation.shape), where=total > 0.0)
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
