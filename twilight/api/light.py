"""`light`: what shines on a direction or a surface at a place and a time, in the unit of a trade."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from datetime import UTC, datetime
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from twilight.api.arguments import config_of, moment_of, numbers, place_of
from twilight.api.types import PlaceLike, SceneLike, TimeLike, TimesLike
from twilight.base.errors import TwilightError
from twilight.engine.light import LightField, Moments, moments_at, spectra_arguments
from twilight.engine.light_setup import field_for
from twilight.engine.surfaces import Surface
from twilight.engine.towards import Direction, towards
from twilight.sky.ephemeris import parse_time
from twilight.sky.quantities.catalogue import Of, Quantity, check_of, quantity, unit_of
from twilight.sky.quantities.measure import Spectra
from twilight.sky.twilight_times import time_of

if TYPE_CHECKING:
    import xarray

Target = str | Direction | Surface
Returned = Literal["xarray", "pandas", "astropy"]
AT_ONCE = 20_000
"""Directions times moments whose spectra are held at once."""


def light(
    place: PlaceLike | Sequence[PlaceLike],
    time: TimeLike | TimesLike,
    towards: Target | Sequence[Target] | tuple[Any, Any] = "zenith",
    quantity: str | Quantity | Sequence[str | Quantity] = "V",
    climate: SceneLike = "continental-average",
    *,
    sources: Sequence[str] | None = None,
    time_zone: str | None = None,
    altitude_km: float | None = None,
    quality: str | None = None,
    settings: Mapping[str, object] | None = None,
    returns: Returned = "xarray",
) -> Any:
    """The light of directions or surfaces at places and times: sun, sky, moon, night and ground.

    The field of the climate is solved once for all suns and kept in the user's cache, with the tables of its skies;
    what follows takes milliseconds.  Tables are within 0.4 % of the field, 0.1 % on surfaces; few lines of sight,
    fewer than the tables would take, are computed one by one.

    Parameters
    ----------
    place
        (latitude, longitude) [deg], north and east positive; pvlib's Location or astropy's EarthLocation; or several.
    time
        As of `twilight.render`, or an event such as "2026-06-21 civil dusk"; several give the dimension `time`.
    towards
        A direction: "zenith", "30/180" (elevation and azimuth from north [deg]), "5/sun+90" (azimuth from the sun), a
        pair of arrays (elevation, azimuth; numbers, astropy's angles, or DataArrays along `time`), astropy's AltAz.
        A surface: "horizontal", "plane:35/180" (tilt and azimuth that it faces), "sphere" (actinic flux), "cylinder"
        (mean of upright planes); or a `Direction` or `Surface`.  A list gives the dimension `direction` or `surface`.
    quantity
        A name of `docs/quantities.md`: V, g, luminance, illuminance, melanopic, cct ...; or several.
    climate
        Name or file of a climate or configuration, the same as a mapping, or a `Config`.
    sources
        Some of sun, sky, moon, airglow, stars, zodiacal_light, light_pollution (of `night.light_pollution` alone) and
        ground (which the chosen ones light); None: all.  A direction never sees the discs of sun and moon.
    time_zone
        Of times without an offset, e.g. Europe/Berlin.
    altitude_km
        Of the observer, above sea level [km].
    quality, settings
        As of `twilight.render`.
    returns
        xarray; pandas (a Series along the times that were given, a DataFrame for several quantities or targets);
        astropy (a Quantity).

    Returns
    -------
    xarray.DataArray, xarray.Dataset, pandas.Series, pandas.DataFrame or astropy.units.Quantity
        A dataset (a mapping, for astropy) where several quantities are asked for.  Dimensions `place`, `time` (UTC),
        `direction` or `surface`, those of which there are several.

    Raises
    ------
    TwilightError
        For what is not allowed, a quantity that a target does not have, and a band that cannot be covered.

    Examples
    --------
    >>> twilight.light((28.3, -16.5), "2026-03-20 nautical dusk", "zenith", ["V", "luminance"])
    >>> twilight.light((52.5, 13.4), times, "plane:90/180", "illuminance", "urban", returns="pandas")
    """
    names = [quantity] if isinstance(quantity, str | Quantity) else list(quantity)
    found = [_quantity(name) for name in names]
    several_places, latitude, longitude, zone, height = _places(place, time_zone)
    several_times, times = _times(time, latitude[0], longitude[0], zone)
    aim = _Aim.read(towards)
    for one in found:
        check_of(one, aim.of)
    altitude_km = height if altitude_km is None else altitude_km
    field = light_field(climate, found, altitude_km, quality, settings)
    count = len(times)
    moments = moments_at(
        np.repeat(latitude, count).tolist(),
        np.repeat(longitude, count).tolist(),
        list(times) * len(latitude),
        field.solved.scene.altitude_km,
    )
    values = _values(field, moments, aim, found, sources, count)
    dims = {"place": (len(latitude), several_places), "time": (count, several_times), aim.of: (aim.size, aim.several)}
    shape = [size for size, several in dims.values() if several]
    kept = [name for name, (_, several) in dims.items() if several]
    arrays = {one.variable: values[i].reshape(shape) for i, one in enumerate(found)}
    if returns == "astropy":
        from twilight.api.foreign import quantities_of  # optional

        return quantities_of(arrays, found, aim.of)
    made = _dataset(arrays, found, aim, kept, latitude, longitude, times, moments, field)
    if returns == "pandas":
        from twilight.api.foreign import frame_of  # start-up

        return frame_of(made, time, [one.variable for one in found], zone)
    if returns != "xarray":
        raise TwilightError(f"light: returns is '{returns}'; allowed is xarray, pandas, astropy")
    return made[found[0].variable] if isinstance(quantity, str | Quantity) else made


def light_field(
    climate: SceneLike,
    quantities: Sequence[Quantity],
    altitude_km: float | None = None,
    quality: str | None = None,
    settings: Mapping[str, object] | None = None,
) -> LightField:
    """The solved field of a climate at wavelengths that cover quantities, with a night; kept for the next call.

    A configuration that says its wavelengths keeps them.
    Errors: TwilightError for a quantity that they do not cover.
    """
    config = config_of(climate, {}, altitude_km, None, None, quality, settings)
    return field_for(config, quantities)


class _Aim:
    """Directions or surfaces: `of`, size D, whether there are `several`, and what labels them."""

    def __init__(
        self,
        of: Of,
        size: int,
        several: bool,
        labels: Mapping[str, Any],
        surfaces: Sequence[Surface] = (),
        elevation: Any = None,
        azimuth: Any = None,
        from_sun: Any = False,
    ):
        self.of, self.size, self.several, self.labels, self.surfaces = of, size, several, labels, surfaces
        self.elevation, self.azimuth, self.from_sun = elevation, azimuth, from_sun

    @classmethod
    def read(cls, target: Any) -> _Aim:
        if hasattr(target, "alt") and hasattr(target, "az"):  # astropy's AltAz
            target = (target.alt, target.az)
        pair = isinstance(target, tuple) and len(target) == 2 and not any(_is_target(t) for t in target)
        if pair:
            return cls._of_angles(*(_degrees(values) for values in target))
        several = isinstance(target, list | tuple)
        chosen = [towards(t) if isinstance(t, str) else t for t in (target if several else [target])]
        if all(isinstance(t, Surface) for t in chosen) and chosen:
            names = [str(t) for t in target] if several else [str(target)]
            return cls("surface", len(chosen), several, {"surface": names}, chosen)  # type: ignore[arg-type]
        if all(isinstance(t, Direction) for t in chosen) and chosen:
            elevation, azimuth = (np.array([getattr(t, f"{x}_deg") for t in chosen]) for x in ("elevation", "azimuth"))
            from_sun = np.array([t.from_sun for t in chosen])
            labels = {"elevation": elevation, "azimuth": azimuth}
            return cls("direction", len(chosen), several, labels, (), elevation, azimuth, from_sun)
        raise TwilightError("towards: must be directions or surfaces, not both and nothing else; see twilight.light")

    @classmethod
    def _of_angles(cls, elevation: Any, azimuth: Any) -> _Aim:
        along = [getattr(values, "dims", None) for values in (elevation, azimuth)]
        if any(dims is not None and "time" in dims for dims in along):
            import xarray  # start-up

            both = [v if hasattr(v, "dims") else xarray.DataArray(np.asarray(v, float)) for v in (elevation, azimuth)]
            first, second = xarray.broadcast(*both)
            others = [d for d in first.dims if d != "time"]
            if len(others) > 1:
                raise TwilightError("towards: DataArrays may have the dimension time and one other")
            e, a = (v.transpose("time", *others).values.reshape(first.sizes["time"], -1) for v in (first, second))
            labels: dict[str, Any] = {"elevation": e, "azimuth": a}
            made = cls("direction", e.shape[1], bool(others), labels, (), e, a)
        else:
            e, a = np.broadcast_arrays(np.asarray(elevation, float), np.asarray(azimuth, float))
            if e.ndim > 1:
                raise TwilightError("towards: elevation and azimuth must be numbers or have one dimension")
            labels = {"elevation": e.ravel(), "azimuth": a.ravel()}
            made = cls("direction", e.size, e.ndim == 1, labels, (), e.ravel(), a.ravel())
        if not ((made.elevation >= 0.0) & (made.elevation <= 90.0)).all() or not np.isfinite(made.azimuth).all():
            raise TwilightError("towards: elevations must be from 0 to 90 deg, and azimuths finite")
        return made

    def angles(self, moments: Moments, first: int, times: int) -> tuple[np.ndarray, np.ndarray]:
        """Elevation and azimuth from north (N, D) of moments, the first of which is number `first` of all."""
        n = len(moments.places)
        if self.elevation.ndim == 2:
            if self.elevation.shape[0] != times:
                raise TwilightError(f"towards: has {self.elevation.shape[0]} times, and time has {times}")
            rows = (first + np.arange(n)) % times
            return self.elevation[rows], self.azimuth[rows]
        azimuth = self.azimuth + np.where(self.from_sun, moments.sun_azimuth_deg[:, None], 0.0)
        return np.broadcast_to(self.elevation, (n, self.size)), azimuth


def _values(
    field: LightField,
    moments: Moments,
    aim: _Aim,
    found: Sequence[Quantity],
    sources: Sequence[str] | None,
    times: int,
) -> list[np.ndarray]:
    """Each quantity, (N, D)."""
    parts: list[list[np.ndarray]] = [[] for _ in found]
    step = max(1, AT_ONCE // aim.size)
    for first in range(0, len(moments.places), step):
        some = moments.part(slice(first, first + step))
        if aim.of == "surface":
            made = field.surfaces(some, aim.surfaces, sources)
        else:
            made = field.directions(some, *aim.angles(some, first, times), sources)
        spectra = Spectra(field.factor(made), **spectra_arguments(field))
        for i, one in enumerate(found):
            parts[i].append(one.value(spectra))
    return [np.concatenate(part) for part in parts]


def _dataset(
    arrays: Mapping[str, np.ndarray],
    found: Sequence[Quantity],
    aim: _Aim,
    dims: Sequence[str],
    latitude: np.ndarray,
    longitude: np.ndarray,
    times: Sequence[datetime],
    moments: Moments,
    field: LightField,
) -> xarray.Dataset:
    import xarray  # start-up

    moment = np.array([t.astimezone(UTC).replace(tzinfo=None) for t in times], "datetime64[us]").astype(
        "datetime64[ns]"
    )
    sky = [d for d in dims if d in ("place", "time")]
    shape = [len(latitude) if d == "place" else len(times) for d in sky]

    def along(name: str, values: Any) -> Any:
        return (name, values) if name in dims else values[0]

    coords: dict[str, Any] = {
        "latitude": along("place", latitude),
        "longitude": along("place", longitude),
        "time": along("time", moment),
        "solar_elevation_angle": (sky, moments.sun_elevation_deg.reshape(shape)),
        "solar_azimuth_angle": (sky, moments.sun_azimuth_deg.reshape(shape)),
    }
    for name, values in aim.labels.items():
        if np.ndim(values) == 2:
            coords[name] = (["time", "direction"], values) if aim.several else ("time", np.asarray(values)[:, 0])
        else:
            coords[name] = along(aim.of, values)
    climate = field.solved.scene.configuration.climate.name
    made = xarray.Dataset(
        {
            one.variable: (list(dims), arrays[one.variable], {"units": unit_of(one, aim.of), "long_name": one.about})
            for one in found
        },
        coords,
        {"climate": climate},
    )
    for name in ("latitude", "longitude", "solar_elevation_angle", "solar_azimuth_angle", "elevation", "azimuth"):
        if name in made.coords:
            made[name].attrs["units"] = {"latitude": "degrees_north", "longitude": "degrees_east"}.get(name, "degree")
    return made


def _quantity(name: str | Quantity) -> Quantity:
    return quantity(name)


def _is_target(value: Any) -> bool:
    return isinstance(value, str | Direction | Surface)


def _degrees(values: Any) -> Any:
    """Numbers of astropy's angles; others as they are."""
    if hasattr(values, "to_value"):
        return np.asarray(values.to_value("deg"))
    return values


def _places(place: Any, time_zone: str | None) -> tuple[bool, np.ndarray, np.ndarray, str | None, float | None]:
    """Whether there are several, latitudes and longitudes (P,), time zone, and altitude [km] of a single one."""
    several = isinstance(place, list) or (
        isinstance(place, tuple) and len(place) > 0 and not all(np.ndim(p) == 0 and not _is_place(p) for p in place)
    )
    if several and isinstance(place, tuple) and len(place) == 2 and all(np.ndim(p) == 1 for p in place):
        place = list(zip(*(numbers(p, "place") for p in place), strict=True))
    found = [place_of(one, None, None, time_zone) for one in (place if several else [place])]
    if not found:
        raise TwilightError("place: none is given")
    for one in found:
        if not (-90.0 <= one["latitude_deg"] <= 90.0 and -180.0 <= one["longitude_deg"] <= 360.0):
            raise TwilightError(
                f"place: ({one['latitude_deg']:g}, {one['longitude_deg']:g}) is not a latitude from -90 to 90 and a "
                "longitude from -180 to 360"
            )
    heights = {one["altitude_km"] for one in found}
    if len(heights) > 1:
        raise TwilightError("place: several places must have one altitude; give altitude_km")
    latitude, longitude = (np.array([one[f"{x}_deg"] for one in found]) for x in ("latitude", "longitude"))
    return several, latitude, longitude, found[0]["time_zone"], heights.pop()


def _is_place(value: Any) -> bool:
    return isinstance(value, tuple) or hasattr(value, "latitude") or hasattr(value, "to_geodetic")


def _times(time: Any, latitude: float, longitude: float, zone: str | None) -> tuple[bool, list[datetime]]:
    several = getattr(time, "isscalar", None) is False or not (isinstance(time, str) or np.ndim(time) == 0)

    def one(moment: Any) -> datetime:
        value = moment_of(moment)
        if isinstance(value, str):
            try:
                datetime.fromisoformat(value.strip())
            except ValueError:
                return time_of(value, latitude, longitude, zone)
        if isinstance(value, datetime) and value.tzinfo is None and zone is None:
            value = value.replace(tzinfo=UTC)
        return parse_time(value, zone or "UTC")

    made = [one(moment) for moment in (time if several else [time])]
    if not made:
        raise TwilightError("time: none is given")
    return several, made
