"""`twilight compare`: error against run time of the solvers on one scene."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from twilight.base.extras import require
from twilight.cli import options
from twilight.cli.options import Within, argument, option
from twilight.cli.terminal import print_table, progress_bar


@dataclass(frozen=True)
class ComparisonOptions:
    """How near, where and how long solvers are compared."""

    reference_stderr: Annotated[
        float, option("FRACTION", "Relative standard error of the radiances that montecarlo makes."), Within(1e-4, 0.1)
    ] = 0.003
    directions: Annotated[
        int, option("N", "Directions of the texture in which montecarlo makes them."), Within(4, 100_000)
    ] = 48
    time_limit: Annotated[
        float,
        option("SECONDS", "For one solver at one quality, all suns together, and for one sun of montecarlo's."),
        Within(1.0, 1e7),
    ] = 900.0
    repeats: Annotated[int, option("N", "Most timed runs of each, of which the median is given."), Within(1, 100)] = 3


def compare(
    scene: Annotated[str, argument("CLIMATE_OR_CONFIG", "Name or file of a climate, or file of a configuration.")],
    limits: ComparisonOptions,
    solvers: Annotated[
        str | None, option("NAMES", "Comma-separated, e.g. cells,montecarlo:draft; without it, all qualities of all.")
    ] = None,
    sun_elevation: Annotated[
        str | None, option("DEG,...", "True elevations of the sun; without it, the scene's, or the table's.")
    ] = None,
    reference: Annotated[
        Path | None, option("FILE.csv", "Stored radiances that are taken for right; without it, montecarlo makes them.")
    ] = None,
    settings: Annotated[list[str] | None, options.SETTINGS] = None,
    output: Annotated[Path | None, option("DIR", "Folder for tables, picture and finished rows.")] = None,
) -> None:
    """Measure error, run time and memory of the solvers; write tables (CSV) and a picture. A rerun continues."""
    require("compare", "colour", "matplotlib")
    chosen, names = options.settings_of(settings)
    suns = None if sun_elevation is None else options.parse_numbers(sun_elevation, "--sun-elevation", -90.0, 90.0)
    config = options.load_one_scene(scene, chosen, names, "compare")
    from twilight.scene.usual import CLEAN

    if config.horizon is None:  # solvers without a screen are compared too
        chosen["horizon"] = "clean"
        config = config.model_copy(update={"horizon": CLEAN})
    folder = options.output_folder(output, "compare", config.title)

    from twilight.base.progress import part_of
    from twilight.engine import check_size
    from twilight.studies.compare import comparison, presets, reference_solution, report
    from twilight.studies.compare.bench import Bench
    from twilight.studies.compare.job import stratified_directions, sun_elevations

    bench = Bench(folder / "rows", limits.time_limit)
    wanted = None if solvers is None else [name for name in solvers.split(",") if name.strip()]
    wanted_presets = presets.solver_presets(wanted)
    check_size(config)
    stored = None if reference is None else reference_solution.read_references(reference)
    if suns is None and (stored is None or "sun" in config.model_fields_set):
        suns = sun_elevations(config)
    references = None if stored is None else reference_solution.select_suns(stored, suns, str(reference))
    folder.mkdir(parents=True, exist_ok=True)
    rows: list[comparison.ComparisonRow] = []
    done = 0.0
    with progress_bar() as progress:
        if references is None:
            done = 0.3
            solver = reference_solution.ReferenceSolver(
                config, folder / "rows", limits.reference_stderr, limits.time_limit
            )
            part = part_of(progress, 0.0, done)
            grid = stratified_directions(config.texture.shape, limits.directions)
            references = solver.references(suns or [], grid, part)
            reference_solution.write_references(folder / "reference.csv", references)
        part = part_of(progress, done, 1.0 - done)
        for results in comparison.compare(
            config, wanted_presets, references, bench, repeats=limits.repeats, progress=part
        ):
            rows += results
            report.write_tables(rows, folder)
    drawn = report.draw(report.points(rows), folder / "error-against-time.png", title=config.title)
    print_table(list(report.PRINTED), report.printed(rows), right=tuple(range(2, len(report.PRINTED))))
    for line in report.remarks(rows):
        print(line)
    print(f"wrote compare.csv, wavelengths.csv{', error-against-time.png' if drawn else ''} to {folder}/")
