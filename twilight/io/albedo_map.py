"""Albedo of the ground by latitude and longitude, from a netCDF file by wavelength or a picture of the whole Earth.

A picture becomes spectra by one rule: linear Rec. 709 values weigh three spectra that are between 0 and 1, add up to 1
and have these values' colour under D65 (Mallett and Yuksel 2019, Spectral Primary Decomposition for Rendering with sRGB
Reflectance, as colour-science has them); grey is the same at every wavelength.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from twilight.base.conventions import ROUNDING
from twilight.base.errors import TwilightError
from twilight.base.extras import require
from twilight.base.reading import check_expansion, first_line
from twilight.io.netcdf import interruptible_h5netcdf
from twilight.io.stored_image import SAMPLE_SUFFIXES, read_samples, srgb_to_linear
from twilight.numerics.spectrum import colour_spectrum

PICTURES = (*SAMPLE_SUFFIXES, ".exr")
"""Names' ends of pictures; whatever else is read as netCDF."""
COORDINATES = {
    "latitude": ("latitude", "lat"),
    "longitude": ("longitude", "lon"),
    "radiation_wavelength": ("wavelength", "wavelength_nm", "wl"),
}
"""Names of each coordinate, by the name that CF conventions give it as `standard_name`."""
ALBEDO = ("albedo", "surface_albedo", "reflectance")
"""Names of the variable, where a file has several on the grid."""
NM = {"": 1.0, "nm": 1.0, "nanometer": 1.0, "nanometers": 1.0, "um": 1e3, "µm": 1e3, "micrometer": 1e3,
      "micrometers": 1e3, "micron": 1e3, "microns": 1e3, "m": 1e9}  # fmt: skip
"""Units of wavelength [nm]."""
NEAR_ITS_EDGE = 0.51
"""A point is in a map as long as it is no more of its steps outside: cells are known by their middles."""


@dataclass(frozen=True, eq=False)
class AlbedoMap:
    """Albedo on a grid; NaN where the map has none.

    latitude_deg (N,), longitude_deg (M,): increasing, of cells' middles, north and east positive; around the Earth the
    first meridian stands at the end once more.  channels (N, M, C): of the file; spectra (C, K): the albedo that a
    channel of 1 adds at wavelength_nm (K,), linear in between and constant outside.
    """

    latitude_deg: np.ndarray
    longitude_deg: np.ndarray
    channels: np.ndarray
    wavelength_nm: np.ndarray
    spectra: np.ndarray

    def at(self, latitude_deg: np.ndarray, longitude_deg: np.ndarray, wavelength_nm: np.ndarray) -> np.ndarray:
        """Albedo (D, W) at places (D,), bilinear between cells' middles; NaN where the map has none."""
        (i, p, north), (j, q, east) = self._cells(latitude_deg, longitude_deg)
        across = [self.channels[k, j] * (1.0 - q) + self.channels[k, j + 1] * q for k in (i, i + 1)]
        found = across[0] * (1.0 - p) + across[1] * p
        found[~(north & east)] = np.nan
        spectra = np.stack([np.interp(wavelength_nm, self.wavelength_nm, s) for s in self.spectra])
        return found @ spectra

    def _cells(self, latitude_deg: np.ndarray, longitude_deg: np.ndarray) -> list[tuple[np.ndarray, Any, np.ndarray]]:
        """(index of the node before, fraction (D, 1) towards the next, whether that is in the map) for both axes."""
        x = self.longitude_deg
        first = x[0] - NEAR_ITS_EDGE * (x[1] - x[0])
        found = []
        for axis, at in ((self.latitude_deg, latitude_deg), (x, first + np.mod(longitude_deg - first, 360.0))):
            k = np.clip(np.searchsorted(axis, at, side="right") - 1, 0, axis.size - 2)
            u = (at - axis[k]) / (axis[k + 1] - axis[k])
            inside = (u >= -NEAR_ITS_EDGE) & (u <= 1.0 + NEAR_ITS_EDGE)
            found.append((k, np.clip(u, 0.0, 1.0)[:, None], inside))
        return found

    def mean(self, latitude_deg: float, longitude_deg: float, radius_deg: float) -> np.ndarray:
        """Albedo (K,) at `wavelength_nm`, mean over the area within an angle of a place; NaN where the map has none."""
        lat, lon = np.radians(self.latitude_deg)[:, None], np.radians(self.longitude_deg - longitude_deg)
        here = np.radians(latitude_deg)
        cosine = np.sin(lat) * np.sin(here) + np.cos(lat) * np.cos(here) * np.cos(lon)
        width = np.gradient(self.longitude_deg)
        if self.longitude_deg[-1] - self.longitude_deg[0] > 360.0 - ROUNDING:
            width[[0, -1]] *= 0.5  # one meridian
        area = np.gradient(self.latitude_deg)[:, None] * np.cos(lat) * width
        area = np.where((cosine >= np.cos(np.radians(radius_deg))) & np.isfinite(self.channels[..., 0]), area, 0.0)
        if not area.any():
            return self.at(np.array([latitude_deg]), np.array([longitude_deg]), self.wavelength_nm)[0]
        rows, columns = area.any(axis=1), area.any(axis=0)
        weight = area[rows][:, columns] / area.sum()
        mean = np.einsum("nm,nmc->c", weight, np.nan_to_num(self.channels[rows][:, columns]), dtype=float)
        return np.asarray(np.clip(mean @ self.spectra, 0.0, 1.0))


