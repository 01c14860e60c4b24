"""Journals: files of JSON lines, one for each finished part of a long job, so that the job can be continued."""

import errno
import json
import os
import warnings
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import IO, Any

from twilight.base.errors import TwilightError, TwilightWarning


class Journal:
    """An open journal, written by this process alone."""

    def __init__(self, file: IO[str]):
        self._file = file

    def write(self, entry: dict[str, Any]) -> None:
        """Add a line, which is on the disk when this returns.  Errors: OSError."""
        self._file.write(json.dumps(entry) + "\n")
        self._file.flush()
        os.fsync(self._file.fileno())


@contextmanager
def open_journal(path: Path, what: str) -> Iterator[Journal]:
    """A journal to add lines to, made where there is none; a line that was cut in writing is ended first.

    what: who may be writing it already, e.g. `another sweep`.  Errors: TwilightError where that is so; OSError.
    """
    with locked(path, what) as file:
        content = path.read_bytes()
        if content and not content.endswith(b"\n"):
            file.write("\n")
            file.flush()
        yield Journal(file)


def read_journal(path: Path) -> Iterator[dict[str, Any]]:
    """The lines that are whole, in their order; none where there is no such file."""
    if not path.is_file():
        return
    for line in path.read_text(encoding="utf-8", errors="replace").splitlines():
        with suppress(ValueError):  # a line that was cut in writing
            entry = json.loads(line)
            if isinstance(entry, dict):
                yield entry


@contextmanager
def locked(path: Path, what: str) -> Iterator[IO[str]]:
    """A file to add text to, by this process alone; where the system (Windows) or the file system has no locks this is
    left to the user.

    what: who may hold it, e.g. `another film`.  Errors: TwilightError where that is so; OSError.
    """
    with open(path, "a", encoding="utf-8") as file:
        try:
            import fcntl  # optional: not on Windows

            fcntl.flock(file.fileno(), fcntl.LOCK_EX | fcntl.LOCK_NB)
        except ImportError:
            pass
        except OSError as error:
            if error.errno in (errno.EWOULDBLOCK, errno.EACCES):
                raise TwilightError(f"{path.parent}: {what} is writing it") from None
            warnings.warn(
                f"{path.parent}: the file system has no locks ({error.strerror}); see to it that {what} does not write "
                "there",
                TwilightWarning,
                stacklevel=2,
            )
        if not path.exists() or not os.path.samestat(os.fstat(file.fileno()), path.stat()):
            raise TwilightError(f"{path.parent}: {what} has just ended there; try again")
        yield file
