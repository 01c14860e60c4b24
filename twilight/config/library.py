"""The climates and configurations that come with the program, by name."""

from __future__ import annotations

from difflib import get_close_matches
from os.path import isdir, isfile
from pathlib import Path

from twilight.base.errors import TwilightError


def shipped(kind: str) -> dict[str, Path]:
    """Name -> file of the shipped `climates` or `configs`, sorted by name.

    An installed package holds the two folders inside itself; a checkout holds them beside the package.
    """
    package = Path(__file__).resolve().parents[1]
    folder = next((f for f in (package / kind, package.parent / kind) if f.is_dir()), None)
    if folder is None:
        raise TwilightError(f"the {kind} that come with twilight are missing from this installation: install it again")
    return {path.stem: path for path in sorted(folder.glob("*.yaml"))}


NOUNS = {"climates": "climate", "configs": "configuration"}


def find(
    target: str | Path,
    folder: Path = Path(),
    kinds: tuple[str, ...] = ("climates", "configs"),
    asked: tuple[str, ...] | None = None,
) -> Path:
    """The file that `target` means: a path (relative to `folder`), or the name of something shipped.

    asked: the kinds that an error lists and suggests, where fewer make sense than are found.
    Errors: TwilightError that lists the nearest names when there is no such thing.
    """
    asked = asked or kinds
    noun = " or ".join(NOUNS[kind] for kind in asked)
    text = str(target)
    if "\0" in text or not text:
        raise TwilightError(f"{text!r} is neither a file nor the name of a {noun}")
    path = folder / Path(text).expanduser()
    if isfile(path):  # unlike Path.is_file, False for a name that is too long
        return path
    if isdir(path):
        raise TwilightError(f"{path}: is a folder; give the file of a {noun}")
    found = next((names[text] for names in map(shipped, kinds) if text in names), None)
    if found is not None:
        return found
    if path.suffix in (".yaml", ".yml", ".json") or "/" in text or "\\" in text:
        beside = get_close_matches(path.stem, _files_beside(path), n=1)
        near = get_close_matches(path.stem, [name for kind in asked for name in shipped(kind)], n=1)
        hint = f"; did you mean {path.parent / _files_beside(path)[beside[0]]}?" if beside else ""
        hint = hint or (f"; did you mean {near[0]}, which needs no path?" if near else f"; {_lists(asked)}")
        raise TwilightError(f"{path}: there is no such file{hint}")
    suggested = [name for kind in asked for name in shipped(kind)]
    near = get_close_matches(text, suggested, n=1)
    hint = f"did you mean {near[0]}?" if near else _names(asked)
    raise TwilightError(f"{text} is not a {noun}; {hint}")


def _files_beside(path: Path) -> dict[str, str]:
    """Names of the documents in the folder of a path by their stems; none where it cannot be read."""
    try:
        return {one.stem: one.name for one in path.parent.iterdir() if one.suffix in (".yaml", ".yml", ".json")}
    except OSError:
        return {}


def _names(kinds: tuple[str, ...]) -> str:
    """`climates are a, b; configurations are c`, for errors."""
    return "; ".join(f"{NOUNS[kind]}s are {', '.join(shipped(kind))}" for kind in kinds)


def _lists(kinds: tuple[str, ...]) -> str:
    """Where the names are listed, for errors."""
    commands = " and ".join(f"`twilight {kind}`" for kind in kinds)
    return f"{commands} list{'s' * (len(kinds) == 1)} those that come with the program"
