"""`twilight validate estimate`: the air from a photograph."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

from twilight.cli import options
from twilight.cli import photograph as photo_options
from twilight.cli.options import flag, option
from twilight.cli.terminal import print_table, progress_bar


def estimate(
    image: photo_options.Image,
    config: Annotated[
        str, option("CLIMATE_OR_CONFIG", "All that is not estimated; its sun counts where it is given.")
    ] = "continental-average",
    camera: photo_options.CameraFile = None,
    sun_elevation: Annotated[
        float | None, option("DEG", "True elevation of the sun; unset: the scene's, its disc's, or searched.")
    ] = None,
    types: Annotated[
        str, option("NAMES", "Aerosol types to try, with commas between.")
    ] = "continental_average,maritime_clean,desert,urban",
    parameters: Annotated[
        str, option("NAMES", "Besides the aerosol's optical depth: ozone, albedo, or none.")
    ] = "ozone,albedo",
    refine: Annotated[bool, flag("--refine", "End with skies of the scene's own solver, not of compact.")] = False,
    white_balance: photo_options.WhiteBalance = False,
    no_colour: Annotated[bool, flag("--no-colour", "Use the luminance only.")] = False,
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
    """Estimate aerosol, ozone, ground albedo and, where it is not given, the sun's elevation from a photograph.

    Fits skies of the solver compact and compares the best with the photograph.  Says first where that does not fit, and
    what the photograph cannot tell.  Writes estimate.json, climate.yaml, which holds what was told, and what `twilight
    validate photo` writes.
    """
    import twilight
    from twilight.base.progress import part_of
    from twilight.base.whole_files import check_folder, whole_file
    from twilight.studies.validate.photographs.report import write_json

    options.check_range(sun_elevation, "--sun-elevation", -18.0, 90.0)
    chosen, names = options.settings_of(settings)
    loaded = options.load_one_scene(config, chosen, names, "validate estimate")
    photograph = photo_options.open_photograph(
        image,
        camera,
        sun_azimuth,
        profile=profile,
        mask=mask,
        automatic=not no_automatic_mask,
        min_elevation_deg=min_elevation,
        glare_deg=glare,
        resolution_deg=resolution,
    )
    folder = options.output_folder(output, "estimate", image.stem, "photo")
    check_folder(folder)
    folder.mkdir(parents=True, exist_ok=True)
    with progress_bar() as bar:
        found = twilight.estimate(
            photograph,
            loaded,
            sun_elevation_deg=sun_elevation,
            sun_azimuth_deg=sun_azimuth,
            types=_names(types),
            parameters=[] if parameters.strip() == "none" else _names(parameters),
            white_balance=white_balance,
            colour=not no_colour,
            refine=refine,
            name=image.name,
            progress=part_of(bar, 0.0, 0.9),
        )
        bar("comparing", 0.9)
        write_json(folder / "estimate.json", found.facts())
        with whole_file(folder / "climate.yaml") as temporary:
            temporary.write_text(found.climate_yaml(), encoding="utf-8")
        write_comparison(found, folder)
    for line in found.sentences():
        print(line)
    _print_tables(found)
    print(f"wrote estimate.json, climate.yaml and the comparison to {folder}/")


def _names(text: str) -> list[str]:
    return [name.strip() for name in text.split(",") if name.strip()]


def write_comparison(found: Any, folder: Path) -> None:
    """Write what `twilight validate photo` writes of the estimate's own sky."""
    from twilight.studies.validate.photographs.figure import write_figure
    from twilight.studies.validate.photographs.report import write_dataset, write_json, write_profiles

    facts = {
        "photograph": found.picture,
        "scene": found.given.title,
        "sun_elevation_deg": found.sun_elevation_deg,
        "sun_azimuth_deg": found.sun_azimuth_deg,
        "masked": found.seen.mask.taken,
        "figures": found.comparison.figures,
        "computed_sky": found.sky.provenance,
    }
    lines = (f"sun {found.sun_elevation_deg:+.2f} deg, {found.best.aerosol_type}", *found.remarks)
    drawn = (found.comparison, found.seen.panorama, found.seen.mask)
    write_figure(folder / "comparison.png", *drawn, title=found.picture, lines=lines)
    write_json(folder / "figures.json", facts)
    write_profiles(folder / "profiles.csv", found.comparison)
    write_dataset(folder / "comparison.h5", found.comparison, facts)


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
