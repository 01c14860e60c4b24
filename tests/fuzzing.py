"""Random documents and damaged files for the fuzz tests, and what may come of them.

An input is accepted, or refused by a TwilightError of one line.  Anything else is a fault: another exception, a message
of several lines, more than `CPU_SECONDS` of processor time, more than `MEMORY_BYTES` of memory on top.
"""

from __future__ import annotations

import os
import random
import signal
import threading
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from copy import deepcopy
from pathlib import Path
from typing import Any

import yaml

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


# --- configurations ---


def seeds(root: Path) -> list[dict[str, Any]]:
    """Valid documents: those in `climates/` and `configs/`, and some that use what these do not."""
    files = sorted([*root.glob("climates/*.yaml"), *root.glob("configs/*.yaml")])
    found = [yaml.load(file.read_text(encoding="utf-8"), Loader=yaml.BaseLoader) for file in files]
    documents = [_typed(document) for document in found]
    documents += [
        {
            "version": 1, "name": "all", "climate": {
                "version": 1, "name": "own",
                "atmosphere": {"profile": "tropical", "top_km": 90, "layers": {"equal_air_mass": 40}},
                "gases": {"ozone": {"column_du": 300, "treatment": "layer"}, "no2": False, "o4": True},
                "refraction": {"model": "haber", "co2_ppm": 400},
                "aerosol": {"components": {"waso": 7000, "inso": 0.4}, "relative_humidity_percent": 80,
                            "optical_depth_550nm": 0.2, "phase_function": "henyey_greenstein",
                            "mineral_transported": {"bottom_km": 2, "top_km": 4, "optical_depth_550nm": 0.1}},
                "stratosphere": {"kind": "background", "season": "fall_winter"},
                "ground": {"albedo": {"wavelength_nm": [400, 700], "albedo": [0.1, 0.2]}}},
            "sun": {"start": "2003-12-08T16:00", "stop": "2003-12-08T18:00", "step_minutes": 30,
                    "latitude_deg": 49, "longitude_deg": 7, "time_zone": "Europe/Berlin"},
            "observer": {"altitude_km": 0.5}, "wavelengths": {"list_nm": [450, 550, 650]},
            "solar_spectrum": "sao2010", "solver": {"name": "cells", "quality": "draft", "max_orders": 4},
            "texture": {"azimuth_count": 36, "elevation_count": 9},
            "output": {"renderer": "blender", "width": 64, "spectral_width": 32, "views": ["fisheye"],
                       "exposure_ev100": 3, "tone_mapping": "gamma"},
            "omit_negligible": False,
        },
        {"version": 1, "climate": "pure-air", "sun": {"elevations_deg": [30, 3]}, "solver": {"name": "cie"},
         "texture": {"resolution_deg": 45}, "output": {"width": 16, "spectral_width": 8},
         "vary": {"ground.albedo": [0, 0.5], "observer.altitude_km": [0, 0.1]}},
        {"version": 1, "medium": {"table": "t1.csv", "depolarisation": 0.03}, "ground": {"albedo": 0.3}},
        {"version": 1, "climate": "pure-air", "solver": {"name": "montecarlo", "samples": 8, "target_stderr": None}},
        {"version": 1, "climate": "pure-air",
         "solver": {"name": "zones", "quality": "draft", "expert": {"degree": 6, "late_degree": 5}}},
        {"version": 1, "climate": "pure-air", "solver": {"name": "preetham", "turbidity": 3.0}},
    ]  # fmt: skip
    return documents


def _typed(value: Any) -> Any:
    """YAML 1.2 scalars of a document that was read as text."""
    if isinstance(value, dict):
        return {key: _typed(item) for key, item in value.items()}
    if isinstance(value, list):
        return [_typed(item) for item in value]
    for kind in (int, float):
        with suppress(ValueError):
            return kind(value)
    return {"true": True, "false": False, "null": None}.get(value, value)


