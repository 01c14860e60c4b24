"""Error against run time of every solver, over four climates and eight suns.

    python benchmarks/compare.py                   runs what is missing and writes benchmarks/compare/*.csv
    python benchmarks/compare.py urban desert      the same for some climates
    python benchmarks/compare.py picture           draws docs/error-against-time.png from the tables

For each climate:

    twilight compare configs/compare.yaml --set climate=CLIMATE --set solver.name=zones \
        --reference benchmarks/reference/CLIMATE.csv

with the solvers in SOLVERS.  Finished rows are kept in out/benchmark-CLIMATE.
"""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import results

from twilight.compare.figure import draw, read_points

ROOT = Path(__file__).resolve().parents[1]
TABLES = ROOT / "benchmarks" / "compare"
DRAWN = "continental-average"
EVERYWHERE = "zones:draft,zones:standard,cells:draft,preetham,cie,sunsky"
SOLVERS = {
    DRAWN: (
        "zones,compact,cells:draft,cells:standard,montecarlo:draft,montecarlo:standard,preetham,cie,sunsky,sasktran2"
    ),
    "urban": EVERYWHERE,
    "desert": EVERYWHERE,
    "maritime-clean": EVERYWHERE,
}


def run(climate: str) -> None:
    """Compare on one climate and copy its tables."""
    folder = ROOT / "out" / f"benchmark-{climate}"
    command = [
        *(sys.executable, "-c", "from twilight.cli import main; main()", "compare", "configs/compare.yaml"),
        *("--set", f"climate={climate}", "--set", "solver.name=zones"),
        *("--reference", f"benchmarks/reference/{climate}.csv"),
        *("--solvers", SOLVERS[climate], "--output", str(folder), "--repeats", "1", "--time-limit", "1200"),
    ]
    subprocess.run(command, cwd=ROOT, check=True)
    TABLES.mkdir(exist_ok=True)
    for name, target in (("compare.csv", f"{climate}.csv"), ("wavelengths.csv", f"{climate}-wavelengths.csv")):
        results.stamp(folder / name, TABLES / target, f"python benchmarks/compare.py {climate}")


def picture() -> None:
    """One climate in full colour, the others faint behind it."""
    marks = read_points(TABLES / f"{DRAWN}.csv", processor=True)
    others = [c for c in SOLVERS if c != DRAWN and (TABLES / f"{c}.csv").exists()]
    draw(
        marks,
        ROOT / "docs" / "error-against-time.png",
        title=f"{DRAWN} air" + (f"; pale: {', '.join(others)}" if others else ""),
        faint=[read_points(TABLES / f"{c}.csv", processor=True) for c in others],
        time_label="processor time of one sky [s]",
    )


if __name__ == "__main__":
    if sys.argv[1:] == ["picture"]:
        picture()
    else:
        for name in sys.argv[1:] or SOLVERS:
            run(name)
