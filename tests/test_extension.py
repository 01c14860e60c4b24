"""Packages of others add solvers and file formats: the example of the docs, installed and used."""

from __future__ import annotations

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

ROOT = Path(__file__).resolve().parents[1]
EXAMPLE = ROOT / "docs" / "examples" / "extension"
SMALL = ("--set", "texture.resolution_deg=15", "--set", "wavelengths.list_nm=[450, 550, 650]")


@pytest.fixture(scope="module")
def installed(tmp_path_factory):
    """A folder with the example package, as pip installs it."""
    folder = tmp_path_factory.mktemp("site")
    pip = [sys.executable, "-m", "pip", "install", "-q", "--no-deps", "--no-build-isolation", "--target", folder]
    subprocess.run([*pip, EXAMPLE], check=True, capture_output=True, cwd=folder)
    return folder


def twilight(installed, folder, *words):
    env = {**os.environ, "PYTHONPATH": os.pathsep.join([str(installed), str(ROOT)])}
    command = [sys.executable, "-m", "twilight", *words]
    return subprocess.run(command, cwd=folder, env=env, capture_output=True, text=True, timeout=120)


def test_a_solver_and_a_format_of_another_package_are_used_by_their_names(installed, tmp_path):
    words = [
        "render",
        "pure-air",
        "--sun-elevation",
        "5",
        "--solver",
        "uniform",
        "--set",
        "solver.radiance=0.02",
        *SMALL,
    ]
    done = twilight(installed, tmp_path, *words, "--only", "luminance-csv,h5", "--output", "out")
    assert done.returncode == 0, done.stderr
    assert {"sky.h5", "sky.luminance.csv"} <= {path.name for path in (tmp_path / "out").iterdir()}
    luminance = np.loadtxt(tmp_path / "out" / "sky.luminance.csv", delimiter=",")
    assert luminance.shape == (6, 24) and luminance.min() > 0.0 and np.ptp(luminance) == 0.0
    again = twilight(installed, tmp_path, *words, "--only", "luminance-csv,h5", "--output", "out")
    assert again.returncode == 0 and "1 of 1 were there already" in again.stderr
    listed = twilight(installed, tmp_path, "solvers", "uniform").stdout
    assert "sun-normalised [sr^-1]" in listed


def test_a_slip_in_its_options_is_one_sentence(installed, tmp_path):
    words = ("render", "pure-air", "--sun-elevation", "5", "--solver", "uniform", *SMALL)
    done = twilight(installed, tmp_path, *words, "--set", "solver.radiance=-1")
    assert done.returncode == 2 and "allowed is 0 and more" in done.stderr and "Traceback" not in done.stderr
    done = twilight(installed, tmp_path, *words, "--set", "solver.radiants=1")
    assert done.returncode == 2 and "did you mean radiance" in done.stderr


def test_without_the_package_its_names_are_unknown(tmp_path):
    done = twilight(tmp_path, tmp_path, "render", "pure-air", "--solver", "uniform", "--sun-elevation", "5")
    assert done.returncode == 2 and "uniform is not a solver" in done.stderr
    done = twilight(tmp_path, tmp_path, "render", "pure-air", "--only", "luminance-csv", "--sun-elevation", "5")
    assert done.returncode == 2 and "is not a file of a render" in done.stderr


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
    monkeypatch.setitem(solvers.SOLVERS, "json", "json")
    with pytest.raises(TwilightError, match="json: json is no solver; it lacks CAPABILITIES, QUALITIES, prepare"):
        solvers.load("json")
