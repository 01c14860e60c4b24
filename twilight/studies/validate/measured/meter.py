"""The zenith as a Sky Quality Meter sees it: twilight and moonlit nights at one dark site, in the meter's own band.

The meter looks up with a field of view of 20 deg (full width at half maximum, about Gaussian).  Its magnitudes are of
its own band (`twilight.sky.quantities`: SQM), of which V is 0.1 to 0.2 mag fainter in twilight; its zero is known to
0.1 mag.  The site's night, measured by the same meter, is added to what is computed.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from twilight.config.scene import Config, Wavelengths
from twilight.sky.moon import Moon
from twilight.sky.quantities.measure import Spectra
from twilight.studies.validate.measured import references

FIELD_DEG = 20.0
"""Full width at half maximum of the meter's field of view."""
WAVELENGTHS_NM = (
    *(380.0, 400.0, 424.0, 460.0, 490.0, 520.0, 545.0, 560.0),
    *(590.0, 603.0, 620.0, 650.0, 675.0, 750.0, 780.0, 860.0),
)
"""Where the radiance is computed: all of the meter's band, between the bands of the gases."""
RINGS = 3
"""Rings of directions that stand for the field of view."""


@dataclass(frozen=True)
class MoonlitPoint:
    """The zenith under a moon [mag arcsec^-2, the meter's band]: phase angle and elevation [deg] are bins' middles."""

    climate: str
    phase_angle_deg: float
    moon_elevation_deg: float
    readings: int
    computed_mag: float
    measured_mag: float


def site_of(config: Config) -> Config:
    """The configuration at the meter's wavelengths, with the ozone that its site has in the mean; a tabulated medium
    keeps its own ozone."""
    climate = config.climate
    config = config.model_copy(update={"wavelengths": Wavelengths(list_nm=WAVELENGTHS_NM)})
    if climate.medium is not None:
        return config
    ozone = climate.gases.ozone.model_copy(update={"column_du": references.METER_OZONE_DU, "day_of_year": None})
    gases = climate.gases.model_copy(update={"ozone": ozone})
    return config.model_copy(update={"climate": climate.model_copy(update={"gases": gases})})


def field_of_view() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Directions (elevation, azimuth) [deg] about the zenith and weights (D,) that sum to 1: a Gaussian of FIELD_DEG.

    Gauss-Laguerre in r^2 / (2 sigma^2), and half a turn of azimuths, of which the other half is the mirror image.
    """
    x, w = np.polynomial.laguerre.laggauss(RINGS)
    sigma = FIELD_DEG / (2.0 * np.sqrt(2.0 * np.log(2.0)))
    azimuth, turn = np.array([0.0, 60.0, 120.0, 180.0]), np.array([1.0, 2.0, 2.0, 1.0]) / 6.0
    grid = np.meshgrid(90.0 - sigma * np.sqrt(2.0 * x), azimuth, indexing="ij")
    return grid[0].ravel(), grid[1].ravel(), np.outer(w, turn).ravel()


class SkyQualityMeter:
    """The meter in the light of a `Photometer`: brightness of the zenith for any sun or moon."""

    def __init__(self, light: Any, floor_mag: float | None):
        """light: a `Photometer` at the site; floor_mag: of the night [mag arcsec^-2], None: without it."""
        self._light, self._floor = light, 0.0 if floor_mag is None else 10.0 ** (-0.4 * floor_mag)
        self._altitude_km = max(references.METER_SITE.altitude_km, light.medium.bottom_km)

    def _factor(self, source_deg: float) -> np.ndarray:
        elevation, azimuth, weight = field_of_view()
        light = self._light.solved.radiance(source_deg, elevation, azimuth, observer_altitude_km=self._altitude_km)
        return np.asarray(weight @ light)

    def _magnitude(self, factor: np.ndarray) -> float:
        """Magnitude of a factor (W,) over the sun's light, the night added [mag arcsec^-2]."""
        spectra = Spectra(factor, self._light.medium.wavelength_nm, self._light.config.solar_spectrum)
        return float(-2.5 * np.log10(10.0 ** (-0.4 * float(spectra.magnitude("SQM"))) + self._floor))

    def twilight_mag(self, sun_elevation_deg: float) -> float:
        """Brightness of the zenith under the sun and the night [mag arcsec^-2]."""
        return self._magnitude(self._factor(sun_elevation_deg))

    def moonlit_mag(self, moon: Moon) -> float:
        """Brightness of the zenith under the moon and the night, sun far below the horizon [mag arcsec^-2]."""
        nm = self._light.medium.wavelength_nm
        return self._magnitude(self._factor(moon.elevation_deg) * moon.irradiance_factor(nm))

    def moonlit(self, climate: str) -> Iterator[MoonlitPoint]:
        """Every bin of moonlit readings."""
        for phase_deg, elevation_deg, readings, measured in references.meter_moonlit():
            computed = self.moonlit_mag(Moon(elevation_deg, 0.0, phase_deg))
            yield MoonlitPoint(climate, phase_deg, elevation_deg, readings, computed, measured)
