"""`twilight render`: from a climate or a configuration to files."""

from __future__ import annotations

import re
import sys
from pathlib import Path
from typing import Annotated, Any

import typer

from twilight.cli.options import check_polarised, option, settings_of
from twilight.cli.terminal import print_table, progress_bar
from twilight.errors import TwilightError


def render(
    scene: Annotated[
        str, typer.Argument(metavar="CLIMATE_OR_CONFIG", help="Name or file of a climate, or file of a configuration.")
    ],
    sun_elevation: Annotated[float | None, option("DEG", "True elevation of the sun.")] = None,
    at: Annotated[str | None, option("TIME", "Date and time, e.g. 2003-12-08T16:30; needs a place.")] = None,
    latitude: Annotated[float | None, option("DEG", "North positive.")] = None,
    longitude: Annotated[float | None, option("DEG", "East positive.")] = None,
    time_zone: Annotated[str | None, option("ZONE", "For a TIME without offset, e.g. Europe/Berlin.")] = None,
    altitude_km: Annotated[float | None, option("KM", "Altitude of the observer above sea level.")] = None,
    solver: Annotated[str | None, option("NAME", "See `twilight solvers`.")] = None,
    quality: Annotated[str | None, option("NAME", "Preset of the solver.")] = None,
    target_stderr: Annotated[
        float | None, option("SHARE", "Relative standard error of every pixel, e.g. 0.01; montecarlo only.")
    ] = None,
    target_error: Annotated[
        float | None, option("SHARE", "Refine until two qualities agree to this share, e.g. 0.01; zones only.")
    ] = None,
    settings: Annotated[list[str] | None, option("KEY=VALUE", "Any key; may be repeated.", "--set")] = None,
    target: Annotated[
        str | None, option("NAME", "Whose sky.rgb.exr: openexr, mitsuba, blender, pbrt or radiance.")
    ] = None,
    only: Annotated[str | None, option("NAMES", "Which files, e.g. png,h5; see `output.files`.")] = None,
    polariser: Annotated[
        float | None, option("DEG", "Axis of a polariser before the pictures, from the vertical, clockwise.")
    ] = None,
    output: Annotated[Path | None, option("DIR", "Folder for the files; made where it is missing.")] = None,
    plan: Annotated[bool, typer.Option("--plan", help="Only say what the scene leaves out, and why.")] = False,
) -> None:
    """Compute a sky, or a series of them, and write PNG, EXR and HDF5."""
    from twilight.config import load_series

    chosen: dict[str, Any] = {}
    names: dict[str, str] = {}

    def choose(key: str, value: Any, option: str) -> None:
        if value is not None:
            chosen[key], names[key] = value, option

    sun, option = _sun(sun_elevation, at, latitude, longitude, time_zone)
    choose("sun", sun, option)
    choose("observer.altitude_km", altitude_km, "--altitude-km")
    choose("solver.name", solver, "--solver")
    choose("solver.quality", quality, "--quality")
    choose("output.target", target, "--target")
    choose("output.files", None if only is None else [name.strip() for name in only.split(",")], "--only")
    choose("output.polariser_deg", polariser, "--polariser")
    set_here, called = settings_of(settings)
    chosen.update(set_here)
    names.update(called)
    if target_error is not None:
        _check_solver(load_series(scene, chosen, names), "--target-error", "zones", "refines to a target error")
        choose("solver.target_error", target_error, "--target-error")
    if target_stderr is not None:
        _check_solver(load_series(scene, chosen, names), "--target-stderr", "montecarlo", "stops at a standard error")
        choose("solver.target_stderr", target_stderr, "--target-stderr")
    cases = load_series(scene, chosen, names)
    if plan:
        _print_plans(cases)
    else:
        _render(cases, scene, output)


def _check_solver(cases: list[Any], option: str, solver: str, does: str) -> None:
    from twilight import solvers

    others = {case.config.solver.get("name", solvers.DEFAULT) for case in cases} - {solver}
    if others:
        raise TwilightError(
            f"{option}: only the solver {solver} {does}, not {', '.join(sorted(others))}; add --solver {solver}"
        )


