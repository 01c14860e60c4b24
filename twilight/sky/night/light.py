"""Spectra and patterns of what shines at night above the scattering air: airglow, starlight, zodiacal light."""

from functools import lru_cache

import numpy as np

from twilight.base.conventions import EARTH_RADIUS_KM
from twilight.base.shipped_data import data_numbers, data_rows
from twilight.numerics import spectrum

RAYLEIGH_PHOTONS = 1e10 / (4.0 * np.pi)
"""1 rayleigh in photons m^-2 s^-1 sr^-1 (Hunten, Roach and Chamberlain 1956)."""
_PLANCK_TIMES_LIGHT_J_NM = 6.62607015e-34 * 2.99792458e8 * 1e9
"""h c [J nm] (SI 2019)."""
S10_550NM = 1.19e-11
"""One 10th magnitude (V) star per square degree [W m^-2 nm^-1 sr^-1] at 550 nm: 27.78 mag arcsec^-2 with
3.631e-11 W m^-2 nm^-1 for V = 0 (Bessell, Castelli and Plez 1998)."""
STARLIGHT_POLE_S10 = 30.0
"""All stars together at the galactic poles [S10(V)] (Roach and Gordon 1973)."""
STARLIGHT_PLANE_S10 = 250.0
"""All stars together in the galactic plane [S10(V)], mean over longitude (Roach and Gordon 1973: 160 to 640)."""
GALACTIC_LIGHT_FRACTION = 0.25
"""Fraction of diffuse galactic light (starlight scattered by dust) in the light of the Milky Way: 0.2 to 0.3 (Leinert
et al. 1998 sec. 11)."""
CONTINUUM_NM = np.array([300.0, 366.0, 438.0, 500.0, 545.0, 641.0, 720.0, 798.0, 1000.0])
"""Wavelengths of CONTINUUM_RAYLEIGH_PER_NM [nm]."""
CONTINUUM_RAYLEIGH_PER_NM = np.array([0.3, 0.3, 5.6, 4.0, 4.0, 12.1, 5.8, 5.8, 5.8])
"""Airglow between the lines of ``airglow_lines.csv``, with the weak OH bands that are not in it.  What is left of the
night sky at Paranal in UBVRI at solar maximum (Patat 2003, A&A 400, 1183: 22.28, 22.64, 21.61, 20.87, 19.71) after
the lines, zodiacal light of 1.2e-9 W m^-2 nm^-1 sr^-1 at 500 nm and 15 S10 of scattered starlight.  4 R/nm at 545 nm is
the 0.3 to 0.5 R/A that is usually quoted (Leinert et al. 1998 sec. 6)."""
CONTINUUM_ALTITUDE_KM = 90.0
"""Altitude of the layer that the continuum shines from [km], that of OH."""
SOLAR_MAXIMUM = 4.0 / 3.0
"""Airglow at the strong solar maximum for which lines and continuum hold, over its mean in a solar cycle (level 1)."""


def photon_energy_j(wavelength_nm: np.ndarray) -> np.ndarray:
    """Energy of a photon [J]."""
    return _PLANCK_TIMES_LIGHT_J_NM / np.asarray(wavelength_nm, float)


# Airglow --------------------------------------------------------------------------------------------------------


@lru_cache(maxsize=1)
def _lines() -> np.ndarray:
    """centre_nm, width_nm, rayleigh, altitude_km of every line, (N, 4)."""
    return np.array([[float(x) for x in [*row.values()][1:]] for row in data_rows("night/airglow_lines.csv")])


def airglow_layers() -> np.ndarray:
    """Altitudes of the emitting layers [km], (N,)."""
    return np.unique(np.append(_lines()[:, 3], CONTINUUM_ALTITUDE_KM))


def airglow_zenith(bounds_nm: np.ndarray) -> np.ndarray:
    """Spectral radiance of every layer in the zenith, mean over wavelength bins (W, 2) [W m^-2 nm^-1 sr^-1], (N, W)."""
    layers = airglow_layers()
    low, high = bounds_nm[:, 0], bounds_nm[:, 1]
    out = np.zeros((layers.size, low.size))
    for centre, width, rayleigh, altitude in _lines():
        overlap = np.clip(np.minimum(high, centre + width / 2) - np.maximum(low, centre - width / 2), 0.0, None)
        energy = RAYLEIGH_PHOTONS * photon_energy_j(np.array([centre]))
        out[np.searchsorted(layers, altitude)] += rayleigh * energy * overlap / width / (high - low)
    integral = np.interp(bounds_nm, *_continuum_integral())
    out[np.searchsorted(layers, CONTINUUM_ALTITUDE_KM)] += (integral[:, 1] - integral[:, 0]) / (high - low)
    return out / SOLAR_MAXIMUM


@lru_cache(maxsize=1)
def _continuum_integral() -> tuple[np.ndarray, np.ndarray]:
    """Wavelengths [nm], step 1, and the integral of the continuum up to them [W m^-2 sr^-1]."""
    nm = np.arange(200.0, 1200.0)
    rayleigh = np.exp(np.interp(nm, CONTINUUM_NM, np.log(CONTINUUM_RAYLEIGH_PER_NM)))
    radiance = rayleigh * RAYLEIGH_PHOTONS * photon_energy_j(nm)
    return nm, np.concatenate([[0.0], np.cumsum(0.5 * (radiance[1:] + radiance[:-1]))])


