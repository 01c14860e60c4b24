"""One form for every table of benchmarks: CSV, and a first line that says of which code it is and how it is renewed.

    # twilight 0.1.0, commit 1a2b3c4d (changed): python benchmarks/zones_error.py standard

`(changed)` stands where the program's files differed from that commit.  Lines that begin with # are notes; the first
line without one names the columns.  A table that is dear to make may be checked beside later code: its second line then
begins with `# checked at commit`.
"""

from __future__ import annotations

import csv
import json
import os
import subprocess
import sys
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from twilight import __version__
from twilight.base.whole_files import whole_file, write_csv

ROOT = Path(__file__).resolve().parents[1]
FOLDER = ROOT / "benchmarks" / "results"


def say_help(text: str | None) -> None:
    """Print what a script says of itself and end, where --help is asked for."""
    if {"--help", "-h"} & set(sys.argv[1:]):
        print((text or "").strip())
        sys.exit()


def heading(command: str = "") -> str:
    """The first line of a table, behind its #.  command: what makes it; empty: this script with its arguments."""
    if not command:
        arguments = [os.path.relpath(a, ROOT) if os.path.isabs(a) else a for a in sys.argv[1:]]
        command = " ".join(["python benchmarks/" + Path(sys.argv[0]).name, *arguments])
    return f"twilight {__version__}, {commit()}: {command}"


def commit() -> str:
    """The commit of the program, and whether its files differ from that."""
    try:
        commit = _git("rev-parse", "--short=8", "HEAD").strip()
        changed = _git("status", "--porcelain", "--untracked-files=no", "--", "twilight", "climates").strip()
    except (OSError, subprocess.CalledProcessError):
        return "commit unknown"
    return f"commit {commit}" + (" (changed)" if changed else "")


def _git(*arguments: str) -> str:
    return subprocess.run(["git", *arguments], cwd=ROOT, capture_output=True, text=True, check=True).stdout


def write(
    path: Path, columns: Sequence[str], rows: Iterable[Sequence[Any]], *, notes: Sequence[str] = (), command: str = ""
) -> None:
    """Write a table whole or not at all."""
    write_csv(path, columns, rows, heading(command), *notes)


class Kept:
    """Rows that a benchmark has found, by name, in a folder of its own under out/: a run that was stopped goes on.

    version: of the code behind them; rows of another one are not seen.
    """

    def __init__(self, folder: str, version: str):
        self.folder, self.version = ROOT / "out" / folder, version

    def rows(self, name: str) -> list | None:
        """What was kept under a name; None: nothing of this version."""
        try:
            kept = json.loads((self.folder / f"{name}.json").read_text(encoding="utf-8"))
        except FileNotFoundError:
            return None
        return kept["rows"] if kept["version"] == self.version else None

    def keep(self, name: str, rows: list) -> None:
        """Keep rows of numbers and text under a name."""
        self.folder.mkdir(parents=True, exist_ok=True)
        text = json.dumps({"version": self.version, "rows": rows})
        with whole_file(self.folder / f"{name}.json") as temporary:
            temporary.write_text(text, encoding="utf-8")


def stamp(path: Path, target: Path, command: str = "") -> None:
    """Copy a table that the program wrote, with the heading in front."""
    text = Path(path).read_text(encoding="utf-8")
    with whole_file(target) as temporary:
        temporary.write_text(f"# {heading(command)}\n{text}", encoding="utf-8")


def note_check(path: Path, said: str) -> None:
    """Put what a check of a table found, which begins with "checked at commit", into the table's second line."""
    heading_line, *lines = path.read_text(encoding="utf-8").splitlines(keepends=True)
    lines = [line for line in lines if not line.startswith("# checked at commit")]
    with whole_file(path) as temporary:
        temporary.write_text("".join([heading_line, f"# {said}\n", *lines]), encoding="utf-8")


def kept(path: Path) -> list[list[str]]:
    """Rows of a table that goes on where it is; none where it is not there."""
    return [list(row.values()) for row in read_rows(path)] if path.exists() else []


def read_rows(path: Path) -> list[dict[str, str]]:
    """The rows of a table by column."""
    with open(path, newline="", encoding="utf-8") as file:
        return list(csv.DictReader(line for line in file if not line.startswith("#")))


def read_numbers(path: Path) -> np.ndarray:
    """A table of numbers as a structured array, a field for each column."""
    rows = read_rows(path)
    kind = [(name, float) for name in rows[0]]
    return np.array([tuple(float(v) for v in row.values()) for row in rows], dtype=kind)


def excess(error: np.ndarray, own: np.ndarray) -> float:
    """What 95 % of normally distributed errors would stay below, without the reference's own standard errors.

    error, own: shares of the radiance
    """
    return float(1.96 * np.sqrt(max(0.0, np.mean(error**2 - own**2))))
