"""What `import twilight` offers: a sky in one call, or a field that answers for any sun."""

from __future__ import annotations

import itertools
import warnings
from collections.abc import Mapping, Sequence
from datetime import UTC, datetime, timedelta
from typing import Any

import numpy as np

from twilight.config import Config, load
from twilight.engine import Solved, frames
from twilight.engine import solve as solve_config
from twilight.errors import TwilightError, TwilightWarning
from twilight.scene.suns import count_suns
from twilight.sky import Sky


def render(
    scene: Any,
    *,
    sun_elevation_deg: float | Sequence[float] | None = None,
    at: Any = None,
    place: Any = None,
    latitude_deg: float | None = None,
    longitude_deg: float | None = None,
    time_zone: str | None = None,
    altitude_km: float | None = None,
    wavelength_nm: Sequence[float] | None = None,
    solver: str | None = None,
    quality: str | None = None,
    settings: Mapping[str, Any] | None = None,
) -> Sky | list[Sky]:
    """The sky of a climate or configuration (name, file, mapping or `Config`); a list where there are several suns.

    sun_elevation_deg: true elevation(s) of the sun [deg].  Or at: a time with a place; text, datetime, numpy's
    datetime64, pandas' Timestamp or astropy's Time, or several of them at equal steps (a list, a DatetimeIndex).
    place: pvlib's Location (with its altitude and, for times without an offset, its time zone) or astropy's
    EarthLocation (with its height), in place of latitude_deg and longitude_deg [deg, north and east positive].
    time_zone: of times without an offset, e.g. Europe/Berlin.  altitude_km: of the observer, above sea level [km].
    wavelength_nm: increasing [nm].  settings: any other dotted keys, e.g. {"ground.albedo": 0.8}.
    Errors: TwilightError.
    """
    if sun_elevation_deg is not None and at is not None:
        raise TwilightError("render: takes either sun_elevation_deg or at, not both")
    where = _place(place, latitude_deg, longitude_deg, time_zone)
    if at is None and any(value is not None for value in where.values()):
        raise TwilightError("render: a place needs a time: give at")
    chosen: dict[str, Any] = {}
    if sun_elevation_deg is not None:
        several = np.ndim(sun_elevation_deg) > 0
        suns = _numbers(sun_elevation_deg, "sun_elevation_deg")
        chosen["sun"] = {"elevations_deg": suns} if several else {"elevation_deg": suns[0]}
    elif at is not None:
        observer_km = where.pop("altitude_km")
        altitude_km = observer_km if altitude_km is None else altitude_km
        chosen["sun"] = {**_times(at), **{key: value for key, value in where.items() if value is not None}}
    config = _config(scene, chosen, altitude_km, wavelength_nm, solver, quality, settings)
    skies = [frame.sky for frame in frames(config)]
    return skies if count_suns(config) > 1 else skies[0]


def solve(
    scene: Any,
    *,
    sun_elevation_deg: float | Sequence[float] | None = None,
    altitude_km: float | None = None,
    wavelength_nm: Sequence[float] | None = None,
    solver: str | None = None,
    quality: str | None = None,
    settings: Mapping[str, Any] | None = None,
) -> Solved:
    """The solved field of a climate or configuration, to be asked for any direction, and for any sun and observer.

    Its `radiance(sun_elevation_deg, elevation_deg, azimuth_deg, observer_altitude_km)` is sun-normalised [sr^-1], shape
    of the directions plus (W,); `stokes` adds Q and U, `sky` gives a whole `Sky`, `direct` the sun's own light.
    sun_elevation_deg: all the suns that will be asked for [deg], which saves time; None: any.  The sun of the scene
    itself plays no part.  Others: as `render`.
    Errors: TwilightError.
    """
    suns = None if sun_elevation_deg is None else _numbers(sun_elevation_deg, "sun_elevation_deg")
    return solve_config(_config(scene, {}, altitude_km, wavelength_nm, solver, quality, settings), suns)


