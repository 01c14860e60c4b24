"""Fields of heights: by formulas, shipped, from .npy and from GeoTIFF."""

from __future__ import annotations

from importlib import resources
from pathlib import Path
from typing import NamedTuple

import numpy as np

from twilight.base.errors import TwilightError
from twilight.base.reading import check_npy, reading
from twilight.config.pictures import Terrain
from twilight.terrain.geotiff import Land, check_shape, read_geotiff

LOWEST_M, HIGHEST_M = -500.0, 9000.0
"""Altitudes [m] between which all land lies: the shore of the Dead Sea at -430 m, Everest at 8849 m."""
NO_LAND_KM = -1e9
"""Altitude that stands for no land within a field [km]."""
SHIPPED = {"jacksboro": (30.1, 31.8)}
"""Extents (x, y) [km] of the fields of heights in `data/terrain`."""


class Heights(NamedTuple):
    """Altitudes above sea level [km], (N, M), on a level sphere around the observer; NO_LAND_KM: none there.

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


def heights_of(terrain: Terrain, folder: Path | None = None, standpoint: Standpoint | None = None) -> Heights:
    """The heights that a configuration names; paths count from `folder`.

    standpoint: of an observer whose place and sun are known; a GeoTIFF with coordinates then lies where it is, its
    north to the north.  Otherwise the observer stands in its middle and its far side lies towards the sun.
    Errors: TwilightError for a file that cannot be read, holds something else or lies elsewhere.
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
        return _of_file(terrain, Path(terrain.heights) if folder is None else folder / terrain.heights, standpoint)
    step_x, step_y = size_x / altitude.shape[1], size_y / altitude.shape[0]
    return _made(altitude, *_corner(terrain, size_x, size_y), step_x, step_y, terrain.azimuth_deg)


def _corner(terrain: Terrain, size_x_km: float, size_y_km: float) -> tuple[float, float]:
    """Place (x, y) [km] of the near left corner of a field whose middle lies distance_km away."""
    return -0.5 * size_x_km, terrain.distance_km - 0.5 * size_y_km


def _made(
    altitude: np.ndarray, left: float, near: float, step_x: float, step_y: float, turn_deg: float
) -> Heights:  # fmt: skip
    """Heights of altitudes [km], NaN where there is no land; left, near [km]: the corner of the first cell."""
    turn = np.radians(turn_deg)
    return Heights(
        np.ascontiguousarray(np.where(np.isnan(altitude), NO_LAND_KM, altitude), dtype=np.float32),
        left + 0.5 * step_x,
        near + 0.5 * step_y,
        step_x,
        step_y,
        float(np.cos(turn)),
        float(np.sin(turn)),
        float(np.nanmax(altitude)),
    )


def _of_file(terrain: Terrain, path: Path, standpoint: Standpoint | None) -> Heights:
    """The heights of a .npy or GeoTIFF file."""
    if not path.is_file():
        raise TwilightError(f"terrain.heights: there is no file {path}")
    land, about_observer = Land(np.empty((0, 0))), False
    if path.suffix.lower() == ".npy":
        land = Land(_npy(path))
    else:
        place = None if standpoint is None else (standpoint.latitude_deg, standpoint.longitude_deg)
        land, about_observer = read_geotiff(path, place)
    _check_heights(path, land.metres)
    altitude = land.metres[::-1] / 1000.0
    rows, columns = altitude.shape
    if land.step_m is None:
        step = terrain.size_km / columns
        return _made(altitude, *_corner(terrain, terrain.size_km, step * rows), step, step, terrain.azimuth_deg)
    step = land.step_m / 1000.0
    if "size_km" in terrain.model_fields_set:
        raise TwilightError(f"terrain: {terrain.heights} says itself how large it is; leave out size_km")
    left, near = land.west_m / 1000.0 - 0.5 * step, land.north_m / 1000.0 + (0.5 - rows) * step
    if not about_observer:
        return _made(altitude, left, near + terrain.distance_km, step, step, terrain.azimuth_deg)
    assert standpoint is not None
    if terrain.model_fields_set & {"distance_km", "azimuth_deg"}:
        raise TwilightError(
            f"terrain: {terrain.heights} has coordinates, and the observer a place; leave out distance_km and "
            "azimuth_deg"
        )
    return _made(altitude, left, near, step, step, -standpoint.sun_azimuth_deg)


def _npy(path: Path) -> np.ndarray:
    """Altitudes [m] of a .npy file."""
    with reading(path, "a .npy file of numbers"):
        check_npy(path)
        values = np.load(path, allow_pickle=False)
    check_shape(path, values.shape)
    if not np.issubdtype(values.dtype, np.integer) and not np.issubdtype(values.dtype, np.floating):
        raise TwilightError(f"{path}: must hold altitudes, has {values.dtype}")
    if not np.isfinite(values).all():
        raise TwilightError(f"{path}: altitudes must be numbers without gaps")
    return np.asarray(values, dtype=float)


def _check_heights(path: Path, metres: np.ndarray) -> None:
    low, high = float(np.nanmin(metres)), float(np.nanmax(metres))
    if low < LOWEST_M or high > HIGHEST_M:
        raise TwilightError(
            f"{path}: altitudes must be from {LOWEST_M:g} to {HIGHEST_M:g} m, as land has them; it has {low:g} to "
            f"{high:g} m: is its unit or its scale another one, or a number that stands for no land not marked as such?"
        )


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
