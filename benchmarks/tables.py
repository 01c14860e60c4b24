"""Tables for real-time renderers: their errors against the field that filled them; writes tables.csv.

Errors are seen from the ground, over the sky, for every sun: median and 95th percentile of the relative error, in
percent, at 680, 550 and 440 nm.  `--quality` is that of the field.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
from results import write

from twilight.base.progress import silent
from twilight.config import load_climate
from twilight.scene.medium import climate_medium
from twilight.solvers import zones
from twilight.studies.export import bruneton, sky_tables
from twilight.studies.export.field_values import FieldSource

HERE = Path(__file__).parent
SUNS_DEG = (30.3, 10.0, 5.2, 2.1, 0.0, -2.1, -4.2, -6.0, -9.0, -12.1, -15.1, -17.9)
DIRECTIONS = 1500
NM = (680, 550, 440)
TAKRAM_KM = (6360.0, 6420.0)


def directions(count: int) -> tuple[np.ndarray, np.ndarray]:
    """Elevations and azimuths [deg], uniform over the sky above 0.3 deg."""
    random = np.random.default_rng(1)
    return np.degrees(np.arcsin(random.uniform(0.005, 1.0, count))), random.uniform(0.0, 180.0, count)


def errors(options: argparse.Namespace) -> None:
    """tables.csv"""
    medium = climate_medium(load_climate(options.climate), np.array(NM[::-1], dtype=float))
    source = FieldSource(zones.prepare(medium, zones.QUALITIES[options.quality]), medium, medium.has_refraction)
    field, radius = source.field, source.medium.earth_radius_km
    elevation, azimuth = directions(DIRECTIONS)
    exact = {sun: field.radiance(sun, elevation, azimuth)[:, ::-1] for sun in SUNS_DEG}
    rows = []

    def add(layout: str, size: int, read: Callable[[float], np.ndarray]) -> None:
        for sun in SUNS_DEG:
            off = 100.0 * (read(sun) / exact[sun] - 1.0)
            middle, high = np.median(off, axis=0), np.percentile(np.abs(off), 95, axis=0)
            numbers = [f"{v:.2f}" for pair in zip(middle, high, strict=True) for v in pair]
            rows.append([layout, f"{size / 1e6:.1f}", sun, *numbers])
            print(*rows[-1], flush=True)

    sizes = replace(sky_tables.SkyTableSizes(), altitude_km=(0.0,))
    made = sky_tables.fill(source, sizes, {}, silent)
    add(
        "twilight",
        len(sky_tables.SkyTableSizes().altitude_km) * made.n_bytes,
        lambda sun: made.radiance(sun, elevation, azimuth),
    )
    layouts = {"bruneton2017": (radius, radius + source.medium.top_km), "takram": TAKRAM_KM}
    for layout, radii in layouts.items():
        his = bruneton.fill(
            source, np.ones(3), mapping=bruneton.make_mapping(*radii), scale=1.0, facts={}, progress=silent, rows=1
        )
        size = sum(len(content) for content in his.files("dat", False).values())

        def read(sun: float, of: bruneton.BrunetonTables) -> np.ndarray:
            return bruneton.sky_radiance(of, 0.0, sun, elevation, azimuth)

        if layout != "takram":
            add(layout, size, lambda sun, of=his: read(sun, of))
        for scale in (1.0, 4096.0) if layout != "takram" else (4096.0,):
            with np.errstate(over="ignore"):
                rounded = (his.scattering * scale).astype(np.float16).astype(float) / scale
            half = replace(his, scattering=rounded)
            name = layout if layout == "takram" else f"{layout} half x {scale:g}"
            add(name, size // 2, lambda sun, of=half: read(sun, of))
    columns = [f"{what}_error_{nm}nm_percent" for nm in NM for what in ("median", "p95")]
    notes = [
        f"{options.climate}, zones {options.quality}, {DIRECTIONS} directions from the ground; size: of whole tables",
        "takram: half floats x 4096, as @takram/three-atmosphere reads them (tests/test_tables_takram.py)",
    ]
    write(HERE / "tables.csv", ["layout", "size_mb", "sun_elevation_deg", *columns], rows, notes=notes)


def main() -> None:
    parse = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parse.add_argument("--climate", default="continental-average")
    parse.add_argument("--quality", default="draft")
    errors(parse.parse_args())


if __name__ == "__main__":
    main()
