"""`twilight render`: from a climate or a configuration to files."""

import re
import sys
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Any

from twilight.base.errors import TwilightError
from twilight.cli import options
from twilight.cli.options import Sets, flag, option
from twilight.cli.terminal import print_table, time_of
from twilight.cli.words import perhaps_a_decimal_comma
from twilight.numerics.projections import PERSPECTIVE_UP_DEG, PROJECTIONS, usual_width


@dataclass(frozen=True)
class SunOptions(options.PlaceAndTime):
    """Where the sun stands."""

    sun_elevation: Annotated[
        str | None,
        option("DEG,...", "True elevation of the sun; several with commas between: -4,-5; one on the date of --at."),
    ] = None


@dataclass(frozen=True, kw_only=True)
class RenderSettings(options.ObserverSettings):
    """What sets a key of the configuration, and any key."""

    solver: options.Solver = None
    target_stderr: Annotated[
        float | None, option("FRACTION", "Relative standard error of every pixel, e.g. 0.01, where a solver estimates.")
    ] = None
    target_error: Annotated[
        float | None,
        option("FRACTION", "Error of 95 % of directions that a solver chooses its settings for, e.g. 0.01."),
    ] = None
    renderer: Annotated[
        str | None,
        option("NAME", "Whose axes sky.rgb.exr has: openexr, mitsuba, blender, pbrt or radiance."),
        Sets(["output.renderer"]),
    ] = None
    width: Annotated[
        int | None,
        option("PIXELS", "Of sky.rgb.exr, a multiple of 4 up to 16384; without it, 1024."),
        Sets(["output.width"]),
    ] = None
    primaries: Annotated[
        str | None,
        option("NAME", "Colours of sky.rgb.exr: rec709, acescg or rec2020."),
        Sets(["output.primaries"]),
    ] = None
    tone: Annotated[
        str | None,
        option("NAME", "Of the pictures: photographic, filmic, gamma, eye, camera (output.camera)."),
        Sets(["output.tone_mapping"]),
    ] = None
    polariser: Annotated[
        float | None,
        option("DEG", "Axis of a polariser before the pictures, from the vertical, clockwise."),
        Sets(["output.polariser_deg"]),
    ] = None
    disc: Annotated[
        bool,
        flag("--disc", "The sun's disc too: in the pictures, the environment maps and sun.png."),
        Sets(["sun.disc", "output.disc"]),
    ] = False


@dataclass(frozen=True)
class PictureOptions:
    """Which files are written, and the picture with the ground in it."""

    exposure: Annotated[
        str | None,
        option("EV100|series", "Of the pictures: a value, or one for all of a series; without it, by each sky."),
    ] = None
    only: Annotated[str | None, option("NAMES", "Which files, e.g. png,h5; see `output.files`.")] = None
    projection: Annotated[
        str | None, option("KIND", f"A picture with the ground in it, sky.view.png: {', '.join(PROJECTIONS)}.")
    ] = None
    size: Annotated[
        str | None,
        option("WIDTHxHEIGHT|WIDTH", "Of that picture in pixels, up to 16384; without it, 1600 wide or less."),
    ] = None


