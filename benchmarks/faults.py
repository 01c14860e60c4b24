"""Programs that are killed and caches that two fill at once.

    python benchmarks/faults.py [TIMES_OF_EACH_KIND] [SEED] [KIND]

A render of a series, a sweep, a comparison and an estimate from a photograph are killed (signal 9, with all their
processes) at a random moment of the time that they take undisturbed, and the same command is given again.  A Dask
scheduler is killed under a sweep, which must say so in one sentence, and the sweep is given again on this machine.  Two
renders fill one empty cache folder at once.  A fault is a traceback, an exit status that is not 0 in the end, or a
result that differs from the undisturbed one.

Writes benchmarks/faults.csv: kind, times, killed while it ran, faults, seed; a KIND alone (compare, scheduler, cold,
...) is told and not written.
"""

from __future__ import annotations

import csv
import json
import os
import random
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import results
import xarray as xr

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests"))

from photographs import latlong, take

COMMON = """\
version: 1
climate: {version: 1, name: test, refraction: {model: none}}
wavelengths: {list_nm: [450, 550, 650]}
texture: {azimuth_count: 24, elevation_count: 6}
output: {width: 64, spectral_width: 32}
"""
SERIES = COMMON + "sun: {elevations_deg: [40, 35, 30, 25, 20, 15]}\nsolver: {name: cie, turbidity: 3}\n"
SWEPT = COMMON + (
    "solver: {name: cie}\nvary: {solver.turbidity: [2, 2.5, 3, 3.5, 4, 5], sun.elevation_deg: [40, 20, 10]}\n"
)
SEEN = (
    "version: 1\nclimate: continental-average\nsun: {elevation_deg: 20}\nsolver: {name: preetham}\n"
    "texture: {resolution_deg: 6}\n"
)
COMPARED = COMMON + "sun: {elevation_deg: 30}\nsolver: {name: cie, turbidity: 3}\n"
SOLVED = COMMON + "sun: {elevation_deg: -4}\nsolver: {name: zones, quality: draft, max_events: 2, tolerance: 0}\n"
LONGEST_S = 300.0


def start(folder: Path, *arguments: str, program: str = "from twilight.cli import main; main()", **more: str):
    """A process of its own group, which is killed with all that it started."""
    return subprocess.Popen(
        [sys.executable, "-c", program, *arguments],
        cwd=folder,
        env={**os.environ, **more},
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )


def finish(process: subprocess.Popen) -> tuple[int, str]:
    """(exit status, what it said of errors)."""
    try:
        errors = process.communicate(timeout=LONGEST_S)[1]
    except subprocess.TimeoutExpired:
        kill(process)
        errors = process.communicate()[1] + "Traceback: it hung"
    return process.returncode, errors


def kill(process: subprocess.Popen) -> None:
    try:
        os.killpg(process.pid, signal.SIGKILL)
    except ProcessLookupError:
        pass


def skies(folder: Path) -> dict[str, np.ndarray]:
    from twilight.io import read_latlong_exr, read_sky

    found = {}
    for file in sorted(folder.rglob("sky.h5")):
        found[str(file.relative_to(folder))] = read_sky(file).sun_normalised_radiance
    for file in sorted(folder.rglob("sky.rgb.exr")):
        found[str(file.relative_to(folder))] = read_latlong_exr(file).rgb
    return found


def dataset(folder: Path) -> dict[str, np.ndarray]:
    with xr.open_zarr(folder / "out.zarr") as data:
        return {name: data[name].values for name in ("sun_normalised_radiance", "status")}


def compared(folder: Path) -> dict[str, np.ndarray]:
    """Errors of every solver and the referee's radiances, without the times, which differ from run to run."""
    found = {}
    for file in sorted((folder / "out").glob("*.csv")):
        with open(file, newline="") as lines:
            rows = list(csv.DictReader(line for line in lines if not line.startswith("#")))
        for column in rows[0]:
            if column.endswith(("_percent", "_per_sr")):
                found[f"{file.name} {column}"] = np.array([row[column] for row in rows])
    return found


