"""What a user can set of the cells solver."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Literal

from twilight.base.errors import TwilightError
from twilight.solvers.base import check_choices, check_ranges


@dataclass(frozen=True)
class CellsSettings:
    """Haber's cells, and what goes beyond them.

    Both modes:
    multiple_scattering: 'exact' follows the phase functions at every order, on points around the observer; 'isotropic'
        is Haber's system on his cells; 'none' is single scattering along exact lines of sight
    max_orders: most orders of scattering that are followed
    tolerance: stop earlier when what is missing is known to this fraction of the light at every point (exact: a
        geometric series is added for it) or an order adds less than this fraction (isotropic); 0 follows max_orders
    refraction: bend the sunbeam (exact: and spread it)

    Isotropic mode:
    azimuth_cells: S, the number of cells around a ring; their angular size is 360/S deg in azimuth and elevation
    active_shell_step: every n-th shell takes part in multiple scattering
    inner_radius_km: R_min, radius of the innermost shell
    sun_tolerance_deg: of the binary search for the refracted path to the sun
    reduce_extinction: in light scattered twice or more take g of the aerosol's scattering from its extinction too, so
        that none is lost; Haber takes it from scattering alone

    Exact mode:
    degree: of the Legendre series that phase functions are followed to (delta-scaled beyond)
    polar_directions: directions per hemisphere
    azimuth_directions: directions around
    azimuth_nodes: azimuths of the points, a multiple of azimuth_directions
    node_density: of the points in altitude and radius, 1 is standard
    """

    COMMON: ClassVar[tuple[str, ...]] = (
        "multiple_scattering",
        "max_orders",
        "refraction",
        "azimuth_cells",
        "active_shell_step",
    )
    """Options that are shown first."""

    azimuth_cells: int = 60
    active_shell_step: int = 4
    inner_radius_km: float = 0.1
    sun_tolerance_deg: float = 0.1
    reduce_extinction: bool = False
    max_orders: int = 60
    tolerance: float = 1e-3
    multiple_scattering: Literal["exact", "isotropic", "none"] = "exact"
    degree: int = 6
    polar_directions: int = 6
    azimuth_directions: int = 14
    azimuth_nodes: int = 28
    node_density: float = 0.8
    refraction: bool = True

    def __post_init__(self):
        ranges = {
            "azimuth_cells": (8, 360),
            "inner_radius_km": (0.001, 10.0),
            "active_shell_step": (1, 16),
            "max_orders": (1, 100),
            "tolerance": (0.0, 0.5),
            "sun_tolerance_deg": (1e-4, 0.5),
            "degree": (2, 32),
            "polar_directions": (2, 32),
            "azimuth_directions": (4, 96),
            "azimuth_nodes": (4, 192),
            "node_density": (0.3, 5.0),
        }
        check_ranges(self, ranges)
        check_choices(self, {"multiple_scattering": ("exact", "isotropic", "none")})
        if self.azimuth_cells % 2:
            raise TwilightError(f"solver.azimuth_cells is {self.azimuth_cells}; it must be even")
        if self.azimuth_nodes % self.azimuth_directions or self.azimuth_nodes % 2:
            raise TwilightError(
                f"solver.expert.azimuth_nodes is {self.azimuth_nodes}; it must be even and a multiple of "
                f"solver.expert.azimuth_directions, which is {self.azimuth_directions}"
            )
        if self.azimuth_directions < 2 * self.degree + 1:
            raise TwilightError(
                f"solver.expert.azimuth_directions is {self.azimuth_directions}; degree {self.degree} needs at least "
                f"{2 * self.degree + 1}"
            )


def check_sun(sun_elevation_deg: float) -> None:
    """TwilightError for an elevation that no sun has."""
    if not -90.0 <= sun_elevation_deg <= 90.0:
        raise TwilightError(f"sun.elevation_deg is {sun_elevation_deg:g}; allowed is -90 to 90")


QUALITIES: dict[str, CellsSettings] = {
    "draft": CellsSettings(degree=4, polar_directions=4, azimuth_directions=10, azimuth_nodes=20, node_density=0.7),
    "standard": CellsSettings(),
    "reference": CellsSettings(
        degree=8,
        polar_directions=8,
        azimuth_directions=18,
        azimuth_nodes=36,
        node_density=1.7,
        tolerance=3e-4,
    ),
    "haber2005": CellsSettings(
        azimuth_cells=120,
        multiple_scattering="isotropic",
        max_orders=5,
        tolerance=0.0,
    ),
}
