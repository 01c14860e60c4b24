"""The house, drawn from its code: rooms, their sizes, what each hands up, which takes from which; and what tables feed.

    python docs/rooms.py

writes both drawings into `architecture.md`; tests hold the page to the code.
"""

from __future__ import annotations

import ast
import functools
import re
import tomllib
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[1]
PAGE = ROOT / "docs" / "architecture.md"
HANDS_UP = {
    "engine": ("Field",),
    "scene": ("Scene",),
    "config": ("Config", "Climate"),
    "sky": ("Light", "SkyTable", "Sky"),
    "solvers": ("Solver",),
    "transport": ("Beam", "RayPath"),
    "clear_air": ("Air", "Skies"),
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
    ("transport", "clear_air", "atmosphere"),
    ("numerics", "jit", "base"),
)
"""Rooms of the six storeys, from the top."""

MADE_BY = {
    "Medium": "scene.medium.climate_medium",
    "GasBands": "scene.medium.climate_gas_bands",
    "ScaledMedium": "transport.scaling.delta_scaled",
    "Layout": "solvers.zones.grids.lay_out",
    "FieldGrids": "solvers.zones.grids.FieldGrids",
    "Beam": "solvers.zones.grids.FieldGrids.sunbeam",
    "Solution": "solvers.zones.orders.solve",
    "ZonesField": "solvers.zones.field.ZonesField",
    "ScatteredOnce": "transport.scattered_once.ScatteredOnce",
    "Stokes": "engine.block.Block.answer",
    "SkyTable": "engine.table.fill",
    "SunLight": "engine.one_sun.SunLight",
    "Sky": "engine.one_sun.SunLight.sky",
}
"""Tables between a climate and a sky, and the function or class that makes each: what feeds it is its annotations."""

STANDS_FOR = {"Field": "ZonesField"}
"""What the engine knows a solver's table as."""


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


def named(note: ast.AST | None) -> set[str]:
    """Names in an annotation or an expression."""
    return {node.id for node in ast.walk(note) if isinstance(node, ast.Name)} if note else set()


def annotated(table: str) -> set[str]:
    """Names in the annotations of what makes a table: parameters, and what an object of the class holds.

    Where a method's class is a table, that stands for what it holds.
    """
    names, made_by = modules(), MADE_BY[table]
    module = max((name for name in names if f"twilight.{made_by}.".startswith(f"{name}.")), key=len)
    tree = ast.parse(names[module].read_text(encoding="utf-8"))
    parts = f"twilight.{made_by}".removeprefix(f"{module}.").split(".")
    found: set[str] = set()
    scope: Any = tree
    for part in parts:
        [scope] = [n for n in scope.body if isinstance(n, ast.ClassDef | ast.FunctionDef) and n.name == part]
        if isinstance(scope, ast.ClassDef) and part in MADE_BY and part != parts[-1]:
            found.add(part)
            continue
        functions = [scope]
        if isinstance(scope, ast.ClassDef):
            found = found.union(
                *(named(node.annotation) for node in ast.walk(scope) if isinstance(node, ast.AnnAssign))
            )
            functions = [n for n in scope.body if isinstance(n, ast.FunctionDef) and n.name == "__init__"]
        for function in functions:
            arguments = [*function.args.args, *function.args.kwonlyargs]
            found = found.union(*(named(argument.annotation) for argument in arguments))
    made = scope.name if isinstance(scope, ast.ClassDef) else ast.unparse(scope.returns)
    assert table in made, f"{made_by} makes {made}"
    aliases = [n for n in tree.body if isinstance(n, ast.Assign) and named(n.targets[0]) & found]
    return found.union(*(named(alias.value) for alias in aliases))


def feeds() -> set[tuple[str, str]]:
    """Pairs of tables: the first enters the second."""
    pairs = {(STANDS_FOR.get(n, n), table) for table in MADE_BY for n in annotated(table)}
    return {(above, below) for above, below in pairs if above in MADE_BY and above != below}


def lines_down(order: list[str], pairs: set[tuple[str, str]]) -> list[str]:
    """For each name a line that goes left to dots on the lines that go down from the names above it in its pairs."""
    lowest = {name: max([i for i, below in enumerate(order) if (name, below) in pairs], default=-1) for name in order}
    rows = []
    for i, name in enumerate(order):
        line, joined = "", False
        for above in order[:i]:
            joined |= (above, name) in pairs
            below = i < lowest[above]
            mark = "●" if (above, name) in pairs else "│┼"[joined] if below else " ─"[joined]
            line += mark + " ─"[joined] * 2
        rows.append(f"{line}{'┐' if lowest[name] > i else '╴'}")
    return rows


def drawing() -> str:
    """A row for each room."""
    order, names = layers(), modules()
    storeys = {room: n for n, rooms in enumerate(STOREYS, 1) for room in rooms}
    rows = []
    for room, line in zip(order, lines_down(order, takes()), strict=True):
        files = [path for name, path in names.items() if name.split(".")[1:2] == [room]]
        lines = round(sum(len(path.read_text("utf-8").splitlines()) for path in files), -2)
        up = ", ".join(HANDS_UP.get(room, ()))
        rows.append(f"{storeys[room]} {room:<11}{len(files):4}{lines:8,}   {line:<{3 * len(order)}}{up}".rstrip())
    return "\n".join([f"  {'room':<11}files  lines   {'imported by':<{3 * len(order)}}hands up", *rows])


def drawing_of_tables() -> str:
    """A row for each table."""
    order = [*MADE_BY]
    rows = zip(MADE_BY.items(), lines_down(order, feeds()), strict=True)
    head = f"{'table':<15}{'made of':<{3 * len(order)}}made by"
    return "\n".join([head, *(f"{table:<15}{line:<{3 * len(order)}}{made_by}" for (table, made_by), line in rows)])


DRAWINGS = {"drawing": drawing, "tables": drawing_of_tables}
"""Marks on the page, and what stands between them."""


def drawn(text: str, name: str) -> str:
    """A drawing that a page holds."""
    block = re.search(rf"<!-- {name} -->\n\n```text\n(.*?)\n```\n\n<!-- end of {name} -->", text, re.DOTALL)
    assert block is not None, f"{name} is not there"
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
    text = PAGE.read_text(encoding="utf-8")
    for name, draw in DRAWINGS.items():
        begin, end = f"<!-- {name} -->", f"<!-- end of {name} -->"
        head, _, rest = text.partition(begin)
        text = f"{head}{begin}\n\n```text\n{draw()}\n```\n\n{end}{rest.partition(end)[2]}"
    PAGE.write_text(text, encoding="utf-8")
