"""Compiles the kernels that a look at a solved field calls: `python -m twilight.solvers.zones.ahead`.

Arguments of the types of those of `Field` say for what; nothing is computed.
"""

from __future__ import annotations

from typing import Any

import numba
import numpy as np

from twilight.solvers.zones.aureole import Peak, widen
from twilight.solvers.zones.grid import Series
from twilight.solvers.zones.passes import Light, Refinement
from twilight.solvers.zones.paths import LANES, Points
from twilight.solvers.zones.view import view_multiple
from twilight.transport.around import Directions
from twilight.transport.beam import Beam, beam_at
from twilight.transport.bundle import Rays
from twilight.transport.profile import Profile
from twilight.transport.sunlit import scattered_once
from twilight.transport.sunlit_ray import Phases


def _none(*shape: int, dtype: type = float) -> np.ndarray:
    return np.zeros(shape, dtype)


def _compile(kernel: Any, *arguments: Any) -> None:
    kernel.compile(tuple(numba.typeof(argument) for argument in arguments))


def compile_look() -> None:
    """Compile `scattered_once`, `widen` and `view_multiple`, the sunbeam's `beam_at` first: solving needs it too."""
    single = np.float32
    beam = Beam(_none(1), _none(64, dtype=np.int64))
    rays = Rays(_none(1, dtype=np.int64), _none(0, 4), _none(0, 1), _none(0, 1), _none(0), _none(0), _none(0, 1))
    directions = Directions(_none(1, dtype=np.int64), _none(0), 0.0)
    phases = Phases(_none(3, 0, 1, 1), _none(3, 0, 1, 1), _none(3, 0, 1, 1))
    share = _none(1, 0, 1)
    _compile(beam_at, beam, 0.0, 0.0, _none(0))
    _compile(
        scattered_once, beam, rays, share, _none(0), directions, phases, 0.0, _none(0, 1), 0.0, _none(0),
        _none(0, 3, 1), 0, 0,
    )  # fmt: skip
    fields: list[Any] = [_none(1) for _ in Profile._fields]
    profile = Profile(*fields)._replace(
        extinction=_none(1, 1), scattering=_none(1, 1), species_scattering=_none(1, 1, 1),
        level_of_bin=_none(1, dtype=np.int64), earth_radius_km=1.0,
    )  # fmt: skip
    peak = Peak(_none(1, 1, 1), _none(1, 1), profile)
    _compile(
        widen, beam, peak, rays.first, rays.place, rays.weight, share, 0.0, directions.first, _none(3, 0),
        _none(3, 0, 1, 1), _none(3, 0, 1, 1), 0, 0,
    )  # fmt: skip
    points = Points(
        _none(0, dtype=np.int32), _none(0, dtype=single), _none(0, dtype=single), _none(0, 1, dtype=single),
        _none(0, dtype=np.int32), _none(0, 1, LANES, dtype=single), _none(0, 1, LANES, dtype=single),
        _none(0, LANES, dtype=single), _none(0, 1, dtype=single), _none(0, 1, dtype=single),
        _none(0, 3, 1, LANES, dtype=single),
    )  # fmt: skip
    light = Light(
        _none(1, 1, LANES, dtype=single), _none(1, 1, 1, LANES, dtype=single), _none(1, LANES, dtype=single),
        _none(0, 0, 0, 0, 0, dtype=single),
    )  # fmt: skip
    rule = Refinement(_none(1, 4, dtype=np.int64), _none(1, 4, dtype=single), 1)
    _compile(
        view_multiple, rays.first, rays.place, points, directions, _none(2), _none(2), light, rule, Series(1, 1, 0, 0),
        _none(0, LANES, dtype=single), _none(0), _none(0), _none(0, 3, LANES), 0, 0,
    )  # fmt: skip


if __name__ == "__main__":
    compile_look()
