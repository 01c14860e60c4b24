"""Importing stays fast, and imports go one way."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
HEAVY = {"numba", "scipy", "colour", "matplotlib", "pvlib", "pandas", "xarray", "h5py", "PIL", "OpenEXR", "mitsuba"}


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
