"""What a user can set of the cells solver."""

from typing import Literal

from twilight.base.errors import TwilightError
from twilight.base.sections import option, settings


@settings
class CellsSettings:
    """Haber's cells, and what goes beyond them."""

    multiple_scattering: Literal["exact", "isotropic", "none"] = option(
        "'exact' follows the phase functions at every order, on points around the observer; 'isotropic' is Haber's "
        "system on his cells; 'none' is single scattering along exact lines of sight",
        default="exact",
    )
    max_orders: int = option("most orders of scattering that are followed", default=60, ge=1, le=100)
    refraction: bool = option("bend the sunbeam (exact: and spread it)", default=True)
    azimuth_cells: int = option(
        "S, the number of cells around a ring; their angular size is 360/S deg in azimuth and elevation",
        default=60,
        ge=8,
        le=360,
    )
    active_shell_step: int = option("every n-th shell takes part in multiple scattering", default=4, ge=1, le=16)
    inner_radius_km: float = option("R_min, radius of the innermost shell", default=0.1, ge=0.001, le=10.0, expert=True)
    sun_tolerance_deg: float = option(
        "of the binary search for the refracted path to the sun", default=0.1, ge=1e-4, le=0.5, expert=True
    )
    reduce_extinction: bool = option(
        "in light scattered twice or more take g of the aerosol's scattering from its extinction too, so that none "
        "is lost; Haber takes it from scattering alone",
        default=False,
        expert=True,
    )
    tolerance: float = option(
        "stop earlier when what is missing is known to this fraction of the light at every point (exact: a "
        "geometric series is added for it) or an order adds less than this fraction (isotropic); 0 follows "
        "max_orders",
        default=1e-3,
        ge=0.0,
        le=0.5,
        expert=True,
    )
    degree: int = option(
        "of the Legendre series that phase functions are followed to (delta-scaled beyond)",
        default=6,
        ge=2,
        le=32,
        expert=True,
    )
    polar_directions: int = option("directions per hemisphere", default=6, ge=2, le=32, expert=True)
    azimuth_directions: int = option("directions around", default=14, ge=4, le=96, expert=True)
    azimuth_nodes: int = option(
        "azimuths of the points, a multiple of azimuth_directions", default=28, ge=4, le=192, expert=True
    )
    node_density: float = option(
        "of the points in altitude and radius, 1 is standard", default=0.8, ge=0.3, le=5.0, expert=True
    )

    def __post_init__(self):
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
