"""Importing stays fast, and imports go one way."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import pytest
import rooms
from rooms import imported, imports_of

ROOT = Path(__file__).resolve().parents[2]
HEAVY = {"numba", "scipy", "colour", "matplotlib", "pandas", "erfa", "xarray", "h5py", "PIL", "OpenEXR", "mitsuba"}


def modules_after(statement: str) -> set[str]:
    program = f"import sys\n{statement}\nprint(*sorted({{name.partition('.')[0] for name in sys.modules}}))"
    return set(
        subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True).stdout.split()
    )


def test_importing_the_package_loads_nothing_but_itself():
    """`import twilight` would load numpy and more before any of it is needed."""
    assert not modules_after("import twilight") & (HEAVY | {"numpy", "pydantic", "yaml", "typer"})


@pytest.mark.parametrize(
    "statement", ["import twilight.cli.app", "from twilight.config import load_climate; load_climate('urban')"]
)
def test_the_command_line_and_configurations_load_nothing_heavy(statement):
    """`twilight --help` would wait for numba and scipy."""
    assert not modules_after(statement) & HEAVY


def test_a_sky_of_the_fitted_model_loads_no_compiler():
    """A sky within seconds would wait half a second for numba, and need it."""
    compute = "import twilight; twilight.solve('urban', solver='compact').radiance(-4.0, 20.0, 0.0)"
    assert not modules_after(compute) & (HEAVY | {"llvmlite"}) - {"h5py"}


def test_imports_keep_to_the_contract():
    """Rooms would import from rooms above them."""
    pytest.importorskip("importlinter")
    result = subprocess.run(
        [sys.executable, "-c", "from importlinter.cli import lint_imports_command as c; c()", "--no-cache"],
        cwd=ROOT,
        capture_output=True,
        text=True,
    )
    assert result.returncode == 0, result.stdout
    assert "3 kept, 0 broken" in result.stdout


def circles(imports: dict[str, set[str]]) -> list[list[str]]:
    """Groups of modules each of which leads back to itself."""
    reached = {name: set(others) for name, others in imports.items()}
    for middle in imports:
        for name in imports:
            if middle in reached[name]:
                reached[name] |= reached[middle]
    groups = {frozenset(o for o in reached[n] if n in reached[o]) for n in imports if n in reached[n]}
    return [sorted(group) for group in groups]


def test_no_modules_import_each_other():
    """Neither when they are loaded, nor in functions, nor for types alone: a reader of one needs not the other."""
    names = rooms.modules()
    imports = {name: imported(path, names) - {name} for name, path in names.items()}
    assert len(imports) > 250 and sum(map(len, imports.values())) > 1000
    assert circles(imports) == []
    assert circles({"a": {"b"}, "b": {"c"}, "c": {"a", "d"}, "d": set()}) == [["a", "b", "c"]]


PAGE = rooms.PAGE.read_text(encoding="utf-8")
SIZES = re.compile(r"^\d (\w+) +(\d+) +([\d,]+)(?=   )", re.MULTILINE)


def test_the_page_draws_the_rooms_as_they_are():
    """An import between rooms came or went: `python docs/rooms.py`; so did a tenth of a room's files or lines."""
    page, now = rooms.drawn(PAGE, "drawing"), rooms.drawing()
    assert SIZES.sub(r"\1", page) == SIZES.sub(r"\1", now)
    sizes = [
        {room: (int(files), int(lines.replace(",", ""))) for room, files, lines in SIZES.findall(text)}
        for text in (page, now)
    ]
    assert list(sizes[0]) == rooms.layers() == [room for storey in rooms.STOREYS for room in storey]
    for room, (files, lines) in sizes[1].items():
        assert sizes[0][room][0] == pytest.approx(files, rel=0.1, abs=2), room
        assert sizes[0][room][1] == pytest.approx(lines, rel=0.1, abs=200), room


def test_the_page_draws_which_table_feeds_which():
    """A table is made of others than it was: `python docs/rooms.py`; what it is made of stands above it."""
    assert rooms.drawn(PAGE, "tables") == rooms.drawing_of_tables()
    order, pairs = [*rooms.MADE_BY], rooms.feeds()
    assert all(order.index(above) < order.index(below) for above, below in pairs)
    assert {below for _, below in pairs} == {*order[1:]} and {above for above, _ in pairs} == {*order[:-1]}
    assert rooms.annotated("ZonesField") & {*order} == {"FieldGrids", "Beam", "Solution"}


def test_rooms_define_what_they_hand_up():
    """The drawing would name classes that a room does not have."""
    names = rooms.modules()
    for room, classes in rooms.HANDS_UP.items():
        text = "".join(path.read_text("utf-8") for name, path in names.items() if name.startswith(f"twilight.{room}."))
        assert [name for name in classes if not re.search(rf"^class {name}\b", text, re.MULTILINE)] == []


def test_every_room_has_its_row_with_tests_that_are_there():
    """A room would be missing from the page of the architecture."""
    rows = re.findall(r"^\| (`\w+`(?:, `\w+`)*) \|.*\| ([^|]*) \| [^|]*\|$", PAGE, re.MULTILINE)
    told = {room: tests for named, tests in rows for room in re.findall(r"\w+", named)}
    assert {room for room in rooms.layers() if "`tests/" in told.get(room, "")} == {*rooms.layers()}


@pytest.mark.parametrize("walk", rooms.walks(PAGE))
def test_the_walks_go_by_imports(walk):
    """A walk on the page of the architecture would go where no import goes, or grow past 14 files."""
    steps = rooms.walks(PAGE)[walk]
    assert rooms.broken(steps) == []
    assert 10 <= len(steps) <= 14


def test_a_walk_that_no_import_takes_is_broken():
    """The check of the walks would pass any list."""
    steps = [("cli/render.py", ""), ("sky/table.py", "cli/render.py"), ("sky/sky.py", "by name"), ("sky/no.py", "")]
    assert rooms.broken(steps) == [
        "cli/render.py does not import sky/table.py",
        "sky/sky.py is of no solver",
        "sky/no.py is not there",
    ]


INSIDE_THE_ENGINE = {"Problem", "Block", "MixedBlock"}


def test_fields_and_skies_are_all_that_the_engine_hands_out():
    """A film, a sweep, a test or a benchmark would join blocks of wavelengths by itself."""
    files = [p for room in ("twilight", "tests", "benchmarks") for p in (ROOT / room).rglob("*.py")]
    outside = [p for p in files if (ROOT / "twilight" / "engine") not in p.parents]
    users = {
        p.name: INSIDE_THE_ENGINE & names
        for p in outside
        for module, names in imports_of(p).items()
        if module.startswith("twilight.engine") and INSIDE_THE_ENGINE & names
    }
    assert users == {"test_unknown_light.py": {"Block"}}
    assert len(outside) > 400
