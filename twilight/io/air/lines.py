"""Text files of measurements, line by line, with one sentence for whatever is wrong in one."""

from __future__ import annotations

import math
import zipfile
from datetime import UTC, datetime
from pathlib import Path

from twilight.base.errors import TwilightError

MAX_BYTES = 400_000_000
"""Largest file of text that is read."""


def read_bytes(path: Path, count: int = -1) -> bytes:
    """The first bytes of a file, -1: all; of the one file in a zip archive where it is one."""
    try:
        if path.stat().st_size > MAX_BYTES:
            raise TwilightError(f"{path}: is larger than {MAX_BYTES // 1_000_000} MB, which is the most allowed")
        if not zipfile.is_zipfile(path):
            with open(path, "rb") as file:
                return file.read(count)
        with zipfile.ZipFile(path) as archive:
            members = [info for info in archive.infolist() if not info.is_dir()]
            if len(members) != 1 or members[0].file_size > MAX_BYTES:
                names = ", ".join(info.filename for info in members[:4]) + ", ..." * (len(members) > 4)
                raise TwilightError(
                    f"{path}: holds {len(members)} files ({names}); allowed is one of {MAX_BYTES // 1_000_000} MB at "
                    "most: unpack it and give them one by one"
                )
            with archive.open(members[0]) as file:
                return file.read(count)
    except (OSError, zipfile.BadZipFile, RuntimeError, NotImplementedError) as error:
        reason = getattr(error, "strerror", None) or " ".join(str(error).split())
        raise TwilightError(f"{path}: cannot be read: {reason}") from None


def read_lines(path: Path) -> list[str]:
    """The lines of a text; letters outside UTF-8 (names of stations) are read as Latin-1."""
    content = read_bytes(path)
    try:
        text = content.decode("utf-8-sig")
    except UnicodeDecodeError:
        text = content.decode("latin-1")
    return text.splitlines()


def number(
    path: Path,
    line: int,
    name: str,
    text: str,
    low: float,
    high: float,
    unit: str = "",
    missing: tuple[float, ...] = (),
) -> float:
    """A number of a line (counted from 1), NaN for one of `missing`.

    Errors: TwilightError with the file, the line and what is allowed.
    """
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if value in missing:
        return math.nan
    if not low <= value <= high:
        unit = f" {unit}" if unit else ""
        raise TwilightError(
            f"{path}: line {line}: {name} is `{text.strip()[:40]}`, allowed is a number from {low:g} to {high:g}{unit}"
        )
    return value


def moment(path: Path, line: int, text: str, layout: str) -> datetime:
    """A time in UTC, in a layout of `strptime`; TwilightError with the file and the line."""
    try:
        return datetime.strptime(text.strip(), layout).replace(tzinfo=UTC)
    except ValueError:
        example = f"{datetime(2026, 6, 21, 12):{layout}}"
        raise TwilightError(f"{path}: line {line}: `{text.strip()[:60]}` is no time such as {example}") from None


def reason(error: Exception) -> str:
    """What a library says of a damaged file, on one line of 200 characters at most."""
    return " ".join(str(error).split())[:200]
