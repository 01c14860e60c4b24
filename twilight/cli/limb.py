"""`twilight limb`: radiance against tangent altitude as seen from space, and solar occultation."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from twilight.base.errors import TwilightError
from twilight.cli import options
from twilight.cli.options import flag, option
from twilight.cli.terminal import print_table, progress_bar

PRINTED = 12
"""About how many lines of sight are printed."""


def limb(
    scene: Annotated[str, options.SCENE_BY_FILE],
    tangent_km: Annotated[
        str, option("KM", "Apparent tangent altitudes: first:last:step, or numbers with commas between them.")
    ] = "10:80:2",
    sun_zenith: Annotated[float | None, option("DEG", "Solar zenith angle at the tangent point.")] = None,
    sun_elevation: Annotated[float | None, option("DEG", "In place of it: true elevation of the sun there.")] = None,
    azimuth: Annotated[float | None, option("DEG", "Of the line of sight from the sun, there; without it, 90.")] = None,
    wavelength: Annotated[str, option("NM,...", "Wavelengths.")] = "470,600,675",
    altitude_km: Annotated[float, option("KM", "Of the observer, above the air.")] = 600.0,
    field_of_view_km: Annotated[
        float | None, option("KM", "Width in tangent altitude over which light is averaged; without it, a line.")
    ] = None,
    field_of_view_shape: Annotated[str, option("NAME", "box, or gaussian with that width at half maximum.")] = "box",
    air_mass: Annotated[
        bool, flag("--air-mass", "Box air-mass factors too: derivatives by the absorption of each layer.")
    ] = False,
    layers: Annotated[
        str | None, option("KM,...", "Altitudes that bound their layers; without it, 15 layers up to 70 km.")
    ] = None,
    occultation: Annotated[
        bool, flag("--occultation", "The sun behind the limb, in place of scattered light.")
    ] = False,
    solver: Annotated[str | None, option("NAME", "zones (as it is without this), or montecarlo.")] = None,
    quality: Annotated[str | None, options.QUALITY] = None,
    settings: Annotated[list[str] | None, options.SETTINGS] = None,
    output: Annotated[Path | None, option("DIR", "Folder for tables, netCDF and picture.")] = None,
) -> None:
    """Radiance of the limb against tangent altitude, seen from above the air; or the sun's light through the limb.

    Writes limb.csv, limb.nc and limb.png, or occultation.csv, .nc and .png: transmittance of the bent rays, the angle
    by which they are bent, and how thin that spreads sunlight.
    """
    tangents = options.parse_numbers_or_range(tangent_km, "--tangent-km", 0.0, 200.0)
    options.check_range(altitude_km, "--altitude-km", 50.0, 40_000.0)
    wavelengths = sorted(options.parse_numbers(wavelength, "--wavelength", 280.0, 1000.0))
    given: options.Given = {
        "wavelengths": ({"list_nm": wavelengths}, "--wavelength"),
        "solver.name": (solver, "--solver"),
        "solver.quality": (quality, "--quality"),
    }
    chosen, names = options.settings_of(settings, given)
    if occultation:
        for value, name in ((sun_zenith, "--sun-zenith"), (sun_elevation, "--sun-elevation"), (azimuth, "--azimuth")):
            if value is not None:
                raise TwilightError(f"{name}: is not for --occultation, where the sun stands behind the limb")
        for text, name in ((solver, "--solver"), (quality, "--quality")):
            if text is not None:
                raise TwilightError(f"{name}: is not for --occultation, which follows rays and solves nothing")
        if air_mass:
            raise TwilightError("--air-mass: is not for --occultation")
    elif (sun_zenith is None) == (sun_elevation is None):
        raise TwilightError("limb: takes either --sun-zenith or --sun-elevation, or --occultation")
    if layers is not None and not air_mass:
        raise TwilightError("--layers: is for --air-mass alone")
    if field_of_view_shape != "box" and field_of_view_km is None:
        raise TwilightError("--field-of-view-shape: goes with --field-of-view-km")
    options.check_range(azimuth, "--azimuth", -720.0, 720.0)
    options.check_range(sun_zenith, "--sun-zenith", 0.0, 108.0)
    options.check_range(sun_elevation, "--sun-elevation", -18.0, 90.0)
    edges = None if layers is None else options.parse_numbers(layers, "--layers", 0.0, 200.0)
    config = options.load_one_scene(scene, chosen, names, "limb")
    stem = "occultation" if occultation else "limb"
    folder = options.output_folder(output, stem, config.title)

    from twilight.base.progress import part_of
    from twilight.engine import check_size, solve
    from twilight.scene import resolve
    from twilight.studies.limb import geometry, report
    from twilight.studies.limb.limb import limb_of
    from twilight.studies.limb.occultation import occultation as occultation_of

    resolved = resolve(config)
    geometry.tangent_altitudes(resolved.medium, tangents, altitude_km)
    geometry.field_of_view(field_of_view_km, field_of_view_shape)
    if occultation:
        found = occultation_of(
            resolved.medium,
            tangents,
            bands=resolved.bands,
            observer_altitude_km=altitude_km,
            title=config.title,
            field_of_view_km=field_of_view_km,
            field_of_view_shape=field_of_view_shape,
        )
    else:
        check_size(config)
        with progress_bar() as bar:
            solved = solve(resolved, None, part_of(bar, 0.0, 0.7))
            found = limb_of(
                solved,
                tangents,
                90.0 - sun_zenith if sun_zenith is not None else float(sun_elevation or 0.0),
                90.0 if azimuth is None else azimuth,
                observer_altitude_km=altitude_km,
                air_mass=air_mass,
                edges_km=edges,
                progress=part_of(bar, 0.7, 0.3),
                field_of_view_km=field_of_view_km,
                field_of_view_shape=field_of_view_shape,
            )
    folder.mkdir(parents=True, exist_ok=True)
    files = report.write(found, folder, stem)
    columns, rows = report.table(found.isel(apparent_tangent_altitude=slice(None, None, -(-len(tangents) // PRINTED))))
    print_table(columns, rows, right=tuple(range(len(columns))))
    print(f"wrote {', '.join(files)} to {folder}/")
