"""Box air-mass factors of `zones`, by the adjoint, beside those of `montecarlo`, by random paths, in ten airs.

    python benchmarks/air_mass.py [CLIMATE...]
    python benchmarks/air_mass.py speed     prints the processor seconds of 12 layers, 33 suns and 10 wavelengths

Zenith sky at WAVELENGTH_NM, suns at SUNS_DEG, layers between EDGES_KM; `zones` at `draft`.  Climates alone are printed;
all of them write benchmarks/air_mass.csv.  A pair agrees that differs by 1 % or three standard errors at most.
"""

from __future__ import annotations

import sys
import time
from pathlib import Path

import numpy as np
import results

import twilight

HERE = Path(__file__).parent
CLIMATES = (
    "pure-air", "continental-clean", "continental-average", "continental-polluted", "urban", "desert", "maritime-clean",
    "arctic", "volcanic-stratosphere", "noctilucent",
)  # fmt: skip
"""Ten airs that are shipped."""
WAVELENGTH_NM = 450.0
"""Where nitrogen dioxide is measured."""
SUNS_DEG = (-2.0,)
"""Elevations of the sun: the zenith angle of 92 deg, where slant columns of the stratosphere are measured."""
EDGES_KM = (0.0, 2.0, 6.0, 12.0, 18.0, 24.0, 30.0, 40.0, 60.0)
"""Altitudes that bound the layers."""
TARGET = 0.006
"""Standard error of the least certain layer over the largest factor, of random paths."""
SEED = 20
COLUMNS = (
    "climate", "sun_elevation_deg", "bottom_km", "top_km", "zones", "montecarlo", "standard_error", "percent",
    "standard_errors", "agree",
)  # fmt: skip


def factors(climate: str, solver: str, settings: dict[str, object]):
    """Box air-mass factors (S, J), their standard errors or None, and processor seconds."""
    began = time.process_time()
    field = twilight.solve(
        climate, wavelength_nm=[WAVELENGTH_NM], solver=solver, settings=settings, sun_elevation_deg=SUNS_DEG
    )
    boxes = field.airmass(SUNS_DEG, 90.0, 0.0, edges_km=EDGES_KM).isel(wavelength=0)
    error = boxes["standard_error"].values if "standard_error" in boxes else None
    return boxes["box_air_mass_factor"].values, error, time.process_time() - began


def compared(climate: str) -> tuple[list[list[object]], str]:
    """Rows of the table, and what the two took."""
    adjoint, _, seconds = factors(climate, "zones", {"solver.quality": "draft"})
    paths, error, seconds_of_paths = factors(
        climate, "montecarlo", {"solver.target_stderr": TARGET, "solver.seed": SEED}
    )
    rows: list[list[object]] = []
    for s, sun in enumerate(SUNS_DEG):
        for j in range(len(EDGES_KM) - 1):
            a, b, e = adjoint[s, j], paths[s, j], error[s, j]
            percent, z = 100.0 * (a / b - 1.0), (a - b) / e
            agree = "yes" if abs(percent) <= 1.0 or abs(z) <= 3.0 else "no"
            numbers = [f"{a:.4f}", f"{b:.4f}", f"{e:.4f}", f"{percent:.2f}", f"{z:.1f}"]
            rows.append([climate, f"{sun:g}", f"{EDGES_KM[j]:g}", f"{EDGES_KM[j + 1]:g}", *numbers, agree])
    return rows, f"{climate}: {seconds:.0f} processor seconds by zones, {seconds_of_paths:.0f} by montecarlo"


def speed() -> None:
    """Print the processor seconds of a field and of the box air-mass factors of a table, with compiled kernels."""
    suns, wavelength_nm = np.linspace(80.0, -8.0, 33), np.linspace(420.0, 600.0, 10)
    edges_km = (0.0, 2.0, 5.0, 8.0, 11.0, 14.0, 17.0, 20.0, 24.0, 28.0, 34.0, 42.0, 60.0)
    began = time.process_time()
    field = twilight.solve("pure-air", wavelength_nm=wavelength_nm, quality="draft", sun_elevation_deg=suns)
    field.radiance(0.0, 90.0, 0.0)
    solved = time.process_time()
    boxes = field.airmass(suns, 90.0, 0.0, edges_km=edges_km)["box_air_mass_factor"]
    seconds = time.process_time() - solved
    print(f"{boxes.shape}: {solved - began:.0f} s for the field, {seconds:.0f} s for the factors")


def main(climates: list[str]) -> None:
    """Compare and print; write the table of all."""
    rows: list[list[object]] = []
    notes = []
    for climate in climates or CLIMATES:
        some, note = compared(climate)
        rows, notes = rows + some, [*notes, note]
        print(note, flush=True)
        for row in some:
            print("  ", *row[1:])
    if not climates:
        off = np.abs([float(str(row[7])) for row in rows])
        agreed = sum(row[-1] == "yes" for row in rows)
        notes.append(
            f"{agreed} of {len(rows)} agree; median difference {np.median(off):.2f} %, largest {off.max():.2f} %"
        )
        print(notes[-1])
        results.write(HERE / "air_mass.csv", COLUMNS, rows, notes=notes)


if __name__ == "__main__":
    speed() if sys.argv[1:] == ["speed"] else main(sys.argv[1:])
