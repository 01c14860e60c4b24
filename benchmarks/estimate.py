"""How long `twilight validate estimate` takes for a first photograph, and for the next of its kind.

    python benchmarks/estimate.py FOLDER_OF_PHOTOS

The panorama is one of benchmarks/photos.py, of four aerosol types, the sun known.  Kernels are compiled before anything
is measured; the folder of kept skies is empty at first, and the next photograph finds what the first has left.  The
next one of the same sun is the same panorama; of another sun, it again with the sun 0.2 deg higher.  Processor seconds
are those of all processes of a command, wall seconds those of this machine as it was.  Writes benchmarks/estimate.csv.
"""

from __future__ import annotations

import json
import os
import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import results

ROOT = Path(__file__).resolve().parents[1]
SCENE = """version: 1
climate:
  version: 1
  name: estimate
  atmosphere: {profile: midlatitude_summer}
  aerosol: {type: continental_average, relative_humidity_percent: 80, optical_depth_550nm: 0.15}
  ground: {albedo: 0.2}
sun: SUN
solver: {name: zones, quality: draft}
"""
PHOTOGRAPH = "pmndrs_sunset.hdr"
TYPES = "continental_average,maritime_clean,desert,urban"
FITTED = {
    "optical_depth_550nm": "aerosol",
    "relative_humidity_percent": "humidity",
    "ozone_du": "ozone",
    "albedo": "albedo",
}
"""Columns and what the estimate calls these parameters."""
HEAD = ["case", "wall_s", "processor_s", "load_average", "best_type", *FITTED]
CASES = {"first photograph": 3.0, "the same sun again": 3.0, "another sun": 3.2}
"""Cases in the order of their runs, and the elevation of the sun [deg] of their scene."""


def estimate(sun_deg: float, photos: Path, folder: Path) -> tuple[float, float, Any]:
    """(wall, processor) seconds of the command, and the estimate of its best type."""
    scene = folder / "scene.yaml"
    scene.write_text(SCENE.replace("SUN", f"{{elevation_deg: {sun_deg:g}}}"))
    out = folder / "out"
    env = {**os.environ, "PYTHONPATH": str(ROOT), "TWILIGHT_CACHE_GB": "2", "TWILIGHT_CACHE_DIR": str(folder / "cache")}
    words = ["validate", "estimate", str(photos / PHOTOGRAPH), "--config", str(scene), "--white-balance"]
    words += ["--types", TYPES, "--output", str(out)]
    before, begin = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter()
    done = subprocess.run([sys.executable, "-P", "-m", "twilight", *words], cwd=folder, env=env, capture_output=True)
    wall, after = time.perf_counter() - begin, resource.getrusage(resource.RUSAGE_CHILDREN)
    if done.returncode:
        raise SystemExit(done.stderr.decode()[-2000:])
    best = json.loads((out / "estimate.json").read_text())["estimates"][0]
    return wall, after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime, best


def compiled(photos: Path) -> None:
    """Compile what the command needs, in a run of one climate's sky."""
    with tempfile.TemporaryDirectory() as made:
        folder = Path(made)
        (folder / "scene.yaml").write_text(SCENE.replace("SUN", "{elevation_deg: 3.0}"))
        env = {**os.environ, "PYTHONPATH": str(ROOT), "TWILIGHT_CACHE_GB": "0"}
        words = ["validate", "photo", str(photos / PHOTOGRAPH), "--config", str(folder / "scene.yaml")]
        words += ["--resolution", "6", "--output", str(folder / "out")]
        subprocess.run([sys.executable, "-P", "-m", "twilight", *words], cwd=folder, env=env, check=True)


def main() -> None:
    photos = Path(sys.argv[1]).resolve()
    compiled(photos)
    rows = []
    with tempfile.TemporaryDirectory() as folder:
        for name, sun_deg in CASES.items():
            wall, processor, best = estimate(sun_deg, photos, Path(folder))
            parameters = [best["parameters"][key] for key in FITTED.values()]
            fitted = [f"{p['value']:.3g} +- {p['standard_error']:.1g}" for p in parameters]
            load = f"{os.getloadavg()[0]:.1f}"
            rows.append([name, f"{wall:.1f}", f"{processor:.1f}", load, best["aerosol_type"], *fitted])
            print(*rows[-1], sep="\t", flush=True)
    notes = [f"{len(os.sched_getaffinity(0))} cores"]
    command = "python benchmarks/estimate.py ../shared/data/photos"
    results.write(ROOT / "benchmarks" / "estimate.csv", HEAD, rows, notes=notes, command=command)


if __name__ == "__main__":
    main()
