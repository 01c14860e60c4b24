"""A sky that clouds cover in part, as independent columns: the mean of the sky under them and of the one between them.

    L = c L_under + (1 - c) L_between,    of Stokes parameters, the sunbeam and transmittances,

as if no light crossed from one to the other; c is the cover.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from twilight.engine.answer import Answer
from twilight.engine.block import Block
from twilight.engine.disc import follow_rows, make_disc

if TYPE_CHECKING:
    from twilight.engine.sunbeam import Direct
    from twilight.scene.scene import Scene
    from twilight.sky.disc import Disc


def mean_of(columns: Sequence[tuple[float, Any]], value: Callable[[Any], Any]) -> Any:
    """The mean of what each column gives, by its fraction of the sky."""
    return sum(fraction * value(column) for fraction, column in columns)


class MixedBlock(Block):
    """The same wavelengths under clouds and between them; `columns` are the blocks of one air each."""

    def __init__(self, columns: Sequence[tuple[float, Block]]):
        under = columns[0][1]
        super().__init__(under.problem, under.wavelengths, under.medium, under.bands, under._progress)
        self.columns = tuple(columns)
        self.field = under.field
        self.from_disk = all(block.from_disk for _, block in columns)

    def key(self, altitude_km: float) -> str:
        return " ".join(f"{fraction} {block.key(altitude_km)}" for fraction, block in self.columns)

    def rows_at_once(self, columns: int) -> int:
        return min(block.rows_at_once(columns) for _, block in self.columns)

    def answer(self, *question: Any, polarisation: bool = False, checkpoint: Path | None = None) -> Answer:
        found = []
        for n, (_, block) in enumerate(self.columns):
            own = None if checkpoint is None else checkpoint.with_suffix(f".column{n}{checkpoint.suffix}")
            found.append(block.answer(*question, polarisation=polarisation, checkpoint=own))
        fractions = np.array([fraction for fraction, _ in self.columns])
        parts: list[Any] = []
        for name, values in zip(vars(found[0]), zip(*(vars(one).values() for one in found), strict=True), strict=True):
            if any(value is None for value in values):
                parts.append(None)
            elif name.endswith("error"):
                # the columns' noise is their own
                parts.append(np.sqrt(np.tensordot(fractions**2, np.square(values), 1)))
            else:
                parts.append(np.tensordot(fractions, np.array(values), 1))
        return Answer(*parts)

    def inscatter(self, *question: Any) -> tuple[np.ndarray, np.ndarray]:
        found = [(fraction, block.inscatter(*question)) for fraction, block in self.columns]
        return mean_of(found, lambda two: two[0]), mean_of(found, lambda two: two[1])

    def direct(self, sun_elevation_deg: float, observer_altitude_km: float | None = None) -> Direct:
        found = [(fraction, block.direct(sun_elevation_deg, observer_altitude_km)) for fraction, block in self.columns]
        bending_deg = max((direct.bending_deg for _, direct in found), key=abs)
        return found[0][1]._replace(irradiance=mean_of(found, lambda one: one.irradiance), bending_deg=bending_deg)


def disc_of(
    scene: Scene,
    sun_elevation_deg: float,
    distance_au: float = 1.0,
    radius_deg: float | None = None,
    altitude_km: float | None = None,
) -> Disc:
    """The disc over a scene; arguments as of `make_disc`, altitude_km None: the observer's."""
    columns = scene.columns
    # the rows of the air that is seen through
    clear = columns[-1][1]
    altitude = clear.altitude_km if altitude_km is None else altitude_km
    disc = make_disc(clear.medium, sun_elevation_deg, altitude, distance_au, clear.bands, radius_deg)
    if len(columns) == 1:
        return disc
    rows = disc.elevation_deg
    passed = mean_of(columns, lambda one: follow_rows(one.medium, altitude, rows, one.bands)[1])
    return replace(disc, transmittance=np.where(disc.transmittance > 0.0, passed, 0.0))
