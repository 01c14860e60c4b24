"""Stiff and extreme scenes: processor time that `render --plan` says, and what the run takes.

    python benchmarks/stiff_air.py [CASE ...]      run the cases whose names contain one of the words, or all

Every case renders eight wavelengths at `draft` unless it says otherwise, without a cache, in a process of its own; it
is stopped after LIMIT_S.  Run one case before, so that machine code is there.  Writes results/stiff_air.csv, in which
the cases that were not run now stay as they are.
"""

from __future__ import annotations

import os
import re
import subprocess
import sys
import tempfile
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
import results

sys.path.insert(0, str(results.ROOT / "tests"))

from stability_media import LEVELS_KM, STRUCTURES, Air, medium_of

from twilight.atmosphere import medium_table
from twilight.atmosphere.medium import Medium
from twilight.base.whole_files import write_csv
from twilight.config import load
from twilight.engine.problem import full_cost
from twilight.scene import resolve

TABLE = results.FOLDER / "stiff_air.csv"
COLUMNS = ("case", "quality", "wavelengths", "planned_s", "processor_s", "planned_over_processor")
LIMIT_S = 200
WAVELENGTHS_NM = np.linspace(400.0, 700.0, 8)
HAZE = "climate.aerosol.optical_depth_550nm"
LAYERS = "climate.atmosphere.layers.equal_air_mass"
WHITE = {"climate.ground.albedo": 1.0}


@dataclass(frozen=True)
class Case:
    """A climate, or a medium to be written as a table, with keys over the defaults and its sun."""

    climate: str | Callable[[], Medium]
    keys: dict = field(default_factory=dict)
    sun_deg: float = 15.0
    quality: str = "draft"


def spectrum(levels_km=LEVELS_KM, **air) -> Medium:
    """Air whose aerosol falls with the wavelength and whose molecules fall with its fourth power."""
    airs = [
        Air(**(air | {"air": 0.1 * (550.0 / nm) ** 4, "aerosol": air.get("aerosol", 0.1) * 550.0 / nm}))
        for nm in WAVELENGTHS_NM
    ]
    return replace(medium_of(*airs, levels_km=levels_km), wavelength_nm=WAVELENGTHS_NM)


def eight(of: Callable[[], Medium]) -> Medium:
    """A medium of one wavelength at eight."""
    alone = of()
    return replace(alone.select(np.zeros(8, int)), wavelength_nm=WAVELENGTHS_NM)


def table_of(**air) -> Callable[[], Medium]:
    return lambda: spectrum(**air)


CASES: dict[str, Case] = {
    "usual": Case("continental-average"),
    **{f"continental haze {d:g}": Case("continental-average", {HAZE: d}) for d in (0.3, 0.6, 1.0, 2.0, 5.0, 20.0)},
    "continental haze 1 over white ground": Case("continental-average", {HAZE: 1.0} | WHITE),
    "desert": Case("desert"),
    "desert dust 1": Case("desert", {HAZE: 1.0}),
    "desert dust 1 over white ground": Case("desert", {HAZE: 1.0} | WHITE),
    "desert dust 1 over white ground, standard": Case("desert", {HAZE: 1.0} | WHITE, quality="standard"),
    "desert dust 20": Case("desert", {HAZE: 20.0}),
    "50 layers": Case("continental-average", {LAYERS: 50}),
    "500 layers": Case("continental-average", {LAYERS: 500}),
    "500 layers, one wavelength": Case("continental-average", {LAYERS: 500, "wavelengths": {"list_nm": [550.0]}}),
    "300 to 1000 nm": Case("continental-average", {"wavelengths": {"list_nm": list(range(300, 1001, 100))}}),
    **{f"sun at {s:g}": Case("continental-average", sun_deg=s) for s in (90.0, 0.0, -18.0, -40.0)},
    "in orbit": Case("continental-average", {"observer.altitude_km": 400.0}),
    **{f"table, depth {d:g}": Case(table_of(aerosol=d)) for d in (0.2, 1.0, 2.0, 5.0, 20.0)},
    **{f"table, depth {d:g} over white ground": Case(table_of(aerosol=d, ground=1.0), WHITE) for d in (0.2, 1.0)},
    "table, depth 20, albedo 1, asymmetry 0.9": Case(table_of(aerosol=20.0, albedo=1.0, asymmetry=0.9)),
    "the same over white ground": Case(table_of(aerosol=20.0, albedo=1.0, asymmetry=0.9), WHITE),
    "the same, one wavelength": Case(lambda: medium_of(Air(aerosol=20.0, albedo=1.0, asymmetry=0.9))),
    "table, depth 1, asymmetry 0.98": Case(table_of(aerosol=1.0, asymmetry=0.98)),
    "table, depth 20, albedo 1, asymmetry 0": Case(table_of(aerosol=20.0, albedo=1.0, asymmetry=0.0), WHITE),
    "table, soot": Case(table_of(aerosol=2.0, albedo=0.0)),
    **{f"table, {name}": Case(lambda of=of: eight(of)) for name, of in STRUCTURES.items()},
}  # fmt: skip


