"""The pieces of a sweep: skies, the chunks that they lie in, and the tasks that workers are given."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator
from dataclasses import dataclass

from twilight import solvers
from twilight.base.digest import DISPLAY, code_digest

STANDARD_ERROR = "standard_error"
STOKES = ("sun_normalised_radiance_q", "sun_normalised_radiance_u")
STOKES_ERROR = ("standard_error_q", "standard_error_u")


def code_of(solver: str) -> str:
    """SHA-256 over the code and data that the skies of a sweep with this solver depend on."""
    return code_digest("twilight.studies.sweep.work", solvers.SOLVERS[solver], without=DISPLAY)


@dataclass(frozen=True)
class ScenePosition:
    """Sun and observer of one sky."""

    sun_elevation_deg: float
    sun_azimuth_deg: float | None
    distance_au: float
    observer_altitude_km: float
    time_s: float | None
    name: str


@dataclass(frozen=True)
class DatasetBlock:
    """One chunk of the dataset: an index along each outer dimension, a range along each inner one."""

    index: tuple[int, ...]
    ranges: tuple[tuple[int, int], ...]

    @property
    def skies(self) -> int:
        """How many skies it holds."""
        return math.prod(stop - start for start, stop in self.ranges)

    @property
    def region(self) -> tuple[slice, ...]:
        """Where it lies in an array over the sweep's dimensions."""
        return tuple(slice(i, i + 1) for i in self.index) + tuple(slice(*r) for r in self.ranges)

    @property
    def shape(self) -> tuple[int, ...]:
        """Shape of the block in an array over the sweep's dimensions."""
        return (1,) * len(self.index) + tuple(stop - start for start, stop in self.ranges)

    def scenes(self) -> Iterator[tuple[int, ...]]:
        """The index of each of its skies."""
        return itertools.product(*((i,) for i in self.index), *(range(*r) for r in self.ranges))


@dataclass(frozen=True)
class Task:
    """What one worker computes at a time: chunks that come out of one field.  key: a hash of all it depends on."""

    key: str
    field_key: str
    blocks: tuple[DatasetBlock, ...]

    @property
    def skies(self) -> int:
        """How many skies it computes."""
        return sum(block.skies for block in self.blocks)
