"""`twilight validate`: computed skies against photographs, and cameras calibrated for it.

`estimate`: the air from a photograph; `photometry`: illuminance and zenith luminance against measurements; `spectra`: a
screen beyond the horizon, from spectra of level ground.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any

import typer

from twilight.base.errors import TwilightError
from twilight.base.extras import require
from twilight.cli import options, validate_photo, validate_stars
from twilight.cli import validate_photo as photo_options
from twilight.cli.options import argument, flag, option
from twilight.cli.terminal import print_table, progress_bar, with_errors_as_sentences


def estimate(
    images: Annotated[
        list[Path],
        argument("IMAGE...", "HDR, EXR, TIFF, PNG, JPEG, HEIF or RAW; several: one evening, one still camera."),
    ],
    config: Annotated[
        str, option("CLIMATE_OR_CONFIG", "All that is not estimated; its sun counts where it is given.")
    ] = "continental-average",
    camera: photo_options.CameraFile = None,
    field_of_view: photo_options.FieldOfView = None,
    sun_elevation: Annotated[
        str | None,
        option(
            "DEG,...", "True elevation of the sun, of every picture; unset: the scene's, Exif's, its disc's, searched."
        ),
    ] = None,
    types: Annotated[
        str, option("NAMES", "Aerosol types to try, with commas between.")
    ] = "continental_average,maritime_clean,desert,urban",
    parameters: Annotated[
        str, option("NAMES", "Besides the aerosol's optical depth: ozone, albedo, or none.")
    ] = "ozone,albedo",
    refine: Annotated[bool, flag("--refine", "End with skies of the scene's own solver, not of compact.")] = False,
    white_balance: Annotated[
        bool | None,
        flag(
            "--white-balance/--no-white-balance",
            "Free gains of red, green and blue; unset: unless a --camera is given.",
        ),
    ] = None,
    tone_curve: Annotated[
        bool | None, flag("--tone-curve/--no-tone-curve", "A free curve of three numbers; unset: of sRGB pictures.")
    ] = None,
    no_colour: Annotated[bool, flag("--no-colour", "Use the luminance only.")] = False,
    no_brightness: Annotated[bool, flag("--no-brightness", "Use the colours only.")] = False,
    sun_azimuth: photo_options.Azimuth = None,
    profile: photo_options.Skyline = None,
    mask: photo_options.MaskImage = None,
    no_automatic_mask: photo_options.NoAutomaticMask = False,
    min_elevation: photo_options.MinElevation = 3.0,
    glare: photo_options.Glare = 10.0,
    resolution: photo_options.Resolution = 3.0,
    settings: photo_options.Settings = None,
    output: photo_options.Folder = None,
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
    from twilight.studies.validate.photographs.options import EstimateOptions

    require("validate estimate", *photo_options.NEEDED)
    from twilight.studies.validate.photographs.figure import write_json, write_report

    suns = None if sun_elevation is None else options.parse_numbers(sun_elevation, "--sun-elevation", -18.0, 90.0)
    chosen, names = options.settings_of(settings)
    loaded = options.load_one_scene(config, chosen, names, "validate estimate")
    asked = EstimateOptions(
        loaded,
        camera=camera,
        field_of_view_deg=field_of_view,
        sun_elevation_deg=suns,
        sun_azimuth_deg=sun_azimuth,
        types=_names(types),
        parameters=[] if parameters.strip() == "none" else _names(parameters),
        white_balance=white_balance,
        tone_curve=tone_curve,
        brightness=not no_brightness,
        colour=not no_colour,
        refine=refine,
        profile=profile,
        mask=mask,
        automatic_mask=not no_automatic_mask,
        min_elevation_deg=min_elevation,
        glare_deg=glare,
        resolution_deg=resolution,
        name=[image.name for image in images],
    )
    photographs = [photo_options.open_photograph(image, asked) for image in images]
    folder = options.output_folder(output, "estimate", images[0].stem, "photo")
    check_folder(folder)
    folder.mkdir(parents=True, exist_ok=True)
    with progress_bar() as bar:
        estimated = estimate_with(photographs, replace(asked, progress=part_of(bar, 0.0, 0.9)))
        bar("comparing", 0.9)
        write_json(folder / "estimate.json", estimated.facts())
        with whole_file(folder / "climate.yaml") as temporary:
            temporary.write_text(estimated.climate_yaml(), encoding="utf-8")
        others = estimated.other_suns()
        for k, shown in enumerate(estimated.shown):
            where = folder if len(images) == 1 else folder / f"{k + 1:02d}-{Path(shown.name).stem}"
            where.mkdir(parents=True, exist_ok=True)
            sky, comparison = estimated.compared(shown)
            facts = {"photograph": shown.name, "scene": estimated.given.title, "sun_azimuth_deg": shown.sun_azimuth_deg}
            lines = (f"sun {shown.sun_elevation_deg:+.2f} deg, {estimated.best.aerosol_type}", *estimated.about)
            write_report(where, comparison, sky, facts, lines, others)
    for line in estimated.sentences():
        print(line)
    _print_tables(estimated)
    print(f"wrote estimate.json, climate.yaml and the comparison to {folder}/")


def _names(text: str) -> list[str]:
    return [name.strip() for name in text.split(",") if name.strip()]


def _print_tables(estimated: Any) -> None:
    types = [[e.aerosol_type, f"{e.misfit:.3g}", f"{e.chi2_above_best:.3g}"] for e in estimated.types]
    print_table(["type", "misfit", "chi2 above best"], types, right=(1, 2))
    rows = [
        [
            p.name,
            f"{p.value:.4g}",
            f"{p.low:.4g} to {p.high:.4g}",
            f"{p.low_95:.4g} to {p.high_95:.4g}",
            p.unit,
            "yes" if p.constrained else "no",
        ]
        for p in estimated.best.parameters
    ]
    print_table(["parameter", "value", "68 %", "95 %", "unit", "told"], rows, right=(1,))


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
    validate_photo.response,
    estimate,
    photometry,
    spectra,
    validate_stars.stars,
)
for command in commands:
    app.command()(with_errors_as_sentences(command))
