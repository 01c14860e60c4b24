"""Files of a comparison: figures as JSON, profiles as CSV, all maps as HDF5; each whole or absent."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import xarray

from twilight.base.whole_files import whole_file, write_csv
from twilight.io.netcdf import write_netcdf
from twilight.sky import colour
from twilight.studies.validate.photographs.photo import Comparison


def write_json(path: str | Path, facts: dict[str, Any]) -> None:
    """Write facts as JSON; numbers that are not finite become null."""
    with whole_file(path) as temporary:
        temporary.write_text(json.dumps(_plain(facts), indent=2, ensure_ascii=False) + "\n", encoding="utf-8")


def _plain(value: Any) -> Any:
    if isinstance(value, dict):
        return {str(key): _plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(item) for item in value]
    if isinstance(value, np.generic):
        value = value.item()
    if isinstance(value, float) and not np.isfinite(value):
        return None
    return value


def write_profiles(path: str | Path, comparison: Comparison) -> None:
    """Write both profiles: meridian, angle, luminance [cd m^-2] and u', v' of photograph and simulation."""
    columns = "meridian angle_deg photo_cd_per_m2 computed_cd_per_m2 photo_u photo_v computed_u computed_v".split()
    rows = []
    for name, profile in (("solar", comparison.solar), ("perpendicular", comparison.perpendicular)):
        for angle, one, other in zip(profile.angle_deg, profile.photo, profile.simulated, strict=True):
            if np.isfinite(one[1]):
                numbers = [one[1], other[1], *colour.uv_of_xyz(one), *colour.uv_of_xyz(other)]
                rows.append([name, f"{angle:g}", *(f"{number:.6g}" for number in numbers)])
    write_csv(path, columns, rows)


def write_dataset(path: str | Path, comparison: Comparison, facts: dict[str, Any]) -> None:
    """Write photograph and simulation with all maps, NaN where masked, as HDF5 that is netCDF-4; facts: as JSON."""
    photo, grid = comparison.photo, ("elevation", "azimuth")
    light = {"long_name": "CIE 1931 tristimulus values, Y is the luminance", "units": "cd m-2"}
    maps = {
        "log_ratio": (comparison.log_ratio, "ln(photograph / computed) luminance", "1"),
        "delta_uv": (comparison.delta_uv, "distance in CIE 1976 u', v'", "1"),
        "ciede2000": (comparison.delta_e, "CIEDE2000", "1"),
        "ciede2000_colour": (comparison.delta_e_colour, "CIEDE2000 at equal luminance", "1"),
        "solid_angle": (photo.solid_angle_sr, "clear part of the cell", "sr"),
    }
    variables = {
        "photograph_xyz": ((*grid, "tristimulus"), comparison.photo_xyz, light),
        "computed_xyz": ((*grid, "tristimulus"), comparison.simulated.xyz, light),
        **{name: (grid, values, {"long_name": text, "units": unit}) for name, (values, text, unit) in maps.items()},
    }
    coordinates = {
        "elevation": ("elevation", photo.elevation_deg, {"units": "degree", "long_name": "elevation"}),
        "azimuth": ("azimuth", photo.azimuth_deg, {"units": "degree", "long_name": "azimuth from the sun, clockwise"}),
        "tristimulus": ("tristimulus", ["X", "Y", "Z"]),
    }
    attributes = {"title": "Photograph and computed sky", "facts": json.dumps(_plain(facts))}
    encoding = {name: {"zlib": True, "complevel": 4, "dtype": "float32"} for name in variables}
    write_netcdf(xarray.Dataset(variables, coordinates, attributes), path, encoding)


def write_suns(path: str | Path, rows: list[tuple[str, float, float, dict[str, Any]]]) -> None:
    """Write one line for each sun that was tried: name, elevation, misfit, figures."""
    numbers = [key for key, value in rows[0][3].items() if not isinstance(value, list)]
    lines = [
        [name, f"{sun:g}", f"{misfit:.6g}", *("" if found.get(k) is None else f"{found[k]:.6g}" for k in numbers)]
        for name, sun, misfit, found in rows
    ]
    write_csv(path, ["frame", "sun_elevation_deg", "misfit", *numbers], lines)
