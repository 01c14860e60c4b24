"""Computed light against photometers: illuminance of the ground, luminance of the zenith.

Measured sites differ among themselves by a factor 1.5 to 2, so level and slope are separate: the mean of log10
(computed / measured) over a range of sun elevations, and its slope [dex deg^-1].
"""

from collections.abc import Iterable
from dataclasses import dataclass, replace
from datetime import timedelta
from typing import Any

import numpy as np

from twilight import solvers
from twilight.base.conventions import TINY
from twilight.base.errors import TwilightError
from twilight.base.progress import Progress, part_of, silent
from twilight.config.scene import Config, Observer
from twilight.engine.field import solve
from twilight.numerics import spectrum
from twilight.scene import resolve
from twilight.scene.lights import levels_of
from twilight.sky.ephemeris import sun_position
from twilight.sky.night import Place, night_radiance
from twilight.studies.validate.measured import meter

WAVELENGTHS_NM = (400.0, 424.0, 460.0, 490.0, 520.0, 545.0, 560.0, 590.0, 603.0, 620.0, 650.0, 720.0)
"""Where the radiance is computed: dense where V(lambda) is large, on both sides of the O4 bands (477, 577, 630 nm)."""

SUNS_DEG = (60, 50, 40, 30, 25, 20, 15, 10, 8, 6, 5, 4, 3, 2, 1, 0, -0.8, *range(-1, -19, -1))
"""Sun elevations for illuminance [deg]."""
ZENITH_SUNS_DEG = (0, *range(-1, -19, -1))
"""Sun elevations for luminance of the zenith [deg]."""

ILLUMINANCE_RANGES_DEG = ((20, 60), (5, 20), (-0.8, 5), (-5, -0.8), (-12, -5), (-18, -12))
"""Sun elevations [deg] over which errors of the illuminance are summed up: the pieces of Janiczek and DeYoung."""
LUMINANCE_RANGES_DEG = ((-6, 0), (-12, -6), (-15, -12))
"""Sun elevations [deg] over which errors of the luminance are summed up."""
COLOUR_RANGES_DEG = ((2, 15), (-2, 2), (-6, -2), (-10, -6))
"""Sun elevations [deg] over which errors of the colour are summed up."""

BLUE_GREEN_RED_NM = (450.0, 550.0, 650.0)
"""Wavelengths whose ratios say the colour of level ground."""
COLOURS = ("blue over green", "red over green")
"""Ratios of the irradiance of level ground at 450 and at 650 nm to that at 550 nm."""
LOWEST_COLOUR_DEG = -10.0
"""Elevation of the lowest sun whose spectra are more than noise and the light of the night [deg]."""
METER_QUANTITY = "zenith, meter's band"
"""Of the Sky Quality Meter, as the luminance that such meters print."""
METER_CD_M2 = 10.8e4
"""Luminance that Sky Quality Meters print for 0 mag arcsec^-2 [cd m^-2] (Unihedron)."""

HIGH_SITE_KM = 0.5
"""A site more than this above the climate's ground [km] gets the climate with its ground at the site's altitude."""


@dataclass(frozen=True)
class PhotometricPoint:
    """One computed value: lx, cd m^-2 or a ratio by `quantity`; `night` is the night sky's part of `computed`.

    measured: NaN where there is no measurement.
    """

    climate: str
    quantity: str
    source: str
    site: str
    observer_altitude_km: float
    sun_elevation_deg: float
    computed: float
    night: float
    measured: float

    @property
    def log_ratio(self) -> float:
        """log10 of computed over measured."""
        return float(np.log10(self.computed / self.measured))


@dataclass(frozen=True)
class Level:
    """Points of one range of sun elevations: how far off in level (mean, least, most log10 ratio) and in slope.

    slope_difference: of log10 (computed / measured) over sun elevation, least squares [dex deg^-1].
    """

    climate: str
    quantity: str
    site: str
    low_deg: float
    high_deg: float
    count: int
    level_dex: float
    lowest_dex: float
    highest_dex: float
    slope_difference: float

    @property
    def factor(self) -> float:
        """Geometric mean of computed over measured."""
        return float(10.0**self.level_dex)


