"""State of an interrupted run in a file: written whole or not at all, and only taken up for the same question."""

import hashlib
import struct
import time
import zlib
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any
from zipfile import BadZipFile

import numpy as np

from twilight.base.errors import TwilightError
from twilight.base.reading import open_npz
from twilight.base.whole_files import whole_file

SAVE_EVERY_S = 10.0
"""Least time [s] between two savings."""
FREE_SETTINGS = ("time_limit_s",)
"""Settings that say when a run stops, not what is computed: they may differ when the run is taken up again."""


@dataclass(frozen=True)
class RunState:
    """Where a run stands: the sums of `chunks.Tally`, the chunks used, and the batch that comes next.

    round_plan (P, W, 2): samples planned for the present round; round_index, batch_index: number of the round, and of
    its next batch.
    """

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
        if f.name in ("name", "notes", "grid_medium"):
            continue
        if f.name == "screen":
            digest.update(repr(value).encode())
        elif f.name == "phase_functions":
            for p in value:
                digest.update(repr(p.kind).encode())
                digest.update(np.ascontiguousarray(p.asymmetry).tobytes())
                digest.update(np.ascontiguousarray(p.log_table).tobytes())
                digest.update(np.ascontiguousarray(p.ratios).tobytes())
        else:
            digest.update(np.ascontiguousarray(value, dtype=float).tobytes())
    digest.update(repr([(k, v) for k, v in vars(settings).items() if k not in FREE_SETTINGS]).encode())
    # a limit, whichever, makes the first round short
    digest.update(repr(settings.time_limit_s is None).encode())
    digest.update(pixels.key.tobytes())
    return digest.hexdigest()


class Checkpoint:
    """One file that holds a :class:`RunState` and the fingerprint of its question."""

    def __init__(self, path: Path, key: str):
        self.path = path
        self.key = key
        self.saved = time.monotonic()

    def load(self) -> RunState | None:
        """The saved state, None if there is none; TwilightError if the file belongs to another question."""
        if not self.path.exists():
            return None
        try:
            with open_npz(self.path, largest_expansion=1) as data:  # savez compresses nothing
                key = str(data["fingerprint"])
                values: dict[str, Any] = {f.name: data[f.name] for f in fields(RunState)}
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
        return RunState(**values)

    def save_if_due(self, state: RunState) -> None:
        """Save if the last time was a while ago."""
        if time.monotonic() - self.saved > SAVE_EVERY_S:
            self.save(state)

    def save(self, state: RunState) -> None:
        """Replace the file in one step."""
        with whole_file(self.path) as part, open(part, "wb") as stream:
            np.savez(stream, fingerprint=np.array(self.key), **vars(state))
        self.saved = time.monotonic()

    def remove(self) -> None:
        """The run is complete."""
        self.path.unlink(missing_ok=True)
