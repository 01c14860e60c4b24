"""Checks that both kinds of compact models share: observers, suns, directions, wavelengths; grids of directions."""

from __future__ import annotations

import numpy as np

from twilight.atmosphere.medium import Medium
from twilight.base.errors import TwilightError
from twilight.solvers.base import observer_at


def checked_observer(medium: Medium, altitude_km: float | None, highest_km: float) -> float:
    """The altitude of an observer [km], the ground's where it is None; TwilightError for one that the model lacks.

    highest_km: above the ground
    """
    altitude = observer_at(medium, altitude_km, medium.bottom_km)
    high = medium.bottom_km + highest_km
    if altitude > high:
        raise TwilightError(
            f"the compact solver knows the sky of observers up to {highest_km:g} km above the ground: "
            f"observer.altitude_km is {altitude:g}, allowed is {medium.bottom_km:g} to {high:g}"
        )
    return altitude


def check_medium(medium: Medium, model: str, lowest_nm: float, highest_nm: float) -> None:
    """TwilightError for wavelengths outside a model's.

    model: in the words of messages
    """
    outside = medium.wavelength_nm[(medium.wavelength_nm < lowest_nm) | (medium.wavelength_nm > highest_nm)]
    if outside.size:
        raise TwilightError(
            f"{model} has wavelengths from {lowest_nm:g} to {highest_nm:g} nm, and {outside[0]:g} nm is asked for"
        )


def checked_directions(
    sun_elevation_deg: float, suns_deg: np.ndarray, elevation_deg, azimuth_deg
) -> tuple[np.ndarray, np.ndarray]:
    """Elevations and azimuths of one shape [deg]; TwilightError below the horizon, and for a sun beyond the model's
    increasing suns_deg."""
    low, high = suns_deg[[0, -1]]
    if not low <= sun_elevation_deg <= high:
        raise TwilightError(
            f"sun.elevation_deg is {sun_elevation_deg:g}; the compact solver allows {low:g} to {high:g}"
        )
    elevation, azimuth = np.broadcast_arrays(np.asarray(elevation_deg, float), np.asarray(azimuth_deg, float))
    if elevation.size and not (elevation.min() >= 0.0 and elevation.max() <= 90.0):
        raise TwilightError("the compact solver knows the sky above the horizon only: elevations from 0 to 90 deg")
    return elevation, azimuth


def rows_and_columns(elevation: np.ndarray, azimuth: np.ndarray) -> tuple[np.ndarray, np.ndarray] | None:
    """Elevations (E,) of the rows and azimuths (A,) of the columns of directions (E, A) that are a grid; None: they are
    not."""
    if elevation.ndim != 2 or not elevation.size:
        return None
    rows, columns = elevation[:, :1], azimuth[:1]
    return (rows[:, 0], columns[0]) if (elevation == rows).all() and (azimuth == columns).all() else None
