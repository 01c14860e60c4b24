"""`twilight validate photo` and `response`, and the options that describe a photograph."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated, Any

from twilight.base.errors import TwilightError
from twilight.base.extras import require
from twilight.cli import options
from twilight.cli.options import argument, flag, option
from twilight.cli.terminal import print_table, progress_bar

DISC_AWAY_DEG = 0.5
"""A disc so far [deg] from the scene's sun is worth a sentence; on coarse panoramas it is found to some 0.3 deg."""

NEEDED = ("colour", "matplotlib", "xarray")
"""Extras with which a photograph is compared with a sky."""


def photo(
    image: Image,
    config: Annotated[str, option("CLIMATE_OR_CONFIG", "The scene to compare with; several suns are tried in turn.")],
    camera: CameraFile = None,
    field_of_view: FieldOfView = None,
    white_balance: WhiteBalance = False,
    sun_azimuth: Azimuth = None,
    profile: Skyline = None,
    mask: MaskImage = None,
    no_automatic_mask: NoAutomaticMask = False,
    min_elevation: MinElevation = 0.0,
    glare: Glare = 6.0,
    resolution: Resolution = 2.0,
    polariser: Annotated[
        float | None,
        option("DEG", "The photograph was taken through a polariser: its axis from the vertical, clockwise."),
    ] = None,
    settings: Settings = None,
    output: Folder = None,
) -> None:
    """Compare a photograph with the computed sky, and write a side-by-side picture with its figures.

    Writes comparison.png, figures.json, profiles.csv and comparison.h5; with several suns also suns.csv, and the files
    are those of the sun that fits best.
    """
    require("validate photo", *NEEDED)
    chosen, names = options.settings_of(settings)
    from twilight.studies.validate.photographs.options import EstimateOptions
    from twilight.studies.validate.photographs.series import with_file

    asked = EstimateOptions(
        camera=camera,
        field_of_view_deg=field_of_view,
        sun_azimuth_deg=sun_azimuth,
        profile=profile,
        mask=mask,
        automatic_mask=not no_automatic_mask,
        min_elevation_deg=min_elevation,
        glare_deg=glare,
        resolution_deg=resolution,
    )
    photograph = open_photograph(image, asked)
    chosen["texture"] = {"resolution_deg": resolution}
    names["texture"] = "--resolution"
    if polariser is not None:
        chosen["output.polariser_deg"], names["output.polariser_deg"] = polariser, "--polariser"
    loaded = options.load_one_scene(config, chosen, names, "validate photo")
    options.check_polarised(loaded)
    loaded, said = with_file(image.name, photograph, loaded)
    for line in said:
        print(line)
    folder = options.output_folder(output, "photo", image.stem, "photo")
    folder.mkdir(parents=True, exist_ok=True)
    compare_with_sky(image, photograph, loaded, sun_azimuth, white_balance, folder)


def compare_with_sky(
    image: Path, photograph: Any, config: Any, sun_azimuth: float | None, white_balance: bool, folder: Path
) -> None:
    from twilight.base.progress import part_of
    from twilight.engine import frames
    from twilight.scene import resolve
    from twilight.scene.suns import count_suns
    from twilight.studies.validate.photographs import comparison as comparing
    from twilight.studies.validate.photographs.figure import summary, write_report, write_suns
    from twilight.studies.validate.photographs.picture import place_sun

    best: Any = None
    rows = []
    note = ""
    config, disc = _with_disc(config, photograph, sun_azimuth)
    with progress_bar() as bar:
        bar("looking at the photograph", 0.0)
        for frame in frames(resolve(config), part_of(bar, 0.0, 0.9), numpy_only_sun=count_suns(config) == 1):
            sky = frame.sky
            if config.output.polariser_deg is not None:
                sky = sky.through_polariser(config.output.polariser_deg)
            azimuth, _, note, _ = place_sun(photograph, sky.sun_azimuth_deg, sun_azimuth)
            apparent = (
                sky.sun_elevation_deg if sky.apparent_sun_elevation_deg is None else sky.apparent_sun_elevation_deg
            )
            comparison = comparing.compare(photograph.seen(azimuth, apparent), sky, white_balance=white_balance)
            residuals = comparing.residual_vector(comparison.photo, comparison.simulated, white_balance=white_balance)
            misfit = float(residuals @ residuals)
            rows.append((frame.name, sky.sun_elevation_deg, misfit, comparison.figures))
            of_disc = disc is not None and sky.sun_elevation_deg == disc
            if best is None or of_disc or (misfit < best[0] and best[1].sun_elevation_deg != disc):
                best = (misfit, sky, comparison, azimuth)
        bar("drawing", 0.92)
        _, sky, comparison, azimuth = best
        facts = {"photograph": image.name, "scene": config.title, "sun_azimuth_deg": azimuth, "sun_azimuth": note}
        lines = (f"scene: {config.title}, sun {sky.sun_elevation_deg:+.2f} deg", note)
        write_report(folder, comparison, sky, facts, lines)
        if count_suns(config) > 1:
            write_suns(folder / "suns.csv", rows)
    if len(rows) > 1:
        columns = ["sun", "misfit", "luminance rms", "solar meridian", "u'v'"]
        table = [[name, f"{misfit:.4g}", *_cells(figures)] for name, _, misfit, figures in rows]
        print_table(columns, table, right=(1, 2, 3, 4))
        print(_chosen(rows, sky.sun_elevation_deg, disc))
    elif _disc_differs(photograph, sun_azimuth, sky):
        print(_disc_differs(photograph, sun_azimuth, sky))
    print(note)
    for cause, fraction in comparison.photo.mask.taken.items():
        print(f"masked, {cause}: {100 * fraction:.1f} % of the sky")
    for line in summary(comparison.figures):
        print(line)
    names = "comparison.png, figures.json, profiles.csv, comparison.h5" + (", suns.csv" if len(rows) > 1 else "")
    print(f"wrote {names} to {folder}/")


