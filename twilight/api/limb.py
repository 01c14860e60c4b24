"""Limb radiance of a solved scene, as a method of `twilight.Solved`."""

from __future__ import annotations

from typing import TYPE_CHECKING

from numpy.typing import ArrayLike

from twilight.engine import Solved

if TYPE_CHECKING:
    from xarray import Dataset


def limb(
    self: Solved,
    tangent_km: ArrayLike,
    sun_elevation_deg: float,
    azimuth_deg: float = 90.0,
    *,
    observer_altitude_km: float = 600.0,
    field_of_view_km: float | None = None,
    field_of_view_shape: str = "box",
    air_mass: bool = False,
    edges_km: ArrayLike | None = None,
) -> Dataset:
    """Limb radiance against tangent altitude, seen from above the air.

    Parameters
    ----------
    tangent_km : (T,) or one
        Apparent tangent altitudes [km]: lowest points of the straight lines of sight.
    sun_elevation_deg, azimuth_deg
        True elevation of the sun, and azimuth of the line of sight from it, at the straight line's tangent point [deg].
        The observer's own sun follows from them for each line, and stays within a field of view.
    observer_altitude_km
        Above sea level [km]; above the air.
    field_of_view_km, field_of_view_shape
        Width in tangent altitude [km] over which light is a mean: of a `box`, or of a `gaussian` at half maximum; None:
        a line of sight.
    air_mass
        Add `box_air_mass_factor`, -d ln(radiance) / d(vertical optical depth of absorption in a layer).
    edges_km
        Altitudes [km] that bound its layers; None: 15 layers up to 70 km.

    Returns
    -------
    xarray.Dataset
        Over apparent_tangent_altitude and wavelength: `sun_normalised_radiance` [sr^-1], its `standard_error` from a
        solver that estimates it, `radiance` [W m^-2 sr^-1 nm^-1] at 1 au; tangent_altitude [km] of the bent rays.

    Raises
    ------
    TwilightError
        For an observer within the air, tangent altitudes outside it, and a solver that does not look down or, for
        air-mass factors, cannot differentiate.
    """
    from twilight.studies.limb.limb import limb_of  # start-up

    return limb_of(
        self,
        tangent_km,
        sun_elevation_deg,
        azimuth_deg,
        observer_altitude_km=observer_altitude_km,
        field_of_view_km=field_of_view_km,
        field_of_view_shape=field_of_view_shape,
        air_mass=air_mass,
        edges_km=edges_km,
    )
