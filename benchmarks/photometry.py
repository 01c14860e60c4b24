"""Computed illuminance and zenith luminance against photometers: python benchmarks/photometry.py [draft]

Runs `twilight validate photometry` on one climate under a measured stratosphere and under OPAC's own, and writes
benchmarks/photometry/points.csv, levels.csv, moonlit.csv and docs/photometry.png.
With `draft`: one climate at that quality, into *_draft.csv, in a tenth of the time.
"""

from __future__ import annotations

import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

import results

ROOT = Path(__file__).resolve().parents[1]
HERE = ROOT / "benchmarks" / "photometry"


def main() -> None:
    draft = sys.argv[1:] == ["draft"]
    words = ["--quality", "draft"] if draft else sorted(str(path) for path in HERE.glob("*.yaml"))
    with tempfile.TemporaryDirectory() as folder:
        command = [sys.executable, "-c", "from twilight.cli import main; main()", "validate", "photometry"]
        subprocess.run([*command, "continental-average", *words, "--output", folder], cwd=ROOT, check=True)
        for name in ("points.csv", "levels.csv", "moonlit.csv"):
            results.stamp(Path(folder) / name, HERE / (name.replace(".csv", "_draft.csv") if draft else name))
        shutil.copyfile(Path(folder) / "photometry.png", ROOT / "docs" / "photometry.png")


if __name__ == "__main__":
    main()
