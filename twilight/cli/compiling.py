"""The notice that the first run of a solver compiles."""

import sys
from pathlib import Path

from twilight.cli import terminal

SENTENCE = "the first run compiles its kernels, about half a minute of processor time; their machine code is kept"


def must_compile(package: str) -> bool:
    """Whether numba keeps no machine code yet of any kernel of a package that is imported (and has kernels to keep)."""
    from twilight.jit.kernels import Kernel

    kernels = []
    for name, module in list(sys.modules.items()):
        if name == package or name.startswith(f"{package}."):
            loaded = [value for value in vars(module).values() if isinstance(value, Kernel)]
            kernels += [one for one in loaded if one.py_func.__module__ == name and one.stats.cache_path]
    for kernel in kernels:
        if any(Path(str(kernel.stats.cache_path)).glob(f"*.{kernel.py_func.__name__}-*.nbi")):
            return False
    return bool(kernels)


def announce_compiling(solver: str) -> None:
    """One sentence on stderr where a solver has to be compiled, which begins then."""
    from twilight import solvers

    solvers.load(solver)
    if must_compile(solvers.SOLVERS[solver]):
        terminal.compiling = True
        print(f"twilight: {SENTENCE}", file=sys.stderr, flush=True)
        from twilight.jit.ahead import compile_ahead  # start-up

        compile_ahead(solver)
