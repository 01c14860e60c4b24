"""State of an interrupted run on disk: written whole or not at all, and only taken up for the same question."""

from __future__ import annotations

import hashlib
import os
import struct
import tempfile
import time
import zlib
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any
from zipfile import BadZipFile

import numpy as np

from twilight.errors import TwilightError
from twilight.reading import open_npz

SAVE_EVERY_S = 10.0
# settings that say when to stop, not what is computed: they may differ when a run is taken up again
FREE_SETTINGS = ("time_limit_s",)


@dataclass(frozen=True)
class State:
    """Sums so far, the samples planned for the present round, and the next batch of it."""

    count: np.ndarray
    sums: np.ndarray
    squares: np.ndarray
    high: np.ndarray
    limited: int
    chunks_used: np.ndarray
    round_plan: np.ndarray
    round_index: int
    batch_index: int


def fingerprint(medium, settings, pixels) -> str:
    """SHA-256 of everything that enters the answer."""
    digest = hashlib.sha256()
    for f in fields(medium):
        value = getattr(medium, f.name)
        if f.name in ("name", "notes"):
            continue
        if f.name == "phase_functions":
            for p in value:
                digest.update(repr(p.kind).encode())
                digest.update(np.ascontiguousarray(p.asymmetry).tobytes())
                digest.update(np.ascontiguousarray(p.log_table).tobytes())
                digest.update(np.ascontiguousarray(p.ratios).tobytes())
        else:
            digest.update(np.ascontiguousarray(value, dtype=float).tobytes())
    digest.update(repr([(k, v) for k, v in settings.as_dict().items() if k not in FREE_SETTINGS]).encode())
    # a limit, whichever, makes the first round short
    digest.update(repr(settings.time_limit_s is None).encode())
    digest.update(pixels.key.tobytes())
    return digest.hexdigest()


class Checkpoint:
    """One file that holds a :class:`State` and the fingerprint of its question."""

    def __init__(self, path: Path, key: str):
        self.path = path
        self.key = key
        self.saved = time.monotonic()

    def load(self) -> State | None:
        """The saved state, None if there is none; TwilightError if the file belongs to another question."""
        if not self.path.exists():
            return None
        try:
            with open_npz(self.path, largest_expansion=1) as data:  # savez compresses nothing
                key = str(data["fingerprint"])
                values: dict[str, Any] = {f.name: data[f.name] for f in fields(State)}
                for name in ("limited", "round_index", "batch_index"):
                    values[name] = int(values[name])
        except TwilightError:
            raise
        except (OSError, EOFError, RuntimeError, ValueError, KeyError, BadZipFile, zlib.error, struct.error) as error:
            raise TwilightError(f"{self.path}: not a Monte-Carlo checkpoint; delete it or name another file") from error
        if key != self.key:
            raise TwilightError(
                f"{self.path}: checkpoint of another medium, setting or view; delete it or name another file"
            )
        return State(**values)

    def save_if_due(self, state: dict) -> None:
        """Save if the last time was a while ago."""
        if time.monotonic() - self.saved > SAVE_EVERY_S:
            self.save(state)

    def save(self, state: dict) -> None:
        """Replace the file in one step."""
        handle, temporary = tempfile.mkstemp(dir=self.path.parent, prefix=self.path.name, suffix=".part")
        try:
            with os.fdopen(handle, "wb") as stream:
                np.savez(stream, fingerprint=np.array(self.key), **state)
            os.replace(temporary, self.path)
        except BaseException:
            Path(temporary).unlink(missing_ok=True)
            raise
        self.saved = time.monotonic()

    def remove(self) -> None:
        """The run is complete."""
        self.path.unlink(missing_ok=True)
