"""The frontier of error against run time of `zones` in eight climates at once, searched over its settings.

    python benchmarks/frontier.py          goes on from benchmarks/frontier.csv for 10 processor minutes
    python benchmarks/frontier.py 30       for 30
    python benchmarks/frontier.py 0        the table and the picture of the points there are
    python benchmarks/frontier.py anew     forgets them: after a change of what `zones` computes
    python benchmarks/frontier.py peers    `zones` and sasktran2, each on its own frontier: benchmarks/frontier_peers.py

Runs `twilight frontier` on CLIMATES with their tables of the reference solution, from the qualities on, and writes all
points to benchmarks/frontier.csv, the picture to docs/frontier.png.
"""

from __future__ import annotations

import shutil
import subprocess
import sys
from pathlib import Path

import frontier_peers
import results
from zones_error import CLIMATES as TABLES

ROOT = Path(__file__).resolve().parents[1]
TABLE = ROOT / "benchmarks" / "frontier.csv"
FOLDER = ROOT / "out" / "frontier"
CLIMATES = (
    *("pure-air", "continental-average", "arctic", "antarctic"),
    *("continental-polluted", "urban", "desert", "maritime-clean"),
)
LONGEST_S = 16.0
"""Mean processor seconds of a field beyond which a point is given up, about twice what `standard` takes when busy."""


def main(arguments: list[str]) -> None:
    if arguments[:1] == ["peers"]:
        frontier_peers.main(arguments[1:])
        return
    anew = arguments == ["anew"]
    minutes = "10" if anew or not arguments else arguments[0]
    FOLDER.mkdir(parents=True, exist_ok=True)
    resume = TABLE.exists() and not anew
    if resume:
        shutil.copy(TABLE, FOLDER / "points.csv")
    command = [
        *(sys.executable, "-c", "from twilight.cli import main; main()", "frontier", *CLIMATES),
        *(part for name in CLIMATES for part in ("--reference", f"benchmarks/reference/{TABLES[name]}.csv")),
        *("--minutes", minutes, "--longest", f"{LONGEST_S:g}", "--seed", "1", "--output", str(FOLDER)),
        *(["--resume"] if resume else []),
    ]
    subprocess.run(command, cwd=ROOT, check=True)
    results.stamp(FOLDER / "points.csv", TABLE)
    shutil.copy(FOLDER / "frontier.png", ROOT / "docs" / "frontier.png")


if __name__ == "__main__":
    main(sys.argv[1:])
