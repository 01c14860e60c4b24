"""prepare and Field: the cells solver behind the interface that all solvers share."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from twilight.atmosphere.medium import Medium
from twilight.base.errors import TwilightError
from twilight.base.progress import Progress, silent
from twilight.solvers.base import BareField, Cost
from twilight.solvers.cells.exact import (
    ExactCells,
    MultipleView,
    coarse_elevations,
    horizon_deg,
    make_straight_lines,
    single_scattering,
)
from twilight.solvers.cells.exchange import make_active_shells
from twilight.solvers.cells.grid import make_grid
from twilight.solvers.cells.haber import HaberField
from twilight.solvers.cells.settings import QUALITIES, CellsSettings, check_sun
from twilight.transport.beam import prepare_beam
from twilight.transport.profile import prepare_profile
from twilight.transport.scaling import delta_scaled

PAIR_S = 5.5e-7
"""Processor seconds of a pair of cells in a pass, there and back, whatever its wavelengths (S = 48 to 120)."""
PAIR_WAVELENGTH_S = 1.15e-7
"""The same of each wavelength of the pair."""
FORWARD_S = 2.7e-7
"""The same of each wavelength more in the pass whose light goes out by Henyey and Greenstein's function."""
SUNLIT_S = 2.5e-6
"""Processor seconds of a cell and wavelength in direct light: the search for the sun."""
POWERS_AT_ONCE = 2, 5
"""Numbers of a cell and wavelength that are there at the same time: of every cell, and more of an active one."""
WAVELENGTHS_OF_A_PASS = 32
"""Most wavelengths that share the geometry of a pass: those of a block."""

SET_UP_S = (0.19, 2.15e-4)
"""Processor seconds of a wavelength: of any, and times the product of its angles and density; as all figures here of
`draft` and `standard`, eight wavelengths (`benchmarks/results/compare.csv`)."""
SET_UP_BYTES = (1.55e7, 2.0e4)
"""Bytes of a wavelength, likewise."""
DIRECTION_S = 3.9e-7
"""Processor seconds of a direction and wavelength times that product."""


def cost(
    medium: Medium, settings: CellsSettings, sun_elevations_deg: Sequence[float] | None, observer_altitude_km: float
) -> Cost | None:
    """Cost of a field, of Haber's system all of it for each sun; None for single scattering: not known."""
    if settings.multiple_scattering == "none":
        return None
    if settings.multiple_scattering == "exact":
        angles = settings.polar_directions * settings.azimuth_directions * settings.azimuth_nodes
        size = angles * settings.node_density
        return Cost(
            fixed_bytes=0.0,
            bytes_per_wavelength=SET_UP_BYTES[0] + SET_UP_BYTES[1] * size,
            cpu_s_per_wavelength=SET_UP_S[0] + SET_UP_S[1] * size,
            cpu_s_per_direction=DIRECTION_S * size,
        )
    air = medium.bottom_km, medium.top_km, medium.earth_radius_km
    grid = make_grid(settings.azimuth_cells, settings.inner_radius_km, observer_altitude_km, *air)
    active = make_active_shells(grid, settings.active_shell_step).ring.size
    half, sharing = settings.azimuth_cells // 2 + 1, min(medium.n_wavelengths, WAVELENGTHS_OF_A_PASS)
    pairs = half * active * (active + 1) / 2
    passes = settings.max_orders - 1
    seconds = SUNLIT_S * grid.n_rings * half + passes * pairs * (PAIR_S / sharing + PAIR_WAVELENGTH_S)
    every, of_active = POWERS_AT_ONCE
    return Cost(
        fixed_bytes=0.0,
        bytes_per_wavelength=8.0 * half * (every * grid.n_rings + of_active * active),
        cpu_s_per_wavelength=0.0,
        cpu_s_per_direction=0.0,
        cpu_s_per_sun=seconds + min(passes, 1) * pairs * FORWARD_S,
    )


