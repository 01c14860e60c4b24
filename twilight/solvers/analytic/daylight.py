"""Preetham 1999, appendix A: sunlight at the ground (A.1, after Iqbal 1983); spectra from luminance and chromaticity
by the CIE daylight basis (A.5).

A model's spectrum is divided by the solar spectrum in bins: the mean of one over the mean of the other.  The basis is
known every 10 nm, so bins are 10 nm wide at least; the quotient is then smooth, as sun-normalised radiance has to be.

What skies that are formulae share besides: which suns, observers and turbidities they refuse, the turbidity of a
medium, and the Lambertian ground below an observer who stands on it.
"""

import warnings
from collections.abc import Callable
from functools import lru_cache

import numpy as np

from twilight.atmosphere.medium import Medium
from twilight.base.errors import TwilightError, TwilightWarning
from twilight.base.shipped_data import data_numbers
from twilight.numerics import spectrum


@lru_cache(maxsize=8)
def table(name: str) -> tuple[tuple[str, ...], np.ndarray]:
    """Column names and values (rows, columns) of a table; an empty cell is NaN."""
    return data_numbers(f"analytic/{name}.csv")


def column(name: str, key: str) -> np.ndarray:
    """One column of a table."""
    head, values = table(name)
    return values[:, head.index(key)]


ANGSTROM_EXPONENT = 1.3
"""Exponent of the aerosol's optical depth in wavelength."""
RAYLEIGH_EXPONENT = 4.08
"""Exponent of the air's optical depth in wavelength."""


def relative_optical_mass(sun_zenith_deg) -> np.ndarray:
    """m = 1 / (cos z + 0.15 (93.885 - z)^-1.253), z the sun's zenith angle [deg], 0 to 90 (Kasten 1966)."""
    z = np.asarray(sun_zenith_deg, float)
    if not ((z >= 0) & (z <= 90)).all():
        raise TwilightError("sun_zenith_deg must be from 0 to 90: the optical mass is not defined below the horizon")
    return 1.0 / (np.cos(np.radians(z)) + 0.15 * (93.885 - z) ** -1.253)


def transmittances(
    wavelength_nm,
    sun_zenith_deg: float,
    turbidity: float,
    *,
    ozone_cm: float = 0.35,
    precipitable_water_cm: float = 2.0,
) -> dict[str, np.ndarray]:
    """Transmittance of `air`, `aerosol`, `ozone`, `mixed_gases` and `water` towards the sun, each (W,).

    ozone_cm: column at NTP [cm]; precipitable_water_cm [cm].  The absorption spectra are tabulated from 380 to 780
    nm and taken as 0 beyond, which leaves out the ozone of the ultraviolet and the water of the infrared.
    """
    wavelength = np.atleast_1d(np.asarray(wavelength_nm, float))
    micrometre = wavelength / 1000.0
    m = float(relative_optical_mass(sun_zenith_deg))

    def k(gas: str) -> np.ndarray:
        grid = column("preetham1999_spectra", "wavelength_nm")
        return np.interp(wavelength, grid, column("preetham1999_spectra", gas), left=0.0, right=0.0)

    water = k("water") * precipitable_water_cm * m
    mixed = k("mixed") * m
    beta = np.maximum(0.04608 * np.asarray(turbidity, float) - 0.04586, 0.0)  # Angstrom's, the aerosol's depth at 1 um
    return {
        "air": np.exp(-0.008735 * micrometre**-RAYLEIGH_EXPONENT * m),
        "aerosol": np.exp(-beta * micrometre**-ANGSTROM_EXPONENT * m),
        "ozone": np.exp(-k("ozone") * ozone_cm * m),
        "mixed_gases": np.exp(-1.41 * mixed / (1.0 + 118.93 * mixed) ** 0.45),
        "water": np.exp(-0.2385 * water / (1.0 + 20.07 * water) ** 0.45),
    }


def direct_transmittance(wavelength_nm, sun_zenith_deg: float, turbidity: float, **amounts: float) -> np.ndarray:
    """Product of all ``transmittances``: direct sunlight at the ground at normal incidence over F0, (W,)."""
    return np.prod(list(transmittances(wavelength_nm, sun_zenith_deg, turbidity, **amounts).values()), axis=0)


