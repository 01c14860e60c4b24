"""What a sweep costs: a field, a sky, one and two workers, 1,000 skies; from these, on paper, 10^6.

    python benchmarks/sweep.py [CONFIG] [--set KEY=VALUE ...]

Three runs of the same sweep, each on machine code that is there: one worker with one thread, one worker with two
threads, two workers with one thread each.  Processor time hardly depends on what else the machine does; `busy` is the
share of the workers' wall time that went into tasks, and the rest is Dask and the dataset.

Writes benchmarks/sweep.csv, of another CONFIG than sweep-haze benchmarks/CONFIG.csv: `sweep-compact` is 1,000 skies by
the compact model.
"""

from __future__ import annotations

import argparse
import tempfile
from pathlib import Path

import numpy as np
import results

from twilight.batch.cluster import Place, connect
from twilight.batch.run import run_sweep
from twilight.batch.store import open_store
from twilight.batch.sweep import Sweep
from twilight.config.load import load_axes, parse_setting

PLACES = ((1, 1), (1, 2), (2, 1))
HOURS_PER_S = 1.0 / 3600.0


def main() -> None:
    """Measure and write the table."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("config", nargs="?", default="sweep-haze")
    parser.add_argument("--set", dest="settings", nargs="*", default=[], metavar="KEY=VALUE")
    options = parser.parse_args()
    settings = dict(parse_setting(text) for text in options.settings)
    warm = Sweep(load_axes(options.config, settings | {"vary": {"sun.elevation_deg": [5.0, -4.0]}}))
    measured(warm, 1, 1)
    sweep = Sweep(load_axes(options.config, settings))
    notes = [f"{options.config} {settings}: {sweep.scenes} skies of {sweep.fields} fields, {len(sweep.tasks)} tasks"]
    print(notes[0])
    per_sky, rows = [], []
    for workers, threads in PLACES:
        wall, cpu, inside, size = measured(sweep, workers, threads)
        per_sky.append(cpu / sweep.scenes)
        busy = inside / (workers * wall)
        row = (wall, cpu, 1e3 * cpu / sweep.scenes, busy, size / sweep.scenes, size / sweep.bytes)
        rows.append([workers, threads, *(f"{x:.4g}" for x in row)])
        print(*rows[-1], sep="\t", flush=True)
    cost = float(np.median(per_sky))
    notes.append(f"1,000 skies: {1e3 * cost:.0f} s of processor time; 1,000,000: {1e6 * cost * HOURS_PER_S:.0f} h")
    print(notes[1])
    columns = "workers threads wall_s cpu_s cpu_ms_per_sky busy bytes_per_sky compressed_share".split()
    name = "sweep" if options.config == parser.get_default("config") else Path(options.config).stem
    results.write(Path(__file__).with_name(f"{name}.csv"), columns, rows, notes=notes)


def measured(sweep: Sweep, workers: int, threads: int) -> tuple[float, float, float, int]:
    """(wall seconds, processor seconds of the workers, wall seconds inside tasks, bytes on disk) of one run."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "sweep.zarr"
        with open_store(path, sweep) as store, connect(Place(workers=workers, threads=threads)) as client:
            client.wait_for_workers(workers)
            outcome = run_sweep(client, store, threads=threads)
            inside = sum(entry["wall_s"] for entry in store.done.values())
        size = sum(f.stat().st_size for f in path.rglob("*") if f.is_file())
    if outcome.failed:
        raise SystemExit(f"a task failed: {next(iter(outcome.failed.values()))}")
    return outcome.wall_s, outcome.cpu_s, inside, size


if __name__ == "__main__":
    main()
