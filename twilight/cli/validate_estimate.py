"""`twilight validate estimate`: the air from a photograph."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

from twilight.cli import options
from twilight.cli import photograph as photo_options
from twilight.cli.options import argument, flag, option
from twilight.cli.terminal import print_table, progress_bar


def estimate(
    images: Annotated[
        list[Path], argument("IMAGE...", "HDR, EXR, TIFF, PNG, JPEG or RAW; several: one evening, one still camera.")
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
        flag("--white-balance/--no-white-balance", "Free gains of red, green and blue; unset: of developed pictures."),
    ] = None,
    tone_curve: Annotated[
        bool | None, flag("--tone-curve/--no-tone-curve", "A free curve of two numbers; unset: of developed pictures.")
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

    Fits skies of the solver compact and compares the best with the photographs.  Says first where that does not fit,
    and what they cannot tell.  Writes estimate.json, climate.yaml, which holds what was told, and what `twilight
    validate photo` writes, of several pictures in a folder each.
    """
    import twilight
    from twilight.base.progress import part_of
    from twilight.base.whole_files import check_folder, whole_file
    from twilight.studies.validate.photographs.figure import write_json

    suns = None if sun_elevation is None else options.parse_numbers(sun_elevation, "--sun-elevation", -18.0, 90.0)
    chosen, names = options.settings_of(settings)
    loaded = options.load_one_scene(config, chosen, names, "validate estimate")
    photographs = [
        photo_options.open_photograph(
            image,
            camera,
            sun_azimuth,
            profile=profile,
            mask=mask,
            automatic=not no_automatic_mask,
            min_elevation_deg=min_elevation,
            glare_deg=glare,
            resolution_deg=resolution,
            field_of_view_deg=field_of_view,
        )
        for image in images
    ]
    folder = options.output_folder(output, "estimate", images[0].stem, "photo")
    check_folder(folder)
    folder.mkdir(parents=True, exist_ok=True)
    with progress_bar() as bar:
        found = twilight.estimate(
            photographs,
            loaded,
            sun_elevation_deg=suns,
            sun_azimuth_deg=sun_azimuth,
            types=_names(types),
            parameters=[] if parameters.strip() == "none" else _names(parameters),
            white_balance=white_balance,
            tone_curve=tone_curve,
            brightness=not no_brightness,
            colour=not no_colour,
            refine=refine,
            name=[image.name for image in images],
            progress=part_of(bar, 0.0, 0.9),
        )
        bar("comparing", 0.9)
        write_json(folder / "estimate.json", found.facts())
        with whole_file(folder / "climate.yaml") as temporary:
            temporary.write_text(found.climate_yaml(), encoding="utf-8")
        others = found.other_suns()
        for k, shown in enumerate(found.shown):
            where = folder if len(images) == 1 else folder / f"{k + 1:02d}-{Path(shown.name).stem}"
            where.mkdir(parents=True, exist_ok=True)
            write_comparison(found, shown, where, others)
    for line in found.sentences():
        print(line)
    _print_tables(found)
    print(f"wrote estimate.json, climate.yaml and the comparison to {folder}/")


def _names(text: str) -> list[str]:
    return [name.strip() for name in text.split(",") if name.strip()]


def write_comparison(found: Any, shown: Any, folder: Path, others: Any) -> None:
    """Write what `twilight validate photo` writes of the estimate's own sky of one picture."""
    from twilight.studies.validate.photographs.figure import write_dataset, write_figure, write_json, write_profiles

    sky = found.sky if shown is found.shown[0] else found.sky_of(shown)
    seen, comparison = (found.seen, found.comparison) if shown is found.shown[0] else found.compared(shown, sky)
    facts = {
        "photograph": shown.name,
        "scene": found.given.title,
        "sun_elevation_deg": shown.sun_elevation_deg,
        "sun_azimuth_deg": shown.sun_azimuth_deg,
        "masked": seen.mask.taken,
        "figures": comparison.figures,
        "computed_sky": sky.provenance,
    }
    lines = (f"sun {shown.sun_elevation_deg:+.2f} deg, {found.best.aerosol_type}", *found.remarks)
    drawn = (comparison, seen.panorama, seen.mask)
    write_figure(folder / "comparison.png", *drawn, title=shown.name, lines=lines, others=others)
    write_json(folder / "figures.json", facts)
    write_profiles(folder / "profiles.csv", comparison)
    write_dataset(folder / "comparison.h5", comparison, facts)


def _print_tables(found: Any) -> None:
    types = [[e.aerosol_type, f"{e.misfit:.3g}", f"{e.chi2_above_best:.3g}"] for e in found.types]
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
        for p in found.best.parameters
    ]
    print_table(["parameter", "value", "68 %", "95 %", "unit", "told"], rows, right=(1,))