def render(
    scene: Annotated[str, options.SCENE],
    suns: SunOptions,
    keys: RenderSettings,
    picture: PictureOptions,
    output: Annotated[
        Path | None, option("DIR|FILE.nc", "Folder for the files; or one NetCDF file with the radiances of all suns.")
    ] = None,
    overwrite: Annotated[
        bool, flag("--overwrite", "Compute all again, and delete what else renders wrote to the folder.")
    ] = False,
    no_preview: Annotated[
        bool, flag("--no-preview", "No picture of a fitted model while the sky is computed.")
    ] = False,
    plan: Annotated[bool, flag("--plan", "Only say what the scene leaves out and why, and its size.")] = False,
) -> None:
    """Compute a sky, or a series of them, and write PNG, EXR and HDF5. Goes on where it was interrupted."""
    from twilight.config import load_series

    size, projection, only = picture.size, picture.projection, picture.only
    sun, sun_option = _sun(suns)
    exposure_key, exposure_value = _exposure(picture.exposure)
    files = None if only is None else [name.strip() for name in only.split(",")]
    if projection is not None and files is not None and "view" not in files:
        raise TwilightError(f"--projection: its picture is the file `view`, which --only {only} leaves out")
    view = None if projection is None else _view(projection, size)
    given: options.Given = {
        "sun": (sun, sun_option),
        exposure_key: (exposure_value, "--exposure"),
        "output.files": (files, "--only"),
        "observer.view": (view, "--projection" if size is None else "--projection, --size"),
    }
    chosen, names = keys.chosen(given)
    if size is not None and projection is None:
        if any(case.config.observer.view is None for case in load_series(scene, chosen, names)):
            raise TwilightError("--size: is the size of the picture of --projection; give both")
        for key, value in zip(("width", "height"), _size(size), strict=True):
            chosen[f"observer.view.{key}"], names[f"observer.view.{key}"] = value, "--size"
    for target_key, fraction in (("target_error", keys.target_error), ("target_stderr", keys.target_stderr)):
        if fraction is not None:
            target_option = f"--{target_key.replace('_', '-')}"
            _check_target(load_series(scene, chosen, names), target_option, target_key)
            options.put_options(chosen, names, {f"solver.{target_key}": (fraction, target_option)})
    cases = load_series(scene, chosen, names)
    if plan:
        _print_plans(cases)
        return
    from twilight.cli.climate import source_summary
    from twilight.cli.compiling import announce_compiling
    from twilight.cli.preview import say_if_long, show_preview
    from twilight.cli.render_files import SUFFIX, check_cases, check_one_file, render_files, render_one_file
    from twilight.config.sun import SunElevation

    one_file = output is not None and output.suffix == SUFFIX
    if output is not None and one_file:
        check_one_file(cases, scene, {key: names.get(key, key) for key in chosen}, output, overwrite)
    for case in cases:
        options.check_polarised(case.config)
    check_cases(cases)  # before anything is said: a refusal is one sentence
    for words in dict.fromkeys(source_summary(a.sources) for c in cases if (a := c.config.climate.air) and a.sources):
        print(f"twilight: {words}", file=sys.stderr)
    if any(_has_default_sun(case.config) for case in cases):
        default = SunElevation().elevation_deg
        print(
            f"twilight: no sun is given: it stands at {default:+g} deg (--sun-elevation, or --at and a place)",
            file=sys.stderr,
        )
    for name in sorted({case.config.chosen_solver.name for case in cases}):
        announce_compiling(name)
    if output is not None and one_file:
        with say_if_long(cases[0].config):
            render_one_file(cases[0].config, output)
        return
    render_files(cases, scene, chosen, output, overwrite, say_if_long if no_preview else show_preview)


def _has_default_sun(config: Any) -> bool:
    """Whether nothing says where the sun is."""
    return "sun" not in config.model_fields_set or not config.sun.model_fields_set - {"disc", "distance_au"}


def _exposure(text: str | None) -> tuple[str, Any]:
    """The key and the value that --exposure sets."""
    if text is None or text == "series":
        return "output.exposure", text
    try:
        return "output.exposure_ev100", float(text)
    except ValueError:
        raise TwilightError(f"--exposure: {text} must be an exposure value such as 12, or series") from None


def _view(projection: str, size: str | None) -> dict[str, Any]:
    """`observer.view` for --projection and --size, towards the sun."""
    view: dict[str, Any] = {"kind": projection}
    if projection in PROJECTIONS:  # else the configuration says what is allowed
        view["width"] = usual_width(projection)
    if size is not None:
        view["width"], view["height"] = _size(size)
    if projection == "perspective":
        view["elevation_deg"] = PERSPECTIVE_UP_DEG
    return view


def _size(size: str) -> tuple[int, int | None]:
    """Width and height [pixel] of --size; None: the height that the projection has at that width."""
    match = re.fullmatch(r"(\d{1,9})(?:[xX](\d{1,9}))?", size)
    if match is None:
        raise TwilightError(f"--size: {size} must be WIDTHxHEIGHT or WIDTH in pixels, e.g. 1920x1080")
    return int(match[1]), int(match[2]) if match[2] else None


