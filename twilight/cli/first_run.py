"""The first run of a solver says that it compiles, and for how long."""

from __future__ import annotations

import sys
from pathlib import Path

SENTENCE = "the first run compiles its kernels, which takes a minute or two; their machine code is kept for later runs"


def must_compile(package: str) -> bool:
    """Whether numba keeps no machine code yet of any kernel of a package that is imported (and has kernels to keep)."""
    from numba.core.dispatcher import Dispatcher

    kernels = []
    for name, module in list(sys.modules.items()):
        if name == package or name.startswith(f"{package}."):
            found = [value for value in vars(module).values() if isinstance(value, Dispatcher)]
            kernels += [one for one in found if one.py_func.__module__ == name and one.stats.cache_path]
    for kernel in kernels:
        if any(Path(str(kernel.stats.cache_path)).glob(f"*.{kernel.py_func.__name__}-*.nbi")):
            return False
    return bool(kernels)


def announce_compiling(solver: str) -> None:
    """One sentence on stderr where a solver has to be compiled."""
    from twilight import solvers
    from twilight.cli import terminal

    solvers.load(solver)
    if must_compile(solvers.SOLVERS[solver]):
        terminal.compiling = True
        print(f"twilight: {SENTENCE}", file=sys.stderr)
