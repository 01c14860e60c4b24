"""`twilight validate estimate`: the air from a photograph."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated, Any, get_args

import typer

from twilight.base.errors import TwilightError
from twilight.cli import options
from twilight.cli import photograph as photo_options
from twilight.cli.options import flag, option
from twilight.cli.terminal import print_table, progress_bar
from twilight.cli.validate_photo import sun_azimuth_of

SUN_STEP_DEG = 1.0
"""Distance of the suns that an estimate is made for from each other [deg]."""
HORIZON = "horizon"
"""Parameter that is no part of the climate."""
MOST_SUNS = 25
"""Suns that an estimate is made for, at most."""


def estimate(
    image: photo_options.Image,
    config: Annotated[
        str, option("CLIMATE_OR_CONFIG", "All that is not estimated; with several suns the elevation is, between them.")
    ],
    camera: photo_options.CameraFile = None,
    types: Annotated[
        str, option("NAMES", "Aerosol types to try, with commas between.")
    ] = "continental_average,maritime_clean,desert,urban",
    parameters: Annotated[
        str,
        option(
            "NAMES",
            "Besides the aerosol's optical depth: humidity, ozone, albedo, horizon (which part of the sunbeams clouds "
            "beyond the horizon stop), or none.",
        ),
    ] = "humidity,ozone,albedo",
    library: Annotated[
        Path | None, option("DIR", "Folder where the fitted skies are cached, for other photographs of the same sun.")
    ] = None,
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
    """Estimate aerosol, humidity, ozone, ground albedo and, on request, the sun's elevation from a photograph.

    Emulates the skies of each aerosol type from a few computed ones, fits them to the photograph, computes the sky of
    the best fit and compares it.  Writes estimate.json, climate.yaml and what `twilight validate photo` writes.  Says
    what the photograph cannot tell, and how far emulated skies are off, which its uncertainties hold.  What a type was
    emulated from is cached for the next photograph under a sun some degrees from this one's (`twilight cache`).
    Interrupted (Ctrl-C), it fits the types that are there.
    """
    from twilight.base.whole_files import check_folder

    chosen_types, design = _types_and_design(types, parameters)
    chosen, names = options.settings_of(settings)
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
    loaded = options.load_one_scene(config, chosen, names, "validate estimate")
    folder = options.output_folder(output, "estimate", image.stem, "photo")
    for place in (folder, *([library] if library else [])):
        check_folder(place)
        place.mkdir(parents=True, exist_ok=True)
    free = {"white_balance": white_balance, "with_colour": not no_colour}
    _estimate(image, photograph, loaded, chosen_types, design, sun_azimuth, library, free, folder)


def _types_and_design(types: str, parameters: str) -> tuple[list[str], Any]:
    from twilight.config.aerosol import AerosolType
    from twilight.config.validate import unknown
    from twilight.studies.validate.photographs.library import OTHERS, Design

    known = get_args(AerosolType)
    chosen = [name.strip() for name in types.split(",") if name.strip()]
    for name in chosen:
        if name not in known:
            raise TwilightError(f"--types: {name} {unknown(name, known)}")
    if not chosen:
        raise TwilightError("--types: names no aerosol type")
    wanted = [] if parameters.strip() == "none" else [name.strip() for name in parameters.split(",") if name.strip()]
    others = {p.name: p for p in OTHERS}
    for name in wanted:
        if name not in others:
            raise TwilightError(f"--parameters: {name} {unknown(name, others)}")
    return list(dict.fromkeys(chosen)), Design(tuple(p for p in OTHERS if p.name in wanted))


def _suns(config: Any) -> list[float]:
    """Elevations of the library: the scene's only sun, or nodes from its lowest to its highest."""
    import math

    import numpy as np

    from twilight.config.sun import SunAt, SunElevation, SunElevations
    from twilight.sky.ephemeris import sun_position

    sun = config.sun
    if isinstance(sun, SunElevation):
        return [sun.elevation_deg]
    if isinstance(sun, SunElevations):
        low, high = min(sun.elevations_deg), max(sun.elevations_deg)
        count = math.ceil((high - low) / SUN_STEP_DEG) + 1
        if count > MOST_SUNS:
            raise TwilightError(
                f"sun: {low:g} to {high:g} deg is too far apart; at most {MOST_SUNS - 1} deg are searched"
            )
        return [float(s) for s in np.linspace(low, high, max(count, 3))] if high > low else [low]
    if not isinstance(sun, SunAt):
        raise TwilightError(
            "sun: a photograph has one time; give sun.at, an elevation, or elevations to search between"
        )
    at = sun_position(sun.aware(sun.at), sun.latitude_deg, sun.longitude_deg, config.observer.altitude_km)
    return [float(at.elevation_deg)]


