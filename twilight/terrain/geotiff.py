"""Heights of a GeoTIFF on a level metric grid about the observer: where, how large and in which unit the file says.

rasterio reads the file (nodata, masks, whole numbers, scale and offset of the band) and lays it on an azimuthal
equidistant grid, in which distances and directions from the observer are true, from whatever coordinate system, order
of rows or rotation it is stored in.
"""

import re
import warnings
from functools import lru_cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from twilight.base.errors import TwilightError, TwilightWarning
from twilight.base.extras import missing
from twilight.base.reading import first_line

MOST_POINTS = 4096
"""Most altitudes along a side of a file, and of the grid that it is laid on."""
LEAST_STEP_M = 0.05
"""Smallest pixel of a file without a coordinate system [m]: what is smaller is no metre."""
REACH_KM = 1000.0
"""Land farther from the observer than this is left out [km]: lines of sight to terrain are at most 600 km long."""
METRES = {
    "m": 1.0, "metre": 1.0, "meter": 1.0, "metres": 1.0, "meters": 1.0,
    "km": 1000.0, "kilometre": 1000.0, "kilometer": 1000.0, "kilometres": 1000.0, "kilometers": 1000.0,
    "dm": 0.1, "decimetre": 0.1, "decimeter": 0.1, "decimetres": 0.1, "decimeters": 0.1,
    "cm": 0.01, "centimetre": 0.01, "centimeter": 0.01, "centimetres": 0.01, "centimeters": 0.01,
    "mm": 0.001, "millimetre": 0.001, "millimeter": 0.001, "millimetres": 0.001, "millimeters": 0.001,
    "ft": 0.3048, "foot": 0.3048, "feet": 0.3048, "international foot": 0.3048, "foot (international)": 0.3048,
    "us survey foot": 1200.0 / 3937.0, "us survey feet": 1200.0 / 3937.0, "us-ft": 1200.0 / 3937.0,
    "ftus": 1200.0 / 3937.0, "foot_us": 1200.0 / 3937.0,
}  # fmt: skip
"""Length of units of height [m], by their names in lower case."""
VERTICAL = re.compile(r'VERT_?(?:CS|CRS)\[.*?UNIT\["[^"]*",\s*([0-9.eE+-]+)', re.DOTALL)
"""The length of the unit of heights [m] in the text (WKT) of a coordinate system that has heights."""


class Land(NamedTuple):
    """Altitudes [m] on a metric grid, the northern side first, NaN where the file has none.

    west_m, north_m: place of metres[0, 0] from the observer, or from the file's middle where nobody stands in it;
    step_m: between rows and between columns; None: the file does not say how large it is.
    """

    metres: np.ndarray
    west_m: float = 0.0
    north_m: float = 0.0
    step_m: float | None = None


def read_geotiff(path: Path, place: tuple[float, float] | None) -> tuple[Land, bool]:
    """(the land of a GeoTIFF, whether it lies about the place).

    place: latitude and longitude of the observer [deg]; None, or a file without coordinates: its middle.
    Errors: TwilightError for a file that cannot be read, holds no heights, or lies elsewhere than the place.
    """
    return _read(path, path.stat().st_mtime_ns, place)


@lru_cache(maxsize=1)  # every frame of a film and every block of wavelengths asks for it
def _read(path: Path, changed_ns: int, place: tuple[float, float] | None) -> tuple[Land, bool]:
    try:
        import rasterio  # optional
    except ImportError:
        raise missing("rasterio", f"{path}: reading GeoTIFF") from None
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", rasterio.errors.NotGeoreferencedWarning)
            with rasterio.open(path) as file:
                check_shape(path, file.shape)
                _check_place(file, path, place)
                metres = _metres(file, path)
                if file.transform.is_identity:
                    return Land(metres), False
                return _on_grid(metres, file.transform, file.crs, path, place), file.crs is not None and bool(place)
    except (rasterio.errors.RasterioError, rasterio._err.CPLE_BaseError) as error:
        raise TwilightError(f"{path}: cannot be read as GeoTIFF ({first_line(error)})") from None


