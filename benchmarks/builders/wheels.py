"""Everything that a release uploads, into dist/: the sdist, and from it a wheel with compiled kernels for each Python.

    python benchmarks/builders/wheels.py                      3.11, 3.12 and 3.13, kernels of `zones`
    python benchmarks/builders/wheels.py 3.13 --kernels ""    one pure wheel

`uv` fetches the Pythons that are not there; `twine check` reads what was made (`pip install uv twine`).
"""

import argparse
import os
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]


def main() -> None:
    """Build and check."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("pythons", nargs="*", default=["3.11", "3.12", "3.13"])
    parser.add_argument("--kernels", default="zones", help="solvers whose machine code the wheels bring")
    parser.add_argument("--output", type=Path, default=ROOT / "dist")
    given = parser.parse_args()
    build = [sys.executable, "-m", "uv", "build", "--out-dir", str(given.output)]
    subprocess.run([*build, "--sdist", str(ROOT)], check=True)
    sdist = max(given.output.glob("twilight_sky-*.tar.gz"), key=lambda path: path.stat().st_mtime)
    for python in given.pythons:
        environment = {**os.environ, "TWILIGHT_KERNELS": given.kernels}
        subprocess.run([*build, "--wheel", "--python", python, str(sdist)], check=True, env=environment)
    made = sorted(str(path) for path in given.output.glob("twilight_sky-*"))
    subprocess.run([sys.executable, "-m", "twine", "check", "--strict", *made], check=True)


if __name__ == "__main__":
    main()
