"""A wheel with kernels: whoever installs it compiles nothing."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
COUNT = """
import sys
from numba.core import event
import twilight

names = []

class Listener(event.Listener):
    def on_start(self, found):
        names.append(found.data["dispatcher"].py_func.__name__)

    def on_end(self, found):
        pass

event.register("numba:compile", Listener())
sky = twilight.render("continental-average", sun_elevation_deg=-4.0, quality="draft")
names += [module for module in ("numba.np.arraymath", "scipy.linalg") if module in sys.modules]
print(twilight.__file__, float(sky.radiance.mean()) > 0.0, "compiled:", names)
"""


@pytest.mark.slow
def test_a_wheel_with_kernels_compiles_nothing(tmp_path):
    """The first sky would take half a minute of compiling on each machine, though the wheel brings machine code; or
    half a second for what only compiling needs."""
    pytest.importorskip("hatchling")
    build = [sys.executable, "-m", "hatchling", "build", "-t", "wheel", "-d", str(tmp_path)]
    subprocess.run(build, cwd=ROOT, env={**os.environ, "TWILIGHT_KERNELS": "zones"}, check=True, capture_output=True)
    (wheel,) = tmp_path.glob("*.whl")
    assert "py3-none-any" not in wheel.name and wheel.stat().st_size < 12e6
    install = [sys.executable, "-m", "pip", "install", "--quiet", "--no-deps", "--target", str(tmp_path / "site")]
    subprocess.run([*install, str(wheel)], check=True)
    kept = {key: value for key, value in os.environ.items() if key != "NUMBA_CACHE_DIR"}
    changed = {"PYTHONPATH": str(tmp_path / "site"), "TWILIGHT_CACHE_DIR": str(tmp_path / "cache")}
    run = [sys.executable, "-c", COUNT]
    done = subprocess.run(run, cwd=tmp_path, env=kept | changed, check=True, capture_output=True, text=True)
    assert done.stdout.split()[0].startswith(str(tmp_path / "site")) and done.stdout.endswith("True compiled: []\n")
