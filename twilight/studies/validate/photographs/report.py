"""Files of a comparison: figures as JSON, profiles as CSV, all maps as HDF5; each whole or absent."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import xarray

from twilight.base.whole_files import whole_file, write_csv
from twilight.sky import colour
from twilight.studies.validate.photographs.photo import Comparison

if TYPE_CHECKING:
    import xarray


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


def to_dataset(comparison: Comparison, attributes: dict[str, Any] | None = None) -> xarray.Dataset:
    """Photograph and simulation with all maps as an xarray Dataset, NaN where masked."""
    photo, grid = comparison.photo, ("elevation", "azimuth")
    light = "CIE 1931 tristimulus values, Y is the luminance"
    variables = {
        "photograph_xyz": ((*grid, "tristimulus"), comparison.photo_xyz, {"long_name": light, "units": "cd m-2"}),
        "computed_xyz": ((*grid, "tristimulus"), comparison.simulated.xyz, {"long_name": light, "units": "cd m-2"}),
        "log_ratio": (grid, comparison.log_ratio, {"long_name": "ln(photograph / computed) luminance", "units": "1"}),
        "delta_uv": (grid, comparison.delta_uv, {"long_name": "distance in CIE 1976 u', v'", "units": "1"}),
        "ciede2000": (grid, comparison.delta_e, {"long_name": "CIEDE2000", "units": "1"}),
        "ciede2000_colour": (
            grid,
            comparison.delta_e_colour,
            {"long_name": "CIEDE2000 at equal luminance", "units": "1"},
        ),
        "solid_angle": (grid, photo.solid_angle_sr, {"long_name": "clear part of the cell", "units": "sr"}),
    }
    coordinates = {
        "elevation": ("elevation", photo.elevation_deg, {"units": "degree", "long_name": "elevation"}),
        "azimuth": ("azimuth", photo.azimuth_deg, {"units": "degree", "long_name": "azimuth from the sun, clockwise"}),
        "tristimulus": ("tristimulus", ["X", "Y", "Z"]),
    }
    return xarray.Dataset(variables, coordinates, attributes or {})


def write_dataset(path: str | Path, comparison: Comparison, facts: dict[str, Any]) -> None:
    """Write ``to_dataset`` as HDF5 that is netCDF-4, with the facts as a JSON attribute."""
    dataset = to_dataset(comparison, {"title": "Photograph and computed sky", "facts": json.dumps(_plain(facts))})
    encoding = {name: {"zlib": True, "complevel": 4, "dtype": "float32"} for name in dataset.data_vars}
    with whole_file(path) as temporary:
        dataset.to_netcdf(temporary, engine="h5netcdf", encoding=encoding)


def write_suns(path: str | Path, rows: list[tuple[str, float, float, dict[str, Any]]]) -> None:
    """Write one line for each sun that was tried: name, elevation, misfit, figures."""
    numbers = [key for key, value in rows[0][3].items() if not isinstance(value, list)]
    lines = [
        [name, f"{sun:g}", f"{misfit:.6g}", *("" if found.get(k) is None else f"{found[k]:.6g}" for k in numbers)]
        for name, sun, misfit, found in rows
    ]
    write_csv(path, ["frame", "sun_elevation_deg", "misfit", *numbers], lines)
