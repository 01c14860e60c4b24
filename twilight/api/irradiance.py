"""`irradiance`: light of the sun and its sky as a frame with the columns of pvlib, from times or solar positions."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from datetime import datetime
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from twilight.api.arguments import config_of, place_of
from twilight.api.types import PlaceLike, SceneLike
from twilight.base.errors import TwilightError
from twilight.engine.light import Moments, moments_at
from twilight.engine.light_setup import field_for
from twilight.engine.surfaces import Surface
from twilight.sky.ephemeris import sun_position
from twilight.sky.night import Place
from twilight.sky.quantities.catalogue import QUANTITIES, check_of
from twilight.sky.quantities.catalogue import quantity as known

if TYPE_CHECKING:
    import pandas

POSITIONS = (("elevation", -90.0, 90.0), ("azimuth", -360.0, 360.0))
"""Columns of pvlib's solar positions that are taken, and their ranges [deg]."""


def irradiance(
    times: pandas.DatetimeIndex | pandas.DataFrame | Sequence[str] | Sequence[datetime],
    place: PlaceLike | None = None,
    climate: SceneLike = "continental-average",
    quantity: str = "illuminance",
    *,
    surface_tilt: ArrayLike | pandas.Series | None = None,
    surface_azimuth: ArrayLike | pandas.Series | None = None,
    altitude_km: float | None = None,
    quality: str | None = None,
    settings: Mapping[str, object] | None = None,
) -> pandas.DataFrame:
    """Global, direct and diffuse light of the sun and its sky, in the columns of pvlib.

    The beam of the refracted disc and the integral of the computed sky over the hemisphere, at any sun, twilight
    included; without moon, stars and airglow (`twilight.light` has them).  The program computes 300 to 1000 nm at
    most: there is no broadband irradiance, and `attrs` of the frame say what is in its columns.

    Parameters
    ----------
    times
        A DatetimeIndex (UTC without a zone), or the frame of pvlib's `get_solarposition`, whose true `elevation` and
        `azimuth` [deg] are taken.
    place
        (latitude, longitude) [deg], pvlib's Location (its altitude counts) or astropy's EarthLocation; not needed with
        solar positions.
    climate
        Name or file of a climate or configuration, the same as a mapping, or a `Config`.
    quantity
        A quantity of surfaces that adds up (`docs/quantities.md`): illuminance [lx], ppfd, uv_index, melanopic ...;
        in:RESPONSE [W m^-2], e.g. in:PAR or in:FILE.csv; photons:RESPONSE.
    surface_tilt, surface_azimuth
        Of a plane [deg], as pvlib has them (0 level; from north, clockwise): numbers or, of a tracker, Series.
    altitude_km
        Of the observer, above sea level [km].
    quality, settings
        As of `twilight.render`.

    Returns
    -------
    pandas.DataFrame
        Columns `ghi`, `dni`, `dhi` along the times: of a level plane, of the beam across itself, of the sky on a level
        plane.  With a tilt also `poa_global`, `poa_direct`, `poa_diffuse`, `poa_sky_diffuse`, `poa_ground_diffuse`.
        `attrs`: quantity, units, about.

    Raises
    ------
    TwilightError
        For what is not allowed, a quantity that does not add up, and one that wavelengths do not cover.

    Examples
    --------
    >>> location = pvlib.location.Location(52.5, 13.4)
    >>> twilight.irradiance(times, location, "urban", "ppfd", surface_tilt=35, surface_azimuth=180)
    >>> twilight.irradiance(location.get_solarposition(times), climate="urban")
    """
    import pandas  # start-up

    found = known(quantity)
    check_of(found, "surface")
    if found.name in ("cct", "duv"):
        adding = ", ".join(one.name for one in QUANTITIES.values() if one.of == ("surface",))
        raise TwilightError(
            f"irradiance: {found.name} does not add up; choose one of {adding}, in:RESPONSE, photons:RESPONSE"
        )
    moments, index, height = _moments(times, place, altitude_km)
    field = field_for(config_of(climate, altitude_km=height, quality=quality, settings=settings), [found])
    level, planes, groups = Surface.horizontal(), *_planes(surface_tilt, surface_azimuth, index)

    def number(light: np.ndarray) -> np.ndarray:
        return found.value(field.spectra(light))

    size = len(index), field.wavelength_nm.size
    dni, beam, sky, direct, diffuse, ground = (np.zeros(size) for _ in range(6))
    albedo = field.solved.medium.ground_albedo
    for plane, rows in zip(planes, groups, strict=True):
        some = moments.part(rows)
        surfaces = [level] if plane is None else [level, plane]
        made = field.surfaces(some, surfaces, ["sky"])
        sky[rows], diffuse[rows] = made[:, 0], made[:, -1]
        for one in field.terms(["sun"])[0].beams(some):
            dni[rows] += np.where(one.elevation_deg[:, None] > 0.0, one.irradiance, 0.0)
            beam[rows] += one.view(level, some) * one.irradiance
            if plane is not None:
                direct[rows] += one.view(plane, some) * one.irradiance
        if plane is not None:
            ground[rows] = plane.ground_view * albedo / np.pi * (sky[rows] + beam[rows])
    parts = {"ghi": sky + beam, "dni": dni, "dhi": sky}
    if planes[0] is not None:
        parts |= {"poa_global": direct + diffuse + ground, "poa_direct": direct, "poa_diffuse": diffuse + ground,
                  "poa_sky_diffuse": diffuse, "poa_ground_diffuse": ground}  # fmt: skip
    frame = pandas.DataFrame({name: number(light) for name, light in parts.items()}, index)
    frame.attrs = {"quantity": found.name, "units": found.unit, "about": found.about}
    return frame


