"""Where tasks run: processes of this machine, a scheduler that is already there, or the jobs of a batch system.

A scheduler that is already there (on every node `NUMBA_NUM_THREADS` may set the threads of a worker):

    dask scheduler --port 8786
    dask worker tcp://HOST:8786 --nworkers 4 --nthreads 1      # on each node, with twilight installed
    twilight sweep sweep-haze --scheduler tcp://HOST:8786

A batch system, after `pip install '.[jobqueue]'`, with what a job is in ~/.config/dask/jobqueue.yaml; the command
itself stays on the login node and writes the dataset, while jobs may come, go and be killed:

    jobqueue:
      slurm: {name: twilight, queue: standard, cores: 1, memory: 4GB, walltime: '04:00:00', interface: ib0,
              job-script-prologue: ['export NUMBA_NUM_THREADS=1']}

    twilight sweep sweep-haze --batch-system slurm --workers 40
"""

from __future__ import annotations

import logging
import os
import signal
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from twilight.base.errors import TwilightError
from twilight.base.extras import is_installed, missing

if TYPE_CHECKING:
    from distributed import Client

BATCH_SYSTEMS = {
    "slurm": "SLURMCluster",
    "pbs": "PBSCluster",
    "sge": "SGECluster",
    "lsf": "LSFCluster",
    "htcondor": "HTCondorCluster",
    "oar": "OARCluster",
    "moab": "MoabCluster",
}
_DASK_SETTINGS: dict[str, Any] = {
    "distributed.scheduler.worker-ttl": None,  # a kernel that keeps the interpreter's lock is no dead worker
    **{f"distributed.{who}.http.routes": [] for who in ("scheduler", "worker", "nanny")},  # pages that end tasks
    **{f"distributed.worker.memory.{limit}": False for limit in ("target", "spill", "pause")},
    "distributed.admin.tick.limit": "1h",
    "distributed.comm.timeouts.connect": "10s",
}


@dataclass(frozen=True)
class Resources:
    """What the command line says about where to compute.

    scheduler: address of a running Dask scheduler; batch_system: a key of BATCH_SYSTEMS; with neither, processes of
    this machine.  workers: processes, or jobs of the batch system; threads: of each, None shares the cores evenly.
    """

    scheduler: str | None = None
    batch_system: str | None = None
    workers: int | None = None
    threads: int | None = None


def check_installed(resources: Resources) -> None:
    """Raise TwilightError where a package is missing that these resources need."""
    if resources.batch_system is not None and not is_installed("dask_jobqueue"):
        raise missing("dask_jobqueue", f"--batch-system: {resources.batch_system}")


@contextmanager
def connect(resources: Resources) -> Iterator[Client]:
    """A client of Dask's, whose cluster goes with it where this process has started it.

    Errors: TwilightError where a library is missing or the scheduler cannot be reached.
    """
    check_installed(resources)
    import dask  # optional
    import distributed  # before the settings: what it sets itself would go with them

    with dask.config.set(_DASK_SETTINGS), ExitStack() as opened:
        # what Dask logs about lost workers and schedulers is said by the sweep, in one sentence
        opened.callback(logging.disable, logging.root.manager.disable)
        logging.disable(logging.CRITICAL)
        where: Any = resources.scheduler
        if where is None:
            where = _local(resources) if resources.batch_system is None else _jobs(resources)
            opened.callback(_close, where)
        try:
            client = distributed.Client(where, timeout=10, set_as_default=False)
        except (OSError, TimeoutError, ValueError) as error:
            raise TwilightError(f"--scheduler: {where} cannot be reached ({str(error).splitlines()[0]})") from None
        opened.callback(_close, client)
        yield client


def _close(what: Any) -> None:
    with suppress(Exception):  # it may be gone already
        what.close(timeout=5)


def cores() -> int:
    """Cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def _local(resources: Resources) -> Any:
    from distributed import LocalCluster  # optional

    workers = resources.workers or cores()
    threads = resources.threads or max(1, cores() // workers)
    with _interrupts_for_this_thread_only():
        return LocalCluster(
            n_workers=workers,
            threads_per_worker=1,
            processes=True,
            host="127.0.0.1",
            dashboard_address=None,
            silence_logs=logging.CRITICAL,
            env={name: str(threads) for name in ("NUMBA_NUM_THREADS", "OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS")},
        )


@contextmanager
def _interrupts_for_this_thread_only() -> Iterator[None]:
    """Ctrl-C goes to a terminal's whole group: workers, which inherit the mask of the thread that is made here and
    that starts and restarts them, are to be ended by the cluster and not by a traceback of their own."""
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    from multiprocessing import resource_tracker  # start-up

    resource_tracker.ensure_running()  # where a worker's start has to begin it, that start lets interrupts in again
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _jobs(resources: Resources) -> Any:
    import dask_jobqueue  # optional

    try:
        cluster = getattr(dask_jobqueue, BATCH_SYSTEMS[str(resources.batch_system)])()
        cluster.scale(jobs=resources.workers or 1)
    except (ValueError, OSError, RuntimeError, TypeError) as error:
        raise TwilightError(
            f"--batch-system: {resources.batch_system} cannot be used ({str(error).splitlines()[0]}); cores, memory, "
            f"queue and walltime are read from jobqueue.yaml in ~/.config/dask"
        ) from None
    return cluster
