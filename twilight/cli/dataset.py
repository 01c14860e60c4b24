"""`twilight dataset`: a training set of skies."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated

from twilight.base.errors import TwilightError
from twilight.cli import options
from twilight.cli.options import argument, option
from twilight.cli.sweep import print_plan, resources_of, run_sweep_into
from twilight.cli.terminal import progress_bar


def dataset(
    scene: Annotated[
        str, argument("CONFIG", "A climate, or a configuration with a Latin hypercube.", options.scene_names)
    ],
    airs: Annotated[int, option("N", "Airs that are drawn; each is seen under all suns.")],
    output: Annotated[Path, option("DIR.zarr", "The dataset; continued where it is there.")],
    validation: Annotated[float, option("FRACTION", "Of the airs, held back for validation.")] = 0.1,
    seed: Annotated[int, option("N", "Of the draw of the airs and of the split.")] = 0,
    solver: Annotated[
        str | None, option("NAME", "In place of the configuration's.", complete=options.solver_names)
    ] = None,
    quality: Annotated[str | None, options.QUALITY] = None,
    scheduler: Annotated[str | None, option("ADDRESS", "A running Dask scheduler; without it, this machine.")] = None,
    batch_system: Annotated[str | None, option("NAME", "Jobs of slurm, pbs and others, as in sweep.")] = None,
    workers: Annotated[int | None, options.WORKERS] = None,
    threads: Annotated[int | None, options.THREADS] = None,
    settings: Annotated[list[str] | None, options.SETTINGS] = None,
    plan: Annotated[bool, options.ONLY_PLAN] = False,
) -> None:
    """Draw airs and compute their skies under many suns into a dataset with a part for validation."""
    from twilight.base.whole_files import check_folder
    from twilight.studies.dataset.draw import VALIDATION, split_of, training_series, write_split
    from twilight.studies.sweep.sweep import Sweep

    options.check_range(airs, "--airs", 2, 100_000)
    options.check_range(seed, "--seed", 0, 2**31 - 1)
    if not 0.0 < validation < 1.0:
        raise TwilightError(f"--validation: {validation:g} is not allowed; it must be above 0 and below 1")
    resources = resources_of(scheduler, batch_system, workers, threads, output)
    chosen, names = options.settings_of(settings)
    options.put_options(chosen, names, {"solver.name": (solver, "--solver"), "solver.quality": (quality, "--quality")})
    series = training_series(scene, airs, seed, chosen, names)
    split = split_of(airs, validation, seed)
    with progress_bar() as bar:
        made = Sweep(series, bar)
    held = int((split == VALIDATION).sum())
    print(f"{airs - held:,} airs to train with, {held:,} for validation", file=sys.stderr if plan else sys.stdout)
    if plan:
        print_plan(made, output)
        return
    check_folder(output.parent)
    facts = {"airs": airs, "validation": validation, "seed": seed}
    run_sweep_into(made, output, resources, lambda path: write_split(path, split, facts))
