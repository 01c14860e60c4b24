"""What the night sky's light passes, and light pollution: a level that is given and a published curve to the horizon.

The air takes from light that comes from above it in all directions: by extinction and, to first order, scattering.
"""

from typing import NamedTuple

import numpy as np

from twilight.atmosphere.levels import layer_mean
from twilight.atmosphere.medium import Medium
from twilight.base.errors import TwilightError
from twilight.numerics import spectrum

NATURAL_ZENITH_MAG = 22.0
"""Zenith of a natural sky [V mag arcsec^-2], which is within the brightness that is given: 174 ucd m^-2 (Falchi et al.
2016, Science Advances 2, e1600377)."""
NATURAL_ZENITH_CD_PER_M2 = 174e-6
"""The same as a luminance [cd m^-2] (ibid.)."""
BORTLE_ZENITH_MAG = (22.0, 21.94, 21.79, 21.09, 20.0, 19.22, 18.66, 18.1, 17.5)
"""Middle of the range of zenith brightness [V mag arcsec^-2] that goes with the classes 1 to 9 of Bortle 2001 (Sky and
Telescope 101/2, 126) in the charts in common use: 21.99, 21.89, 21.69, 20.49, 19.50, 18.94, 18.38 between the classes;
8 and 9 are open ranges.  The classes themselves are of what is seen, and differ by half a class."""
EXTINCTION_MAG = 0.172
"""Extinction in the zenith [mag], V (Krisciunas and Schaefer 1991)."""
PATH_CURVATURE = 0.96
"""Of the path X = (1 - 0.96 sin^2 z)^-1/2 (Garstang 1989, PASP 101, 306)."""
TEMPERATURE_K = 3000.0
"""Temperature of the black body whose spectrum the lamps have: between sodium lamps and white LEDs."""


def bortle_zenith_mag(bortle_class: int) -> float:
    """Zenith brightness [V mag arcsec^-2] that stands for a class of Bortle 2001; TwilightError outside 1 to 9."""
    if not 1 <= bortle_class <= len(BORTLE_ZENITH_MAG):
        raise TwilightError(f"Bortle class: must be from 1 to 9, not {bortle_class}")
    return BORTLE_ZENITH_MAG[bortle_class - 1]


def artificial_zenith_cd_per_m2(zenith_mag_per_arcsec2: float) -> float:
    """Luminance of the lamps' light in the zenith [cd m^-2], for a zenith brightness with the natural sky in it.

    Errors: TwilightError for a zenith darker than the natural one, 22.0 V mag arcsec^-2.
    """
    if not zenith_mag_per_arcsec2 <= NATURAL_ZENITH_MAG:
        raise TwilightError(
            f"light pollution: a zenith of {zenith_mag_per_arcsec2:g} mag arcsec^-2 is darker than a natural one, "
            f"{NATURAL_ZENITH_MAG:g}"
        )
    return NATURAL_ZENITH_CD_PER_M2 * (10.0 ** (0.4 * (NATURAL_ZENITH_MAG - zenith_mag_per_arcsec2)) - 1.0)


def gradient(elevation_deg: np.ndarray) -> np.ndarray:
    """Brightness over that of the zenith, X 10^(-0.4 k (X - 1)): 1 there, 2.65 at the horizon and below it.

    Garstang 1989; Krisciunas and Schaefer 1991 eq. 2 and 3.  The same all around: no light dome of a town is known.
    """
    sine = np.cos(np.radians(np.maximum(np.asarray(elevation_deg, float), 0.0)))
    path = (1.0 - PATH_CURVATURE * sine**2) ** -0.5
    return path * 10.0 ** (-0.4 * EXTINCTION_MAG * (path - 1.0))


def lamp_spectrum(wavelength_nm: np.ndarray) -> np.ndarray:
    """Spectral radiance of the lamps' light in the air of a luminance of 1 cd m^-2 [W m^-2 nm^-1 sr^-1], (W,)."""
    efficacy = spectrum.LUMINOUS_EFFICACY_LM_PER_W * spectrum.colour_matching_functions("cie1931_2deg")[:, 1]
    return _black_body(np.asarray(wavelength_nm, float)) / float(_black_body(spectrum.VISIBLE_NM) @ efficacy)


def _black_body(nm: np.ndarray) -> np.ndarray:
    return 1e15 / (nm**5 * np.expm1(1.4387769e7 / (nm * TEMPERATURE_K)))


DIFFUSIVITY = 1.66
"""Mean slant of diffuse light (Elsasser 1942)."""