def _estimate(
    image: Path,
    photograph: Any,
    config: Any,
    types: list[str],
    design: Any,
    sun_azimuth: float | None,
    folder_of_libraries: Path | None,
    free: dict[str, bool],
    folder: Path,
) -> None:
    from twilight.base.progress import part_of
    from twilight.cli.validate_photo import compare_with_sky
    from twilight.engine import run
    from twilight.scene import resolve
    from twilight.sky.colour import sky_to_xyz
    from twilight.studies.validate.photographs.estimate import estimate as fit
    from twilight.studies.validate.photographs.estimate import facts, sentences, unconstrained_wavelengths
    from twilight.studies.validate.photographs.library import make_library
    from twilight.studies.validate.photographs.photo import OBSERVER
    from twilight.studies.validate.photographs.report import write_json

    suns = _suns(config)
    remarks: list[str] = []
    if len(suns) > 1 and sun_azimuth is None and (disc := photograph.sun.true_elevation_deg) is not None:
        if suns[0] <= disc <= suns[-1]:
            suns = [round(float(disc), 2)]
            remarks.append(f"sun: {suns[0]:.2f} deg by its disc in the photograph")
        else:
            remarks.append(
                f"sun: its disc in the photograph stands at {disc:.2f} deg, outside of the {suns[0]:g} to {suns[-1]:g} "
                "deg that are searched"
            )
    with progress_bar() as bar:
        libraries = []
        try:
            for i, name in enumerate(types):
                file = None if folder_of_libraries is None else folder_of_libraries / f"{config.title}_{name}.npz"
                part = part_of(bar, 0.85 * i / len(types), 0.85 / len(types))
                made_here = make_library(config, design, name, suns, photograph.cell_deg, file=file, progress=part)
                libraries.append(made_here)
        except KeyboardInterrupt:
            if not libraries:
                raise
        untried = types[len(libraries) :]
        if untried:
            names = ", ".join(types[: len(libraries)])
            print(
                f"twilight: interrupted; fits {names}, not {', '.join(untried)} (once more to stop at once)",
                file=sys.stderr,
            )
        # the glare of a sun whose height is searched is masked about the middle of the search
        middle = libraries[0].apparent_elevations_deg
        azimuth = _sun_azimuth(photograph, config, suns, sun_azimuth)
        seen = photograph.seen(azimuth, float(0.5 * (middle[0] + middle[-1])))

        def compute(name: str, values: Any) -> Any:
            scene = _scene(config, design, values, name, photograph.cell_deg, suns)
            return sky_to_xyz(run(resolve(scene), numpy_only_sun=True), observer=OBSERVER)

        made = fit(seen.sky, libraries, refine=compute, progress=part_of(bar, 0.85, 0.1), **free)
    findings = [*sentences(made), unconstrained_wavelengths(free["white_balance"], free["with_colour"])]
    if any(p.name == HORIZON and p.constrained for p in made[0].parameters):
        findings.append(_beyond(config, made[0].values[HORIZON]))
    unseen = [f"aerosol type: {', '.join(untried)} was not tried: interrupted"] if untried else []
    best = made[0]
    final = _scene(config, design, best.values, best.aerosol_type, photograph.cell_deg, suns)
    _write_climate(folder / "climate.yaml", final.climate)
    write_json(
        folder / "estimate.json",
        {
            "photograph": image.name,
            "scene": config.title,
            "suns_deg": suns,
            "emulation": {
                library.aerosol_type: {"luminance_rms": library.luminance_error, "uv_rms": library.chromaticity_error}
                for library in libraries
            },
            "estimates": facts(made),
            "remarks": [*remarks, *findings, *unseen],
        },
    )
    rows = [
        [
            p.name,
            f"{p.value:.4g}",
            f"{p.standard_error:.2g}",
            f"{p.low:.4g} to {p.high:.4g}",
            p.unit,
            "yes" if p.constrained else "no",
        ]
        for p in best.parameters
    ]
    print_table(
        ["type", "misfit", "chi2 above best"],
        [[e.aerosol_type, f"{e.misfit:.4g}", f"{e.chi2_above_best:.3g}"] for e in made],
        right=(1, 2),
    )
    print_table(["parameter", "value", "+-", "interval", "unit", "constrained"], rows, right=(1, 2))
    for line in [*remarks, *findings, *unseen]:
        print(line)
    luminance = max(one.luminance_error for one in libraries)
    chromaticity = max(one.chromaticity_error for one in libraries)
    print(
        f"emulated skies are off by up to {100 * luminance:.1f} % in luminance and {chromaticity:.4f} in u', v' "
        "(root mean squares of a type); the uncertainties hold this"
    )
    compare_with_sky(image, photograph, final, sun_azimuth, free["white_balance"], folder)
    print(f"wrote estimate.json and climate.yaml to {folder}/")
    if untried:
        raise typer.Exit(130)


