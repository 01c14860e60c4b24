"""The long tests, their results and times.

    python benchmarks/reliability.py [FILE ...]    run the long tests of these files, or of all, in turn
    python benchmarks/reliability.py stale         those of files without a row, or with one that failed; rows of files
                                                   that are gone go

Each file's long tests run as `pytest -m slow tests/FILE` in one process, which names the eight dearest; the processor
time is that of the command with all that it started and compiled.  Writes results/slow_tests.csv, in which the files
that were not run now stay as they are.
"""

from __future__ import annotations

import os
import platform
import re
import subprocess
import sys
from pathlib import Path

import results

TESTS = results.FOLDER / "slow_tests.csv"
COLUMNS = ("file", "long_tests", "passed", "failed", "processor_s", "processor", "commit")


def slow_files() -> list[str]:
    """Names of the test files that hold long tests."""
    return sorted(
        file.name for file in (results.ROOT / "tests").rglob("test_*.py") if "mark.slow" in file.read_text("utf-8")
    )


def stale(rows: dict[str, dict[str, str]]) -> list[str]:
    """Files of long tests that the table does not have, or whose tests failed."""
    return [file for file in slow_files() if file not in rows or int(rows[file]["failed"])]


def run_tests(file: str) -> tuple[int, int, int, float]:
    """(long tests, passed, failed, processor seconds)."""
    before = os.times()
    path = str(next((results.ROOT / "tests").rglob(file)))
    words = ["-m", "pytest", "-m", "slow", path, "-v", "-p", "no:cacheprovider", "--durations=8"]
    done = subprocess.run([sys.executable, *words], cwd=results.ROOT, capture_output=True, text=True)
    after = os.times()
    print(done.stdout[-2000:], done.stderr[-500:], flush=True)
    counts = {word: int(n) for n, word in re.findall(r"(\d+) (passed|failed|error|skipped)", done.stdout)}
    failed = counts.get("failed", 0) + counts.get("error", 0)
    passed = counts.get("passed", 0)
    seconds = after.children_user + after.children_system - before.children_user - before.children_system
    return passed + failed + counts.get("skipped", 0), passed, failed, seconds


def processor() -> str:
    """What the system calls it, "unknown" where it does not say."""
    try:
        found = re.search(r"model name\s*:\s*(.+)", Path("/proc/cpuinfo").read_text("utf-8"))
    except OSError:
        found = None
    return found[1].strip() if found else platform.processor() or "unknown"


def tests(files: list[str]) -> None:
    """slow_tests.csv"""
    commit, known = results.commit().removeprefix("commit "), slow_files()
    wanted = files or known
    if files == ["stale"]:
        wanted = stale({row["file"]: row for row in results.read_rows(TESTS)})
    for file in wanted:
        row = run_tests(file)
        stored = results.read_rows(TESTS) if TESTS.exists() else []
        rows = {r["file"]: tuple(r.values()) for r in stored if r["file"] in known}
        rows[file] = (file, *map(str, row[:3]), f"{row[3]:.0f}", processor(), commit)
        results.write(TESTS, COLUMNS, sorted(rows.values()), command="python benchmarks/reliability.py")


if __name__ == "__main__":
    results.say_help(__doc__)
    tests([Path(word).name for word in sys.argv[1:]])
