"""`twilight view`: a sky in a browser, as one HTML file."""

import shlex
from datetime import timedelta
from pathlib import Path
from types import SimpleNamespace
from typing import Annotated, Any

from twilight.base.errors import TwilightError
from twilight.cli import options
from twilight.cli.options import EndsIn, argument, option
from twilight.cli.terminal import progress_bar


def view(
    scene: Annotated[
        str,
        argument(
            "CLIMATE_OR_CONFIG_OR_FIELD",
            "Name or file of a climate or configuration, or a field.h5 that solver.field_file wrote.",
            options.scene_names,
        ),
    ],
    keys: options.SolverSettings,
    beside: Annotated[str | None, option("SCENE", "A second one, beyond a line that divides the picture.")] = None,
    altitudes_km: Annotated[
        str | None,
        option(
            "KM,...",
            "Altitudes of the observer above sea level, increasing; the page interpolates in between, and one above "
            "the air lets it go up to there. Without it from the ground to an orbit at 1000 km.",
        ),
    ] = None,
    sliders: Annotated[
        bool,
        options.flag(
            "--sliders",
            "Aerosol, ozone, ground albedo and altitude are sliders too; the solver compact computes the sky in the "
            "browser.",
        ),
    ] = False,
    output: Annotated[Path | None, option("FILE.html", "Without it, out/NAME.html."), EndsIn([".html", ".htm"])] = None,
) -> None:
    """Write a sky that can be walked through: every sun and direction, in one HTML file that needs no network."""
    chosen, names = keys.chosen()
    if sliders:
        for name, value in (("--beside", beside), ("--altitudes-km", altitudes_km)):
            if value is not None:
                raise TwilightError(f"{name}: a page with --sliders shows one sky, at any altitude; leave it out")
        options.put_options(chosen, names, {"solver.name": (chosen.get("solver.name", "compact"), "--sliders")})
    altitudes = None if altitudes_km is None else options.parse_numbers(altitudes_km, "--altitudes-km", 0.0, 40000.0)
    scenes = [scene] if beside is None else [scene, beside]
    airs = [_scene(name_given, chosen, names) for name_given in scenes]
    title = [
        air.title or air.medium.name or options.file_stem(Path(name_given).stem, "sky")
        for name_given, (air, _) in zip(scenes, airs, strict=True)
    ]
    path = output or Path("out") / f"{'-'.join(options.file_stem(name, 'sky') for name in title)}.html"

    from twilight.base.whole_files import check_file

    check_file(path)
    if sliders:
        from twilight.show.sliders import view_air

        page = view_air(airs[0][0], name=title[0], start=_start(airs[0][1]))
    else:
        page = _tabulated(scenes, airs, title, altitudes, keys)
    path.parent.mkdir(parents=True, exist_ok=True)
    page.save(path)
    print(f"wrote {path}: {path.stat().st_size / 1e6:.1f} MB, every sun from +90 to -18 deg; open it in a browser")


def _tabulated(
    scenes: list[str],
    airs: list[tuple[Any, Any]],
    title: list[str],
    altitudes: list[float] | None,
    keys: options.SolverSettings,
) -> Any:
    """The page of fields that are solved and put into tables."""
    from twilight.engine import solve
    from twilight.show.skies import check_altitudes, ground_to_orbit, view_fields

    first = airs[0][0]
    if altitudes is None and first.capabilities.every_observer:
        altitudes = list(ground_to_orbit(first.medium))
    for name, (air, _) in zip(title, airs, strict=True):
        check_altitudes(air, altitudes, name)
    config = airs[0][1]
    with progress_bar() as bar:
        from twilight.base.progress import part_of

        solved = []
        for k, (air, config_of_it) in enumerate(airs):
            part = part_of(bar, 0.4 * k / len(airs), 0.4 / len(airs), f"{title[k]}: field")
            solved.append(solve(air, progress=part, cached=config_of_it is not None))
        return view_fields(
            solved,
            names=title,
            scenes=[_render_words(name_given, keys) for name_given, case in zip(scenes, airs, strict=True) if case[1]],
            altitudes_km=altitudes,
            start={} if config is None else _start(config),
            progress=part_of(bar, 0.4, 0.6, "tables"),
            **({} if config is None else {"solar_spectrum": config.solar_spectrum}),
        )


def _render_words(scene: str, keys: options.SolverSettings) -> str:
    """What `twilight render` is given for the same scene, for a shell."""
    words = [scene]
    if keys.quality is not None:
        words += ["--quality", keys.quality]
    for setting in keys.settings or []:
        words += ["--set", setting]
    return shlex.join(words)


def _scene(scene: str, chosen: dict[str, Any], names: dict[str, str]) -> tuple[Any, Any]:
    """The scene resolved, and its configuration where it has one."""
    from twilight.cli.compiling import announce_compiling
    from twilight.scene import Scene, resolve

    if not scene.lower().endswith((".h5", ".hdf5")):
        config = options.load_one_scene(scene, chosen, names, "view")
        announce_compiling(config.chosen_solver.name)
        return resolve(config), config
    if chosen:
        raise TwilightError(f"{scene}: is a solved field, which {next(iter(names.values()))} cannot change")
    from twilight.solvers import zones

    field = zones.load(scene)
    solver: Any = SimpleNamespace(
        CAPABILITIES=zones.CAPABILITIES, QUALITIES=zones.QUALITIES, prepare=lambda medium, settings, **options: field
    )
    return Scene(field.medium, None, solver, field.settings, title=Path(scene).stem), None


def _start(config: Any) -> dict[str, Any]:
    """What the page shows first."""
    from twilight.config.sun import SunElevation, SunElevations
    from twilight.scene.suns import suns_of

    start: dict[str, Any] = {"altitude": config.observer.altitude_km}
    if config.output.tone_mapping == "eye":
        start["tone"] = "eye"
    if config.moon is not None:
        start["moon"] = True
        if config.moon.elevation_deg is not None:
            azimuth = 180.0 if config.moon.azimuth_deg is None else config.moon.azimuth_deg
            start |= {"moonElevation": config.moon.elevation_deg, "moonAzimuth": (azimuth + 180.0) % 360.0 - 180.0}
    if config.output.exposure_ev100 is not None:
        start |= {"exposure": "manual", "ev": config.output.exposure_ev100}
    if "sun" not in config.model_fields_set:
        return start
    sun = next(suns_of(config))
    if isinstance(config.sun, SunElevation | SunElevations):
        return start | {"sun": sun.elevation_deg}
    assert sun.time is not None
    offset = (sun.time.utcoffset() or timedelta()).total_seconds() / 3600.0
    hours = sun.time.hour + sun.time.minute / 60.0 + sun.time.second / 3600.0
    place = {"latitude": config.sun.latitude_deg, "longitude": config.sun.longitude_deg}
    return start | place | {"mode": "clock", "date": sun.time.date().isoformat(), "hours": hours, "zone": offset}
