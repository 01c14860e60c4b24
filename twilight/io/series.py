"""Files of a series: a table of its skies, and one dataset with all of them."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from twilight.base.errors import TwilightError
from twilight.base.extras import is_installed, missing
from twilight.base.reading import MEMORY_FRACTION, memory_bytes
from twilight.base.whole_files import link_or_copy, write_csv, writing
from twilight.io.folder import NUMBERED, numbered_files
from twilight.io.labels import attributes
from twilight.io.netcdf import read_sky, sky_to_dataset, write_netcdf
from twilight.sky.sky import Sky

if TYPE_CHECKING:
    import xarray

COLUMNS = (
    "scene",
    "time",
    "sun_elevation_deg",
    "apparent_sun_elevation_deg",
    "sun_azimuth_deg",
    "zenith_luminance_cd_per_m2",
    "zenith_magnitude_v_per_arcsec2",
    "sky_illuminance_lux",
    "illuminance_with_sun_lux",
    "solver",
    "quality",
    "estimated_error",
    "set_up_time_s",
    "run_time_s",
)

CLOSEST_DEG = 0.08
"""Rows and columns of different skies on one grid that are closer are one [deg], as in `twilight.sky.plain_grid`."""

_PER_SKY = (
    "sun_normalised_radiance",
    "luminance",
    "standard_error",
    "sun_normalised_radiance_q",
    "sun_normalised_radiance_u",
    "standard_error_q",
    "standard_error_u",
    "night_radiance",
    "direct_irradiance_factor",
)
"""Variables that every sky of a series has its own values of."""
_SUN_AND_TIME = (
    "solar_elevation_angle",
    "apparent_solar_elevation_angle",
    "solar_azimuth_angle",
    "earth_sun_distance",
    "time",
)
"""Scalars of every sky, which are coordinates of the series."""
_COMMON = ("solar_irradiance", "surface_albedo")
"""Variables that are the same for all skies of a series."""
_COPIES = 3
"""Of a series' skies that are held at once: as parts, together, and while they are written."""


def figures(sky: Sky) -> dict[str, Any]:
    """A sky's row of the table, without its name: numbers, text, and None for what is not known."""
    zenith = sky.luminance_at(90.0)
    magnitude = sky.magnitude() if sky.covers("V") else np.inf
    record = sky.provenance
    return {
        "time": None if sky.time is None else sky.time.isoformat(),
        "sun_elevation_deg": sky.sun_elevation_deg,
        "apparent_sun_elevation_deg": sky.apparent_sun_elevation_deg,
        "sun_azimuth_deg": sky.sun_azimuth_deg,
        "zenith_luminance_cd_per_m2": zenith,
        "zenith_magnitude_v_per_arcsec2": magnitude if np.isfinite(magnitude) else None,
        "sky_illuminance_lux": sky.illuminance_lux(),
        "illuminance_with_sun_lux": None if sky.direct_irradiance is None else sky.illuminance_lux(direct=True),
        "solver": record.get("solver"),
        "quality": record.get("quality"),
        "estimated_error": record.get("convergence", {}).get("error"),
        "set_up_time_s": record.get("set_up_time_s"),
        "run_time_s": record.get("run_time_s"),
    }


def write_table(rows: Mapping[str, Mapping[str, Any]], path: Path) -> None:
    """Write `series.csv`, whole or not at all: one row for each sky, by name, with the columns of `COLUMNS`."""
    write_csv(path, COLUMNS, ([name, *(_cell(row.get(key)) for key in COLUMNS[1:])] for name, row in rows.items()))


def _cell(value: Any) -> str:
    return "" if value is None else f"{value:.8g}" if isinstance(value, float) else str(value)


def write_dataset(files: Mapping[str, Path], path: Path) -> str:
    """Write `series.nc`, whole or not at all: all skies along the dimension `scene`, from their sky.h5.

    Returns why it is not written, empty where it is: other wavelengths, more skies than the memory should hold, or no
    xarray.
    """
    if not is_installed("xarray"):
        return str(missing("xarray", "it"))
    import xarray  # optional

    total = sum(file.stat().st_size for file in files.values())
    skies: list[Sky] = []
    for file in files.values():
        skies.append(read_sky(file))
        if len(skies) == 1 and _too_large(sky_to_dataset(skies[0]), len(files)):
            return f"the skies ({total / 1e9:.3g} GB compressed) are more than fits into the memory"
        if not np.array_equal(skies[0].wavelength_nm, skies[-1].wavelength_nm):
            return "the skies have different wavelengths"
    parts = [_of_a_series(sky_to_dataset(sky)) for sky in on_one_grid(skies)]
    scene = xarray.DataArray(list(files), dims="scene", name="scene", attrs=attributes("scene"))
    _write_netcdf(_concatenated(parts, scene), path)
    return ""


def write_series(skies: Iterable[Sky], path: Path, about: Mapping[str, Any], count: int) -> None:
    """Write skies as one NetCDF file, whole or not at all, along the dimension of `series_to_dataset`.

    about: further attributes; count: how many skies there are.
    Errors: TwilightError for more skies than the memory should hold, and where the file cannot be written.
    """

    def fitting() -> Iterator[Sky]:
        for i, sky in enumerate(skies):
            if i == 0 and _too_large(sky_to_dataset(sky), count):
                raise TwilightError(
                    f"{path}: {count} skies are more than fits into the memory; give a folder, or take `twilight sweep`"
                )
            yield sky

    dataset = series_to_dataset(fitting()).assign_attrs(about)
    path.parent.mkdir(parents=True, exist_ok=True)
    _write_netcdf(dataset, path)


