"""What skies that are formulae share: which suns, observers and turbidities they refuse, the turbidity of a medium, and
the Lambertian ground below an observer who stands on it.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable

import numpy as np

from twilight.atmosphere.medium import Medium
from twilight.base.errors import TwilightError, TwilightWarning
from twilight.solvers.analytic.daylight import ANGSTROM_EXPONENT, RAYLEIGH_EXPONENT

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
