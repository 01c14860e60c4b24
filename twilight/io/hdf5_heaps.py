"""Damaged global heaps of HDF5 files, with which the HDF5 library can turn forever, are refused before it sees them.

A global heap (HDF5 File Format Specification 3.0, section III.E) is a run of objects behind a head of 16 bytes; each
has a head of 16 bytes of its own with its index and size.  The one of index 0 is the free space at the end, whose size
counts its head: where it is 0, as in zeroed bytes, HDF5 1.14 never gets past it.
"""

from __future__ import annotations

import mmap
import struct
from pathlib import Path

from twilight.base.errors import TwilightError

HEAP = b"GCOL\x01\x00\x00\x00"
"""Signature, version 1 and three bytes of 0."""
HEAD_BYTES = 16
"""Of a heap, and of every object in it."""


def check_heaps(path: Path) -> None:
    """TwilightError where a global heap of an HDF5 file is damaged."""
    with open(path, "rb") as file:
        if not file.seek(0, 2):
            return  # nothing to map
        with mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as content:
            start = content.find(HEAP)
            while start >= 0:
                if not _is_whole(content, start):
                    raise TwilightError(f"{path}: is not a complete HDF5 file (a global heap is damaged)")
                start = content.find(HEAP, start + len(HEAP))


def _is_whole(content: mmap.mmap, start: int) -> bool:
    """Whether the objects of the heap that begins at byte `start` fill it."""
    if start + HEAD_BYTES > len(content):
        return False
    end = start + struct.unpack_from("<Q", content, start + 8)[0]
    if end > len(content):
        return False
    at = start + HEAD_BYTES
    while at + HEAD_BYTES <= end:
        index, _, size = struct.unpack_from("<HH4xQ", content, at)
        taken = size if index == 0 else HEAD_BYTES + -(-size // 8) * 8
        if taken < HEAD_BYTES or at + taken > end:
            return False
        at += taken
    return True
