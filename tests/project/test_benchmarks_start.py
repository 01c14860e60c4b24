"""Every benchmark can be imported and started."""

import runpy
import sys
from pathlib import Path

import pytest

HERE = Path(__file__).resolve().parents[2] / "benchmarks"


@pytest.mark.parametrize("path", sorted(HERE.glob("*.py")), ids=lambda path: path.stem)
def test_a_benchmark_says_what_it_does(path, monkeypatch, capsys):
    """A script would import what was renamed, and no table that it writes could be renewed."""
    monkeypatch.syspath_prepend(HERE)
    monkeypatch.setattr(sys, "argv", [str(path), "--help"])
    try:
        runpy.run_path(str(path), run_name="__main__")
    except SystemExit as end:
        assert not end.code
        assert len(capsys.readouterr().out) > 20
    except ModuleNotFoundError as error:
        name = (error.name or "").partition(".")[0]
        assert name != "twilight" and not (HERE / f"{name}.py").exists(), error
        pytest.skip(f"needs {name}")
    else:
        assert "__main__" not in path.read_text(encoding="utf-8"), "it ran"