def _check_target(cases: list[Any], option: str, setting: str) -> None:
    """TwilightError unless every case's solver has the setting."""
    from twilight import solvers

    able = solvers.with_option(setting)
    others = {case.config.solver.get("name", solvers.DEFAULT) for case in cases} - {*able}
    if others:
        raise TwilightError(
            f"{option}: {', '.join(sorted(others))} does not take {setting}; add --solver {' or '.join(able)}"
        )


_DATE = re.compile(r"\d{4}-\d{2}-\d{2}(\s+(dawn|dusk))?")
"""A date, on which `--sun-elevation` names a moment of the evening or of the morning."""


def _sun(suns: SunOptions) -> tuple[dict[str, Any] | None, str]:
    """The `sun` section that the options describe, None where there are none, and the option to name in errors."""
    elevation, at = suns.sun_elevation, suns.at
    if elevation is not None:
        elevations = options.parse_numbers(elevation, "--sun-elevation", -90.0, 90.0)
        if perhaps_a_decimal_comma(elevation):
            both = " and ".join(f"{sun:g}" for sun in elevations)
            print(f"twilight: --sun-elevation {elevation}: suns at {both} deg; decimals have a point", file=sys.stderr)
        if at is not None and _DATE.fullmatch(at.strip()) and len(elevations) == 1:
            side = "" if at.strip()[-1].isalpha() else " dusk"
            return _sun(replace(suns, sun_elevation=None, at=f"{at.strip()}{side} {elevations[0]:.10g}"))
        if any(value is not None for value in (at, suns.latitude, suns.longitude, suns.time_zone)):
            raise TwilightError(
                "--sun-elevation: takes the place of --at, --latitude, --longitude and --time-zone, but for one "
                "elevation on a date: --at 2026-06-21, or '2026-06-21 dawn'"
            )
        key = ("elevation_deg", elevations[0]) if len(elevations) == 1 else ("elevations_deg", elevations)
        return dict([key]), "--sun-elevation"
    return suns.given or None, "--at"


def _print_plans(cases: list[Any]) -> None:
    from twilight.cli.choices import print_choices
    from twilight.scene import resolve
    from twilight.scene.plan import not_computed
    from twilight.scene.usual import described, usual_horizon

    rows, sizes = [], []
    for case in cases:
        scene, name = resolve(case.config, for_plan=True), case.name or case.config.title
        dark = scene.lights(scene.suns[0]).left_out if len(scene.suns) == 1 else ()
        omitted = (*scene.omissions, *dark, *not_computed(case.config))
        rows += [[name, item.part, item.reason, item.effect] for item in omitted]
        if not omitted:
            rows.append([name, "nothing", "all that this program knows is computed", ""])
        sizes.append([name, *_sizes(scene)])
    print_table(["scene", "left out", "why", "effect on the radiance"], rows)
    for case in cases:
        if (horizon := usual_horizon(case.config)).screen is not None:
            print(f"beyond the horizon of {case.name or case.config.title}: {described(horizon)}")
    print_choices([(case.name or case.config.title, resolve(case.config, for_plan=True)) for case in cases])
    columns = ["scene", "suns", "wavelengths", "in blocks", "interpolated from", "sky [GB]", "picture of the view [GB]"]
    columns += ["field of a block [GB]", "memory in all [GB]", "processor time, about"]
    print_table(columns, sizes, right=tuple(range(1, len(columns))))


def _sizes(scene: Any) -> list[str]:
    """What a scene costs; of a solver that does not say what its field costs, the cost of the arrays alone."""
    from twilight.engine.problem import full_cost

    sizes = full_cost(scene)
    blocks = f"{sizes.blocks} of {min(sizes.max_wavelengths, sizes.wavelengths)}"
    numbers = [f"{sizes.sky_bytes / 1e9:.3g}", f"{sizes.view_bytes / 1e9:.3g}" if sizes.view_bytes else "none"]
    in_full = ["-", "-", "-"]
    if sizes.field_bytes is not None and sizes.total_bytes is not None and sizes.cpu_s is not None:
        in_full = [f"{sizes.field_bytes / 1e9:.2g}", f"{sizes.total_bytes / 1e9:.2g}", time_of(sizes.cpu_s)]
    solved = str(sizes.solved) if sizes.solved else "-"
    return [str(sizes.suns), str(sizes.wavelengths), blocks, solved, *numbers, *in_full]
