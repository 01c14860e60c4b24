"""The light of one sun: gathered from blocks of wavelengths as plain samples or as a table, and made a `Sky`."""

import warnings
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from twilight.atmosphere.medium import Medium
from twilight.base.conventions import UNSEEN
from twilight.base.errors import TwilightWarning
from twilight.engine.block import Block, Stokes, StokesWithError, join
from twilight.engine.sunbeam import Direct
from twilight.engine.table import HIGH_FROM_KM, fill, first_rows, row_breaks
from twilight.numerics.directions import texture_centres
from twilight.scene.scene import Scene
from twilight.sky.plain_grid import grid_error, plain_grid
from twilight.sky.sky import Sky
from twilight.sky.table import SkyTable
from twilight.sky.table import join as join_tables
from twilight.transport.rays import horizon_dip_deg

LARGEST_STATED_ERROR = 0.05
"""Largest relative error of a table, where it is compared with light, beyond which there is a warning."""
_NEAR_HORIZON_DEG = np.array([0.04, 0.15, 0.4, 0.9, 1.8, 3.5, 7.0, 14.0, 28.0, 56.0])
"""Distances of rows from the horizon: there the light changes at once, and radiance is evaluated on both sides."""


@dataclass
class SunLight:
    """The light of one sun, gathered from blocks of wavelengths one after the other.

    grid: rows (E,) and columns (A,) [deg] of plain samples; None: tables are filled.
    """

    grid: tuple[np.ndarray, np.ndarray] | None = None
    tables: list[SkyTable] = field(default_factory=list)
    samples: list[tuple[Stokes, Stokes | None]] = field(default_factory=list)

    def add(self, block: Block, sun_elevation_deg: float, altitude_km: float, **nodes: Any) -> None:
        """Add a block under the sun, seen from an altitude; nodes: as of `Field.table`."""
        if self.grid is not None:
            self.samples.append(block.texture(sun_elevation_deg, *self.grid, altitude_km))
            return
        if self.tables:
            last = self.tables[-1]
            nodes = {**nodes, "rows_deg": last.elevation_deg, "columns_deg": last.azimuth_deg}
        self.tables.append(_table(block, sun_elevation_deg, altitude_km, **nodes))

    @property
    def table(self) -> SkyTable:
        """At all wavelengths."""
        return join_tables(self.tables)

    def on_grid(self, grid: tuple[np.ndarray, np.ndarray], zero_deg: float = 0.0) -> StokesWithError:
        """The light on rows and columns, whose azimuths count from zero_deg before that of the sun: tables are read,
        samples are those of the grid."""
        if self.samples:
            return join(self.samples)
        table, rows, columns = self.table, grid[0], np.mod(grid[1] - zero_deg, 360.0)
        radiance = table.on_grid(rows, columns)[..., None, :]
        if table.stokes is None:
            return radiance, None
        return np.concatenate([radiance, table.fractional_stokes(rows[:, None], columns) * radiance], axis=-2), None

    def sky(
        self,
        medium: Medium,
        grid: tuple[np.ndarray, np.ndarray],
        direct: Direct,
        sun_elevation_deg: float,
        observer_altitude_km: float,
        **facts: Any,
    ) -> Sky:
        """The light on a grid (elevation (E,), azimuth (A,)) [deg] at all wavelengths of a medium, as a `Sky`."""
        stokes, error = self.on_grid(grid)
        polarised = stokes.shape[-2] > 1
        return Sky(
            wavelength_nm=medium.wavelength_nm,
            elevation_deg=grid[0],
            azimuth_deg=grid[1],
            sun_normalised_radiance=stokes[..., 0, :],
            standard_error=None if error is None else error[..., 0, :],
            polarisation=stokes[..., 1:, :] if polarised else None,
            polarisation_error=None if error is None or not polarised else error[..., 1:, :],
            sun_elevation_deg=sun_elevation_deg,
            observer_altitude_km=observer_altitude_km,
            ground_albedo=medium.ground_albedo,
            direct_irradiance=direct.irradiance,
            apparent_sun_elevation_deg=sun_elevation_deg + direct.bending_deg,
            **facts,
        )


def _table(
    block: Block,
    sun_elevation_deg: float,
    altitude_km: float,
    rows_deg: np.ndarray | None = None,
    columns_deg: np.ndarray | None = None,
    aureole_sun_deg: float | None = None,
    **limits: Any,
) -> SkyTable:
    """The sky of one sun in one block; arguments as of `Field.table`."""
    once = block.scattered_once(altitude_km)
    shared_sun_deg = sun_elevation_deg if aureole_sun_deg is None else aureole_sun_deg
    own, shared = (block.widening(sun, altitude_km) for sun in (sun_elevation_deg, shared_sun_deg))
    widening = None if own is None or shared is None else (own, shared)
    rows = first_rows(*row_breaks(block.scene, altitude_km)) if rows_deg is None else rows_deg

    def light(elevation_deg: np.ndarray, azimuth_deg: np.ndarray) -> Stokes:
        return block.texture(sun_elevation_deg, elevation_deg, azimuth_deg, altitude_km)[0]

    return fill(light, once, sun_elevation_deg, rows, columns_deg, widening=widening, **limits)


