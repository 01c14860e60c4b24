"""Fields of heights: by formulas, shipped, from .npy and from GeoTIFF."""

from __future__ import annotations

from importlib import resources
from pathlib import Path
from typing import NamedTuple

import numpy as np

from twilight.base.errors import TwilightError
from twilight.base.extras import missing
from twilight.base.reading import check_npy
from twilight.config.terrain import Terrain

MOST_POINTS = 4096
"""Most altitudes along a side of a file."""
SHIPPED = {"jacksboro": (30.1, 31.8)}
"""Extents (x, y) [km] of the fields of heights in `data/terrain`."""


class Heights(NamedTuple):
    """Altitudes above sea level [km], (N, M), on a level sphere around the observer.

    low_x_km, low_y_km: place of altitude_km[0, 0], x to the right of the sun and y towards it, distances along the
    sphere; step_km (2,): of columns (x) and rows (y), in the axes turned by cos_turn, sin_turn.
    """

    altitude_km: np.ndarray
    low_x_km: float
    low_y_km: float
    step_x_km: float
    step_y_km: float
    cos_turn: float
    sin_turn: float
    highest_km: float

    def facing(self, azimuth_deg: float) -> Heights:
        """The same heights for x and y from another azimuth, clockwise from the present one."""
        turn = np.arctan2(self.sin_turn, self.cos_turn) - np.radians(azimuth_deg)
        return self._replace(cos_turn=float(np.cos(turn)), sin_turn=float(np.sin(turn)))


class Standpoint(NamedTuple):
    """Where the observer stands [deg, north and east positive] and the sun's azimuth, clockwise from north [deg]."""

    latitude_deg: float
    longitude_deg: float
    sun_azimuth_deg: float


class HeightRaster(NamedTuple):
    """A file of altitudes [m], the northern or far side first.

    size_km: extent (x, y) where the file knows it; column, row: of the observer, counted from the first pixel's centre,
    and grid_north_deg: azimuth of the columns' direction there, where file and observer have a place.
    """

    metres: np.ndarray
    size_km: tuple[float, float] | None = None
    column: float | None = None
    row: float = 0.0
    grid_north_deg: float = 0.0


def heights_of(terrain: Terrain, folder: Path | None = None, standpoint: Standpoint | None = None) -> Heights:
    """The heights that a configuration names; paths count from `folder`.

    standpoint: of an observer whose place and sun are known; a GeoTIFF with coordinates then lies where it is, its
    north to the north.  Otherwise the observer stands in its middle and its far side lies towards the sun.
    Errors: TwilightError for a file that cannot be read, holds something else or lies elsewhere.
    """
    size_x = size_y = terrain.size_km
    raster: HeightRaster | None = None
    if terrain.heights in _FORMULAS:
        u = (np.arange(terrain.count) + 0.5) / terrain.count - 0.5
        x, y = np.meshgrid(u, u)
        shape = _FORMULAS[terrain.heights](x, y, terrain.seed)
        altitude = terrain.base_km + terrain.height_km * shape / shape.max()
    elif terrain.heights in SHIPPED:
        with resources.files("twilight").joinpath(f"data/terrain/{terrain.heights}.npy").open("rb") as file:
            altitude = np.load(file)[::-1] / 1000.0
        size_x, size_y = SHIPPED[terrain.heights]
    else:
        path = Path(terrain.heights) if folder is None else folder / terrain.heights
        raster = _read(path, standpoint)
        if raster.size_km is not None:
            size_x, size_y = raster.size_km
        else:
            size_y = size_x * raster.metres.shape[0] / raster.metres.shape[1]
        altitude = raster.metres[::-1] / 1000.0
    turn = np.radians(terrain.azimuth_deg)
    rows, columns = altitude.shape
    step_x, step_y = size_x / columns, size_y / rows
    low_x, low_y = -0.5 * size_x + 0.5 * step_x, terrain.distance_km - 0.5 * size_y + 0.5 * step_y
    if standpoint is not None and raster is not None and raster.column is not None:
        if terrain.model_fields_set & {"distance_km", "azimuth_deg"}:
            raise TwilightError(
                f"terrain: {terrain.heights} has coordinates, and the observer a place; leave out distance_km and "
                "azimuth_deg"
            )
        low_x, low_y = -raster.column * step_x, -(rows - 1 - raster.row) * step_y
        turn = -np.radians(standpoint.sun_azimuth_deg - raster.grid_north_deg)
    return Heights(
        np.ascontiguousarray(altitude, dtype=np.float32),
        low_x,
        low_y,
        step_x,
        step_y,
        float(np.cos(turn)),
        float(np.sin(turn)),
        float(altitude.max()),
    )


