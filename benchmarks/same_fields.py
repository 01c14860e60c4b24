"""Whether two versions of the program compute the same light, bit for bit, in ten airs and by five solvers.

    python benchmarks/same_fields.py write before.csv        # in one version
    python benchmarks/same_fields.py write after.csv         # in the other, on the same machine
    python benchmarks/same_fields.py compare before.csv after.csv

A row is a case: its name, a SHA-256 of I, Q, U (where the solver has them) and of the sun's direct light, the mean of
I [sr^-1] for people to read, and the processor seconds.  Machine code may differ between processors: both files must
come from one machine.  `write FILE zones cells` restricts to cases whose name
begins so.
"""

from __future__ import annotations

import csv
import hashlib
import sys
import time
from collections.abc import Callable
from typing import Any

import numpy as np
import results

import twilight

AIRS = (
    "continental-average",
    "continental-polluted",
    "urban",
    "desert",
    "maritime-clean",
    "arctic",
    "antarctic",
    "volcanic-stratosphere",
    "pure-air",
    "haber2005-air",
)
WAVELENGTHS_NM = (380.0, 450.0, 550.0, 650.0)
IN_A_BAND_NM = (550.0, 720.0)
"""The second in a band of water vapour, which is an exponential sum."""
SUNS_DEG = (35.0, 4.0, 0.0, -3.0, -8.0, -15.0)
ELEVATION_DEG, AZIMUTH_DEG = (
    grid.ravel() for grid in np.meshgrid([0.5, 6.0, 30.0, 75.0, 90.0], [0.0, 25.0, 95.0, 180.0], indexing="ij")
)

Case = Callable[[], list[np.ndarray]]


def light(
    scene: Any,
    suns_deg: tuple[float, ...] = SUNS_DEG,
    wavelength_nm: tuple[float, ...] = WAVELENGTHS_NM,
    **options: Any,
) -> Case:
    """The light of a scene for suns, seen from the ground and from 10 km where the solver can."""

    def compute() -> list[np.ndarray]:
        field = twilight.solve(scene, wavelength_nm=list(wavelength_nm), **options)
        found = []
        for sun in suns_deg:
            found.append(np.asarray(field.radiance(sun, ELEVATION_DEG, AZIMUTH_DEG)))
            if (options.get("settings") or {}).get("solver.polarisation"):
                found.append(np.asarray(field.stokes(sun, ELEVATION_DEG, AZIMUTH_DEG)))
            found.append(np.asarray(field.direct(sun, 0.0).irradiance))
            if options.get("solver") in (None, "zones"):
                found.append(np.asarray(field.radiance(sun, ELEVATION_DEG - 5.0, AZIMUTH_DEG, 10.0)))
        return found

    return compute


POLARISED = {"solver.polarisation": True}
CASES: dict[str, Case] = {f"zones {air} draft": light(air, quality="draft", settings=POLARISED) for air in AIRS}
CASES["zones scalar"] = light("continental-average", quality="draft", settings={"solver.polarisation": False})
CASES["zones band"] = light("urban", wavelength_nm=IN_A_BAND_NM, quality="draft", settings=POLARISED)
CASES["zones standard"] = light("continental-average", (4.0, -8.0), (450.0, 650.0), quality="standard")
CASES["zones one sun"] = light("urban", (-4.0,), quality="draft", sun_elevation_deg=-4.0)
FEW = {"solver.samples": 2, "solver.seed": 7}
CASES["montecarlo urban"] = light("urban", (-4.0,), (450.0,), solver="montecarlo", settings=FEW)
CASES["montecarlo volcanic"] = light(
    "volcanic-stratosphere", (2.0,), (650.0,), solver="montecarlo", settings={**FEW, **POLARISED}
)
for air, suns_deg in (("haber2005-air", (4.0, -3.0)), ("urban", (-3.0,))):
    CASES[f"cells {air}"] = light(
        air, suns_deg, (450.0, 650.0), solver="cells", quality="haber2005", settings={"solver.azimuth_cells": 24}
    )
CASES["tables"] = light("pure-air", (4.0, -3.0), (450.0, 650.0), solver="tables", quality="standard")
CASES["compact"] = light("continental-average", solver="compact")
for name in ("preetham", "sunsky"):
    CASES[name] = light("continental-average", (35.0, 4.0), solver=name)


def lights() -> list[np.ndarray]:
    """A moonlit night with all its lights, in the sky and in a view."""
    from twilight.config import load
    from twilight.engine import frames
    from twilight.scene import resolve

    place = {"at": "2026-08-25T22:10+02:00", "latitude_deg": 47.0, "longitude_deg": 11.0}
    view = {"kind": "fisheye", "width": 96, "elevation_deg": 90.0}
    settings = {"solver.quality": "draft", "sun": place, "moon": {}, "night": {}, "observer.view": view}
    [frame] = frames(resolve(load("continental-average", settings)), cached=False)
    assert frame.view is not None
    return [frame.sky.radiance, np.asarray(frame.sky.night_radiance), frame.view.rows(0, frame.view.shape[0]).radiance]


CASES["lights"] = lights


def write(path: str, beginnings: list[str]) -> None:
    """Compute the cases and write their rows."""
    with open(path, "w", newline="", encoding="utf-8") as file:
        rows = csv.writer(file, lineterminator="\n")
        rows.writerow(["case", "sha256", "mean_per_sr", "processor_s"])
        for name, compute in CASES.items():
            if beginnings and not any(name.startswith(beginning) for beginning in beginnings):
                continue
            started = time.process_time()
            try:
                found = compute()
            except twilight.TwilightError as error:
                rows.writerow([name, f"refused: {error}", "", ""])
                print(name, error, flush=True)
                continue
            digest = hashlib.sha256(b"".join(np.ascontiguousarray(one).tobytes() for one in found)).hexdigest()
            rows.writerow([name, digest, f"{found[0].mean():.6g}", f"{time.process_time() - started:.1f}"])
            file.flush()
            print(name, digest[:12], f"{time.process_time() - started:.1f} s", flush=True)


def compare(before: str, after: str) -> int:
    """Print the cases whose hashes differ; the exit status is 1 where there are any, or where none is in both."""
    tables = []
    for path in (before, after):
        with open(path, newline="", encoding="utf-8") as file:
            tables.append({row["case"]: row for row in csv.DictReader(file)})
    both = [name for name in tables[0] if name in tables[1]]
    differ = [name for name in both if tables[0][name]["sha256"] != tables[1][name]["sha256"]]
    for name in differ:
        print(f"{name}: {tables[0][name]['mean_per_sr']} -> {tables[1][name]['mean_per_sr']}")
    print(f"{len(both) - len(differ)} of {len(both)} cases are the same bit for bit")
    return 1 if differ or not both else 0


if __name__ == "__main__":
    results.say_help(__doc__)
    match sys.argv[1:]:
        case ["write", path, *beginnings]:
            write(path, beginnings)
        case ["compare", before, after]:
            sys.exit(compare(before, after))
        case _:
            sys.exit(__doc__)
