"""Runs jobs in worker processes and caches their results, so that an interrupted comparison can be continued."""

import json
import queue
import subprocess
import sys
import threading
import time
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from twilight.base.errors import TwilightError
from twilight.base.progress import Progress, silent
from twilight.base.reading import read_text
from twilight.base.whole_files import whole_file
from twilight.studies.compare.job import Job, JobOutcome, Timing

MAX_ROW_BYTES = 200_000_000
"""Largest file of cached results that is read."""


WORKER = "import sys; sys.path.append({package!r}); from twilight.studies.compare.worker import main; sys.exit(main())"
"""Program of a worker process; package: the folder that `twilight` is in."""


@dataclass
class Bench:
    """folder: where results are cached; time_limit_s: of one worker, after which it is ended."""

    folder: Path
    time_limit_s: float = 900.0

    def measure(self, job: Job, progress: Progress | None = None) -> dict[float, JobOutcome]:
        """What is known about each sun of the job after running what is missing.

        Errors: TwilightError where the folder cannot be written.
        """
        self.folder.mkdir(parents=True, exist_ok=True)
        outcomes = {sun: self._cached(job, sun) for sun in job.suns}
        suns = tuple(s for s in job.suns if not outcomes[s].reason and self._missing(job, outcomes[s]))
        if suns:
            self._run(job, suns, outcomes, progress or silent)
        return outcomes

    @staticmethod
    def _missing(job: Job, outcome: JobOutcome) -> bool:
        return outcome.radiance is None or (job.timed and outcome.timing is None)

    def _cached(self, job: Job, sun: float) -> JobOutcome:
        outcome = JobOutcome()
        for what in ("time", "radiance") if job.timed else ("radiance",):
            cached = _read(self._file(job, sun, what))
            reason = cached.get("reason", "")
            if reason and cached.get("limit_s", self.time_limit_s) < self.time_limit_s:
                continue  # there is more time now
            outcome.reason = outcome.reason or reason
            with suppress(TypeError, ValueError):  # a damaged file counts as none
                if "timing" in cached:
                    outcome.timing = Timing(**cached["timing"])
                if "radiance" in cached:
                    radiance = np.array(cached["radiance"], dtype=float)
                    if radiance.ndim == 2 and len(radiance) == len(job.directions[sun].elevation_deg):
                        outcome.radiance = radiance
        return outcome

    def _file(self, job: Job, sun: float, what: str) -> Path:
        return self.folder / f"{job.solver}-{job.quality}{sun:+g}-{what}-{job.key(sun, what)}.json"

    def _store(self, job: Job, sun: float, what: str, value: dict[str, Any]) -> None:
        with whole_file(self._file(job, sun, what)) as path:
            path.write_text(json.dumps(value), encoding="utf-8")

    def _run(self, job: Job, suns: tuple[float, ...], outcomes: dict[float, JobOutcome], progress: Progress) -> None:
        timed = tuple(s for s in suns if job.timed and outcomes[s].timing is None)
        message = job.message(suns, timed)
        what = "time" if job.timed else "radiance"
        compiled_s = 0.0
        for _ in range(3):  # machine code is made by workers of their own: the next worker finds it in numba's cache
            worker = _Worker(message, self.time_limit_s)
            again = False
            for answer in worker.answers():
                if "compiled_s" in answer:
                    compiled_s += answer["compiled_s"]
                    again = True
                elif "progress" in answer:
                    progress(*answer["progress"])
                else:
                    self._receive(job, answer, outcomes, compiled_s, what)
            unfinished = [s for s in suns if not outcomes[s].reason and self._missing(job, outcomes[s])]
            for sun in unfinished if worker.timed_out or worker.failure else ():
                outcomes[sun].reason = worker.failure or f"stopped after {self.time_limit_s:g} s (time limit)"
                if worker.timed_out:
                    self._store(job, sun, "radiance", {"reason": outcomes[sun].reason, "limit_s": self.time_limit_s})
            if not again:
                return
        for sun in unfinished:
            outcomes[sun].reason = outcomes[sun].reason or "numba cannot cache machine code (NUMBA_CACHE_DIR)"

    def _receive(
        self, job: Job, answer: dict[str, Any], outcomes: dict[float, JobOutcome], compiled_s: float, what: str
    ) -> None:
        sun = answer["sun"]
        outcome = outcomes[sun]
        if "timing" in answer:
            outcome.timing = replace(Timing(**answer["timing"]), compiled_s=compiled_s)
            self._store(job, sun, "time", {"timing": vars(outcome.timing)})
        elif "radiance" in answer:
            outcome.radiance = np.array(answer["radiance"])
            self._store(job, sun, "radiance", {"radiance": answer["radiance"]})
        else:
            outcome.reason = answer["reason"]
            self._store(job, sun, what, {"reason": outcome.reason})


def _read(path: Path) -> dict[str, Any]:
    """What is cached in a file; nothing where there is none or it is damaged."""
    try:
        cached = json.loads(read_text(path, MAX_ROW_BYTES))
    except (TwilightError, ValueError):
        return {}
    return cached if isinstance(cached, dict) else {}


class _Worker:
    """A worker process; it is ended when its time is up and whenever its reader leaves."""

    def __init__(self, message: dict[str, Any], time_limit_s: float):
        self.message, self.time_limit_s = message, time_limit_s
        self.timed_out = False
        self.failure = ""

    def answers(self) -> Any:
        # a session of its own: Ctrl-C reaches this process alone, which then ends the worker
        process = subprocess.Popen(
            # without the working folder on its path, whose random.py it would run
            [sys.executable, "-P", "-c", WORKER.format(package=str(Path(__file__).parents[3]))],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            start_new_session=True,
        )
        lines: queue.Queue[str | None] = queue.Queue()
        errors: list[str] = []
        threads = [
            threading.Thread(target=_pump, args=(process.stdout, lines), daemon=True),
            threading.Thread(target=lambda: errors.extend(process.stderr or ()), daemon=True),
        ]
        try:
            assert process.stdin is not None
            for thread in threads:
                thread.start()
            process.stdin.write(json.dumps(self.message))
            process.stdin.close()
            deadline = time.monotonic() + self.time_limit_s
            while True:
                try:
                    line = lines.get(timeout=max(deadline - time.monotonic(), 0.0))
                except queue.Empty:
                    self.timed_out = True
                    return
                if line is None:
                    break
                yield json.loads(line)
            if process.wait() != 0:
                threads[1].join(1.0)
                last = next((e.strip() for e in reversed(errors) if e.strip()), f"exit status {process.returncode}")
                self.failure = f"ended without an answer: {last}"
        finally:
            if process.poll() is None:
                process.kill()
            process.wait()


def _pump(stream: Any, lines: queue.Queue) -> None:
    for line in stream:
        lines.put(line)
    lines.put(None)
