"""Types of the arguments that `twilight` takes: scenes, times and places of several libraries."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from datetime import datetime, tzinfo
from os import PathLike
from typing import TYPE_CHECKING, Literal, Protocol, TypedDict, Union

import numpy as np
from numpy.typing import ArrayLike, NDArray

from twilight.base.progress import Progress
from twilight.engine.surfaces import Direction, Surface

if TYPE_CHECKING:
    from twilight.config import Config


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
"""What light is asked of; text is read by `twilight.engine.surfaces`."""
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