def _sun(
    elevation: float | None, at: str | None, latitude: float | None, longitude: float | None, zone: str | None
) -> tuple[dict[str, Any] | None, str]:
    """The `sun` section that the options describe, None where there are none, and the option to name in errors."""
    place = {"latitude_deg": latitude, "longitude_deg": longitude, "time_zone": zone}
    given = {key: value for key, value in place.items() if value is not None}
    if elevation is not None:
        if at is not None or given:
            raise TwilightError("--sun-elevation: takes the place of --at, --latitude, --longitude and --time-zone")
        return {"elevation_deg": elevation}, "--sun-elevation"
    if at is None and not given:
        return None, ""
    if at is None or latitude is None or longitude is None:
        raise TwilightError("--at: a time needs a place and a place a time: give --at, --latitude and --longitude")
    return {"at": at, **given}, "--at"


def _print_plans(cases: list[Any]) -> None:
    from twilight.scene.plan import make_plan

    rows = []
    for case in cases:
        plan = make_plan(case.config)
        name = case.name or case.config.title
        rows += [[name, item.part, item.reason, item.effect] for item in plan.left_out]
        if not plan.left_out:
            rows.append([name, "nothing", "everything in this scene matters", ""])
    print_table(["scene", "left out", "why", "effect on the radiance"], rows)


def _render(cases: list[Any], scene: str, output: Path | None) -> None:
    from twilight.engine import check_size, frames
    from twilight.io.whole import check_folder
    from twilight.progress import part_of
    from twilight.scene.suns import count_suns

    for case in cases:
        check_size(case.config)
        check_polarised(case.config)
    check_folder(output or Path("out"))
    counts = [count_suns(case.config) for case in cases]
    total = sum(counts)
    rows: list[list[str]] = []
    pictures: list[tuple[str, Path]] = []
    root = output
    with progress_bar() as progress:
        done = 0
        for case, count in zip(cases, counts, strict=True):
            report = part_of(progress, done / total, count / total, case.name)
            for frame in frames(case.config, report):
                if root is None:
                    root = _default_folder(case.config, scene, total, frame)
                folder = root.joinpath(*(part for part in (case.name, frame.name if count > 1 else "") if part))
                files = _write(frame, case.config, folder)
                label = " ".join(part for part in (case.name, frame.name) if part)
                pictures += [(label, file) for file in files if file.suffix == ".png"][:1]
                rows.append(_summary(label, frame.sky))
            done += count
    assert root is not None
    if len(pictures) > 1:
        from twilight.plotting import contact_sheet

        contact_sheet(pictures, root / "contact-sheet.png")
    print_table(
        ["scene", "solver", "set-up + sky", "zenith luminance", "sky illuminance"],
        rows,
        right=(2, 3, 4),
    )
    what = ", ".join(file.name for file in files)
    more = f" in {total} folders, and contact-sheet.png" if total > 1 else ""
    print(f"wrote {what}{more} to {root}{'' if str(root).endswith('/') else '/'}", file=sys.stdout)


def _write(frame: Any, config: Any, folder: Path) -> list[Path]:
    from twilight.io.outputs import write_outputs

    o = config.output
    return write_outputs(
        frame.sky,
        folder,
        panorama=frame.panorama,
        files=o.files,
        polariser_deg=o.polariser_deg,
        views=o.views,
        target=o.target,
        width=config.texture.latlong_width or o.width,
        spectral_width=o.spectral_width,
        exposure="auto" if o.exposure_ev100 is None else o.exposure_ev100,
        tone_mapping=o.tone_mapping,
        observer=o.colour_observer,
    )


def _default_folder(config: Any, scene: str, total: int, frame: Any) -> Path:
    name = config.title if total == 1 else (config.name or Path(scene).stem)
    text = f"{name}_{frame.name}" if total == 1 else name
    return Path("out") / (re.sub(r"[^\w.+-]+", "-", text).strip("-.") or "sky")


def _summary(label: str, sky: Any) -> list[str]:
    zenith = float(sky.resample([90.0], [0.0]).luminance()[0, 0])
    record = sky.provenance
    return [
        label,
        f"{record['solver']} ({record['quality']})",
        f"{record['set_up_time_s']:.1f} + {record['run_time_s'] - record['set_up_time_s']:.1f} s",
        f"{zenith:.4g} cd/m^2",
        f"{sky.illuminance_lux():.4g} lx",
    ]