def van_rhijn(elevation_deg: np.ndarray, layer_km: float, observer_km: float = 0.0) -> np.ndarray:
    """Path through a thin layer over its thickness (van Rhijn 1921): 1/sqrt(1 - ((R + z) cos e / (R + h))^2).

    Counts every crossing of the line of sight: one for an observer below the layer; none, or one each way, from above
    it; a line of sight that ends on the ground crosses nothing beyond.
    """
    e = np.radians(np.asarray(elevation_deg, float))
    lowest = (EARTH_RADIUS_KM + observer_km) * np.cos(e)  # distance of the line from the Earth's centre
    ratio = lowest / (EARTH_RADIUS_KM + layer_km)
    with np.errstate(divide="ignore", invalid="ignore"):
        path = np.where(ratio < 1.0, 1.0 / np.sqrt(1.0 - ratio**2), 0.0)
    ground = (e < 0) & (lowest < EARTH_RADIUS_KM)
    if observer_km < layer_km:
        return np.where(ground, 0.0, path)
    return np.where(e >= 0, 0.0, np.where(ground, path, 2.0 * path))


# Starlight and zodiacal light -----------------------------------------------------------------------------------


def starlight_s10(galactic_latitude_deg: np.ndarray | None) -> np.ndarray:
    """Starlight with diffuse galactic light [S10, V] at a galactic latitude; None gives the mean over the sky.

    A level layer of stars mixed with dust: B(b) = B_pole (1 - exp(-t/sin b)) / (1 - exp(-t)), with t such that the
    plane (b = 0) has ``STARLIGHT_PLANE_S10``.  Clouds and arms of the Milky Way are not in it.
    """
    fraction = STARLIGHT_POLE_S10 / STARLIGHT_PLANE_S10  # 1 - exp(-t)
    depth = -np.log1p(-fraction)
    if galactic_latitude_deg is None:
        sine = (np.arange(2000) + 0.5) / 2000
        level = np.asarray(np.mean(-np.expm1(-depth / sine)))
    else:
        sine = np.maximum(np.sin(np.radians(np.abs(galactic_latitude_deg))), 1e-9)
        level = -np.expm1(-depth / sine)
    return STARLIGHT_PLANE_S10 * level / (1.0 - GALACTIC_LIGHT_FRACTION)


@lru_cache(maxsize=1)
def _zodiacal_table() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Ecliptic longitude from the sun (L,) and latitude (B,) [deg], and ln of the light (L, B)."""
    (_, *latitudes), numbers = data_numbers("night/zodiacal_light.csv")
    longitude, table = numbers[:, 0], numbers[:, 1:].copy()
    # next to the sun: the value at the nearest measured longitude
    for column in table.T:
        measured = np.isfinite(column)
        column[~measured] = column[measured][0]
    return longitude, np.array(latitudes, float), np.log(table)


def zodiacal_500nm(longitude_from_sun_deg: np.ndarray, ecliptic_latitude_deg: np.ndarray) -> np.ndarray:
    """Zodiacal light at 500 nm [W m^-2 nm^-1 sr^-1], bilinear in the logarithm of the table."""
    longitude, latitude, table = _zodiacal_table()
    x, y = np.abs(longitude_from_sun_deg), np.abs(ecliptic_latitude_deg)
    i = np.clip(np.searchsorted(longitude, x, side="right") - 1, 0, longitude.size - 2)
    j = np.clip(np.searchsorted(latitude, y, side="right") - 1, 0, latitude.size - 2)
    u = np.clip((x - longitude[i]) / (longitude[i + 1] - longitude[i]), 0.0, 1.0)
    v = np.clip((y - latitude[j]) / (latitude[j + 1] - latitude[j]), 0.0, 1.0)
    low = (1 - v) * table[i, j] + v * table[i, j + 1]
    high = (1 - v) * table[i + 1, j] + v * table[i + 1, j + 1]
    return np.exp((1 - u) * low + u * high) * 1e-11


def solar_shape(wavelength_nm: np.ndarray, reference_nm: float) -> np.ndarray:
    """The solar spectrum's bin means over its mean within 5 nm of a reference wavelength, (W,)."""
    grid, irradiance = spectrum.solar_spectrum()
    near = np.abs(grid - reference_nm) <= 5.0
    return spectrum.solar_irradiance(wavelength_nm) / irradiance[near].mean()


def zodiacal_colour(wavelength_nm: np.ndarray) -> np.ndarray:
    """Colour of the zodiacal light relative to the sun, 1 at 500 nm, (W,): 1 + 0.9 log10(nm/500) below 500 nm and
    1 + 0.6 log10(nm/500) above (Leinert et al. 1998 eq. 22, elongation 90 deg)."""
    x = np.log10(np.asarray(wavelength_nm, float) / 500.0)
    return 1.0 + np.where(x < 0, 0.9, 0.6) * x
