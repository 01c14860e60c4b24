"""What `twilight render --plan` says of skies, views, terrain, series and many wavelengths, and what they take.

    python benchmarks/memory.py [--only CASE,CASE] [--plan]

Every case is one command, run to its end in a process of its own, whose largest resident memory and processor time are
those of the system; load: the machine's, on average over its last minute.  Kernels are compiled before.  With --only
the other rows of the table stay as they are, with the commit that they were made at.  With --plan no case is run, and
what the plan says now is put beside what the rows have measured.  Writes results/memory.csv.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile

import results
from results import ROOT

THOUSAND = "wavelengths={min_nm: 380, max_nm: 740, count: 1000}"
EIGHTY_ONE = "wavelengths={min_nm: 380, max_nm: 780, count: 81}"
THIRTY_THREE = "wavelengths={min_nm: 400, max_nm: 720, count: 33}"
FOUR = "wavelengths={list_nm: [450, 550, 610, 680]}"
HUNDRED = "wavelengths={min_nm: 380, max_nm: 740, count: 100}"
SUNS = "--sun-elevation=" + ",".join(f"{sun:g}" for sun in range(-18, 17))
CONTINENTAL = ("continental-average", "--sun-elevation", "-4")
CASES = {
    "1000 wavelengths draft": (*CONTINENTAL, "--quality", "draft", "--set", THOUSAND, "--only", "h5"),
    "1000 wavelengths standard": (*CONTINENTAL, "--quality", "standard", "--set", THOUSAND, "--only", "h5"),
    "100 wavelengths standard": (*CONTINENTAL, "--quality", "standard", "--set", HUNDRED, "--only", "h5"),
    "81 wavelengths draft": (*CONTINENTAL, "--quality", "draft", "--set", EIGHTY_ONE, "--only", "h5"),
    "view 2048x1024 draft": (*CONTINENTAL, "--quality", "draft", "--projection", "latlong", "--size", "2048x1024"),
    "sky draft": (*CONTINENTAL, "--quality", "draft"),
    "sky standard": (*CONTINENTAL, "--quality", "standard"),
    "desert 4 wavelengths standard": ("desert", "--sun-elevation", "-4", "--set", FOUR, "--only", "h5"),
    "overcast draft": ("overcast-stratus", "--sun-elevation", "30", "--quality", "draft"),
    "35 suns 33 wavelengths draft": ("continental-average", SUNS, "--quality", "draft", "--set", THIRTY_THREE),
    "ridges 1920x1080 draft": ("configs/sunset-over-ridges.yaml", "--size", "1920x1080"),
    "mountain-shadow draft": ("configs/mountain-shadow.yaml",),
}
COLUMNS = (
    "case", "planned_gb", "measured_gb", "planned_processor_s", "processor_s", "taken_over_planned", "wall_s",
    "in_blocks", "load", "commit",
)  # fmt: skip
UNITS_S = {"s": 1.0, "min": 60.0, "h": 3600.0}
MEASURED = """
import json, resource, sys, time
from twilight.cli import main
begin = time.perf_counter()
try:
    main()
finally:
    own = resource.getrusage(resource.RUSAGE_SELF)
    print(json.dumps([own.ru_maxrss * 1024, own.ru_utime + own.ru_stime, time.perf_counter() - begin]), file=sys.stderr)
"""


def measured(words: tuple[str, ...]) -> tuple[float, float, float]:
    """(bytes, processor seconds, wall seconds) of a command."""
    env = {**os.environ, "PYTHONPATH": str(ROOT), "TWILIGHT_CACHE_GB": "0"}
    done = subprocess.run([sys.executable, "-c", MEASURED, *words], cwd=ROOT, env=env, capture_output=True, text=True)
    if done.returncode:
        raise SystemExit(done.stderr)
    n_bytes, processor, wall = json.loads(done.stderr.splitlines()[-1])
    return n_bytes, processor, wall


def planned(words: tuple[str, ...]) -> tuple[float, float, str]:
    """(bytes, processor seconds, blocks) that the program says of a case before it is run."""
    env = {**os.environ, "PYTHONPATH": str(ROOT)}
    command = [sys.executable, "-m", "twilight", "render", *words, "--plan"]
    said = subprocess.run(command, cwd=ROOT, env=env, capture_output=True, text=True, check=True).stdout.splitlines()
    heads, row = (line.split("\t") for line in said[-2:])
    facts = dict(zip(heads, row, strict=True))
    time, unit = facts["processor time, about"].split()
    return float(facts["memory in all [GB]"]) * 1e9, float(time) * UNITS_S[unit], facts["in blocks"]


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--only", default=",".join(CASES))
    parser.add_argument("--plan", action="store_true")
    options = parser.parse_args()
    chosen = options.only.split(",")
    unknown = [name for name in chosen if name not in CASES]
    if unknown:
        parser.error(f"{unknown[0]} is no case; there are {', '.join(CASES)}")
    path = results.FOLDER / "memory.csv"
    rows = {row["case"]: dict(row) for row in results.read_rows(path)} if path.exists() else {}
    for row in rows.values():
        row["taken_over_planned"] = f"{float(row['processor_s']) / float(row['planned_processor_s']):.3g}"
    commit = results.commit().removeprefix("commit ")
    for name in [name for name in chosen if name in rows or not options.plan]:
        n_bytes, seconds, blocks = planned(CASES[name])
        row = rows.setdefault(name, {"case": name})
        if not options.plan:
            with tempfile.TemporaryDirectory() as folder:
                has_view = "--size" in CASES[name] or "configs/" in CASES[name][0]
                compiled = (*CASES[name], "--size", "64x32") if has_view else (*CONTINENTAL, "--quality", "draft")
                measured(("render", *compiled, "--output", f"{folder}/sky", "--overwrite"))
                taken = measured(("render", *CASES[name], "--output", f"{folder}/sky", "--overwrite"))
            row |= dict(zip(("measured_gb", "processor_s", "wall_s"), (taken[0] / 1e9, *taken[1:]), strict=True))
            row |= {"load": f"{os.getloadavg()[0]:.1f}", "commit": commit}
        row |= {"planned_gb": n_bytes / 1e9, "planned_processor_s": seconds, "in_blocks": blocks}
        row["taken_over_planned"] = float(row["processor_s"]) / seconds
        shown = {key: f"{value:.3g}" if isinstance(value, float) else value for key, value in row.items()}
        rows[name] = shown
        print(*(shown[column] for column in COLUMNS), sep="\t", flush=True)
        results.write(path, COLUMNS, [[rows[n][c] for c in COLUMNS] for n in CASES if n in rows])


if __name__ == "__main__":
    main()
