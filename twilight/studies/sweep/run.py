"""Tasks to workers, results to the store: the loop of a sweep."""

from __future__ import annotations

import itertools
import queue
import secrets
import time
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from twilight.base.errors import TwilightError
from twilight.base.progress import Progress, silent
from twilight.studies.sweep.store import Store
from twilight.studies.sweep.work import Task, compute, forget

if TYPE_CHECKING:
    from distributed import Client, Future

TASKS_PER_THREAD = 2
"""Tasks given out for each worker thread: one at work, one waiting."""
LOST_AFTER_S = 15.0
"""Without a connection to the scheduler for this long, the sweep ends."""


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
    begin, outcome = time.perf_counter(), SweepOutcome()
    missing = [task for task in store.sweep.tasks if task.key not in store.done]
    waiting, total, done = iter(missing), sum(task.skies for task in missing), 0
    running: dict[Future, Task] = {}
    finished: queue.SimpleQueue[Future] = queue.SimpleQueue()
    run = secrets.token_hex(4)  # a scheduler remembers how a key ended, so that each run has keys of its own
    try:
        while True:
            for task in itertools.islice(waiting, max(0, _room(client) - len(running))):
                key = f"twilight-{task.key}-{run}"
                future = client.submit(compute, store.sweep.payload(task), threads, key=key, pure=False)
                running[future] = task
                future.add_done_callback(finished.put)
            if not running:
                return outcome
            future = _next(client, store, finished)
            task = running.pop(future)
            _receive(client, store, future, task, outcome)
            done += task.skies
            outcome.wall_s = time.perf_counter() - begin
            bad = f", {len(outcome.failed)} tasks failed" if outcome.failed else ""
            speed = outcome.skies / max(outcome.wall_s, 1e-9)
            (progress or silent)(f"{done:,} of {total:,} skies, {speed:.3g} a second{bad}", done / max(total, 1))
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


def _next(client: Client, store: Store, finished: queue.SimpleQueue[Future]) -> Future:
    """The next future that ends; TwilightError where the scheduler is gone."""
    connected = time.perf_counter()
    while True:
        with suppress(queue.Empty):
            return finished.get(timeout=0.5)
        if client.status == "running":
            connected = time.perf_counter()
        elif client.status == "closed" or time.perf_counter() - connected > LOST_AFTER_S:
            raise _lost(store)


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
