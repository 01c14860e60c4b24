"""How kernels are compiled: numba's `njit`, with divisions as hardware does them, and without what nobody calls.

Python's rule, an exception for a division by 0, puts a test and an exit into every division: a fifth more machine code
to compile, which does nothing here, for kernels keep their divisors off 0.

Beside each kernel numba makes two more functions: one for C, which nothing here calls, and one for Python, which takes
every field out of every named tuple of arrays.  `inner` leaves both out for a kernel that kernels call, and machine
code of its own too.

numba counts who holds an array, and does so again for every row of one that is handed on and in every kernel that is
called: a third of the time of a short kernel.  A kernel that makes no arrays needs none of it (`makes_arrays=False`);
numba then refuses to compile one that does.

A small kernel becomes a part of those that call it by LLVM (`inline=True`).  numba's own way, `inline="always"`, copies
and types its Python code anew for each call: `beam_at` took 7.4 processor seconds to compile in place of 3.4, to the
same bits.

These options, and the vectors of :mod:`twilight.jit.simd`, are parts of numba that change from one minor version to
the next: versions that were never tested are refused with one sentence.

numba is loaded when a kernel is first called: what calls none, as the solver `compact` on the ground, starts at once.
Without numba, and with the environment variable NUMBA_DISABLE_JIT=1, nothing is compiled: every
kernel is its Python function, a thousand times slower, for debuggers.
"""

from __future__ import annotations

import functools
import os
import re
from collections.abc import Callable
from importlib.util import find_spec
from typing import Any

from twilight.base.errors import TwilightError

OLDEST_NUMBA = (0, 60)
"""First minor version of numba with which the tests passed; as in `pyproject.toml`."""
UNTESTED_NUMBA = (0, 69)
"""First minor version of numba with which the tests were not run; as in `pyproject.toml`."""

COMPILED = find_spec("numba") is not None and os.environ.get("NUMBA_DISABLE_JIT", "0") in ("", "0")
"""Whether kernels are compiled: not without numba, nor with NUMBA_DISABLE_JIT=1."""


def check_numba(version: str) -> None:
    """TwilightError for a version of numba that kernels were not tested with; it names the command that helps."""
    numbers = re.match(r"(\d+)\.(\d+)", version)
    if numbers is None or not OLDEST_NUMBA <= (int(numbers[1]), int(numbers[2])) < UNTESTED_NUMBA:
        oldest, untested = (".".join(map(str, bound)) for bound in (OLDEST_NUMBA, UNTESTED_NUMBA))
        raise TwilightError(
            f"numba {version} is installed, and twilight is tested with {oldest} to below {untested}; this installs "
            f'one that works: python -m pip install "numba>={oldest},<{untested}"'
        )


class Kernel:
    """A function that numba compiles when it is called, by Python or by another kernel.

    py_func: the Python function
    """

    def __init__(self, function: Callable[..., Any], inner: bool, cached: bool, options: dict[str, Any]) -> None:
        functools.update_wrapper(self, function)
        self.py_func = function
        self._inner, self._cached, self._options = inner, cached, options

    @functools.cached_property
    def dispatcher(self) -> Any:
        """What numba makes of it."""
        import numba  # start-up

        from twilight.jit.machine_code import InnerCompiler, KernelCache, no_garbage_collection  # start-up

        check_numba(numba.__version__)
        compiler = {"pipeline_class": InnerCompiler} if self._inner else {}
        made: Any = numba.njit(**self._options | compiler)(self.py_func)
        made._compiler.compile = no_garbage_collection()(made._compiler.compile)
        if self._cached:
            made._cache = KernelCache(made)
        return made

    @property
    def _numba_type_(self) -> Any:
        """What numba takes it for in the kernels that call it."""
        return self.dispatcher._numba_type_

    @functools.cached_property
    def _for_python(self) -> Callable[..., Any]:
        if not self._inner:
            found: Callable[..., Any] = self.dispatcher
            return found
        kernel = self

        def hand_on(*arguments: Any) -> Any:
            return kernel(*arguments)

        return Kernel(hand_on, False, False, self._options | {"no_cpython_wrapper": False})

    def __call__(self, *arguments: Any, **named: Any) -> Any:
        """What the kernel returns; for an inner one, of a test or a debugger, one that hands it on is compiled."""
        return self._for_python(*arguments, **named)

    def __getattr__(self, name: str) -> Any:
        if name.startswith("__"):
            raise AttributeError(name)
        return getattr(self.dispatcher, name)


def njit(
    *, inner: bool = False, inline: bool | str = False, makes_arrays: bool = True, cache: bool = False, **options: Any
) -> Callable[..., Any]:
    """numba's `njit`, with `fastmath` among the options; a division by 0 gives inf or nan.

    No kernel holds Python's lock: signals are heard, and progress is shown, while one runs.

    inner: kernels call it.  inline: it becomes a part of the machine code of those that call it; "always": by numba, of
    its Python code.  makes_arrays: whether it makes any; those that it is handed are then not counted.  cache: its
    machine code is kept.
    """
    made = options | {
        "error_model": "numpy",
        "nogil": True,
        "no_cfunc_wrapper": True,
        "no_cpython_wrapper": inner,
    }
    made |= {"forceinline": True} if inline is True else {"inline": inline or "never"}
    if not makes_arrays:
        made["_nrt"] = False

    def kernel(function: Any) -> Any:
        if not COMPILED:
            function.py_func = function
            return function
        return Kernel(function, inner, cache, made)

    return kernel
