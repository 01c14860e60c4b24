"""What is installed with the program suffices; what is not is asked for in one sentence with a command that works."""

from __future__ import annotations

import ast
import re
import sys
import tomllib
from importlib.metadata import packages_distributions
from pathlib import Path

import pytest
from typer.testing import CliRunner

from twilight.base.extras import REQUIREMENTS, is_installed, missing
from twilight.cli.app import app

ROOT = Path(__file__).resolve().parents[2]
BROUGHT_BY = {"numcodecs": "zarr", "pandas": "xarray"}
"""Modules that come with a dependency which cannot do without them."""
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]


def distribution(requirement: str) -> str:
    return re.split(r"[<>=!~\[; ]", requirement)[0].lower().replace("_", "-")


def imports() -> dict[str, set[str]]:
    """The packages of others that the program imports, with the files that do."""
    found: dict[str, set[str]] = {}
    for path in (ROOT / "twilight").rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            names = [a.name for a in node.names] if isinstance(node, ast.Import) else []
            names += [node.module or ""] if isinstance(node, ast.ImportFrom) and not node.level else []
            for name in names:
                top = name.partition(".")[0]
                if top not in sys.stdlib_module_names and top != "twilight":
                    found.setdefault(top, set()).add(str(path.relative_to(ROOT)))
    return found


def test_what_the_program_imports_is_installed_with_it_or_asked_for():
    here = {distribution(text) for text in PROJECT["dependencies"]}
    distributions = packages_distributions()
    for module, files in imports().items():
        if module not in REQUIREMENTS and BROUGHT_BY.get(module) not in here:
            names = {name.lower().replace("_", "-") for name in distributions.get(module, [module])}
            assert names & here, f"{module}, which {files} import, is no dependency: {names}"


def test_the_requirements_that_sentences_name_are_those_of_the_extras():
    extras = {r for name, list_ in PROJECT["optional-dependencies"].items() if name != "test" for r in list_}
    assert set(REQUIREMENTS.values()) <= extras
    assert not is_installed("no_such_module") and is_installed("numpy")
    assert "mitsuba>=" in str(missing("mitsuba", "x"))


def test_no_sentence_asks_for_a_package_that_no_index_has():
    for path in [*(ROOT / "twilight").rglob("*.py"), ROOT / "README.md", *(ROOT / "docs").glob("*.md")]:
        assert "pip install 'twilight" not in path.read_text(encoding="utf-8"), path


def test_what_is_not_there_is_one_sentence_with_the_command(tmp_path, monkeypatch):
    from PIL import Image

    from twilight.base.errors import TwilightError
    from twilight.studies.camera.image import read_image

    for module in REQUIREMENTS:
        monkeypatch.setitem(sys.modules, module, None)
    Image.new("RGB", (30, 20)).save(tmp_path / "a.png")
    with pytest.raises(TwilightError, match="install 'openimageio>="):
        read_image(tmp_path / "a.png")
    (tmp_path / "a.cr2").write_bytes(b"II*\0" + bytes(1000))
    with pytest.raises(TwilightError, match="install 'rawpy>="):
        read_image(tmp_path / "a.cr2")
    (tmp_path / "a.heic").write_bytes(bytes(100))
    with pytest.raises(TwilightError, match="install 'pillow-heif>="):
        read_image(tmp_path / "a.heic")
    result = CliRunner().invoke(app, ["sweep", "humidity", "--batch-system", "slurm"])
    assert result.exit_code == 2 and "install 'dask-jobqueue>=" in result.output
    assert len(result.output.splitlines()) == 1
