"""What is installed with the program suffices; what is not is asked for in one sentence with a command that works."""

import ast
import re
import subprocess
import sys
import tomllib
from importlib.metadata import packages_distributions
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from twilight.api.representation import Sky
from twilight.base.extras import REQUIREMENTS, is_installed, missing
from twilight.cli.app import app

ROOT = Path(__file__).resolve().parents[2]
BROUGHT_BY = {"numcodecs": "zarr", "pandas": "xarray"}
"""Modules that come with a dependency which cannot do without them."""
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]


COMMANDS = {
    "sweep humidity": "dask",
    "compare pure-air": "colour-science",
    "timeline pure-air --latitude 28 --longitude -16 --output night.nc": "xarray",
    "timeline pure-air --latitude 28 --longitude -16 --output night.png": "matplotlib",
    "light pure-air --at 2026-06-21T12:00Z --latitude 28 --longitude -16": "xarray",
    "validate photometry": "matplotlib",
}
"""Commands, and what the sentence of each asks for first."""


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
    """A fresh installation would end in a ModuleNotFoundError."""
    here = {distribution(text) for text in PROJECT["dependencies"]}
    distributions = packages_distributions()
    for module, files in imports().items():
        if module not in REQUIREMENTS and BROUGHT_BY.get(module) not in REQUIREMENTS:
            names = {name.lower().replace("_", "-") for name in distributions.get(module, [module])}
            assert names & here, f"{module}, which {files} import, is no dependency: {names}"


def test_the_requirements_that_sentences_name_are_those_of_the_extras():
    """A sentence would ask for another version than the extra has."""
    extras = {r for name, list_ in PROJECT["optional-dependencies"].items() if name != "test" for r in list_}
    assert set(REQUIREMENTS.values()) <= extras
    assert not is_installed("no_such_module") and is_installed("numpy")
    assert "mitsuba>=" in str(missing("mitsuba", "x"))
    assert "'dask>=2025.5' 'zarr>=3.1,<4'" in str(missing("dask", "x", "zarr"))


def test_no_sentence_asks_for_a_package_that_no_index_has():
    """A sentence's command would fail."""
    for path in [*(ROOT / "twilight").rglob("*.py"), ROOT / "README.md", *(ROOT / "docs").glob("*.md")]:
        assert "pip install 'twilight" not in path.read_text(encoding="utf-8"), path


def test_what_is_not_there_is_one_sentence_with_the_command(tmp_path, monkeypatch):
    """A package that is missing would be a traceback."""
    from PIL import Image

    from twilight.base.errors import TwilightError
    from twilight.io.stored_image import read_image

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
    for command, requirement in COMMANDS.items():
        result = CliRunner().invoke(app, command.split())
        assert result.exit_code == 2 and f"install '{requirement}>=" in result.output, result.output
        assert len(result.output.splitlines()) == 1
    sky = Sky(np.array([500.0, 600.0]), np.array([30.0, 60.0]), np.array([0.0, 180.0]), np.ones((2, 2, 2)), 5.0)
    for call in (sky.to_xarray, sky.plot):
        with pytest.raises(TwilightError, match="install '"):
            call()


def test_a_batch_system_is_asked_for(monkeypatch):
    """A cluster's package that is missing would be a traceback."""
    monkeypatch.setitem(sys.modules, "dask_jobqueue", None)
    result = CliRunner().invoke(app, ["sweep", "humidity", "--batch-system", "slurm"])
    assert result.exit_code == 2 and "install 'dask-jobqueue>=" in result.output


def test_a_sky_is_rendered_and_read_without_any_extra(tmp_path):
    """README's first command, which installs none, would fail."""
    script = f"""import sys
for name in {sorted([*REQUIREMENTS, *BROUGHT_BY])}: sys.modules[name] = None
from twilight import read_sky
from twilight.cli import main
try:
    main()
except SystemExit as left:
    assert not left.code
print(read_sky("sky/sky.h5").illuminance_lux())
"""
    command = ["render", "pure-air", "--sun-elevation", "10", "--solver", "compact", "--output", "sky"]
    command += ["--set", "output.camera={}"]
    done = subprocess.run([sys.executable, "-c", script, *command], cwd=tmp_path, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert 1e3 < float(done.stdout.splitlines()[-1]) < 1e5