def _check_place(file: Any, path: Path, place: tuple[float, float] | None) -> None:
    """TwilightError for a file that says half of where it lies; a warning where that is not compared with the place."""
    if file.transform.is_identity and file.gcps[0]:
        raise TwilightError(
            f"{path}: is placed by ground control points; lay it on a grid first (gdalwarp in.tif out.tif)"
        )
    if file.transform.is_identity:
        if file.crs is not None:
            raise TwilightError(
                f"{path}: says its coordinate system and not where its pixels lie in it; say it "
                "(gdal_edit.py -a_ullr WEST NORTH EAST SOUTH), or remove both"
            )
        return
    if file.crs is None:
        step = float(np.hypot(file.transform.a, file.transform.d))
        if step < LEAST_STEP_M:
            raise TwilightError(
                f"{path}: has no coordinate system, and its pixels are {step:.3g} m large if its coordinates are "
                f"metres, allowed is {LEAST_STEP_M:g} m or more; if they are degrees, say so "
                "(gdal_edit.py -a_srs EPSG:4326)"
            )
        if place is not None:
            warnings.warn(
                f"{path}: has no coordinate system; it is not laid where its coordinates are, but with its middle "
                "where terrain.distance_km and terrain.azimuth_deg say",
                TwilightWarning, stacklevel=2,
            )  # fmt: skip
    elif not (file.crs.is_geographic or file.crs.is_projected):
        raise TwilightError(
            f"{path}: its coordinate system is none of places on Earth; say which it is (gdal_edit.py -a_srs ...), or "
            "remove it (gdal_edit.py -a_srs None)"
        )


def check_shape(path: Path, shape: tuple[int, ...]) -> None:
    """TwilightError for an array that is no grid, or too large."""
    if len(shape) != 2 or min(shape) < 2 or max(shape) > MOST_POINTS:
        raise TwilightError(f"{path}: must hold 2 x 2 to {MOST_POINTS} x {MOST_POINTS} altitudes, has {shape}")


def _metres(file: Any, path: Path) -> np.ndarray:
    """Heights [m] of the file's band, NaN where it has none."""
    from rasterio.enums import ColorInterp  # optional

    bands = [n for n, kind in zip(file.indexes, file.colorinterp, strict=True) if kind != ColorInterp.alpha]
    if len(bands) != 1:
        raise TwilightError(f"{path}: must hold heights in one band, has {len(bands)} bands")
    band = bands[0]
    if np.issubdtype(np.dtype(file.dtypes[band - 1]), np.complexfloating):
        raise TwilightError(f"{path}: must hold altitudes, has {file.dtypes[band - 1]}")
    values = np.ma.filled(file.read(band, masked=True).astype(float), np.nan)
    if np.isnan(values).all():
        raise TwilightError(f"{path}: holds no heights: every pixel is nodata")
    if np.isinf(values).any():
        raise TwilightError(f"{path}: heights must be finite; it has infinite ones")
    return (values * file.scales[band - 1] + file.offsets[band - 1]) * _unit_m(file, band, path)


def _unit_m(file: Any, band: int, path: Path) -> float:
    """Length [m] of the unit of a band: its own word, else that of the heights' coordinate system, else metres."""
    text = "" if file.crs is None else file.crs.to_wkt()
    name = (file.units[band - 1] or "").strip()
    if name:
        if name.lower() not in METRES:
            raise TwilightError(f"{path}: its heights are in {name!r}; known are m, km, dm, cm, mm, ft, US survey foot")
        return METRES[name.lower()]
    match = VERTICAL.search(text)
    projected = file.crs is not None and file.crs.is_projected
    if match is None and projected and abs(file.crs.linear_units_factor[1] - 1.0) > 1e-3:
        warnings.warn(
            f"{path}: its coordinates are in {file.crs.linear_units}, and it does not say in what its heights are: "
            "they are taken for metres; if they are not, say so (gdal_edit.py -units ft)",
            TwilightWarning, stacklevel=2,
        )  # fmt: skip
    return float(match[1]) if match else 1.0


