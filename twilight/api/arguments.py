"""What arguments mean: scenes, places and times of several libraries."""

from __future__ import annotations

from collections.abc import Mapping
from datetime import UTC, datetime
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from twilight.api.types import SceneLike
from twilight.base.errors import TwilightError
from twilight.config import Config, load


def config_of(
    scene: SceneLike,
    chosen: Mapping[str, Any],
    altitude_km: float | None,
    wavelength_nm: ArrayLike | None,
    solver: str | None,
    quality: str | None,
    settings: Mapping[str, object] | None,
) -> Config:
    given: dict[str, Any] = {
        "observer.altitude_km": altitude_km,
        "wavelengths": None if wavelength_nm is None else {"list_nm": numbers(wavelength_nm, "wavelength_nm")},
        "solver.name": solver,
        "solver.quality": quality,
    }
    keys = {**chosen, **{key: value for key, value in given.items() if value is not None}, **(settings or {})}
    if isinstance(scene, Config):
        if not keys:
            return scene
        return load(scene.model_dump(mode="json", exclude_unset=True), keys)
    return load(scene if isinstance(scene, Mapping) else str(scene), keys)


def numbers(values: ArrayLike, name: str) -> list[float]:
    try:
        return [float(value) for value in np.atleast_1d(values)]
    except (TypeError, ValueError):
        raise TwilightError(f"{name}: must be a number or a list of numbers, got {values!r}") from None


def place_of(
    place: Any, latitude_deg: float | None, longitude_deg: float | None, time_zone: str | None
) -> dict[str, Any]:
    """latitude_deg, longitude_deg, time_zone and altitude_km; None for what is not known."""
    altitude_km = None
    if place is not None:
        if latitude_deg is not None or longitude_deg is not None:
            raise TwilightError("render: takes either place or latitude_deg and longitude_deg, not both")
        if isinstance(place, tuple | list) and len(place) == 2:
            latitude_deg, longitude_deg = numbers(place, "place")
        elif hasattr(place, "latitude") and hasattr(place, "longitude"):  # pvlib
            latitude_deg, longitude_deg = float(place.latitude), float(place.longitude)
            altitude_km = float(getattr(place, "altitude", None) or 0.0) / 1e3
            time_zone = time_zone or str(place.tz)
        elif hasattr(place, "to_geodetic"):  # astropy
            found = place.to_geodetic()
            latitude_deg, longitude_deg = float(found.lat.deg), float(found.lon.deg)
            altitude_km = float(found.height.to_value("km"))
        else:
            raise TwilightError(
                "place: must be (latitude, longitude), pvlib's Location or astropy's EarthLocation, "
                f"got {type(place).__name__}"
            )
        if altitude_km is not None:
            # at sea level, or below it by the rounding of an ellipsoid: on the ground of the scene
            altitude_km = round(altitude_km, 6) if altitude_km >= 1e-3 else None
    return {
        "latitude_deg": latitude_deg,
        "longitude_deg": longitude_deg,
        "time_zone": time_zone,
        "altitude_km": altitude_km,
    }


def moment_of(at: Any) -> Any:
    """A time as a datetime; text as it is."""
    if hasattr(at, "to_datetime") and hasattr(at, "scale"):  # astropy's Time
        return at.utc.to_datetime(timezone=UTC)
    if isinstance(at, np.datetime64):
        return at.astype("datetime64[us]").item()
    if isinstance(at, datetime):
        # pandas' Timestamp is one, with nanoseconds
        return datetime.fromisoformat(at.isoformat(timespec="microseconds"))
    return str(at)
