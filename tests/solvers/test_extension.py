"""Packages of others add solvers and file formats: the example of the docs, installed and used."""

import json
import os
import subprocess
import sys
from importlib.metadata import EntryPoint
from pathlib import Path

import numpy as np
import pytest

from twilight import solvers
from twilight.base.errors import TwilightError
from twilight.base.registry import Registry

ROOT = Path(__file__).resolve().parents[2]
EXAMPLE = ROOT / "docs" / "examples" / "extension"
SMALL = ("--set", "texture.resolution_deg=15", "--set", "wavelengths.list_nm=[450, 550, 650]")


@pytest.fixture(scope="module")
def installed(tmp_path_factory):
    """A folder with the example package, as pip installs it."""
    folder = tmp_path_factory.mktemp("site")
    pip = [sys.executable, "-m", "pip", "install", "-q", "--no-deps", "--no-build-isolation", "--target", folder]
    subprocess.run([*pip, EXAMPLE], check=True, capture_output=True, cwd=folder)
    return folder


CALLS = """
import json, sys
from typer.testing import CliRunner
from twilight.cli.app import app
for words in json.loads(sys.argv[1]):
    done = CliRunner().invoke(app, words)
    print(json.dumps([done.exit_code, done.stdout, done.stderr]))
"""


def twilight(installed, folder, *commands):
    """(exit code, output, errors) of commands, one after the other in one process beside what is installed."""
    env = {**os.environ, "PYTHONPATH": os.pathsep.join([str(installed), str(ROOT)])}
    command = [sys.executable, "-c", CALLS, json.dumps(commands)]
    done = subprocess.run(command, cwd=folder, env=env, capture_output=True, text=True, timeout=120, check=True)
    return [json.loads(line) for line in done.stdout.splitlines()]


def test_a_solver_and_a_format_of_another_package_are_used_by_their_names(installed, tmp_path):
    """The example of the docs would not work."""
    uniform = ["render", "pure-air", "--sun-elevation", "5", "--solver", "uniform", *SMALL]
    words = [*uniform, "--set", "solver.radiance=0.02", "--only", "luminance-csv,h5", "--output", "out"]
    slips = ([*uniform, "--set", f"solver.{slip}"] for slip in ("radiance=-1", "radiants=1"))
    done, again, listed, wrong, misspelt = twilight(
        installed, tmp_path, words, words, ["show", "solvers", "uniform"], *slips
    )
    assert done[0] == 0, done
    assert {"sky.h5", "sky.luminance.csv"} <= {path.name for path in (tmp_path / "out").iterdir()}
    luminance = np.loadtxt(tmp_path / "out" / "sky.luminance.csv", delimiter=",")
    assert luminance.shape == (6, 24) and luminance.min() > 0.0 and np.ptp(luminance) == 0.0
    assert again[0] == 0 and "1 of 1 were there already" in again[2]
    assert "sun-normalised [sr^-1]" in listed[1]
    # a slip in its options is one sentence
    assert wrong[0] == 2 and "solver.radiance must be a number of at least 0, got -1" in wrong[2]
    assert misspelt[0] == 2 and "did you mean radiance" in misspelt[2]


def registry_with(monkeypatch, name, value):
    monkeypatch.setattr("importlib.metadata.entry_points", lambda group: [EntryPoint(name, value, group)])
    return Registry("twilight.solvers", {"zones": "twilight.solvers.zones"})


def test_a_name_that_is_taken_or_cannot_be_loaded_is_one_sentence(monkeypatch):
    """Otherwise another package could take the place of a solver in silence."""
    registry = registry_with(monkeypatch, "zones", "elsewhere")
    assert registry["zones"] == "twilight.solvers.zones"  # entry points are not read for what is there
    with pytest.raises(TwilightError, match=r"zones of twilight\.solvers has a name that is taken"):
        list(registry)
    registry = registry_with(monkeypatch, "mine", "no_such_module")
    with pytest.raises(TwilightError, match=r"mine: the entry point no_such_module .* cannot be loaded"):
        registry.load("mine")
    with pytest.raises(KeyError):
        registry.load("other")


def test_a_module_that_is_no_solver_says_what_it_lacks(monkeypatch):
    """A module that is no solver would be a traceback."""
    monkeypatch.setitem(solvers.SOLVERS, "json", "json")
    with pytest.raises(TwilightError, match="json: json is no solver; it lacks CAPABILITIES, QUALITIES, prepare"):
        solvers.load("json")
