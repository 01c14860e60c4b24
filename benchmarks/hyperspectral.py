"""Light interpolated over the spectrum by `zones` beside light that is solved at every wavelength: error and time.

    python benchmarks/hyperspectral.py                    errors in three climates, results/hyperspectral.csv
    python benchmarks/hyperspectral.py continental-average   one climate's rows anew
    python benchmarks/hyperspectral.py --quality standard ...   at another quality, into hyperspectral_standard.csv

701 wavelengths from 300 to 1000 nm, 81 from 380 to 780 nm, and eight in bands of gases; every sun.  Errors: of
wavelengths drawn at random from each spectral group, 49 directions and suns from +30 to -14 deg, 95 % and largest, of
I, and of Q and U over I.  Processor seconds are those of the fields; where all is solved they are those of the drawn
wavelengths, scaled to the number of wavelengths or terms.
"""

from __future__ import annotations

import sys
import time
from typing import Any

import numpy as np
import results

from twilight.config import load
from twilight.engine import plan
from twilight.scene import Scene, resolve
from twilight.solvers import zones

CLIMATES = ("continental-average", "desert", "pure-air")
CASES = {
    "701": tuple(np.linspace(300.0, 1000.0, 701)),
    "81": tuple(np.linspace(380.0, 780.0, 81)),
    "8 in bands": (690.0, 720.0, 730.0, 762.0, 820.0, 900.0, 940.0, 980.0),
}
DRAWN = {"701": 30, "81": 12, "8 in bands": 8}
"""Wavelengths drawn in bands, and as many between."""
SUNS_DEG = (30.0, 5.0, 0.0, -4.0, -8.0, -14.0)
ELEVATION_DEG, AZIMUTH_DEG = (
    a.ravel() for a in np.meshgrid([1.5, 4.0, 10.0, 20.0, 35.0, 60.0, 88.0], np.linspace(0.0, 180.0, 7))
)
AT_ONCE = 8
"""Wavelengths that are solved together."""


def scene_of(climate: str, wavelength_nm: tuple[float, ...], quality: str) -> Scene:
    solver = {"quality": quality, "polarisation": True}
    return resolve(load(climate, {"solver": solver, "wavelengths": {"list_nm": list(wavelength_nm)}}))


def light(scene: Scene, some: np.ndarray, interpolation: Any) -> tuple[np.ndarray, float, int]:
    """Stokes parameters (suns, directions, 3, N) of some wavelengths; processor seconds of their fields; columns."""
    found, seconds, columns = [], 0.0, 0
    for start in range(0, some.size, AT_ONCE):
        part = some[start : start + AT_ONCE]
        medium = scene.medium.select(part)
        bands = None if scene.bands is None else scene.bands.select(part)
        wide = medium if bands is None else bands.expand(medium)
        begin = time.process_time()
        field = zones.prepare(wide, scene.settings, interpolation=interpolation)
        seconds += time.process_time() - begin
        columns += wide.n_wavelengths
        stokes = np.stack([field.stokes(sun, ELEVATION_DEG, AZIMUTH_DEG) for sun in SUNS_DEG])
        found.append(stokes if bands is None else bands.sum_terms(stokes))
    return np.concatenate(found, axis=-1), seconds, columns


def compare(climate: str, case: str, quality: str) -> list[list[Any]]:
    """Rows of a climate and case: one for each spectral group."""
    begin = time.process_time()
    scene = scene_of(climate, CASES[case], quality)
    served = plan(scene).interpolations
    planned = time.process_time() - begin
    terms = np.ones(len(served), int) if scene.bands is None else scene.bands.term_counts
    draw = np.random.default_rng(29)
    rows = []
    for one in {id(each): each for each in served}.values():
        members = np.array([w for w, other in enumerate(served) if other is one])
        in_band = bool((terms[members] > 1).any())
        where = "in bands" if in_band else "between"
        nm, total = scene.medium.wavelength_nm[members], int(terms[members].sum())
        about = [climate, case, quality, f"{where}, {nm[0]:g} to {nm[-1]:g} nm", members.size, total]
        if one is None:
            rows.append([*about, 0, *[""] * 7])
            continue
        some = np.sort(draw.choice(members, min(DRAWN[case], members.size), replace=False))
        begin = time.process_time()
        new, field_s, columns = light(scene, some[:1], one)  # solves the nodes
        nodes_s = time.process_time() - begin
        new, field_s, columns = light(scene, some, one)
        old, direct_s, _ = light(scene, some, None)
        error = 100.0 * np.abs(new[..., 0, :] / old[..., 0, :] - 1.0)
        polarised = 100.0 * np.abs((new - old)[..., 1:, :]) / old[..., :1, :]
        rows.append(
            [
                *about, one.n_nodes, some.size, f"{np.percentile(error, 95):.3f}", f"{error.max():.3f}",
                f"{np.percentile(polarised, 95):.3f}", f"{polarised.max():.3f}",
                f"{nodes_s + field_s / columns * total:.1f}", f"{direct_s / columns * total:.1f}",
            ]
        )  # fmt: skip
        print(*rows[-1], f"planned in {planned:.1f} s", sep="\t", flush=True)
        worst = error.max(axis=(0, 1))
        print("  by sun", *(f"{np.percentile(e, 95):.3f}" for e in error), file=sys.stderr)
        print("  by nm", *(f"{scene.medium.wavelength_nm[w]:g}:{e:.2f}" for w, e in zip(some, worst, strict=True)),
              file=sys.stderr, flush=True)  # fmt: skip
    return rows


COLUMNS = ["climate", "case", "quality", "group", "wavelengths", "columns", "nodes", "compared"]
COLUMNS += ["error_p95_percent", "error_max_percent", "polarisation_p95_percent", "polarisation_max_percent"]
COLUMNS += ["interpolated_cpu_s", "solved_cpu_s"]


def main(arguments: list[str]) -> None:
    quality = "draft"
    if arguments[:1] == ["--quality"]:
        quality, arguments = arguments[1], arguments[2:]
    name = "hyperspectral.csv" if quality == "draft" else f"hyperspectral_{quality}.csv"
    wanted = [a for a in arguments if a in CLIMATES] or list(CLIMATES)
    cases = [a for a in arguments if a in CASES] or list(CASES)
    path = results.FOLDER / name
    stored = results.read_rows(path) if path.exists() and len(arguments) else []
    rows = [list(row.values()) for row in stored if row["climate"] not in wanted or row["case"] not in cases]
    for climate in wanted:
        for case in cases:
            rows += compare(climate, case, quality)
            results.write(
                path, COLUMNS, sorted(rows, key=lambda row: (CLIMATES.index(row[0]), list(CASES).index(row[1])))
            )


if __name__ == "__main__":
    main(sys.argv[1:])
