"""How kernels are compiled: numba's `njit`, with divisions as hardware does them, and without what nobody calls.

Python's rule, an exception for a division by 0, puts a test and an exit into every division: a fifth more machine code
to compile, which does nothing here, for kernels keep their divisors off 0.

Beside each kernel numba makes two more functions: one for C, which nothing here calls, and one for Python, which takes
every field out of every named tuple of arrays.  For a kernel that only kernels call, the second is most of the work;
`inner` leaves it out.  Python must not call such a kernel (its `py_func` it may); `tests/test_kernels.py` sees to that.

numba counts who holds an array, and does so again for every row of one that is handed on and in every kernel that is
called: a third of the time of a short one.  A kernel that makes no arrays needs none of it (`makes_arrays=False`);
numba then refuses to compile one that does.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numba


def njit(*, inner: bool = False, makes_arrays: bool = True, **options: Any) -> Callable[..., Any]:
    """numba's `njit` with these options: `cache`, `nogil`, `inline`, `fastmath`; a division by 0 gives inf or nan.

    inner: kernels alone call it; a call from Python ends the process.  makes_arrays: whether it makes any; those that
    it is handed are then not counted.
    """
    # numba's own types do not list the last two
    made: dict[str, Any] = {"error_model": "numpy", "no_cfunc_wrapper": True, "no_cpython_wrapper": inner}
    if not makes_arrays:
        made["_nrt"] = False
    return numba.njit(**made, **options)
