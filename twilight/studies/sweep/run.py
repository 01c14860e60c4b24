"""Tasks to workers, results to the store: the loop of a sweep."""

from __future__ import annotations

import itertools
import queue
import secrets
import time
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

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
    return _SweepRun(client, store, threads, progress or silent).all_tasks()


class _SweepRun:
    def __init__(self, client: Client, store: Store, threads: int | None, progress: Progress):
        self.client, self.store, self.threads, self.progress = client, store, threads, progress
        self.tasks = [task for task in store.sweep.tasks if task.key not in store.done]
        self.running: dict[Future, Task] = {}
        self.finished: queue.SimpleQueue[Future] = queue.SimpleQueue()
        self.outcome = SweepOutcome()
        self.run = secrets.token_hex(4)

    def all_tasks(self) -> SweepOutcome:
        begin = time.perf_counter()
        waiting = iter(self.tasks)
        total = sum(task.skies for task in self.tasks)
        done = 0
        try:
            while True:
                for task in itertools.islice(waiting, max(0, self._room() - len(self.running))):
                    self._submit(task)
                if not self.running:
                    break
                future = self._next()
                task = self.running.pop(future)
                self._receive(future, task)
                done += task.skies
                self.outcome.wall_s = time.perf_counter() - begin
                self._report(done, total)
        finally:
            self._release_workers()
        return self.outcome

    def _room(self) -> int:
        """How many tasks may be given out at a time, so that results do not pile up and few are lost."""
        workers = self.client.scheduler_info(n_workers=-1)["workers"].values()
        return TASKS_PER_THREAD * max(1, sum(worker["nthreads"] for worker in workers))

    def _submit(self, task: Task) -> None:
        # a scheduler remembers how a key ended, so that each run has keys of its own
        key = f"twilight-{task.key}-{self.run}"
        future = self.client.submit(compute, self.store.sweep.payload(task), self.threads, key=key, pure=False)
        self.running[future] = task
        future.add_done_callback(self.finished.put)

    def _next(self) -> Future:
        lost_since: float | None = None
        while True:
            try:
                return self.finished.get(timeout=0.5)
            except queue.Empty:
                pass
            if self.client.status == "running":
                lost_since = None
                continue
            lost_since = lost_since or time.perf_counter()
            if self.client.status == "closed" or time.perf_counter() - lost_since > LOST_AFTER_S:
                raise self._lost()

    def _lost(self) -> TwilightError:
        return TwilightError(
            f"the scheduler is gone; {len(self.store.done)} of {len(self.store.sweep.tasks)} tasks are in "
            f"{self.store.path}, and the same command computes the rest"
        )

    def _receive(self, future: Future, task: Task) -> None:
        if future.status == "cancelled":
            raise self._lost()
        try:
            result = future.result()
        except Exception as error:  # whatever a task dies of is its reason
            if future.status == "cancelled" or self.client.status != "running":
                raise self._lost() from None
            self.outcome.failed[task.key] = _reason(error)
            return
        self.store.write(task, result)
        future.release()
        self.outcome.tasks += 1
        self.outcome.skies += task.skies
        self.outcome.cpu_s += result.cpu_s

    def _report(self, done: int, total: int) -> None:
        speed = self.outcome.skies / max(self.outcome.wall_s, 1e-9)
        words = f"{done:,} of {total:,} skies, {speed:.3g} a second"
        bad = len(self.outcome.failed)
        self.progress(words + (f", {bad} tasks failed" if bad else ""), done / max(total, 1))

    def _release_workers(self) -> None:
        """Workers of a scheduler that lives on are not left with tasks that nobody waits for, nor with a field."""
        with suppress(Exception):
            if self.client.status == "running":
                if self.running:
                    self.client.cancel(list(self.running), force=True)
                else:
                    self.client.run(forget, on_error="ignore")


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
            scenes: Any = (scene for block in task.blocks for scene in block.scenes())
            by_reason.setdefault(outcome.failed[task.key], []).extend(scenes)
    yield from by_reason.items()
