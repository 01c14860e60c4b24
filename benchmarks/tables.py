"""Tables of skies beside the fields that they are made of: their errors, and what they and what reads them cost.

    python benchmarks/tables.py [AIR ...]
    python benchmarks/tables.py raised [AIR ...]

Writes results/tables.csv, a row for each quantity: errors of radiance at 95 % and at most in 1,000 directions from
0.3 deg above the horizon, 0.3 deg and more from the sun's disc, of `field.table(sun)` and of the table of many suns
half-way between two of them (`between suns`); sizes; the aureole's axes; processor seconds at eight wavelengths, in one
process with an empty cache, after a first sky of another air has compiled the kernels.  AIR: these alone are measured,
and the table is printed, not written.

`raised` writes results/raised_observers.csv, a row for each air, altitude and sun: errors of `Sky.sample`, which files
hold, beside `field.radiance` at `draft`, three wavelengths, scalar, in 1,200 directions: three quarters within 0.02 to
5 deg of the visible horizon (above and, from high up, below), the others from nadir to zenith; all about the sun,
opposite to it and anywhere, but not within 0.3 deg of its disc and 0.002 deg of edges of layers.  Beside them what the
sky says itself, its table's nodes and processor seconds.  Each air is tried at every other altitude under one
of the suns in turn, and where it was worst.  AIR: these alone are tried; rows of others stay as they are.
"""

from __future__ import annotations

import csv
import os
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import results

import twilight
from twilight.base import cache
from twilight.engine.one_sun import SunLight, interpolation_error
from twilight.engine.sun_tables import SunTables
from twilight.engine.table import row_breaks
from twilight.io import write_outputs
from twilight.numerics.directions import scattering_angle_rad
from twilight.sky.plain_grid import plain_grid
from twilight.sky.table import SkyTable
from twilight.transport.rays import horizon_dip_deg

sys.path.insert(0, str(results.ROOT / "tests"))
sys.path.insert(0, str(results.ROOT / "tests" / "engine"))
from test_files_beside_field import AT_EDGE_DEG, BESIDE_DEG, DISC_DEG, FAINT, at_horizon, directions

AIRS = ("pure-air", "continental-average", "urban", "desert", "maritime-clean")
SUNS_DEG = (60.0, 30.0, 10.0, 2.0, -1.0, -2.3, -4.0, -8.0, -14.0)
AUREOLE_SUNS_DEG = (10.0, 28.0, 30.0, 33.0)
LOWEST_BETWEEN_DEG = -14.0
HIGHEST_BETWEEN_DEG = 3.0
"""Between them suns are tried half-way between two of the table [deg]."""
EVERY_BETWEEN = 3
"""One pair of suns in so many."""
SCENE = {"quality": "draft"}
RAISED_AIRS = (
    *("continental-clean", "continental-average", "desert", "pure-air", "urban", "maritime-clean"),
    *("continental-polluted", "maritime-polluted", "maritime-tropical", "arctic", "antarctic"),
    *("volcanic-extreme", "volcanic-stratosphere"),
)
RAISED_KM = (0.0, 0.3, 1.03, 4.0, 10.0, 12.0, 100.0, 400.0)
RAISED_SUNS_DEG = (30.0, 2.0, -4.0, -12.0)
RAISED_TOO = {"continental-clean": [(10.0, -3.0), (35.0, -4.0), (400.0, -4.0)]}
"""Altitudes [km] and suns [deg] where a table was worst."""
RAISED_SCENE = {"wavelength_nm": [420.0, 550.0, 676.0], "settings": {"solver.polarisation": False}}
RAISED_DIRECTIONS = 300
RAISED_COLUMNS = (
    "air", "altitude_km", "sun_deg", "p95_percent", "largest_percent", "stated_p95_percent", "stated_largest_percent",
    "rows", "columns", "processor_s",
)  # fmt: skip
COLUMNS = ("case", "air", "sun_deg", "quantity", "value")

Row = tuple[str, str, str, str, str]


