"""Files that are written whole or not at all."""

from __future__ import annotations

import os
import secrets
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from twilight.errors import TwilightError


@contextmanager
def whole_file(path: str | os.PathLike) -> Iterator[Path]:
    """Give a temporary path beside ``path`` (same suffix) to write to, and rename it when the block ends well.

    If the block raises, the temporary file is removed and what was at ``path`` before stays.  Raises TwilightError
    where the folder does not exist or the system refuses to write.
    """
    path = Path(path)
    if not path.parent.is_dir():
        raise TwilightError(f"{path}: the folder does not exist")
    if path.is_dir():
        raise TwilightError(f"{path}: is a folder, not a file")
    temporary = path.with_name(f".{path.name}.{secrets.token_hex(4)}.part{path.suffix}")
    try:
        yield temporary
        os.replace(temporary, path)
    except OSError as error:
        raise TwilightError(f"{path}: cannot be written ({error.strerror or error})") from error
    finally:
        with suppress(OSError):
            temporary.unlink()