def write_table(medium: Medium, folder: Path) -> Path:
    """A climate of a tabulated medium, of Henyey-Greenstein aerosol."""
    z = medium.altitude_km
    g = [float(phase) for phase in medium.phase_functions[0].asymmetry] if medium.phase_functions else []
    scattering = medium.air_scattering_per_km, medium.aerosol_extinction_per_km, medium.aerosol_single_scattering_albedo
    rows = []
    for w, nm in enumerate(medium.wavelength_nm):
        for i in range(z.size):
            height, *first = (f"{x:.9g}" for x in (z[i], *(c[i, w] for c in scattering)))
            last = [f"{c[i, w]:.9g}" for c in (medium.absorption_per_km, medium.refractivity)]
            rows.append([height, nm, *first, g[w] if g else 0.0, *last])
    write_csv(folder / "air.csv", list(medium_table.COLUMNS), rows)
    path = folder / "air.yaml"
    albedo = float(medium.ground_albedo[0])
    path.write_text(f"version: 1\nname: table\nmedium:\n  table: air.csv\nground:\n  albedo: {albedo:g}\n", "utf-8")
    return path


def run(case: Case) -> tuple[int, float, float, str]:
    """(wavelengths, planned processor seconds, those that were used, what the program said last)."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        scene = case.climate if isinstance(case.climate, str) else str(write_table(case.climate(), folder))
        keys = case.keys | {"sun.elevation_deg": case.sun_deg, "solver.quality": case.quality}
        sizes = full_cost(resolve(load(scene, keys), for_plan=True))
        words = [word for key, value in keys.items() for word in ("--set", f"{key}={_yaml(value)}")]
        command = [
            sys.executable,
            "-m",
            "twilight",
            "render",
            scene,
            *words,
            "--no-preview",
            "--output",
            str(folder / "o"),
        ]
        before = os.times()
        done = subprocess.run(
            ["prlimit", f"--cpu={LIMIT_S}", *command], capture_output=True, text=True,
            env={**os.environ, "TWILIGHT_CACHE_GB": "0"},
        )  # fmt: skip
        said = "" if done.returncode == 0 else done.stderr.strip() or f"stopped after {LIMIT_S} s"
        after = os.times()
    seconds = after.children_user + after.children_system - before.children_user - before.children_system
    return sizes.wavelengths, sizes.cpu_s or 0.0, seconds, said.splitlines()[-1] if said else ""


def _yaml(value) -> str:
    """A value as `--set` takes it."""
    return re.sub("'", "", str(value))


def main(words: list[str]) -> None:
    """stiff_air.csv"""
    rows = {row["case"]: tuple(row.values()) for row in results.read_rows(TABLE)} if TABLE.exists() else {}
    for name, case in CASES.items():
        if words and not any(word in name for word in words):
            continue
        n, planned, used, said = run(case)
        row = (name, case.quality, str(n), f"{planned:.1f}", f"{used:.1f}", f"{planned / used:.2f}")
        print(*row, said, sep="\t", flush=True)
        if not said:
            rows[name] = row
            results.write(TABLE, COLUMNS, rows.values(), command="python benchmarks/stiff_air.py")


if __name__ == "__main__":
    results.say_help(__doc__)
    main(sys.argv[1:])
