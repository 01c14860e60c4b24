"""Processor seconds at any wavelengths, and the error of light that the fitted model carries over the spectrum.

    python benchmarks/hyperspectral.py                    all of CASES in continental air, two in others
    python benchmarks/hyperspectral.py desert 81          one climate's rows anew, of one case
    python benchmarks/hyperspectral.py times 81           seconds anew, in continental air; errors stay
    python benchmarks/hyperspectral.py --quality standard ...   at another quality, into hyperspectral_standard.csv

Seconds are those of optics, fields and the table of one sun, one thread, kernels compiled before; the eight default
wavelengths come first.  Errors are beside light that is solved at wavelengths drawn at random in bands of gases and
between them: 49 directions and suns from +30 to -14 deg, 95 % and largest, of I, and of Q and U over I.
"""

from __future__ import annotations

import os
import sys
import time

os.environ |= {"NUMBA_NUM_THREADS": "1", "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1", "TWILIGHT_CACHE_GB": "0"}

import numpy as np
import results

from twilight.config import load
from twilight.config.scene import PLACED_NM
from twilight.engine import solve
from twilight.engine.problem import n_nodes
from twilight.scene import Scene, resolve

CLIMATES = ("continental-average", "continental-clean", "continental-polluted", "urban", "desert", "maritime-clean")
CLIMATES += ("maritime-polluted", "maritime-tropical", "arctic", "antarctic", "pure-air", "volcanic-stratosphere")
CLIMATES += ("volcanic-extreme",)
CASES = {
    "8, the default": PLACED_NM,
    "8 of 400 to 700": tuple(np.linspace(400.0, 700.0, 8)),
    "8 of 320 to 1000": tuple(np.linspace(320.0, 1000.0, 8)),
    "8 in bands": (690.0, 720.0, 730.0, 762.0, 820.0, 900.0, 940.0, 980.0),
    "81": tuple(np.linspace(380.0, 780.0, 81)),
    "701": tuple(np.linspace(300.0, 1000.0, 701)),
}
IN_OTHER_AIR = ("8 in bands", "81")
DRAWN = 4
"""Most wavelengths drawn in bands, and as many between."""
SUNS_DEG = (30.0, 5.0, 0.0, -4.0, -8.0, -14.0)
TIMED_SUN_DEG = -4.0
"""Sun of the table that counts in the seconds."""
ELEVATION_DEG, AZIMUTH_DEG = (
    a.ravel() for a in np.meshgrid([1.5, 4.0, 10.0, 20.0, 35.0, 60.0, 88.0], np.linspace(0.0, 180.0, 7))
)


def scene_of(climate: str, wavelength_nm: tuple[float, ...], quality: str, spectrum: str = "auto") -> Scene:
    solver = {"quality": quality, "polarisation": True, "expert": {"spectrum": spectrum}}
    return resolve(load(climate, {"solver": solver, "wavelengths": {"list_nm": [float(w) for w in wavelength_nm]}}))


def light(scene: Scene) -> tuple[np.ndarray, float, int]:
    """Stokes parameters (suns, directions, 3, W), processor seconds of fields and one sun's table, and nodes."""
    begin = time.process_time()
    field = solve(scene, cached=False)
    field.table(TIMED_SUN_DEG)
    seconds = time.process_time() - begin
    stokes = np.stack([field.stokes(sun, ELEVATION_DEG, AZIMUTH_DEG) for sun in SUNS_DEG])
    return stokes, seconds, n_nodes(field.problem)


def compare(climate: str, case: str, quality: str, stored: list[list[object]] | None = None) -> list[list[object]]:
    """Rows of a climate and case: in bands and between; with the errors of stored ones, where these are given."""
    begin = time.process_time()
    scene = scene_of(climate, CASES[case], quality)
    optics = time.process_time() - begin
    new, seconds, nodes = light(scene)
    count = scene.medium.n_wavelengths
    terms = np.ones(count, int) if scene.bands is None else scene.bands.term_counts
    about = [climate, case, quality, count, int(terms.sum()), nodes, f"{optics + seconds:.1f}"]
    if nodes == 0 or stored is not None:
        print(*about, sep="\t", flush=True)
        return [[*about, *row[len(about) :]] for row in stored or [[""] * len(COLUMNS)]]
    draw, rows = np.random.default_rng(29), []
    for where, members in (("between", np.flatnonzero(terms == 1)), ("in bands", np.flatnonzero(terms > 1))):
        if members.size == 0:
            continue
        some = np.sort(draw.choice(members, min(DRAWN, members.size), replace=False))
        old, _, _ = light(scene_of(climate, tuple(scene.medium.wavelength_nm[some]), quality, "solved"))
        error = 100.0 * np.abs(new[..., 0, some] / old[..., 0, :] - 1.0)
        polarised = 100.0 * np.abs((new[..., some] - old)[..., 1:, :]) / old[..., :1, :]
        figures = [f(e) for e in (error, polarised) for f in (lambda e: np.percentile(e, 95), np.max)]
        rows.append([*about, where, some.size, *(f"{x:.3f}" for x in figures)])
        print(*rows[-1], sep="\t", flush=True)
        print("  by sun", *(f"{np.percentile(e, 95):.3f}" for e in error), "by nm", *(
            f"{scene.medium.wavelength_nm[w]:g}:{e:.2f}" for w, e in zip(some, error.max(axis=(0, 1)), strict=True)
        ), file=sys.stderr, flush=True)  # fmt: skip
    return rows


COLUMNS = ["climate", "case", "quality", "wavelengths", "columns", "nodes", "cpu_s", "compared_where", "compared"]
COLUMNS += ["error_p95_percent", "error_max_percent", "polarisation_p95_percent", "polarisation_max_percent"]


def main(arguments: list[str]) -> None:
    quality = "draft"
    if arguments[:1] == ["--quality"]:
        quality, arguments = arguments[1], arguments[2:]
    name = "hyperspectral.csv" if quality == "draft" else f"hyperspectral_{quality}.csv"
    times = "times" in arguments
    wanted = [a for a in arguments if a in CLIMATES] or list(CLIMATES[:1] if times else CLIMATES)
    cases = [a for a in arguments if a in CASES] or list(CASES)
    path = results.FOLDER / name
    stored = results.read_rows(path) if path.exists() and arguments else []
    rows = [list(row.values()) for row in stored]
    light(scene_of(wanted[0], CASES["8, the default"], quality))  # compiles, or reads what was compiled
    for climate in wanted:
        for case in cases if climate == CLIMATES[0] or len(cases) < len(CASES) else IN_OTHER_AIR:
            of_case = [row for row in rows if row[:2] == [climate, case]]
            rows = [row for row in rows if row not in of_case]
            rows += compare(climate, case, quality, of_case if times else None)
            rows.sort(key=lambda row: (CLIMATES.index(str(row[0])), list(CASES).index(str(row[1]))))
            results.write(path, COLUMNS, rows)


if __name__ == "__main__":
    results.say_help(__doc__)
    main(sys.argv[1:])
