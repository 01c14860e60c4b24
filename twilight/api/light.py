"""`light`: light of a direction or on a surface, by place and time, as named quantities, astropy's and pandas' too."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from datetime import UTC, datetime
from typing import TYPE_CHECKING, Any, Literal, TypeAlias, Unpack, overload

import numpy as np
from numpy.typing import ArrayLike

from twilight.api import arguments
from twilight.base.arguments import by_dimension, in_units, plain
from twilight.base.errors import TwilightError
from twilight.base.extras import require
from twilight.base.progress import Progress, part_of, silent
from twilight.engine.light import LightField, check_sources, field_for
from twilight.scene.usual import between_ozone_of
from twilight.sky.ephemeris import parse_time
from twilight.sky.moments import Moments, moments_at
from twilight.sky.quantities.measure import Of, Quantity, check_of, unit_of
from twilight.sky.quantities.measure import quantity as quantity_of
from twilight.sky.surfaces import Direction, Surface, towards
from twilight.sky.twilight_times import moment_of

if TYPE_CHECKING:
    import pandas
    import xarray


Astropy: TypeAlias = arguments.AstropyQuantity | dict[str, arguments.AstropyQuantity]
"""astropy's quantity, or one for each of several quantities by its variable."""
AT_ONCE = 2_000
"""Directions times moments whose spectra are held at once."""
_TARGETS = (str, Direction, Surface)


@overload
def light(
    place: arguments.PlaceLike | Sequence[arguments.PlaceLike],
    time: arguments.TimeLike | arguments.TimesLike,
    towards: arguments.TargetsLike = "zenith",
    quantity: str | Quantity | Sequence[str | Quantity] = "V",
    climate: arguments.SceneLike = "continental-average",
    *,
    returns: Literal["xarray"] = "xarray",
    **options: Unpack[arguments.LightOptions],
) -> xarray.DataArray | xarray.Dataset: ...


@overload
def light(
    place: arguments.PlaceLike | Sequence[arguments.PlaceLike],
    time: arguments.TimeLike | arguments.TimesLike,
    towards: arguments.TargetsLike = "zenith",
    quantity: str | Quantity | Sequence[str | Quantity] = "V",
    climate: arguments.SceneLike = "continental-average",
    *,
    returns: Literal["pandas", "astropy"],
    **options: Unpack[arguments.LightOptions],
) -> pandas.Series | pandas.DataFrame | Astropy: ...


