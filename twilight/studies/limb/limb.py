"""Limb radiance of a solved field against tangent altitude, with fields of view and box air-mass factors."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from twilight.atmosphere.layer_changes import layer_edges
from twilight.atmosphere.medium import Medium
from twilight.base.errors import TwilightError
from twilight.base.progress import Progress, silent
from twilight.engine import Solved
from twilight.numerics.spectrum import solar_irradiance
from twilight.studies.airmass.factors import usual_edges
from twilight.studies.limb.geometry import (
    bent_tangent_km,
    field_of_view,
    limb_elevation_deg,
    limb_geometry,
    tangent_altitudes,
)

if TYPE_CHECKING:
    from xarray import Dataset

TANGENT = "apparent_tangent_altitude"
"""The dimension of the datasets, beside the wavelength."""


def limb_of(
    solved: Solved,
    tangent_km: ArrayLike,
    sun_elevation_deg: float,
    azimuth_deg: float,
    *,
    observer_altitude_km: float = 600.0,
    field_of_view_km: float | None = None,
    field_of_view_shape: str = "box",
    air_mass: bool = False,
    edges_km: ArrayLike | None = None,
    progress: Progress = silent,
) -> Dataset:
    """Limb radiance; arguments and result as of `twilight.Solved.limb`."""
    import xarray  # start-up

    medium = solved.medium
    if not solved.scene.capabilities.looks_down:
        name = solved.scene.solver.__name__.rpartition(".")[2]
        raise TwilightError(f"limb: the solver {name} does not look below the horizontal; zones and montecarlo do")
    if not -90.0 <= sun_elevation_deg <= 90.0:
        raise TwilightError(f"sun_elevation_deg is {sun_elevation_deg:g}; allowed is -90 to 90")
    tangent = tangent_altitudes(medium, tangent_km, observer_altitude_km)
    offset, weight = field_of_view(field_of_view_km, field_of_view_shape)
    lines = limb_geometry(medium, tangent, observer_altitude_km, sun_elevation_deg, azimuth_deg)
    elevation = limb_elevation_deg(medium, tangent[:, None] + offset, observer_altitude_km)
    edges = layer_edges(medium, usual_edges(medium) if edges_km is None else edges_km) if air_mass else None
    light, errors, factors = [], [], []
    for k in range(tangent.size):
        progress("limb", k / tangent.size)
        sun, azimuth = float(lines.sun_elevation_deg[k]), float(lines.azimuth_deg[k])
        found = solved.radiance_with_error(sun, elevation[k], azimuth, observer_altitude_km)
        light.append(weight @ found.radiance)
        if found.standard_error is not None:
            errors.append(np.sqrt(weight**2 @ found.standard_error**2))
        if edges is not None:
            slopes, _ = solved.log_slopes("absorption", edges, sun, elevation[k], azimuth, observer_altitude_km)
            part = weight[:, None] * found.radiance
            with np.errstate(invalid="ignore"):
                factors.append(-np.einsum("nw,njw->jw", part, slopes) / part.sum(axis=0))
    normalised = np.array(light)
    solar = solar_irradiance(medium.wavelength_nm, solved.solar_spectrum)
    dims = (TANGENT, "wavelength")
    values: dict[str, Any] = {
        "sun_normalised_radiance": (dims, normalised, {"long_name": "radiance over solar irradiance", "units": "sr-1"}),
        "radiance": (dims, normalised * solar, {"long_name": "radiance at 1 au", "units": "W m-2 sr-1 nm-1"}),
    }
    if errors:
        about = {"long_name": "standard error of sun_normalised_radiance", "units": "sr-1"}
        values["standard_error"] = (dims, np.array(errors), about)
    if edges is not None:
        about = {"long_name": "-d ln(radiance) / d(vertical optical depth of the layer)", "units": "1"}
        values["box_air_mass_factor"] = ((TANGENT, "altitude", "wavelength"), np.array(factors), about)
        values["altitude_bnds"] = (("altitude", "nv"), np.stack([edges[:-1], edges[1:]], axis=1))
    angles = {
        "elevation": (lines.elevation_deg, "elevation of the line of sight"),
        "azimuth": (lines.azimuth_deg, "azimuth from the sun, at the observer"),
        "sun_elevation": (lines.sun_elevation_deg, "of the sun at the observer, true"),
        "scattering_angle": (lines.scattering_angle_deg, "at the tangent point"),
    }
    coordinates = coordinates_of(medium, tangent)
    for name, (value, text) in angles.items():
        coordinates[name] = (TANGENT, value, {"long_name": text, "units": "degree"})
    if edges is not None:
        middle = {"long_name": "middle of the layer", "units": "km", "bounds": "altitude_bnds"}
        coordinates["altitude"] = ("altitude", 0.5 * (edges[1:] + edges[:-1]), middle)
    attributes = {
        "title": solved.scene.title,
        "tangent_point_sun_elevation_deg": sun_elevation_deg,
        "tangent_point_azimuth_deg": azimuth_deg,
        **instrument_attributes(observer_altitude_km, field_of_view_km, field_of_view_shape),
    }
    return xarray.Dataset(values, coordinates, attributes)


def coordinates_of(medium: Medium, tangent_km: np.ndarray) -> dict[str, Any]:
    """Tangent altitudes, apparent and of the bent rays, and wavelengths."""
    km = {"units": "km"}
    return {
        TANGENT: (TANGENT, tangent_km, {"long_name": "apparent tangent altitude", **km}),
        "tangent_altitude": (
            (TANGENT, "wavelength"), bent_tangent_km(medium, tangent_km),
            {"long_name": "lowest point of the bent ray", **km},
        ),
        "wavelength": ("wavelength", medium.wavelength_nm, {"units": "nm"}),
    }  # fmt: skip


def instrument_attributes(observer_altitude_km: float, width_km: float | None, shape: str) -> dict[str, Any]:
    """Attributes of a dataset about the instrument: its altitude, and its field of view where it has one."""
    view = {} if width_km is None else {"field_of_view_km": width_km, "field_of_view_shape": shape}
    return {"observer_altitude_km": observer_altitude_km, **view}