def mutated_document(rng: random.Random, documents: list[dict[str, Any]]) -> str:
    """The text of a valid document with one to four faults in its data, or in its text, or in both."""
    data: Any = deepcopy(rng.choice(documents))
    kind = rng.random()
    for _ in range(rng.choice((1, 1, 1, 2, 4))):
        if kind < 0.85:
            data = _mutate(rng, data, documents)
    text = yaml.safe_dump(_printable(data), allow_unicode=rng.random() < 0.5, default_flow_style=None, sort_keys=False)
    if kind > 0.7:
        for _ in range(rng.choice((1, 1, 2, 8))):
            text = _mutate_text(rng, text)
    return text


def _printable(value: Any) -> Any:
    """Without what YAML cannot write."""
    if isinstance(value, dict):
        return {str(key): _printable(item) for key, item in value.items()}
    return [_printable(item) for item in value] if isinstance(value, list) else value


def _places(value: Any, path: tuple = ()) -> Iterator[tuple]:
    yield path
    items = value.items() if isinstance(value, dict) else enumerate(value[:20]) if isinstance(value, list) else ()
    for key, item in items:
        yield from _places(item, (*path, key))


def _mutate(rng: random.Random, data: Any, documents: list[dict[str, Any]]) -> Any:
    path = rng.choice(list(_places(data)))
    if not path:
        if rng.random() < 0.9:
            return data if not isinstance(data, dict) else data | {_key(rng, documents): _value(rng, documents)}
        return deepcopy(rng.choice(NASTY))
    parent = data
    for part in path[:-1]:
        parent = parent[part]
    last = path[-1]
    how = rng.randrange(7)
    if how <= 2:
        parent[last] = _value(rng, documents)
    elif how == 3:
        del parent[last]
    elif how == 4 and isinstance(parent, dict):
        parent[_key(rng, documents)] = parent.pop(last)
    elif how == 5 and isinstance(parent[last], int | float) and not isinstance(parent[last], bool):
        parent[last] = _near(rng, parent[last])
    elif how == 6:
        parent[last] = [deepcopy(parent[last])] if rng.random() < 0.5 else {_key(rng, documents): parent[last]}
    return data


def _near(rng: random.Random, number: float) -> float:
    try:
        return rng.choice((-number, number * 10, number / 10, number + 1, number - 1, number * 1e6, float(number), -1))
    except OverflowError:
        return -1


def _value(rng: random.Random, documents: list[dict[str, Any]]) -> Any:
    if rng.random() < 0.7:
        return deepcopy(rng.choice(NASTY))
    if rng.random() < 0.1:
        deep: Any = 1
        for _ in range(rng.choice((5, 20, 80))):
            deep = [deep] if rng.random() < 0.5 else {"a": deep}
        return deep
    other: Any = rng.choice(documents)
    for part in rng.choice(list(_places(other))):
        other = other[part]
    return deepcopy(other)


def _key(rng: random.Random, documents: list[dict[str, Any]]) -> str:
    names = [part for path in _places(rng.choice(documents)) for part in path if isinstance(part, str)]
    return rng.choice(
        [*names, "", "x", "a.b", "é漢字", "0", "vary", "solver", "sun", "\0", "x" * 500, "..", "<elevation>"]
    )


def _mutate_text(rng: random.Random, text: str) -> str:
    how = rng.randrange(6)
    at = rng.randrange(len(text) + 1)
    lines = text.split("\n")
    if how == 0:
        return text[:at] + rng.choice(ODD_YAML) + text[at:]
    if how == 1:
        return text[:at] + chr(rng.choice((rng.randrange(128), rng.randrange(0xD800)))) + text[at + 1 :]
    if how == 2:
        return text[:at]
    if how == 3:
        line = rng.randrange(len(lines))
        lines[line] = lines[line].partition(":")[0] + ": " + rng.choice(ODD_YAML)
    elif how == 4:
        lines.insert(rng.randrange(len(lines) + 1), rng.choice(lines))
    else:
        line = rng.randrange(len(lines))
        lines[line] = " " * rng.randrange(6) + lines[line].lstrip()
    return "\n".join(lines)


# --- files ---


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