class Veil(NamedTuple):
    """transmittance (E, W) along lines of sight; source (W,): what the air scatters in, over the mean light above."""

    transmittance: np.ndarray
    source: np.ndarray

    def behind(self, above: np.ndarray, mean: np.ndarray) -> np.ndarray:
        """Radiance (..., W) at the observer of light `above` the air whose hemispheric mean is `mean`.

            L = L_above t + L_mean (1 - t) s

        s: `veil`; the transmittance is one that broadcasts with the light.
        """
        return above * self.transmittance + mean * (1.0 - self.transmittance) * self.source


def veil(medium: Medium, elevation_deg: np.ndarray, observer_km: float = 0.0) -> Veil:
    """The air of a medium between an observer and the sources above, for light from all directions of the upper half.

    s makes the flux of a uniform field that of a two-stream layer over the ground: with the diffuse transmittance
    T = exp(-1.66 t_abs) / (1 + 0.75 (t_air + (1 - g) t_particles)), what it sends back R = 1 - T exp(1.66 t_abs), the
    ground's albedo A, and E = exp(-1.66 t) of the light that came straight, s = (T / (1 - A R) - E) / (1 - E).
    2 to 7 % darker than the effective extinction of Noll et al. 2012 (A&A 543, A92, fits to multiple scattering at
    Paranal) to 60 deg from the zenith.  Lines of sight are straight; those that end on the ground have transmittance 0.
    """
    fine = medium.refined(0.25, 1e-3)
    z = fine.altitude_km
    observer = max(float(observer_km), float(z[0]))
    keep = np.diff(z) > 0
    lower, upper = z[:-1][keep], z[1:][keep]

    def mean(coefficient: np.ndarray) -> np.ndarray:
        return layer_mean(coefficient[:-1][keep], coefficient[1:][keep])

    air, gas, particles = (
        mean(a) for a in (fine.air_scattering_per_km, fine.absorption_per_km, fine.aerosol_extinction_per_km)
    )
    albedo = 0.5 * (fine.aerosol_single_scattering_albedo[:-1] + fine.aerosol_single_scattering_albedo[1:])[keep]
    above = np.clip(upper - np.maximum(lower, observer), 0.0, None)[:, None]
    depth_air, depth_gas, depth_particles = ((a * above).sum(axis=0) for a in (air, gas, particles))
    scattered = (particles * albedo * above).sum(axis=0)
    g = np.zeros(scattered.size)
    for fraction, phase in zip(fine.aerosol_phase_fraction, fine.phase_functions, strict=True):
        mixed = 0.5 * (fraction[:-1] + fraction[1:])[keep]
        g += phase.asymmetry * (mixed * particles * albedo * above).sum(axis=0)
    g = np.divide(g, scattered, out=np.zeros_like(g), where=scattered > 0)
    total = depth_air + depth_gas + depth_particles
    absorbed = depth_gas + depth_particles - scattered
    sent_on = 1.0 / (1.0 + 0.75 * (depth_air + (1 - g) * scattered))
    diffuse = np.exp(-DIFFUSIVITY * absorbed) * sent_on / (1.0 - medium.ground_albedo * (1.0 - sent_on))
    lost = -np.expm1(-DIFFUSIVITY * total)
    source = np.divide(diffuse - (1.0 - lost), lost, out=np.zeros_like(lost), where=lost > 0)
    depth = _lengths_km(lower, upper, elevation_deg, observer, medium.earth_radius_km) @ (air + gas + particles)
    blocked = _ends_on_ground(elevation_deg, observer, medium)
    transmittance = np.where(blocked[:, None], 0.0, np.exp(-depth))
    return Veil(transmittance, np.maximum(source, 0.0))


def _ends_on_ground(elevation_deg: np.ndarray, observer_km: float, medium: Medium) -> np.ndarray:
    e = np.radians(elevation_deg)
    lowest = (medium.earth_radius_km + observer_km) * np.cos(e)
    return (e < 0) & (lowest < medium.earth_radius_km + medium.bottom_km)


def _lengths_km(lower: np.ndarray, upper: np.ndarray, elevation_deg: np.ndarray, observer_km: float, radius_km: float):
    """Lengths of straight lines in spherical layers (E, L) [km], from the observer outwards."""
    e = np.radians(np.asarray(elevation_deg, float))[:, None]
    start = radius_km + observer_km
    nearest = start * np.cos(e)

    def along(altitude: np.ndarray) -> np.ndarray:
        """Distance from the point of the line that is nearest to the Earth's centre."""
        return np.sqrt(np.maximum((radius_km + altitude) ** 2 - nearest**2, 0.0))

    out = along(np.maximum(upper, observer_km)) - along(np.maximum(lower, observer_km))
    dip = along(np.minimum(upper, observer_km)) - along(np.minimum(lower, observer_km))
    return np.where(e < 0, out + 2.0 * dip, out)
