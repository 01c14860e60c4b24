"""`twilight validate`: computed skies against photographs and measurements, and cameras calibrated for it.

`photo`, `estimate` and `stars` have files of their own.  `response`: a camera's curve; `photometry`: illuminance and
zenith luminance against measurements; `spectra`: a screen beyond the horizon, from spectra of level ground.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any

import typer

from twilight.base.errors import TwilightError
from twilight.base.extras import require
from twilight.cli import options, validate_photo, validate_stars
from twilight.cli.options import argument, flag, option
from twilight.cli.terminal import print_table, progress_bar, with_errors_as_sentences


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


DEFAULT_CLIMATES = ("continental-average", "continental-clean")


def photometry(
    climates: Annotated[
        list[str] | None, argument("[CLIMATE...]", "Names or files; without them continental-average and -clean.")
    ] = None,
    quality: Annotated[str, option("NAME", "Preset of the solver zones.")] = "standard",
    settings: Annotated[list[str] | None, options.SETTINGS] = None,
    output: Annotated[Path, option("DIR", "Folder for the tables and the picture.")] = Path("out/photometry"),
) -> None:
    """Illuminance of the ground (Janiczek and DeYoung 1987), luminance of the zenith (Koomen et al. 1952; Sky Quality
    Meter, twilight and moonlit nights) and colour of level ground (Spitschan et al. 2016).

    Writes points.csv, levels.csv, moonlit.csv and photometry.png: level and slope apart, for measured sites differ by a
    factor 1.5 to 2. With the night sky; --set night=null leaves it out.
    """
    from twilight.base.progress import part_of
    from twilight.base.whole_files import check_folder
    from twilight.config import load
    from twilight.studies.validate.measured import photometry as work

    require("validate photometry", "matplotlib")
    from twilight.studies.validate.measured import report

    chosen: dict[str, Any] = {"night": {}, "wavelengths.list_nm": list(work.WAVELENGTHS_NM), "solver.quality": quality}
    for key, value in options.settings_of(settings)[0].items():
        if key == "night":
            chosen = {k: v for k, v in chosen.items() if not k.startswith("night.")}
        chosen[key] = value
    names = climates or list(DEFAULT_CLIMATES)
    configs = [load(name, chosen) for name in names]
    titles = [config.climate.name for config in configs]
    if len(set(titles)) < len(titles):
        raise TwilightError(f"validate photometry: the climates must have different names, not {', '.join(titles)}")
    check_folder(output)
    output.mkdir(parents=True, exist_ok=True)
    points: list[work.PhotometricPoint] = []
    moonlit: list[Any] = []
    air: list[str] = []
    with progress_bar() as progress:
        for i, config in enumerate(configs):
            part = part_of(progress, i / len(configs), 1.0 / len(configs), titles[i])
            found, by_moon, transmission = work.photometry(config, part)
            points += found
            moonlit += by_moon
            for site in work.meter.KOOMEN_SITES:
                low, high = site.transmission
                air.append(
                    f"{titles[i]}: vertical photopic transmission above {site.name} {transmission[site.name]:.2f}, "
                    f"measured {low:.2f} to {high:.2f}"
                )
    summary = work.levels(points)
    report.write_points(points, output / "points.csv")
    report.write_levels(summary, output / "levels.csv")
    report.write_moonlit(moonlit, output / "moonlit.csv")
    report.draw(points, moonlit, output / "photometry.png")
    print_table(list(report.LEVEL_COLUMNS), report.level_rows(summary), right=tuple(range(3, 11)))
    for line in air:
        print(line)
    print(f"wrote points.csv, levels.csv, moonlit.csv, photometry.png to {output}/")


def spectra(
    recorded: Annotated[Path, argument("SPECTRA", "CSV: sun_elevation_deg, then a column for each wavelength [nm].")],
    config: Annotated[str, option("CLIMATE_OR_CONFIG", "The air and the ground.")] = "continental-average",
    series: Annotated[
        str | None, option("NAME", "Of a file with several: the value of its column session or run.")
    ] = None,
    suns: Annotated[str, option("HIGH,LOW", "Elevations of the sun [deg] between which spectra count.")] = "0,-8",
    from_km: Annotated[
        str, option("KM,...", "Distances at which the screen may begin; the nearest fit is kept.")
    ] = "0,150,300",
    zenith: Annotated[
        float, option("MAG", "By how much the zenith may become fainter, sun at -4 deg and below; inf: by any.")
    ] = 0.1,
    as_recorded: Annotated[
        bool, flag("--as-recorded", "Do not divide by the ratio to computed light of the recording's own day.")
    ] = False,
    free_calibration: Annotated[
        bool, flag("--free-calibration", "A factor for each wavelength, the same for all suns, is free too.")
    ] = False,
    quality: Annotated[str, options.QUALITY] = "draft",
    settings: Annotated[list[str] | None, options.SETTINGS] = None,
    output: Annotated[Path, option("DIR", "Folder for the tables, the picture and the evening.")] = Path("out/spectra"),
) -> None:
    """Fit what lay beyond the horizon to recorded spectra of level ground.

    Light is linear in what passes at each height, so that one solution for every height serves all fits. Each spectrum
    has a level of its own: colours are fitted. Writes fits.csv, residuals.csv, spectra.png and evening.yaml, the
    configuration with the screen that is nearest.
    """
    from twilight.base.whole_files import check_folder
    from twilight.config import load
    from twilight.studies.validate.measured import report
    from twilight.studies.validate.measured import spectra as work

    require("validate spectra", "matplotlib")

    between = options.parse_numbers(suns, "--suns", -90.0, 90.0)
    if len(between) != 2 or between[0] < between[1]:
        raise TwilightError(f"--suns: {suns} must be two elevations, the higher one first, e.g. 0,-8")
    high, low = between
    starts = tuple(options.parse_numbers(from_km, "--from-km", 0.0, 2000.0))
    if not zenith >= 0.0:
        raise TwilightError(f"--zenith {zenith:g}: must be 0 or more")
    chosen = options.settings_of(settings)[0]
    loaded = load(config, {"solver.quality": quality} | chosen)
    day = high if as_recorded else max(high, work.DAY_DEG[1])
    spectra = work.read_spectra(recorded, series)
    work.at_nodes(spectra, high, low)  # says what those suns lack
    measured = work.at_nodes(spectra, day, low)
    check_folder(output)
    output.mkdir(parents=True, exist_ok=True)
    with progress_bar() as bar:
        bases = work.bases(loaded, measured, starts, bar)
    factor = None
    if not as_recorded:
        measured, bases, factor = work.on_own_day(measured, bases, high)
    fits = sorted((work.fit(measured, basis, zenith, free_calibration) for basis in bases), key=lambda one: one.rms)
    rows = report.fit_rows(fits)
    report.write_fits(fits, output / "fits.csv")
    report.write_residuals(measured, fits[0], output / "residuals.csv")
    report.write_evening(output / "evening.yaml", loaded.climate, fits[0])
    report.draw_spectra(measured, fits[0], output / "spectra.png", f"{recorded.name} {series or ''}".strip())
    print_table(list(report.FIT_COLUMNS), rows, right=tuple(range(len(report.FIT_COLUMNS))))
    print_table(list(report.RESIDUAL_COLUMNS), report.by_wavelength(measured, fits[0]), right=(0, 1, 2, 3, 4))
    if factor is not None:
        told = ", ".join(f"{f:.2f} at {nm:g} nm" for f, nm in zip(factor, measured.wavelength_nm, strict=True))
        print(f"recorded over computed by the recording's own day, which it was divided by: {told}")
    elif not as_recorded:
        print(f"no spectrum with the sun at {work.DAY_DEG[0]:g} deg or above: the light is as it was recorded")
    for line in report.sentences(fits[0]):
        print(line)
    print(f"wrote fits.csv, residuals.csv, spectra.png, evening.yaml to {output}/")


app = typer.Typer(
    name="validate", help="Compare computed skies with photographs; calibrate cameras.", no_args_is_help=True
)
commands: tuple[Callable[..., None], ...] = (
    validate_photo.photo,
    response,
    validate_photo.estimate,
    photometry,
    spectra,
    validate_stars.stars,
)
for command in commands:
    app.command()(with_errors_as_sentences(command))
