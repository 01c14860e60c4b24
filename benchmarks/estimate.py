"""How long `twilight validate estimate` takes for a first photograph, and for the next of its kind.

    python benchmarks/estimate.py FOLDER_OF_PHOTOS [--beside CHECKOUT] [--part low,dawn,beside]

The panoramas are those of benchmarks/photos.py.  Kernels are compiled before anything is measured; the folder of kept
skies is empty at first, and the next photograph finds what the first has left.  The next one of the same sun is the
same panorama; of another sun, it again with the sun 0.2 deg higher.  CHECKOUT is another version of the program, whose
figures are measured in turn with these, for a first photograph and one aerosol type.  With --part the other rows of the
table stay as they are, with the commit that they were made at.  Processor seconds are those of all processes of a
command, wall seconds those of this machine as it was.  Writes benchmarks/estimate.csv.
"""

from __future__ import annotations

import argparse
import json
import os
import re
import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any, NamedTuple

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
HEAD = ["program", "case", "types", "wall_s", "processor_s", "load_average", "best_type"]
HEAD += ["optical_depth_550nm", "relative_humidity_percent", "ozone_du", "albedo", "sun_elevation_deg", "commit"]
COMMAND = "python benchmarks/estimate.py ../shared/data/photos --beside OLD"
ONE = "continental_average"
ALL = "continental_average,maritime_clean,desert,urban"


class Case(NamedTuple):
    """A photograph, the sun of its scene, and what the user's cache holds."""

    name: str
    photo: str
    sun: str
    keeps: str


CASES = (
    Case("sun known, first photograph", "pmndrs_sunset.hdr", "{elevation_deg: 3.0}", "low"),
    Case("sun known, the same sun again", "pmndrs_sunset.hdr", "{elevation_deg: 3.0}", "low"),
    Case("sun known, another sun", "pmndrs_sunset.hdr", "{elevation_deg: 3.2}", "low"),
    Case("sun unknown, first photograph", "kiara_1_dawn_1k.hdr", "{elevations_deg: [-6, -2]}", "dawn"),
    Case("sun unknown, again", "kiara_1_dawn_1k.hdr", "{elevations_deg: [-6, -2]}", "dawn"),
)


def seconds(root: Path, case: Case, types: str, photos: Path, folder: Path) -> tuple[float, float, Any]:
    """(wall, processor) seconds of the command of the program at `root`, and the estimate of its best type."""
    scene = folder / "scene.yaml"
    scene.write_text(SCENE.replace("SUN", case.sun))
    out = folder / "out"
    env = {**os.environ, "PYTHONPATH": str(root), "TWILIGHT_CACHE_GB": "2"}
    env |= {"TWILIGHT_CACHE_DIR": str(folder / f"cache-{case.keeps}")}
    words = ["validate", "estimate", str(photos / case.photo), "--config", str(scene), "--white-balance"]
    words += ["--types", types, "--output", str(out)]
    before, begin = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter()
    done = subprocess.run([sys.executable, "-P", "-m", "twilight", *words], cwd=folder, env=env, capture_output=True)
    wall, after = time.perf_counter() - begin, resource.getrusage(resource.RUSAGE_CHILDREN)
    if done.returncode:
        raise SystemExit(f"{root}: {done.stderr.decode()[-2000:]}")
    best = json.loads((out / "estimate.json").read_text())["estimates"][0]
    return wall, after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime, best


def compiled(root: Path, photos: Path) -> None:
    """Compile what the command needs, in a run of one climate's sky."""
    with tempfile.TemporaryDirectory() as made:
        folder = Path(made)
        (folder / "scene.yaml").write_text(SCENE.replace("SUN", "{elevation_deg: 3.0}"))
        env = {**os.environ, "PYTHONPATH": str(root), "TWILIGHT_CACHE_GB": "0"}
        words = ["validate", "photo", str(photos / "pmndrs_sunset.hdr"), "--config", str(folder / "scene.yaml")]
        words += ["--resolution", "6", "--output", str(folder / "out")]
        subprocess.run([sys.executable, "-P", "-m", "twilight", *words], cwd=folder, env=env, check=True)


def row(program: str, case: Case, types: str, found: tuple[float, float, Any]) -> list[str]:
    """A line of the table."""
    wall, processor, best = found
    fitted = [
        f"{best['parameters'][p]['value']:.3g} +- {best['parameters'][p]['standard_error']:.1g}"
        if p in best["parameters"]
        else ""
        for p in ("aerosol", "humidity", "ozone", "albedo", "sun")
    ]
    made = [program, case.name, str(types.count(",") + 1), f"{wall:.1f}", f"{processor:.1f}"]
    made += [f"{os.getloadavg()[0]:.1f}", best["aerosol_type"], *fitted]
    print(*made, sep="\t", flush=True)
    return made


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("photos", type=Path)
    parser.add_argument("--beside", type=Path)
    parser.add_argument("--part", default="low,dawn,beside", help="low,dawn,beside")
    options = parser.parse_args()
    photos, parts, path = options.photos.resolve(), options.part.split(","), ROOT / "benchmarks" / "estimate.csv"
    found = re.search(r"commit (.*?):", results.heading("x"))
    here = found[1] if found else ""
    rows = {tuple(row.values())[:3]: list(row.values()) for row in results.read_rows(path)} if path.exists() else {}

    def take(program: str, root: Path, case: Case, types: str, commit: str, folder: Path) -> None:
        made = [*row(program, case, types, seconds(root, case, types, photos, folder)), commit]
        rows[tuple(made[:3])] = made
        results.write(path, HEAD, rows.values(), notes=[f"{len(os.sched_getaffinity(0))} cores"], command=COMMAND)

    compiled(ROOT, photos)
    with tempfile.TemporaryDirectory() as made:
        for case in CASES:
            if case.keeps in parts:
                take("this program", ROOT, case, ALL, here, Path(made))
    if options.beside is not None and "beside" in parts:
        root = options.beside.resolve()
        git = subprocess.run(["git", "log", "-1", "--format=%h"], cwd=root, capture_output=True, text=True)
        compiled(root, photos)
        for program, where, commit in (("this program", ROOT, here), ("before", root, git.stdout.strip())):
            with tempfile.TemporaryDirectory() as made:
                take(program, where, CASES[0], ONE, commit, Path(made))


if __name__ == "__main__":
    main()