def _on_grid(metres: np.ndarray, transform: Any, crs: Any, path: Path, place: tuple[float, float] | None) -> Land:
    """Heights on a metric grid about the place, or about the file's middle."""
    from rasterio.crs import CRS  # optional
    from rasterio.transform import Affine
    from rasterio.warp import Resampling, reproject
    from rasterio.warp import transform as to_other

    rows, columns = metres.shape
    x0, y0 = transform @ (0.5 * columns, 0.5 * rows)
    if crs is not None and place is not None:
        (x0,), (y0,) = to_other(CRS.from_epsg(4326), crs, [(place[1] + 180.0) % 360.0 - 180.0], [place[0]])
    aeqd = "+proj=aeqd +lat_0={} +lon_0={} +datum=WGS84 +units=m"
    if crs is None:  # metres on a plane
        source = local = CRS.from_proj4(aeqd.format(0.0, 0.0))
        transform = Affine.translation(-x0, -y0) @ transform
        x0 = y0 = 0.0
    elif crs.is_geographic:
        # longitudes count from the place: no seam of theirs, at 180 or at 0 deg, is near it
        degree = np.radians(1.0) / crs.units_factor[1]
        metres, transform = _about_longitude(metres, Affine.scale(1.0 / degree) @ transform, x0 / degree)
        rows, columns = metres.shape
        source, local = CRS.from_epsg(4326), CRS.from_proj4(aeqd.format(y0 / degree, 0.0))
        x0, y0 = 0.0, y0 / degree
    else:
        (longitude,), (latitude,) = to_other(crs, CRS.from_epsg(4326), [x0], [y0])
        source, local = crs, CRS.from_proj4(aeqd.format(latitude, longitude))

    def metric(column: np.ndarray, row: np.ndarray) -> np.ndarray:
        return np.array(to_other(source, local, *transform @ (np.ravel(column), np.ravel(row))))

    outline = metric(*np.meshgrid(np.linspace(0.0, columns, 65), np.linspace(0.0, rows, 65)))
    reach_m = 1000.0 * REACH_KM
    west, south = np.maximum(outline.min(axis=1), -reach_m)
    east, north = np.minimum(outline.max(axis=1), reach_m)
    column, row = ~transform @ (x0, y0)
    if not (west < east and south < north and -1.0 <= column <= columns + 1.0 and -1.0 <= row <= rows + 1.0):
        raise _elsewhere(path, place)
    column, row = np.clip(column, 0.0, columns - 1.0), np.clip(row, 0.0, rows - 1.0)
    corner, across, down = metric(column + np.array([0.0, 1.0, 0.0]), row + np.array([0.0, 0.0, 1.0])).T
    pixel_m = min(np.linalg.norm(across - corner), np.linalg.norm(down - corner))
    step_m = float(max(pixel_m, max(east - west, north - south) / MOST_POINTS))
    shape = tuple(max(2, int(np.ceil(size / step_m - 1e-6))) for size in (north - south, east - west))
    heights_m = np.full(shape, np.nan)
    reproject(
        metres, heights_m, src_transform=transform, src_crs=source, src_nodata=np.nan, dst_nodata=np.nan,
        dst_transform=Affine(step_m, 0.0, west, 0.0, -step_m, north), dst_crs=local, resampling=Resampling.bilinear,
    )  # fmt: skip
    land = Land(heights_m, float(west) + 0.5 * step_m, float(north) - 0.5 * step_m, step_m)
    if place is not None and crs is not None and not _stands_on(land):
        raise _elsewhere(path, place)
    return land


def _about_longitude(metres: np.ndarray, transform: Any, longitude_deg: float) -> tuple[np.ndarray, Any]:
    """(heights, transform) of a file in degrees, its longitudes counted from the given one."""
    from rasterio.transform import Affine  # optional

    columns = metres.shape[1]
    transform = Affine.translation(-longitude_deg, 0.0) @ transform
    if transform.b or transform.d:  # turned: a whole number of turns is all that can be done
        middle = (transform @ (0.5 * columns, 0.5 * metres.shape[0]))[0]
        return metres, Affine.translation(-360.0 * round(middle / 360.0), 0.0) @ transform
    step = transform.a
    if abs(columns * abs(step) - 360.0) < 0.5 * abs(step):  # once around: cut it open on the far side
        turned = round(transform.c / step) + columns // 2
        return np.roll(metres, turned, axis=1), Affine.translation(-turned * step, 0.0) @ transform
    first, last = sorted((transform.c, transform.c + columns * step))
    # the turn in which the place is within the file, else that which is nearest to it
    turns = np.floor(last / 360.0)
    if first - 360.0 * turns > 0.0:
        turns = round(0.5 * (first + last) / 360.0)
    return metres, Affine.translation(-360.0 * turns, 0.0) @ transform


def _stands_on(land: Land) -> bool:
    """Whether the file has a height where the observer stands."""
    assert land.step_m is not None
    rows, columns = land.metres.shape
    row, column = land.north_m / land.step_m, -land.west_m / land.step_m
    if not (-0.5 <= row <= rows - 0.5 and -0.5 <= column <= columns - 0.5):
        return False
    return bool(np.isfinite(land.metres[min(max(round(row), 0), rows - 1), min(max(round(column), 0), columns - 1)]))


def _elsewhere(path: Path, place: tuple[float, float] | None) -> TwilightError:
    if place is None:
        return TwilightError(f"{path}: its coordinates lie nowhere on Earth")
    return TwilightError(
        f"{path}: the observer at latitude {place[0]:g}, longitude {place[1]:g} stands outside of it, or where it has "
        "no height"
    )
