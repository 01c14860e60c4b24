"""Ctrl-C and SIGTERM end a command within seconds, also while compiled code runs.

Python's own handler unwinds the stack, so that temporary files go, but only once the main thread is back in Python,
which inside a kernel may take minutes.  A second thread hears of the signal at once and ends the process where the
first does not.
"""

from __future__ import annotations

import os
import signal
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from typing import Any

from twilight.base.whole_files import remove_unfinished

GRACE_S = 3.0
"""Time that the main thread has for leaving by itself [s]."""
SENTENCES = {
    signal.SIGINT: "interrupted; what was finished before is kept",
    signal.SIGTERM: "terminated; what was finished before is kept",
}


@contextmanager
def leaving_on_signals() -> Iterator[None]:
    """SIGTERM unwinds the stack as Ctrl-C does; both end the process after GRACE_S at the latest."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return

    def leave(number: int, frame: Any) -> None:
        print(f"twilight: {SENTENCES[signal.SIGTERM]}", file=sys.stderr)
        raise SystemExit(128 + number)

    before = signal.signal(signal.SIGTERM, leave)
    try:
        with _watched():
            yield
    finally:
        signal.signal(signal.SIGTERM, before)


@contextmanager
def _watched() -> Iterator[None]:
    if os.name == "nt":  # has no pipe that signals can write to
        yield
        return
    reading, writing = os.pipe()
    os.set_blocking(writing, False)
    before = signal.set_wakeup_fd(writing, warn_on_full_buffer=False)
    threading.Thread(target=_end_after_grace, args=(reading,), daemon=True).start()
    try:
        yield
    finally:
        signal.set_wakeup_fd(before)
        os.close(writing)  # the thread reads the end of it and is done, if there was no signal


def _end_after_grace(reading: int) -> None:
    """End the process GRACE_S after a signal to leave; return where the pipe is closed before one comes."""
    while True:
        received = os.read(reading, 1)
        if not received:
            os.close(reading)
            return
        if received[0] in (signal.SIGINT, signal.SIGTERM):
            break
    number = signal.Signals(received[0])
    time.sleep(GRACE_S)
    remove_unfinished()
    with suppress(OSError):
        os.write(2, f"twilight: {SENTENCES[number]}\n".encode())
    os._exit(128 + number)
