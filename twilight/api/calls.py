"""What `import twilight` offers to call: a sky, a series, skies of many airs, a field for any sun, air, a solver."""

import itertools
import warnings
from collections.abc import Mapping, Sequence
from datetime import datetime
from os import PathLike
from typing import TYPE_CHECKING, Any, Unpack, overload

import numpy as np
from numpy.typing import ArrayLike, NDArray

from twilight import solvers
from twilight.api import arguments
from twilight.api.representation import Sky, SkySeries
from twilight.atmosphere.medium import Medium
from twilight.base.arguments import in_units
from twilight.base.errors import TwilightError, TwilightWarning
from twilight.base.sections import unknown
from twilight.base.threads import in_slices, one_blas_thread
from twilight.clear_air.entry import SkyArrays, checked_directions, checked_observer
from twilight.config import Climate, load_climate
from twilight.config.sun import SunAt, SunElevation
from twilight.engine import Field, check_size, frames
from twilight.engine import solve as solve_scene
from twilight.scene import resolve
from twilight.scene.lights import check_stars
from twilight.scene.medium import climate_medium
from twilight.scene.usual import with_usual_ozone
from twilight.solvers.base import ModelError, Solver

if TYPE_CHECKING:
    from twilight.show.page import Page


@overload
def render(
    scene: arguments.SceneLike, *, sun_elevation_deg: float, **options: Unpack[arguments.RenderOptions]
) -> Sky: ...
@overload
def render(
    scene: arguments.SceneLike,
    *,
    sun_elevation_deg: Sequence[float] | NDArray[np.float64],
    **options: Unpack[arguments.RenderOptions],
) -> SkySeries: ...
@overload
def render(
    scene: arguments.SceneLike, *, at: str | datetime | np.datetime64, **options: Unpack[arguments.RenderOptions]
) -> Sky: ...
@overload
def render(
    scene: arguments.SceneLike, *, at: arguments.TimesLike, **options: Unpack[arguments.RenderOptions]
) -> Sky | SkySeries: ...
@overload
def render(scene: arguments.SceneLike, **options: Unpack[arguments.RenderOptions]) -> Sky | SkySeries: ...


@in_units
def render(
    scene: arguments.SceneLike,
    *,
    sun_elevation_deg: float | Sequence[float] | NDArray[np.float64] | None = None,
    at: arguments.TimeLike | arguments.TimesLike | None = None,
    place: arguments.PlaceLike | None = None,
    latitude_deg: float | None = None,
    longitude_deg: float | None = None,
    time_zone: str | None = None,
    altitude_km: float | None = None,
    wavelength_nm: Sequence[float] | NDArray[np.float64] | None = None,
    solver: str | None = None,
    quality: str | None = None,
    settings: Mapping[str, object] | None = None,
) -> Sky | SkySeries:
    """The sky of a climate or configuration, or the skies of several suns.

    Parameters
    ----------
    scene
        Name or file of a climate or configuration, the same as a mapping, or a `Config`.
    sun_elevation_deg
        True elevation of the sun [deg]; a list gives a series, one of a single sun too.
    at
        A time with a place, in place of the elevation: text, datetime, numpy's datetime64, pandas' Timestamp or
        astropy's Time.  Several of them in their order (a list, a DatetimeIndex) give a series.
    place
        (latitude, longitude) [deg], north and east positive; or pvlib's Location (with its altitude and, for times
        without an offset, its time zone) or astropy's EarthLocation (with its height).
    latitude_deg, longitude_deg
        In place of `place` [deg], north and east positive.
    time_zone
        Of times without an offset, e.g. Europe/Berlin.
    altitude_km
        Altitude of the observer above sea level [km].
    wavelength_nm
        Wavelengths, increasing [nm].
    solver, quality
        Name of a solver and of one of its presets.
    settings
        Any other dotted keys, e.g. {"ground.albedo": 0.8}.

    Returns
    -------
    Sky or SkySeries
        A sky where one sun is asked for; a series, computed sun by sun when its skies are asked for, where a list or a
        configuration with several suns is.  Without any sun the scene's own is taken.

    Raises
    ------
    TwilightError
        For whatever is not allowed or cannot be computed, in one sentence.

    Examples
    --------
    >>> sky = twilight.render("continental-average", sun_elevation_deg=-4, quality="draft")
    >>> dusk = twilight.render("urban", at=["2026-06-21T21:45", "2026-06-21T22:30"], place=(52.5, 13.4),
    ...                        time_zone="Europe/Berlin")
    """
    if sun_elevation_deg is not None and at is not None:
        raise TwilightError("render: takes either sun_elevation_deg or at, not both")
    where = arguments.place_of(place, latitude_deg, longitude_deg, time_zone)
    if at is None and any(value is not None for value in where):
        raise TwilightError("render: a place needs a time: give at")
    chosen: dict[str, object] = {}
    if sun_elevation_deg is not None:
        several = np.ndim(sun_elevation_deg) > 0
        suns = arguments.numbers(sun_elevation_deg, "sun_elevation_deg")
        chosen["sun"] = {"elevations_deg": suns} if several else {"elevation_deg": suns[0]}
    elif at is not None:
        altitude_km = where.altitude_km if altitude_km is None else altitude_km
        given = where._replace(altitude_km=None)._asdict()
        chosen["sun"] = {**_times(at), **{key: value for key, value in given.items() if value is not None}}
    config = arguments.config_of(scene, chosen, altitude_km, wavelength_nm, solver, quality, settings)
    if "sun" not in config.model_fields_set:
        sun = SunElevation().elevation_deg
        warnings.warn(
            f"no sun is given: it stands at {sun:+g} deg (sun_elevation_deg, or at and a place)",
            TwilightWarning,
            stacklevel=2,
        )
    check_size(config)
    check_stars(config)
    resolved = resolve(config)
    made = (frame.sky for frame in frames(resolved))
    if isinstance(config.sun, SunElevation | SunAt):
        return next(made)
    times = [sun.time for sun in resolved.suns if sun.time is not None]
    return SkySeries(made, resolved.sun_elevations_deg, times or None)


