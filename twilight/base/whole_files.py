"""Files that are written whole or not at all."""

import csv
import errno
import json
import os
import secrets
import shutil
import sys
import tempfile
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager, suppress
from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING, Any

from twilight.base.errors import TwilightError

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_unfinished: set[Path] = set()
"""Temporary files and folders that are being written."""


def remove_unfinished() -> None:
    """Remove what is half written: for a process that ends without unwinding its stack."""
    for path in list(_unfinished):
        with suppress(OSError):
            path.unlink() if not path.is_dir() else shutil.rmtree(path)


@contextmanager
def unfinished(path: Path) -> Iterator[Path]:
    """Count a temporary file or folder, which need not be there yet, as half written until the block ends; remove it
    then, if it still has this name."""
    _unfinished.add(path)
    try:
        yield path
    finally:
        with suppress(OSError):
            path.unlink() if not path.is_dir() else shutil.rmtree(path)
        _unfinished.discard(path)


def check_folder(folder: str | os.PathLike) -> None:
    """Raise TwilightError unless files can be written into ``folder``, or a folder be made there; leaves no trace."""
    folder = Path(folder)
    _check_name(folder)
    existing = next((f for f in (folder, *folder.absolute().parents) if f.exists()), Path())
    try:
        with tempfile.TemporaryDirectory(dir=existing, prefix=".twilight-"):
            pass
    except OSError as error:
        reason = f"{existing} is not a folder" if not existing.is_dir() else error.strerror or str(error)
        raise TwilightError(f"{folder}: files cannot be written there: {reason}") from None


def check_file(path: str | os.PathLike) -> None:
    """Raise TwilightError unless a file can be written at ``path``, in a folder that may have to be made."""
    path = Path(path)
    check_folder(path.parent)
    if path.is_dir():
        raise TwilightError(f"{path}: is a folder, not a file")


def _check_name(path: Path) -> None:
    """Raise TwilightError for a name that is no text, or that the locale has no letters for."""
    try:
        str(path).encode("utf-8")
        os.fsencode(path)
    except UnicodeEncodeError:
        raise TwilightError(
            f"{path}: this name cannot be written in the locale's encoding ({sys.getfilesystemencoding()}); take "
            "another one, or a locale such as LC_ALL=C.UTF-8"
        ) from None


@contextmanager
def whole_content(path: str | os.PathLike) -> Iterator[BytesIO]:
    """Give a stream in memory, for HDF5, and write it as `whole_file` does when the block ends well.

    HDF5 itself does not survive a disk that is full: it ends in tracebacks, and may end the process.
    """
    with whole_file(path) as temporary:
        content = BytesIO()
        yield content
        temporary.write_bytes(content.getbuffer())


@contextmanager
def whole_file(path: str | os.PathLike) -> Iterator[Path]:
    """Give a temporary path beside ``path`` (same suffix) to write to, and rename it when the block ends well.

    If the block raises, the temporary file is removed and what was at ``path`` before stays.  Raises TwilightError
    where the folder does not exist or the system refuses to write.
    """
    path = Path(path)
    _check_name(path)
    if not path.parent.is_dir():
        raise TwilightError(f"{path}: the folder does not exist")
    if path.is_dir():
        raise TwilightError(f"{path}: is a folder, not a file")
    temporary = path.with_name(f".{path.name}.{secrets.token_hex(4)}.part{path.suffix}")
    with writing(path), unfinished(temporary):
        yield temporary
        os.replace(temporary, path)


@contextmanager
def writing(path: str | os.PathLike) -> Iterator[None]:
    """TwilightError with the path and the system's words where it refuses to write within the block."""
    try:
        yield
    except Exception as error:
        if (reason := refusal(error)) is None:
            raise
        raise TwilightError(f"{path}: cannot be written ({reason})") from error


def link_or_copy(source: Path, target: Path) -> None:
    """Have a file under a second name: a link to the same data where the file system has them, else a copy, whole or
    not at all.  Errors: TwilightError where the system refuses."""
    with suppress(OSError, NotImplementedError, AttributeError):
        os.link(source, target)
        return
    with whole_file(target) as temporary:
        shutil.copyfile(source, temporary)


@contextmanager
def whole_folder(path: str | os.PathLike) -> Iterator[Path]:
    """Give a new folder beside ``path`` to fill, and rename it when the block ends well; else nothing is left of it.

    ``path`` itself may be an empty folder; folders above it are made.  Raises TwilightError where the system refuses.
    """
    path = Path(path)
    _check_name(path)
    with writing(path):
        path.parent.mkdir(parents=True, exist_ok=True)
        with unfinished(path.with_name(f".{path.name}.{secrets.token_hex(4)}.part")) as temporary:
            temporary.mkdir()
            yield temporary
            os.replace(temporary, path)


_REFUSALS = tuple(
    os.strerror(getattr(errno, name))
    for name in ("ENOSPC", "EDQUOT", "EFBIG", "EIO", "EROFS", "EACCES", "EPERM", "ENXIO", "ENODEV", "ESTALE")
    if hasattr(errno, name)
)
"""What the system says where it does not let a file be written."""


def refusal(error: BaseException) -> str | None:
    """In the system's words why it refused to write, where that is what an error says; else None.

    Libraries in C and C++ (OpenEXR, HDF5) wrap its words in errors of their own, which are no OSError.
    """
    if isinstance(error, OSError) and error.strerror in _REFUSALS:
        return error.strerror
    said = str(error)
    if (found := next((words for words in _REFUSALS if words in said), None)) is not None:
        return found
    return (error.strerror or said.partition("\n")[0]) if isinstance(error, OSError) else None


def write_csv(path: str | os.PathLike, columns: Sequence[str], rows: Iterable[Sequence[Any]], *notes: str) -> Path:
    """Write a table in UTF-8, whole or not at all; notes: first lines, which begin with #.  Returns the path."""
    with whole_file(path) as temporary, open(temporary, "w", newline="", encoding="utf-8") as file:
        file.writelines(f"# {note}\n" for note in notes)
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(columns)
        writer.writerows(rows)
    return Path(path)


def write_json(path: str | os.PathLike, content: Any) -> Path:
    """Write JSON values in UTF-8, whole or not at all.  Returns the path."""
    with whole_file(path) as temporary:
        temporary.write_text(json.dumps(content, indent=1) + "\n", encoding="utf-8")
    return Path(path)


def save_figure(path: str | os.PathLike, figure: "Figure", dpi: float) -> Path:
    """Write a figure of matplotlib's, whole or not at all.  Returns the path."""
    with whole_file(path) as temporary:
        figure.savefig(temporary, dpi=dpi)
    return Path(path)
