"""What a user can set of the tables solver."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar, Literal

from twilight.atmosphere.medium import Medium
from twilight.base.errors import TwilightError
from twilight.solvers.base import Cost, check_ranges


@dataclass(frozen=True)
class TablesSettings:
    """Sizes and mapping of the tables, and how they are filled.

    mapping: from (r, mu, mu_s, nu) to texels: bruneton2008 (sec. 4 of the paper; it ends with the sun at -11.5 deg) or
        bruneton2017 (of his later code; it ends at lowest_sun_deg)
    lowest_sun_deg: of the mapping bruneton2017; below it tables hold their last texel
    scattering_r, scattering_mu, scattering_mu_s, scattering_nu: texels of S
    scattering_angles: texels of nu: cosines, even in nu, as his mappings have them; or half_sines, even in the sine
        of half the scattering angle, close together towards the sun, where aerosol scatters most
    interpolation: between texels of S: linear, as on a graphics card, or logarithmic (what was scattered once, which is
        zero in the shadow, is linear)
    max_orders: orders of scattering (5 in the paper)
    degree: of the Legendre series of the phase functions in the integral over incident light (delta-scaled beyond)
    polar_directions, azimuth_directions: of that integral, per hemisphere and over half a turn
    step_density: of the points along the rays
    """

    COMMON: ClassVar[tuple[str, ...]] = (
        "mapping", "lowest_sun_deg", "scattering_mu_s", "scattering_nu", "interpolation", "max_orders",
    )  # fmt: skip

    mapping: Literal["bruneton2008", "bruneton2017"] = "bruneton2008"
    lowest_sun_deg: float = -30.0
    scattering_r: int = 32
    scattering_mu: int = 128
    scattering_mu_s: int = 32
    scattering_nu: int = 8
    scattering_angles: Literal["cosines", "half_sines"] = "cosines"
    interpolation: Literal["linear", "logarithmic"] = "linear"
    max_orders: int = 5
    degree: int = 12
    polar_directions: int = 12
    azimuth_directions: int = 16
    step_density: float = 1.0

    def __post_init__(self):
        ranges = {
            "lowest_sun_deg": (-89.0, -1.0),
            "scattering_r": (4, 256),
            "scattering_mu": (8, 1024),
            "scattering_mu_s": (4, 1024),
            "scattering_nu": (2, 256),
            "max_orders": (1, 100),
            "degree": (2, 32),
            "polar_directions": (2, 64),
            "azimuth_directions": (3, 128),
            "step_density": (0.2, 10.0),
        }
        check_ranges(self, ranges)
        if self.scattering_mu % 2:
            raise TwilightError(
                f"solver.expert.scattering_mu is {self.scattering_mu}; it must be even: half looks down"
            )
        if self.degree >= self.azimuth_directions:
            raise TwilightError(
                f"solver.expert.degree is {self.degree}; azimuth_directions, {self.azimuth_directions}, is more"
            )


QUALITIES: dict[str, TablesSettings] = {
    "standard": TablesSettings(),
    "bruneton2008": TablesSettings(),
    "bruneton2017": TablesSettings(mapping="bruneton2017"),
    "fine": TablesSettings(
        mapping="bruneton2017",
        lowest_sun_deg=-24.0,
        scattering_angles="half_sines",
        interpolation="logarithmic",
        max_orders=8,
    ),
}
"""`standard` is the paper's own: 32 x 128 x 32 x 8 texels, five orders; `fine` has as many texels where they matter."""


TEXEL_DIRECTION_S = 9.6e-9
"""Processor seconds of a texel of S, an incident direction, a wavelength and an order after the first: `standard` and
`fine`, within 15 % (`benchmarks/compare.csv`)."""
TEXEL_BYTES = 68.0
"""Bytes of a texel and wavelength while tables are filled (ibid.)."""
DIRECTION_S = 3e-7
"""Processor seconds of a direction and wavelength (ibid.)."""


def cost(
    medium: Medium, settings: TablesSettings, sun_elevations_deg: Sequence[float] | None, observer_altitude_km: float
) -> Cost:
    """Cost of a field, from the sizes of its tables."""
    texels = settings.scattering_r * settings.scattering_mu * settings.scattering_mu_s * settings.scattering_nu
    incident = settings.polar_directions * settings.azimuth_directions
    return Cost(
        fixed_bytes=0.0,
        bytes_per_wavelength=TEXEL_BYTES * texels,
        cpu_s_per_wavelength=TEXEL_DIRECTION_S * texels * incident * (settings.max_orders - 1),
        cpu_s_per_direction=DIRECTION_S,
    )