@in_units
def solve(
    scene: arguments.SceneLike,
    *,
    sun_elevation_deg: float | Sequence[float] | NDArray[np.float64] | None = None,
    altitude_km: float | None = None,
    wavelength_nm: Sequence[float] | NDArray[np.float64] | None = None,
    solver: str | None = None,
    quality: str | None = None,
    settings: Mapping[str, object] | None = None,
) -> Field:
    """The solved field of a climate or configuration, to be asked for any direction, sun and observer.

    Parameters
    ----------
    scene
        As of `render`; its own sun plays no part.
    sun_elevation_deg
        All the suns that will be asked for [deg], which saves time; None: any.
    altitude_km, wavelength_nm, solver, quality, settings
        As of `render`.

    Returns
    -------
    Field
        `radiance(sun_elevation_deg, elevation_deg, azimuth_deg, observer_altitude_km)` is sun-normalised [sr^-1], shape
        of the directions plus (W,); `stokes` gives I, Q and U, `inscatter` the air before an object, `direct` the sun's
        own light, `sky` a whole `Sky`, `view` a page for the browser.

    Raises
    ------
    TwilightError
        For whatever is not allowed or cannot be computed, in one sentence.
    """
    suns = None if sun_elevation_deg is None else arguments.numbers(sun_elevation_deg, "sun_elevation_deg")
    config = arguments.config_of(scene, None, altitude_km, wavelength_nm, solver, quality, settings)
    return solve_scene(resolve(config), suns)