class Photometer:
    """The light of one climate for any sun, on the ground and above it.

    ground_altitude_km: of the land in place of the climate's own.
    """

    def __init__(self, config: Config, progress: Progress | None = None, ground_altitude_km: float | None = None):
        if ground_altitude_km is not None:
            ground = config.climate.ground.model_copy(update={"altitude_km": ground_altitude_km})
            config = config.model_copy(update={"climate": config.climate.model_copy(update={"ground": ground})})
        # few wavelengths stand for the visible: 590 nm would count the edge of water vapour's band for 20 nm
        scene = replace(resolve(config), observer=Observer(), bands=None)
        able = scene.capabilities
        if not (able.every_sun and able.every_observer):
            name = config.solver.get("name", solvers.DEFAULT)
            raise TwilightError(
                f"validate photometry: needs a solver whose field serves every sun and observer, as zones, not {name}"
            )
        self.config = config
        self.medium = scene.medium
        self.solved = solve(scene, progress=progress, cached=False)
        self._weight = (
            spectrum.LUMINOUS_EFFICACY_LM_PER_W
            * spectrum.solar_at_visible(config.solar_spectrum)
            * spectrum.colour_matching_functions("cie1931_2deg")[:, 1]
        )

    def luminous(self, factor: np.ndarray) -> np.ndarray:
        """Luminance [cd m^-2] or illuminance [lx] of sun-normalised spectra (..., W)."""
        return spectrum.integrate(factor, self.medium.wavelength_nm, self._weight)

    def illuminance_lux(self, sun_elevation_deg: float) -> tuple[float, float]:
        """(sun, sky and night together; night alone): illuminance of level ground at the medium's foot [lx]."""
        sun = float(self.luminous(self.solved.disc_irradiance(sun_elevation_deg)))
        sky = float(self.luminous(self.solved.horizontal_irradiance(sun_elevation_deg)))
        night = self._night(np.arcsin(np.sqrt((np.arange(20) + 0.5) / 20)), 24, sun_elevation_deg, None)
        lux = float(np.pi * np.mean(night)) if night is not None else 0.0  # rows of equal cosine x solid angle
        return sun + sky + lux, lux

    def colours(self, sun_elevation_deg: float) -> np.ndarray:
        """Irradiance of level ground by sun and sky at 450 and at 650 nm over that at 550 nm, (2,)."""
        factor = self.solved.horizontal_irradiance(sun_elevation_deg, direct=True)
        nm = np.array(BLUE_GREEN_RED_NM)
        at = np.exp(np.interp(nm, self.medium.wavelength_nm, np.log(np.maximum(factor, TINY))))
        blue, green, red = at * spectrum.solar_irradiance(nm, self.config.solar_spectrum)
        return np.array([blue / green, red / green])

    def zenith_luminance(self, sun_elevation_deg: float, site: meter.Site) -> tuple[float, float]:
        """(sky and night together; night alone): luminance of the zenith at a site [cd m^-2]."""
        altitude_km = max(site.altitude_km, self.medium.bottom_km)
        factor = self.solved.radiance(sun_elevation_deg, [90.0], [0.0], observer_altitude_km=altitude_km)
        night = self._night(np.array([np.pi / 2]), 1, sun_elevation_deg, site)
        floor = float(night[0, 0]) if night is not None else 0.0
        return float(self.luminous(factor)[0]) + floor, floor

    def transmission(self, altitude_km: float) -> float:
        """Vertical photopic transmission of the air above an altitude: of sunlight, by V(lambda)."""
        out = self.solved.direct(90.0, max(altitude_km, self.medium.bottom_km)).irradiance
        return float(self.luminous(out) / self.luminous(np.ones_like(out)))

    def _night(
        self, elevation_rad: np.ndarray, columns: int, sun_deg: float, site: meter.Site | None
    ) -> np.ndarray | None:
        """Luminance of the night sky (E, A) [cd m^-2], None where the configuration has none."""
        if self.config.night is None:
            return None
        sun_azimuth, place = None, None
        if site is not None:
            moment, sun_azimuth = evening(site, sun_deg)
            place = Place(site.latitude_deg, site.longitude_deg, moment)
        radiance = night_radiance(
            self.medium,
            np.degrees(elevation_rad),
            np.arange(columns) * (360.0 / columns),
            levels_of(self.config.night),
            sun_elevation_deg=sun_deg,
            sun_azimuth_deg=sun_azimuth,
            place=place,
            observer_altitude_km=self.medium.bottom_km if site is None else site.altitude_km,
        )
        solar = spectrum.solar_irradiance(self.medium.wavelength_nm, self.config.solar_spectrum)
        return self.luminous(radiance / solar)


def meter_luminance(magnitude: float) -> float:
    """Luminance [cd m^-2] that a Sky Quality Meter prints for a surface brightness [mag arcsec^-2]."""
    return METER_CD_M2 * 10.0 ** (-0.4 * magnitude)


def meter_magnitude(luminance_cd_m2: float) -> float:
    """The inverse of `meter_luminance`."""
    return float(-2.5 * np.log10(luminance_cd_m2 / METER_CD_M2))


def evening(site: meter.Site, sun_elevation_deg: float) -> tuple[Any, float]:
    """The moment of the site's evening when the sun stands at an elevation [deg], and the sun's azimuth [deg]."""
    low, high = site.evening, site.evening + timedelta(hours=12)
    for _ in range(24):
        middle = low + (high - low) / 2
        at = sun_position(middle, site.latitude_deg, site.longitude_deg, site.altitude_km)
        low, high = (middle, high) if float(at.elevation_deg) > sun_elevation_deg else (low, middle)
    return middle, float(at.azimuth_deg)


