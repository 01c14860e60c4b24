"""Wavelengths by which solvers lay out their grids, whatever wavelengths are asked for.

If a grid followed the wavelengths asked for, each of them would move the light at the others.  So the spectrum has
fixed ranges: all wavelengths of a range share one grid, made for the air at a few fixed wavelengths of the range, the
worst case of them.  From 360 nm on one grid serves all, at hardly more nodes than the clearest wavelength needs; below,
ozone grows by factors within 20 nm.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from functools import cached_property
from types import SimpleNamespace
from typing import Any, Generic, TypeVar

import numpy as np

from twilight.base.errors import TwilightError

M = TypeVar("M")
"""A `Medium`, whose module imports this one."""

RANGES: tuple[tuple[float, tuple[float, ...]], ...] = (
    (300.0, (300.0, 308.0, 316.0)),
    (320.0, (320.0, 330.0, 345.0)),
    (360.0, (380.0, 450.0, 550.0, 650.0, 720.0)),
)
"""Ranges: where each begins [nm], and its fixed wavelengths [nm].

The last range ends with the optical data; its fixed wavelengths are some whose aerosol optics come with the program.
"""


def range_of(wavelength_nm: float) -> int:
    """The range that a wavelength [nm] belongs to, from 0."""
    return max(0, int(np.searchsorted([start for start, _ in RANGES], wavelength_nm, side="right")) - 1)


def fixed_wavelengths(wavelength_nm: Iterable[float]) -> np.ndarray:
    """The fixed wavelengths [nm] of all ranges that some of these [nm] belong to."""
    ranges = sorted({range_of(w) for w in wavelength_nm})
    return np.array([w for i in ranges for w in RANGES[i][1]])


class _OnDemand(Generic[M]):
    """The air at fixed wavelengths, built when it is first asked for and then cached."""

    def __init__(self, build: Callable[[np.ndarray], M], wavelength_nm: np.ndarray):
        self._build, self._wavelength_nm = build, wavelength_nm

    @cached_property
    def medium(self) -> M | None:
        try:
            return self._build(self._wavelength_nm) if self._wavelength_nm.size else None
        except TwilightError:  # the user's table of optics covers some of the wavelengths
            known = np.array([w for w in self._wavelength_nm if self._known(w)])
            return self._build(known) if known.size else None

    def _known(self, wavelength_nm: float) -> bool:
        try:
            self._build(np.array([wavelength_nm]))
        except TwilightError:
            return False
        return True


@dataclass(frozen=True, eq=False)
class GridMedium(Generic[M]):
    """The air of a medium, M, at fixed wavelengths, by which grids are laid out; the field `Medium.grid_medium`.

    It stands for certain optics: those of the medium that it is first given to.  `dataclasses.replace` of that medium
    keeps it where the optics stay the same (another ground, filter above the air, name or notes), and drops it where
    they change, because grids for other air are not known to serve.
    """

    _source: Any
    _optics: tuple[Any, ...] | None = None

    @staticmethod
    def on_demand(build: Callable[[np.ndarray], M], wavelength_nm: np.ndarray) -> GridMedium[M]:
        """What `build` makes of those wavelengths (W,) [nm] whose optics are known, when it is first asked for."""
        return GridMedium(_OnDemand(build, wavelength_nm))

    @staticmethod
    def of(medium: M) -> GridMedium[M]:
        """A medium that is built already."""
        return GridMedium(SimpleNamespace(medium=medium))

    @property
    def medium(self) -> M | None:
        """At those of the fixed wavelengths where the optics are known; None where they are known at none."""
        return self._source.medium

    def for_optics(self, optics: tuple[Any, ...]) -> GridMedium[M] | None:
        """For a medium of these optics, which become its own the first time; None for other optics."""
        if self._optics is None:
            return replace(self, _optics=optics)
        same = len(optics) == len(self._optics) and all(map(_equal, optics, self._optics))
        return self if same else None

    def for_any_optics(self) -> GridMedium[M]:
        """The same, to be given to a medium of the same air in other arrays."""
        return replace(self, _optics=None)


def _equal(one: Any, other: Any) -> bool:
    return one is other or (not hasattr(one, "kind") and np.array_equal(one, other))