@in_units
def light(
    place: arguments.PlaceLike | Sequence[arguments.PlaceLike],
    time: arguments.TimeLike | arguments.TimesLike,
    towards: arguments.TargetsLike = "zenith",
    quantity: str | Quantity | Sequence[str | Quantity] = "V",
    climate: arguments.SceneLike = "continental-average",
    *,
    sources: Sequence[str] | None = None,
    time_zone: str | None = None,
    altitude_km: float | None = None,
    quality: str | None = None,
    settings: Mapping[str, object] | None = None,
    progress: Progress | None = None,
    returns: Literal["xarray", "pandas", "astropy"] = "xarray",
) -> xarray.DataArray | xarray.Dataset | pandas.Series | pandas.DataFrame | Astropy:
    """The light of directions or surfaces at places and times: sun, sky, moon, night and ground.

    The field of the climate is solved once for all suns (twice where usual columns of ozone differ by more than
    4 DU) and cached, with what is read from it under many suns; what follows takes half a millisecond a moment.
    A climate without a `solver` is that of `compact`, where it has the air, the observer and the wavelengths, else of
    `zones`; the dataset's attribute `solver` says which, and why.  Tables are within 0.3 % of the field; few lines of
    sight, fewer than those of the tables, are computed one by one.  A source of the night is left out where sun and
    moon are 10,000 times brighter in everything that is asked for.

    Parameters
    ----------
    place
        (latitude, longitude) [deg], north and east positive; pvlib's Location or astropy's EarthLocation; or several:
        a list of them, rows of an array, or arrays (latitudes, longitudes).
    time
        As of `twilight.render`, or an event such as "2026-06-21 civil dusk"; several give the dimension `time`.
    towards
        A direction: "zenith", "30/180" (elevation and azimuth from north [deg]), "5/sun+90" (azimuth from the sun), a
        pair of arrays (elevation, azimuth; numbers, astropy's angles, or DataArrays along `time`), astropy's AltAz.
        A surface: "horizontal", "plane:35/180" (tilt and azimuth of the normal), "sphere" (actinic flux), "cylinder"
        (mean of vertical planes); or a `Direction` or `Surface`.  A list gives the dimension `direction` or `surface`.
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
    progress
        Called as progress(doing, fraction) now and then.
    returns
        xarray; pandas (a Series along the times that were given, a DataFrame for several quantities or targets);
        astropy (a Quantity).

    Returns
    -------
    xarray.DataArray, xarray.Dataset, pandas.Series, pandas.DataFrame or astropy.units.Quantity
        A dataset (a mapping, for astropy) where several quantities are asked for.  Dimensions `place`, `time` (UTC),
        `direction` or `surface`, those of which there are several.  Events and times of the clock are those of each
        place: of several, the coordinate `moment` (place, time) has them.

    All places and times have one air but for ozone that it leaves unset: each has the zonal mean of its own; the
    logarithm of light is interpolated between the least and the most of them.

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
    quantities = [quantity_of(name) for name in names]
    several_places, places = arguments.places_of(place, time_zone)
    altitudes = {one.altitude_km for one in places}
    if altitude_km is None and len(altitudes) > 1:
        raise TwilightError("place: several places must have one altitude; give altitude_km")
    altitude_km = altitudes.pop() if altitude_km is None else altitude_km
    several_times, times = _times(time, places, altitude_km)
    aim = _Aim.of_targets(towards)
    for item in quantities:
        check_of(item, aim.of)
    check_sources(sources)
    if returns not in ("xarray", "pandas", "astropy"):
        raise TwilightError(f"light: returns is '{returns}'; allowed is xarray, pandas, astropy")
    require(f"light: returns {returns}", "astropy" if returns == "astropy" else "xarray")
    config = arguments.config_of(climate, altitude_km=altitude_km, quality=quality, settings=settings)
    tell = progress or silent
    count, n_places = len(times[0]), len(places)
    when, latitude = (
        [moment for row in times for moment in row],
        [one.latitude_deg for one in places for _ in range(count)],
    )
    configs, shares = between_ozone_of(config, when, latitude)
    parts = [part_of(tell, 0.5 * k / len(configs), 0.5 / len(configs)) for k in range(len(configs))]
    fields = [field_for(one, quantities, part) for one, part in zip(configs, parts, strict=True)]
    solved = fields[0]
    longitude = [one.longitude_deg for one in places for _ in range(count)]
    moments = moments_at(latitude, longitude, when, solved.solved.scene.altitude_km)
    values = _values(fields, shares, moments, aim, quantities, sources, count, part_of(tell, 0.5, 0.5))
    sizes = {"place": (n_places, several_places), "time": (count, several_times), aim.of: (aim.size, aim.several)}
    dims = {name: size for name, (size, several) in sizes.items() if several}
    arrays = {item.variable: v.reshape(list(dims.values())) for item, v in zip(quantities, values, strict=True)}
    if returns == "astropy":
        return quantities_of(arrays, quantities, aim.of)
    dataset = _dataset(arrays, quantities, aim, dims, places, times, moments)
    dataset.attrs["climate"] = solved.solved.scene.configuration.climate.name
    dataset.attrs["solver"] = solved.chosen or solved.solved.scene.solver_name
    if returns == "pandas":
        return frame_of(dataset, time, [item.variable for item in quantities], places[0].time_zone)
    return dataset[quantities[0].variable] if isinstance(quantity, str | Quantity) else dataset


@dataclass(frozen=True, eq=False)
class _Aim:
    """Directions or surfaces, whether there are `several`, and the names of surfaces.

    elevation, azimuth: of directions [deg], (D,), or (T, D) of as many times; from_sun: whether azimuths count from the
    sun, (D,).
    """

    of: Of
    several: bool
    surfaces: Sequence[Surface] = ()
    names: Sequence[str] = ()
    elevation: np.ndarray = field(default_factory=lambda: np.empty(0))
    azimuth: np.ndarray = field(default_factory=lambda: np.empty(0))
    from_sun: np.ndarray | bool = False

    @property
    def size(self) -> int:
        """How many directions or surfaces there are."""
        return len(self.surfaces) or self.elevation.shape[-1]

    @property
    def labels(self) -> dict[str, ArrayLike]:
        """What coordinates of a dataset say of them."""
        return {"surface": self.names} if self.surfaces else {"elevation": self.elevation, "azimuth": self.azimuth}

    @classmethod
    def of_targets(cls, target: arguments.TargetsLike) -> _Aim:
        given: Any = target
        if hasattr(target, "alt") and hasattr(target, "az"):
            given = given.alt, given.az
        several = isinstance(given, list | tuple)
        each = given if several else [given]
        if isinstance(given, tuple) and len(each) == 2 and not any(isinstance(t, _TARGETS) for t in each):
            return cls._of_angles(*each)
        chosen = [towards(t) if isinstance(t, str) else t for t in each]
        surfaces = [t for t in chosen if isinstance(t, Surface)]
        directions = [t for t in chosen if isinstance(t, Direction)]
        if surfaces and len(surfaces) == len(chosen):
            return cls("surface", several, surfaces, [str(t) for t in each])
        if directions and len(directions) == len(chosen):
            angles = np.array([(t.elevation_deg, t.azimuth_deg) for t in directions]).T
            return cls("direction", several, (), (), angles[0], angles[1], np.array([t.from_sun for t in directions]))
        raise TwilightError("towards: must be directions or surfaces, not both and nothing else; see twilight.light")

    @classmethod
    def _of_angles(cls, elevation: Any, azimuth: Any) -> _Aim:
        given = by_dimension({"elevation_deg": elevation, "azimuth_deg": azimuth})
        e: np.ndarray
        a: np.ndarray
        numbers = [np.asarray(plain(values, name)) for name, values in given.items()]
        dims = next((v.dims for v in given.values() if "time" in getattr(v, "dims", ())), ())
        if dims:
            if len(dims) > 2:
                raise TwilightError("towards: DataArrays may have the dimension time and one other")
            along_time = (np.moveaxis(both, dims.index("time"), 0) for both in np.broadcast_arrays(*numbers))
            e, a = (both.reshape(both.shape[0], -1) for both in along_time)
            several = len(dims) > 1
        else:
            try:
                e, a = np.broadcast_arrays(*numbers)
            except ValueError:
                raise TwilightError("towards: elevation and azimuth must be as many as each other") from None
            if e.ndim > 1:
                raise TwilightError("towards: elevation and azimuth must be numbers or have one dimension")
            several, e, a = e.ndim == 1, np.ravel(e), np.ravel(a)
        if not ((e >= 0.0) & (e <= 90.0)).all():
            raise TwilightError("towards: elevations must be from 0 to 90 deg")
        return cls("direction", several, (), (), e, a)

    def angles(self, moments: Moments, first: int, times: int) -> tuple[np.ndarray, np.ndarray]:
        """Elevation and azimuth from north (N, D) of moments, the first of which is number `first` of all."""
        n = len(moments)
        if self.elevation.ndim == 2:
            if self.elevation.shape[0] != times:
                raise TwilightError(f"towards: has {self.elevation.shape[0]} times, and time has {times}")
            rows = (first + np.arange(n)) % times
            return self.elevation[rows], self.azimuth[rows]
        azimuth = self.azimuth + np.where(self.from_sun, moments.sun.azimuth_deg[:, None], 0.0)
        return np.broadcast_to(self.elevation, (n, self.size)), azimuth


def _values(
    fields: Sequence[LightField],
    shares: np.ndarray,
    moments: Moments,
    aim: _Aim,
    found: Sequence[Quantity],
    sources: Sequence[str] | None,
    times: int,
    progress: Progress,
) -> list[np.ndarray]:
    """Each quantity, (N, D); fields: of one air, or of less and more ozone, of which moments have shares (N,)."""
    parts: list[list[np.ndarray]] = [[] for _ in found]
    step, count = max(1, AT_ONCE // aim.size), len(moments)
    if aim.of == "surface":
        for k, field in enumerate(fields):
            field.prepare(moments, part_of(progress, 0.5 * k / len(fields), 0.5 / len(fields)))
    for first in range(0, count, step):
        progress(f"moment {first + 1} of {count}", 0.5 + 0.5 * first / count)
        some = moments.part(slice(first, first + step))
        if aim.of == "surface":
            each = [field.surfaces(some, aim.surfaces, sources) for field in fields]
        else:
            angles = aim.angles(some, first, times)
            each = [field.directions(some, *angles, sources) for field in fields]
        share = shares[first : first + step, None, None]
        light = each[0] if len(each) == 1 else each[0] ** (1.0 - share) * each[1] ** share
        spectra = fields[0].spectra(light)
        for i, one in enumerate(found):
            parts[i].append(one.value(spectra))
    return [np.concatenate(part) for part in parts]


def _dataset(
    arrays: Mapping[str, np.ndarray],
    found: Sequence[Quantity],
    aim: _Aim,
    dims: Mapping[str, int],
    places: Sequence[arguments.GivenPlace],
    times: Sequence[Sequence[datetime]],
    moments: Moments,
) -> xarray.Dataset:
    import xarray  # optional

    moment: np.ndarray = np.array(
        [[t.astimezone(UTC).replace(tzinfo=None) for t in row] for row in times], "datetime64[ns]"
    )
    sky = [d for d in dims if d in ("place", "time")]
    shape = [dims[d] for d in sky]

    def along(name: str, values: Any) -> Any:
        return (name, values) if name in dims else values[0]

    coords: dict[str, Any] = {
        "latitude": along("place", [one.latitude_deg for one in places]),
        "longitude": along("place", [one.longitude_deg for one in places]),
        "solar_elevation_angle": (sky, moments.sun.elevation_deg.reshape(shape)),
        "solar_azimuth_angle": (sky, moments.sun.azimuth_deg.reshape(shape)),
    }
    if (moment == moment[0]).all():
        coords["time"] = along("time", moment[0])
    else:  # an event or a clock's time is another moment at each place
        coords["moment" if "time" in dims else "time"] = (sky, moment.reshape(shape))
    for name, values in aim.labels.items():
        if np.ndim(values) == 2:
            coords[name] = (["time", "direction"], values) if aim.several else ("time", np.asarray(values)[:, 0])
        else:
            coords[name] = along(aim.of, values)
    dataset = xarray.Dataset(
        {
            item.variable: (
                list(dims),
                arrays[item.variable],
                {"units": unit_of(item, aim.of), "long_name": item.about},
            )
            for item in found
        },
        coords,
    )
    for name in ("latitude", "longitude", "solar_elevation_angle", "solar_azimuth_angle", "elevation", "azimuth"):
        if name in dataset.coords:
            dataset[name].attrs["units"] = {"latitude": "degrees_north", "longitude": "degrees_east"}.get(
                name, "degree"
            )
    return dataset


def _times(
    time: arguments.TimeLike | arguments.TimesLike, places: Sequence[arguments.GivenPlace], altitude_km: float | None
) -> tuple[bool, list[list[datetime]]]:
    """Whether there are several times, and those of each place: by its own clocks, its own dusk."""
    several, moments = arguments.times_of(time)
    if not moments:
        raise TwilightError("time: none is given")

    def one(moment: datetime | str, place: arguments.GivenPlace) -> datetime:
        if isinstance(moment, str):
            return moment_of(moment, place.latitude_deg, place.longitude_deg, place.time_zone, altitude_km or 0.0)
        return parse_time(moment, place.time_zone)

    return several, [[one(moment, place) for moment in moments] for place in places]


def quantities_of(
    arrays: Mapping[str, np.ndarray], found: Sequence[Quantity], of: Of
) -> arguments.AstropyQuantity | dict[str, arguments.AstropyQuantity]:
    """astropy's Quantity, or a mapping of them by variable where there are several."""
    from astropy import units  # optional

    quantities = {}
    for item in found:
        text = unit_of(item, of)
        unit = units.dimensionless_unscaled if text == "1" else units.Unit(text.replace("s-1 m-2", "ph s-1 m-2"))
        quantities[item.variable] = arrays[item.variable] * unit
    return next(iter(quantities.values())) if len(quantities) == 1 else quantities


def frame_of(
    made: xarray.Dataset, time: arguments.TimeLike | arguments.TimesLike, variables: Sequence[str], zone: str | None
) -> pandas.Series | pandas.DataFrame:
    """pandas' Series along the time, a DataFrame for several quantities or targets; the index is the one that was
    given."""
    import pandas  # optional

    if "place" in made.dims or "time" not in made.dims:
        raise TwilightError("light: returns pandas needs one place and several times")
    if isinstance(time, pandas.DatetimeIndex):
        index = time
    else:
        index = pandas.DatetimeIndex(made["time"].values, tz="UTC").tz_convert(zone or "UTC")
    columns = {}
    for name in variables:
        values = made[name].transpose("time", ...).values
        if values.ndim == 1:
            columns[name] = pandas.Series(values, index, name=name)
        else:
            of = next(str(d) for d in made[name].dims if d != "time")
            labels = made["surface"].values if of == "surface" else range(values.shape[1])
            for k, label in enumerate(labels):
                columns[f"{name} {label}"] = pandas.Series(values[:, k], index, name=f"{name} {label}")
    return next(iter(columns.values())) if len(columns) == 1 else pandas.DataFrame(columns)
