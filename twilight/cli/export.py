"""`twilight export`: tables for real-time renderers."""

from __future__ import annotations

import time
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any, Literal

import typer

from twilight.cli import options
from twilight.cli.export_prague import prague
from twilight.cli.export_shader import shader
from twilight.cli.options import argument, option
from twilight.cli.terminal import progress_bar, with_errors_as_sentences

RGB_NM = (680.0, 550.0, 440.0)
"""Wavelengths of red, green and blue (Bruneton and Neyret 2008 sec. 2.1)."""


def tables(
    climate: Annotated[
        str, argument("CLIMATE", "Name or file of a climate; of a configuration its climate and its horizon count.")
    ],
    output: Annotated[Path | None, option("DIR", "New folder; without it, out/CLIMATE-tables.")] = None,
    solver: Annotated[Literal["zones", "tables"], option("NAME", "Whose field fills them: zones or tables.")] = "zones",
    quality: Annotated[str, options.QUALITY] = "standard",
) -> None:
    """Write the sky of a climate, for every sun, as tables that a graphics card reads, with their reader in GLSL."""
    import numpy as np

    from twilight import __version__
    from twilight.base.progress import part_of
    from twilight.config import load_climate, load_series
    from twilight.config.solver import choose_solver
    from twilight.config.validate import Origins
    from twilight.numerics.spectrum import solar_spectrum
    from twilight.scene.horizon import described, screen_of
    from twilight.scene.medium import climate_medium
    from twilight.solvers import load
    from twilight.studies.export import sky_tables
    from twilight.studies.export.field_values import FieldSource
    from twilight.studies.export.folder import check_new, write_folder

    model = load_climate(climate)
    folder = output or Path("out") / f"{model.name}-tables"
    check_new(folder)
    horizon = load_series(climate)[0].config.horizon
    medium = replace(climate_medium(model, np.array(RGB_NM[::-1])), screen=screen_of(horizon))
    _, _, settings = choose_solver({"name": solver, "quality": quality}, Origins({(): "--quality"}))
    facts: dict[str, Any] = {
        "program": f"twilight {__version__}",
        "climate": model.name,
        **({} if medium.screen is None else {"beyond_the_horizon": described(horizon)}),
        "wavelength_nm": list(RGB_NM),
        "solver": solver,
        "quality": quality,
        "refraction": solver == "zones" and medium.has_refraction,
        "solar_irradiance": np.interp(medium.wavelength_nm, *solar_spectrum())[::-1].tolist(),
    }
    begin = time.process_time()
    with progress_bar() as bar:
        field = load(solver).prepare(medium, settings, progress=part_of(bar, 0.0, 0.2))
        solved = time.process_time()
        source = FieldSource(field, medium, facts["refraction"])
        altitudes = sky_tables.altitudes_of(medium.bottom_km, medium.top_km)
        sizes = sky_tables.SkyTableSizes(altitude_km=altitudes)
        files = sky_tables.fill(source, sizes, facts, part_of(bar, 0.2, 0.8)).files()
    write_folder(folder, files)
    size = sum(len(content) for content in files.values())
    print(f"wrote {folder}: {', '.join(sorted(files))}; {size / 1e6:.1f} MB")
    print(f"processor time: {solved - begin:.0f} s for the field, {time.process_time() - solved:.0f} s for the tables")


app = typer.Typer(name="export", help="Tables for other programs.", no_args_is_help=True)
for command in (tables, shader, prague):
    app.command()(with_errors_as_sentences(command))
