"""Solved fields kept on disk, so that a scene that was solved before is looked at without solving it again; and skies.

One file per block of wavelengths, named by a SHA-256 of all that enters: the medium, the solver, its settings and its
code, the suns and the observer's altitude.  The solver's own file format guards the content.  Files that were used
longest ago go first when all together exceed the limit.  A folder that cannot be written is no error: fields are then
solved anew.
"""

from __future__ import annotations

import contextlib
import hashlib
import json
import math
import os
import shutil
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from twilight.atmosphere.optics_cache import default_cache_dir
from twilight.digest import code_digest
from twilight.errors import TwilightError

if TYPE_CHECKING:
    from twilight.atmosphere.medium import Medium

LIMIT_VARIABLE = "TWILIGHT_CACHE_GB"
DEFAULT_LIMIT_GB = 2.0
_SUFFIX = ".field.h5"
SKIES_SUFFIX = ".skies.npz"
"""Of skies that a study keeps beside the fields (`KeptFields.skies_path`), under the same limit."""
MODEL_SUFFIX = ".model.npz"
"""Of compact models (`KeptFields.model_path`)."""
SUFFIXES = (_SUFFIX, SKIES_SUFFIX, MODEL_SUFFIX)


@dataclass(frozen=True)
class KeptFields:
    """A folder of solved fields and the most that they may take together [bytes]."""

    folder: Path
    limit_bytes: float

    def path(
        self, solver: str, settings: Any, medium: Medium, suns_deg: Sequence[float] | None, altitude_km: float
    ) -> Path:
        """Where the field of a problem is, if it is there.

        solver: name of its module; suns_deg: all that will be asked for, None: any; altitude_km: the observer's.
        """
        digest = hashlib.sha256(code_digest(solver).encode())
        about = [solver, asdict(settings), None if suns_deg is None else sorted(suns_deg), altitude_km]
        digest.update(json.dumps(about, sort_keys=True, default=str).encode())
        _add(digest, medium)
        _add(digest, medium.reference)
        return self.folder / f"{digest.hexdigest()}{_SUFFIX}"

    def keep(self, path: Path, field: Any) -> None:
        """Write a field and make room for it."""
        self.write(path, field.save)

    def skies_path(self, key: str) -> Path:
        """Where the skies of a study are, if they are there; key: a hash of all that enters."""
        return self.folder / f"{key}{SKIES_SUFFIX}"

    def model_path(self, key: str) -> Path:
        """Where a compact model is, if it is there; key: a hash of all that enters."""
        return self.folder / f"{key}{MODEL_SUFFIX}"

    def write(self, path: Path, save: Callable[[Path], Any]) -> None:
        """Have a file written by `save` and make room for it."""
        with contextlib.suppress(OSError, TwilightError):  # what it holds is there, only not for the next time
            path.parent.mkdir(parents=True, exist_ok=True)
            save(path)
            self._make_room(path)

    def _make_room(self, newest: Path) -> None:
        files = sorted(self.files(), key=lambda file: file.used_s, reverse=True)
        total = 0
        for file in files:
            total += file.size_bytes
            if total > self.limit_bytes and file.path != newest:
                file.path.unlink(missing_ok=True)

    def files(self) -> list[KeptFile]:
        """What is there."""
        found = []
        for path in (p for suffix in SUFFIXES for p in self.folder.glob(f"*{suffix}")):
            with contextlib.suppress(OSError):  # removed by another process meanwhile
                about = path.stat()
                found.append(KeptFile(path, about.st_size, about.st_mtime))
        return found

    def clear(self) -> None:
        """Remove all fields."""
        shutil.rmtree(self.folder, ignore_errors=True)


@dataclass(frozen=True)
class KeptFile:
    """One of them; used_s: when it was last written or read [s since 1970]."""

    path: Path
    size_bytes: int
    used_s: float

    @property
    def is_field(self) -> bool:
        """Whether it is a solved field."""
        return self.path.name.endswith(_SUFFIX)

    @property
    def is_model(self) -> bool:
        """Whether it is a compact model; else, if no field, the skies of a study."""
        return self.path.name.endswith(MODEL_SUFFIX)


def _add(digest: Any, value: Any) -> None:
    """Everything in a medium but the notes."""
    if isinstance(value, np.ndarray):
        digest.update(f"{value.dtype.str}{value.shape}".encode() + np.ascontiguousarray(value).tobytes())
    elif isinstance(value, tuple):
        for one in value:
            _add(digest, one)
    elif hasattr(value, "__dataclass_fields__"):
        for f in fields(value):
            if f.name != "notes":
                digest.update(f.name.encode())
                _add(digest, getattr(value, f.name))
    else:
        digest.update(repr(value).encode())


def fields_folder() -> Path:
    """Where fields are kept: `fields` in the cache folder (`TWILIGHT_CACHE_DIR`)."""
    return default_cache_dir() / "fields"


def kept_fields() -> KeptFields | None:
    """The user's own; None where `TWILIGHT_CACHE_GB` is 0.

    Errors: TwilightError for a limit that is not a number of at least 0.
    """
    text = os.environ.get(LIMIT_VARIABLE) or f"{DEFAULT_LIMIT_GB:g}"
    try:
        limit_gb = float(text)
    except ValueError:
        limit_gb = math.nan
    if not 0.0 <= limit_gb < math.inf:
        raise TwilightError(f"{LIMIT_VARIABLE}: is {text!r}; allowed is a number of gigabytes, 0 to keep no fields")
    return KeptFields(fields_folder(), 1e9 * limit_gb) if limit_gb > 0.0 else None