def equal_grid(scene: Scene) -> tuple[np.ndarray, np.ndarray] | None:
    """Rows (E,) and columns (A,) [deg] of plain samples, where they were asked for or light has noise; else None."""
    texture = scene.configuration.texture
    if not (texture.plain or scene.capabilities.standard_error):
        return None
    return texture_rows(scene), texture_centres(texture.shape)[1]


def texture_rows(scene: Scene) -> np.ndarray:
    """Elevations [deg] of equal rows: those of the sky, and from high up more, to the horizon and the nadir.

    Rows below 0 deg need a solver that serves every observer and looks down; they bracket the horizon, whose dip is
    that of the refracted ray that touches the ground.
    """
    rows, _ = texture_centres(scene.configuration.texture.shape)
    above_ground_km = scene.altitude_km - scene.medium.bottom_km
    able = scene.capabilities
    if above_ground_km <= HIGH_FROM_KM or not (able.every_observer and able.looks_down):
        return rows
    dip = horizon_dip_deg(scene.medium, scene.altitude_km)
    upper = np.concatenate([-dip + _NEAR_HORIZON_DEG, [0.0]])
    upper = upper[(upper <= 0.0) & (upper < rows[0] - 1e-6)]
    lower = np.append(-dip - _NEAR_HORIZON_DEG, -90.0)
    lower = lower[lower >= -90.0]
    merged = np.unique(np.concatenate([lower, upper, rows]))
    return merged[np.concatenate([[True], np.diff(merged) > 0.02])]


def shared_grid(lit: Sequence[tuple[SkyTable, float]]) -> tuple[np.ndarray, np.ndarray]:
    """`plain_grid` of a table, or rows and columns of those of several, each with its zero of azimuth [deg]; close ones
    once."""
    grids = [plain_grid(table) for table, _ in lit]
    if len(grids) == 1:
        return grids[0]
    turned = [np.mod(grid[1] + zero_deg, 360.0) % 360.0 for grid, (_, zero_deg) in zip(grids, lit, strict=True)]
    rows, columns = (np.unique(np.round(np.concatenate(nodes), 4)) for nodes in ([g[0] for g in grids], turned))
    return rows, columns[columns < 360.0]


def is_above_air(scene: Scene, altitude_km: float) -> bool:
    """Whether an observer stands above a scene's air; never where the air is a table, which ends anywhere."""
    table = scene.config is not None and scene.config.climate.medium is not None
    return not table and altitude_km >= scene.medium.top_km


def interpolation_error(light: SunLight, sky: Sky) -> tuple[float, float] | None:
    """Relative error, at 95 % of directions and at most, of a sky between its rows and columns: that of the tables and
    that of the grid which was read from them.  None: of samples, which are compared with nothing."""
    if not light.tables:
        return None
    usual, worst = grid_error(light.table, sky.elevation_deg, sky.azimuth_deg)
    return usual + max(t.error for t in light.tables), worst + max(t.worst for t in light.tables)


def warn_of_error(error: tuple[float, float] | None, sky: Sky, stacklevel: int) -> None:
    """TwilightWarning for a sky whose nodes ended at their limit before they held the light."""
    usual, worst = error or (0.0, 0.0)
    if worst > LARGEST_STATED_ERROR:
        warnings.warn(
            f"the sky of the sun at {sky.sun_elevation_deg:g} deg is interpolated between directions: it is off by "
            f"{100 * usual:.2g} % at 95 % of them and by {100 * worst:.2g} % at most, at a tested edge of light",
            TwilightWarning,
            stacklevel=stacklevel + 1,
        )


def warn_of_black(scene: Scene, sky: Sky, without_night: str, stacklevel: int) -> None:
    """TwilightWarning for a sky without light that anybody would see, which says why.

    without_night: what to do for light of the night; empty: it is in the sky.
    """
    light = sky.normalised_radiance
    if np.isnan(light).any() or light.max() > UNSEEN:
        return
    what = "black in every direction" if not light.any() else "darker than a thousandth of any night"
    altitude, top_km = sky.observer_altitude_km, scene.medium.top_km
    if is_above_air(scene, altitude):
        why = f"an observer at {altitude:g} km is above the air, which ends at {top_km:g} km, and looks up"
        ask = "take a lower observer.altitude_km"
    elif without_night:
        why, ask = f"no sunlight reaches it with the sun at {sky.sun_elevation_deg:g} deg", without_night
    else:
        why, ask = "there is no light in this air", "see the climate"
    warnings.warn(f"the sky is {what}: {why}; {ask}", TwilightWarning, stacklevel=stacklevel + 1)
