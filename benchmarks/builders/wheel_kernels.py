"""A wheel with compiled kernels, for processors of the level x86-64-v3 (any other compiles, as without):

    TWILIGHT_KERNELS=zones,cells python -m build --wheel

A hook of hatchling: it renders a sky by each solver named, in a copy of the package, and puts the machine code that
numba kept into the wheel, whose name then says for which Python and platform it is.  The code serves the versions of
numba and Python that made it.  Without TWILIGHT_KERNELS the wheel is pure Python.
"""

from __future__ import annotations

import os
import platform
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

from hatchling.builders.hooks.plugin.interface import BuildHookInterface

SCENES = {"zones": ("pure-air", "continental-average")}
"""Climates to render by a solver where one does not call all kernels."""


class KernelsHook(BuildHookInterface):
    """Adds the kernels of TWILIGHT_KERNELS."""

    @property
    def _solvers(self) -> list[str]:
        return [name for name in os.environ.get("TWILIGHT_KERNELS", "").split(",") if name]

    def dependencies(self) -> list[str]:
        """What rendering needs."""
        return list(self.metadata.core.dependencies) if self._solvers else []

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        """Compile, and list the files."""
        if version != "standard" or not self._solvers:
            return
        if platform.machine().lower() not in ("x86_64", "amd64"):
            raise SystemExit(f"TWILIGHT_KERNELS: there is no baseline for {platform.machine()}; leave it out")
        root = Path(self.root)
        self._folder = tempfile.mkdtemp(prefix="twilight-wheel-")
        package = Path(self._folder) / "twilight"
        shutil.copytree(root / "twilight", package, ignore=shutil.ignore_patterns("__pycache__"))
        for name in ("climates", "configs"):
            shutil.copytree(root / name, package / name)
        changed = {"NUMBA_CPU_NAME": "x86-64-v3", "NUMBA_CPU_FEATURES": "", "PYTHONPATH": self._folder}
        changed |= {"TWILIGHT_CACHE_DIR": f"{self._folder}/cache", "PYTHONDONTWRITEBYTECODE": "1"}
        environment = {key: value for key, value in os.environ.items() if key != "NUMBA_CACHE_DIR"} | changed
        for solver in self._solvers:
            for scene in SCENES.get(solver, ("continental-average",)):
                command = ["render", scene, "--sun-elevation", "-4", "--solver", solver, "--no-preview"]
                command += ["--quality", "draft", "--output", f"{self._folder}/sky", "--overwrite"]
                run = [sys.executable, "-P", "-m", "twilight", *command]
                subprocess.run(run, env=environment, cwd=self._folder, check=True)
        found = list(package.rglob("*.nb[ci]"))
        if not found:
            raise SystemExit("TWILIGHT_KERNELS: numba kept no machine code beside the modules")
        for file in found:
            build_data["force_include"][str(file)] = f"twilight/{file.relative_to(package).as_posix()}"
        build_data["pure_python"], build_data["infer_tag"] = False, True

    def finalize(self, version: str, build_data: dict[str, Any], artifact_path: str) -> None:
        """Remove the copy."""
        shutil.rmtree(getattr(self, "_folder", ""), ignore_errors=True)
