"""The climates and configurations that come with the program, by name."""

from __future__ import annotations

from os.path import isdir, isfile
from pathlib import Path

from twilight.config.validate import unknown
from twilight.errors import TwilightError


def shipped(kind: str) -> dict[str, Path]:
    """Name -> file of the shipped `climates` or `configs`, sorted by name.

    An installed package holds the two folders inside itself; a checkout holds them beside the package.
    """
    package = Path(__file__).resolve().parents[1]
    folder = next((f for f in (package / kind, package.parent / kind) if f.is_dir()), None)
    if folder is None:
        raise TwilightError(f"the {kind} that come with twilight are missing from this installation: install it again")
    return {path.stem: path for path in sorted(folder.glob("*.yaml"))}


def find(target: str | Path, folder: Path = Path(), kinds: tuple[str, ...] = ("climates", "configs")) -> Path:
    """The file that `target` means: a path (relative to `folder`), or the name of something shipped.

    Errors: TwilightError that lists the nearest names when there is no such thing.
    """
    text = str(target)
    if "\0" in text or not text:
        raise TwilightError(f"{text!r} is neither a file nor the name of a climate")
    path = folder / Path(text).expanduser()
    if isfile(path):  # unlike Path.is_file, False for a name that is too long
        return path
    if isdir(path):
        raise TwilightError(f"{path}: is a folder; give the file of a climate or configuration")
    names = {name: file for kind in kinds for name, file in shipped(kind).items()}
    if text in names:
        return names[text]
    if path.suffix in (".yaml", ".yml", ".json") or "/" in text or "\\" in text:
        raise TwilightError(f"{path}: there is no such file (names without a folder: {', '.join(sorted(names))})")
    raise TwilightError(
        f"{text} {unknown(text, names, 'climate' if kinds == ('climates',) else 'climate or configuration')}"
    )
