"""Side by side with sasktran2 on exactly the same air: error against the Monte-Carlo reference, time, memory, ratios.

    python benchmarks/peers_sasktran2.py [--models sasktran2:standard zones:standard ...] [--tasks error one thirty]
                                         [--threads 1 2] [--reference TABLE.csv] [--output TABLE.csv]

Needs `pip install '.[peers]'`.  The air is the climate `continental-average` with straight light (no refraction), at
eight wavelengths from 380 to 720 nm for times and at the reference's for errors.  Every job has a process of its own.
Writes two tables: errors per model and sun, and costs per model; prints the ratios between models.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np

HERE = Path(__file__).parent
sys.path.insert(0, str(HERE))

import results  # noqa: E402
from peers.case import REFERENCE, ReferenceSolution, compare  # noqa: E402

MODELS = ("sasktran2:draft", "sasktran2:standard", "zones:draft", "zones:standard", "zones:reference")
ERROR_COLUMNS = (
    "model",
    "sun_elevation_deg",
    "median_percent",
    "mean_percent",
    "p95_percent",
    "worst_percent",
    "bias_percent",
    "reference_error_percent",
    "worst_elevation_deg",
    "worst_azimuth_deg",
    "worst_wavelength_nm",
)
COST_COLUMNS = ("model", "task", "threads", "wall_s", "cpu_s", "memory_mib", "memory_before_mib")


def run_job(folder: Path, job: dict) -> tuple[dict, np.ndarray] | None:
    """Measurements and radiances of one job; None and a line of output where it failed (no memory, no answer)."""
    name = "-".join(str(job[k]) for k in ("model", "task", "threads")).replace(":", "-")
    path = folder / f"{name}.json"
    job = job | {"output": str(folder / f"{name}.npz")}
    path.write_text(json.dumps(job))
    environment = os.environ | {"OMP_NUM_THREADS": str(job["threads"]), "OPENBLAS_NUM_THREADS": str(job["threads"])}
    environment["PYTHONPATH"] = os.pathsep.join(filter(None, (str(HERE), environment.get("PYTHONPATH"))))
    done = subprocess.run(
        [sys.executable, "-m", "peers.job", str(path)], env=environment, capture_output=True, text=True
    )
    if done.returncode:
        reason = done.stderr.strip().splitlines()[-1] if done.stderr.strip() else "no message"
        print(f"{name}: ended with code {done.returncode}: {reason}", flush=True)
        return None
    return json.loads(done.stdout.strip().splitlines()[-1]), np.load(job["output"])["radiance"]


def error_rows(model: str, reference: ReferenceSolution, radiance: np.ndarray) -> list[list]:
    """One row per sun; radiance (suns, directions, wavelengths)."""
    elevation, azimuth = reference.directions()
    place = {pair: i for i, pair in enumerate(zip(elevation.tolist(), azimuth.tolist(), strict=True))}
    wavelengths = reference.wavelengths()
    rows = []
    for sky, sun in zip(radiance, reference.suns_deg, strict=True):
        some = reference.at(sun)
        direction = [place[p] for p in zip(some.elevation_deg.tolist(), some.azimuth_deg.tolist(), strict=True)]
        found = compare(some, sky[direction, np.searchsorted(wavelengths, some.wavelength_nm)])
        numbers = (found.median, found.mean, found.p95, found.worst, found.bias, found.reference)
        rows.append([model, f"{sun:g}", *(f"{x:.2f}" for x in numbers), *(f"{x:g}" for x in found.worst_at)])
    return rows


def ratios(costs: list[list]) -> None:
    """What each sasktran2 setting costs in units of each other model at the same task and threads."""
    named = {(row[0], row[1], row[2]): [float(x) for x in row[3:6]] for row in costs}
    print("\nratio of sasktran2 to the other: processor time, wall time, peak memory")
    for (peer, task, threads), theirs in named.items():
        if not peer.startswith("sasktran2"):
            continue
        for (model, other_task, other_threads), ours in named.items():
            if model.startswith("sasktran2") or (task, threads) != (other_task, other_threads):
                continue
            print(
                f"{task:7s} {threads} threads  {peer:20s} / {model:16s}: {theirs[1] / ours[1]:7.1f}"
                f" {theirs[0] / ours[0]:7.1f} {theirs[2] / ours[2]:7.1f}"
            )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--models", nargs="+", default=list(MODELS))
    parser.add_argument("--tasks", nargs="+", default=["error", "one", "thirty"], choices=["error", "one", "thirty"])
    parser.add_argument("--threads", nargs="+", type=int, default=[1, 2])
    parser.add_argument("--reference", type=Path, default=REFERENCE / "continental-average-unrefracted.csv")
    parser.add_argument("--suns", nargs="+", type=float, help="only these of the reference solution's suns [deg]")
    parser.add_argument("--output", type=Path, default=HERE / "peers_sasktran2.csv")
    arguments = parser.parse_args()
    reference = ReferenceSolution.read(arguments.reference, arguments.suns) if "error" in arguments.tasks else None
    errors: list[list] = []
    costs: list[list] = []
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        for model in arguments.models:
            if reference is not None:
                job = {"model": model, "task": "error", "threads": max(arguments.threads)}
                done = run_job(folder, job | {"reference": str(arguments.reference), "suns": arguments.suns})
                if done is not None:
                    rows = error_rows(model, reference, done[1])
                    for row in rows:
                        print(*row, sep="\t", flush=True)
                    errors.extend(rows)
                    results.write(arguments.output, ERROR_COLUMNS, errors)
            for task in [t for t in arguments.tasks if t != "error"]:
                for threads in arguments.threads:
                    done = run_job(folder, {"model": model, "task": task, "threads": threads})
                    if done is not None:
                        measured = [f"{done[0][key]:.4g}" for key in COST_COLUMNS[3:]]
                        costs.append([model, task, str(threads), *measured])
                        print(*costs[-1], sep="\t", flush=True)
                        results.write(arguments.output.with_stem(arguments.output.stem + "_cost"), COST_COLUMNS, costs)
    ratios(costs)


if __name__ == "__main__":
    main()