def prepare(
    medium: Medium,
    settings: CellsSettings | None = None,
    *,
    observer_altitude_km: float = 0.0,
    progress: Progress | None = None,
) -> Field | HaberField:
    """Make everything that does not depend on the sun.

    Parameters
    ----------
    medium
        Coefficients of air, aerosol and gases at W wavelengths, and the ground.
    settings
        One of QUALITIES, perhaps with options replaced; None: `standard`.
    observer_altitude_km
        Altitude of the observer [km], inside the air.
    progress
        Called as progress(doing, fraction) now and then.

    Raises
    ------
    TwilightError
        For an observer below the ground or above the air.

    References
    ----------
    Haber, Magnor & Seidel 2005, Physically-based simulation of twilight phenomena.
    """
    settings = settings or QUALITIES["standard"]
    if not medium.bottom_km <= observer_altitude_km < medium.top_km:
        raise TwilightError(
            "the cells solver needs an observer inside the air: observer.altitude_km is "
            f"{observer_altitude_km:g}, allowed is {medium.bottom_km:g} to below {medium.top_km:g}"
        )
    made = HaberField if settings.multiple_scattering == "isotropic" else Field
    return made(medium, settings, float(observer_altitude_km), progress)


class Field(BareField):
    """The sky of one medium around one observer, for any sun, beyond Haber's system: exact phase functions."""

    def __init__(self, medium: Medium, settings: CellsSettings, observer_altitude_km: float, progress: Progress | None):
        self.medium, self.settings = medium, settings
        self.observer_altitude_km = observer_altitude_km
        self._progress = progress or silent
        exact = settings.multiple_scattering == "exact"
        self.scaled = delta_scaled(medium, settings.degree if exact else None)
        self._progress("sunbeam", 0.0)
        self.beam = prepare_beam(self.scaled.medium, refraction=settings.refraction)
        self.profile = prepare_profile(self.scaled.medium)
        self._progress("cells", 0.0)
        self.multiple: ExactCells | None = None
        if exact and settings.max_orders > 1:
            self.multiple = ExactCells(
                medium, self.scaled, self.profile, self.beam, settings, self.observer_altitude_km
            )
        self.horizon_deg = horizon_deg(self.observer_altitude_km, medium.bottom_km, medium.earth_radius_km)
        self._solved_sun_deg: float | None = None
        self._solution: Any = None
        self._views: dict[bool, MultipleView] = {}

    def radiance(self, sun_elevation_deg: float, elevation_deg, azimuth_deg) -> np.ndarray:
        """Sun-normalised radiance.

        Parameters
        ----------
        sun_elevation_deg
            True elevation of the sun's centre [deg].
        elevation_deg, azimuth_deg
            Of the lines of sight [deg], azimuth from the sun; they are broadcast.  Directions may look down: then the
            Lambertian ground is seen through the air, lit by sun and sky.

        Returns
        -------
        array
            [sr^-1], shape of the directions plus (W,).
        """
        check_sun(sun_elevation_deg)
        elevation, azimuth = np.broadcast_arrays(
            np.asarray(elevation_deg, dtype=float), np.asarray(azimuth_deg, dtype=float)
        )
        e, a = elevation.ravel(), azimuth.ravel()
        out = self.single(sun_elevation_deg, e, a)
        if self.multiple is not None:
            for below in (False, True):
                mask = (e < self.horizon_deg) if below else (e >= self.horizon_deg)
                if np.any(mask):
                    out[mask] += self._view(self.multiple, float(sun_elevation_deg), below)(e[mask], a[mask])
        self._progress("sky", 1.0)
        return out.reshape(*elevation.shape, -1)

    def single(self, sun_elevation_deg: float, elevation_deg, azimuth_deg) -> np.ndarray:
        """Light scattered once, (D, W) [sr^-1], for flat lists of directions in degrees."""
        lines = make_straight_lines(self.profile, self.scaled, self.observer_altitude_km, elevation_deg, azimuth_deg)
        return single_scattering(lines, self.beam, self.medium, self.scaled.forward_fraction, sun_elevation_deg)

    def _view(self, multiple: ExactCells, sun_elevation_deg: float, below: bool) -> MultipleView:
        """Light scattered more than once, above or below the horizon; the views of the latest sun are cached."""
        if self._solved_sun_deg != sun_elevation_deg:
            self._solution, self.convergence = multiple.solve(sun_elevation_deg, self._progress)
            self._solved_sun_deg, self._views = sun_elevation_deg, {}
        if below not in self._views:
            if below:
                elevation = coarse_elevations(self.horizon_deg - 1e-6, -90.0, 12)[::-1]
            else:
                elevation = coarse_elevations(self.horizon_deg, 90.0, 24)
            azimuth = np.linspace(0.0, 180.0, 25)
            self._views[below] = MultipleView(elevation, azimuth, multiple.view(self._solution, elevation, azimuth))
        return self._views[below]
