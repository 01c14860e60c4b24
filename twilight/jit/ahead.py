"""Kernels compiled side by side, before they are called: the first sky on a machine waits for little else.

`entries.json` lists by solver the kernels that Python calls for a sky, with the types of their arguments
(`benchmarks/builders/ship_kernels.py` writes it).  A process for each further core compiles them into numba's cache,
from the last to the first, while the program itself goes on; it takes what is there and waits for a kernel that another
process is compiling.  A list that is out of date costs time alone: what it lacks is compiled where it is called.
"""

from __future__ import annotations

import atexit
import json
import os
import shutil
import signal
import sys
import tempfile
from functools import cache
from importlib import import_module
from pathlib import Path
from typing import Any

from numba.core import types

from twilight.jit import machine_code

MOST = 8
"""Most processes, of some 150 MB each: kernels wait for those that they call."""


def compile_ahead(solver: str) -> None:
    """Begin to compile the kernels of a solver, where there are cores for it."""
    entries = listed().get(solver, [])
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else 1
    if machine_code.locks or not entries or cores < 2:
        return
    kernels = [(getattr(import_module(module), name), signature(kinds)) for module, name, kinds in entries]
    try:
        folder, parent = Path(tempfile.mkdtemp(prefix="twilight-")), os.getpid()
    except OSError:  # nowhere to keep locks: kernels are compiled one after the other
        return
    kernels[0][0].targetctx.refresh()  # once, not in each process
    machine_code.locks.append(folder)
    pids = []
    for first in range(min(cores, MOST) - 1):
        pid = os.fork()
        if pid == 0:
            _work(kernels[::-1][first:] + kernels[::-1][:first], parent)
        pids.append(pid)
    atexit.register(_end, pids, folder)


def _work(kernels: list[tuple[Any, Any]], parent: int) -> None:
    """Compile what no other process has begun, and end the process."""
    try:
        for number in (signal.SIGINT, signal.SIGTERM):
            signal.signal(number, signal.SIG_DFL)
        signal.set_wakeup_fd(-1)
        sys.stdout = sys.stderr = open(os.devnull, "w")  # the program itself says what there is to say
        for kernel, kinds in kernels:
            if os.getppid() != parent:
                break
            if not kernel._cache.is_taken(kinds):
                kernel.compile(kinds)
    finally:
        os._exit(0)


def _end(pids: list[int], folder: Path) -> None:
    for pid in pids:
        try:
            os.kill(pid, signal.SIGTERM)
            os.waitpid(pid, 0)
        except OSError:
            pass
    shutil.rmtree(folder, ignore_errors=True)


@cache
def listed() -> dict[str, list[Any]]:
    """What `entries.json` holds: by solver, [module, kernel, types of its arguments]."""
    found: dict[str, list[Any]] = json.loads(Path(__file__).with_name("entries.json").read_text(encoding="utf-8"))
    return found


def signature(kinds: list[Any]) -> tuple[Any, ...]:
    """numba's types of a list of them: "float64"; ["float64", 2, "C"], an array of two axes in C order; ["tuple",
    ...]; ["module:Class", ...], a named tuple of these fields."""
    return tuple(map(_type, kinds))


def _type(kind: Any) -> Any:
    if isinstance(kind, str):
        return getattr(types, kind)
    head, *rest = kind
    if head == "tuple":
        return types.Tuple(signature(rest))
    if ":" in head:
        module, _, name = head.partition(":")
        fields = signature(rest)
        named = getattr(import_module(module), name)
        same = len(set(fields)) == 1
        return types.NamedUniTuple(fields[0], len(fields), named) if same else types.NamedTuple(fields, named)
    return types.Array(getattr(types, head), *rest)


def described(kind: Any) -> Any:
    """What `signature` makes this type of; ValueError for one that it does not know."""
    parts: Any = kind
    if isinstance(kind, types.Array) and kind.mutable and kind.aligned:
        return [described(kind.dtype), kind.ndim, kind.layout]
    if isinstance(kind, types.BaseNamedTuple):
        named = parts.instance_class
        return [f"{named.__module__}:{named.__qualname__}", *map(described, parts.types)]
    if isinstance(kind, types.BaseTuple):
        return ["tuple", *map(described, parts.types)]
    name = "boolean" if kind == types.boolean else str(kind)
    if getattr(types, name, None) != kind:
        raise ValueError(f"no description of the type {kind}")
    return name
