"""The sky of Preetham, Shirley and Smits 1999 as a solver: a formula in turbidity and sun position, sun above the
horizon.  From the coefficients' highest turbidity (6) to OVERCAST_TURBIDITY it goes linearly over to the CIE's overcast
sky of flat spectrum without direct sun, as the paper asks for (sec. 5, Fig. 10).

The turbidity is that of the medium (`daylight.turbidity_of`) unless it is set; everything else about the air, and
the ground's albedo, does not change the sky.  Directions below the horizon see the ground, a Lambertian reflector of
the medium's albedo under this sky and this sun.
"""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Literal

import numpy as np

from twilight.atmosphere.medium import Medium
from twilight.base.errors import TwilightError
from twilight.base.progress import Progress, silent
from twilight.base.sections import option, settings
from twilight.solvers.analytic import daylight
from twilight.solvers.analytic.aerial import aerial_perspective
from twilight.solvers.analytic.coefficients import file_sha256, load_coefficients, overcast_luminance
from twilight.solvers.base import ALL_WAVELENGTHS, BareField, Capabilities

CAPABILITIES = Capabilities(kind="formula", finite_segments=True, wavelengths_at_once=ALL_WAVELENGTHS)
"""All wavelengths are done at once: the turbidity is read from the medium at 550 nm."""

HIGHEST_TURBIDITY = 100.0
"""Highest turbidity that is allowed."""

OVERCAST_TURBIDITY = 10.0
"""Turbidity from which "we would typically expect an overcast sky" (sec. 5)."""


@settings
class PreethamSettings:
    """The turbidity of the sky, and the coefficients of its distributions."""

    turbidity: float | None = option(
        "at 550 nm; from 10 on the sky is overcast; null: that of the medium",
        default=None,
        ge=1.0,
        le=HIGHEST_TURBIDITY,
    )
    outside: Literal["nearest", "refuse"] = option(
        "'nearest' takes the nearest turbidity that the coefficients cover where the medium's is not, and warns; "
        "'refuse' does not",
        default="nearest",
    )
    coefficients: str = option(
        "'preetham1999', another set that comes with twilight, or the path of a set that `twilight fit perez` wrote",
        default="preetham1999",
    )
    coefficients_sha256: str = option(
        "of the file of coefficients, hexadecimal, where it must be that one; empty: any", default=""
    )
    ozone_cm: float = option(
        "of the direct sunlight on the ground that is seen below the horizon", default=0.35, ge=0.0, le=10.0
    )
    precipitable_water_cm: float = option(
        "of the direct sunlight on the ground that is seen below the horizon", default=2.0, ge=0.0, le=100.0
    )


QUALITIES: dict[str, PreethamSettings] = {"standard": PreethamSettings()}


def recorded(settings: PreethamSettings) -> PreethamSettings:
    """The settings for the record in files: coefficients from a file by its name and the SHA-256 of its content."""
    sha256 = file_sha256(settings.coefficients)
    if not sha256:
        return settings
    return replace(settings, coefficients=Path(settings.coefficients).name, coefficients_sha256=sha256)


def prepare(
    medium: Medium,
    settings: PreethamSettings | None = None,
    *,
    observer_altitude_km: float = 0.0,
    progress: Progress | None = None,
) -> PreethamField:
    """The sky of this medium's turbidity; nothing is computed yet.

    Raises TwilightError for an observer high above the ground, wavelengths outside 300 to 830 nm, coefficients that do
    not exist, and a turbidity that they do not cover.
    """
    return PreethamField(medium, settings or QUALITIES["standard"], observer_altitude_km, progress)


