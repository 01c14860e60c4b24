"""One sky at 1000 wavelengths and a panorama of 2048 x 1024: what `twilight render --plan` says, and what they take.

    python benchmarks/memory.py [--only CASE,CASE] [--plan]

Every case is one command, run to its end in a process of its own, whose largest resident memory and processor time are
those of the system; load: the machine's, on average over its last minute.  Kernels are compiled before.  With --only
the other rows of the table stay as they are, with the commit that they were made at.  With --plan no case is run, and
what the plan says now is put beside what the rows have measured.  Writes benchmarks/memory.csv.
"""

from __future__ import annotations

import argparse
import json
import os
import re
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import TYPE_CHECKING

import results

if TYPE_CHECKING:
    from twilight.engine.memory import SceneCost

HERE = Path(__file__).parent
ROOT = HERE.parent
THOUSAND = "wavelengths={min_nm: 380, max_nm: 740, count: 1000}"
HUNDRED = "wavelengths={min_nm: 380, max_nm: 740, count: 100}"
CASES = {
    "1000 wavelengths draft": ("--quality", "draft", "--set", THOUSAND, "--only", "h5"),
    "1000 wavelengths standard": ("--quality", "standard", "--set", THOUSAND, "--only", "h5"),
    "100 wavelengths standard": ("--quality", "standard", "--set", HUNDRED, "--only", "h5"),
    "panorama 2048x1024 draft": ("--quality", "draft", "--set", "texture.latlong_width=2048"),
    "panorama 2048x1024 standard": ("--quality", "standard", "--set", "texture.latlong_width=2048"),
    "view 2048x1024 draft": ("--quality", "draft", "--projection", "latlong", "--size", "2048x1024"),
}
COLUMNS = (
    "case", "planned_gb", "measured_gb", "planned_processor_s", "processor_s", "wall_s", "in_blocks", "load", "commit",
)  # fmt: skip
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


def planned(words: tuple[str, ...]) -> SceneCost:
    """What the program says of a case before it is run."""
    from twilight.config import load_series
    from twilight.config.load import parse_setting
    from twilight.engine.memory import full_cost
    from twilight.scene import resolve

    keys = {"sun.elevation_deg": -4.0, "solver.quality": words[1]}
    keys |= dict(parse_setting(w) for w in words if "=" in w)
    if "--projection" in words:
        keys["observer.view"] = {"kind": "latlong", "width": 2048, "height": 1024}
    (case,) = load_series("continental-average", keys)
    return full_cost(resolve(case.config))


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--only", default=",".join(CASES))
    parser.add_argument("--plan", action="store_true")
    options = parser.parse_args()
    chosen = options.only.split(",")
    unknown = [name for name in chosen if name not in CASES]
    if unknown:
        parser.error(f"{unknown[0]} is no case; there are {', '.join(CASES)}")
    path = HERE / "memory.csv"
    rows = {row["case"]: list(row.values()) for row in results.read_rows(path)} if path.exists() else {}
    commit = re.search(r"commit (.*?):", results.heading("x"))
    if options.plan:
        for name, row in rows.items():
            plan = planned(CASES[name])
            assert plan.total_bytes is not None and plan.cpu_s is not None
            row[1], row[3] = f"{plan.total_bytes / 1e9:.3g}", f"{plan.cpu_s:.3g}"
            row[6] = f"{plan.blocks} of {min(plan.at_once, plan.wavelengths)}"
        results.write(path, COLUMNS, [rows[n] for n in CASES if n in rows])
        return
    with tempfile.TemporaryDirectory() as folder:
        scene = ("render", "continental-average", "--sun-elevation", "-4", "--output", f"{folder}/sky", "--overwrite")
        for name in chosen:
            words = CASES[name]
            quality = words[1]
            measured((*scene, "--quality", quality))  # compiles
            plan = planned(words)
            assert plan.total_bytes is not None and plan.cpu_s is not None
            n_bytes, processor, wall = measured((*scene, *words))
            facts = [
                f"{plan.blocks} of {min(plan.at_once, plan.wavelengths)}",
                f"{os.getloadavg()[0]:.1f}",
                commit[1] if commit else "",
            ]
            numbers = [plan.total_bytes / 1e9, n_bytes / 1e9, plan.cpu_s, processor, wall]
            rows[name] = [name, *(f"{x:.3g}" for x in numbers), *facts]
            print(*rows[name], sep="\t", flush=True)
            results.write(path, COLUMNS, [rows[n] for n in CASES if n in rows])


if __name__ == "__main__":
    main()
