"""Every benchmark can be imported and started."""

import os
import subprocess
import sys
from pathlib import Path

HERE = Path(__file__).resolve().parents[2] / "benchmarks"
START_ALL = """
import contextlib, io, pathlib, runpy, sys
here = pathlib.Path(sys.argv[1])
sys.path.insert(0, str(here))
for path in sorted(here.rglob("*.py")):
    sys.path.insert(1, str(path.parent))
    sys.argv, said = [str(path), "--help"], io.StringIO()
    try:
        with contextlib.redirect_stdout(said):
            runpy.run_path(str(path), run_name="__main__")
        if "__main__" in path.read_text(encoding="utf-8"):
            print(path.name, "ran")
    except SystemExit as end:
        if end.code or len(said.getvalue()) < 20:
            print(path.name, "ends with", end.code, "and says", repr(said.getvalue()))
    except ModuleNotFoundError as error:  # a package that no extra for tests has
        name = error.name.partition(".")[0]
        if name == "twilight" or [*here.rglob(name + ".py")]:
            print(path.name, error)
    except Exception as error:
        print(path.name, repr(error))
"""
"""Starts each script with --help in one process of its own, for some set variables of the environment, and prints those
that do not say what they do."""


def test_every_benchmark_says_what_it_does():
    """A script would import what was renamed, and no table that it writes could be renewed."""
    path = os.pathsep.join([str(HERE.parent), os.environ.get("PYTHONPATH", "")])
    done = subprocess.run(
        [sys.executable, "-c", START_ALL, str(HERE)],
        env={**os.environ, "PYTHONPATH": path},
        capture_output=True,
        text=True,
    )
    assert (done.returncode, done.stdout) == (0, ""), done.stderr