def _with_disc(config: Any, photograph: Any, sun_azimuth: float | None) -> tuple[Any, float | None]:
    """The configuration with the sun that the photograph shows among those to try, and its true elevation [deg].

    None, and the configuration as it is, where it has one sun, the disc is not seen, or it is not asked for.
    """
    from twilight.config.sun import SunElevations

    if not isinstance(config.sun, SunElevations) or sun_azimuth is not None:
        return config, None
    elevation_deg = photograph.sun.disc_elevation_deg
    if elevation_deg is None:
        return config, None
    disc = round(float(elevation_deg), 2)
    suns = tuple(sorted({*config.sun.elevations_deg, disc}))
    return config.model_copy(update={"sun": config.sun.model_copy(update={"elevations_deg": suns})}), disc


def _chosen(rows: list[Any], taken: float, disc: float | None) -> str:
    """Which of several suns is compared, why, and what speaks against it."""
    ordered = sorted(rows, key=lambda row: row[2])
    closest = ordered[0][1]
    if disc is not None:
        line = f"sun {taken:+.2f} deg, by its disc in the photograph"
        return line if closest == taken else f"{line}; the sky alone fits best with {closest:+.2f} deg"
    line = f"best: sun {taken:+.2f} deg"
    elevations = [row[1] for row in rows]
    if taken in (min(elevations), max(elevations)):
        side = "lowest" if taken == min(elevations) else "highest"
        line += f", the {side} of those tried: the true one may lie beyond"
    return line


def _disc_differs(photograph: Any, sun_azimuth: float | None, sky: Any) -> str:
    """A sentence where the disc in the photograph stands elsewhere than the scene's only sun, else an empty one."""
    disc = None if sun_azimuth is not None else photograph.sun.disc_elevation_deg
    if disc is None or abs(disc - sky.sun_elevation_deg) < DISC_AWAY_DEG:
        return ""
    return (
        f"the sun's disc in the photograph stands at {disc:+.2f} deg, the scene's sun at {sky.sun_elevation_deg:+.2f}"
    )


def _cells(figures: dict[str, Any]) -> list[str]:
    uv, solar = figures.get("uv_distance_median"), figures["solar_meridian_rms_percent"]
    return [
        f"{figures['luminance_rms_percent']:.1f} %",
        "-" if solar is None else f"{solar:.1f} %",
        "-" if uv is None else f"{uv:.4f}",
    ]


