"""What a sweep costs: 10,000 skies by `compact`, their bytes, one and two workers, reading them back.

    python benchmarks/sweep.py [--set KEY=VALUE ...] [--places 1x1,1x2,2x1]

Runs of the same sweep, each on machine code that is there: WORKERSxTHREADS, 1x1 unless said otherwise.  Processor
time hardly depends on what else the machine does; `busy` is the fraction of the workers' wall time that went into
tasks, and the rest is Dask and the dataset.  `read_s`: xarray opens the dataset lazily and takes the mean radiance of
every sky, chunk by chunk.

Writes results/sweep.csv.
"""

from __future__ import annotations

import argparse
import os
import tempfile
import time
from pathlib import Path

import numpy as np
import results
import xarray

from twilight.config.load import load_axes, parse_setting
from twilight.studies.sweep.resources import Resources, connect
from twilight.studies.sweep.run import run_sweep
from twilight.studies.sweep.store import COMPUTED, open_store
from twilight.studies.sweep.sweep import Sweep

MANY = {
    "vary": {
        "aerosol.optical_depth_550nm": {"from": 0.02, "to": 0.7, "count": 10, "scale": "log"},
        "gases.ozone.column_du": [220, 280, 340, 400],
        "ground.albedo": [0, 0.2, 0.4, 0.6, 0.8],
        "sun.elevation_deg": {"from": 60, "to": -18, "count": 50},
    },
}
"""200 airs under 50 suns, on the directions and wavelengths of the configuration."""
HOURS_PER_S = 1.0 / 3600.0


def main() -> None:
    """Measure and write the table."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--set", dest="settings", nargs="*", default=[], metavar="KEY=VALUE")
    parser.add_argument("--places", default="1x1", help="WORKERSxTHREADS, with commas between")
    options = parser.parse_args()
    settings = MANY | dict(parse_setting(text) for text in options.settings)
    places = [tuple(int(n) for n in place.split("x")) for place in options.places.split(",")]
    warm = Sweep(load_axes("sweep-compact", settings | {"vary": {"sun.elevation_deg": [5.0, -4.0]}}))
    measured(warm, 1, 1)
    sweep = Sweep(load_axes("sweep-compact", settings))
    notes = [f"sweep-compact {settings}: {sweep.scenes} skies of {sweep.fields} fields, {len(sweep.tasks)} tasks"]
    print(notes[0])
    per_sky, rows = [], []
    for workers, threads in places:
        wall, cpu, inside, size, read = measured(sweep, workers, threads)
        per_sky.append(cpu / sweep.scenes)
        busy = inside / (workers * wall)
        row = (wall, cpu, 1e3 * cpu / sweep.scenes, busy, size / sweep.scenes, size / sweep.bytes, read)
        rows.append([workers, threads, *(f"{x:.4g}" for x in row)])
        print(*rows[-1], sep="\t", flush=True)
    cost = float(np.median(per_sky))
    notes.append(f"1,000 skies: {1e3 * cost:.0f} s of processor time; 1,000,000: {1e6 * cost * HOURS_PER_S:.0f} h")
    notes.append(f"load average {os.getloadavg()[0]:.1f} at the end on {len(os.sched_getaffinity(0))} cores")
    print(*notes[1:], sep="\n")
    columns = "workers threads wall_s cpu_s cpu_ms_per_sky busy bytes_per_sky compressed_share read_s".split()
    results.write(results.FOLDER / "sweep.csv", columns, rows, notes=notes)


def measured(sweep: Sweep, workers: int, threads: int) -> tuple[float, float, float, int, float]:
    """(wall seconds, processor seconds of the workers, wall seconds inside tasks, bytes on disk, seconds to read) of
    one run."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "sweep.zarr"
        with open_store(path, sweep) as store, connect(Resources(workers=workers, threads=threads)) as client:
            client.wait_for_workers(workers)
            outcome = run_sweep(client, store, threads=threads)
            inside = sum(entry["wall_s"] for entry in store.done.values())
        size = sum(f.stat().st_size for f in path.rglob("*") if f.is_file())
        if outcome.failed:
            raise SystemExit(f"a task failed: {next(iter(outcome.failed.values()))}")
        begin = time.perf_counter()
        with xarray.open_zarr(path) as dataset:
            mean = dataset["sun_normalised_radiance"].mean(("elevation", "azimuth", "wavelength")).values
            computed = dataset["status"].values == COMPUTED
        read = time.perf_counter() - begin
    if mean.size != sweep.scenes or not np.isfinite(mean[computed]).all():
        raise SystemExit(f"{mean.size} skies were read of {sweep.scenes}, not all of them whole")
    return outcome.wall_s, outcome.cpu_s, inside, size, read


if __name__ == "__main__":
    main()
