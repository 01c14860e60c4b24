"""`twilight sweep`: many skies into one dataset."""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any

import typer

from twilight.base.errors import TwilightError
from twilight.cli.options import config_names, file_stem, option, settings_of
from twilight.cli.terminal import print_table, progress_bar, time_of

LISTED_SCENES = 5
"""Scenes of each reason that are named; all are in the dataset's journal."""


def sweep(
    scene: Annotated[
        str,
        typer.Argument(
            metavar="CONFIG", help="Name or file of a configuration with `vary`.", autocompletion=config_names
        ),
    ],
    scheduler: Annotated[
        str | None, option("ADDRESS", "A running Dask scheduler, e.g. tcp://10.0.0.1:8786; without it, this machine.")
    ] = None,
    batch_system: Annotated[
        str | None, option("NAME", "Jobs of slurm, pbs, sge, lsf, htcondor, oar or moab, as jobqueue.yaml says.")
    ] = None,
    workers: Annotated[int | None, option("N", "Processes on this machine (default: its cores), or jobs.")] = None,
    threads: Annotated[int | None, option("N", "Of each worker; without it, cores are shared evenly.")] = None,
    settings: Annotated[list[str] | None, option("KEY=VALUE", "Any key; may be repeated.", "--set")] = None,
    output: Annotated[Path | None, option("DIR.zarr", "The dataset; continued where it is there.")] = None,
    plan: Annotated[bool, typer.Option("--plan", help="Only say what would be computed.")] = False,
) -> None:
    """Compute the skies of a configuration's `vary` section into one dataset for xarray. Takes up what is there."""
    from twilight.base.whole_files import check_folder
    from twilight.config.load import load_axes
    from twilight.config.slips import warn_of_slips
    from twilight.studies.sweep.sweep import Sweep

    place = place_of(scheduler, batch_system, workers, threads, output)
    chosen, names = settings_of(settings)
    series = load_axes(scene, chosen, names, ("configs",))
    with progress_bar() as bar:
        made = Sweep(series, bar)
    warn_of_slips(made.first)
    name = file_stem(made.first.name or Path(scene).stem, "sweep")
    path = output or Path("out") / f"{name}.zarr"
    if plan:
        print_plan(made, path)
        return
    check_folder(path.parent)
    run_into(made, path, place)


def place_of(
    scheduler: str | None, batch_system: str | None, workers: int | None, threads: int | None, output: Path | None
) -> Any:
    """Where to compute, as `Resources`.  Errors: TwilightError for options that do not go together, or no .zarr."""
    from twilight.config.validate import unknown
    from twilight.studies.sweep.resources import BATCH_SYSTEMS, Resources, check_installed

    for name, value in (("--workers", workers), ("--threads", threads)):
        if value is not None and not 1 <= value <= 10_000:
            raise TwilightError(f"{name}: {value} is not allowed; it must be from 1 to 10000")
    if batch_system is not None and batch_system not in BATCH_SYSTEMS:
        raise TwilightError(f"--batch-system: {batch_system} {unknown(batch_system, BATCH_SYSTEMS, 'batch system')}")
    if scheduler is not None and (batch_system is not None or workers is not None):
        raise TwilightError("--scheduler: a running scheduler has its own workers; no --workers, no --batch-system")
    if output is not None and output.suffix != ".zarr":
        raise TwilightError(f"--output: {output} must end in .zarr")
    place = Resources(scheduler, batch_system, workers, threads)
    check_installed(place)
    return place


def run_into(made: Any, path: Path, place: Any, begun: Callable[[Path], None] = lambda path: None) -> None:
    """Compute what the dataset of a sweep lacks and say how it went; `begun` is called when its folder is there."""
    from twilight.studies.sweep.resources import connect
    from twilight.studies.sweep.run import failures, run_sweep
    from twilight.studies.sweep.store import open_store

    with open_store(path, made) as store, progress_bar() as bar:
        begun(path)
        had = len(store.done)
        if store.damaged:
            print(f"twilight: {store.damaged:,} tasks whose files are damaged are computed again", file=sys.stderr)
        bar("starting workers", 0.0)
        if had < len(made.tasks):
            with connect(place) as client:
                outcome = run_sweep(client, store, threads=place.threads, progress=bar)
        else:
            from twilight.studies.sweep.run import SweepOutcome

            outcome = SweepOutcome()
        found = list(failures(store, outcome))
    if found:
        rows = [[str(len(scenes)), _some(made, scenes), reason] for reason, scenes in found]
        print_table(["scenes", "such as", "failed because"], rows, right=(0,))
    before = f" ({had} tasks were there)" if had else ""
    print(
        f"{outcome.skies:,} skies in {outcome.tasks:,} tasks{before}, {outcome.wall_s:.1f} s, "
        f"{outcome.cpu_s:.1f} s of processor time"
    )
    print(f"wrote {path}: xarray.open_zarr({str(path)!r})")
    failed = sum(len(scenes) for _, scenes in found)
    if failed:
        print(f"twilight: {failed:,} of {made.scenes:,} scenes failed", file=sys.stderr)
        raise typer.Exit(1)


def _some(made: Any, scenes: list[tuple[int, ...]]) -> str:
    text = ", ".join(made.label(scene) for scene in scenes[:LISTED_SCENES])
    return text + (", ..." if len(scenes) > LISTED_SCENES else "")


def print_plan(made: Any, path: Path) -> None:
    """Say what a sweep computes and what of it is there."""
    from twilight.studies.sweep.store import finished_tasks

    there = finished_tasks(path, made)
    rows = [[d.name, f"{d.size:,}", "shared field" if d.serves else "own field"] for d in made.dimensions]
    print_table(["dimension", "size", "each value has"], rows, right=(1,))
    print(f"{made.scenes:,} skies of {made.fields:,} fields in {len(made.tasks):,} tasks")
    print(f"up to {made.bytes / 1e9:.3g} GB in {path}")
    missing = len(made.tasks) - len(there)
    if there:
        print(f"{len(there):,} of {len(made.tasks):,} tasks are there already")
        if missing:
            seconds = sum(there) / len(there) * missing
            print(f"the rest takes some {time_of(seconds)} of processor time, as those did")
    else:
        print("how long it takes is not known before a task is finished; interrupt the sweep and ask again")
