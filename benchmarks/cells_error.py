"""Error of the cells solver against the committed Monte-Carlo reference: python benchmarks/cells_error.py

Writes benchmarks/cells_error.csv: relative error of the radiance over all directions and wavelengths of
benchmarks/reference (the reference's own error is in the last column), for each setting and sun.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import results

from twilight.atmosphere.medium_table import medium_from_table
from twilight.solvers import cells

HERE = Path(__file__).parent
SETTINGS = {
    "draft": cells.QUALITIES["draft"],
    "standard": cells.QUALITIES["standard"],
    "isotropic after the first event, S = 120": replace(
        cells.QUALITIES["haber2005"], max_orders=10, tolerance=1e-3, subcells=3
    ),
    "single scattering": replace(cells.QUALITIES["standard"], multiple_scattering="none"),
}
CASES = {
    "pure-air": ("pure-air.csv", "pure-air-albedo-0.csv"),
    "hazy-air": ("hazy-air.csv", "hazy-air-albedo-0.csv"),
}


def main() -> None:
    rows = []
    for case, (table, answers) in CASES.items():
        medium = medium_from_table(HERE / "reference" / table)
        reference = results.read_numbers(HERE / "reference" / answers)
        for name, settings in SETTINGS.items():
            field = cells.prepare(medium, settings)
            for sun in sorted(set(reference["sun_elevation_deg"]), reverse=True):
                some = reference[reference["sun_elevation_deg"] == sun]
                place = np.searchsorted(medium.wavelength_nm, some["wavelength_nm"])
                radiance = field.radiance(sun, some["elevation_deg"], some["azimuth_deg"])
                error = radiance[np.arange(some.size), place] / some["radiance_per_sr"] - 1.0
                own = np.median(some["standard_error_per_sr"] / some["radiance_per_sr"])
                size = 100 * np.abs(error)
                row = [case, name, f"{sun:g}", *(f"{x:.2f}" for x in (
                    np.median(size), np.percentile(size, 95), size.max(), 100 * error.mean(), 100 * own))]  # fmt: skip
                rows.append(row)
                print(*row, sep="\t", flush=True)
    results.write(
        HERE / "cells_error.csv",
        [
            "air",
            "setting",
            "sun_elevation_deg",
            "median_percent",
            "p95_percent",
            "max_percent",
            "mean_percent",
            "reference_error_percent",
        ],
        rows,
    )


if __name__ == "__main__":
    main()
