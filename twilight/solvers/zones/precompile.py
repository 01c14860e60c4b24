"""Compiles the kernels that evaluate a solved field: `python -m twilight.solvers.zones.precompile`.

Arguments of the types of those of `Field` say for what; nothing is computed.
"""

from __future__ import annotations

from typing import Any

import numba
import numpy as np

from twilight.solvers.zones.aureole import ForwardPeak, widen
from twilight.solvers.zones.grid import Truncation
from twilight.solvers.zones.line_integrals import view_multiple
from twilight.solvers.zones.next_order import CubicRule, RadianceField
from twilight.solvers.zones.ray_points import LANES, RayPoints
from twilight.transport.azimuth_series import RayDirections
from twilight.transport.beam import Beam, beam_at
from twilight.transport.profile import Profile
from twilight.transport.ray_bundle import RayBundle
from twilight.transport.sunlit import scattered_once
from twilight.transport.sunlit_ray import Phases


def _none(*shape: int, dtype: type = float) -> np.ndarray:
    return np.zeros(shape, dtype)


def _compile(kernel: Any, *arguments: Any) -> None:
    kernel.compile(tuple(numba.typeof(argument) for argument in arguments))


def compile_evaluation() -> None:
    """Compile `scattered_once`, `widen` and `view_multiple`, the sunbeam's `beam_at` first: solving needs it too."""
    single = np.float32
    beam = Beam(_none(1), _none(64, dtype=np.int64))
    rays = RayBundle(_none(1, dtype=np.int64), _none(0, 4), _none(0, 1), _none(0, 1), _none(0), _none(0), _none(0, 1))
    directions = RayDirections(_none(1, dtype=np.int64), _none(0), 0.0)
    phases = Phases(_none(3, 0, 1, 1), _none(3, 0, 1, 1), _none(3, 0, 1, 1))
    fraction = _none(1, 0, 1)
    _compile(beam_at, beam, 0.0, 0.0, _none(0))
    _compile(
        scattered_once, beam, rays, fraction, _none(0), directions, phases, 0.0, _none(0, 1), 0.0, _none(0),
        _none(0, 3, 1), 0, 0,
    )  # fmt: skip
    fields: list[Any] = [_none(1) for _ in Profile._fields]
    profile = Profile(*fields)._replace(
        extinction=_none(1, 1), scattering=_none(1, 1), species_scattering=_none(1, 1, 1),
        level_of_bin=_none(1, dtype=np.int64), earth_radius_km=1.0,
    )  # fmt: skip
    peak = ForwardPeak(_none(1, 1, 1), _none(1, 1), profile)
    _compile(
        widen, beam, peak, rays, fraction, directions, _none(3, 0), _none(3, 0, 1, 1), _none(3, 0, 1, 1), 0, 0
    )  # fmt: skip
    points = RayPoints(
        _none(0, dtype=np.int32), _none(0, dtype=single), _none(0, dtype=single), _none(0, 1, dtype=single),
        _none(0, dtype=np.int32), _none(0, 1, LANES, dtype=single), _none(0, 1, LANES, dtype=single),
        _none(0, LANES, dtype=single), _none(0, 1, dtype=single), _none(0, 1, dtype=single),
        _none(0, 3, 1, LANES, dtype=single),
    )  # fmt: skip
    light = RadianceField(
        _none(1, 1, LANES, dtype=single), _none(1, 1, 1, LANES, dtype=single), _none(1, LANES, dtype=single),
        _none(0, 0, 0, 0, 0, dtype=single),
    )  # fmt: skip
    rule = CubicRule(_none(1, 4, dtype=np.int64), _none(1, 4, dtype=single), 1)
    _compile(
        view_multiple, rays, points, directions, _none(2), _none(2), light, rule, Truncation(1, 1, 0, 0),
        _none(0, LANES, dtype=single), _none(0), _none(0, 3, LANES), 0, 0,
    )  # fmt: skip


if __name__ == "__main__":
    compile_evaluation()
