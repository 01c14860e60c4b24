"""Importing stays fast, and imports go one way."""

from __future__ import annotations

import ast
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
HEAVY = {"numba", "scipy", "colour", "matplotlib", "pandas", "erfa", "xarray", "h5py", "PIL", "OpenEXR", "mitsuba"}


def modules_after(statement: str) -> set[str]:
    program = f"import sys\n{statement}\nprint(*sorted({{name.partition('.')[0] for name in sys.modules}}))"
    return set(
        subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True).stdout.split()
    )


def test_importing_the_package_loads_nothing_but_itself():
    assert not modules_after("import twilight") & (HEAVY | {"numpy", "pydantic", "yaml", "typer"})


@pytest.mark.parametrize(
    "statement", ["import twilight.cli.app", "from twilight.config import load_climate; load_climate('urban')"]
)
def test_the_command_line_and_configurations_load_nothing_heavy(statement):
    assert not modules_after(statement) & HEAVY


def test_imports_keep_to_the_contract():
    pytest.importorskip("importlinter")
    result = subprocess.run(
        [sys.executable, "-c", "from importlinter.cli import lint_imports_command as c; c()", "--no-cache"],
        cwd=ROOT,
        capture_output=True,
        text=True,
    )
    assert result.returncode == 0, result.stdout
    assert "3 kept, 0 broken" in result.stdout


def unexplained_imports(path: Path) -> list[str]:
    """Functions that import first without a word of the reason; one comment serves the imports behind it."""
    text = path.read_text(encoding="utf-8")
    lines, found = text.splitlines(), []
    for function in ast.walk(ast.parse(text)):
        if isinstance(function, ast.FunctionDef | ast.AsyncFunctionDef):
            inside = sorted(n.lineno for n in ast.walk(function) if isinstance(n, ast.Import | ast.ImportFrom))
            around = " ".join(lines[inside[0] - 2 : inside[-1]]) if inside else "start-up"
            if "start-up" not in around and "# optional" not in around:
                found.append(f"{path.relative_to(ROOT)}:{inside[0]}: {function.name}")
    return found


def test_imports_inside_functions_say_why():
    """The commands' head says it for all of them."""
    files = [f for f in (ROOT / "twilight").rglob("*.py") if "cli" not in f.relative_to(ROOT).parts]
    assert [line for file in files for line in unexplained_imports(file)] == []
