"""The user's cache: what takes long to make and can be made again, in whole files named by a hash of all that enters.

    FOLDER/fields/KEY.h5       solved fields                        together at most TWILIGHT_CACHE_GB; the files that
    FOLDER/skies/KEY.npz       skies that were computed             were used longest ago go first
    FOLDER/optics/KEY.npz      optics of particles by Mie theory    small, not limited
    FOLDER/kernels/            machine code, where TWILIGHT_CACHE_DIR is set and the package cannot be written

FOLDER is TWILIGHT_CACHE_DIR, else the platform's cache folder for `twilight`.  A folder that is full or cannot be
written is no error: what was computed is used, a warning of one sentence says that it is not there for the next time.
Whoever stores a file sees to it that a damaged one is recognised; `read_arrays` does for arrays.
"""

import contextlib
import math
import os
import shutil
import warnings
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from twilight.base.errors import TwilightError, TwilightWarning
from twilight.base.reading import stored_arrays
from twilight.base.whole_files import whole_file

FOLDER_VARIABLE = "TWILIGHT_CACHE_DIR"
LIMIT_VARIABLE = "TWILIGHT_CACHE_GB"
DEFAULT_LIMIT_GB = 2.0
"""Some hundred fields of a climate at eight wavelengths."""


class FileKind(NamedTuple):
    """Files of one kind: their folder and suffix, what the user is told they are, whether the limit counts them."""

    folder: str
    suffix: str
    label: str
    limited: bool


FIELDS = FileKind("fields", ".h5", "solved fields", True)
SKIES = FileKind("skies", ".npz", "skies", True)
OPTICS = FileKind("optics", ".npz", "optics of particles", False)
KINDS = (FIELDS, SKIES, OPTICS)


class CachedFile(NamedTuple):
    """A file of the cache; used_s: when it was last written or read [s since 1970]."""

    kind: FileKind
    path: Path
    size_bytes: int
    used_s: float


def cache_folder() -> Path:
    """Where the cache is."""
    import platformdirs  # start-up

    chosen = os.environ.get(FOLDER_VARIABLE)
    return Path(chosen).expanduser() if chosen else platformdirs.user_cache_path("twilight", appauthor=False)


def limit_bytes() -> float:
    """The most that fields and skies may take together [bytes]; 0: none is cached.

    Errors: TwilightError for a limit that is not a number of at least 0.
    """
    text = os.environ.get(LIMIT_VARIABLE) or f"{DEFAULT_LIMIT_GB:g}"
    try:
        limit_gb = float(text)
    except ValueError:
        limit_gb = math.nan
    if not 0.0 <= limit_gb < math.inf:
        raise TwilightError(f"{LIMIT_VARIABLE}: is {text!r}; allowed is a number of gigabytes, 0 to cache no fields")
    return 1e9 * limit_gb


def path_of(kind: FileKind, key: str) -> Path:
    """Where the file of a key is, if it is there."""
    return cache_folder() / kind.folder / f"{key}{kind.suffix}"


def find(kind: FileKind, key: str) -> Path | None:
    """The file of a key, which counts as used now; None where there is none, or none is to be cached."""
    path = path_of(kind, key)
    if (kind.limited and limit_bytes() == 0.0) or not path.is_file():
        return None
    with contextlib.suppress(OSError):  # a cache that is read only
        os.utime(path)
    return path


def store(kind: FileKind, key: str, write: Callable[[Path], Any]) -> Path | None:
    """Have `write` write the file of a key, whole or not at all, and make room for it.

    Returns its path; None where it is not there now: nothing is to be cached, or a warning has said why not.
    """
    if kind.limited and limit_bytes() == 0.0:
        return None
    path = path_of(kind, key)
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with whole_file(path) as temporary:
            write(temporary)
    except (OSError, TwilightError) as error:
        _warn_once(str(cache_folder()), error)
        return None
    if kind.limited:
        _make_room(path)
    return path


def discard(path: Path) -> None:
    """Remove a file that turned out to be damaged."""
    with contextlib.suppress(OSError):
        path.unlink()


def read_arrays(kind: FileKind, key: str) -> dict[str, np.ndarray] | None:
    """The arrays that `store_arrays` left under a key; None where there are none, and damaged ones are removed."""
    path = find(kind, key)
    arrays = None if path is None else stored_arrays(path)
    if path is not None and arrays is None:
        discard(path)
    return arrays


def store_arrays(kind: FileKind, key: str, arrays: Mapping[str, np.ndarray]) -> None:
    """Leave arrays under a key, each with a checksum."""
    store(kind, key, lambda path: np.savez(path, **arrays))  # type: ignore[arg-type]


def of_skies(
    key: str, compute: Callable[[], dict[str, np.ndarray]], read: Callable[[dict[str, np.ndarray]], Any]
) -> Any:
    """What `read` makes of the skies under a key, or of new ones, which are then there in place of damaged ones; a key
    is empty where nothing is to be cached."""
    with contextlib.suppress(ValueError, KeyError, TypeError):
        if key and (arrays := read_arrays(SKIES, key)) is not None:
            return read(arrays)
    arrays = compute()
    if key:
        store_arrays(SKIES, key, arrays)
    return read(arrays)


def cached_files() -> Iterator[CachedFile]:
    """All files of the cache."""
    for kind in KINDS:
        for path in sorted((cache_folder() / kind.folder).glob(f"[!.]*{kind.suffix}")):
            with contextlib.suppress(OSError):  # removed by another process meanwhile
                about = path.stat()
                yield CachedFile(kind, path, about.st_size, about.st_mtime)


def clear() -> None:
    """Remove all files of the cache."""
    for folder in (*(kind.folder for kind in KINDS), "kernels"):
        shutil.rmtree(cache_folder() / folder, ignore_errors=True)


def _make_room(newest: Path) -> None:
    """Remove the files that were used longest ago until the limit is kept; the newest stays."""
    files = sorted((f for f in cached_files() if f.kind.limited), key=lambda file: file.used_s, reverse=True)
    total, limit = 0, limit_bytes()
    for file in files:
        total += file.size_bytes
        if total > limit and file.path != newest:
            discard(file.path)


_warned: set[str] = set()
"""Cache folders of which this process has said that they cannot be written."""


def _warn_once(folder: str, error: BaseException) -> None:
    if folder in _warned:
        return
    _warned.add(folder)
    while error.__cause__ is not None:
        error = error.__cause__
    reason = getattr(error, "strerror", None) or str(error)
    warnings.warn(
        f"the cache folder {folder} cannot be written ({reason}): what is computed now is computed again the next "
        f"time; {FOLDER_VARIABLE} names another folder",
        TwilightWarning,
        stacklevel=4,
    )