def _config(
    scene: Any,
    chosen: Mapping[str, Any],
    altitude_km: float | None,
    wavelength_nm: Sequence[float] | None,
    solver: str | None,
    quality: str | None,
    settings: Mapping[str, Any] | None,
) -> Config:
    given: dict[str, Any] = {
        "observer.altitude_km": altitude_km,
        "wavelengths": None if wavelength_nm is None else {"list_nm": _numbers(wavelength_nm, "wavelength_nm")},
        "solver.name": solver,
        "solver.quality": quality,
    }
    keys = {**chosen, **{key: value for key, value in given.items() if value is not None}, **(settings or {})}
    if isinstance(scene, Config):
        if not keys:
            return _own_model(scene)
        scene = scene.model_dump(mode="json", exclude_unset=True)
    return _own_model(load(scene, keys))


def _own_model(config: Config) -> Config:
    """With the compact model of its own air, fitted first where there is none, for scenes that ask for that solver."""
    if config.solver.get("name") != "compact":
        return config
    from twilight.fit.compact.own import with_own_model

    return with_own_model(config, say=lambda sentence: warnings.warn(sentence, TwilightWarning, stacklevel=5))


def _numbers(values: Any, name: str) -> list[float]:
    try:
        return [float(value) for value in np.atleast_1d(values)]
    except (TypeError, ValueError):
        raise TwilightError(f"{name}: must be a number or a list of numbers, got {values!r}") from None


def _place(
    place: Any, latitude_deg: float | None, longitude_deg: float | None, time_zone: str | None
) -> dict[str, Any]:
    """latitude_deg, longitude_deg, time_zone and altitude_km; None for what is not known."""
    altitude_km = None
    if place is not None:
        if latitude_deg is not None or longitude_deg is not None:
            raise TwilightError("render: takes either place or latitude_deg and longitude_deg, not both")
        if hasattr(place, "latitude") and hasattr(place, "longitude"):  # pvlib
            latitude_deg, longitude_deg = float(place.latitude), float(place.longitude)
            altitude_km = float(getattr(place, "altitude", None) or 0.0) / 1e3
            time_zone = time_zone or str(place.tz)
        elif hasattr(place, "to_geodetic"):  # astropy
            found = place.to_geodetic()
            latitude_deg, longitude_deg = float(found.lat.deg), float(found.lon.deg)
            altitude_km = float(found.height.to_value("km"))
        else:
            raise TwilightError(
                f"place: must be pvlib's Location or astropy's EarthLocation, got {type(place).__name__}"
            )
        # at sea level, or below it by the rounding of an ellipsoid: on the ground of the scene
        altitude_km = round(altitude_km, 6) if altitude_km >= 1e-3 else None
    return {
        "latitude_deg": latitude_deg,
        "longitude_deg": longitude_deg,
        "time_zone": time_zone,
        "altitude_km": altitude_km,
    }


def _times(at: Any) -> dict[str, Any]:
    """The keys of a `sun` section for one time or for several."""
    if getattr(at, "isscalar", None) is False or not (isinstance(at, str) or np.ndim(at) == 0):
        moments = [_moment(one) for one in at]
        if len(moments) == 1:
            return {"at": moments[0]}
        try:
            steps = [b - a for a, b in itertools.pairwise(moments)]
        except TypeError:
            raise TwilightError("at: several times must be datetimes, all with or all without an offset") from None
        if not steps or min(steps) <= timedelta(0) or max(steps) - min(steps) > timedelta(milliseconds=1):
            raise TwilightError("at: several times must be in order and equally far from each other; others one by one")
        minutes = (moments[-1] - moments[0]).total_seconds() / len(steps) / 60.0
        return {"start": moments[0].isoformat(), "stop": moments[-1].isoformat(), "step_minutes": minutes}
    moment = _moment(at)
    return {"at": moment if isinstance(moment, str) else moment.isoformat()}


def _moment(at: Any) -> Any:
    """A time as a datetime; text as it is."""
    if hasattr(at, "to_datetime") and hasattr(at, "scale"):  # astropy's Time
        return at.utc.to_datetime(timezone=UTC)
    if isinstance(at, np.datetime64):
        return at.astype("datetime64[us]").item()
    if isinstance(at, datetime):
        # pandas' Timestamp is one, with nanoseconds
        return datetime.fromisoformat(at.isoformat(timespec="microseconds"))
    return str(at)
