"""Fills a `SkyTable` with a field's light: nodes are added until lines of sight that no node stands in agree.

Rows are halved where the table's rule misses the light of the row between two others, then columns; whatever is
computed for a test becomes a node.  In the end the table is compared with directions drawn at random.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import TYPE_CHECKING, Protocol

import numpy as np

from twilight.engine.answer import Answer
from twilight.numerics.orientation import scattering_angle_rad
from twilight.sky.table import SkyTable, split
from twilight.transport.apparent_rays import horizon_dip_deg
from twilight.transport.scattered_once import ScatteredOnce

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

LARGEST_MISS = 0.04
"""The same of the largest error in it."""

CLOSEST_ROWS_DEG = 0.06
"""Rows closer than this are not halved [deg]."""

CLOSEST_COLUMNS_DEG = 0.25
"""Columns closer than this are not halved [deg]."""

MOST_ROWS, MOST_COLUMNS = 140, 70
"""Most rows and columns of a table, which bounds its time in air with edges."""

FAINT = 1e-3
"""Light, of the brightest at a wavelength, whose errors count as if it were so bright."""

CHECKS = 96
"""Directions drawn at random with which a table is compared in the end."""

BESIDE_BREAK_DEG = 1e-3
"""How far from a break the rows next to it stand [deg]."""


HIGH_FROM_KM = 0.1
"""Height above the ground from which rows go below the horizontal; lower down the horizon dips by 0.3 deg at most."""

SUDDEN_FALL = 0.2
"""Part of the extinction that is lost within a hundredth of a kilometre where a layer has an edge."""


def row_breaks(scene: Scene, altitude_km: float) -> tuple[float, list[float]]:
    """The lowest row of a scene's table, and where light of the rows is not smooth [deg].

    Seen from high up by a solver that can look down: the horizon, and the rays that graze the edges of layers below.
    """
    medium = scene.medium
    above_ground_km = altitude_km - medium.bottom_km
    if above_ground_km <= HIGH_FROM_KM or not (scene.capabilities.every_observer and scene.capabilities.looks_down):
        return 0.0, []
    z = medium.altitude_km
    level = 0.5 * (z[1:] + z[:-1])
    extinction = medium.extinction_per_km.max(axis=1)
    sudden = (
        (np.diff(z) <= 0.01) & (np.diff(extinction) < -SUDDEN_FALL * extinction[:-1]) & (level < altitude_km - 0.01)
    )
    edges = [-horizon_dip_deg(medium, altitude_km, float(k)) for k in level[sudden]]
    return -90.0, sorted({-horizon_dip_deg(medium, altitude_km), *(round(e, 4) for e in edges)})


class Light(Protocol):
    """What a table is filled with: the answer of rows (E,) and columns (A,), (E, A, W), under one sun."""

    def __call__(self, elevation_deg: np.ndarray, azimuth_deg: np.ndarray) -> Answer: ...


def first_rows(low_deg: float, breaks_deg: Sequence[float], count: int = FIRST_ROWS) -> np.ndarray:
    """Rows from low_deg to the zenith, closest at the last break; every break stands twice."""
    edges = [low_deg, *(b for b in sorted(breaks_deg) if low_deg < b < 90.0), 90.0]
    parts = []
    for n, (below, above) in enumerate(pairwise(edges)):
        last = n == len(edges) - 2
        u = np.linspace(0.0, 1.0, count if last else max(5, count // 2))
        rise = u**ROW_POWER if last else 1.0 - (1.0 - u) ** ROW_POWER
        parts.append(below + (above - below) * rise)
    return np.concatenate(parts)


class _Samples:
    """Light at rows and columns, to which more are added."""

    def __init__(self, light: Light, rows: np.ndarray, columns: np.ndarray):
        self._light, self.rows, self.columns = light, rows, columns
        self.answer = self._asked(rows, columns)

    def _asked(self, rows: np.ndarray, columns: np.ndarray) -> Answer:
        """Of two equal rows one is asked just below the break."""
        below = np.append(np.diff(rows) == 0.0, False)
        above = np.concatenate([[False], np.diff(rows) == 0.0])
        return self._light(rows - BESIDE_BREAK_DEG * below + BESIDE_BREAK_DEG * above, columns)

    def add_rows(self, place: np.ndarray, rows: np.ndarray, found: Answer) -> None:
        """Insert rows found at `rows` before the places."""
        self.rows = np.insert(self.rows, place, rows)
        self.answer = _inserted(self.answer, place, found, 0)

    def add_columns(self, place: np.ndarray, columns: np.ndarray, found: Answer) -> None:
        """Insert columns."""
        self.columns = np.insert(self.columns, place, columns)
        self.answer = _inserted(self.answer, place, found, 1)


def _inserted(answer: Answer, place: np.ndarray, found: Answer, axis: int) -> Answer:
    polarisation = None
    if answer.polarisation is not None and found.polarisation is not None:
        polarisation = np.insert(answer.polarisation, place, found.polarisation, axis=axis)
    return Answer(np.insert(answer.radiance, place, found.radiance, axis=axis), None, polarisation)


def fill(
    light: Light,
    once: ScatteredOnce,
    sun_elevation_deg: float,
    rows_deg: np.ndarray,
    columns_deg: np.ndarray | None = None,
) -> SkyTable:
    """The table of one sun.

    rows_deg: the first rows, `first_rows`, or those of another table; columns_deg: the first columns; None: the usual
    """
    columns = 180.0 * np.linspace(0.0, 1.0, FIRST_COLUMNS) ** COLUMN_POWER if columns_deg is None else columns_deg
    samples = _Samples(light, rows_deg, columns)

    def table() -> SkyTable:
        return _table(samples, once, sun_elevation_deg)

    halves = np.flatnonzero(np.diff(samples.rows) > 2.0 * CLOSEST_ROWS_DEG)
    while halves.size and samples.rows.size < MOST_ROWS:
        rows = 0.5 * (samples.rows[halves] + samples.rows[halves + 1])
        found = light(rows, samples.columns)
        missed = _missed(table().on_grid(rows, samples.columns), found.radiance, samples.answer.radiance, 0)
        samples.add_rows(halves + 1, rows, found)
        again = np.concatenate([place + np.arange(2) for place in (halves + np.arange(halves.size))[missed]] or [[]])
        halves = again.astype(int)[np.diff(samples.rows)[again.astype(int)] > CLOSEST_ROWS_DEG]
    halves = np.flatnonzero(np.diff(samples.columns) > 2.0 * CLOSEST_COLUMNS_DEG)
    while halves.size and samples.columns.size < MOST_COLUMNS:
        columns = 0.5 * (samples.columns[halves] + samples.columns[halves + 1])
        found = samples._asked(samples.rows, columns)
        missed = _missed(table().on_grid(samples.rows, columns), found.radiance, samples.answer.radiance, 1)
        samples.add_columns(halves + 1, columns, found)
        again = np.concatenate([place + np.arange(2) for place in (halves + np.arange(halves.size))[missed]] or [[]])
        halves = again.astype(int)[np.diff(samples.columns)[again.astype(int)] > CLOSEST_COLUMNS_DEG]
    return table()


def _missed(read: np.ndarray, found: np.ndarray, sky: np.ndarray, axis: int) -> np.ndarray:
    """Which of the rows (axis 0) or columns (axis 1) found were missed by what was read there."""
    error = np.abs(read - found) / np.maximum(found, FAINT * sky.max(axis=(0, 1)))
    each = np.moveaxis(error, axis, 0).reshape(error.shape[axis], -1)
    return (np.percentile(each, 95, axis=1) > USUAL_MISS) | (each.max(axis=1) > LARGEST_MISS)


def _table(samples: _Samples, once: ScatteredOnce, sun_elevation_deg: float) -> SkyTable:
    rows, columns, answer = samples.rows, samples.columns, samples.answer
    apparent = once.apparent_sun_deg(sun_elevation_deg)
    angle = scattering_angle_rad(apparent, rows[:, None], columns)[None]
    part = once.light(sun_elevation_deg, rows, columns)
    smooth, aureole = split(answer.radiance[None], None if part is None else part[None], angle, once.log_phase)
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
        None if aureole is None else once.log_phase,
        stokes,
    )
