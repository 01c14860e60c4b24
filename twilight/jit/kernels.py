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

With the environment variable NUMBA_DISABLE_JIT=1 nothing is compiled: every kernel is its Python function, a thousand
times slower, for debuggers.
"""

from __future__ import annotations

import functools
import re
from collections.abc import Callable
from typing import Any

import numba
from numba.core import types

from twilight.base.errors import TwilightError
from twilight.jit.machine_code import InnerCompiler, KernelCache, no_garbage_collection

OLDEST_NUMBA = (0, 60)
"""First minor version of numba with which the tests passed; as in `pyproject.toml`."""
UNTESTED_NUMBA = (0, 69)
"""First minor version of numba with which the tests were not run; as in `pyproject.toml`."""

COMPILED = not numba.config.DISABLE_JIT  # type: ignore[attr-defined]
"""Whether kernels are compiled: not with NUMBA_DISABLE_JIT=1."""


def check_numba(version: str) -> None:
    """TwilightError for a version of numba that kernels were not tested with; it names the command that helps."""
    numbers = re.match(r"(\d+)\.(\d+)", version)
    if numbers is None or not OLDEST_NUMBA <= (int(numbers[1]), int(numbers[2])) < UNTESTED_NUMBA:
        oldest, untested = (".".join(map(str, bound)) for bound in (OLDEST_NUMBA, UNTESTED_NUMBA))
        raise TwilightError(
            f"numba {version} is installed, and twilight is tested with {oldest} to below {untested}; this installs "
            f'one that works: python -m pip install "numba>={oldest},<{untested}"'
        )


class InnerKernel:
    """What Python holds of a kernel that compiled functions call: a call from Python, of a test or a debugger, compiles
    one that hands it on.

    py_func: the Python function that was compiled
    """

    def __init__(self, dispatcher: Any) -> None:
        self._dispatcher = dispatcher
        self.py_func: Callable[..., Any] = dispatcher.py_func
        self.__name__: str = dispatcher.py_func.__name__
        self.__doc__ = dispatcher.py_func.__doc__

    @property
    def _numba_type_(self) -> types.Dispatcher:
        """What numba takes it for in the kernels that call it."""
        return types.Dispatcher(self._dispatcher)

    @functools.cached_property
    def _for_python(self) -> Callable[..., Any]:
        kernel = self

        def hand_on(*arguments: Any) -> Any:
            return kernel(*arguments)

        handed_on: Callable[..., Any] = njit()(hand_on)
        return handed_on

    def __call__(self, *arguments: Any) -> Any:
        """What the kernel returns."""
        return self._for_python(*arguments)


def njit(
    *, inner: bool = False, inline: bool | str = False, makes_arrays: bool = True, **options: Any
) -> Callable[..., Any]:
    """numba's `njit` with these options: `cache`, `fastmath`; a division by 0 gives inf or nan.

    No kernel holds Python's lock: signals are heard, and progress is shown, while one runs.

    inner: kernels call it; Python gets an `InnerKernel`.  inline: it becomes a part of the machine code of those
    that call it; "always": by numba, of its Python code.  makes_arrays: whether it makes any; those that it is handed
    are then not counted.
    """
    # numba's own types do not list the last three
    made: dict[str, Any] = {
        "error_model": "numpy",
        "nogil": True,
        "no_cfunc_wrapper": True,
        "no_cpython_wrapper": inner,
    }
    made |= {"forceinline": True} if inline is True else {"inline": inline or "never"}
    if not makes_arrays:
        made["_nrt"] = False
    if inner:
        made["pipeline_class"] = InnerCompiler
    cached = options.pop("cache", False)
    compiled: Callable[..., Any] = numba.njit(**made | options)

    def kernel(function: Any) -> Any:
        if not COMPILED:
            function.py_func = function
            return function
        made = compiled(function)
        compile_now = made._compiler.compile
        made._compiler.compile = no_garbage_collection()(compile_now)
        if cached:
            made._cache = KernelCache(made)
        return InnerKernel(made) if inner else made

    return kernel


check_numba(numba.__version__)
