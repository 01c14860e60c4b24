"""Fields of heights: by formulas, shipped, from .npy and from GeoTIFF."""

from __future__ import annotations

from importlib import resources
from pathlib import Path
from typing import NamedTuple

import numpy as np

from twilight.config.terrain import Terrain
from twilight.errors import TwilightError
from twilight.extras import missing
from twilight.reading import check_npy

MOST_POINTS = 4096
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


def heights_of(terrain: Terrain, folder: Path | None = None) -> Heights:
    """The heights that a configuration names; paths count from `folder`.

    Errors: TwilightError for a file that cannot be read or holds something else.
    """
    size_x = size_y = terrain.size_km
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
        metres, own = _read(path)
        if own is not None:
            size_x, size_y = own
        else:
            size_y = size_x * metres.shape[0] / metres.shape[1]
        altitude = metres[::-1] / 1000.0
    turn = np.radians(terrain.azimuth_deg)
    rows, columns = altitude.shape
    step_x, step_y = size_x / columns, size_y / rows
    return Heights(
        np.ascontiguousarray(altitude, dtype=np.float32),
        -0.5 * size_x + 0.5 * step_x,
        terrain.ahead_km - 0.5 * size_y + 0.5 * step_y,
        step_x,
        step_y,
        float(np.cos(turn)),
        float(np.sin(turn)),
        float(altitude.max()),
    )


def _read(path: Path) -> tuple[np.ndarray, tuple[float, float] | None]:
    """Altitudes [m], (rows, columns), the far side first, and the size (x, y) [km] where the file knows it."""
    if not path.is_file():
        raise TwilightError(f"terrain.heights: there is no file {path}")
    size = None
    if path.suffix.lower() == ".npy":
        try:
            check_npy(path)
            values = np.load(path, allow_pickle=False)
        except (ValueError, OSError, EOFError):
            raise TwilightError(f"{path}: is not a .npy file of numbers") from None
    else:
        try:
            import rasterio
        except ImportError:
            raise missing("rasterio", f"{path}: reading GeoTIFF") from None
        try:
            with rasterio.open(path) as file:
                _check_shape(path, file.shape)
                values = file.read(1, masked=True).filled(np.nan)
                size = _size_km(file)
        except rasterio.errors.RasterioError as error:
            raise TwilightError(f"{path}: cannot be read as GeoTIFF ({error})") from None
    _check_shape(path, values.shape)
    if not np.issubdtype(values.dtype, np.number):
        raise TwilightError(f"{path}: must hold altitudes, has {values.dtype}")
    values = np.asarray(values, dtype=float)
    if not np.isfinite(values).all() or values.min() < -1000.0 or values.max() > 100000.0:
        raise TwilightError(f"{path}: altitudes must be numbers from -1000 to 100000 m without gaps")
    return values, size


def _check_shape(path: Path, shape: tuple[int, ...]) -> None:
    if len(shape) != 2 or min(shape) < 2 or max(shape) > MOST_POINTS:
        raise TwilightError(f"{path}: must hold 2 x 2 to {MOST_POINTS} x {MOST_POINTS} altitudes, has {shape}")


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
    total, weight, share = np.zeros_like(x), np.ones_like(x), 1.0
    for octave in range(7):
        n = 5 * 2**octave
        noise = random.standard_normal((n + 3, n + 3))
        smooth = _cubic(noise, (x + 0.5) * n, (y + 0.5) * n)
        fold = np.clip(1.0 - np.abs(smooth) / 1.6, 0.0, 1.0) ** 1.5
        total += share * weight * fold
        weight, share = np.clip(1.8 * weight * fold, 0.05, 1.0), 0.55 * share
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