def timed(call: Callable[[], Any]) -> tuple[Any, float]:
    """What a call gives, and its processor seconds."""
    begin = time.process_time()
    found = call()
    return found, time.process_time() - begin


def errors(field: Any, table: SkyTable) -> tuple[float, float]:
    """Relative error of a table of one sun in per cent: at 95 % and at most."""
    sun = float(table.sun_elevation_deg[0])
    elevation, azimuth = directions(sun)
    away = np.degrees(scattering_angle_rad(table.apparent_sun_deg[0], elevation, azimuth))
    asked = (elevation > BESIDE_DEG) & (away > DISC_DEG + BESIDE_DEG)
    elevation, azimuth = elevation[asked], azimuth[asked]
    error = np.abs(table.light(elevation, azimuth) / field.radiance(sun, elevation, azimuth) - 1.0)
    return 100.0 * float(np.percentile(error, 95)), 100.0 * float(error.max())


def of_air(air: str) -> Iterator[Row]:
    """Tables of single suns, of suns half-way between those of the table of many, and the aureole's axes."""
    field = twilight.solve(air, **SCENE)
    for sun in SUNS_DEG:
        table, seconds = timed(lambda sun=sun: field.table(sun))
        usual, most = errors(field, table)
        where = ("one sun", air, f"{sun:g}")
        yield (*where, "error at 95 % [%]", f"{usual:.3f}")
        yield (*where, "largest error [%]", f"{most:.2f}")
        yield (*where, "rows x columns", f"{table.elevation_deg.size} x {table.azimuth_deg.size}")
        yield (*where, "processor_s", f"{seconds:.2f}")
    tables = SunTables(field)
    nodes = tables.suns_deg
    middle = 0.5 * (nodes[1:] + nodes[:-1])
    middle = middle[(middle > LOWEST_BETWEEN_DEG) & (middle < HIGHEST_BETWEEN_DEG)][::EVERY_BETWEEN]
    found = [(sun, *errors(field, tables.under(float(sun)))) for sun in middle]
    for sun, usual, most in found:
        where = ("between suns", air, f"{sun:.2f}")
        yield (*where, "error at 95 % [%]", f"{usual:.3f}")
        yield (*where, "largest error [%]", f"{most:.2f}")
    for sun in AUREOLE_SUNS_DEG:
        high, wide = aureole_deg(field.sky(sun))
        yield ("aureole", air, f"{sun:g}", "height x width [deg]", f"{high:.2f} x {wide:.2f}")


def aureole_deg(sky: Any) -> tuple[float, float]:
    """Height and width of the line of equal luminance that goes through 1 deg above the sun [deg]."""
    sun = sky.apparent_sun_elevation_deg
    level = sky.luminance_at(sun + 1.0, 0.0)
    radius = np.linspace(0.3, 8.0, 3000)
    size = []
    for up, aside in ((1.0, 0.0), (-1.0, 0.0), (0.0, 1.0), (0.0, -1.0)):
        light = sky.luminance_at(sun + up * radius, aside * radius / np.cos(np.radians(sun)))
        size.append(radius[np.argmin(np.abs(light - level))])
    return size[0] + size[1], size[2] + size[3]


def speed(air: str = "continental-average") -> Iterator[Row]:
    """Processor seconds of what reads tables."""
    twilight.solve("pure-air", **SCENE).sky(-4.0)
    field = twilight.solve(air, **SCENE)
    _, first = timed(lambda: field.sky(-4.3))
    sky, following = timed(lambda: field.sky(-4.2))
    tables = SunTables(field)
    tables.under(-4.3)
    elevation, azimuth = directions(-4.3, 3600)
    _, sky_of_table = timed(lambda: tables.under(-4.25).light(elevation, azimuth))
    yield ("speed", air, "-4.3", "field.sky(sun), first [processor s]", f"{first:.2f}")
    yield ("speed", air, "-4.2", "field.sky(sun), next [processor s]", f"{following:.3f}")
    yield ("speed", air, "-4.25", "3,600 directions of one more sun [processor s]", f"{sky_of_table:.4f}")
    with tempfile.TemporaryDirectory() as folder:
        each = {}
        for width in (1024, 4096):
            where = Path(folder) / str(width)
            _, each[width] = timed(lambda w=width, f=where: write_outputs(sky, f, files=("rgb",), width=w))
    yield ("speed", air, "-4.2", "map 4096 beside 1024 wide, more [processor s]", f"{each[4096] - each[1024]:.2f}")
    times = pd.date_range("2026-03-20", periods=10_000, freq="8min", tz="UTC")
    for which in ("first", "skies cached"):
        _, seconds = timed(lambda: twilight.light((28.3, -16.5), times, "horizontal", ["illuminance", "cct"], air))
        yield ("speed", air, "", f"10,000 moments of illuminance and cct, {which} [processor s]", f"{seconds:.2f}")


