"""A folder of files that is written whole or not at all."""

from __future__ import annotations

import os
import shutil
import tempfile
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path

from twilight.base.errors import TwilightError

Buffer = bytes | bytearray | memoryview


def write_folder(folder: str | Path, files: Mapping[str, Buffer]) -> None:
    """Write the files into a new folder; a name may stand in a folder of its own.

    Errors: TwilightError where there is something already, and where the system refuses; nothing is left behind then.
    """
    folder = Path(folder)
    check_new(folder)
    temporary = None
    try:
        folder.parent.mkdir(parents=True, exist_ok=True)
        temporary = Path(tempfile.mkdtemp(prefix=f".{folder.name}.", dir=folder.parent))
        for name, content in files.items():
            path = temporary / name
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_bytes(content)
        temporary.chmod(0o755)
        os.replace(temporary, folder)
    except OSError as error:
        raise TwilightError(f"{folder}: cannot be written ({error.strerror or error})") from None
    finally:
        if temporary is not None:
            with suppress(OSError):
                shutil.rmtree(temporary)


def check_new(folder: Path) -> None:
    """Raise TwilightError where there is something other than an empty folder."""
    if folder.exists() and not (folder.is_dir() and not any(folder.iterdir())):
        raise TwilightError(f"{folder}: is there already; tables are written into a new folder")
