"""Tables for real-time renderers: their errors against the field that filled them; writes tables.csv.

Errors are seen from the ground, over the sky, for every sun: median and 95th percentile of the relative error, in
percent, at 680, 550 and 440 nm.  `--quality` is that of the field.
"""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path

import numpy as np
from results import write

from twilight.base.progress import silent
from twilight.config import load_climate
from twilight.scene.medium import climate_medium
from twilight.solvers import zones
from twilight.studies.export import sky_tables
from twilight.studies.export.field_values import FieldSource

HERE = Path(__file__).parent
SUNS_DEG = (30.3, 10.0, 5.2, 2.1, 0.0, -2.1, -4.2, -6.0, -9.0, -12.1, -15.1, -17.9)
DIRECTIONS = 1500
NM = (680, 550, 440)


def directions(count: int) -> tuple[np.ndarray, np.ndarray]:
    """Elevations and azimuths [deg], uniform over the sky above 0.3 deg."""
    random = np.random.default_rng(1)
    return np.degrees(np.arcsin(random.uniform(0.005, 1.0, count))), random.uniform(0.0, 180.0, count)


def errors(options: argparse.Namespace) -> None:
    """tables.csv"""
    medium = climate_medium(load_climate(options.climate), np.array(NM[::-1], dtype=float))
    source = FieldSource(zones.prepare(medium, zones.QUALITIES[options.quality]), medium, medium.has_refraction)
    elevation, azimuth = directions(DIRECTIONS)
    rows = []
    sizes = replace(sky_tables.SkyTableSizes(), altitude_km=(0.0,))
    made = sky_tables.fill(source, sizes, {}, silent)
    size_mb = len(sky_tables.SkyTableSizes().altitude_km) * made.n_bytes / 1e6
    for sun in SUNS_DEG:
        exact = source.field.radiance(sun, elevation, azimuth)[:, ::-1]
        off = 100.0 * (made.radiance(sun, elevation, azimuth) / exact - 1.0)
        middle, high = np.median(off, axis=0), np.percentile(np.abs(off), 95, axis=0)
        numbers = [f"{v:.2f}" for pair in zip(middle, high, strict=True) for v in pair]
        rows.append([f"{size_mb:.1f}", sun, *numbers])
        print(*rows[-1], flush=True)
    columns = [f"{what}_error_{nm}nm_percent" for nm in NM for what in ("median", "p95")]
    notes = [
        f"{options.climate}, zones {options.quality}, {DIRECTIONS} directions from the ground; size: of whole tables",
    ]
    write(HERE / "tables.csv", ["size_mb", "sun_elevation_deg", *columns], rows, notes=notes)


def main() -> None:
    parse = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parse.add_argument("--climate", default="continental-average")
    parse.add_argument("--quality", default="draft")
    errors(parse.parse_args())


if __name__ == "__main__":
    main()
