"""Wavelengths by which solvers lay out their grids, whatever wavelengths are asked for.

A grid that follows the wavelengths asked for lets each of them move the others.  So there are fixed ranges of
wavelengths: all of one range share a grid, made for the air at a few fixed wavelengths inside, the worst case of them.
From 360 nm on one grid serves all, at hardly more nodes than the clearest needs; below, ozone grows by factors within
20 nm.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import TYPE_CHECKING

import numpy as np

from twilight.errors import TwilightError

if TYPE_CHECKING:
    from twilight.atmosphere.medium import Medium

RANGES: tuple[tuple[float, tuple[float, ...]], ...] = (
    (300.0, (300.0, 308.0, 316.0)),
    (320.0, (320.0, 330.0, 345.0)),
    (360.0, (380.0, 450.0, 550.0, 650.0, 720.0)),
)
"""Where each range begins [nm], the last ending with the optical data, and its wavelengths [nm]: in the last some whose
aerosol optics come with the program."""


def range_of(wavelength_nm: float) -> int:
    """The range that a wavelength [nm] belongs to, from 0."""
    return max(0, int(np.searchsorted([start for start, _ in RANGES], wavelength_nm, side="right")) - 1)


def fixed_wavelengths(wavelength_nm: Iterable[float]) -> np.ndarray:
    """The fixed wavelengths [nm] of all ranges that some of these [nm] belong to."""
    found = sorted({range_of(w) for w in wavelength_nm})
    return np.array([w for i in found for w in RANGES[i][1]])


class Reference:
    """The same air at fixed wavelengths, built when it is first asked for."""

    def __init__(self, build: Callable[[np.ndarray], Medium], wavelength_nm: np.ndarray):
        """build: the air at given wavelengths [nm]; it is called with `wavelength_nm` (W,)."""
        self._build, self._wavelength_nm = build, wavelength_nm
        self._medium: Medium | None = None

    @staticmethod
    def of(medium: Medium) -> Reference:
        """One that is built already."""
        made = Reference(medium.select, medium.wavelength_nm)
        made._medium = medium
        return made

    def medium(self) -> Medium | None:
        """At those of the fixed wavelengths that the air's optics are known at; None where they are at none."""
        if self._medium is None and self._wavelength_nm.size:
            try:
                self._medium = self._build(self._wavelength_nm)
            except TwilightError:  # an own table of optics covers some of them
                self._wavelength_nm = np.array([w for w in self._wavelength_nm if self._known(w)])
                self._medium = self._build(self._wavelength_nm) if self._wavelength_nm.size else None
        return self._medium

    def _known(self, wavelength_nm: float) -> bool:
        try:
            self._build(np.array([wavelength_nm]))
        except TwilightError:
            return False
        return True
