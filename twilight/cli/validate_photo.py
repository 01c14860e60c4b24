"""`twilight validate photo` and `estimate`: the commands that take photographs.

Their options are the fields of `EstimateOptions`: `of_options` makes them, with the same names, defaults and help.
"""

from __future__ import annotations

import functools
import inspect
import sys
from collections.abc import Callable
from dataclasses import Field, fields, replace
from pathlib import Path
from typing import Annotated, Any

from twilight.base.errors import TwilightError
from twilight.base.extras import require
from twilight.cli import options
from twilight.cli.options import argument, flag, option
from twilight.cli.terminal import progress_bar
from twilight.studies.validate.photographs.options import TO_THE_HORIZON, EstimateOptions

NEEDED = ("matplotlib", "xarray")
"""Extras with which a photograph is compared with a sky."""

Settings = Annotated[list[str] | None, option("KEY=VALUE", "Any key of the scene; may be repeated.", "--set")]
Folder = Annotated[Path | None, option("DIR", "Folder for the files; made where it is missing.")]


def of_options(*left_out: str, **defaults: Any) -> Callable[[Callable[..., None]], Callable[..., None]]:
    """A command with the fields of `EstimateOptions` as options, which it gets as its argument `asked`; left_out:
    fields without an option; defaults: other ones than the fields' own."""
    chosen = [one for one in fields(EstimateOptions) if one.metadata["metavar"] and one.name not in left_out]

    def with_options(command: Callable[..., None]) -> Callable[..., None]:
        own = [p for p in inspect.signature(command, eval_str=True).parameters.values() if p.name != "asked"]
        made = {one: _parameter(one, defaults.get(one.name, one.default)) for one in chosen}

        @functools.wraps(command)
        def asking(**given: Any) -> None:
            said = {one.name: _value(one, given.pop(p.name)) for one, p in made.items()}
            command(**given, asked=EstimateOptions(**said))

        last = [p for p in own if p.annotation in (Settings, Folder)]
        order = [*(p for p in own if p not in last), *made.values(), *last]
        order = [p.replace(kind=inspect.Parameter.KEYWORD_ONLY) for p in order]
        setattr(asking, "__signature__", inspect.Signature(order))  # noqa: B010
        asking.__annotations__ = {p.name: p.annotation for p in order}
        return asking

    return with_options


def _parameter(one: Field[Any], default: Any) -> inspect.Parameter:
    """The parameter of a command for a field: `sun_azimuth_deg` is --sun-azimuth, what is on by default has a --no-."""
    name, says, metavar = one.name.removesuffix("_deg"), one.metadata["says"], one.metadata["metavar"]
    dashed, kind = name.replace("_", "-"), {"DEG": float, "NAMES": str, "DEG,...": str}.get(metavar, Path)
    if metavar == "yes" and default is True:
        annotation, default = Annotated[bool, flag(f"--no-{dashed}", f"Do not {says[0].lower()}{says[1:]}")], False
    elif metavar == "yes":
        says = says if default is None else f"{says.partition(';')[0].rstrip('.')}."
        names = f"--{dashed}/--no-{dashed}" if default is None else f"--{dashed}"
        annotation = Annotated[bool | None if default is None else bool, flag(names, says)]  # type: ignore[assignment]
    else:
        default = ",".join(default) if metavar == "NAMES" else default
        said = f"{says[:-1]}, with commas between." if metavar == "NAMES" else says
        annotation = Annotated[kind | None if default is None else kind, option(metavar, said, f"--{dashed}")]  # type: ignore[valid-type]
    return inspect.Parameter(name, inspect.Parameter.KEYWORD_ONLY, default=default, annotation=annotation)


def _value(one: Field[Any], given: Any) -> Any:
    """What a field is set to by what was typed."""
    metavar = one.metadata["metavar"]
    if metavar == "yes" and one.default is True:
        return not given
    if metavar == "NAMES":
        return [name.strip() for name in given.split(",") if name.strip() not in ("", "none")]
    if metavar == "DEG,..." and given is not None:
        return options.parse_numbers(given, "--sun-elevation", -18.0, 90.0)
    return given


def open_photograph(image: Path, asked: EstimateOptions) -> Any:
    """The `Photograph` of a file; errors: TwilightError for options out of range and files that are wrong."""
    from twilight.studies.validate.photographs.picture import read_photograph

    options.check_range(asked.sun_azimuth_deg, "--sun-azimuth", -360.0, 360.0)
    photograph = read_photograph(image, asked)
    taken = photograph.camera
    if asked.camera is None and taken.projection == "latlong":
        print(
            f"twilight: no --camera: {image.name} is taken for a panorama of the whole sphere, "
            f"{taken.image.width_px} x {taken.image.height_px}, north unknown, {taken.response}",
            file=sys.stderr,
        )
    return photograph