LOWEST_NM = 300.0
"""Where the daylight basis begins [nm]."""
HIGHEST_NM = 830.0
"""Where the daylight basis ends [nm]."""
NARROWEST_BIN_NM = 10.0
"""Narrowest bin of a wavelength [nm]: the spacing of the daylight basis."""
SINGULAR = -1e-3
"""Largest value of the denominator of M1 and M2; at 0 no mixture of the basis has that chromaticity."""
_CHUNK = 100_000
"""Directions that are handled at once, so that large pictures need little memory."""


def daylight_weights(x, y) -> np.ndarray:
    """Weights (..., 3) of S0, S1, S2 in the daylight spectrum of CIE 1931 chromaticity x, y: 1, M1, M2.

    M1 = (-1.3515 - 1.7703 x + 5.9114 y) / (0.0241 + 0.2562 x - 0.7341 y), M2 = (0.0300 - 31.4424 x + 30.0717 y) / same.
    """
    x, y = np.asarray(x, float), np.asarray(y, float)
    # The denominator is negative wherever daylight lies; it would be 0 in a purple that no sky has.
    m = np.minimum(0.0241 + 0.2562 * x - 0.7341 * y, SINGULAR)
    m1 = (-1.3515 - 1.7703 * x + 5.9114 * y) / m
    m2 = (0.0300 - 31.4424 * x + 30.0717 * y) / m
    return np.stack([np.ones_like(m1), m1, m2], axis=-1)


def daylight_spectrum(x, y) -> np.ndarray:
    """Spectrum (..., 54) of that chromaticity every 10 nm from 300 to 830 nm for 1 lm m^-2 [W m^-2 nm^-1].

    S0 + M1 S1 + M2 S2 where positive and 0 elsewhere: the red of a low sun would be negative in the blue.
    That moves the chromaticity of Preetham's sky by 0.007 at most for a sun above 5 deg, 0.02 at the horizon.
    """
    relative = np.maximum(daylight_weights(x, y) @ _basis().T, 0.0)
    return relative / (relative @ _luminous_weights())[..., None]


def locus_y(x) -> np.ndarray:
    """y of the CIE daylight locus, -3 x^2 + 2.87 x - 0.275 (CIE 15, for 0.25 <= x <= 0.38)."""
    x = np.asarray(x, float)
    return -3.0 * x**2 + 2.87 * x - 0.275


def daylight_chromaticity(colour_temperature_k: float) -> tuple[float, float]:
    """CIE 1931 x, y of daylight of a correlated colour temperature from 4000 to 25000 K (CIE 15)."""
    t = 1000.0 / colour_temperature_k
    if colour_temperature_k <= 7000.0:
        x = 0.244063 + 0.09911 * t + 2.9678 * t**2 - 4.6070 * t**3
    else:
        x = 0.237040 + 0.24748 * t + 1.9018 * t**2 - 2.0064 * t**3
    return x, float(locus_y(x))