def _moments(
    times: pandas.DatetimeIndex | pandas.DataFrame | Sequence[str] | Sequence[datetime],
    place: PlaceLike | None,
    altitude_km: float | None,
) -> tuple[Moments, pandas.DatetimeIndex, float | None]:
    """Suns along an index, and the altitude [km] of the place."""
    import pandas  # start-up

    if isinstance(times, pandas.DataFrame):
        missing = {"elevation", "azimuth"} - set(times.columns)
        if missing or not isinstance(times.index, pandas.DatetimeIndex):
            raise TwilightError(
                "irradiance: times must be a DatetimeIndex or a frame along one with columns elevation and azimuth, as "
                "pvlib's get_solarposition has them"
            )
        index, columns = times.index, times
    else:
        try:
            index, columns = pandas.DatetimeIndex(times), None
        except (TypeError, ValueError):
            raise TwilightError(
                "irradiance: times must be a DatetimeIndex, a list of times, or pvlib's frame of solar positions"
            ) from None
    if not len(index):
        raise TwilightError("irradiance: times: none is given")
    if index.hasnans:
        raise TwilightError("irradiance: times: one is NaT, which is no time")
    utc = index.tz_localize("UTC") if index.tz is None else index.tz_convert("UTC")
    moments = [moment.to_pydatetime() for moment in utc]
    found = place_of(place)
    height = found.altitude_km if altitude_km is None else altitude_km
    if columns is None:
        if found.latitude_deg is None or found.longitude_deg is None:
            raise TwilightError("irradiance: needs a place, or the solar positions of one in place of times")
        where = [found.latitude_deg] * len(index), [found.longitude_deg] * len(index)
        return moments_at(*where, moments, height or 0.0), index, height
    distance = np.asarray(sun_position(moments, 0.0, 0.0).distance_au)
    places = tuple(Place(0.0, 0.0, moment) for moment in moments)
    elevation, azimuth = (_angles(columns, name, low, high) for name, low, high in POSITIONS)
    return Moments(places, elevation, azimuth, distance), index, height


def _angles(columns: pandas.DataFrame, name: str, low: float, high: float) -> np.ndarray:
    """A column of solar positions [deg]; TwilightError for what is no angle between the two."""
    import pandas  # start-up

    values = pandas.to_numeric(columns[name], errors="coerce").to_numpy(float)
    if not np.all((values >= low) & (values <= high)):
        raise TwilightError(f"irradiance: {name} must be numbers from {low:g} to {high:g} [deg]")
    return values


def _planes(
    tilt: ArrayLike | pandas.Series | None, azimuth: ArrayLike | pandas.Series | None, index: pandas.DatetimeIndex
) -> tuple[list[Surface | None], list[np.ndarray]]:
    """The planes that there are, and the rows of each; one None where no plane is asked for."""
    rows = np.arange(len(index))
    if tilt is None and azimuth is None:
        return [None], [rows]
    if tilt is None or azimuth is None:
        raise TwilightError("irradiance: surface_tilt and surface_azimuth go together")
    try:
        pairs = np.stack([np.broadcast_to(np.asarray(x, float), rows.shape) for x in (tilt, azimuth)], axis=1)
    except ValueError:
        raise TwilightError(
            "irradiance: surface_tilt and surface_azimuth must be numbers, or one for each time"
        ) from None
    different, which = np.unique(pairs, axis=0, return_inverse=True)
    planes: list[Surface | None] = [Surface("plane", float(t), float(a)) for t, a in different]
    return planes, [np.flatnonzero(which.ravel() == k) for k in range(len(different))]
