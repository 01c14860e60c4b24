"""What a user can set of the zones solver."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Literal

from twilight.base.errors import TwilightError


@dataclass(frozen=True)
class ZonesSettings:
    """Nodes, directions and harmonics of the field, and what physics it keeps.

    degree: of the Legendre series that phase functions are followed to (delta-scaled beyond)
    max_degree: largest degree, to which it grows beside coarse particles, and polar_directions with it; not in clouds
    polar_directions: directions per hemisphere
    azimuth_directions: directions over half a turn, more beside coarse particles; orders of the series in azimuth are
        fewer than these
    early_orders: orders of scattering that are followed with degree, polar_directions and azimuth_directions; the light
        of later orders is smooth
    late_degree, late_polar_directions, late_azimuth_directions: the same for the orders after early_orders; all three
        are more beside coarse particles
    altitude_density, zenith_density: of the nodes in altitude and solar zenith angle; with zenith_density 0.3 the sky
        of a sun at -6 deg is off by up to 13 %
    step_density: of the points along the rays between nodes
    first_order_step_density: the same for light scattered once: sunlight ends suddenly at the shadow of the Earth and
        its haze
    line_of_sight_density: of the points along lines of sight
    beam_density: of the nodes of the sunbeam's tables
    max_orders: most orders of scattering that are followed; 1 is single scattering.  Above 30, and with a tolerance,
        thick air of conservative scattering is solved for all orders at once, in tens of steps, to 1e-3 or to the
        tolerance where that is less
    tolerance: stop earlier when one more order changes the sum, with a geometric series for the rest, by less than this
        fraction at every node; 0 follows max_orders and adds no rest
    polarisation: follow the linear polarisation of light (I, Q, U) through all orders; without it radiance is that of
        scalar theory, which in clear air is wrong by several per cent
    polarisation_degree, late_polarisation_degree: of the spin-2 harmonics of Q and U in the early and the late orders;
        2 is exact in air without aerosol
    refraction: bend and spread the sunbeam
    bent_lines_of_sight: bend lines of sight too: view directions are then apparent ones
    bent_paths: bend the paths of light between two scatterings too
    target_error: take the cheapest quality that is within this fraction at 95 % of the directions in air of this kind,
        for the lowest of the suns; 0 takes the quality asked for
    spectral_interpolation: auto: where that saves a quarter of the blocks of eight wavelengths, or terms of bands of
        gases, light scattered more than once is solved at some and interpolated to the others; light scattered once and
        the sun's own are computed at each.  off: all is solved at each
    field_file: HDF5 file that the field is read from where it holds this very field, and written to otherwise
    """

    COMMON: ClassVar[tuple[str, ...]] = (
        "polarisation",
        "refraction",
        "bent_lines_of_sight",
        "max_orders",
        "target_error",
        "field_file",
    )
    """Options that are shown first."""

    degree: int = 16
    max_degree: int = 24
    polar_directions: int = 14
    azimuth_directions: int = 9
    early_orders: int = 2
    late_degree: int = 7
    late_polar_directions: int = 7
    late_azimuth_directions: int = 7
    altitude_density: float = 0.7
    zenith_density: float = 1.0
    step_density: float = 0.4
    first_order_step_density: float = 1.2
    line_of_sight_density: float = 1.0
    beam_density: float = 0.5
    max_orders: int = 200
    tolerance: float = 5e-3
    polarisation: bool = True
    polarisation_degree: int = 6
    late_polarisation_degree: int = 3
    refraction: bool = True
    bent_lines_of_sight: bool = True
    bent_paths: bool = True
    target_error: float = 0.0
    spectral_interpolation: Literal["auto", "off"] = "auto"
    field_file: str = ""

    def __post_init__(self):
        ranges = {
            "degree": (2, 48),
            "max_degree": (2, 48),
            "polar_directions": (2, 48),
            "azimuth_directions": (3, 96),
            "early_orders": (1, 1000),
            "late_degree": (2, 32),
            "late_polar_directions": (2, 48),
            "late_azimuth_directions": (3, 96),
            "polarisation_degree": (2, 32),
            "late_polarisation_degree": (2, 32),
            "altitude_density": (0.2, 10.0),
            "zenith_density": (0.3, 10.0),
            "step_density": (0.3, 10.0),
            "first_order_step_density": (0.3, 10.0),
            "line_of_sight_density": (0.3, 10.0),
            "beam_density": (0.3, 4.0),
            "max_orders": (1, 1000),
            "tolerance": (0.0, 0.5),
            "target_error": (0.0, 1.0),
        }
        for key, (low, high) in ranges.items():
            value = getattr(self, key)
            if not low <= value <= high:
                raise TwilightError(f"solver.{key} is {value}; allowed is {low} to {high}")
        of_polarisation = (
            ("polarisation_degree", "degree"),
            ("late_polarisation_degree", "late_degree"),
            ("late_polarisation_degree", "polarisation_degree"),
        )
        of_late_orders = (("late_degree", "degree"), ("late_azimuth_directions", "azimuth_directions"))
        for key, most in (*(of_polarisation if self.polarisation else ()), *of_late_orders):
            value, limit = getattr(self, key), getattr(self, most)
            if value > limit:
                raise TwilightError(f"solver.{key} is {value}; allowed is up to {most}, {limit}")


QUALITIES: dict[str, ZonesSettings] = {
    "draft": ZonesSettings(
        degree=12,
        max_degree=20,
        azimuth_directions=7,
        late_degree=7,
        altitude_density=0.5,
        zenith_density=0.7,
        first_order_step_density=1.0,
        line_of_sight_density=0.7,
        beam_density=0.35,
        tolerance=1e-2,
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