def read_albedo_map(path: str | Path) -> AlbedoMap:
    """The map of a file.

    A picture (PNG, JPEG, TIFF, EXR) shows the whole Earth, twice as wide as high, north up, from 180 deg W to 180 deg
    E; whole numbers are sRGB unless the file says otherwise, floats linear; transparent pixels have no albedo.  A
    netCDF-4 (HDF5) file has a variable over latitude, longitude and, if it likes, wavelength, in any order, of the
    Earth or a part of it.
    Errors: TwilightError for a file that is none of these.
    """
    path = Path(path)
    if not path.is_file():
        raise TwilightError(f"ground.albedo_map: there is no file {path}")
    return _read(path, path.stat().st_mtime_ns)


@lru_cache(maxsize=1)  # every block of wavelengths asks for it
def _read(path: Path, changed_ns: int) -> AlbedoMap:
    made = _picture(path) if path.suffix.lower() in PICTURES else _netcdf(path)
    low, high = np.nanmin(made.channels, initial=np.inf), np.nanmax(made.channels, initial=-np.inf)
    if low > high:
        raise TwilightError(f"{path}: holds no albedo: every value is missing")
    if not (low >= 0.0 and high <= 1.0):
        raise TwilightError(f"{path}: albedo must be from 0 to 1; it has {low:g} to {high:g}")
    x = made.longitude_deg
    if x[0] + 360.0 - x[-1] > 1.5 * np.diff(x).max():
        return made
    around = np.concatenate([made.channels, made.channels[:, :1]], axis=1)
    return AlbedoMap(made.latitude_deg, np.append(x, x[0] + 360.0), around, made.wavelength_nm, made.spectra)


def _picture(path: Path) -> AlbedoMap:
    picture = read_samples(path)
    rgb = picture.light(None if picture.linear else srgb_to_linear)
    rgb = rgb if picture.missing is None else np.where(picture.missing[..., None], np.float32(np.nan), rgb)
    rows, columns = rgb.shape[:2]
    if columns != 2 * rows or rows < 2:
        raise TwilightError(
            f"{path}: a map of the whole Earth by latitude and longitude is twice as wide as high; it has {columns} x "
            f"{rows} pixels (a part of the Earth: as netCDF with latitude and longitude)"
        )
    step = 180.0 / rows
    lat, lon = -90.0 + step * (np.arange(rows) + 0.5), -180.0 + step * (np.arange(columns) + 0.5)
    nm = colour_spectrum("mallett red")[0]
    spectra = np.stack([colour_spectrum(f"mallett {channel}")[1] for channel in ("red", "green", "blue")])
    return AlbedoMap(lat, lon, rgb[::-1], nm, spectra / spectra.sum(axis=0))


