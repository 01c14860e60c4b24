"""Tasks to workers, results to the store: the loop of a sweep.

Where tasks run: processes of this machine, a scheduler that is already there, or the jobs of a batch system.  A
scheduler that is already there (on every node `NUMBA_NUM_THREADS` may set the threads of a worker):

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

import itertools
import logging
import os
import secrets
import signal
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from twilight.base.errors import TwilightError
from twilight.base.extras import is_installed, missing
from twilight.base.progress import Progress, silent
from twilight.studies.sweep.store import Store
from twilight.studies.sweep.work import Task, compute, forget

if TYPE_CHECKING:
    from distributed import Client, Future

TASKS_PER_THREAD = 2
"""Tasks given out for each worker thread: one at work, one waiting."""


@dataclass
class SweepOutcome:
    """What a run of a sweep did: tasks and skies computed, seconds, and the reason of each task that failed."""

    tasks: int = 0
    skies: int = 0
    cpu_s: float = 0.0
    wall_s: float = 0.0
    failed: dict[str, str] = field(default_factory=dict)


def run_sweep(
    client: Client, store: Store, *, threads: int | None = None, progress: Progress | None = None
) -> SweepOutcome:
    """Compute what the store lacks.  A task that fails is reported with its reason and does not stop the others.

    threads: of each worker; None: as the worker was started.
    Errors: TwilightError where the scheduler is lost or the store cannot be written; what was finished stays.
    """
    from distributed import as_completed  # optional

    begin, outcome = time.perf_counter(), SweepOutcome()
    missing = [task for task in store.sweep.tasks if task.key not in store.done]
    waiting, total, done = iter(missing), sum(task.skies for task in missing), 0
    running: dict[Future, Task] = {}
    completed = as_completed(loop=client.loop)
    run = secrets.token_hex(4)  # a scheduler remembers how a key ended, so that each run has keys of its own

    def give_out() -> None:
        for task in itertools.islice(waiting, max(0, _room(client) - len(running))):
            key = f"twilight-{task.key}-{run}"
            future = client.submit(compute, store.sweep.payload(task), threads, key=key, pure=False)
            running[future] = task
            completed.add(future)

    try:
        give_out()
        for future in completed:
            task = running.pop(future)
            _receive(client, store, future, task, outcome)
            done += task.skies
            outcome.wall_s = time.perf_counter() - begin
            bad = f", {len(outcome.failed)} tasks failed" if outcome.failed else ""
            speed = outcome.skies / max(outcome.wall_s, 1e-9)
            (progress or silent)(f"{done:,} of {total:,} skies, {speed:.3g} a second{bad}", done / max(total, 1))
            give_out()
        return outcome
    finally:
        # workers of a scheduler that lives on are not left with tasks that nobody waits for, nor with a field
        with suppress(Exception):
            if client.status == "running":
                if running:
                    client.cancel(list(running), force=True)
                else:
                    client.run(forget, on_error="ignore")


def _room(client: Client) -> int:
    """How many tasks may be given out at a time, so that results do not pile up and few are lost."""
    workers = client.scheduler_info(n_workers=-1)["workers"].values()
    return TASKS_PER_THREAD * max(1, sum(worker["nthreads"] for worker in workers))


def _lost(store: Store) -> TwilightError:
    return TwilightError(
        f"the scheduler is gone; {len(store.done)} of {len(store.sweep.tasks)} tasks are in {store.path}, and the same "
        f"command computes the rest"
    )


def _receive(client: Client, store: Store, future: Future, task: Task, outcome: SweepOutcome) -> None:
    """Write what a task gave, or note why it failed."""
    if future.status == "cancelled":
        raise _lost(store)
    try:
        result = future.result()
    except Exception as error:  # whatever a task dies of is its reason
        if client.status != "running":
            raise _lost(store) from None
        outcome.failed[task.key] = _reason(error)
        return
    store.write(task, result)
    future.release()
    outcome.tasks += 1
    outcome.skies += task.skies
    outcome.cpu_s += result.cpu_s


def _reason(error: Exception) -> str:
    """One sentence."""
    if type(error).__name__ == "KilledWorker":
        return "the worker died each time that it computed this; perhaps it ran out of memory"
    text = " ".join(str(error).split()) or "no message"
    return text if isinstance(error, TwilightError) else f"{type(error).__name__}: {text}"


def failures(store: Store, outcome: SweepOutcome) -> Iterator[tuple[str, list[tuple[int, ...]]]]:
    """(reason, scenes) of all that failed, now or in an earlier run, by reason."""
    by_reason: dict[str, list[tuple[int, ...]]] = {}
    for scene, reason in store.refused():
        by_reason.setdefault(reason, []).append(scene)
    for task in store.sweep.tasks:
        if task.key in outcome.failed:
            by_reason.setdefault(outcome.failed[task.key], []).extend(task.scenes())
    yield from by_reason.items()


BATCH_SYSTEMS = {name.lower(): f"{name}Cluster" for name in ("SLURM", "PBS", "SGE", "LSF", "HTCondor", "OAR", "Moab")}
"""Classes of dask_jobqueue by the names that users give."""
_DASK_SETTINGS: dict[str, Any] = {
    "distributed.scheduler.worker-ttl": None,  # a kernel that keeps the interpreter's lock is no dead worker
    **{f"distributed.{who}.http.routes": [] for who in ("scheduler", "worker", "nanny")},  # pages that end tasks
    **{f"distributed.worker.memory.{limit}": False for limit in ("target", "spill", "pause")},
    "distributed.admin.tick.limit": "1h",
    # arrays of some MB come and go with every sky: given back to the system each time, they took half the time
    **{f"distributed.nanny.pre-spawn-environ.MALLOC_{what}_THRESHOLD_": 2**28 for what in ("TRIM", "MMAP")},
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