def _scene(config: Any, design: Any, values: Any, aerosol_type: str, cell_deg: float, suns: list[float]) -> Any:
    """The configuration of one climate of the design, and of its sun where that is a parameter or the disc's."""
    from twilight.config.sun import SunElevations
    from twilight.studies.validate.photographs.library import SUN, climate_settings, with_settings

    settings = climate_settings(design, values, aerosol_type) | {"texture": {"resolution_deg": cell_deg}}
    if SUN in values:
        settings["sun"] = {"elevation_deg": values[SUN]}
    elif isinstance(config.sun, SunElevations):
        settings["sun"] = {"elevation_deg": suns[0]}
    return with_settings(config, settings)


def _beyond(config: Any, cover: float) -> str:
    """What lay beyond the horizon, which climate.yaml does not hold."""
    from twilight.config.horizon import HorizonClouds

    section = config.horizon.screen
    clouds = HorizonClouds() if section is None or section.clouds is None else section.clouds
    return (
        f"what lay beyond the horizon: clouds up to about {clouds.top_km:g} km that stop {cover:.0%} of the sunbeams "
        f"(climate.yaml does not hold it: --set horizon.screen.clouds.cover={cover:.2f})"
    )


def _sun_azimuth(photograph: Any, config: Any, suns: list[float], given: float | None) -> float:
    """The sun's azimuth in the camera's azimuths, as `twilight validate photo` takes it."""
    from types import SimpleNamespace

    from twilight.config.sun import SunAt
    from twilight.sky.ephemeris import sun_position

    known = None
    if isinstance(config.sun, SunAt):
        sun = config.sun
        at = sun_position(sun.aware(sun.at), sun.latitude_deg, sun.longitude_deg, config.observer.altitude_km)
        known = float(at.azimuth_deg)
    return sun_azimuth_of(photograph, SimpleNamespace(sun_azimuth_deg=known), given)[0]


def _write_climate(path: Path, climate: Any) -> None:
    import yaml

    from twilight.base.whole_files import whole_file

    data = climate.model_dump(mode="json", exclude_none=True, exclude_defaults=True)
    data = {"version": 1, **data}
    with whole_file(path) as temporary:
        temporary.write_text(yaml.safe_dump(data, sort_keys=False, allow_unicode=True, width=120), encoding="utf-8")
