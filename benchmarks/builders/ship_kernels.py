"""Writes twilight/jit/entries.json: the kernels that Python calls for a sky, by solver, in the order in which they are
first called, with the types of their arguments.

    python benchmarks/builders/ship_kernels.py
"""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))  # benchmarks, where results is
import results

ENTRIES = Path(__file__).resolve().parents[2] / "twilight" / "jit" / "entries.json"
SOLVERS = ("zones", "cells")
"""Those whose sky takes less time than their kernels."""


def called(solver: str) -> list[list[object]]:
    """The kernels of a solver's default sky, called in this process."""
    from numba.core.dispatcher import Dispatcher

    from twilight.cli.app import app
    from twilight.jit.ahead import described

    order: list[Dispatcher] = []
    add = Dispatcher.add_overload

    def noted(self: Dispatcher, result: object) -> None:
        add(self, result)
        order.append(self)

    Dispatcher.add_overload = noted
    command = ["render", "continental-average", "--sun-elevation", "-4", "--solver", solver, "--quality", "draft"]
    assert not app(
        [*command, "--output", f"out/ship_kernels-{solver}", "--overwrite", "--no-preview"], standalone_mode=False
    )
    found = []
    for kernel in dict.fromkeys(order):
        function = kernel.py_func
        if function.__module__.startswith("twilight.") and not kernel.targetoptions["no_cpython_wrapper"]:
            for kinds in kernel.signatures:
                try:
                    found.append([function.__module__, function.__name__, [described(kind) for kind in kinds]])
                except ValueError as error:
                    print(f"{function.__module__}.{function.__name__}: {error}", file=sys.stderr)
    return found


def main() -> None:
    if len(sys.argv) == 2:
        print("\n" + json.dumps(called(sys.argv[1])))
        return
    found = {}
    for solver in SOLVERS:
        done = subprocess.run([sys.executable, __file__, solver], check=True, stdout=subprocess.PIPE, text=True)
        found[solver] = json.loads(done.stdout.splitlines()[-1])
    solvers = []
    for solver, entries in found.items():
        lines = ",\n".join("  " + json.dumps(entry) for entry in entries)
        solvers.append(f' "{solver}": [\n{lines}\n ]')
    ENTRIES.write_text("{\n" + ",\n".join(solvers) + "\n}\n", encoding="utf-8")


if __name__ == "__main__":
    results.say_help(__doc__)
    main()
