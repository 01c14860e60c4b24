"""How long a user waits for one sky: on a fresh machine, when the kernels are compiled, when the field is cached.

    python benchmarks/cold_start.py [--beside FOLDER]

Runs the first command of README with folders of machine code and of fields that are empty, then again with the machine
code, then with the field too, and the same sky by `--solver compact` with empty folders; and twice the timeline of a
night at the default solver, by then compiled: the climate's skies are computed first and then read.  FOLDER is another
checkout of the program, whose figures are measured in turn with these and written beside them.  Writes
results/cold_start.csv.
A loop in plain Python says, in a note, how fast the machine was.
"preview" is the time until the preview of the first case is on disk: the picture that a user sees meanwhile.
Processor seconds are of all processes of a command, wall seconds those of this machine as it was.
"""

from __future__ import annotations

import argparse
import compileall
import os
import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import psutil
import results

ROOT = Path(__file__).resolve().parents[1]
ZONES = ("render", "climates/continental-average.yaml", "--sun-elevation", "-4", "--overwrite")
COMPACT = (*ZONES, "--solver", "compact")

NIGHT = ("timeline", "continental-average", "--at", "2026-03-20", "--latitude", "28.3", "--longitude", "-16.5")


def environment(root: Path, folder: Path) -> dict[str, str]:
    """The variables under which the program at `root` keeps machine code and fields in a folder.

    Its bytecode is kept beside its modules, as an installation has it: without, a command takes 0.9 s more.
    """
    env = {**os.environ, "PYTHONPATH": str(root), "NUMBA_CACHE_DIR": str(folder / "numba")}
    return env | {"TWILIGHT_CACHE_DIR": str(folder / "cache"), "PYTHONDONTWRITEBYTECODE": ""}


def seconds(root: Path, command: tuple[str, ...], folder: Path, **more: str) -> tuple[float, float] | None:
    """(wall, processor) seconds of a command of the program at `root`, with more variables; None where it fails."""
    run = [sys.executable, "-P", "-m", "twilight", *command, "--output", str(folder / "sky")]
    before, begin = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter()
    done = subprocess.run(run, cwd=root, env=environment(root, folder) | more, capture_output=True, text=True)
    wall, after = time.perf_counter() - begin, resource.getrusage(resource.RUSAGE_CHILDREN)
    if done.returncode:
        print(f"{root}: {done.stderr.splitlines()[-1] if done.stderr else done.returncode}", file=sys.stderr)
        return None
    return wall, after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def preview_seconds(root: Path, folder: Path) -> tuple[float, float] | None:
    """(wall, processor) seconds until the preview of ZONES is written, on a fresh machine; None where there is none.

    The command is stopped then.
    """
    begin = time.perf_counter()
    run = [sys.executable, "-P", "-m", "twilight", *ZONES, "--output", str(folder / "sky")]
    quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
    process = psutil.Popen(run, cwd=root, env=environment(root, folder), **quiet)
    found = None
    while found is None and process.poll() is None:
        if any((folder / "sky").rglob("sky.preview.png")):
            used = process.cpu_times()
            found = time.perf_counter() - begin, used.user + used.system
        time.sleep(0.02)
    process.terminate()
    process.wait()
    return found


def measure(root: Path) -> dict[str, tuple[float, float] | None]:
    """The cases of one checkout."""
    compileall.compile_dir(root / "twilight", quiet=1)
    with tempfile.TemporaryDirectory() as made:
        folder, empty, first = Path(made), Path(made) / "empty", Path(made) / "first"
        empty.mkdir()
        first.mkdir()
        return {
            "preview": preview_seconds(root, first),
            "compact, fresh machine": seconds(root, COMPACT, empty),
            "zones, fresh machine": seconds(root, ZONES, folder, TWILIGHT_CACHE_GB="0"),
            "zones, compiled": seconds(root, ZONES, folder),
            "zones, compiled, field cached": seconds(root, ZONES, folder),
            "timeline, skies not computed": seconds(root, NIGHT, empty),
            "timeline, skies cached": seconds(root, NIGHT, empty),
        }


def loop_s() -> float:
    """Processor seconds of ten million turns of a loop, by which machines and hours are compared."""
    begin = time.process_time()
    for _ in range(10_000_000):
        pass
    return time.process_time() - begin


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--beside", type=Path)
    options = parser.parse_args()
    roots = {"this program": ROOT} | ({} if options.beside is None else {"beside": options.beside.resolve()})
    found = {name: measure(root) for name, root in roots.items()}
    rows = [
        [name, case, *(f"{value:.1f}" for value in pair)] if pair else [name, case, "", ""]
        for case in found["this program"]
        for name, pair in ((name, found[name][case]) for name in roots)
    ]
    notes = [f"{len(os.sched_getaffinity(0))} cores; ten million turns of a loop in Python took {loop_s():.2f} s"]
    if options.beside is not None:
        git = subprocess.run(["git", "log", "-1", "--format=%h"], cwd=options.beside, capture_output=True, text=True)
        notes.append(f"beside: commit {git.stdout.strip() or 'unknown'}")
    command = "python benchmarks/cold_start.py" + ("" if options.beside is None else " --beside OLD")
    head = ["program", "case", "wall_s", "processor_s"]
    results.write(results.FOLDER / "cold_start.csv", head, rows, notes=notes, command=command)
    print((results.FOLDER / "cold_start.csv").read_text(), end="")


if __name__ == "__main__":
    main()
