"""Errors of tables for real-time renderers against the field that filled them: python benchmarks/tables.py

Seen from the ground, over the sky, for every sun: median and 95th percentile of the relative error, in percent, at 680,
550 and 440 nm.  Writes benchmarks/tables.csv.  `--quality` is that of the field.
"""

from __future__ import annotations

import argparse
import csv
import subprocess
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np

from twilight import __version__
from twilight.config import load_climate
from twilight.export import bruneton, own
from twilight.export.values import Source
from twilight.io.whole import whole_file
from twilight.scene.medium import climate_medium
from twilight.solvers import zones

SUNS_DEG = (30.3, 10.3, 5.2, 2.1, 0.2, -2.1, -4.2, -6.1, -9.1, -12.1, -15.1, -17.9)
DIRECTIONS = 1500
NM = (680, 550, 440)


def directions(count: int) -> tuple[np.ndarray, np.ndarray]:
    """Elevations and azimuths [deg], uniform over the sky above 0.3 deg."""
    random = np.random.default_rng(1)
    return np.degrees(np.arcsin(random.uniform(0.005, 1.0, count))), random.uniform(0.0, 180.0, count)


def main() -> None:
    parse = argparse.ArgumentParser(description=__doc__)
    parse.add_argument("--climate", default="continental-average")
    parse.add_argument("--quality", default="draft")
    parse.add_argument("--output", type=Path, default=Path(__file__).with_name("tables.csv"))
    options = parse.parse_args()
    medium = climate_medium(load_climate(options.climate), np.array(NM[::-1], dtype=float))
    field = zones.prepare(medium, zones.QUALITIES[options.quality])
    source = Source(field, medium, True)
    elevation, azimuth = directions(DIRECTIONS)
    exact = {sun: field.radiance(sun, elevation, azimuth)[:, ::-1] for sun in SUNS_DEG}
    radius = medium.earth_radius_km
    rows = []

    def errors(layout: str, size: int, cpu_s: float, read: Callable[[float], np.ndarray]) -> None:
        for sun in SUNS_DEG:
            off = 100.0 * (read(sun) / exact[sun] - 1.0)
            middle, high = np.median(off, axis=0), np.percentile(np.abs(off), 95, axis=0)
            numbers = [f"{v:.2f}" for pair in zip(middle, high, strict=True) for v in pair]
            rows.append([layout, f"{size / 1e6:.1f}", f"{cpu_s:.1f}", sun, *numbers])
            print(*rows[-1], flush=True)

    start = time.process_time()
    sizes = replace(own.Sizes(), altitude_km=(0.0,))
    made = own.fill(source, sizes, {}, lambda doing, share: None)
    whole = len(own.Sizes().altitude_km) * made.n_bytes
    errors("twilight", whole, time.process_time() - start, lambda sun: made.radiance(sun, elevation, azimuth))
    start = time.process_time()
    his = bruneton.fill(
        source, np.ones(3), bottom_km=radius, top_km=radius + medium.top_km, scale=1.0, facts={},
        progress=lambda doing, share: None, rows=1,
    )  # fmt: skip
    cpu = time.process_time() - start
    size = sum(len(content) for content in his.files("dat", False).values())
    errors("bruneton2017", size, cpu, lambda sun: bruneton.sky_radiance(his, 0.0, sun, elevation, azimuth))
    for scale in (1.0, 4096.0):
        with np.errstate(over="ignore"):
            rounded = (his.scattering * scale).astype(np.float16).astype(float) / scale
        half = replace(his, scattering=rounded)
        errors(
            f"bruneton2017 half x {scale:g}", size // 2, cpu,
            lambda sun, half=half: bruneton.sky_radiance(half, 0.0, sun, elevation, azimuth),
        )  # fmt: skip
    commit = subprocess.run(["git", "rev-parse", "--short", "HEAD"], capture_output=True, text=True).stdout.strip()
    with whole_file(options.output) as path, path.open("w", newline="") as stream:
        stream.write(f"# twilight {__version__} {commit}, python benchmarks/tables.py\n")
        stream.write(f"# {options.climate}, zones {options.quality}, {DIRECTIONS} directions from the ground\n")
        stream.write("# size: of the whole tables; cpu_s: of the part that an observer on the ground needs\n")
        table = csv.writer(stream, lineterminator="\n")
        table.writerow(
            ["layout", "size_mb", "cpu_s", "sun_elevation_deg"]
            + [f"{what}_error_{nm}nm_percent" for nm in NM for what in ("median", "p95")]
        )
        table.writerows(rows)


if __name__ == "__main__":
    main()
