"""`twilight frontier`: the best errors of `zones` on scenes for any run time, searched over its settings."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Annotated, Any

from twilight.base.errors import TwilightError
from twilight.cli import options
from twilight.cli.options import argument, flag, option
from twilight.cli.terminal import print_table, progress_bar

MOST_NAMED = 3
"""Most scenes that the picture names."""


def frontier(
    scenes: Annotated[
        list[str], argument("CLIMATE_OR_CONFIG...", "Scenes that the same settings are to serve: names or files.")
    ],
    reference: Annotated[
        list[Path] | None,
        option(
            "FILE.csv",
            "Stored radiances of each scene, in the same sequence; without it, quality `reference` is right.",
        ),
    ] = None,
    sun_elevation: Annotated[
        str | None, option("DEG,...", "True elevations of the sun; without it, the scene's, the table's, or nine.")
    ] = None,
    minutes: Annotated[float, option("MIN", "Processor time after which no new point is begun.")] = 10.0,
    points: Annotated[int, option("N", "Most points.")] = 200,
    longest: Annotated[
        float | None, option("S", "Processor seconds of a field, in the mean; slower points are given up.")
    ] = None,
    resume: Annotated[bool, flag("--resume", "Go on from the points.csv of an earlier search.")] = False,
    seed: Annotated[int, option("N", "Of what the search proposes.")] = 0,
    settings: Annotated[list[str] | None, options.SETTINGS] = None,
    output: Annotated[Path | None, option("DIR", "Folder for tables and picture.")] = None,
) -> None:
    """Search the settings of zones for the least error at every run time; write every point, the frontier, a picture.

    Needs optuna (the extra `search`).
    """
    from twilight.base.progress import part_of
    from twilight.studies.frontier import report, search
    from twilight.studies.frontier.measure import qualities
    from twilight.studies.frontier.space import ZONES

    search.check_installed()
    options.check_range(minutes, "--minutes", 0.0, 1e5)
    options.check_range(points, "--points", 1, 100_000)
    options.check_range(longest, "--longest", 0.01, 1e6)
    chosen, names = options.settings_of(settings)
    suns = None if sun_elevation is None else options.parse_numbers(sun_elevation, "--sun-elevation", -90.0, 90.0)
    tables = reference or []
    if tables and len(tables) != len(scenes):
        raise TwilightError(f"--reference: is given {len(tables)} times for {len(scenes)} scenes; each needs its own")
    folder = options.output_folder(output, "frontier", "-".join(Path(s).stem for s in scenes)[:80])
    configs = [_one(scene, chosen, names) for scene in scenes]
    found = report.read_points(folder / "points.csv", [Path(s).stem for s in scenes]) if resume else []
    folder.mkdir(parents=True, exist_ok=True)
    with progress_bar() as progress:
        first_part = 0.3 if not tables else 0.02
        cases = [
            _case(
                scene, config, tables[i] if tables else None, suns, part_of(progress, first_part * i / len(scenes), 0.0)
            )
            for i, (scene, config) in enumerate(zip(scenes, configs, strict=True))
        ]
        starts = {**qualities(cases[0].physics), **ZONES.starts}
        del starts["reference"]  # it is what is right, or as near to it as tables can tell
        steps = search.search(
            cases,
            starts,
            budget_s=60.0 * minutes,
            most_points=points,
            longest_s=math.inf if longest is None else longest,
            known=tuple(found),
            seed=seed,
            progress=part_of(progress, first_part, 1.0 - first_part),
        )
        for point in steps:
            found.append(point)
            report.write_tables(found, folder)
    report.write_tables(found, folder)
    title = ", ".join(case.name for case in cases) if len(cases) <= MOST_NAMED else f"{len(cases)} scenes"
    report.draw(found, folder / "frontier.png", f"{title}: zones, worst sun")
    print_table(["point", "from", "processor s", "MiB", "error %"], report.printed(found), right=(0, 2, 3, 4))
    print(f"wrote points.csv, frontier.csv, frontier.png to {folder}/")


def _one(scene: str, chosen: dict[str, Any], names: dict[str, str]) -> Any:
    from twilight.engine import check_size

    config = options.load_one_scene(scene, chosen, names, "frontier")
    if config.chosen_solver.name != "zones":
        raise TwilightError(
            f"{scene}: solver.name is {config.chosen_solver.name}; frontier searches the settings of zones"
        )
    check_size(config)
    return config


def _case(scene: str, config: Any, table: Path | None, suns: list[float] | None, progress: Any) -> Any:
    from twilight.studies.compare.directions import sun_elevations
    from twilight.studies.compare.reference_solution import read_references, select_suns
    from twilight.studies.frontier.measure import ZonesScene

    name = Path(scene).stem
    own = "sun" in config.model_fields_set
    wanted = suns if suns is not None else (sun_elevations(config) if own else None)
    if table is not None:
        stored = read_references(table)
        references = select_suns(stored, wanted, str(table))
        return ZonesScene.of_table(name, config, references, None if wanted is None else tuple(wanted))
    return ZonesScene.of_scene(name, config, None if wanted is None else tuple(wanted), progress)
