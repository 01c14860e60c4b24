"""``sky.h5``: a Sky as HDF5 that is netCDF-4 with CF attributes, read through xarray.

It is written through h5netcdf alone, as xarray would: importing xarray takes 0.4 s of processor time, a third of a
picture whose field is cached.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from datetime import UTC, datetime
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from twilight.base.errors import TwilightError
from twilight.base.reading import check_expansion, reading
from twilight.base.whole_files import whole_content
from twilight.io.labels import attributes
from twilight.io.provenance import coordinates_of, fields_from, provenance_fields, provenance_from_fields
from twilight.io.rendered import Options, Rendered
from twilight.numerics.spectrum import DEFAULT_SOLAR_SPECTRUM, wavelength_bounds
from twilight.sky.disc import Disc
from twilight.sky.sky import Sky

if TYPE_CHECKING:
    import xarray

CONVENTIONS = "CF-1.11"
_DIRECTIONS = ("elevation", "azimuth")
_GRID = (*_DIRECTIONS, "wavelength")
_RADIANCE = "sun_normalised_radiance"
_ATTRIBUTE_LIMIT = 60_000
"""HDF5 keeps an attribute in the object header, at most 64 KiB; longer texts become scalar variables."""
_Variable = tuple[str, str | tuple[str, ...], Any]
"""Name, dimensions and values."""


class _Contents(NamedTuple):
    """What ``sky.h5`` holds: variables and coordinates as (dimensions, values[, attributes]), and its attributes."""

    variables: dict[str, Any]
    coordinates: dict[str, Any]
    attributes: dict[str, Any]


def sky_to_dataset(sky: Sky) -> xarray.Dataset:
    """The sky with the variables and attributes of ``sky.h5``; its time, where it has one, as datetime64 in UTC."""
    import xarray  # optional

    dataset = xarray.Dataset(*_contents(sky))
    if sky.time is not None:
        about = dict(dataset["time"].attrs)
        encoding = {name: about.pop(name) for name in ("units", "calendar")} | {"dtype": "float64"}
        time = xarray.Variable((), np.datetime64(sky.time.astimezone(UTC).replace(tzinfo=None), "us"), about)
        dataset = dataset.assign_coords(time=time)
        dataset["time"].encoding = encoding
    return dataset


@cache
def interruptible_h5netcdf() -> Any:
    """The module `h5netcdf`, whose files are silent where an interrupt leaves them half made.

    An interrupt within the constructor of `h5netcdf.File` leaves an object without some of its attributes, whose
    `__del__` then prints a traceback beside the one sentence that the user gets.
    """
    import h5netcdf  # start-up

    def close(self: Any) -> None:
        with suppress(AttributeError):
            self.close()

    h5netcdf.File.__del__ = close
    return h5netcdf


def write_netcdf(dataset: xarray.Dataset, path: str | Path, encoding: dict[str, Any] | None = None) -> None:
    """Write a NetCDF file, whole or not at all; encoding: as of `xarray.Dataset.to_netcdf`.

    Errors: TwilightError where it cannot be written.
    """
    interruptible_h5netcdf()
    with whole_content(path) as content:
        dataset.to_netcdf(content, engine="h5netcdf", encoding=encoding)


def _contents(sky: Sky) -> _Contents:
    coords: dict = {
        "wavelength": ("wavelength", sky.wavelength_nm, attributes("wavelength") | {"bounds": "wavelength_bnds"}),
        "elevation": ("elevation", sky.elevation_deg, attributes("elevation") | {"bounds": "elevation_bnds"}),
        "azimuth": ("azimuth", sky.azimuth_deg, attributes("azimuth") | {"bounds": "azimuth_bnds"}),
    }
    coords |= coordinates_of(sky)
    if sky.time is not None:
        about = {"calendar": "standard", "units_metadata": "leap_seconds: none", "axis": "T"}
        coords["time"] = ((), sky.time.timestamp(), attributes("time") | about)
    edges, azimuth = sky.elevation_edges_deg, sky.azimuth_deg
    turns = 0.5 * (azimuth + np.append(azimuth[1:], azimuth[0] + 360.0))
    variables: dict = {
        "wavelength_bnds": (("wavelength", "nv"), wavelength_bounds(sky.wavelength_nm, sky.solar_spectrum)),
        "elevation_bnds": (("elevation", "nv"), np.stack([edges[:-1], edges[1:]], axis=1)),
        "azimuth_bnds": (("azimuth", "nv"), np.stack([np.append(turns[-1] - 360.0, turns[:-1]), turns], axis=1)),
    }
    for name, dims, values in (
        ("radiance", _GRID, sky.radiance),
        (_RADIANCE, _GRID, sky.sun_normalised_radiance),
        ("luminance", _DIRECTIONS, sky.luminance()),
        ("solar_irradiance", "wavelength", sky.solar_irradiance),
        ("surface_albedo", "wavelength", sky.ground_albedo),
        ("standard_error", _GRID, sky.standard_error),
        *_polarisation(sky),
        ("night_radiance", _GRID, sky.night_radiance),
        ("direct_irradiance_factor", "wavelength", sky.direct_irradiance),
        *_disc_variables(sky.disc),
    ):
        if values is not None:
            variables[name] = (dims, values, attributes(name))
    variables["solar_irradiance"][2]["source"] = sky.solar_spectrum
    for letter in ("", "_q", "_u"):
        if f"standard_error{letter}" in variables:
            variables[f"{_RADIANCE}{letter}"][2]["ancillary_variables"] = f"standard_error{letter}"
    fields = provenance_fields(sky.provenance)
    about_all: dict = {
        "Conventions": CONVENTIONS,
        "title": f"Radiance of the sky, sun at {sky.sun_elevation_deg:g} degrees elevation",
        "source": f"twilight {fields['twilight_version']}",
        "history": f"written by twilight {fields['twilight_version']}",
        "references": "Haber, Magnor, Seidel 2005, Physically-based simulation of twilight phenomena",
        "solar_spectrum": sky.solar_spectrum,
    }
    if sky.time is not None:
        about_all["time_iso8601"] = sky.time.isoformat()
    for name, value in fields.items():
        if isinstance(value, str) and len(value.encode()) > _ATTRIBUTE_LIMIT:
            variables[name] = ((), np.array(value, dtype=object), {"long_name": f"{name}, JSON"})
        else:
            about_all[name] = value
    return _Contents(variables, coords, about_all)


def _polarisation(sky: Sky) -> Iterator[_Variable]:
    """The variables of a polarised sky."""
    if sky.polarisation is None:
        return
    for i, letter in enumerate("qu"):
        yield f"{_RADIANCE}_{letter}", _GRID, sky.polarisation[:, :, i]
        if sky.polarisation_error is not None:
            yield f"standard_error_{letter}", _GRID, sky.polarisation_error[:, :, i]
    yield "degree_of_linear_polarisation", _GRID, sky.degree_of_linear_polarisation
    yield "angle_of_linear_polarisation", _GRID, sky.angle_of_linear_polarisation_deg


def _disc_variables(disc: Disc | None) -> Iterator[_Variable]:
    """The variables of a sky that knows the sun's disc."""
    if disc is not None:
        yield "disc_elevation", "disc_elevation", disc.elevation_deg
        yield "disc_true_elevation", ("disc_elevation", "wavelength"), disc.true_elevation_deg
        yield "disc_transmittance", ("disc_elevation", "wavelength"), disc.transmittance
        yield "disc_radius", (), disc.radius_deg


