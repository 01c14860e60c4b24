"""Air-mass factors and derivatives of a solved scene, as methods of `twilight.Solved`."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from numpy.typing import ArrayLike

from twilight.engine import Solved
from twilight.solvers.base import DIFFERENTIATED
from twilight.studies.airmass import factors

if TYPE_CHECKING:
    from xarray import Dataset


def airmass(
    self: Solved,
    sun_elevation_deg: ArrayLike,
    elevation_deg: ArrayLike,
    azimuth_deg: ArrayLike,
    *,
    edges_km: ArrayLike | None = None,
    observer_altitude_km: float | None = None,
) -> Dataset:
    """Box air-mass factors, -d ln(radiance) / d(vertical optical depth of absorption in a layer).

    Parameters
    ----------
    sun_elevation_deg
        True elevation of the sun [deg]; a list gives a dimension `sun_elevation`.
    elevation_deg, azimuth_deg
        Of the lines of sight [deg], azimuth from the sun; lists, broadcast, give a dimension `direction`.
    edges_km
        Altitudes [km] that bound the layers, increasing, within the air; None: 15 layers up to 70 km.
    observer_altitude_km
        Above sea level [km]; None: the scene's observer.

    Returns
    -------
    xarray.Dataset
        `box_air_mass_factor` over sun_elevation, direction, altitude (of the layers' middles) and wavelength, nan where
        there is no light; `standard_error` from a solver that estimates it.

    Raises
    ------
    TwilightError
        For a solver that cannot differentiate, wavelengths in bands of oxygen or water vapour, and layers outside the
        air.
    """
    return factors.box_factors(
        self,
        sun_elevation_deg,
        elevation_deg,
        azimuth_deg,
        edges_km=edges_km,
        observer_altitude_km=observer_altitude_km,
    )


def jacobian(
    self: Solved,
    sun_elevation_deg: ArrayLike,
    elevation_deg: ArrayLike,
    azimuth_deg: ArrayLike,
    *,
    by: str | Sequence[str] = tuple(DIFFERENTIATED),
    edges_km: ArrayLike | None = None,
    observer_altitude_km: float | None = None,
) -> Dataset:
    """Derivatives of ln(radiance).

    Parameters
    ----------
    sun_elevation_deg, elevation_deg, azimuth_deg, edges_km, observer_altitude_km
        As of `airmass`.
    by
        One or more of absorption (vertical optical depth of a layer), aerosol_extinction (the same of aerosol, whose
        albedo and phase functions stay), aerosol_albedo (single scattering albedo in a layer), aerosol_asymmetry
        (asymmetry parameter in a layer, every phase function P becoming P (1 + eps (mu - g)), or Henyey-Greenstein's of
        the larger g), temperature [K^-1] (at every altitude pressure and the number densities of absorbing gases stay;
        air's density, refractive index and cross sections change), ozone_column [DU^-1], ground_albedo.

    Returns
    -------
    xarray.Dataset
        A variable for each quantity, over sun_elevation, direction, altitude and wavelength; ozone_column and
        ground_albedo have no altitude.

    Raises
    ------
    TwilightError
        For a quantity that the solver cannot differentiate, and as `airmass`.
    """
    return factors.jacobian(
        self,
        sun_elevation_deg,
        elevation_deg,
        azimuth_deg,
        by=by,
        edges_km=edges_km,
        observer_altitude_km=observer_altitude_km,
    )
