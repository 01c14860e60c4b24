"""A cache on disk for arrays that take long to compute, keyed by a hash of everything that enters.

One file per entry: 32 bytes SHA-256 of the rest, then float64 little endian.  A file is written whole or not at all;
one that is damaged does not match its hash and counts as absent.
"""

from __future__ import annotations

import hashlib
import os
import sys
import tempfile
from pathlib import Path

import numpy as np

ENVIRONMENT_VARIABLE = "TWILIGHT_CACHE_DIR"

_DIGEST_BYTES = 32


def default_cache_dir() -> Path:
    """`TWILIGHT_CACHE_DIR`, else the platform's cache folder for `twilight` (XDG_CACHE_HOME or ~/.cache on Linux)."""
    override = os.environ.get(ENVIRONMENT_VARIABLE)
    if override:
        return Path(override).expanduser()
    if sys.platform == "win32":
        base = Path(os.environ.get("LOCALAPPDATA") or Path.home() / "AppData" / "Local")
    elif sys.platform == "darwin":
        base = Path.home() / "Library" / "Caches"
    else:
        base = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
    return base / "twilight"


class ArrayCache:
    """Entries of one fixed length of float64, in a sub-folder `mie` of the cache folder.

    A folder that cannot be written to is no error: the values are computed again the next time.
    """

    def __init__(self, directory: str | os.PathLike | None, length: int):
        self.directory = (Path(directory) if directory is not None else default_cache_dir()) / "mie"
        self.length = length

    def path(self, key: str) -> Path:
        return self.directory / key[:2] / f"{key}.f8"

    def load(self, key: str) -> np.ndarray | None:
        """The entry, or None where there is no whole and undamaged one."""
        try:
            raw = self.path(key).read_bytes()
        except OSError:
            return None
        payload = raw[_DIGEST_BYTES:]
        if len(payload) != 8 * self.length or hashlib.sha256(payload).digest() != raw[:_DIGEST_BYTES]:
            return None
        return np.frombuffer(payload, dtype="<f8").astype(float)

    def store(self, key: str, values: np.ndarray) -> None:
        payload = np.ascontiguousarray(values, dtype="<f8").tobytes()
        target = self.path(key)
        temporary = None
        try:
            target.parent.mkdir(parents=True, exist_ok=True)
            handle, temporary = tempfile.mkstemp(dir=target.parent, prefix=".", suffix=".part")
            with os.fdopen(handle, "wb") as file:
                file.write(hashlib.sha256(payload).digest() + payload)
            os.replace(temporary, target)
        except OSError:
            if temporary is not None:
                Path(temporary).unlink(missing_ok=True)