def estimated(folder: Path) -> dict[str, np.ndarray]:
    """What was found in the photograph, and the air that was written."""
    files = (folder / "out" / name for name in ("estimate.json", "climate.yaml"))
    return {file.name: np.array(file.read_text(encoding="utf-8")) for file in files}


def photograph() -> tuple[bytes, bytes]:
    """A photograph of SEEN and its camera, as files."""
    from twilight.camera import write_camera
    from twilight.camera.image import write_exr
    from twilight.config import load
    from twilight.engine import run

    settings = {"sun.elevation_deg": 20.0, "solver.name": "preetham", "texture.resolution_deg": 6}
    camera = latlong(180)
    with tempfile.TemporaryDirectory() as name:
        image, file = Path(name) / "photo.exr", Path(name) / "camera.yaml"
        write_exr(image, take(run(load("continental-average", settings)), camera, 0.0))
        write_camera(file, camera)
        return image.read_bytes(), file.read_bytes()


COMMANDS: dict[str, tuple[str, list[str], Callable[[Path], dict[str, np.ndarray]]]] = {
    "render": (SERIES, ["render", "scene.yaml", "--output", "out"], skies),
    "sweep": (SWEPT, ["sweep", "scene.yaml", "--output", "out.zarr", "--workers", "2"], dataset),
    "compare": (
        COMPARED,
        ["compare", "scene.yaml", "--solvers", "cie,preetham", "--reference-stderr", "0.05", "--directions", "4",
         "--repeats", "1", "--output", "out"],
        compared,
    ),
    "estimate": (
        SEEN,
        ["validate", "estimate", "photo.exr", "--camera", "camera.yaml", "--config", "scene.yaml", "--types",
         "continental_average", "--parameters", "none", "--resolution", "6", "--library", "skies", "--output", "out"],
        estimated,
    ),
}  # fmt: skip


def same(one: dict[str, np.ndarray], other: dict[str, np.ndarray]) -> bool:
    return bool(one) and one.keys() == other.keys() and all(np.array_equal(one[key], other[key]) for key in one)


def folder_with(place: Path, name: str, text: str) -> Path:
    folder = place / name
    folder.mkdir()
    (folder / "scene.yaml").write_text(text)
    for file in (place / "photo.exr", place / "camera.yaml"):
        if text == SEEN:
            (folder / file.name).write_bytes(file.read_bytes())
    return folder


def killed(place: Path, kind: str, times: int, rng: random.Random) -> tuple[int, list[str]]:
    """(how many were killed before their end, faults)."""
    text, arguments, read = COMMANDS[kind]
    for calm in (folder_with(place, f"{kind}-first", text), folder_with(place, f"{kind}-calm", text)):
        began = time.monotonic()  # of the second, which has compiled nothing
        status, errors = finish(start(calm, *arguments))
        assert status == 0, errors
        takes, truth = time.monotonic() - began, read(calm)
    assert truth
    hit, faults = 0, []
    for i in range(times):
        folder = folder_with(place, f"{kind}-{i}", text)
        process = start(folder, *arguments)
        time.sleep(rng.random() * takes)
        kill(process)
        hit += finish(process)[0] != 0
        status, errors = finish(start(folder, *arguments))
        if status != 0 or "Traceback" in errors:
            faults.append(f"{kind} {i}: {status} {errors}")
        elif not same(read(folder), truth):
            faults.append(f"{kind} {i}: another result")
    return hit, faults


