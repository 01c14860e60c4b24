"""`twilight fluxes`: irradiances, actinic fluxes, heating and photolysis at altitudes, for suns."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from twilight.base.errors import TwilightError
from twilight.cli import options
from twilight.cli.options import option
from twilight.cli.terminal import print_table, progress_bar

USUAL_NM = (
    281, 284, 288, 292, 296, 299, 302, 305, 308, 311, 314, 317, 320, 324, 328, 334, 340, 350, 365, 380, 395, 410, 425,
    450, 475, 500, 525, 550, 575, 600, 625, 650, 680, 710, 740, 770, 800,
)  # fmt: skip
"""Wavelengths [nm] where the scene names none: light of all reactions."""


def fluxes(
    scene: Annotated[str, options.SCENE],
    sun_elevation: Annotated[str, option("DEG,...", "True elevations of the sun.")] = "60,30,10,0,-3,-6",
    altitude_km: Annotated[str | None, option("KM,...", "Altitudes; without it, the ground to 60 km.")] = None,
    quality: Annotated[str | None, options.QUALITY] = None,
    settings: Annotated[list[str] | None, options.SETTINGS] = None,
    output: Annotated[Path | None, option("DIR", "Folder for the files; without it, out/fluxes-NAME.")] = None,
) -> None:
    """Irradiances, actinic fluxes, heating rates and photolysis frequencies at altitudes, for any sun.

    Writes fluxes.nc with the spectra, fluxes.csv with their integrals, fluxes.png.  Without `wavelengths` in the scene
    they are 37 from 281 to 800 nm, for photolysis of NO2, O3 and NO3; that takes minutes the first time.
    """
    import numpy as np

    from twilight.engine import check_size, solve
    from twilight.scene import resolve
    from twilight.studies.flux import report
    from twilight.studies.flux.fluxes import check, fluxes_of
    from twilight.studies.flux.rates import air_of, heating_rates, photolysis_frequencies

    suns = options.parse_numbers(sun_elevation, "--sun-elevation", -90.0, 90.0)
    chosen, names = options.settings_of(settings)
    options.put_options(chosen, names, {"solver.quality": (quality, "--quality")})
    config = options.load_one_scene(scene, chosen, names, "fluxes")
    if config.wavelengths is None and config.climate.medium is None:
        config = options.load_one_scene(scene, {**chosen, "wavelengths": {"list_nm": list(USUAL_NM)}}, names, "fluxes")
    resolved = resolve(config)
    ground = resolved.medium.bottom_km
    if altitude_km is None:
        altitudes = [ground, *(z for z in (2.0, 5.0, 10.0, 15.0, 20.0, 25.0, 30.0, 40.0, 50.0, 60.0) if z > ground)]
    else:
        altitudes = sorted(options.parse_numbers(altitude_km, "--altitude-km", 0.0, 40000.0))
    check(resolved, np.array(altitudes))
    folder = options.output_folder(output, "fluxes", config.title)
    check_size(config)
    try:
        air = air_of(resolved, np.array(altitudes))
    except TwilightError as error:
        typer.echo(f"twilight: without heating and photolysis: {error}", err=True)
        air = None
    with progress_bar() as bar:
        from twilight.base.progress import part_of

        solved = solve(resolved, None, part_of(bar, 0.0, 0.6))
        spectrum, au = config.solar_spectrum, 1.0
        found = fluxes_of(
            solved, suns, altitudes, solar_spectrum=spectrum, distance_au=au, progress=part_of(bar, 0.6, 0.4)
        )
    if air is not None:
        found["heating_rate"] = heating_rates(found, air)
        found = found.merge(photolysis_frequencies(found, air.temperature_k), combine_attrs="no_conflicts")
    folder.mkdir(parents=True, exist_ok=True)
    files = report.write(found, folder)
    columns, rows = report.table(found)
    shown = [i for i, c in enumerate(columns) if c not in ("direct_up_w_per_m2", "diffuse_up_w_per_m2")]
    print_table(
        [columns[i] for i in shown], [[f"{row[i]:.4g}" for i in shown] for row in rows], right=tuple(range(len(shown)))
    )
    print(f"wrote {', '.join(files)} to {folder}/")
