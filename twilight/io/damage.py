"""What readers say about a file that is damaged."""

from __future__ import annotations

from pathlib import Path

from twilight.errors import TwilightError

LARGEST_EXPANSION = 1100
"""Deflate, which compresses all our files, makes at most 1032 bytes of one."""
SMALL_BYTES = 1_000_000


def check_expansion(path: Path, n_bytes: float) -> None:
    """Raise TwilightError where a file claims to hold more than it can, before memory is taken for it."""
    size = path.stat().st_size
    if n_bytes > LARGEST_EXPANSION * size + SMALL_BYTES:
        raise TwilightError(
            f"{path}: is damaged: it says that it holds {n_bytes / 1e9:.3g} GB, but its {size / 1e3:.3g} kB cannot"
        )


def first_line(error: BaseException) -> str:
    """The first line of an error's text, its type where it has none; what cannot be printed is escaped."""
    lines = str(error).splitlines()
    text = lines[0] if lines and lines[0].strip() else type(error).__name__
    return text[:300].encode("ascii", "backslashreplace").decode()
