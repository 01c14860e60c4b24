"""`twilight airmass`: air-mass factors of a gas for every sun, with box factors of the layers."""

from __future__ import annotations

from contextlib import ExitStack
from pathlib import Path
from typing import Annotated, Any

from twilight.base.errors import TwilightError
from twilight.cli import options
from twilight.cli.options import option
from twilight.cli.terminal import print_table, progress_bar


def airmass(
    scene: Annotated[str, options.SCENE_BY_FILE],
    gas: Annotated[str, option("NAME", "o3 or no2, as in the scene's model atmosphere; any name with --profile.")] = (
        "no2"
    ),
    profile: Annotated[
        Path | None, option("FILE.csv", "The gas by altitude: columns altitude_km and density_per_cm3 [cm^-3].")
    ] = None,
    sun: Annotated[
        str, option("DEG", "Solar zenith angles: first:last:step, or numbers with commas between them.")
    ] = "80:96:0.5",
    wavelength: Annotated[str, option("NM,...", "Wavelengths, outside bands of oxygen and water vapour.")] = "470",
    elevation: Annotated[float, option("DEG", "Elevation of the line of sight; 90 looks into the zenith.")] = 90.0,
    azimuth: Annotated[float, option("DEG", "Azimuth of the line of sight from the sun.")] = 0.0,
    layers: Annotated[
        str | None, option("KM,...", "Altitudes that bound the layers; without it, 15 layers up to 70 km.")
    ] = None,
    solver: Annotated[str | None, option("NAME", "zones (as it is without this), or montecarlo.")] = None,
    quality: Annotated[str | None, options.QUALITY] = None,
    vary: Annotated[
        list[str] | None,
        option("KEY=V,...", "A table over values of a key, e.g. ground.albedo=0,0.8; may be repeated."),
    ] = None,
    workers: Annotated[int | None, option("N", "Processes on this machine, by Dask; without it, this process.")] = None,
    scheduler: Annotated[str | None, option("ADDRESS", "A running Dask scheduler, e.g. tcp://10.0.0.1:8786.")] = None,
    settings: Annotated[list[str] | None, options.SETTINGS] = None,
    output: Annotated[Path | None, option("DIR", "Folder for tables, netCDF and picture.")] = None,
) -> None:
    """Compute air-mass factors of a gas: slant over vertical column, as seen in scattered sunlight.

    They are of a weak absorber, which leaves the light that others see as it is. A table holds every air of --vary,
    or of the configuration's own `vary`. On several processes each air is computed apart, and montecarlo divides its
    samples too.
    """
    from twilight.config.load import load_axes

    suns = options.parse_numbers_or_range(sun, "--sun", 0.0, 108.0)
    wavelengths = options.parse_numbers(wavelength, "--wavelength", 300.0, 1000.0)
    options.check_range(elevation, "--elevation", -90.0, 90.0)
    options.check_range(azimuth, "--azimuth", -720.0, 720.0)
    edges = None if layers is None else options.parse_numbers(layers, "--layers", 0.0, 200.0)
    given: options.Given = {
        "wavelengths": ({"list_nm": sorted(wavelengths)}, "--wavelength"),
        "solver.name": (solver, "--solver"),
        "solver.quality": (quality, "--quality"),
        "vary": (dict(map(_axis, vary)) if vary else None, "--vary"),
    }
    series = load_axes(scene, *options.settings_of(settings, given))
    for axis in series.axes:
        for key in axis.points[0]:
            if key.split(".")[0] in ("wavelengths", "sun", "output"):
                raise TwilightError(f"vary: {key} cannot be an axis of this table; allowed is what air, ground, "
                                    "observer and solver have, and --sun and --wavelength take lists")  # fmt: skip
    config = series.config({key: value for axis in series.axes for key, value in axis.points[0].items()})
    options.check_range(workers, "--workers", 1, options.MAX_WORKERS)
    if scheduler is not None and workers is not None:
        raise TwilightError("--scheduler: a running scheduler has its own workers; no --workers")
    folder = options.output_folder(output, "airmass", config.title)

    from twilight.studies.airmass import factors, gas_profile, report
    from twilight.studies.airmass.table import Question, box_table
    from twilight.studies.sweep.resources import Resources, connect

    if profile is None:
        absorber = gas_profile.of_atmosphere(gas, config.climate.atmosphere.profile)
    else:
        absorber = gas_profile.read_profile(profile, gas)
    question = Question(
        tuple(90.0 - zenith for zenith in suns), elevation, azimuth, None if edges is None else tuple(edges)
    )
    with progress_bar() as bar, ExitStack() as stack:
        client, count = None, 1
        if workers is not None or scheduler is not None:
            client = stack.enter_context(connect(Resources(scheduler, None, workers, None)))
            count = sum(worker["nthreads"] for worker in client.scheduler_info(n_workers=-1)["workers"].values())
        found = box_table(series, question, bar, client, count)
    found = factors.with_gas(found, absorber)
    found.attrs |= {"title": f"Air-mass factors of {gas}", "scene": config.title}
    folder.mkdir(parents=True, exist_ok=True)
    report.write_tables(found, folder)
    direction = "zenith" if elevation == 90.0 else f"elevation {elevation:g}, azimuth {azimuth:g} deg"
    report.draw(found, folder / "airmass.png", f"{config.title}, {direction}")
    columns, lines = report.rows(found)
    print_table(columns, lines, right=tuple(range(len(columns))))
    print(f"wrote {folder}: airmass.csv, boxes.csv, airmass.nc, airmass.png")


def _axis(text: str) -> tuple[str, Any]:
    """A dotted key with the list of its values, from `key=value,...`."""
    from twilight.config.load import parse_setting

    key, equals, values = text.partition("=")
    if not equals or not key.strip() or not values.strip():
        raise TwilightError(f"--vary {text}: must be key=value,..., e.g. ground.albedo=0,0.8")
    return parse_setting(f"{key}=[{values}]")