def scheduler_killed(place: Path, times: int, rng: random.Random) -> tuple[int, list[str]]:
    hit, faults = 0, []
    calm = folder_with(place, "scheduler-calm", SWEPT)
    assert finish(start(calm, *COMMANDS["sweep"][1]))[0] == 0
    for i in range(times):
        folder = folder_with(place, f"scheduler-{i}", SWEPT)
        address = folder / "scheduler.json"
        servers = []
        for name, *more in (("scheduler", "--port", "0"), ("worker", "--nthreads", "1", "--no-nanny")):
            program = f"from distributed.cli.dask_{name} import main; main()"
            servers.append(start(folder, "--scheduler-file", str(address), "--no-dashboard", *more, program=program))
            deadline = time.monotonic() + LONGEST_S
            while not address.exists() and time.monotonic() < deadline:
                time.sleep(0.05)
        sweep = ["sweep", "scene.yaml", "--output", "out.zarr"]
        process = start(folder, *sweep, "--scheduler", json.loads(address.read_text())["address"])
        deadline = time.monotonic() + LONGEST_S
        while not (folder / "out.zarr").exists() and process.poll() is None and time.monotonic() < deadline:
            time.sleep(0.02)
        time.sleep(rng.random() * 2.0)
        kill(servers[0])
        status, errors = finish(process)
        kill(servers[1])
        for server in servers:
            server.communicate()
        hit += status != 0
        if "Traceback" in errors or status not in (0, 2) or (status == 2 and len(errors.strip().splitlines()) != 1):
            faults.append(f"scheduler {i}: {status} {errors}")
        status, errors = finish(start(folder, *sweep, "--workers", "1"))
        if status != 0 or "Traceback" in errors or not same(dataset(folder), dataset(calm)):
            faults.append(f"scheduler {i}, again: {status} {errors}")
    return hit, faults


def cold_caches(place: Path, times: int) -> tuple[int, list[str]]:
    faults = []
    for i in range(times):
        cache = place / f"cache-{i}"
        folders = [folder_with(place, f"cold-{i}-{k}", SOLVED) for k in range(2)]
        environment = {"TWILIGHT_CACHE_DIR": str(cache), "TWILIGHT_CACHE_GB": "1"}
        arguments = ["render", "scene.yaml", "--output", "out"]
        both = [start(folder, *arguments, **environment) for folder in folders]
        ends = [finish(process) for process in both]
        third = folder_with(place, f"cold-{i}-2", SOLVED)
        ends.append(finish(start(third, *arguments, **environment)))  # which reads what the two left
        found = [skies(folder) for folder in (*folders, third)]
        if any(status != 0 or "Traceback" in errors for status, errors in ends):
            faults.append(f"caches {i}: {ends}")
        elif not (same(found[0], found[1]) and same(found[0], found[2])):
            faults.append(f"caches {i}: the skies differ")
    return 0, faults


def main() -> int:
    times = int(sys.argv[1]) if len(sys.argv) > 1 else 5
    seed = int(sys.argv[2]) if len(sys.argv) > 2 else 1
    rng = random.Random(seed)
    rows, worst = [], 0
    only = sys.argv[3] if len(sys.argv) > 3 else ""
    with tempfile.TemporaryDirectory() as name:
        place = Path(name)
        for file, content in zip(("photo.exr", "camera.yaml"), photograph(), strict=True):
            (place / file).write_bytes(content)
        kinds: dict[str, Callable[[], tuple[int, list[str]]]] = {
            f"{kind} killed": lambda kind=kind: killed(place, kind, times, rng)  # type: ignore[misc]
            for kind in COMMANDS
        }
        kinds["Dask scheduler killed"] = lambda: scheduler_killed(place, times, rng)
        kinds["two cold caches filled at once"] = lambda: cold_caches(place, times)
        for kind, run in kinds.items():
            if only not in kind:
                continue
            hit, faults = run()
            print(f"{kind}: {times} times, {hit} while it ran, {len(faults)} faults", *faults, sep="\n", flush=True)
            rows.append((kind, times, hit, len(faults), seed))
            worst = max(worst, len(faults))
    if not only:
        columns = ("kind", "times", "killed while it ran", "faults", "seed")
        results.write(Path(__file__).with_name("faults.csv"), columns, rows)
    return 1 if worst else 0


if __name__ == "__main__":
    sys.exit(main())
