"""Size is a feature: how large each part of the tree may be; whoever raises a number says in CHANGELOG what it buys."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import pytest
import typer
from rooms import modules

import twilight
from twilight.cli.app import app

ROOT = Path(__file__).resolve().parents[2]
PACKAGE = ROOT / "twilight"
BUDGET = {
    "api": 1_970,
    "atmosphere": 4_420,
    "base": 1_670,
    "clear_air": 2_520,
    "cli": 3_700,
    "config": 2_790,
    "engine": 3_780,
    "io": 5_030,
    "jit": 880,
    "numerics": 1_030,
    "scene": 1_100,
    "show": 2_230,
    "sky": 5_090,
    "solvers": 13_580,
    "studies": 11_720,
    "terrain": 1_220,
    "transport": 4_510,
    "twilight, all of it": 67_230,
    "JavaScript and shaders": 2_880,
    "tests": 31_220,
    "benchmarks": 6_660,
    "words of README and docs": 15_000,
    "commands": 20,
    "options of commands": 180,
    "public names": 22,
}
"""Lines of Python by room of the package, and what else a reader or a user has before him."""


def lines(*paths: Path) -> int:
    """Lines of text files."""
    return sum(path.read_text(encoding="utf-8").count("\n") for path in paths)


def tracked(folder: str, *suffixes: str) -> list[Path]:
    """Files of a folder by the ends of their names, without what a run leaves behind."""
    found = (path for path in (ROOT / folder).rglob("*") if path.suffix in suffixes)
    return [path for path in found if "__pycache__" not in path.parts and "build" not in path.parts]


def commands(command: Any) -> list[Any]:
    """A command and all below it that do something."""
    below = getattr(command, "commands", {})
    return [command] if not below else [one for each in below.values() for one in commands(each)]


def sizes() -> dict[str, int]:
    """What the budget counts."""
    by_room: dict[str, list[Path]] = {}
    for name, path in modules().items():
        room = name.split(".")[1] if "." in name else ""
        by_room.setdefault(room, []).append(path)
    found = {room: lines(*by_room.get(room, [])) for room in BUDGET if room in by_room}
    every = commands(typer.main.get_command(app))
    pages = [ROOT / "README.md", *(ROOT / "docs").glob("*.md")]
    words = (len(page.read_text(encoding="utf-8").split()) for page in pages if page.name != "command-line.md")
    return found | {
        "twilight, all of it": lines(*modules().values()),
        "JavaScript and shaders": lines(*tracked("twilight", ".js", ".glsl", ".wgsl", ".html")),
        "tests": lines(*tracked("tests", ".py")),
        "benchmarks": lines(*(path for path in tracked("benchmarks", ".py") if "builders" not in path.parts)),
        "words of README and docs": sum(words),
        "commands": len(every),
        "options of commands": sum(p.param_type_name == "option" for one in every for p in one.params),
        "public names": len(twilight.__all__),
    }


@pytest.mark.parametrize("part", BUDGET)
def test_no_part_is_larger_than_its_budget(part):
    """The program would grow without anybody having decided it."""
    size = sizes()[part]
    assert size <= BUDGET[part], f"{part}: {size:,} of {BUDGET[part]:,}; CHANGELOG says what a larger one buys"


def test_every_room_has_a_budget():
    """A new room would cost nothing."""
    assert {name.split(".")[1] for name in modules() if name.count(".") > 1} <= BUDGET.keys()


ROOMS = "|".join(room for room in BUDGET if " " not in room)
QUOTED = re.compile(rf"`{{1,2}}((?:twilight|{ROOMS})(?:\.\w+)+)`{{1,2}}")
ENTRY_POINTS = "twilight.formats"
"""A group of entry points of packages, which is no module."""
FILES = (".png", ".exr", ".hdr", ".h5", ".json", ".jpg", ".glsl", ".wgsl", ".bin", ".csv", ".usda")
"""Ends of names in backticks that are files' and not modules'."""


def test_dotted_names_in_docstrings_and_pages_lead_somewhere():
    """A reader would be sent to a module or a function that is gone."""
    from importlib import import_module

    def leads(name: str) -> bool:
        parts = f"twilight.{name.removeprefix('twilight.')}".split(".")
        for cut in range(len(parts), 0, -1):
            try:
                found: object = import_module(".".join(parts[:cut]))
            except ModuleNotFoundError:
                continue
            for part in parts[cut:]:
                annotations = getattr(found, "__annotations__", {})
                if not hasattr(found, part) and part not in annotations:
                    return False
                found = getattr(found, part, None)
            return True
        return False

    files = [
        *tracked("twilight", ".py"),
        *tracked("tests", ".py"),
        *tracked("benchmarks", ".py"),
    ]
    wrong = [
        f"{path.relative_to(ROOT)}: {name}"
        for path in files
        for name in set(QUOTED.findall(path.read_text(encoding="utf-8")))
        if not name.endswith(FILES) and name != ENTRY_POINTS and not leads(name)
    ]
    assert not wrong, "\n".join(wrong)
    assert not leads("twilight.engine.gone") and leads("twilight.engine.table.fill")
