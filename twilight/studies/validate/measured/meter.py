"""The zenith as a Sky Quality Meter sees it: twilight and moonlit nights at one dark site, in the meter's own band.

The meter looks up with a field of view of 20 deg (full width at half maximum, about Gaussian).  Its magnitudes are of
its own band (`twilight.sky.quantities`: SQM), of which V is 0.1 to 0.2 mag fainter in twilight; its zero is known to
0.1 mag.  The site's night, measured by the same meter, is added to what is computed.
"""

import csv
from collections.abc import Iterator
from dataclasses import dataclass
from datetime import UTC, datetime
from functools import lru_cache
from importlib import resources
from typing import Any

import numpy as np

from twilight.base.errors import TwilightError
from twilight.config.scene import Config, Wavelengths
from twilight.sky.moon import Moon
from twilight.sky.quantities.measure import Spectra


@dataclass(frozen=True)
class Site:
    """Where zenith luminance was measured; ``evening``: midday UTC before a typical evening of the campaign."""

    name: str
    altitude_km: float
    latitude_deg: float
    longitude_deg: float
    evening: datetime
    transmission: tuple[float, float]


KOOMEN_SITES = (
    Site("Maryland", 0.03, 38.8, -77.0, datetime(1951, 2, 15, 17, tzinfo=UTC), (0.75, 0.85)),
    Site("Sacramento Peak", 2.8, 32.79, -105.82, datetime(1951, 6, 1, 19, tzinfo=UTC), (0.85, 0.90)),
)
"""Koomen et al. 1952; the middle of each campaign, and the stated range of the vertical photopic transmission."""
ILLUMINANCE_SOURCE = "Janiczek and DeYoung 1987"
LUMINANCE_SOURCE = "Koomen et al. 1952"


@lru_cache(maxsize=8)
def _rows(name: str) -> list[dict[str, str]]:
    text = resources.files("twilight").joinpath(f"data/references/{name}").read_text(encoding="utf-8")
    return list(csv.DictReader(line for line in text.splitlines() if not line.startswith("#")))


def horizontal_illuminance_lux(sun_elevation_deg) -> np.ndarray:
    """Illuminance of the ground by sun and clear sky [lx], Janiczek and DeYoung 1987, for -18 to 90 deg, any shape.

    Where two pieces meet the upper one holds.  Raises TwilightError outside the range.
    """
    h = np.asarray(sun_elevation_deg, dtype=float)
    pieces = [{k: float(v) for k, v in row.items()} for row in _rows("janiczek_deyoung1987.csv")]
    if not (np.all(h >= -18.0) and np.all(h <= 90.0)):
        raise TwilightError(f"{ILLUMINANCE_SOURCE}: sun elevation must be from -18 to 90 deg")
    out = np.full(h.shape, np.nan)
    for piece in reversed(pieces):  # from the lowest up
        log = np.polynomial.polynomial.polyval(h / 90.0, [piece[f"l{power}"] for power in range(4)])
        out = np.where(h >= piece["altitude_min_deg"], log, out)
    return 10.0**out


def zenith_luminance_cd_m2(site: str) -> tuple[np.ndarray, np.ndarray]:
    """Sun elevations [deg] and measured zenith luminance [cd m^-2] of a site of Koomen et al. 1952."""
    rows = [row for row in _rows("koomen1952_zenith_luminance.csv") if row["site"] == site]
    if not rows:
        raise TwilightError(f"site: '{site}' is not known, choose from {', '.join(s.name for s in KOOMEN_SITES)}")
    return tuple(np.array([float(row[k]) for row in rows]) for k in ("sun_elevation_deg", "luminance_cd_m2"))  # type: ignore[return-value]


SPECTRA_SOURCE = "Spitschan et al. 2016"
METER_SOURCE = "Dark Sky Network, 2018 to 2025"
METER_SITE = Site("Cosmic Campground", 1.634, 33.480, -108.923, datetime(2021, 6, 10, 19, tzinfo=UTC), (0.0, 1.0))
"""A Sky Quality Meter towards the zenith, 20 deg wide; its transmission was not measured."""
METER_OZONE_DU = 285.0
"""Mean column of ozone over that site [DU]."""
METER_FLOOR_MAG = 21.92
"""Median of the clear moonless nights there, in the meter's own band [mag arcsec^-2]."""
SESSIONS = (2, 3, 4)
"""Recording sessions of the rural spectra."""


def level_ground_spectra(session: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Sun elevations (S,) [deg], wavelengths (W,) [nm], spectral irradiance of level ground (S, W) [W m^-2 nm^-1]."""
    rows = [row for row in _rows("spitschan2016_rural.csv") if int(row["session"]) == session]
    if not rows:
        raise TwilightError(f"session: {session} is not known, choose from {', '.join(map(str, SESSIONS))}")
    names = [key for key in rows[0] if key.isdigit()]
    spectra = np.array([[float(row[key]) for key in names] for row in rows])
    return np.array([float(row["sun_elevation_deg"]) for row in rows]), np.array(names, float), spectra


def meter_zenith(column: str = "clear_median") -> tuple[np.ndarray, np.ndarray]:
    """Sun elevations [deg] and brightness of the moonless zenith at METER_SITE [mag arcsec^-2, the meter's own band].

    column: clear_median, all_median, all_p25 or all_p75.
    """
    rows = _rows("dark_sky_zenith.csv")
    return np.array([float(row["sun_elevation_deg"]) for row in rows]), np.array([float(row[column]) for row in rows])


def meter_moonlit(least_readings: int = 50) -> list[tuple[float, float, int, float]]:
    """Phase angle and elevation of the moon [deg] (middles of bins), readings, their 75th percentile [mag arcsec^-2].

    Most of these readings are under clouds, which are bright: the percentile is the clearer side.
    """
    out = []
    for row in _rows("dark_sky_moonlit.csv"):
        phase, moon = (0.5 * (float(row[f"{k}_from_deg"]) + float(row[f"{k}_to_deg"])) for k in ("phase", "moon"))
        if int(row["readings"]) >= least_readings:
            out.append((phase, moon, int(row["readings"]), float(row["p75"])))
    return out


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
    ozone = climate.gases.ozone.model_copy(update={"column_du": METER_OZONE_DU, "day_of_year": None})
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
        self._altitude_km = max(METER_SITE.altitude_km, light.medium.bottom_km)

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
        for phase_deg, elevation_deg, readings, measured in meter_moonlit():
            computed = self.moonlit_mag(Moon(elevation_deg, 0.0, phase_deg))
            yield MoonlitPoint(climate, phase_deg, elevation_deg, readings, computed, measured)