class SpectralBins:
    """The bins of sampled wavelengths, and what turns luminance and chromaticity into sun-normalised radiance there."""

    def __init__(self, wavelength_nm: np.ndarray, solver: str):
        """Raises TwilightError, in the name of ``solver``, for a wavelength without a daylight basis."""
        wavelength = np.asarray(wavelength_nm, float)
        outside = (wavelength < LOWEST_NM) | (wavelength > HIGHEST_NM)
        if outside.any():
            raise TwilightError(
                f"the {solver} solver has daylight spectra from {LOWEST_NM:g} to {HIGHEST_NM:g} nm: "
                f"wavelengths holds {wavelength[outside][0]:g} nm"
            )
        half = 0.5 * NARROWEST_BIN_NM
        bounds = spectrum.wavelength_bounds(wavelength)
        low = np.maximum(np.minimum(bounds[:, 0], wavelength - half), LOWEST_NM)
        high = np.minimum(np.maximum(bounds[:, 1], wavelength + half), HIGHEST_NM)
        step = (np.arange(400) + 0.5) / 400.0
        inside = low[:, None] + (high - low)[:, None] * step
        grid, irradiance = spectrum.solar_spectrum()
        # 400 points in a bin see the 1 nm steps of the solar spectrum to 1e-3 or better.
        sun = irradiance[np.clip(np.rint(inside - grid[0]).astype(int), 0, grid.size - 1)].mean(axis=1)
        nodes = _nodes()
        self.to_bins = np.stack([np.interp(inside, nodes, hat).mean(axis=1) for hat in np.eye(nodes.size)], axis=1)
        self.to_bins /= sun[:, None]
        unit = spectrum.LUMINOUS_EFFICACY_LM_PER_W * spectrum.colour_matching_functions("cie1931_2deg")[:, 1].sum()
        self.of_flat_spectrum = 1.0 / unit / sun
        """Sun-normalised radiance [sr^-1] of light of 1 cd m^-2 whose spectrum is constant, (W,)."""

    def from_chromaticity(self, luminance_cd_per_m2, x, y) -> np.ndarray:
        """Sun-normalised radiance [sr^-1] (..., W) of daylight of that luminance and chromaticity."""
        luminance, x, y = np.broadcast_arrays(np.asarray(luminance_cd_per_m2, float), x, y)
        flat = [v.ravel() for v in (luminance, x, y)]
        out = np.empty((luminance.size, self.to_bins.shape[0]))
        for start in range(0, luminance.size, _CHUNK):
            part = slice(start, start + _CHUNK)
            out[part] = flat[0][part, None] * (daylight_spectrum(flat[1][part], flat[2][part]) @ self.to_bins.T)
        return out.reshape(*luminance.shape, out.shape[1])


def _nodes() -> np.ndarray:
    return table("daylight_basis")[1][:, 0]


def _basis() -> np.ndarray:
    return table("daylight_basis")[1][:, 1:]


@lru_cache(maxsize=1)
def _luminous_weights() -> np.ndarray:
    """683 lm/W times V(lambda) integrated over the hat functions of the basis, (54,)."""
    nodes = _nodes()
    v = spectrum.LUMINOUS_EFFICACY_LM_PER_W * spectrum.colour_matching_functions("cie1931_2deg")[:, 1]
    return np.array([np.interp(spectrum.VISIBLE_NM, nodes, hat) @ v for hat in np.eye(nodes.size)])


HIGHEST_OBSERVER_KM = 1.0
"""The formulae are those of the sky seen from the ground; up to here above it they are taken for it."""
ROUNDING_DEG = 1e-6
"""Elevation of the sun outside the limits that counts as rounding [deg]."""


def check_observer(medium: Medium, altitude_km: float, solver: str) -> None:
    """Raise TwilightError for an observer who does not stand on the ground, or nearly."""
    low, high = medium.bottom_km, medium.bottom_km + HIGHEST_OBSERVER_KM
    if not low <= altitude_km <= high:
        raise TwilightError(
            f"the {solver} solver knows the sky seen from the ground only: observer.altitude_km is {altitude_km:g}, "
            f"allowed is {low:g} to {high:g}"
        )


def check_sun(sun_elevation_deg: float, solver: str, lowest_deg: float = 0.0, highest_deg: float = 90.0) -> None:
    """Raise TwilightError for a sun below the horizon or outside a fit."""
    if not lowest_deg - ROUNDING_DEG <= sun_elevation_deg <= highest_deg + ROUNDING_DEG:
        raise TwilightError(
            f"the {solver} solver has no sky for this sun: sun.elevation_deg is {sun_elevation_deg:g}, allowed is "
            f"{lowest_deg:g} to {highest_deg:g}; `twilight show solvers` lists those that compute twilight"
        )


def chosen_turbidity(
    turbidity: float | None, outside: str, allowed: tuple[float, float], medium: Medium, solver: str
) -> tuple[float, float | None]:
    """(turbidity to use, the turbidity of the medium or None where it was not needed).

    A turbidity that the user sets must be within ``allowed``.  That of the medium is moved to the nearest allowed one
    with a warning, or refused where ``outside`` is "refuse".
    """
    low, high = allowed
    if turbidity is not None:
        if not low <= turbidity <= high:
            raise TwilightError(f"solver.turbidity is {turbidity:g}; the {solver} solver allows {low:g} to {high:g}")
        return turbidity, None
    found = turbidity_of(medium)
    if low <= found <= high:
        return found, found
    name = medium.name or "the medium"
    if outside == "refuse":
        raise TwilightError(
            f"the turbidity of {name} is {found:.3g}; the {solver} solver allows {low:g} to {high:g}: set "
            "solver.turbidity, or solver.outside to nearest"
        )
    taken = low if found < low else high
    warnings.warn(
        f"the turbidity of {name} is {found:.3g}; the {solver} solver takes {taken:g}, the nearest it has",
        TwilightWarning,
        stacklevel=4,
    )
    return taken, found