def photometry(
    config: Config, progress: Progress = silent
) -> tuple[list[PhotometricPoint], list[meter.MoonlitPoint], dict[str, float]]:
    """All points of one climate, those under the moon, and the vertical photopic transmission above Koomen's sites.

    Raises TwilightError for a configuration with a solver other than zones.
    """
    photometer = Photometer(config, part_of(progress, 0.0, 0.4))
    name, points, transmissions = config.climate.name, [], {}
    for i, sun in enumerate(SUNS_DEG):
        progress("illuminance", 0.4 + 0.2 * i / len(SUNS_DEG))
        light = (sun, *photometer.illuminance_lux(sun), float(meter.horizontal_illuminance_lux(sun)))
        points.append(PhotometricPoint(name, "illuminance", meter.ILLUMINANCE_SOURCE, "ground", 0.0, *light))
    for site in meter.KOOMEN_SITES:
        there = photometer
        if site.altitude_km - photometer.medium.bottom_km > HIGH_SITE_KM:
            there = Photometer(config, part_of(progress, 0.6, 0.35), site.altitude_km)
        transmissions[site.name] = there.transmission(site.altitude_km)
        suns, values = meter.zenith_luminance_cd_m2(site.name)
        measured = dict(zip(suns.tolist(), values.tolist(), strict=True))
        where = (meter.LUMINANCE_SOURCE, site.name, site.altitude_km)
        for sun in ZENITH_SUNS_DEG:
            progress(f"zenith, {site.name}", 0.97)
            light = (sun, *there.zenith_luminance(sun, site), measured.get(float(sun), float("nan")))
            points.append(PhotometricPoint(name, "zenith luminance", *where, *light))
    points += _colour_points(photometer, name)
    progress("zenith, meter", 0.98)
    floor = None if config.night is None else meter.METER_FLOOR_MAG
    zenith_meter = meter.SkyQualityMeter(Photometer(meter.site_of(config), None, meter.METER_SITE.altitude_km), floor)
    points += _meter_points(zenith_meter, name, floor)
    moonlit = list(zenith_meter.moonlit(name))
    progress("done", 1.0)
    return points, moonlit, transmissions


def _colour_points(photometer: Photometer, climate: str) -> list[PhotometricPoint]:
    """Colours of level ground beside every session."""
    points: list[PhotometricPoint] = []
    known: dict[float, np.ndarray] = {}
    for session in meter.SESSIONS:
        suns, nm, spectra = meter.level_ground_spectra(session)
        blue, green, red = (spectra[:, np.abs(nm - w) < 6.0].mean(axis=1) for w in BLUE_GREEN_RED_NM)
        for k, sun in enumerate(suns):
            if sun < LOWEST_COLOUR_DEG:
                continue
            if sun not in known:
                known[sun] = photometer.colours(float(sun))
            measured = (blue[k] / green[k], red[k] / green[k])
            where = (meter.SPECTRA_SOURCE, f"session {session}", 0.0, float(sun))
            points += [
                PhotometricPoint(climate, quantity, *where, float(computed), 0.0, float(there))
                for quantity, computed, there in zip(COLOURS, known[sun], measured, strict=True)
            ]
    return points


def _meter_points(zenith_meter: meter.SkyQualityMeter, climate: str, floor_mag: float | None) -> list[PhotometricPoint]:
    """The zenith through twilight, as luminances that the meter prints."""
    night = 0.0 if floor_mag is None else meter_luminance(floor_mag)
    where = (climate, METER_QUANTITY, meter.METER_SOURCE, meter.METER_SITE.name, meter.METER_SITE.altitude_km)
    return [
        PhotometricPoint(*where, sun, meter_luminance(zenith_meter.twilight_mag(sun)), night, meter_luminance(mag))
        for sun, mag in zip(*(values.tolist() for values in meter.meter_zenith()), strict=True)
    ]


def levels(points: Iterable[PhotometricPoint]) -> list[Level]:
    """Level and slope over every range that holds two measured points or more."""
    groups: dict[tuple[str, str, str], list[PhotometricPoint]] = {}
    for point in points:
        if np.isfinite(point.measured):
            groups.setdefault((point.climate, point.quantity, point.site), []).append(point)
    out = []
    for (climate, quantity, site), group in groups.items():
        ranges = {"illuminance": ILLUMINANCE_RANGES_DEG, **dict.fromkeys(COLOURS, COLOUR_RANGES_DEG)}
        for low, high in ranges.get(quantity, LUMINANCE_RANGES_DEG):
            inside = [p for p in group if low <= p.sun_elevation_deg <= high]
            if len(inside) < 2:
                continue
            ratio = np.array([p.log_ratio for p in inside])
            slope = np.polyfit([p.sun_elevation_deg for p in inside], ratio, 1)[0]
            spread = (float(ratio.mean()), float(ratio.min()), float(ratio.max()))
            out.append(Level(climate, quantity, site, low, high, len(inside), *spread, float(slope)))
    return out
