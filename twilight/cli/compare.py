"""`twilight compare`: error against run time of the solvers on one scene."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from twilight.base.errors import TwilightError
from twilight.cli.options import file_stem, numbers, one_config, option, settings_of, within
from twilight.cli.terminal import print_table, progress_bar


def compare(
    scene: Annotated[
        str, typer.Argument(metavar="CLIMATE_OR_CONFIG", help="Name or file of a climate, or file of a configuration.")
    ],
    solvers: Annotated[
        str | None, option("NAMES", "Comma-separated, e.g. cells,montecarlo:draft; without it, all qualities of all.")
    ] = None,
    sun_elevation: Annotated[
        str | None, option("DEG,...", "True elevations of the sun; without it, the scene's, or the table's.")
    ] = None,
    reference: Annotated[
        Path | None,
        option("FILE.csv", "Stored radiances that are taken for right; without it, montecarlo makes them."),
    ] = None,
    add: Annotated[
        list[str] | None,
        option(
            "[NAME=]FILE.csv",
            "Radiances computed elsewhere, judged too; without --reference, montecarlo makes its own where they are.  "
            "Columns: sun_elevation_deg, elevation_deg, azimuth_deg from the sun, wavelength_nm, and radiance_per_sr "
            "(over the sun's irradiance) or radiance_w_per_m2_sr_nm.  May be repeated.",
        ),
    ] = None,
    reference_stderr: Annotated[
        float, option("FRACTION", "Relative standard error of the radiances that montecarlo makes.")
    ] = 0.003,
    directions: Annotated[int, option("N", "Directions of the texture in which montecarlo makes them.")] = 48,
    time_limit: Annotated[
        float, option("SECONDS", "For one solver at one quality, all suns together, and for one sun of montecarlo's.")
    ] = 900.0,
    repeats: Annotated[int, option("N", "Most timed runs of each, of which the median is given.")] = 3,
    ablations: Annotated[
        bool, typer.Option("--ablations", help="Instead: what each simplification changes, and the time it saves.")
    ] = False,
    settings: Annotated[list[str] | None, option("KEY=VALUE", "Any key; may be repeated.", "--set")] = None,
    output: Annotated[Path | None, option("DIR", "Folder for tables, picture and finished rows.")] = None,
) -> None:
    """Measure error, run time and memory of the solvers; write tables (CSV) and a picture. Takes up what is there."""
    chosen, names = settings_of(settings)
    suns = None if sun_elevation is None else numbers(sun_elevation, "--sun-elevation", -90.0, 90.0)
    within(reference_stderr, "--reference-stderr", 1e-4, 0.1)
    within(directions, "--directions", 4, 100_000)
    within(time_limit, "--time-limit", 1.0, 1e7)
    within(repeats, "--repeats", 1, 100)
    config = one_config(scene, chosen, names, "compare")
    folder = output or Path("out") / ("compare-" + file_stem(config.title, "scene"))
    if ablations:
        if solvers is not None or reference is not None or add:
            raise TwilightError(
                "--ablations: compares runs of one solver; it takes no --solvers, no --reference and no --add"
            )
        _ablate(scene, config, chosen, suns, time_limit, repeats, folder)
        return
    wanted = None if solvers is None else [name for name in solvers.split(",") if name.strip()]
    _compare(config, wanted, suns, reference, add or [], reference_stderr, directions, time_limit, repeats, folder)


def _compare(
    config: Any,
    wanted: list[str] | None,
    suns: list[float] | None,
    reference: Path | None,
    add: list[str],
    reference_stderr: float,
    directions: int,
    time_limit_s: float,
    repeats: int,
    folder: Path,
) -> None:
    from twilight.base.progress import part_of
    from twilight.base.whole_files import check_folder
    from twilight.engine import check_size
    from twilight.studies.compare import added, comparison, figure, report
    from twilight.studies.compare.bench import Bench
    from twilight.studies.compare.directions import stratified_directions, sun_elevations
    from twilight.studies.compare.reference_solution import (
        ReferenceSolver,
        read_references,
        some_suns,
        write_references,
    )

    rungs = comparison.ladder(wanted)
    tables = [added.read_added(text) for text in add]
    names = [table.name for table in tables]
    if len({*names}) < len(names) or {*names} & {rung.solver for rung in rungs}:
        raise TwilightError(f"--add: needs a name of its own for each table, NAME=FILE.csv; got {', '.join(names)}")
    if tables and reference is None:
        config = added.scene_of(config, tables[0])
        suns = tables[0].suns() if suns is None else suns
        for table in tables:
            for place in tables[0].values:
                table.value(*place)
    check_size(config)
    stored = None if reference is None else read_references(reference)
    if suns is None and (stored is None or "sun" in config.model_fields_set):
        suns = sun_elevations(config)
    references = None if stored is None else some_suns(stored, suns, str(reference))
    check_folder(folder)
    folder.mkdir(parents=True, exist_ok=True)
    rows: list[comparison.ComparisonRow] = []
    made = 0.0
    with progress_bar() as progress:
        if references is None:
            made = 0.3
            reference_solver = ReferenceSolver(config, folder / "rows", reference_stderr, time_limit_s)
            tell = part_of(progress, 0.0, made)
            if tables:
                references = added.references_of(tables[0], reference_solver, suns or [], tell)
            else:
                grid = stratified_directions(config.texture.shape, directions)
                references = reference_solver.references(suns or [], grid, tell)
            write_references(folder / "reference.csv", references)
        for table in tables:
            rows += added.rows_of(table, references, config)
        bench = Bench(folder / "rows", time_limit_s)
        steps = comparison.compare(
            config,
            rungs,
            references,
            bench,
            repeats=repeats,
            progress=part_of(progress, made, 1.0 - made),
        )
        for found in steps:
            rows += found
            report.write_tables(rows, folder)
    drawn = figure.draw(figure.points(rows), folder / "error-against-time.png", title=config.title)
    print_table(list(report.PRINTED), report.printed(rows), right=tuple(range(2, len(report.PRINTED))))
    for line in report.remarks(rows):
        print(line)
    print(f"wrote compare.csv, wavelengths.csv{', error-against-time.png' if drawn else ''} to {folder}/")


def _ablate(
    scene: str,
    config: Any,
    chosen: dict[str, Any],
    suns: list[float] | None,
    time_limit_s: float,
    repeats: int,
    folder: Path,
) -> None:
    from twilight.base.whole_files import check_folder, write_csv
    from twilight.studies.compare import ablations
    from twilight.studies.compare.bench import Bench
    from twilight.studies.compare.directions import sun_elevations

    check_folder(folder)
    folder.mkdir(parents=True, exist_ok=True)
    rows: list[ablations.AblationRow] = []
    with progress_bar() as progress:
        steps = ablations.ablate(
            scene,
            chosen,
            tuple(suns or sun_elevations(config)),
            Bench(folder / "rows", time_limit_s),
            repeats=repeats,
            progress=progress,
        )
        for found in steps:
            rows += found
            write_csv(folder / "ablations.csv", ablations.COLUMNS, ablations.lines(rows))
    print_table(list(ablations.PRINTED), ablations.printed(rows), right=tuple(range(1, len(ablations.PRINTED))))
    for name, reason in dict.fromkeys((row.name, row.reason) for row in rows if row.reason):
        print(f"{name}: {reason}")
    print(f"wrote ablations.csv to {folder}/")
