"""Error against run time of every solver in continental air, over eight suns.

    python benchmarks/compare.py                   runs what is missing; writes results/compare.csv and draws
                                                   docs/error-against-time.png from it
    python benchmarks/compare.py --solvers NAME:QUALITY,...   the same with rows of these; those of other solvers stay
    python benchmarks/compare.py picture           draws alone

It runs

    twilight compare configs/compare.yaml --set solver.name=zones \
        --reference benchmarks/results/reference/continental-average.csv

with the solvers in SOLVERS.  Finished rows are kept in out/benchmark-compare (those of --solvers beside it).
"""

from __future__ import annotations

import argparse
import subprocess
import sys
from pathlib import Path

import results

from twilight.studies.compare.report import draw, read_points

ROOT = Path(__file__).resolve().parents[1]
TABLE = results.FOLDER / "compare.csv"
CLIMATE = "continental-average"
SOLVERS = "zones,compact,cells:draft,montecarlo:draft,tables:standard,tables:fine,preetham,cie,sunsky,sasktran2"
"""`cells` with more azimuths: results/haber_budget.csv, in the same air and directions."""


def run(solvers: str = "") -> None:
    """Compare and copy the table; solvers: of these alone, all other rows of the table stay."""
    folder = ROOT / "out" / f"benchmark-compare{'-some' if solvers else ''}"
    compare(solvers or SOLVERS, folder)
    if solvers:
        merge(folder / "compare.csv", TABLE)
    else:
        results.stamp(folder / "compare.csv", TABLE, "python benchmarks/compare.py")


def compare(solvers: str, folder: Path) -> None:
    """One comparison with the reference of the climate, written to a folder."""
    command = [
        *(sys.executable, "-c", "from twilight.cli import main; main()", "compare", "configs/compare.yaml"),
        *("--set", "solver.name=zones"),
        *("--reference", f"benchmarks/results/reference/{CLIMATE}.csv"),
        *("--solvers", solvers, "--output", str(folder), "--repeats", "1", "--time-limit", "1200"),
    ]
    subprocess.run(command, cwd=ROOT, check=True)


def merge(made: Path, target: Path) -> None:
    """Put the rows of a table that the program wrote into one of benchmarks, in place of those of the same settings.

    A note for each heading says which of the rows that stay were made under it.
    """
    new, old = results.read_rows(made), results.read_rows(target)
    if not old[0].keys() <= new[0].keys():
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
    unchanged = [row for row in old if which(row) not in set(map(which, new))]
    of_heading: dict[str, list[str]] = {}
    for name in dict.fromkeys(map(which, unchanged)):
        of_heading.setdefault(made_by[name], []).append(name)
    notes = [f"rows of {', '.join(names)}: {heading}" for heading, names in of_heading.items()]
    results.write(
        target, list(new[0]), [[row.get(c, "") for c in new[0]] for row in unchanged + new], notes=[*notes, *others]
    )


def picture() -> None:
    """Error over processor time, a panel for each sun."""
    draw(
        read_points(TABLE, processor=True),
        ROOT / "docs" / "error-against-time.png",
        title=f"{CLIMATE} air",
        time_label="processor time of a first sky, and of one more of the same air (small) [s]",
    )


def main() -> None:
    parse = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parse.add_argument("picture", nargs="?", choices=["picture"], help="draw the table as it is")
    parse.add_argument("--solvers", default="", help="rows of these alone, NAME:QUALITY,...")
    options = parse.parse_args()
    if not options.picture:
        run(options.solvers)
    picture()


if __name__ == "__main__":
    main()