def write_sky(sky: Sky, path: str | Path) -> Path:
    """Write a sky as HDF5 / netCDF-4, whole or not at all; one compressed chunk per wavelength.  Returns the path.

    Errors: TwilightError where the file cannot be written.
    """
    from h5py import string_dtype  # start-up

    h5netcdf = interruptible_h5netcdf()
    contents = _contents(sky)
    # xarray takes what this attribute names for coordinates
    scalars = " ".join(sorted(name for name, (dims, *_) in contents.coordinates.items() if not dims))
    with whole_content(path) as content, h5netcdf.File(content, "w") as file:
        for name, (dims, values, *about) in (contents.coordinates | contents.variables).items():
            dims = (dims,) if isinstance(dims, str) else tuple(dims)
            values = np.asarray(values)
            for dim, size in zip(dims, values.shape, strict=True):
                if dim not in file.dimensions:
                    file.dimensions[dim] = size
            options: dict[str, Any] = {}
            if dims == _GRID:
                chunks = (*values.shape[:2], 1)
                options = {"chunks": chunks, "compression": "gzip", "compression_opts": 4, "shuffle": True}
            dtype = string_dtype() if values.dtype == object else values.dtype
            variable = file.create_variable(name, dims, dtype, **options)
            variable[...] = values
            described = dict(about[0]) if about else {}
            if name in contents.variables and scalars and not name.endswith("_bnds"):
                described["coordinates"] = scalars
            for key, value in described.items():
                variable.attrs[key] = value
        for key, value in contents.attributes.items():
            file.attrs[key] = value
    return Path(path)


def write_h5(rendered: Rendered, folder: Path, options: Options) -> list[Path]:
    """``sky.h5``."""
    return [write_sky(rendered.sky, folder / "sky.h5")]


def read_sky(path: str | Path) -> Sky:
    """Read what `write_sky` wrote; every array comes back bit for bit.

    Errors: TwilightError where the file is missing, not complete, or not a sky."""
    path = Path(path)
    with reading(path, "a complete HDF5 file"):
        variables, about = _load(path)
    for name in (*_GRID, "sun_normalised_radiance", "solar_elevation_angle"):
        if name not in variables:
            raise TwilightError(f"{path}: has no variable '{name}', so it is not a sky written by twilight")
    if set(variables["sun_normalised_radiance"].dims) != set(_GRID):
        raise TwilightError(f"{path}: sun_normalised_radiance must have the dimensions {', '.join(_GRID)}")
    with reading(path, "a sky written by twilight"):
        try:
            return _sky(variables, about)
        except TwilightError as error:
            raise TwilightError(f"{path}: {error}") from None


