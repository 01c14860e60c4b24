"""The house, drawn from its code: rooms, their sizes, what each hands up, and which takes from which.

    python docs/rooms.py

writes the drawing into `architecture.md`; tests hold the page to the code.
"""

from __future__ import annotations

import ast
import functools
import re
import tomllib
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
PAGE = ROOT / "docs" / "architecture.md"
BEGIN, END = "<!-- drawing -->", "<!-- end of drawing -->"
HANDS_UP = {
    "engine": ("Field",),
    "scene": ("Scene",),
    "config": ("Config", "Climate"),
    "sky": ("Light", "SkyTable", "Sky"),
    "solvers": ("Solver",),
    "transport": ("Beam", "RayPath"),
    "atmosphere": ("Medium",),
    "numerics": ("PhaseFunction", "Projection"),
    "base": ("TwilightError",),
}
"""Classes that the data is in when it leaves a room."""

STOREYS = (
    ("cli", "api"),
    ("show", "studies"),
    ("engine", "scene", "terrain", "config"),
    ("io", "sky", "solvers"),
    ("transport", "atmosphere"),
    ("numerics", "jit", "base"),
)
"""Rooms of the six storeys, from the top."""


def modules() -> dict[str, Path]:
    """All modules of the package by name; a package's is its `__init__`."""
    paths = {}
    for path in sorted((ROOT / "twilight").rglob("*.py")):
        parts = path.relative_to(ROOT).with_suffix("").parts
        paths[".".join(parts[:-1] if parts[-1] == "__init__" else parts)] = path
    return paths


@functools.cache
def imports_of(path: Path) -> dict[str, set[str]]:
    """What a module imports from where, in functions and for types alone too."""
    members: dict[str, set[str]] = {}
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            members |= {alias.name: set() for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            members.setdefault(node.module or "", set()).update(alias.name for alias in node.names)
    return members


def imported(path: Path, names: dict[str, Path]) -> set[str]:
    """The modules of the package that a module imports."""
    imports = set()
    for module, members in imports_of(path).items():
        imports |= {f"{module}.{member}" for member in members} & names.keys() or {module}
    return imports & names.keys()


def reached(path: Path, names: dict[str, Path]) -> set[str]:
    """The modules that a module imports, and those whose names it takes from a package that hands them on."""
    imports = imported(path, names)
    for module, members in imports_of(path).items():
        if module in names and names[module].name == "__init__.py":
            within = imports_of(names[module])
            imports |= {source for source, handed in within.items() if handed & members and source in names}
    return imports


def layers() -> list[str]:
    """Rooms from top to bottom, as import-linter holds them."""
    contracts = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["tool"]["importlinter"]["contracts"]
    [rows] = [contract["layers"] for contract in contracts if contract["type"] == "layers"]
    return [room.strip() for row in rows for room in row.split("|")]


def takes() -> set[tuple[str, str]]:
    """Pairs of rooms: the first imports from the second."""
    names = modules()
    rooms = {name: name.split(".")[1] for name in names if "." in name}
    pairs = {(rooms[n], rooms[m]) for n in rooms for m in imported(names[n], names) if m in rooms}
    return {(above, below) for above, below in pairs if above != below}


def drawing() -> str:
    """A row for each room.  Its line goes left to dots on the lines that go down from the rooms that import it."""
    order, pairs, names = layers(), takes(), modules()
    storeys = {room: n for n, rooms in enumerate(STOREYS, 1) for room in rooms}
    lowest = {room: max([i for i, below in enumerate(order) if (room, below) in pairs], default=-1) for room in order}
    rows = []
    for i, room in enumerate(order):
        files = [path for name, path in names.items() if name.split(".")[1:2] == [room]]
        lines = round(sum(len(path.read_text("utf-8").splitlines()) for path in files), -2)
        importers = [above for above in order[:i] if (above, room) in pairs]
        line, joined = "", False
        for above in order[:i]:
            joined |= above in importers
            below = i < lowest[above]
            mark = "●" if above in importers else "│┼"[joined] if below else " ─"[joined]
            line += mark + " ─"[joined] * 2
        line += "┐" if lowest[room] > i else "╴"
        up = ", ".join(HANDS_UP.get(room, ()))
        name = f"{storeys[room]} {room:<11}{len(files):4}{lines:8,}"
        rows.append(f"{name}   {line:<{3 * len(order)}}{up}".rstrip())
    return "\n".join([f"  {'room':<11}files  lines   {'imported by':<{3 * len(order)}}hands up", *rows])


def drawn(text: str) -> str:
    """The drawing that a page holds."""
    block = re.search(rf"{BEGIN}\n\n```text\n(.*?)\n```\n\n{END}", text, re.DOTALL)
    assert block is not None, f"{BEGIN} is not there"
    return block[1]


def walks(text: str) -> dict[str, list[tuple[str, str]]]:
    """Walk to its steps: a file, and the file that imports it; "by name" for a solver that the registry loads."""
    part = text.partition("## Three walks")[2].partition("\n## ")[0]
    steps_of = {}
    for walk in part.split("\n### ")[1:]:
        steps = re.findall(r"^(\d+)\. `([\w/]+\.py)`(?: \((?:from (\d+)|(by name))\))?:", walk, re.MULTILINE)
        assert [int(step[0]) for step in steps] == [*range(1, len(steps) + 1)]
        files = [step[1] for step in steps]
        steps_of[walk.partition("\n")[0]] = [
            (file, named or files[int(source) - 1 if source else i - 1] if i else "")
            for i, (_, file, source, named) in enumerate(steps)
        ]
    return steps_of


def broken(steps: list[tuple[str, str]]) -> list[str]:
    """Steps of a walk that the imports do not take."""
    from twilight.solvers import SOLVERS

    names = modules()
    known = {path.relative_to(ROOT / "twilight").as_posix(): name for name, path in names.items()}
    wrong = []
    for file, source in steps:
        if file not in known:
            wrong.append(f"{file} is not there")
        elif source == "by name":
            solver = known[file].rpartition(".")[0]
            if solver not in SOLVERS.values() or known[file] not in imported(names[solver], names):
                wrong.append(f"{file} is of no solver")
        elif source and (source not in known or known[file] not in reached(names[known[source]], names)):
            wrong.append(f"{source} does not import {file}")
    return wrong


if __name__ == "__main__":
    head, _, rest = PAGE.read_text(encoding="utf-8").partition(BEGIN)
    block = f"{BEGIN}\n\n```text\n{drawing()}\n```\n\n{END}"
    PAGE.write_text(f"{head}{block}{rest.partition(END)[2]}", encoding="utf-8")
