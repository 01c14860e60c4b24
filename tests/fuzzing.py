"""Random documents and damaged files for the fuzz tests, and what may come of them.

An input is accepted, or refused by a TwilightError of one line.  Anything else is a fault: another exception, a message
of several lines, more than `CPU_SECONDS` of processor time, more than `MEMORY_BYTES` of memory on top.
"""

import os
import random
import signal
import threading
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, get_args, get_origin

from pydantic import BaseModel

from twilight.base.errors import TwilightError

CPU_SECONDS = 30
WALL_SECONDS = 1800
"""Waiting for something that never comes takes no processor time; a busy machine makes everything wait."""
MEMORY_BYTES = 1_500_000_000
LONGEST_MESSAGE = 3000

NASTY: tuple[Any, ...] = (
    None, True, False, 0, -1, 1, 2, 3.5, -0.0, 1e-320, 1e308, -1e308, 10**30, -(10**30), 10**400, float("nan"),
    float("inf"), -float("inf"), "", " ", "x", "1", "1e3", "nan", "true", "null", "~", "\0", "a\nb", "\u202e\u0000x",
    "é漢字🌅", "\ud7ff", "a" * 5000, "../../../etc/passwd", "..", ".", "/", "/dev/zero", "/dev/stdin", "~", "~root/x",
    "urban", "pure-air", "haber2005-air", "urban.yaml", "Europe/Berlin", "../../etc/passwd", "posixrules", "UTC",
    "2003-12-08T16:00", "2003-12-08", "16:00", "0001-01-01T00:00+14:00", "9999-12-31T23:59-12:00", "2003-03-30T02:30",
    "2003-02-31T00:00", "cells", "montecarlo", "zones", "cie", "draft", "ciddor", "none", [], {}, [[]], [{}], [1, 2],
    [3, 2, 1], [1, 1], [float("nan")], [None], ["a"], [1e300, 2e300], list(range(3000)), [[1, 2], [3, 4]], {"a": 1},
    {"": 1}, {"a.b": 1}, {"é": None}, {"version": 1}, {"climate": "urban"}, {"name": "cells"}, {"elevation_deg": 3},
    {"at": "2003-12-08T16:00", "latitude_deg": 91}, {"start": "0001-01-01T00:00Z", "stop": "9999-12-31T00:00Z"},
    {"waso": 1e300}, {"waso": -1}, {"wavelength_nm": [1, 2], "albedo": [1]}, {"type": "urban", "components": {}},
)  # fmt: skip

ODD_YAML: tuple[str, ...] = (
    "&a [*a]", "&a {x: *a}", "*a", "<<: {a: 1}", "!!python/object/apply:os.system ['true']", "!!binary aGVsbG8=",
    "!!set {a, b}", "!!timestamp 2001-99-99", "!!float .nan", "!!int 0x_", "!!omap [a: 1]", "!x y", "? [1, 2]\n: 3",
    "? {a: b}\n: c", "|\n  a\n  b", ">-\n  folded", '"\\x00\\uD800"', "'unclosed", '"unclosed', "[1, 2", "{a: 1",
    "- - - -", "%YAML 1.1\n---", "---\na: 1\n---\nb: 2", "...", "\t- tab", "@reserved", "`reserved", "0o17", "1_000",
    "12:30:45", "1e400", "-1e400", "0x7fffffffffffffff", "9" * 4000, "9" * 20000, "." * 200, "{" * 300, "[" * 3000,
    "- " * 3000, "? " * 800, "&x " * 50, "#", ": : :", "\ufeff", "\u2028", "\x85", "a: b: c", "null: null", "1: 2",
    "true: 1", "[]: 1",
)  # fmt: skip


class Fault(AssertionError):
    """An input that was neither accepted nor refused in one sentence."""


@contextmanager
def limited(seconds: float = CPU_SECONDS, memory_bytes: int = MEMORY_BYTES) -> Iterator[None]:
    """Raise Fault after so much processor time or WALL_SECONDS, and MemoryError beyond so much more memory than now.

    Only where the system can do that.
    """
    if os.name != "posix" or threading.current_thread() is not threading.main_thread():
        yield
        return

    def late(signum: int, frame: Any) -> None:
        raise Fault("took too long")

    before = [(number, signal.signal(number, late)) for number in (signal.SIGALRM, signal.SIGPROF)]
    signal.alarm(WALL_SECONDS)
    signal.setitimer(signal.ITIMER_PROF, seconds)
    try:
        with _address_space(memory_bytes):
            yield
    finally:
        signal.alarm(0)
        signal.setitimer(signal.ITIMER_PROF, 0.0)
        for number, handler in before:
            signal.signal(number, handler)