def check_self_contained(path: str | Path) -> None:
    """TwilightError for a file of HDF5 whose data are in other files, which it names: by links, external storage or
    virtual datasets."""
    import h5py  # start-up

    def check(group: Any) -> None:
        for name in group:
            link = group.get(name, getlink=True)
            if isinstance(link, h5py.ExternalLink | h5py.SoftLink):
                raise TwilightError(
                    f"{path}: '{name}' is a link to {getattr(link, 'filename', link.path)}; not followed"
                )
            found = group[name]
            if isinstance(found, h5py.Dataset) and (found.external or found.is_virtual):
                raise TwilightError(f"{path}: the values of '{name}' are in another file, which is not read")
            if isinstance(found, h5py.Group):
                check(found)

    with h5py.File(path, "r") as file:
        check(file)


class _Stored(NamedTuple):
    """A variable of a file: its dimensions and values."""

    dims: tuple[str, ...]
    values: np.ndarray


class _File(NamedTuple):
    """The variables of a file by their names, and its attributes."""

    variables: dict[str, _Stored]
    attributes: dict[str, Any]


def _load(path: Path) -> _File:
    """All of a file; through h5netcdf alone, as it is written."""
    check_self_contained(path)
    with interruptible_h5netcdf().File(path, "r", phony_dims="sort") as opened:
        sizes = [np.prod(v.shape, dtype=float) * getattr(v.dtype, "itemsize", 8) for v in opened.variables.values()]
        check_expansion(path, sum(sizes))
        variables = {name: _Stored(v.dimensions, np.asarray(v[...])) for name, v in opened.variables.items()}
        return _File(variables, dict(opened.attrs))


def _sky(variables: dict[str, _Stored], about: dict[str, Any]) -> Sky:
    def array(name: str) -> np.ndarray | None:
        if name not in variables:
            return None
        dims, values = variables[name]
        return values.transpose([dims.index(dim) for dim in _GRID]) if values.ndim == 3 else values

    def pair(q: str, u: str) -> np.ndarray | None:
        both = array(q), array(u)
        return None if both[0] is None or both[1] is None else np.stack(both, axis=2)  # type: ignore[arg-type]

    def number(*names: str) -> float | None:
        return next((float(variables[name].values) for name in names if name in variables), None)

    fields = dict(about)
    for name in ("configuration", "provenance"):
        if name in variables:
            text = variables[name].values[()]
            fields[name] = text.decode() if isinstance(text, bytes) else str(text)
    time = about.get("time_iso8601")
    axes = [variables[name].values for name in ("wavelength", "elevation", "azimuth")]
    when = None if time is None else datetime.fromisoformat(time)
    return sky_of(axes, array, pair, number, fields, time=when, disc=_disc(variables))


def sky_of(
    axes: Sequence[np.ndarray],
    array: Callable[[str], np.ndarray | None],
    pair: Callable[[str, str], np.ndarray | None],
    number: Callable[..., float | None],
    about: dict[str, Any],
    **more: Any,
) -> Sky:
    """A sky of wavelengths, elevations and azimuths, from what gives the variables of ``sky.h5`` by name: arrays, Q and
    U as one, numbers (`fields_from`); about: its attributes.  None: it is not there."""
    facts = {"provenance": provenance_from_fields(about), **fields_from(number), **more}
    return Sky(
        wavelength_nm=axes[0],
        elevation_deg=axes[1],
        azimuth_deg=axes[2],
        sun_normalised_radiance=array(_RADIANCE),  # type: ignore[arg-type]
        ground_albedo=array("surface_albedo"),
        standard_error=array("standard_error"),
        polarisation=pair(f"{_RADIANCE}_q", f"{_RADIANCE}_u"),
        polarisation_error=pair("standard_error_q", "standard_error_u"),
        night_radiance=array("night_radiance"),
        direct_irradiance=array("direct_irradiance_factor"),
        solar_spectrum=str(about.get("solar_spectrum", DEFAULT_SOLAR_SPECTRUM)),
        **facts,
    )


def _disc(variables: dict[str, _Stored]) -> Disc | None:
    names = ("disc_elevation", "disc_true_elevation", "disc_transmittance", "disc_radius")
    if not all(name in variables for name in names):
        return None
    elevation, true, transmittance, radius = (variables[name].values for name in names)
    sun = float(variables["solar_elevation_angle"].values)
    return Disc(variables["wavelength"].values, elevation, true, transmittance, sun, float(radius))
