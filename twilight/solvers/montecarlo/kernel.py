"""How the innermost kernels are compiled."""

from __future__ import annotations

from typing import Any

# Kernels that only read and write arrays they are given need no reference counting.  Numba counts all the same whenever
# an array is taken out of a named tuple, which took 40 % of the time of a path.  `_nrt=False` leaves the counting out;
# such a kernel may not create arrays (it would not compile).
INNER: dict[str, Any] = {"cache": True, "_nrt": False}