REFERENCE_NM = 550.0
"""Wavelength of the turbidity [nm]."""


def turbidity_of(medium: Medium) -> float:
    """T = (tau_air + tau_aerosol) / tau_air at 550 nm, vertical optical depths (Preetham 1999 sec. 2.1).

    Absorbing gases do not count; the aerosol counts with its extinction, stratospheric aerosol included.  Between
    sampled wavelengths ln tau goes linearly with ln wavelength; where 550 nm is not between samples the nearest is
    taken there by wavelength^-1.3 (aerosol) and wavelength^-4.08 (air).  Raises TwilightError for a medium without air.
    """
    air = _at_reference(medium.wavelength_nm, medium.optical_depth("air"), RAYLEIGH_EXPONENT)
    if not air > 0:
        raise TwilightError(
            f"{medium.name or 'the medium'}: its air does not scatter, so it has no turbidity; set solver.turbidity"
        )
    return 1.0 + _at_reference(medium.wavelength_nm, medium.optical_depth("aerosol"), ANGSTROM_EXPONENT) / air


def _at_reference(wavelength_nm: np.ndarray, depth: np.ndarray, exponent: float) -> float:
    """Optical depth at 550 nm."""
    inside = wavelength_nm[0] <= REFERENCE_NM <= wavelength_nm[-1]
    if inside and (depth > 0).all():
        return float(np.exp(np.interp(np.log(REFERENCE_NM), np.log(wavelength_nm), np.log(depth))))
    nearest = int(np.argmin(np.abs(wavelength_nm - REFERENCE_NM)))
    return float(depth[nearest] * (wavelength_nm[nearest] / REFERENCE_NM) ** exponent)


def hemisphere(elevations: int = 12, azimuths: int = 24) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Elevation [deg], azimuth [deg] and solid angle [sr] of a product quadrature over the upper hemisphere, (N,).

    Gauss-Legendre in sin(elevation), midpoints in azimuth; exact for polynomials in the sine.
    """
    x, w = np.polynomial.legendre.leggauss(elevations)
    sine, weight = 0.5 * (x + 1.0), 0.5 * w
    azimuth = (np.arange(azimuths) + 0.5) * 360.0 / azimuths
    e, a = np.meshgrid(np.degrees(np.arcsin(sine)), azimuth, indexing="ij")
    solid = np.repeat(weight * 2.0 * np.pi / azimuths, azimuths)
    return e.ravel(), a.ravel(), solid


def sky_and_ground(
    sky: Callable[[np.ndarray, np.ndarray], np.ndarray],
    sunlight: Callable[[], np.ndarray],
    sun_elevation_deg: float,
    albedo: np.ndarray,
    elevation_deg,
    azimuth_deg,
) -> np.ndarray:
    """Sun-normalised radiance [sr^-1], shape of the directions plus (W,), of the sky and, below the horizon, of the
    ground: albedo / pi times the irradiance of sky and sun.

    sky(elevation_deg, azimuth_deg) gives (N, W); sunlight() the direct sunlight at normal incidence over F0, (W,).
    """
    elevation, azimuth = np.broadcast_arrays(np.asarray(elevation_deg, float), np.asarray(azimuth_deg, float))
    e, a = elevation.ravel(), azimuth.ravel()
    out = np.empty((e.size, albedo.size))
    up = e >= 0.0
    out[up] = sky(e[up], a[up])
    if not up.all():
        sky_e, sky_a, solid = hemisphere()
        sine = np.sin(np.radians(sky_e))
        direct = sunlight() * max(np.sin(np.radians(sun_elevation_deg)), 0.0)
        out[~up] = albedo / np.pi * ((solid * sine) @ sky(sky_e, sky_a) + direct)
    return out.reshape(*elevation.shape, albedo.size)
