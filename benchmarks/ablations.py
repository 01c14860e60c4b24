"""What `zones` is off by without one thing, beside itself with all of them: `continental-average`, the sun at -4 deg.

    python benchmarks/ablations.py

writes benchmarks/results/ablations.csv: per cent of radiance over directions and wavelengths, and processor seconds.
"""

from __future__ import annotations

import time
from typing import Any

import numpy as np
import results

from twilight.config import load
from twilight.engine import solve
from twilight.scene import resolve
from twilight.studies.compare.job import stratified_directions

SUN_DEG = -4.0
DIRECTIONS = 240
"""Directions of the texture that are compared, about one in eight of its half."""
LEFT_OUT: dict[str, dict[str, Any]] = {
    "no polarisation": {"solver.polarisation": False},
    "refraction off": {"refraction.model": "none"},
    "straight lines of sight": {"solver.bent_lines_of_sight": False},
    "ozone as a vertical filter": {"gases.ozone.treatment": "overhead_filter"},
    "no ozone": {"gases.ozone.treatment": "none"},
    "no NO2 and O4": {"gases.no2": False, "gases.o4": False},
    **{f"top at {top} km": {"atmosphere.top_km": top} for top in (35, 50, 60, 80)},
    "Henyey-Greenstein instead of Mie": {"aerosol.phase_function": "henyey_greenstein"},
    "single scattering alone": {"solver.max_orders": 1},
    **{f"{n} orders of scattering": {"solver.max_orders": n, "solver.expert.tolerance": 0.0} for n in (2, 3, 5, 8)},
}


def light(settings: dict[str, Any]) -> tuple[np.ndarray, float]:
    """Radiance in the directions and processor seconds."""
    config = load("continental-average", {"sun.elevation_deg": SUN_DEG, "horizon": "clean", **settings})
    started = time.process_time()
    field = solve(resolve(config), (SUN_DEG,), cached=False)
    found = field.radiance(SUN_DEG, *stratified_directions(config.texture.shape, DIRECTIONS))
    return found, time.process_time() - started


def main() -> None:
    """Write the table."""
    for settings in ({}, *LEFT_OUT.values()):
        light(settings)  # compiles, and reads what is read once
    whole, whole_s = light({})
    rows = []
    for name, settings in LEFT_OUT.items():
        without, seconds = light(settings)
        percent = 100.0 * np.abs(without / whole - 1.0)
        found = (np.median(percent), np.percentile(percent, 95), percent.max(), seconds, whole_s)
        rows.append([name, *(f"{value:.3g}" for value in found)])
        print(*rows[-1], sep="\t", flush=True)
    columns = ["ablation", "median_percent", "p95_percent", "max_percent", "cpu_s", "cpu_without_s"]
    results.write(results.FOLDER / "ablations.csv", columns, rows)


if __name__ == "__main__":
    results.say_help(__doc__)
    main()