def _read(path: Path, standpoint: Standpoint | None) -> HeightRaster:
    """A .npy or GeoTIFF file; TwilightError where it is neither, or does not hold the observer's place."""
    if not path.is_file():
        raise TwilightError(f"terrain.heights: there is no file {path}")
    about = HeightRaster(np.empty((0, 0)))
    if path.suffix.lower() == ".npy":
        try:
            check_npy(path)
            values = np.load(path, allow_pickle=False)
        except (ValueError, OSError, EOFError):
            raise TwilightError(f"{path}: is not a .npy file of numbers") from None
    else:
        try:
            import rasterio  # optional
        except ImportError:
            raise missing("rasterio", f"{path}: reading GeoTIFF") from None
        try:
            with rasterio.open(path) as file:
                _check_shape(path, file.shape)
                values = file.read(1, masked=True).filled(np.nan)
                about = about._replace(size_km=_size_km(file))
                if standpoint is not None and file.crs is not None:
                    about = _stand_on(about, file, path, standpoint)
        except rasterio.errors.RasterioError as error:
            raise TwilightError(f"{path}: cannot be read as GeoTIFF ({error})") from None
    _check_shape(path, values.shape)
    if not np.issubdtype(values.dtype, np.number):
        raise TwilightError(f"{path}: must hold altitudes, has {values.dtype}")
    values = np.asarray(values, dtype=float)
    if not np.isfinite(values).all() or values.min() < -1000.0 or values.max() > 100000.0:
        raise TwilightError(f"{path}: altitudes must be numbers from -1000 to 100000 m without gaps")
    return about._replace(metres=values)


def _check_shape(path: Path, shape: tuple[int, ...]) -> None:
    if len(shape) != 2 or min(shape) < 2 or max(shape) > MOST_POINTS:
        raise TwilightError(f"{path}: must hold 2 x 2 to {MOST_POINTS} x {MOST_POINTS} altitudes, has {shape}")


def _stand_on(raster: HeightRaster, file, path: Path, standpoint: Standpoint) -> HeightRaster:
    """The raster with the observer's column and row and the direction of its columns there."""
    from rasterio.warp import transform  # optional

    step_deg = 0.01
    latitudes = [standpoint.latitude_deg, standpoint.latitude_deg + step_deg]
    longitude = (standpoint.longitude_deg + 180.0) % 360.0 - 180.0
    x, y = transform("EPSG:4326", file.crs, [longitude, longitude], latitudes)
    inverse = ~file.transform
    column = inverse.a * x[0] + inverse.b * y[0] + inverse.c
    row = inverse.d * x[0] + inverse.e * y[0] + inverse.f
    rows, columns = file.shape
    if not (0.0 <= column <= columns and 0.0 <= row <= rows):
        raise TwilightError(
            f"{path}: the observer at latitude {standpoint.latitude_deg:g}, longitude {standpoint.longitude_deg:g} "
            "stands outside of it"
        )
    # how far the grid's north, up its columns, is turned clockwise from true north
    north = -np.degrees(np.arctan2(x[1] - x[0], y[1] - y[0]))
    return raster._replace(column=column - 0.5, row=row - 0.5, grid_north_deg=float(north))


def _size_km(file) -> tuple[float, float]:
    """Extent (x, y) [km] of a raster in degrees or metres."""
    bounds = file.bounds
    across, up = bounds.right - bounds.left, bounds.top - bounds.bottom
    if file.crs is not None and file.crs.is_geographic:
        per_degree = np.pi / 180.0 * 6371.0
        return across * per_degree * float(np.cos(np.radians(0.5 * (bounds.top + bounds.bottom)))), up * per_degree
    return across / 1000.0, up / 1000.0


def _ridges(x: np.ndarray, y: np.ndarray, seed: int) -> np.ndarray:
    """Crests by octaves of folded noise, higher away from a valley along y through the middle."""
    random = np.random.default_rng(seed)
    total, weight, fraction = np.zeros_like(x), np.ones_like(x), 1.0
    for octave in range(7):
        n = 5 * 2**octave
        noise = random.standard_normal((n + 3, n + 3))
        smooth = _cubic(noise, (x + 0.5) * n, (y + 0.5) * n)
        fold = np.clip(1.0 - np.abs(smooth) / 1.6, 0.0, 1.0) ** 1.5
        total += fraction * weight * fold
        weight, fraction = np.clip(1.8 * weight * fold, 0.05, 1.0), 0.55 * fraction
    away = np.clip((np.hypot(x, 0.35 * y) - 0.015) / 0.12, 0.0, 1.0)
    return total * away * away * (3.0 - 2.0 * away)


def _cubic(noise: np.ndarray, u: np.ndarray, v: np.ndarray) -> np.ndarray:
    """Smooth interpolation (uniform cubic B-spline) of noise at its unit grid."""
    i, j = np.floor(u).astype(int), np.floor(v).astype(int)
    out = np.zeros_like(u)
    for a, weight_a in enumerate(_spline(u - i)):
        for b, weight_b in enumerate(_spline(v - j)):
            out += weight_a * weight_b * noise[j + b, i + a]
    return 2.0 * out


def _spline(t: np.ndarray) -> tuple[np.ndarray, ...]:
    return ((1 - t) ** 3 / 6, (3 * t**3 - 6 * t**2 + 4) / 6, (-3 * t**3 + 3 * t**2 + 3 * t + 1) / 6, t**3 / 6)


def _ridge(x: np.ndarray, y: np.ndarray, seed: int) -> np.ndarray:
    """One crest across, with notches."""
    random = np.random.default_rng(seed)
    crest = np.ones_like(x)
    for n in (5, 9, 17, 33):
        crest += 0.8 / n * 4 * np.cos(2 * np.pi * (n * x + random.random()))
    return np.maximum(crest, 0.05) * np.clip(1.0 - np.abs(y) / 0.12, 0.0, None)


def _peak(x: np.ndarray, y: np.ndarray, seed: int) -> np.ndarray:
    """A cone with concave flanks, a tenth of the square in radius."""
    return np.clip(1.0 - np.hypot(x, y) / 0.1, 0.0, None) ** 1.3


_FORMULAS = {"ridges": _ridges, "ridge": _ridge, "peak": _peak}
