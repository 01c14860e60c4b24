"""What a computed number depends on: a digest of the code that made it, found by walking its imports."""

from __future__ import annotations

import functools
import hashlib
import re
from dataclasses import fields, is_dataclass
from importlib.util import find_spec
from pathlib import Path

import numpy as np

_PACKAGE = Path(__file__).resolve().parents[1]
"""Folder of the package."""

_DATA = _PACKAGE / "data"
"""Folder of the data that come with the package."""

DISPLAY = ("twilight.sky.sky", "twilight.io.exr", "twilight.io.netcdf", "twilight.scene.lights")
"""Modules that show or read and do not compute radiance, and the lights of a sky that are in no field."""


@functools.cache
def code_digest(*modules: str, without: tuple[str, ...] = ()) -> str:
    """SHA-256 over modules, all modules of twilight that they import, and the data that these name.

    An import counts wherever it stands in a file, unless it is for type checkers alone.  A package's `__init__` counts
    where the package itself is imported from, not where one of its modules is.  A folder of data counts where its name
    stands in the code.  Modules of others are taken as they are, without their imports.  Modules in `without` do not
    count, nor what they alone import.
    """
    digest = hashlib.sha256()
    for file in files_of(*modules, without=without):
        digest.update(_name(file).encode())
        digest.update(file.read_bytes())
    return digest.hexdigest()


def files_of(*modules: str, without: tuple[str, ...] = ()) -> list[Path]:
    """The files that `code_digest` reads, in its order."""
    found: dict[str, Path] = {}
    waiting = list(modules)
    folders: set[str] = set()
    while waiting:
        module = waiting.pop()
        if module in found or module in without:
            continue
        file = _file(module)
        if file is None:
            continue
        found[module] = file
        imported, named = _read(file)
        waiting += imported
        folders |= named
    data = (file for folder in _DATA.iterdir() if folder.name in folders for file in folder.rglob("*"))
    counted = [f for f in (*found.values(), *data) if f.is_file() and "__pycache__" not in f.parts]
    return sorted(counted, key=_name)


_FOR_TYPES = re.compile(r"^( *)if [^\n]*TYPE_CHECKING[^\n]*:\n(?:(?:\1 +[^\n]*)?\n)+", re.MULTILINE)
_IMPORT = re.compile(
    rf"^ *(?:import ({_PACKAGE.name}[\w.]*)|from ({_PACKAGE.name}[\w.]*) import (\([^)]*\)|[^\n]*))", re.MULTILINE
)


@functools.cache
def _read(file: Path) -> tuple[tuple[str, ...], frozenset[str]]:
    """Modules of twilight that a file imports, and all that may be names of folders in its strings.

    The text is searched, not parsed: parsing all files takes half a second, at every start of the program.
    """
    text = file.read_text(encoding="utf-8")
    if "TYPE_CHECKING" in text:
        text = _FOR_TYPES.sub("", text)
    found: list[str] = []
    for whole, module, names in _IMPORT.findall(text):
        if whole:
            found.append(whole)
            continue
        inside = [f"{module}.{name}" for name in re.findall(r"(?:^|,)\s*(\w+)", re.sub(r"#.*|[()]", "", names))]
        modules = [name for name in inside if _file(name) is not None]
        found += modules if len(modules) == len(inside) else [*modules, module]
    strings = "/".join(set(re.findall(r"[\"']([^\"'\n]*)[\"']", text)))
    return tuple(found), frozenset(strings.replace(".", "/").split("/"))


def _name(file: Path) -> str:
    return file.relative_to(_PACKAGE).as_posix() if file.is_relative_to(_PACKAGE) else file.name


@functools.cache
def _file(module: str) -> Path | None:
    """The source of a module; None where there is none of that name."""
    if module != _PACKAGE.name and not module.startswith(f"{_PACKAGE.name}."):
        try:
            spec = find_spec(module)
        except ValueError:  # made by hand
            return None
        return Path(spec.origin) if spec is not None and spec.origin is not None else None
    base = _PACKAGE.joinpath(*module.split(".")[1:])
    return next((file for file in (base.with_suffix(".py"), base / "__init__.py") if file.is_file()), None)


def content_digest(*values: object) -> str:
    """SHA-256 over all in values: `add_content`."""
    digest = hashlib.sha256()
    add_content(digest, values)
    return digest.hexdigest()


def add_content(digest: hashlib._Hash, value: object) -> None:
    """Everything in arrays, tuples and dataclasses; of a medium all but notes and the air at other wavelengths."""
    if isinstance(value, np.generic):
        value = value.item()
    if isinstance(value, np.ndarray):
        digest.update(f"{value.dtype.str}{value.shape}".encode() + np.ascontiguousarray(value).tobytes())
    elif isinstance(value, tuple):
        for one in value:
            add_content(digest, one)
    elif is_dataclass(value):
        for f in fields(value):
            if f.compare and f.name != "notes":
                digest.update(f.name.encode())
                add_content(digest, getattr(value, f.name))
    else:
        digest.update(repr(value).encode())
