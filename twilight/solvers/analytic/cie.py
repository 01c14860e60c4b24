"""The standard general skies of the CIE as a solver: 15 luminance distributions (ISO 15469:2004) and the traditional
overcast sky, each in one colour.

A standard sky is relative to its zenith.  The zenith luminance is set, or follows the sun: for skies without direct sun
(1 to 6 and 16) so that the horizontal illuminance is that of Krochmann and Seidl 1974, for
the others it is Preetham's for the turbidity of the medium.  The former have the colour of daylight of
6500 K, the latter that of Preetham's zenith.
"""

from __future__ import annotations

from typing import Literal

import numpy as np

from twilight.atmosphere.medium import Medium
from twilight.base.errors import TwilightError
from twilight.base.progress import Progress, silent
from twilight.base.sections import option, settings
from twilight.solvers.analytic import coefficients, daylight
from twilight.solvers.base import ALL_WAVELENGTHS, BareField, Capabilities

CAPABILITIES = Capabilities(kind="formula", wavelengths_at_once=ALL_WAVELENGTHS)
"""All wavelengths are done at once: the turbidity is read from the medium at 550 nm."""

TRADITIONAL_OVERCAST = 16
"""Type of the traditional overcast sky."""

WITHOUT_SUN = (*range(1, 7), TRADITIONAL_OVERCAST)
"""Types whose sky has no direct sun."""

OVERCAST_TEMPERATURE_K = 6500.0
"""Colour temperature of overcast skies [K]."""


@settings
class CieSettings:
    """Which standard sky, and how bright."""

    sky_type: int = option(
        "1 to 15 of ISO 15469 (1 and 5 overcast, 7 to 10 partly cloudy, 11 to 15 clear; 12 is the clear sky that "
        "Preetham 1999 quotes as eq. 1), or 16, the traditional overcast sky",
        default=12,
        ge=1,
        le=16,
    )
    zenith_luminance_cd_per_m2: float | None = option(
        "null: by the sun and, for types 7 to 15, the turbidity", default=None, ge=1e-6, le=1e6
    )
    turbidity: float | None = option(
        "at 550 nm, for types 7 to 15; null: that of the medium", default=None, ge=1.0, le=100.0
    )
    outside: Literal["nearest", "refuse"] = option(
        "for types 7 to 15, 'nearest' takes the nearest turbidity that Preetham's coefficients cover where the "
        "medium's is not, and warns; 'refuse' does not",
        default="nearest",
    )

    def __post_init__(self):
        if self.turbidity is not None and self.sky_type in WITHOUT_SUN:
            raise TwilightError(f"solver.turbidity does nothing for sky_type {self.sky_type}: leave it out")


QUALITIES: dict[str, CieSettings] = {"standard": CieSettings()}


def prepare(
    medium: Medium,
    settings: CieSettings | None = None,
    *,
    observer_altitude_km: float = 0.0,
    progress: Progress | None = None,
) -> CieField:
    """The standard sky above this medium's ground; nothing is computed yet.

    Raises TwilightError for an observer high above the ground, wavelengths outside 300 to 830 nm, and a turbidity that
    is needed and not covered.
    """
    return CieField(medium, settings or QUALITIES["standard"], observer_altitude_km, progress)


class CieField(BareField):
    """One standard sky for any sun above the horizon.

    turbidity: the one in use, None where the sky does not need one.
    """

    def __init__(self, medium: Medium, settings: CieSettings, altitude_km: float, progress: Progress | None):
        daylight.check_observer(medium, altitude_km, "cie")
        self.medium, self.settings = medium, settings
        self.clear = settings.sky_type not in WITHOUT_SUN
        self.turbidity: float | None = None
        self._zenith = coefficients.load_coefficients("preetham1999")
        if self.clear:
            self.turbidity, _ = daylight.chosen_turbidity(
                settings.turbidity, settings.outside, self._zenith.turbidity, medium, "cie"
            )
        self._bins = daylight.SpectralBins(medium.wavelength_nm, "cie")
        self._progress = progress or silent

    def radiance(self, sun_elevation_deg: float, elevation_deg, azimuth_deg) -> np.ndarray:
        """Sun-normalised radiance [sr^-1], shape of the directions plus (W,); angles in degrees, azimuth from the sun.

        Errors: TwilightError for a sun below the horizon.
        """
        daylight.check_sun(sun_elevation_deg, "cie")
        spectral = self._spectrum(sun_elevation_deg)

        def sky(elevation_deg: np.ndarray, azimuth_deg: np.ndarray) -> np.ndarray:
            return self.luminance(sun_elevation_deg, elevation_deg, azimuth_deg)[:, None] * spectral

        def sunlight() -> np.ndarray:
            if self.turbidity is None:
                return np.zeros_like(spectral)
            return daylight.direct_transmittance(self.medium.wavelength_nm, 90.0 - sun_elevation_deg, self.turbidity)

        albedo = self.medium.ground_albedo
        out = daylight.sky_and_ground(sky, sunlight, sun_elevation_deg, albedo, elevation_deg, azimuth_deg)
        self._progress("sky", 1.0)
        return out

    def luminance(self, sun_elevation_deg: float, elevation_deg, azimuth_deg) -> np.ndarray:
        """Luminance [cd m^-2] of directions at or above the horizon."""
        relative = self.relative_luminance(sun_elevation_deg, elevation_deg, azimuth_deg)
        return self.zenith_luminance(sun_elevation_deg) * relative

    def relative_luminance(self, sun_elevation_deg: float, elevation_deg, azimuth_deg) -> np.ndarray:
        """Luminance over that of the zenith."""
        cosine, gamma = coefficients.angles(sun_elevation_deg, elevation_deg, azimuth_deg)
        if self.settings.sky_type == TRADITIONAL_OVERCAST:
            return coefficients.traditional_overcast(cosine)
        parameters = daylight.table("cie_standard_skies")[1][self.settings.sky_type - 1, 1:]
        zenith = coefficients.cie(parameters, 1.0, np.radians(90.0 - sun_elevation_deg))
        return coefficients.cie(parameters, cosine, gamma) / zenith

    def zenith_luminance(self, sun_elevation_deg: float) -> float:
        """Luminance of the zenith [cd m^-2]."""
        if self.settings.zenith_luminance_cd_per_m2 is not None:
            return self.settings.zenith_luminance_cd_per_m2
        if self.clear:
            assert self.turbidity is not None
            return float(self._zenith.zenith_luminance_cd_per_m2(90.0 - sun_elevation_deg, self.turbidity))
        e, a, solid = daylight.hemisphere(24, 24)
        relative = self.relative_luminance(sun_elevation_deg, e, a)
        illuminance = coefficients.overcast_illuminance_lx(sun_elevation_deg)
        return float(illuminance / np.sum(solid * np.sin(np.radians(e)) * relative))

    def _spectrum(self, sun_elevation_deg: float) -> np.ndarray:
        """Sun-normalised radiance per luminance, (W,) [sr^-1 per cd m^-2]."""
        if self.clear:
            assert self.turbidity is not None
            x, y = map(float, self._zenith.zenith_chromaticity(90.0 - sun_elevation_deg, self.turbidity))
        else:
            x, y = daylight.daylight_chromaticity(OVERCAST_TEMPERATURE_K)
        return self._bins.from_chromaticity(1.0, x, y)