def response(
    images: Annotated[list[Path], argument("IMAGE...", "Photographs of one still scene with different exposures.")],
    times: Annotated[
        str | None, option("SECONDS,...", "Exposure times, one each; unset: from the files' EXIF.")
    ] = None,
    merge: Annotated[Path | None, option("FILE.exr", "Also write the series as one linear picture.")] = None,
    curve: Annotated[
        str | None, option("linear|srgb|EXPONENT|FILE.csv", "With --merge: a known response, instead of recovering it.")
    ] = None,
    output: Annotated[Path | None, option("FILE.csv", "The recovered curve; unset: response.csv.")] = None,
) -> None:
    """Recover a camera's response curve from a bracketed series, and merge the series into one linear picture."""
    from twilight.base.whole_files import check_file
    from twilight.io.stored_image import read_samples, write_exr
    from twilight.studies.camera.response import load_response, merge_bracket, recover_response, write_response

    if curve is not None and (merge is None or output is not None):
        raise TwilightError("--curve: is for --merge, and takes no --output, for there is nothing to recover")
    options.check_suffix(merge, "--merge", ".exr")
    options.check_suffix(output, "--output", ".csv")
    target = output or Path("response.csv")
    for path in (target, merge):
        if path is not None:
            check_file(path)
    pictures = [read_samples(path) for path in images]
    seconds = _times(times, images, pictures)
    recovers = curve is None and not (merge is not None and all(picture.linear for picture in pictures))
    if output is not None and not recovers:
        raise TwilightError("--output: the pictures are linear, and there is no curve to recover")
    if recovers:
        recovered = recover_response(pictures, seconds)
        write_response(target, recovered)
        print(f"rms of ln(exposure): {recovered.residual:.4f} over {recovered.pairs} samples")
        print(f"wrote {target}")
        undo: Any = recovered
    else:
        undo = None if curve is None else load_response(_number_or_text(curve))
    if merge is not None:
        light, saturated = merge_bracket(pictures, seconds, undo)
        write_exr(merge, light)
        print(f"wrote {merge}; {100 * saturated.mean():.2g} % of its pixels are saturated in every exposure")


def _number_or_text(text: str) -> float | str:
    try:
        value = float(text)
    except ValueError:
        return text
    if not 0.1 <= value <= 10.0:
        raise TwilightError(f"--curve: the exponent {value:g} must be from 0.1 to 10")
    return value


def _times(text: str | None, images: list[Path], pictures: list[Any]) -> list[float]:
    if text is not None:
        try:
            seconds = [_seconds(part) for part in text.split(",")]
        except (ValueError, ZeroDivisionError):
            raise TwilightError(
                f"--times: {text} must be seconds with commas between them, e.g. 1/60,1/15,0.25"
            ) from None
        if len(seconds) != len(images):
            raise TwilightError(f"--times: gives {len(seconds)} times for {len(images)} pictures")
        return seconds
    missing = [path for path, picture in zip(images, pictures, strict=True) if picture.exposure_time_s is None]
    if missing:
        raise TwilightError(f"{missing[0]}: does not say its exposure time; give --times")
    return [picture.exposure_time_s for picture in pictures]


def _seconds(text: str) -> float:
    """`1/60` or `0.25` as a number; ValueError for anything else."""
    above, slash, below = text.partition("/")
    return float(above) / (float(below) if slash else 1.0)


Image = Annotated[Path, argument("IMAGE", "HDR, EXR, TIFF, PNG, JPEG, HEIF or RAW.")]
CameraFile = Annotated[
    Path | None,
    option("CAMERA.yaml", "Projection, lens, orientation, response; unset: a panorama (2:1), or what the file says."),
]
FieldOfView = Annotated[
    float | None, option("DEG", "Across the width of a picture whose file does not say the focal length in 35 mm.")
]
WhiteBalance = Annotated[bool, flag("--white-balance", "Free gains of red, green and blue besides the exposure.")]
Azimuth = Annotated[
    float | None,
    option("DEG", "In the camera's azimuths; unset: the scene's if the camera's azimuth is known, else found."),
]
Skyline = Annotated[
    Path | None, option("FILE.csv", "Skyline: azimuth_deg,elevation_deg; below it is no sky.", "--profile")
]
MaskImage = Annotated[
    Path | None, option("IMAGE", "Picture of the photograph's size, bright where there is sky.", "--mask")
]
NoAutomaticMask = Annotated[bool, flag("--no-automatic-mask", "Do not look for ground, trees, buildings and clouds.")]
MinElevation = Annotated[float, option("DEG", "Compare nothing below.")]
Glare = Annotated[float, option("DEG", "Radius about a risen sun that is masked.")]
Resolution = Annotated[float, option("DEG", "Cells of the comparison; must divide 90.")]
Settings = Annotated[list[str] | None, option("KEY=VALUE", "Any key of the scene; may be repeated.", "--set")]
Folder = Annotated[Path | None, option("DIR", "Folder for the files; made where it is missing.")]


def open_photograph(image: Path, asked: Any) -> Any:
    """The `Photograph` of an `EstimateOptions`; errors: TwilightError for options out of range and files that are
    wrong."""
    options.check_range(asked.sun_azimuth_deg, "--sun-azimuth", -360.0, 360.0)
    photograph = asked.photograph(image)
    taken = photograph.camera
    if asked.camera is None and taken.projection == "latlong":
        print(
            f"twilight: no --camera: {image.name} is taken for a panorama of the whole sphere, "
            f"{taken.image.width_px} x {taken.image.height_px}, north unknown, {taken.response}",
            file=sys.stderr,
        )
    return photograph
