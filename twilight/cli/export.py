"""`twilight export`: tables for real-time renderers."""

from __future__ import annotations

import time
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any, Literal

import typer

from twilight.base.errors import TwilightError
from twilight.cli import options
from twilight.cli.export_prague import prague
from twilight.cli.export_shader import shader
from twilight.cli.options import argument, flag, option
from twilight.cli.terminal import progress_bar, with_errors_as_sentences

RGB_NM = (680.0, 550.0, 440.0)
"""Wavelengths of red, green and blue (Bruneton and Neyret 2008 sec. 2.1, and his code of 2017)."""
TAKRAM_KM = (6360.0, 6420.0)
"""Radii of the ground and of the top that @takram/three-atmosphere has."""


def tables(
    climate: Annotated[
        str, argument("CLIMATE", "Name or file of a climate; of a configuration its climate and its horizon count.")
    ],
    layout: Annotated[
        Literal["twilight", "bruneton2017", "takram"], option("NAME", "twilight, bruneton2017 or takram.")
    ] = "twilight",
    output: Annotated[Path | None, option("DIR", "New folder; without it, out/CLIMATE-LAYOUT.")] = None,
    solver: Annotated[Literal["zones", "tables"], option("NAME", "Whose field fills them: zones or tables.")] = "zones",
    quality: Annotated[str, options.QUALITY] = "standard",
    half: Annotated[bool, flag("--half", "Half floats, in bruneton2017; takram always has them.")] = False,
    single_mie: Annotated[
        bool, flag("--single-mie", "single_mie_scattering too, in takram: aerosol in its own colours.")
    ] = False,
    higher_order: Annotated[
        bool, flag("--higher-order", "higher_order_scattering too, in takram: light that mountains' shadows leave.")
    ] = False,
    exr: Annotated[bool, flag("--exr", "OpenEXR, slices stacked, instead of .bin, in takram.")] = False,
    scale: Annotated[
        float | None, option("FACTOR", "On scattering and irradiance; 4096 for half floats, 1 otherwise.")
    ] = None,
) -> None:
    """Write the sky of a climate, for every sun, as tables that a graphics card reads."""
    if layout == "twilight" and (half or scale is not None):
        raise TwilightError("--half and --scale: are for bruneton2017 and takram; twilight is float32")
    for name, asked in (("--single-mie", single_mie), ("--higher-order", higher_order), ("--exr", exr)):
        if asked and layout != "takram":
            raise TwilightError(f"{name}: is for takram, {layout} has no such file")
    options.check_range(scale, "--scale", 1e-6, 1e9)
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
    from twilight.studies.export import bruneton, sky_tables
    from twilight.studies.export.field_values import FieldSource
    from twilight.studies.export.folder import check_new, write_folder

    model = load_climate(climate)
    folder = output or Path("out") / f"{model.name}-{layout}"
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
    }
    solar = np.interp(medium.wavelength_nm, *solar_spectrum())
    begin = time.process_time()
    with progress_bar() as bar:
        field = load(solver).prepare(medium, settings, progress=part_of(bar, 0.0, 0.2))
        solved = time.process_time()
        source = FieldSource(field, medium, facts["refraction"])
        progress = part_of(bar, 0.2, 0.8)
        if layout == "twilight":
            facts["solar_irradiance"] = solar[::-1].tolist()
            altitudes = sky_tables.altitudes_of(medium.bottom_km, medium.top_km)
            files = sky_tables.fill(source, sky_tables.SkyTableSizes(altitude_km=altitudes), facts, progress).files()
        else:
            r = medium.earth_radius_km
            radii = TAKRAM_KM if layout == "takram" else (r + medium.bottom_km, r + medium.top_km)
            half = half or layout == "takram"
            made = bruneton.fill(
                source,
                solar,
                mapping=bruneton.make_mapping(*radii),
                scale=scale or (4096.0 if half else 1.0),
                facts={**facts, "layout": layout, "number": "float16" if half else "float32"},
                progress=progress,
                separate=single_mie,
                higher_order=higher_order,
            )
            files = made.files("exr" if exr else "bin" if layout == "takram" else "dat", half)
    write_folder(folder, files)
    size = sum(len(content) for content in files.values())
    print(f"wrote {folder}: {', '.join(sorted(files))}; {size / 1e6:.1f} MB")
    print(f"processor time: {solved - begin:.0f} s for the field, {time.process_time() - solved:.0f} s for the tables")


app = typer.Typer(name="export", help="Tables for other programs.", no_args_is_help=True)
for command in (tables, shader, prague):
    app.command()(with_errors_as_sentences(command))
