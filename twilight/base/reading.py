"""Files from elsewhere: how much they hold, found out before memory is allotted for it, and what is said of damage."""

import math
import os
import zipfile
from collections.abc import Iterator
from contextlib import contextmanager
from os.path import isfile
from pathlib import Path
from typing import Any
from zipfile import BadZipFile
from zlib import error as ZlibError

import numpy as np

from twilight.base.errors import TwilightError

LARGEST_EXPANSION = 1100
"""Deflate, which compresses all files of this program, makes at most 1032 bytes of one."""
SMALL_BYTES = 1_000_000
"""What a file may say to hold whatever its size [bytes]."""

MEMORY_FRACTION = 0.5
"""Largest fraction of this machine's memory that one file may fill."""


def memory_bytes() -> float:
    """Memory of this machine; infinite where the system does not say."""
    try:
        return float(os.sysconf("SC_PHYS_PAGES")) * os.sysconf("SC_PAGE_SIZE")
    except (AttributeError, ValueError, OSError):
        return float("inf")


@contextmanager
def reading(path: str | os.PathLike, what: str) -> Iterator[None]:
    """One sentence of all that a library raises while it reads a file, which differs by where the file is damaged.

    what: the file as it should be, e.g. `a complete OpenEXR file`.
    Errors: TwilightError where the path is no file, where the system does not let it be read, and for any other
    exception within the block.
    """
    if not isfile(path):
        raise TwilightError(f"{path}: {'is a folder, not a file' if os.path.isdir(path) else 'no such file'}")
    try:
        yield
    except TwilightError:
        raise
    except PermissionError as error:
        raise TwilightError(f"{path}: cannot be read (Permission denied)") from error
    except Exception as error:
        raise TwilightError(f"{path}: is not {what} ({first_line(error)})") from error


def check_expansion(path: Path, n_bytes: float, largest_expansion: float = LARGEST_EXPANSION) -> None:
    """Raise TwilightError where a file says that it holds more than it can, or than this machine's memory should.

    largest_expansion: bytes that one byte of the file can stand for, 1 where nothing is compressed.
    """
    size = path.stat().st_size
    if n_bytes > largest_expansion * size + SMALL_BYTES:
        raise TwilightError(
            f"{path}: is damaged: it says that it holds {n_bytes / 1e9:.3g} GB, but its {size / 1e3:.3g} kB cannot"
        )
    if n_bytes > MEMORY_FRACTION * memory_bytes():
        raise TwilightError(
            f"{path}: holds {n_bytes / 1e9:.3g} GB, more than half of this machine's {memory_bytes() / 1e9:.3g} GB"
        )


def read_text(path: Path, most_bytes: int) -> str:
    """A text file in UTF-8 of at most `most_bytes`, and no pipe or device, which could go on for ever.

    Errors: TwilightError.
    """
    with reading(path, "a text file in UTF-8"):
        if path.stat().st_size > most_bytes:
            raise TwilightError(f"{path}: is larger than {most_bytes / 1e3:g} kB, which no such file is")
        return path.read_text(encoding="utf-8")


@contextmanager
def open_npz(path: Path, largest_expansion: float = LARGEST_EXPANSION) -> Iterator[Any]:
    """A file of numpy's arrays, whose members are as large as the archive says and as it can hold.

    Errors: TwilightError for sizes that cannot be; what else is wrong with the file is numpy's to say.
    """
    with zipfile.ZipFile(path) as archive:
        members = archive.infolist()
        check_expansion(path, float(sum(member.file_size for member in members)), largest_expansion)
        for member in members:
            if member.filename.endswith(".npy"):
                with archive.open(member) as stream:
                    needed = _npy_bytes(stream)
                if needed > member.file_size:
                    raise TwilightError(
                        f"{path}: is damaged: {member.filename} says that it holds {needed / 1e9:.3g} GB, and has "
                        f"{member.file_size / 1e3:.3g} kB"
                    )
    with np.load(path, allow_pickle=False) as data:
        yield data


def check_npy(path: Path) -> None:
    """Raise TwilightError where a .npy file says that it holds more than it does; ValueError where it is none."""
    with path.open("rb") as stream:
        check_expansion(path, float(_npy_bytes(stream)), largest_expansion=1)


def stored_arrays(path: Path) -> dict[str, np.ndarray] | None:
    """Arrays that this program stored in a .npz file, not compressed; None where there is none, or a damaged one."""
    try:
        with open_npz(path, largest_expansion=1) as there:
            return dict(there)
    except (TwilightError, OSError, EOFError, KeyError, TypeError, ValueError, RuntimeError, BadZipFile, ZlibError):
        return None


def _npy_bytes(stream: Any) -> int:
    """Bytes of the array that a .npy header describes."""
    version = np.lib.format.read_magic(stream)
    read = np.lib.format.read_array_header_1_0 if version == (1, 0) else np.lib.format.read_array_header_2_0
    shape, _, dtype = read(stream)
    return math.prod(map(int, shape)) * dtype.itemsize


def check_hdf5(path: Path, file: Any) -> None:
    """Raise TwilightError where the datasets of an open HDF5 file together are larger than it can hold."""
    claimed: list[int] = []

    def add(name: str, item: Any) -> None:
        if (shape := getattr(item, "shape", None)) is not None:
            claimed.append(math.prod(map(int, shape)) * item.dtype.itemsize)

    file.visititems(add)
    check_expansion(path, float(sum(claimed)))


def first_line(error: BaseException) -> str:
    """The first line of an error's text, its type where it has none; what cannot be printed is escaped."""
    lines = str(error).splitlines()
    text = lines[0] if lines and lines[0].strip() else type(error).__name__
    return text[:300].encode("ascii", "backslashreplace").decode()