def _netcdf(path: Path) -> AlbedoMap:
    require(f"{path}: a map in netCDF", "xarray")
    import xarray  # optional

    interruptible_h5netcdf()
    try:
        with xarray.open_dataset(path, engine="h5netcdf", decode_times=False) as data:
            check_expansion(path, sum(variable.nbytes for variable in data.variables.values()))
            return _of_dataset(path, data)
    except TwilightError:
        raise
    except Exception as error:  # what a damaged file raises depends on where it is cut
        raise TwilightError(
            f"{path}: is no map of albedo, which is a picture ({', '.join(PICTURES)}) or a netCDF-4 file "
            f"({first_line(error)})"
        ) from None


def _of_dataset(path: Path, data: Any) -> AlbedoMap:
    found = {}
    for standard, names in COORDINATES.items():
        for name, one in data.variables.items():
            if one.ndim == 1 and (str(name).lower() in names or one.attrs.get("standard_name") == standard):
                found[standard] = name, str(one.dims[0])
    lat, lon, nm = (found.get(standard) for standard in COORDINATES)
    if lat is None or lon is None:
        raise TwilightError(f"{path}: has no latitude and longitude of one dimension each (lat, lon)")
    maps = [name for name in data.data_vars if {lat[1], lon[1]} <= set(data[name].dims)]
    named = [name for name in maps if str(name).lower() in ALBEDO]
    if len(named or maps) != 1:
        raise TwilightError(
            f"{path}: must have one variable over latitude and longitude, or one named {' or '.join(ALBEDO)}; it has "
            f"{', '.join(map(str, maps)) or 'none'}"
        )
    variable = data[(named or maps)[0]]
    order = [lat[1], lon[1], *([nm[1]] if nm is not None and nm[1] in variable.dims else [])]
    variable = variable.squeeze([d for d, n in variable.sizes.items() if n == 1 and d not in order])
    if set(variable.dims) != set(order):
        others = ", ".join(f"{d} ({n})" for d, n in variable.sizes.items() if d not in order)
        raise TwilightError(f"{path}: {variable.name} must be over latitude, longitude and wavelength; it has {others}")
    values = variable.transpose(*order).values.astype(np.float64)
    values = values if values.ndim == 3 else values[..., None]
    latitude = _increasing(path, "latitude", data[lat[0]].values, (-90.0, 90.0))
    longitude = _increasing(path, "longitude", data[lon[0]].values, (-360.0, 360.0), turn=True)
    wavelength, by_nm = np.array([550.0]), np.array([0])
    if len(order) == 3:
        assert nm is not None
        unit = str(data[nm[0]].attrs.get("units", "")).lower()
        if unit not in NM:
            raise TwilightError(f"{path}: its wavelengths are in {unit!r}; known are nm, um and m")
        wavelength, by_nm = _increasing(path, "wavelength [nm]", NM[unit] * data[nm[0]].values, (100.0, 1e5))
    values = values[latitude[1]][:, longitude[1]][..., by_nm]
    return AlbedoMap(latitude[0], longitude[0], values, wavelength, np.eye(wavelength.size))


def _increasing(
    path: Path, name: str, values: np.ndarray, allowed: tuple[float, float], turn: bool = False
) -> tuple[np.ndarray, np.ndarray]:
    """(values of a coordinate in increasing order, their places in the file); turn: of longitudes, however they count,
    from behind the widest gap on."""
    values = np.asarray(values, dtype=float)
    if not (np.isfinite(values).all() and (values >= allowed[0] - 1e-6).all() and (values <= allowed[1] + 1e-6).all()):
        raise TwilightError(
            f"{path}: {name} must be from {allowed[0]:g} to {allowed[1]:g}; it has {values.min():g} to {values.max():g}"
        )
    made, place = np.unique(np.mod(values + 180.0, 360.0) - 180.0 if turn else values, return_index=True)
    if made.size < (1 if allowed[0] > 0.0 else 2) or (made.size < values.size - (1 if turn else 0)):
        raise TwilightError(f"{path}: {name} must have two values or more, each once")
    if turn:
        cut = int(np.argmax(np.diff(made, append=made[0] + 360.0))) + 1
        made, place = np.append(made[cut:], made[:cut] + 360.0), np.roll(place, -cut)
    return made, place
