"""What the commands share: one sentence instead of a traceback, a progress bar, tables.

Ctrl-C and SIGTERM end a command within seconds, also while compiled code runs.

Python's own handler unwinds the stack, so that temporary files go, but only once the main thread is back in Python,
which inside a kernel may take minutes.  A second thread is told of the signal at once and ends the process if the
first does not.
"""

from __future__ import annotations

import functools
import os
import signal
import sys
import threading
import time
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from typing import Any

import typer

from twilight.base.errors import TwilightError, TwilightWarning
from twilight.base.extras import REQUIREMENTS, missing
from twilight.base.progress import Progress
from twilight.base.whole_files import refusal, remove_unfinished
from twilight.cli.options import spread

PROGRESS_LINE_S = 15.0
"""Seconds between lines of progress where the output is no terminal."""


def with_errors_as_sentences(command: Callable[..., None]) -> Callable[..., None]:
    """The command (`options.spread`), with a TwilightError printed as one sentence (exit code 2) and signals as exit
    codes 130 and 143."""

    command = spread(command)

    @functools.wraps(command)
    def guarded(*args: Any, **kwargs: Any) -> None:
        try:
            with leaving_on_signals(), warnings.catch_warnings():
                warnings.showwarning = _print_warnings_once()  # type: ignore[assignment]
                command(*args, **kwargs)
        except TwilightError as error:
            print(f"twilight: {error}", file=sys.stderr)
            raise typer.Exit(2) from None
        except KeyboardInterrupt:
            print(f"twilight: {SENTENCES[signal.SIGINT]}", file=sys.stderr)
            raise typer.Exit(130) from None
        except ModuleNotFoundError as error:
            absent = (error.name or "").partition(".")[0]
            if absent not in REQUIREMENTS:
                raise
            print(f"twilight: {missing(absent, command.__name__)}", file=sys.stderr)
            raise typer.Exit(2) from None
        except Exception as error:
            # a file or folder that the system refuses in a way that nobody foresaw
            reason = refusal(error)
            if reason is None or (isinstance(error, OSError) and error.filename is None):
                raise  # `twilight.cli.main` has a sentence for the standard output
            where = getattr(error, "filename", None)
            print(f"twilight: {TwilightError(f'{where}: {reason}' if where else reason)}", file=sys.stderr)
            raise typer.Exit(2) from None

    return guarded


def _print_warnings_once() -> Callable[..., None]:
    """A `TwilightWarning` is printed as a sentence, one time; other warnings are for developers and are not shown."""
    said: set[str] = set()

    def say(message: Any, category: type[Warning], *_: Any) -> None:
        if issubclass(category, TwilightWarning) and str(message) not in said:
            said.add(str(message))
            print(f"twilight: {message}", file=sys.stderr)

    return say


@contextmanager
def progress_bar() -> Iterator[Progress]:
    """A bar with the time left on stderr; where that is no terminal, now and then a line.

    Gives a function of a few words on what is being done and the fraction done, 0 to 1.
    """
    if not sys.stderr.isatty():
        yield _progress_lines()
        return
    from rich import progress as rich_progress
    from rich.console import Console
    from rich.markup import escape
    from rich.progress import BarColumn, TaskProgressColumn, TextColumn
    from rich.table import Column

    words = TextColumn("{task.description}", table_column=Column(no_wrap=True, overflow="ellipsis"))
    columns = (BarColumn(bar_width=24), TaskProgressColumn(), _time_left_column(), words)
    with rich_progress.Progress(*columns, console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task("starting", total=1.0)
        yield lambda doing, fraction: bar.update(task, completed=fraction, description=escape(doing))


def _progress_lines() -> Progress:
    """A line on stderr every PROGRESS_LINE_S seconds, so that a log says what long work is doing."""
    begin = last = time.monotonic()

    def print_line(doing: str, fraction: float) -> None:
        nonlocal last
        now = time.monotonic()
        if now - last >= PROGRESS_LINE_S:
            last = now
            print(
                f"twilight: {100 * fraction:3.0f} %, {time_left(fraction, now - begin)}: {doing}",
                file=sys.stderr,
                flush=True,
            )

    return print_line


def _time_left_column() -> Any:
    """Time left at the mean speed so far: fractions come in jumps that say nothing about the speed of the moment."""
    from rich.progress import ProgressColumn, Task
    from rich.text import Text

    class TimeLeft(ProgressColumn):
        def render(self, task: Task) -> Text:
            return Text(time_left(task.completed, task.elapsed or 0.0), style="progress.remaining")

    return TimeLeft()


compiling = False
"""Whether this run compiles kernels: the time that its first half takes says nothing of the second."""


def time_left(fraction: float, elapsed_s: float) -> str:
    """`0:01:05 left` where `fraction` of the work took `elapsed_s`; nothing can be said before a tenth is done, which
    is set-up, nor before 0.6 of it in a run that compiles."""
    if compiling and fraction < 0.6:
        return "compiling, time left not known"
    if fraction < 0.1:
        return "-:--:-- left"
    seconds = round(elapsed_s * (1.0 - fraction) / fraction)
    return f"{seconds // 3600}:{seconds // 60 % 60:02d}:{seconds % 60:02d} left"


def print_table(columns: list[str], rows: list[list[str]], *, right: tuple[int, ...] = ()) -> None:
    """A table on stdout: drawn in a terminal, tab-separated without a frame elsewhere."""
    if not sys.stdout.isatty():
        for row in (columns, *rows):
            print("\t".join(row))
        return
    from rich import box
    from rich.console import Console
    from rich.table import Table
    from rich.text import Text

    table = Table(box=box.SIMPLE_HEAD, pad_edge=False)
    for i, name in enumerate(columns):
        table.add_column(name, justify="right" if i in right else "left")
    for row in rows:
        table.add_row(*(Text(cell) for cell in row))
    Console().print(table)


def time_of(seconds: float) -> str:
    """A time in the unit that reads best: 12 s, 3.4 min, 5 h."""
    if seconds < 100.0:
        return f"{seconds:.2g} s"
    return f"{seconds / 60.0:.2g} min" if seconds < 6000.0 else f"{seconds / 3600.0:.2g} h"


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
