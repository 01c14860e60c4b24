"""The most memory that a process has held, of all it ever did or since a moment."""

from __future__ import annotations

import ctypes
import gc
import math
import sys
from contextlib import suppress

if sys.platform != "win32":
    import resource


def peak_mib() -> float:
    """Most memory this process has held [MiB], since `forget_peak` where the system can count anew; nan on Windows.

    Linux counts into ru_maxrss what the parent held when it started this process; VmHWM is this process alone.
    """
    with suppress(OSError), open("/proc/self/status", encoding="ascii") as status:
        for line in status:
            if line.startswith("VmHWM:"):
                return float(line.split()[1]) / 1024.0
    if sys.platform == "win32":
        return math.nan
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return peak / (1024.0**2 if sys.platform == "darwin" else 1024.0)


def forget_peak() -> None:
    """Free what nothing holds and have the peak counted anew; on Linux alone."""
    gc.collect()
    if sys.platform == "linux":
        with suppress(AttributeError, OSError):  # of the GNU C library alone
            ctypes.CDLL(None).malloc_trim(0)
    with suppress(OSError), open("/proc/self/clear_refs", "w", encoding="ascii") as file:
        file.write("5")
