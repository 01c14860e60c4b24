"""Error against run time of every solver, over four climates and eight suns.

    python benchmarks/compare.py                   runs what is missing and writes benchmarks/compare/*.csv
    python benchmarks/compare.py urban desert      the same for some climates
    python benchmarks/compare.py CLIMATE --solvers NAME:QUALITY,...   rows of these; those of other solvers stay
    python benchmarks/compare.py picture           draws docs/error-against-time.png from the tables

For each climate:

    twilight compare configs/compare.yaml --set climate=CLIMATE --set solver.name=zones \
        --reference benchmarks/reference/CLIMATE.csv

with the solvers in SOLVERS.  Finished rows are kept in out/benchmark-CLIMATE (those of --solvers beside it).
"""

from __future__ import annotations

import argparse
import subprocess
import sys
from pathlib import Path

import results

from twilight.studies.compare.figure import draw, read_points

ROOT = Path(__file__).resolve().parents[1]
TABLES = ROOT / "benchmarks" / "compare"
DRAWN = "continental-average"
EVERYWHERE = "zones:draft,zones:standard,cells:draft,preetham,cie,sunsky"
SOLVERS = {
    DRAWN: (
        "zones,compact,cells:draft,cells:standard,montecarlo:draft,montecarlo:standard,tables:standard,"
        "tables:bruneton2017,tables:fine,preetham,cie,sunsky,sasktran2"
    ),
    "urban": EVERYWHERE,
    "desert": EVERYWHERE,
    "maritime-clean": EVERYWHERE,
}


def run(climate: str, solvers: str = "") -> None:
    """Compare on one climate and copy its tables; solvers: of these alone, all other rows of the tables stay."""
    folder = ROOT / "out" / f"benchmark-{climate}{'-some' if solvers else ''}"
    command = [
        *(sys.executable, "-c", "from twilight.cli import main; main()", "compare", "configs/compare.yaml"),
        *("--set", f"climate={climate}", "--set", "solver.name=zones"),
        *("--reference", f"benchmarks/reference/{climate}.csv"),
        *("--solvers", solvers or SOLVERS[climate], "--output", str(folder), "--repeats", "1", "--time-limit", "1200"),
    ]
    subprocess.run(command, cwd=ROOT, check=True)
    TABLES.mkdir(exist_ok=True)
    for name, target in (("compare.csv", f"{climate}.csv"), ("wavelengths.csv", f"{climate}-wavelengths.csv")):
        if solvers:
            merge(folder / name, TABLES / target)
        else:
            results.stamp(folder / name, TABLES / target, f"python benchmarks/compare.py {climate}")


def merge(made: Path, target: Path) -> None:
    """Put the rows of a table that the program wrote into one of benchmarks, in place of those of the same settings.

    A note for each heading says which of the rows that stay were made under it.
    """
    new, old = results.read_rows(made), results.read_rows(target)
    if new[0].keys() != old[0].keys():
        raise SystemExit(f"{target}: has other columns; run it for all solvers")

    def which(row: dict[str, str]) -> str:
        return f"{row['solver']}:{row['quality']}"

    heading, *about = (line[2:] for line in target.read_text(encoding="utf-8").splitlines() if line.startswith("# "))
    made_by, others = dict.fromkeys(map(which, old), heading), []
    for note in about:  # what an earlier merge kept
        names, _, earlier = note.removeprefix("rows of ").partition(": ")
        rows = [name for name in names.split(", ") if note.startswith("rows of ") and name in made_by]
        made_by |= dict.fromkeys(rows, earlier)
        if not rows:
            others.append(note)
    kept = [row for row in old if which(row) not in set(map(which, new))]
    of_heading: dict[str, list[str]] = {}
    for name in dict.fromkeys(map(which, kept)):
        of_heading.setdefault(made_by[name], []).append(name)
    notes = [f"rows of {', '.join(names)}: {heading}" for heading, names in of_heading.items()]
    results.write(target, list(new[0]), [list(row.values()) for row in kept + new], notes=[*notes, *others])


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


def main() -> None:
    parse = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parse.add_argument("climates", nargs="*", metavar="CLIMATE", help="or `picture`; all of them")
    parse.add_argument("--solvers", default="", help="rows of these alone, NAME:QUALITY,...")
    options = parse.parse_args()
    if options.climates == ["picture"]:
        picture()
    else:
        for name in options.climates or SOLVERS:
            run(name, options.solvers)


if __name__ == "__main__":
    main()