@of_options(
    "sun_elevation_deg",
    "types",
    "parameters",
    "tone_curve",
    "colour",
    white_balance=False,
    **TO_THE_HORIZON,
)
def photo(
    image: Annotated[Path, argument("IMAGE", "HDR, EXR, TIFF, PNG, JPEG, HEIF or RAW.")],
    config: Annotated[str, option("CLIMATE_OR_CONFIG", "The scene to compare with, of one sun.")],
    asked: EstimateOptions,
    settings: Settings = None,
    output: Folder = None,
) -> None:
    """Compare a photograph with the computed sky, and write a side-by-side picture with its figures.

    Writes comparison.png, figures.json and comparison.h5.  --set output.polariser_deg=DEG: it was taken through a
    polariser, whose axis is that far clockwise from the vertical.
    """
    require("validate photo", *NEEDED)
    from twilight.base.progress import part_of
    from twilight.engine import run
    from twilight.scene import resolve
    from twilight.scene.suns import count_suns
    from twilight.studies.validate.photographs import comparison as comparing
    from twilight.studies.validate.photographs.figure import REPORT, summary, write_report
    from twilight.studies.validate.photographs.picture import place_sun
    from twilight.studies.validate.photographs.series import with_file

    chosen, names = options.settings_of(settings)

    photograph = open_photograph(image, asked)
    chosen["texture"] = {"resolution_deg": asked.resolution_deg}
    names["texture"] = "--resolution"
    loaded = options.load_one_scene(config, chosen, names, "validate photo")
    options.check_polarised(loaded)
    if count_suns(loaded) > 1:
        raise TwilightError(
            f"{config}: sun: has {count_suns(loaded)} suns; validate photo takes one, e.g. --set sun.elevation_deg=3"
        )
    loaded, said = with_file(photograph, loaded)
    for line in said:
        print(line)
    folder = options.output_folder(output, "photo", image.stem, "photo")
    with progress_bar() as bar:
        sky = run(resolve(loaded), part_of(bar, 0.0, 0.9), numpy_only_sun=True)
        if loaded.output.polariser_deg is not None:
            sky = sky.through_polariser(loaded.output.polariser_deg)
        sun = sky.sun_elevation_deg
        azimuth, _, note, _ = place_sun(photograph, sky.sun_azimuth_deg, asked.sun_azimuth_deg, (sun, sun))
        apparent = sun if sky.apparent_sun_elevation_deg is None else sky.apparent_sun_elevation_deg
        white_balance = bool(asked.white_balance)
        compared = comparing.compare(photograph.seen(azimuth, apparent), sky, white_balance=white_balance)
        bar("drawing", 0.92)
        facts = {"photograph": photograph.name, "scene": loaded.title, "sun_azimuth_deg": azimuth, "sun_azimuth": note}
        write_report(folder, compared, sky, facts, (f"scene: {loaded.title}, sun {sun:+.2f} deg", note))
    print(note)
    for cause, fraction in compared.photo.taken.items():
        print(f"masked, {cause}: {100 * fraction:.1f} % of the sky")
    for line in summary(compared.figures):
        print(line)
    print(f"wrote {', '.join(REPORT)} to {folder}/")


@of_options()
def estimate(
    images: Annotated[
        list[Path],
        argument("IMAGE...", "HDR, EXR, TIFF, PNG, JPEG, HEIF or RAW; several: one evening, one still camera."),
    ],
    asked: EstimateOptions,
    config: Annotated[
        str, option("CLIMATE_OR_CONFIG", "All that is not estimated; its sun counts where it is given.")
    ] = "continental-average",
    settings: Settings = None,
    output: Folder = None,
) -> None:
    """Estimate aerosol, ozone, ground albedo and, where it is not given, the sun's elevation from photographs.

    Fits skies of the solver compact, behind the horizon typical (--set horizon=clean: a clean one), and compares the
    best with the photographs.  Says first where that does not fit, and what they cannot tell.  Writes estimate.json,
    climate.yaml, which holds what was told, and what `twilight validate photo` writes, of several pictures in a folder
    each.
    """
    from twilight.api.photographs import estimate_with
    from twilight.base.progress import part_of
    from twilight.base.whole_files import check_folder, whole_file

    require("validate estimate", *NEEDED)
    from twilight.studies.validate.photographs.figure import write_json, write_report

    chosen, names = options.settings_of(settings)
    loaded = options.load_one_scene(config, chosen, names, "validate estimate")
    asked = replace(asked, scene=loaded, name=[image.name for image in images])
    photographs = [open_photograph(image, asked) for image in images]
    folder = options.output_folder(output, "estimate", images[0].stem, "photo")
    check_folder(folder)
    folder.mkdir(parents=True, exist_ok=True)
    with progress_bar() as bar:
        estimated = estimate_with(photographs, replace(asked, progress=part_of(bar, 0.0, 0.9)))
        bar("comparing", 0.9)
        write_json(folder / "estimate.json", estimated.facts())
        with whole_file(folder / "climate.yaml") as temporary:
            temporary.write_text(estimated.climate_yaml(), encoding="utf-8")
        for k, shown in enumerate(estimated.shown):
            where = folder if len(images) == 1 else folder / f"{k + 1:02d}-{Path(shown.name).stem}"
            sky, comparison = estimated.compared(shown)
            facts = {"photograph": shown.name, "scene": estimated.given.title, "sun_azimuth_deg": shown.sun_azimuth_deg}
            lines = (f"sun {shown.sun_elevation_deg:+.2f} deg, {estimated.best.aerosol_type}", *estimated.about)
            write_report(where, comparison, sky, facts, lines)
    for line in estimated.sentences():
        print(line)
    print(f"wrote estimate.json, climate.yaml and the comparison to {folder}/")