@in_units
def skies(
    scenes: Sequence[arguments.SceneLike],
    sun_elevation_deg: Sequence[float] | NDArray[np.float64],
    elevation_deg: ArrayLike,
    azimuth_deg: ArrayLike,
    *,
    altitude_km: Sequence[float] | NDArray[np.float64] | None = None,
    wavelength_nm: Sequence[float] | NDArray[np.float64] | None = None,
    settings: Mapping[str, object] | None = None,
) -> SkyArrays:
    """The skies of many airs under many suns by the solver `compact`, on as many threads as there are processors.

    At eight wavelengths a new air takes 0.17 processor seconds, each sky of it 0.008, under suns below 2 deg 0.009.

    Parameters
    ----------
    scenes
        Of one climate or configuration each: as of `twilight.render`.
    sun_elevation_deg
        Suns (S,), -18 to 90 [deg].
    elevation_deg, azimuth_deg
        Directions of one shape, 0 to 90 deg above the horizon, azimuth from the sun [deg].
    altitude_km
        Observers (O,), above sea level [km]; None: each scene's own.
    wavelength_nm, settings
        As of `twilight.render`.

    Returns
    -------
    SkyArrays
        `radiance` (N, O, S, ..., W), sun-normalised [sr^-1]; `relative_error` (N, O, S).

    Raises
    ------
    TwilightError
        For an air, a sun, an observer or a direction that the model does not have, before any sky is computed.

    Examples
    --------
    >>> airs = [twilight.load("urban", {"climate.aerosol.optical_depth_550nm": depth}) for depth in (0.1, 0.2, 0.4)]
    >>> light, error = twilight.skies(airs, [-6, -4, -2], elevation_deg=[5, 30, 90], azimuth_deg=0)
    """
    suns = arguments.numbers(sun_elevation_deg, "sun_elevation_deg")
    observers = None if altitude_km is None else arguments.numbers(altitude_km, "altitude_km")
    for sun in suns:
        elevation, azimuth = checked_directions(sun, elevation_deg, azimuth_deg)
    fields: dict[int, Field] = {}
    for n, scene in enumerate(scenes):
        config = arguments.config_of(scene, None, None, wavelength_nm, "compact", None, settings)
        fields[n] = solve_scene(resolve(config))
        for altitude in observers or ():
            checked_observer(fields[n].medium, altitude)
    if not fields:
        raise TwilightError("skies: scenes is empty; it takes one or more")
    nm = [field.medium.wavelength_nm for field in fields.values()]
    if any(one.size != nm[0].size or (one != nm[0]).any() for one in nm):
        raise TwilightError("skies: scenes have other wavelengths than each other; give wavelength_nm")
    shape = (len(fields), 1 if observers is None else len(observers), len(suns))
    radiance, error = np.empty((*shape, *elevation.shape, nm[0].size)), np.empty(shape)

    def work(first: int, end: int) -> None:
        for n in range(first, end):
            field = fields.pop(n)  # what an air needs is dropped when its skies are there
            for o, altitude in enumerate(observers or [field.scene.altitude_km]):
                for s, sun in enumerate(suns):
                    radiance[n, o, s] = field.radiance(sun, elevation, azimuth, altitude)
                    said = (block.field.convergence for block in field.blocks)
                    error[n, o, s] = max(one.error for one in said if isinstance(one, ModelError))

    with one_blas_thread():
        in_slices(work, len(fields))
    return SkyArrays(radiance, error)


@in_units
def medium(
    climate: str | PathLike[str] | Climate,
    wavelength_nm: Sequence[float] | NDArray[np.float64],
    settings: Mapping[str, object] | None = None,
) -> Medium:
    """The air and the ground of a climate as optical coefficients, which solvers take.

    Parameters
    ----------
    climate
        Name or file of a climate, or a `Climate`.
    wavelength_nm
        Wavelengths, increasing [nm], (W,).
    settings
        Dotted keys of the climate, e.g. {"ground.albedo": 0.8}; for a name or a file.

    Raises
    ------
    TwilightError
        For what is not allowed, and what the data of the atmosphere do not cover.
    """
    if isinstance(climate, Climate):
        if settings:
            raise TwilightError("medium: settings go with the name or the file of a climate")
    else:
        climate = load_climate(str(climate), settings)
    return climate_medium(with_usual_ozone(climate)[0], np.array(arguments.numbers(wavelength_nm, "wavelength_nm")))


def solver(name: str) -> Solver:
    """A solver's module: `QUALITIES`, `CAPABILITIES` and `prepare(medium, settings)`, which returns a field.

    Parameters
    ----------
    name
        One of those that `twilight show solvers` lists, e.g. zones.

    Raises
    ------
    TwilightError
        For a name that no solver has.
    """
    if name not in solvers.SOLVERS:
        raise TwilightError(f"solver: {name} {unknown(name, solvers.SOLVERS, 'solver')}")
    return solvers.load(name)


def view(self: Field, **options: Any) -> "Page":
    """The field in a browser, for any sun and direction; takes a minute or more.

    Parameters
    ----------
    **options
        Of `twilight.show.skies.view_fields`, e.g. altitudes_km.

    Returns
    -------
    twilight.show.Page
        A page that a notebook shows and whose `save(path)` writes it as HTML.
    """
    from twilight.show.skies import view_fields  # start-up

    return view_fields([self], **options)


Field.view = view  # type: ignore[method-assign]


def _times(at: arguments.TimeLike | arguments.TimesLike) -> dict[str, object]:
    """The keys of a `sun` section for one time or for several."""
    several, moments = arguments.times_of(at, "at")
    if several and len({isinstance(one, datetime) and one.tzinfo is None for one in moments}) > 1:
        raise TwilightError("at: several times must be all with or all without an offset")
    if any(isinstance(a, datetime) and isinstance(b, datetime) and b <= a for a, b in itertools.pairwise(moments)):
        raise TwilightError("at: several times must be in their order, each once")
    text = [one if isinstance(one, str) else one.isoformat() for one in moments]
    return {"times": text} if several else {"at": text[0]}
