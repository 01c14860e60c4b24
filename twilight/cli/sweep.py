"""`twilight sweep`: many skies into one dataset."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated, Any

import typer

from twilight.base.errors import TwilightError
from twilight.base.extras import require
from twilight.cli import options
from twilight.cli.options import MAX_WORKERS, EndsIn, Within, argument, option
from twilight.cli.terminal import print_table, progress_bar, time_of

LISTED_SCENES = 5
"""Scenes of each reason that are named; all are in the dataset's journal."""


def sweep(
    scene: Annotated[str, argument("CONFIG", "Name or file of a configuration with `vary`.", options.config_names)],
    scheduler: Annotated[
        str | None, option("ADDRESS", "A running Dask scheduler, e.g. tcp://10.0.0.1:8786; without it, this machine.")
    ] = None,
    batch_system: Annotated[
        str | None, option("NAME", "Jobs of slurm, pbs, sge, lsf, htcondor, oar or moab, as jobqueue.yaml says.")
    ] = None,
    workers: Annotated[
        int | None, option("N", "Processes on this machine (default: its cores), or jobs."), Within(1, MAX_WORKERS)
    ] = None,
    threads: Annotated[
        int | None, option("N", "Of each worker; without it, cores are shared evenly."), Within(1, MAX_WORKERS)
    ] = None,
    settings: Annotated[list[str] | None, options.SETTINGS] = None,
    output: Annotated[
        Path | None, option("DIR.zarr", "The dataset; continued where it is there."), EndsIn([".zarr"])
    ] = None,
    plan: Annotated[bool, options.ONLY_PLAN] = False,
) -> None:
    """Compute the skies of a configuration's `vary` section into one dataset for xarray. A rerun continues."""
    from twilight.base.whole_files import check_folder
    from twilight.config.load import load_axes, warn_of_slips
    from twilight.scene.suns import count_suns
    from twilight.studies.sweep.sweep import Sweep

    require("sweep", "dask", "distributed", "xarray", "zarr")
    resources = resources_of(scheduler, batch_system, workers, threads)
    chosen, names = options.settings_of(settings)
    series = load_axes(scene, chosen, names, ("configs",))
    if not series.axes and count_suns(series.config({})) == 1:
        raise TwilightError(
            f"{scene}: varies nothing: a sweep needs a section vary, e.g. "
            "{aerosol.relative_humidity_percent: [50, 80, 95]}, or several suns; `twilight render` computes one sky"
        )
    with progress_bar() as bar:
        job = Sweep(series, bar)
    warn_of_slips(*job.ends())
    if (drawn := job.drawn) is not None:
        held = len(drawn.held_out)
        print(f"{drawn.size - held:,} draws to train with, {held:,} for validation", file=sys.stderr if plan else None)
    name = options.file_stem(job.first.name or Path(scene).stem, "sweep")
    path = output or Path("out") / f"{name}.zarr"
    if plan:
        print_plan(job, path)
        return
    check_folder(path.parent)
    run_sweep_into(job, path, resources)


def resources_of(scheduler: str | None, batch_system: str | None, workers: int | None, threads: int | None) -> Any:
    """Where to compute, as `Resources`.  Errors: TwilightError for options that do not go together."""
    from twilight.base.sections import unknown
    from twilight.studies.sweep.run import BATCH_SYSTEMS, Resources, check_installed

    if batch_system is not None and batch_system not in BATCH_SYSTEMS:
        raise TwilightError(f"--batch-system: {batch_system} {unknown(batch_system, BATCH_SYSTEMS, 'batch system')}")
    if scheduler is not None and (batch_system is not None or workers is not None):
        raise TwilightError("--scheduler: a running scheduler has its own workers; no --workers, no --batch-system")
    resources = Resources(scheduler, batch_system, workers, threads)
    check_installed(resources)
    return resources


def run_sweep_into(job: Any, path: Path, resources: Any) -> None:
    """Compute what the dataset of a sweep lacks and say how it went."""
    from twilight.studies.sweep.run import SweepOutcome, connect, failures, run_sweep
    from twilight.studies.sweep.store import open_store

    with open_store(path, job) as store, progress_bar() as bar:
        had = len(store.done)
        if store.damaged:
            print(f"twilight: {store.damaged:,} tasks whose files are damaged are computed again", file=sys.stderr)
        bar("starting workers", 0.0)
        outcome = SweepOutcome()
        if had < len(job.tasks):
            with connect(resources) as client:
                outcome = run_sweep(client, store, threads=resources.threads, progress=bar)
        reasons = list(failures(store, outcome))
    if reasons:
        rows = [[str(len(scenes)), _examples(job, scenes), reason] for reason, scenes in reasons]
        print_table(["scenes", "such as", "failed because"], rows, right=(0,))
    before = f" ({had} tasks were there)" if had else ""
    print(
        f"{outcome.skies:,} skies in {outcome.tasks:,} tasks{before}, {outcome.wall_s:.1f} s, "
        f"{outcome.cpu_s:.1f} s of processor time"
    )
    print(f"wrote {path}: xarray.open_zarr({str(path)!r})")
    failed = sum(len(scenes) for _, scenes in reasons)
    if failed:
        print(f"twilight: {failed:,} of {job.scenes:,} scenes failed", file=sys.stderr)
        raise typer.Exit(1)


def _examples(job: Any, scenes: list[tuple[int, ...]]) -> str:
    text = ", ".join(job.label(scene) for scene in scenes[:LISTED_SCENES])
    return text + (", ..." if len(scenes) > LISTED_SCENES else "")


def print_plan(job: Any, path: Path) -> None:
    """Say what a sweep computes and what of it is there."""
    from twilight.studies.sweep.store import finished_tasks

    there = finished_tasks(path, job)
    rows = [[d.name, f"{d.size:,}", "shared field" if d.shares_field else "own field"] for d in job.dimensions]
    print_table(["dimension", "size", "each value has"], rows, right=(1,))
    print(f"{job.scenes:,} skies of {job.fields:,} fields in {len(job.tasks):,} tasks")
    print(f"up to {job.bytes / 1e9:.3g} GB in {path}")
    missing = len(job.tasks) - len(there)
    if there:
        print(f"{len(there):,} of {len(job.tasks):,} tasks are there already")
        if missing:
            seconds = sum(there) / len(there) * missing
            print(f"the rest takes some {time_of(seconds)} of processor time, as those did")
    elif (planned := job.planned_cpu_s()) is not None:
        print(f"some {time_of(planned)} of processor time, by what its solver says of its fields")
    else:
        print("how long it takes is not known before a task is finished; interrupt the sweep and ask again")
