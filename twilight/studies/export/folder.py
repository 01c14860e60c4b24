"""A folder of files that is written whole or not at all."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from twilight.base.errors import TwilightError
from twilight.base.whole_files import whole_folder

Buffer = bytes | bytearray | memoryview


def write_folder(folder: str | Path, files: Mapping[str, Buffer]) -> None:
    """Write the files into a new folder; a name may stand in a folder of its own.

    Errors: TwilightError where there is something already, and where the system refuses; nothing is left behind then.
    """
    folder = Path(folder)
    check_new(folder)
    with whole_folder(folder) as temporary:
        for name, content in files.items():
            path = temporary / name
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_bytes(content)


def check_new(folder: Path) -> None:
    """Raise TwilightError where there is something other than an empty folder."""
    if folder.exists() and not (folder.is_dir() and not any(folder.iterdir())):
        raise TwilightError(f"{folder}: is there already; tables are written into a new folder")
