"""Kernels that a second process compiles while this one computes; both keep machine code in numba's folder on disk.

numba compiles one kernel at a time in a process.  The first run of a solver therefore leaves what it will need last to
a process of its own: `start` it before, `wait` for it where its kernels are called, which then only read what it wrote.
If that process fails, or cannot keep its machine code, the kernels are compiled here as ever.
"""

from __future__ import annotations

import atexit
import os
import subprocess
import sys
from pathlib import Path

_ROOT = Path(__file__).resolve().parents[2]
_running: list[subprocess.Popen] = []


def start(module: str) -> bool:
    """Run a module of twilight beside this process; whether that is done.  Not on one core, where nothing is gained."""
    if _running or cores() < 2:
        return False
    path = os.pathsep.join(part for part in (str(_ROOT), os.environ.get("PYTHONPATH", "")) if part)
    try:
        made = subprocess.Popen(
            [sys.executable, "-m", module],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            env={**os.environ, "PYTHONPATH": path},
        )
    except OSError:  # no more processes are allowed
        return False
    _running.append(made)
    atexit.register(_stop, made)
    return True


def wait() -> None:
    """Return when what was started has ended; at once where nothing was."""
    while _running:
        _running.pop().wait()


def cores() -> int:
    """How many cores this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def _stop(process: subprocess.Popen) -> None:
    if process.poll() is None:
        process.terminate()
        process.wait()
