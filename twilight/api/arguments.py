"""Arguments of `twilight`'s functions: scenes, times and places of several libraries, and their types."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from datetime import UTC, datetime, tzinfo
from os import PathLike
from typing import TYPE_CHECKING, Any, Literal, NamedTuple, Protocol, TypedDict, Union, cast

import numpy as np
from numpy.typing import ArrayLike, NDArray

from twilight.base.arguments import plain
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


def numbers(values: object, name: str) -> list[float]:
    """A number or several as a list; `name`: of the argument, for the TwilightError."""
    return np.atleast_1d(plain(values, name)).astype(float).ravel().tolist()


class GivenPlace(NamedTuple):
    """What a call says of a place; None: nothing.  Latitude and longitude [deg] are north and east positive."""

    latitude_deg: Any
    longitude_deg: Any
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
        if hasattr(place, "latitude") and hasattr(place, "longitude"):  # pvlib
            location = cast(PvlibLocation, place)
            latitude_deg, longitude_deg = location.latitude, location.longitude
            altitude_km = _one(getattr(location, "altitude", None) or 0.0, "place") / 1e3
            time_zone = time_zone or str(location.tz)
        elif hasattr(place, "to_geodetic"):  # astropy
            geodetic = cast(AstropyLocation, place).to_geodetic()
            latitude_deg, longitude_deg = geodetic.lat, geodetic.lon  # type: ignore[assignment]
            altitude_km = _one(geodetic.height.to_value("km"), "place")
        elif isinstance(place, tuple | list | np.ndarray) and len(place) == 2:
            latitude_deg, longitude_deg = place
        else:
            raise TwilightError(
                "place: must be (latitude, longitude), pvlib's Location or astropy's EarthLocation, "
                f"got {type(place).__name__}"
            )
        latitude_deg, longitude_deg = (_one(angle, "place", "deg") for angle in (latitude_deg, longitude_deg))
        if not (-90.0 <= latitude_deg <= 90.0 and -180.0 <= longitude_deg <= 360.0):
            raise TwilightError(
                f"place: ({latitude_deg:g}, {longitude_deg:g}) is not a latitude from -90 to 90 and a longitude from "
                "-180 to 360"
            )
        if altitude_km is not None:
            # at sea level, or below it by the rounding of an ellipsoid: on the ground of the scene
            altitude_km = round(altitude_km, 6) if altitude_km >= 1e-3 else None
    return GivenPlace(latitude_deg, longitude_deg, time_zone, altitude_km)


def _one(value: object, name: str, unit: str | None = None) -> float:
    """One number; TwilightError for several."""
    number = plain(value, name, unit)
    if np.ndim(number):
        raise TwilightError(f"{name}: must have one number for each coordinate, got {np.size(number)}")
    return float(number)


def places_of(place: object, time_zone: str | None) -> tuple[bool, list[GivenPlace]]:
    """Whether there are several places, and each: in a list, in rows of an array, or as (latitudes, longitudes).

    A tuple of two pairs is two places.  Errors: TwilightError for two lists of two numbers, which may be either.
    """
    given: Any = place
    if given is None:
        raise TwilightError("place: none is given")
    if not isinstance(given, Iterable) or isinstance(given, str | Mapping) or getattr(given, "isscalar", False):
        return False, [place_of(given, time_zone=time_zone)]
    items = list(given)
    if len(items) == 2 and not any(_is_place(item) for item in items):
        if not any(isinstance(item, list | tuple) or getattr(item, "ndim", 0) for item in items):
            return False, [place_of(tuple(items), time_zone=time_zone)]
        if isinstance(given, tuple) and not all(isinstance(item, tuple) for item in items):
            columns = [np.atleast_1d(plain(item, "place", "deg")) for item in items]
            if columns[0].shape != columns[1].shape or columns[0].ndim != 1:
                raise TwilightError("place: latitudes and longitudes must be as many as each other")
            if columns[0].size == 2 and any(isinstance(item, list) for item in items):
                raise TwilightError(
                    "place: two lists of two numbers may be two places or latitudes and longitudes; give "
                    "[(latitude, longitude), ...], or arrays of numpy's"
                )
            items = list(zip(*(column.tolist() for column in columns), strict=True))
    if not items:
        raise TwilightError("place: none is given")
    return True, [place_of(item, time_zone=time_zone) for item in items]


def _is_place(value: object) -> bool:
    return hasattr(value, "latitude") or hasattr(value, "to_geodetic")


def times_of(at: TimeLike | TimesLike, name: str = "time") -> tuple[bool, list[datetime | str]]:
    """Whether there are several times, and each as a datetime; text stays text.  `name`: of the argument.

    Errors: TwilightError for NaT, what is masked, and more than one dimension.
    """
    given: Any = at
    if hasattr(given, "dims") or hasattr(given, "dask"):
        given = np.asarray(given)
    mask = getattr(given, "mask", None)
    if mask is not None and not callable(mask) and np.any(mask):
        raise TwilightError(f"{name}: holds masked times; leave them out")
    shape = getattr(given, "shape", None)
    several = isinstance(given, Iterable) and not isinstance(given, str | datetime)
    dimensions = int(several) if shape is None else len(shape)
    if dimensions > 1:
        raise TwilightError(f"{name}: times must have one dimension, got {dimensions}")
    return dimensions == 1, [_moment(one, name) for one in (given if dimensions else [given])]


def _moment(at: Any, name: str) -> datetime | str:
    if hasattr(at, "dims") or isinstance(at, np.ndarray):
        at = np.asarray(at)[()]
    try:
        if hasattr(at, "to_datetime") and hasattr(at, "scale"):  # astropy's Time
            at = at.utc.to_datetime(timezone=UTC)
        elif isinstance(at, np.datetime64):
            at = at.astype("datetime64[us]").item()
        missing = at is None or at is np.ma.masked or bool(at != at)  # NaT is not itself
    except (TypeError, ValueError, OverflowError) as error:
        raise TwilightError(f"{name}: {' '.join(str(at).split())[:60]} is no time ({error})") from None
    if missing or isinstance(at, int):
        raise TwilightError(f"{name}: holds {'a time that is missing (NaT)' if missing else f'{at}, which is no time'}")
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
    latitude_deg: Any
    longitude_deg: Any
    time_zone: str | None
    altitude_km: float | None
    wavelength_nm: Sequence[float] | NDArray[np.float64] | None
    solver: str | None
    quality: str | None
    settings: Mapping[str, object] | None
