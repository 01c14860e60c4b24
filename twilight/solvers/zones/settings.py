"""What a user can set of the zones solver."""

from typing import Literal

from twilight.base.errors import TwilightError
from twilight.base.sections import option, option_name, settings


@settings
class ZonesSettings:
    """Nodes, directions and harmonics of the field, and what physics it keeps."""

    polarisation: bool = option(
        "follow the linear polarisation of light (I, Q, U) through all orders; without it radiance is that of "
        "scalar theory, which in clear air is wrong by several per cent",
        default=True,
    )
    refraction: bool = option("bend and spread the sunbeam", default=True)
    bent_lines_of_sight: bool = option("bend lines of sight too: view directions are then apparent ones", default=True)
    max_orders: int = option(
        "most orders of scattering that are followed; 1 is single scattering. Above 30, and with a tolerance, thick"
        " air of conservative scattering is solved for all orders at once, in tens of steps, to 1e-3 or to the "
        "tolerance where that is less",
        default=200,
        ge=1,
        le=1000,
    )
    target_error: float = option(
        "take the cheapest quality that is within this fraction at 95 % of the directions in air of this kind, for "
        "the lowest of the suns; 0 takes the quality asked for",
        default=0.0,
        ge=0.0,
        le=1.0,
    )
    field_file: str = option(
        "HDF5 file that the field is read from where it holds this very field, and written to otherwise", default=""
    )
    degree: int = option(
        "of the Legendre series that phase functions are followed to (delta-scaled beyond)",
        default=16,
        ge=2,
        le=48,
        expert=True,
    )
    max_degree: int = option(
        "largest degree, to which it grows beside coarse particles, and polar_directions with it; not in clouds",
        default=24,
        ge=2,
        le=48,
        expert=True,
    )
    polar_directions: int = option("directions per hemisphere", default=14, ge=2, le=48, expert=True)
    azimuth_directions: int = option(
        "directions over half a turn, more beside coarse particles; orders of the series in azimuth are fewer than "
        "these",
        default=9,
        ge=3,
        le=96,
        expert=True,
    )
    early_orders: int = option(
        "orders of scattering that are followed with degree, polar_directions and azimuth_directions; the light of "
        "later orders is smooth",
        default=2,
        ge=1,
        le=1000,
        expert=True,
    )
    late_degree: int = option(
        "degree for the orders after early_orders; it grows beside coarse particles",
        default=7,
        ge=2,
        le=32,
        expert=True,
    )
    late_polar_directions: int = option(
        "polar_directions for the orders after early_orders; more beside coarse particles",
        default=7,
        ge=2,
        le=48,
        expert=True,
    )
    late_azimuth_directions: int = option(
        "azimuth_directions for the orders after early_orders; more beside coarse particles",
        default=5,
        ge=3,
        le=96,
        expert=True,
    )
    altitude_density: float = option(
        "of the nodes in altitude",
        default=0.7,
        ge=0.2,
        le=10.0,
        expert=True,
    )
    zenith_density: float = option(
        "of the nodes in solar zenith angle; with 0.3 the sky of a sun at -6 deg is off by up to 13 %",
        default=1.0,
        ge=0.3,
        le=10.0,
        expert=True,
    )
    step_density: float = option(
        "of the points along the rays between nodes", default=0.4, ge=0.3, le=10.0, expert=True
    )
    first_order_step_density: float = option(
        "the same for light scattered once: sunlight ends suddenly at the shadow of the Earth and its haze",
        default=1.2,
        ge=0.3,
        le=10.0,
        expert=True,
    )
    line_of_sight_density: float = option(
        "of the points along lines of sight", default=1.0, ge=0.3, le=10.0, expert=True
    )
    beam_density: float = option("of the nodes of the sunbeam's tables", default=0.5, ge=0.3, le=4.0, expert=True)
    tolerance: float = option(
        "stop earlier when one more order changes the sum, with a geometric series for the rest, by less than this "
        "fraction at every node; 0 follows max_orders and adds no rest",
        default=1e-2,
        ge=0.0,
        le=0.5,
        expert=True,
    )
    polarisation_degree: int = option(
        "of the spin-2 harmonics of Q and U in the early orders; 2 is exact in air without aerosol",
        default=6,
        ge=2,
        le=32,
        expert=True,
    )
    late_polarisation_degree: int = option(
        "of the spin-2 harmonics of Q and U in the late orders",
        default=3,
        ge=2,
        le=32,
        expert=True,
    )
    bent_paths: bool = option("bend the paths of light between two scatterings too", default=True, expert=True)
    spectrum: Literal["auto", "solved"] = option(
        "auto: where that saves blocks of eight wavelengths, or terms of bands of gases, some are solved and the "
        "fitted model of clear air carries their light to the others; what that adds is measured. solved: all are",
        default="auto",
        expert=True,
    )

    def __post_init__(self):
        of_polarisation = (
            ("polarisation_degree", "degree"),
            ("late_polarisation_degree", "late_degree"),
            ("late_polarisation_degree", "polarisation_degree"),
        )
        of_late_orders = (("late_degree", "degree"), ("late_azimuth_directions", "azimuth_directions"))
        for key, most in (*(of_polarisation if self.polarisation else ()), *of_late_orders):
            value, limit = getattr(self, key), getattr(self, most)
            if value > limit:
                raise TwilightError(f"{option_name(self, key)} is {value}; allowed is up to {most}, {limit}")


QUALITIES: dict[str, ZonesSettings] = {
    "draft": ZonesSettings(
        degree=12,
        max_degree=20,
        azimuth_directions=7,
        altitude_density=0.5,
        zenith_density=0.7,
        first_order_step_density=1.0,
        line_of_sight_density=0.7,
        beam_density=0.35,
        polarisation_degree=4,
        late_polarisation_degree=2,
    ),
    "standard": ZonesSettings(),
    "reference": ZonesSettings(
        degree=24,
        max_degree=36,
        polar_directions=20,
        azimuth_directions=13,
        early_orders=3,
        late_degree=9,
        late_polar_directions=10,
        late_azimuth_directions=9,
        altitude_density=1.3,
        zenith_density=1.4,
        step_density=0.8,
        first_order_step_density=2.5,
        line_of_sight_density=2.0,
        beam_density=1.0,
        tolerance=1e-3,
        polarisation_degree=10,
        late_polarisation_degree=6,
    ),
}
"""Points on the frontier of error against run time (docs/accuracy.md), measured by `benchmarks/zones_error.py`."""
