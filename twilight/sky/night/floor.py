"""The spectral radiance of the night sky of a scene."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from twilight.atmosphere.medium import Medium
from twilight.base.errors import TwilightError
from twilight.numerics import spectrum
from twilight.sky.night import light
from twilight.sky.night.pollution import pollution_radiance
from twilight.sky.night.veil import veil
from twilight.sky.night.world import Place, ecliptic_from_sun, galactic_latitude


@dataclass(frozen=True)
class NightLevels:
    """How bright each part is, in units of its usual brightness; 0 leaves it out.

    airglow: 1 is the mean of a solar cycle; about 0.7 at solar minimum, 1.3 at a strong maximum, with as much again
        from night to night.
    starlight: all stars as a smooth glow, and starlight scattered by dust between them.
    zodiacal_light: sunlight scattered by dust between the planets.
    light_pollution_cd_per_m2: luminance of the lamps' light in the zenith (`night.pollution`), which is given.
    """

    airglow: float = 1.0
    starlight: float = 1.0
    zodiacal_light: float = 1.0
    light_pollution_cd_per_m2: float = 0.0

    def __post_init__(self):
        for name in ("airglow", "starlight", "zodiacal_light", "light_pollution_cd_per_m2"):
            value = getattr(self, name)
            if not (np.isfinite(value) and value >= 0):
                raise TwilightError(f"night.{name}: must be 0 or more, not {value}")


def night_radiance(
    medium: Medium,
    elevation_deg: np.ndarray,
    azimuth_deg: np.ndarray,
    levels: NightLevels | None = None,
    *,
    sun_elevation_deg: float = -18.0,
    sun_azimuth_deg: float | None = None,
    place: Place | None = None,
    observer_altitude_km: float = 0.0,
) -> np.ndarray:
    """Spectral radiance of the moonless night sky [W m^-2 nm^-1 sr^-1], (E, A, W), at the medium's wavelengths.

    elevation_deg (E,), azimuth_deg (A,) relative to the sun.  Means over the wavelengths' bins
    (``spectrum.wavelength_bounds``), so that no line is lost between two samples.

    * Airglow: lines and continuum of layers at 90 to 250 km, brighter towards the horizon by van Rhijn's function.
    * Starlight with diffuse galactic light by galactic latitude, with the sun's spectrum.
    * Zodiacal light by ecliptic longitude from the sun and latitude, Leinert et al. 1998.
    * Light pollution, by elevation alone: of lamps, in the air.

    The scene's own air dims all but the lamps and scatters some of that light in (``night.veil``).  Where `place` or
    the sun's azimuth is not known, starlight is its mean over the sky and the ecliptic stands at 60 deg to the horizon.
    Validity: brightness to some 20 %; real nights differ by a factor 2, and cities by any factor.
    """
    levels = levels or NightLevels()
    elevation, azimuth = np.asarray(elevation_deg, float), np.asarray(azimuth_deg, float)
    here = (sun_elevation_deg, sun_azimuth_deg, place, observer_altitude_km)
    radiance = _above_air(medium.wavelength_nm, elevation, azimuth, levels, *here)
    rows, columns = (np.arange(30) + 0.5) * 3.0, np.arange(24) * 15.0
    hemisphere = _above_air(medium.wavelength_nm, rows, columns, levels, *here)
    weight = np.sin(2 * np.radians(rows))  # cosine x solid angle
    mean = np.einsum("e,eaw->w", weight / weight.sum() / columns.size, hemisphere)
    seen = veil(medium, elevation, observer_altitude_km).behind(radiance, mean)
    if levels.light_pollution_cd_per_m2 > 0.0:
        lamps = pollution_radiance(medium.wavelength_nm, elevation, levels.light_pollution_cd_per_m2)
        seen = seen + lamps[:, None, :]
    return seen


def _above_air(
    wavelength_nm: np.ndarray,
    elevation: np.ndarray,
    azimuth: np.ndarray,
    levels: NightLevels,
    sun_elevation_deg: float,
    sun_azimuth_deg: float | None,
    place: Place | None,
    observer_km: float,
) -> np.ndarray:
    """Radiance (E, A, W) that the same directions had without scattering air."""
    rows, columns = elevation[:, None], azimuth[None, :]
    out = np.zeros((elevation.size, azimuth.size, wavelength_nm.size))
    if levels.airglow > 0:
        zenith = light.airglow_zenith(spectrum.wavelength_bounds(wavelength_nm))
        for layer, radiance in zip(light.airglow_layers(), zenith, strict=True):
            out += levels.airglow * light.van_rhijn(rows, layer, observer_km)[..., None] * radiance
    if levels.starlight > 0:
        latitude = None
        if place is not None and sun_azimuth_deg is not None:
            latitude = galactic_latitude(rows, columns, sun_azimuth_deg, place)
        s10 = np.broadcast_to(light.starlight_s10(latitude), out.shape[:2])
        out += levels.starlight * light.S10_550NM * s10[..., None] * light.solar_shape(wavelength_nm, 550.0)
    if levels.zodiacal_light > 0:
        where = ecliptic_from_sun(rows, columns, sun_elevation_deg, sun_azimuth_deg, place)
        shape = light.solar_shape(wavelength_nm, 500.0) * light.zodiacal_colour(wavelength_nm)
        out += levels.zodiacal_light * light.zodiacal_500nm(*where)[..., None] * shape
    return out