def raised(airs: list[str]) -> None:
    """Skies of raised observers, written air by air."""
    path = results.FOLDER / "raised_observers.csv"
    rows = [tuple(row.values()) for row in results.read_rows(path) if airs and row["air"] not in airs]
    for n, air in enumerate(RAISED_AIRS):
        if airs and air not in airs:
            continue
        field = twilight.solve(air, **SCENE, **RAISED_SCENE)
        first = n // 2 % len(RAISED_SUNS_DEG)
        turn = list(zip(RAISED_KM[n % 2 :: 2], RAISED_SUNS_DEG[first:] + RAISED_SUNS_DEG[:first], strict=True))
        for km, sun in RAISED_TOO.get(air, []) + turn:
            rows.append((air, f"{km:g}", f"{sun:g}", *seen_from(field, km, sun)))
            print(*rows[-1], flush=True)
        results.write(path, RAISED_COLUMNS, rows, command="python benchmarks/tables.py raised")


def seen_from(field: Any, km: float, sun: float) -> tuple[str, ...]:
    """Errors of a raised observer's sky and of its own word [%], its table's nodes and processor seconds."""
    table, seconds = timed(lambda: field.table(sun, km))
    light = SunLight(None, [table])
    sky = light.sky(field.medium, plain_grid(table), field.direct(sun, km), sun, km)
    low = float(table.elevation_deg[0])
    elevation, azimuth = at_horizon(sun, horizon_dip_deg(field.medium, km) if low < 0.0 else 0.0, RAISED_DIRECTIONS)
    away = np.degrees(scattering_angle_rad(table.apparent_sun_deg[0], elevation, azimuth))
    breaks = np.array(row_breaks(field.scene, km)[1] or [0.0])
    asked = (away > DISC_DEG + BESIDE_DEG) & (np.abs(elevation[:, None] - breaks).min(axis=1) > AT_EDGE_DEG)
    asked &= elevation > low
    elevation, azimuth = elevation[asked], azimuth[asked]
    truth = field.radiance(sun, elevation, azimuth, km)
    # light below a thousandth of the brightest counts as so bright
    error = np.abs(sky.sample(elevation, azimuth) - truth) / np.maximum(truth, FAINT * truth.max(axis=0))
    found = (np.percentile(error, 95), error.max(), *(interpolation_error(light, sky) or ()))
    nodes = (str(table.elevation_deg.size), str(table.azimuth_deg.size))
    return (*(f"{100.0 * x:.3f}" for x in found), *nodes, f"{seconds:.2f}")


def main() -> None:
    if sys.argv[1:2] == ["raised"]:
        raised(sys.argv[2:])
        return
    with tempfile.TemporaryDirectory() as folder:
        os.environ[cache.FOLDER_VARIABLE] = folder
        rows = [] if sys.argv[1:] else list(speed())
        for air in sys.argv[1:] or AIRS:
            rows += of_air(air)
    if sys.argv[1:]:
        csv.writer(sys.stdout, lineterminator="\n").writerows([COLUMNS, *rows])
        return
    results.write(results.FOLDER / "tables.csv", COLUMNS, rows)


if __name__ == "__main__":
    results.say_help(__doc__)
    main()
