"""What a user can set of the tables solver."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from twilight.errors import TwilightError


@dataclass(frozen=True)
class TablesSettings:
    """Sizes and mappings of the tables, and how they are filled and kept.

    mapping: from (r, mu, mu_s, nu) to texels: bruneton2008 (sec. 4 of the paper; it ends with the sun at -11.5 deg) or
        bruneton2017 (of his later code; it ends at lowest_sun_deg)
    lowest_sun_deg: of the mapping bruneton2017; below it tables hold their last texel
    scattering_r, scattering_mu, scattering_mu_s, scattering_nu: texels of S
    scattering_angles: texels of nu: cosines, even in nu, as his mappings have them; or half_sines, even in the sine
        of half the scattering angle, close together towards the sun, where aerosol scatters most
    transmittance_r, transmittance_mu: texels of T
    irradiance_r, irradiance_mu_s: texels of E (both mapped as in the 2017 code; the paper gives sizes alone)
    interpolation: between texels of S: linear, as on a graphics card, or logarithmic (what was scattered once, which is
        zero in the shadow, is linear)
    aerosol_packing: separate keeps light that aerosol scattered once at every wavelength; proportional keeps it at the
        longest one and takes the others from the rest in proportion (sec. 4); this needs a single aerosol phase
        function
    storage: of the texels of S and E: float32, or float16
    storage_scale: factor on the texels before they become float16
    max_events: most scattering events of a path of light (5 orders in the paper)
    degree: of the Legendre series of the phase functions in the integral over incident light (delta-scaled beyond)
    polar_directions, azimuth_directions: of that integral, per hemisphere and over half a turn
    step_density: of the points along the rays
    """

    mapping: Literal["bruneton2008", "bruneton2017"] = "bruneton2008"
    lowest_sun_deg: float = -30.0
    scattering_r: int = 32
    scattering_mu: int = 128
    scattering_mu_s: int = 32
    scattering_nu: int = 8
    scattering_angles: Literal["cosines", "half_sines"] = "cosines"
    transmittance_r: int = 64
    transmittance_mu: int = 256
    irradiance_r: int = 16
    irradiance_mu_s: int = 64
    interpolation: Literal["linear", "logarithmic"] = "linear"
    aerosol_packing: Literal["separate", "proportional"] = "separate"
    storage: Literal["float32", "float16"] = "float32"
    storage_scale: float = 1.0
    max_events: int = 5
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
            "transmittance_r": (4, 1024),
            "transmittance_mu": (8, 4096),
            "irradiance_r": (2, 256),
            "irradiance_mu_s": (4, 4096),
            "storage_scale": (1e-6, 1e9),
            "max_events": (1, 100),
            "degree": (2, 32),
            "polar_directions": (2, 64),
            "azimuth_directions": (3, 128),
            "step_density": (0.2, 10.0),
        }
        for key, (low, high) in ranges.items():
            value = getattr(self, key)
            if not low <= value <= high:
                raise TwilightError(f"solver.{key} is {value}; allowed is {low} to {high}")
        if self.scattering_mu % 2:
            raise TwilightError(f"solver.scattering_mu is {self.scattering_mu}; it must be even: half looks down")
        if self.storage == "float32" and self.storage_scale != 1.0:
            raise TwilightError(f"solver.storage_scale is {self.storage_scale:g}; float32 takes only 1")
        if self.degree >= self.azimuth_directions:
            raise TwilightError(
                f"solver.degree is {self.degree}; azimuth_directions, {self.azimuth_directions}, is more"
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
        max_events=8,
    ),
}
"""`standard` is the paper's own: 32 x 128 x 32 x 8 texels, five events; `fine` has as many texels where they matter."""
