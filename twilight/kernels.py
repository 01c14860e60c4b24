"""How kernels are compiled: numba's `njit`, with divisions as hardware does them.

Python's rule, an exception for a division by 0, puts a test and an exit into every division: a fifth more machine code
to compile, which does nothing here, for kernels keep their divisors off 0.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numba


def njit(**options: Any) -> Callable[..., Any]:
    """numba's `njit` with these options: `cache`, `nogil`, `inline`, `fastmath`; a division by 0 gives inf or nan."""
    return numba.njit(error_model="numpy", **options)
