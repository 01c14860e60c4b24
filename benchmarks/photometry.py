"""Computed illuminance and zenith luminance against photometers: python benchmarks/photometry.py

Runs `twilight validate photometry` at quality draft on one climate under a measured stratosphere and under OPAC's own,
and writes results/photometry/points.csv, levels.csv, moonlit.csv and docs/photometry.png.
"""

from __future__ import annotations

import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

import results

ROOT = Path(__file__).resolve().parents[1]
HERE = results.FOLDER / "photometry"
AIRS = ("continental-average", "benchmarks/photometry/continental-opac.yaml")


def main() -> None:
    with tempfile.TemporaryDirectory() as folder:
        command = [sys.executable, "-c", "from twilight.cli import main; main()", "validate", "photometry"]
        subprocess.run([*command, *AIRS, "--quality", "draft", "--output", folder], cwd=ROOT, check=True)
        for name in ("points.csv", "levels.csv", "moonlit.csv"):
            results.stamp(Path(folder) / name, HERE / name)
        shutil.copyfile(Path(folder) / "photometry.png", ROOT / "docs" / "photometry.png")


if __name__ == "__main__":
    results.say_help(__doc__)
    main()
