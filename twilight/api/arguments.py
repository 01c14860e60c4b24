"""Arguments of `twilight`'s functions: scenes, times and places of several libraries, and their types."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from datetime import UTC, datetime, tzinfo
from os import PathLike
from typing import TYPE_CHECKING, Any, Literal, NamedTuple, Protocol, TypedDict, Union, cast

import numpy as np
from numpy.typing import ArrayLike, NDArray

from twilight.base.errors import TwilightError
from twilight.base.progress import Progress
from twilight.config import Config, load
from twilight.sky.surfaces import Direction, Surface

if TYPE_CHECKING:
    from twilight.config import Config


def config_of(
    scene: SceneLike,
    chosen: Mapping[str, object] | None = None,
    altitude_km: float | None = None,
    wavelength_nm: ArrayLike | None = None,
    solver: str | None = None,
    quality: str | None = None,
    settings: Mapping[str, object] | None = None,
) -> Config:
    """The configuration of a scene with what a call gives in place of its keys; chosen: by dotted keys."""
    given: dict[str, object] = {
        "observer.altitude_km": altitude_km,
        "wavelengths": None if wavelength_nm is None else {"list_nm": numbers(wavelength_nm, "wavelength_nm")},
        "solver.name": solver,
        "solver.quality": quality,
    }
    keys = {**(chosen or {}), **{key: value for key, value in given.items() if value is not None}, **(settings or {})}
    if isinstance(scene, Config):
        if not keys:
            return scene
        return load(scene.model_dump(mode="json", exclude_unset=True), keys)
    return load(scene if isinstance(scene, Mapping) else str(scene), keys)


def numbers(values: ArrayLike, name: str) -> list[float]:
    """A number or several as a list; `name`: of the argument, for the TwilightError."""
    try:
        return [float(value) for value in np.atleast_1d(values)]
    except (TypeError, ValueError):
        raise TwilightError(f"{name}: must be a number or a list of numbers, got {values!r}") from None


class GivenPlace(NamedTuple):
    """What a call says of a place; None: nothing.  Latitude and longitude [deg] are north and east positive."""

    latitude_deg: float | None
    longitude_deg: float | None
    time_zone: str | None
    altitude_km: float | None


def place_of(
    place: PlaceLike | None,
    latitude_deg: float | None = None,
    longitude_deg: float | None = None,
    time_zone: str | None = None,
) -> GivenPlace:
    """A place of any library.  Errors: TwilightError for what is none, and for one that is given twice."""
    altitude_km = None
    if place is not None:
        if latitude_deg is not None or longitude_deg is not None:
            raise TwilightError("render: takes either place or latitude_deg and longitude_deg, not both")
        if isinstance(place, tuple | list) and len(place) == 2:
            latitude_deg, longitude_deg = numbers(place, "place")
        elif hasattr(place, "latitude") and hasattr(place, "longitude"):  # pvlib
            location = cast(PvlibLocation, place)
            latitude_deg, longitude_deg = float(location.latitude), float(location.longitude)
            altitude_km = float(getattr(location, "altitude", None) or 0.0) / 1e3
            time_zone = time_zone or str(location.tz)
        elif hasattr(place, "to_geodetic"):  # astropy
            geodetic = place.to_geodetic()
            latitude_deg, longitude_deg = float(geodetic.lat.to_value("deg")), float(geodetic.lon.to_value("deg"))
            altitude_km = float(geodetic.height.to_value("km"))
        else:
            raise TwilightError(
                "place: must be (latitude, longitude), pvlib's Location or astropy's EarthLocation, "
                f"got {type(place).__name__}"
            )
        if altitude_km is not None:
            # at sea level, or below it by the rounding of an ellipsoid: on the ground of the scene
            altitude_km = round(altitude_km, 6) if altitude_km >= 1e-3 else None
    return GivenPlace(latitude_deg, longitude_deg, time_zone, altitude_km)


def times_of(at: TimeLike | TimesLike) -> tuple[bool, list[datetime | str]]:
    """Whether there are several times, and each as a datetime; text stays text."""
    several = getattr(at, "isscalar", None) is False or not (isinstance(at, str) or np.ndim(cast(Any, at)) == 0)
    return several, [_moment(one) for one in cast(Iterable[TimeLike], at if several else [at])]


def _moment(at: TimeLike) -> datetime | str:
    if hasattr(at, "to_datetime") and hasattr(at, "scale"):  # astropy's Time
        return cast(AstropyTime, at).utc.to_datetime(timezone=UTC)
    if isinstance(at, np.datetime64):
        return at.astype("datetime64[us]").item()
    if isinstance(at, datetime):
        # pandas' Timestamp is one, with nanoseconds
        return datetime.fromisoformat(at.isoformat(timespec="microseconds"))
    return str(at)


class AstropyTime(Protocol):
    """`astropy.time.Time`: one time or several."""

    @property
    def scale(self) -> str: ...
    @property
    def isscalar(self) -> bool: ...
    @property
    def utc(self) -> AstropyTime: ...
    def to_datetime(self, timezone: tzinfo) -> datetime: ...


class AstropyQuantity(Protocol):
    """`astropy.units.Quantity` or `astropy.coordinates.Angle`."""

    def to_value(self, unit: str) -> np.ndarray: ...


class AstropyAltAz(Protocol):
    """`astropy.coordinates.SkyCoord` or `AltAz` as seen from a place."""

    alt: AstropyQuantity
    az: AstropyQuantity


class AstropyGeodetic(Protocol):
    """What `astropy.coordinates.EarthLocation.to_geodetic` gives."""

    lon: AstropyQuantity
    lat: AstropyQuantity
    height: AstropyQuantity


class PvlibLocation(Protocol):
    """`pvlib.location.Location`."""

    latitude: float
    longitude: float
    altitude: float
    tz: object


class AstropyLocation(Protocol):
    """`astropy.coordinates.EarthLocation`."""

    def to_geodetic(self) -> AstropyGeodetic: ...


SceneLike = Union[str, PathLike[str], Mapping[str, object], "Config"]
"""A climate or a configuration: its name, its file, the same as a mapping, or a `Config`."""
TimeLike = str | datetime | np.datetime64 | AstropyTime
"""One time; pandas' Timestamp is a datetime."""
TimesLike = Sequence[str] | Sequence[datetime] | NDArray[np.datetime64] | Iterable[datetime] | AstropyTime
"""Several times in their order; pandas' DatetimeIndex is an iterable of datetimes."""
PlaceLike = tuple[float, float] | PvlibLocation | AstropyLocation
"""(latitude, longitude) [deg], north and east positive, or a place of pvlib's or astropy's."""
AnglesLike = ArrayLike | AstropyQuantity
"""Angles [deg], or astropy's with their unit; xarray's DataArray is an array."""
Target = str | Direction | Surface
"""What light is asked of; text is read by `twilight.sky.surfaces`."""
TargetsLike = Target | Sequence[Target] | tuple[AnglesLike, AnglesLike] | AstropyAltAz
"""One target or several, or the elevations and azimuths of directions."""


class PlotOptions(TypedDict, total=False):
    """Arguments of `Sky.plot` beside projection and axes."""

    azimuth_deg: float
    width: int | None
    exposure: float | Literal["auto"]
    tone_mapping: str
    observer: str


class LightOptions(TypedDict, total=False):
    """Arguments of `twilight.light` that do not change the type of what it returns."""

    sources: Sequence[str] | None
    time_zone: str | None
    altitude_km: float | None
    quality: str | None
    settings: Mapping[str, object] | None
    progress: Progress | None


class RenderOptions(TypedDict, total=False):
    """Arguments of `twilight.render` beside the scene and the suns."""

    place: PlaceLike | None
    latitude_deg: float | None
    longitude_deg: float | None
    time_zone: str | None
    altitude_km: float | None
    wavelength_nm: Sequence[float] | NDArray[np.float64] | None
    solver: str | None
    quality: str | None
    settings: Mapping[str, object] | None