@contextmanager
def _address_space(more_bytes: int) -> Iterator[None]:
    statm = Path("/proc/self/statm")
    if not statm.exists():
        yield
        return
    import resource

    soft, hard = resource.getrlimit(resource.RLIMIT_AS)
    now = int(statm.read_text().split()[0]) * resource.getpagesize()
    resource.setrlimit(resource.RLIMIT_AS, (now + more_bytes, hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_AS, (soft, hard))


def attempt(action: Callable[[], Any], what: str) -> tuple[bool, str]:
    """(accepted, message of the refusal); Fault that shows `what` for anything else."""
    try:
        with limited(), warnings.catch_warnings():
            warnings.simplefilter("ignore")
            action()
    except TwilightError as error:
        message = str(error)
        check_message(message, what)
        return False, message
    except Fault as fault:
        raise Fault(f"{what}: {fault}") from None
    except BaseException as error:
        raise Fault(f"{what}: {type(error).__name__}: {str(error)[:300]}") from error
    return True, ""


def check_message(message: str, what: str) -> None:
    """One line that can be printed, and not a page."""
    lines = message.splitlines()
    if len(lines) != 1 or not message.strip() or "Traceback" in message or len(message) > LONGEST_MESSAGE:
        raise Fault(f"{what}: refused in {len(lines)} lines, {len(message)} characters: {message[:300]!r}")
    try:
        message.encode()
    except UnicodeEncodeError as error:
        raise Fault(f"{what}: a refusal that cannot be printed: {message[:300]!r}") from error


def dotted_keys(model: type[BaseModel], before: str = "") -> Iterator[str]:
    """Every key of a section and of the sections in it, as `--set` takes them."""
    for name, info in model.model_fields.items():
        yield before + name
        for section in _sections(info.annotation):
            yield from dotted_keys(section, f"{before}{name}.")


def _sections(annotation: Any) -> Iterator[type[BaseModel]]:
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        yield annotation
    elif get_origin(annotation) is not tuple:
        for part in get_args(annotation):
            yield from _sections(part)


def damaged_bytes(rng: random.Random, whole: bytes) -> bytes:
    """A file cut short, with bytes changed, blocks zeroed, moved, repeated, or junk in place of it."""
    raw = bytearray(whole)
    how = rng.randrange(7)
    if how == 0:
        return bytes(raw[: rng.randrange(len(raw))])
    if how == 1:
        for _ in range(rng.choice((1, 1, 2, 8, 64))):
            raw[rng.randrange(len(raw))] = rng.randrange(256)
    elif how == 2:  # headers are where the sizes are
        for _ in range(rng.choice((1, 2, 8))):
            raw[rng.randrange(min(len(raw), 4000))] = rng.choice((0, 1, 0x7F, 0x80, 0xFF, rng.randrange(256)))
    elif how == 3:
        at = rng.randrange(len(raw))
        size = rng.choice((4, 8, 512))
        raw[at : at + size] = rng.choice((b"\0", b"\xff", b"\x7f")) * len(raw[at : at + size])
    elif how == 4:
        a, b = sorted((rng.randrange(len(raw)), rng.randrange(len(raw))))
        raw[a:b] = raw[a:b][::-1] if rng.random() < 0.5 else b""
    elif how == 5:
        at = rng.randrange(len(raw))
        raw[at:at] = rng.randbytes(rng.choice((1, 4, 100)))
    else:
        return rng.choice((b"", b"\0" * 100, rng.randbytes(3000), raw[:8] + rng.randbytes(2000), b"\x89HDF\r\n\x1a\n"))
    return bytes(raw)


def damaged_table(rng: random.Random, whole: str) -> str:
    """A CSV table with cells, rows, columns or characters that do not belong there."""
    rows = [line.split(",") for line in whole.splitlines()]
    for _ in range(rng.choice((1, 1, 1, 3))):
        r = rng.randrange(len(rows))
        how = rng.randrange(9)
        if how <= 3 and rows[r]:
            rows[r][rng.randrange(len(rows[r]))] = rng.choice(
                ("", "nan", "inf", "-inf", "-1", "1e400", "1e308", "1e-320", "x", "0x10", "1_0", " 1 ", '"', '"1"',
                 "1;2", "9" * 5000, "é", "\0", "-0", "1e6", "0.5", "2000", "١٢", "#", "\u2028", "1\r2")
            )  # fmt: skip
        elif how == 4:
            rows.insert(r, list(rows[rng.randrange(len(rows))]))
        elif how == 5 and len(rows) > 1:
            del rows[r]
        elif how == 6 and rows[r]:
            del rows[r][rng.randrange(len(rows[r]))]
        elif how == 7:
            column = rng.randrange(len(rows[0]) or 1)
            rows = [row[:column] + row[column + 1 :] for row in rows]
        else:
            rng.shuffle(rows)
        if not rows:
            break
    text = "\n".join(",".join(row) for row in rows)
    return text if rng.random() < 0.8 else text[: rng.randrange(len(text) + 1)]