def _too_large(one: xarray.Dataset, count: int) -> bool:
    """Whether so many skies are more than the memory should hold."""
    return one.nbytes * count * _COPIES > MEMORY_FRACTION * memory_bytes()


def _write_netcdf(dataset: xarray.Dataset, path: Path) -> None:
    encoding: dict[str, Any] = {
        name: {"zlib": True, "complevel": 4, "shuffle": True} for name in _PER_SKY if name in dataset.variables
    }
    if "time" in dataset.variables:
        encoding["time"] = {"units": attributes("time")["units"], "calendar": "standard", "dtype": "float64"}
    write_netcdf(dataset, path, encoding)


def series_to_dataset(skies: Iterable[Sky]) -> xarray.Dataset:
    """Skies as one dataset, along `time` (UTC) where all of them know theirs, else along `sun_elevation_deg`.

    Errors: TwilightError for skies with different wavelengths.
    """
    import xarray  # optional

    every = list(skies)
    if not every:
        raise TwilightError("to_xarray: the series holds no skies")
    if not all(np.array_equal(every[0].wavelength_nm, sky.wavelength_nm) for sky in every):
        raise TwilightError("to_xarray: the skies of the series have different wavelengths")
    parts = [_of_a_series(sky_to_dataset(sky)) for sky in on_one_grid(every)]
    if all("time" in part for part in parts):
        along = xarray.concat([part["time"] for part in parts], "time")
        parts = [part.drop_vars("time") for part in parts]
    else:
        suns = [float(part["solar_elevation_angle"]) for part in parts]
        name = "sun_elevation_deg"
        along = xarray.DataArray(suns, dims=name, name=name, attrs=attributes(name))
    return _concatenated(parts, along)


def _of_a_series(full: xarray.Dataset) -> xarray.Dataset:
    """What a series holds of one sky's dataset."""
    names = [name for name in (*_PER_SKY, *_SUN_AND_TIME, *_COMMON) if name in full.variables]
    return full[names].reset_coords([name for name in _SUN_AND_TIME if name in full.coords])


def _concatenated(parts: Sequence[xarray.Dataset], along: xarray.DataArray) -> xarray.Dataset:
    """Datasets of single skies along a new dimension, with what all of them know."""
    import xarray  # optional

    several = [name for name in (*_PER_SKY, *_SUN_AND_TIME) if all(name in part.variables for part in parts)]
    dataset = xarray.concat(
        [part[several] for part in parts], along, coords="minimal", compat="override", join="override", data_vars="all"
    )
    dataset = dataset.set_coords([name for name in _SUN_AND_TIME if name in dataset.variables])
    for name in (name for name in _COMMON if name in parts[0].variables):
        dataset[name] = parts[0][name]
    dataset.attrs = {**parts[-1].attrs, "title": f"{len(parts)} skies"}
    for name in ("configuration", "configuration_hash", "provenance", "run_time_s", "time_iso8601"):
        dataset.attrs.pop(name, None)
    return dataset


def on_one_grid(skies: Sequence[Sky]) -> list[Sky]:
    """Skies on one grid: as they are where they have one, else read at the rows and columns of all, close ones once."""
    first = skies[0]
    if all(
        np.array_equal(first.elevation_deg, sky.elevation_deg) and np.array_equal(first.azimuth_deg, sky.azimuth_deg)
        for sky in skies
    ):
        return list(skies)
    rows = _merged([sky.elevation_deg for sky in skies])
    lowest = max(float(sky.elevation_edges_deg[0]) for sky in skies)
    columns = _merged([sky.azimuth_deg for sky in skies])
    return [sky.resample(rows[rows >= lowest], columns) for sky in skies]


def _merged(parts_deg: Sequence[np.ndarray]) -> np.ndarray:
    """Angles of all parts in their order, but for those nearer to one of another part than CLOSEST_DEG and half the way
    to the next of their own: rows beside a break stay."""
    kept = parts_deg[0]
    for part in parts_deg[1:]:
        gap = np.minimum(np.diff(part, prepend=-np.inf), np.diff(part, append=np.inf))
        near = np.abs(part[:, None] - kept).min(axis=1)
        kept = np.union1d(kept, part[near > np.minimum(0.5 * gap, CLOSEST_DEG)])
    return kept


def number_files(folders: Sequence[Path], target: Path, names: Sequence[str] = NUMBERED) -> int:
    """Give the files of a series numbers in one folder, `sky.0001.png`, as programs want that read image sequences.

    Links to the same data where the file system has them, else copies.  Returns how many; errors: TwilightError.
    """
    count = 0
    with writing(target):
        for old in numbered_files(target):
            old.unlink()
        for i, folder in enumerate(folders, start=1):
            for name in names:
                if (folder / name).is_file():
                    target.mkdir(parents=True, exist_ok=True)
                    stem, _, suffix = name.rpartition(".")
                    link_or_copy(folder / name, target / f"{stem}.{i:04d}.{suffix}")
                    count += 1
    return count
