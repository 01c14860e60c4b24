"""What active shells cost and save: python benchmarks/cells_active_shells.py

Haber's mode at S = 60 on the hazy air of benchmarks/reference, sky radiance against all shells active.
Writes benchmarks/cells_active_shells.csv.
"""

from __future__ import annotations

import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import results

from twilight.atmosphere.table import medium_from_table
from twilight.solvers import cells

HERE = Path(__file__).parent
SUNS = (10.0, -4.0)


def main() -> None:
    medium = medium_from_table(HERE / "reference" / "hazy-air.csv")
    elevation, azimuth = np.meshgrid([1.5, 10.0, 30.0, 60.0, 88.0], [0.0, 60.0, 120.0, 180.0], indexing="ij")
    settings = replace(cells.QUALITIES["haber2005"], azimuth_cells=60, subcells=3)
    cells.prepare(medium, replace(settings, active_shell_step=16)).radiance(0.0, elevation, azimuth)  # compile
    rows, full = [], {}
    for step in (1, 2, 4, 8):
        start = time.perf_counter()
        field = cells.prepare(medium, replace(settings, active_shell_step=step))
        seconds = time.perf_counter() - start
        for sun in SUNS:
            radiance = field.radiance(sun, elevation, azimuth)
            full.setdefault(sun, radiance)
            error = 100.0 * np.abs(radiance / full[sun] - 1.0)
            rows.append(
                [step, field.isotropic.rings.radius.size, f"{seconds:.1f}", f"{sun:g}"]
                + [f"{x:.2f}" for x in (np.median(error), error.max())]
            )
            print(*rows[-1], sep="\t", flush=True)
    results.write(
        HERE / "cells_active_shells.csv",
        ["active_shell_step", "rings", "set_up_s", "sun_elevation_deg", "median_percent", "max_percent"],
        rows,
    )


if __name__ == "__main__":
    main()