class PreethamField(BareField):
    """The sky of one turbidity for any sun above the horizon.

    turbidity: the one in use; medium_turbidity: that of the medium, None where a turbidity was set.
    """

    def __init__(self, medium: Medium, settings: PreethamSettings, altitude_km: float, progress: Progress | None):
        daylight.check_observer(medium, altitude_km, "preetham")
        self.medium, self.settings = medium, settings
        self.height_km = altitude_km - medium.bottom_km
        self.coefficients = load_coefficients(settings.coefficients)
        if settings.coefficients_sha256 and settings.coefficients_sha256 != file_sha256(settings.coefficients):
            raise TwilightError(
                f"solver.coefficients: {settings.coefficients}: is not the file that solver.coefficients_sha256 names"
            )
        low, high = self.coefficients.turbidity
        allowed = (low, HIGHEST_TURBIDITY)
        self.turbidity, self.medium_turbidity = daylight.chosen_turbidity(
            settings.turbidity, settings.outside, allowed, medium, "preetham"
        )
        self.clear_turbidity = min(self.turbidity, high)
        span = max(OVERCAST_TURBIDITY - high, 1e-9)  # coefficients of one sky cover any turbidity: never overcast
        self.overcast = float(np.clip((self.turbidity - high) / span, 0.0, 1.0))
        self._bins = daylight.SpectralBins(medium.wavelength_nm, "preetham")
        of_medium = {} if self.medium_turbidity is None else {"medium_turbidity": self.medium_turbidity}
        self.facts = {"turbidity": self.turbidity} | of_medium
        self._progress = progress or silent

    def radiance(self, sun_elevation_deg: float, elevation_deg, azimuth_deg) -> np.ndarray:
        """Sun-normalised radiance [sr^-1], shape of the directions plus (W,); angles in degrees, azimuth from the sun.

        The formula's luminance is that under the ASTM G173 solar spectrum, by which it is divided: in a scene with
        another `solar_spectrum` the sky changes with the sunlight.
        Errors: TwilightError for a sun below the horizon or outside the fit of the coefficients.
        """
        self._check(sun_elevation_deg)
        sky, sunlight = (partial(light, sun_elevation_deg) for light in (self._sky, self.sunlight))
        albedo = self.medium.ground_albedo
        out = daylight.sky_and_ground(sky, sunlight, sun_elevation_deg, albedo, elevation_deg, azimuth_deg)
        self._progress("sky", 1.0)
        return out

    def sunlight(self, sun_elevation_deg: float) -> np.ndarray:
        """The model's own direct sunlight at the ground at normal incidence over F0, (W,)."""
        self._check(sun_elevation_deg)
        return (1.0 - self.overcast) * daylight.direct_transmittance(
            self.medium.wavelength_nm,
            90.0 - sun_elevation_deg,
            self.turbidity,
            ozone_cm=self.settings.ozone_cm,
            precipitable_water_cm=self.settings.precipitable_water_cm,
        )

    def inscatter(
        self, sun_elevation_deg: float, elevation_deg, azimuth_deg, distance_km
    ) -> tuple[np.ndarray, np.ndarray]:
        """(inscattered sun-normalised radiance [sr^-1], transmittance) over a distance, directions plus (W,) each.

        An object is seen as the inscattered light plus transmittance times its own radiance (Preetham 1999 sec. 4).
        Rays must end above or on the ground: TwilightError otherwise.
        """
        self._check(sun_elevation_deg)
        return aerial_perspective(
            self.medium.wavelength_nm,
            self.turbidity,
            partial(self._sky, sun_elevation_deg),
            self.sunlight(sun_elevation_deg),
            sun_elevation_deg,
            self.height_km,
            elevation_deg,
            azimuth_deg,
            distance_km,
        )

    def _check(self, sun_elevation_deg: float) -> None:
        lowest, highest = (90.0 - z for z in reversed(self.coefficients.sun_zenith_deg))
        daylight.check_sun(sun_elevation_deg, "preetham", lowest, highest)

    def _sky(self, sun_elevation_deg: float, elevation_deg: np.ndarray, azimuth_deg: np.ndarray) -> np.ndarray:
        luminance, x, y = self.coefficients.sky(self.clear_turbidity, sun_elevation_deg, elevation_deg, azimuth_deg)
        clear = self._bins.from_chromaticity(luminance, x, y)
        if self.overcast == 0.0:
            return clear
        grey = overcast_luminance(sun_elevation_deg, np.sin(np.radians(elevation_deg)))
        flat = grey[..., None] * self._bins.of_flat_spectrum
        return (1.0 - self.overcast) * clear + self.overcast * flat
