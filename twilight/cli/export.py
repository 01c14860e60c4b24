"""`twilight export`: the sky of a climate for other programs.

`prague`: a file of the Prague Sky Model; `shader`: GLSL and WGSL with their textures.
"""

import time
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal

import typer

from twilight.base.errors import TwilightError
from twilight.cli import options
from twilight.cli.options import EndsIn, Within, argument, flag, option
from twilight.cli.terminal import progress_bar, with_errors_as_sentences

FULL_M = (0.0, 500.0, 1000.0, 2000.0, 4000.0, 7000.0, 10_000.0, 15_000.0)
"""Altitudes of viewpoints above the ground in the layout full."""


@dataclass(frozen=True)
class ChannelOptions:
    """The channels of a file of the Prague Sky Model."""

    channels: Annotated[int, option("N", "Channels."), Within(1, 60)] = 11
    start_nm: Annotated[float, option("NM", "Where the first channel begins.")] = 320.0
    width_nm: Annotated[float, option("NM", "Width of a channel."), Within(1.0, 200.0)] = 40.0
    nodes: Annotated[int, option("N", "Wavelengths of each channel at which light is computed."), Within(1, 8)] = 2

    def __post_init__(self) -> None:
        end_nm = self.start_nm + self.channels * self.width_nm
        if not (self.start_nm >= 280.0 and end_nm <= 1000.0):
            raise TwilightError(
                f"--channels {self.channels} of --width-nm {self.width_nm:g} from --start-nm {self.start_nm:g} reach "
                f"from {self.start_nm:g} to {end_nm:g} nm; allowed is 280 to 1000 nm"
            )


def prague(
    climates: Annotated[
        list[str],
        argument(
            "CLIMATE...",
            "A climate whose aerosol is scaled to the visibilities, or several that are taken as they are.",
            options.climate_names,
        ),
    ],
    output: Annotated[Path, option("FILE.dat", "The file."), EndsIn([".dat"])],
    spectrum: ChannelOptions,
    layout: Annotated[
        Literal["ground", "full"], option("NAME", "ground: seen from it; full: from eight altitudes to 15 km.")
    ] = "ground",
    visibility: Annotated[
        str | None, option("KM,...", "Visibilities; without it, 20,32,51,82,131.8 of one climate.")
    ] = None,
    albedo: Annotated[str, option("A,...", "Albedos of the ground.")] = "0,1",
    rank: Annotated[int, option("N", "Products in each sky."), Within(1, 20)] = 9,
    polarisation: Annotated[bool, flag("--polarisation", "The degree of polarisation too.")] = False,
    quality: Annotated[str, option("NAME", "Preset of zones.")] = "draft",
) -> None:
    """Write the sky of a climate, for every sun down to -18 deg, as a file of the Prague Sky Model."""
    visibilities = None if visibility is None else tuple(options.parse_numbers(visibility, "--visibility", 1.0, 400.0))
    albedos = sorted(options.parse_numbers(albedo, "--albedo", 0.0, 1.0))

    import numpy as np

    from twilight.base.sections import Origins
    from twilight.base.whole_files import check_file
    from twilight.config.solver import choose_solver
    from twilight.engine.field import solve
    from twilight.scene import resolve
    from twilight.studies.export.prague import SUN_DEG, PragueMaker
    from twilight.studies.export.prague_air import airs_of, channel_nodes
    from twilight.studies.export.prague_file import PragueAxes, write_prague
    from twilight.studies.export.prague_sky import SAFETY_M

    check_file(output)
    airs = airs_of(climates, visibilities)
    choose_solver({"name": "zones", "quality": quality}, Origins({(): "--quality"}))
    axes = PragueAxes(
        np.array([air.visibility_km for air in airs]),
        np.array(albedos),
        SAFETY_M + np.array(FULL_M if layout == "full" else (0.0,)),
        np.array(SUN_DEG),
        spectrum.channels,
        spectrum.start_nm,
        spectrum.width_nm,
    )
    asked = channel_nodes(spectrum.channels, spectrum.start_nm, spectrum.width_nm, spectrum.nodes)

    def field_of(v: int, b: int, progress: Any) -> Any:
        scene = resolve(airs[v].config(float(axes.albedo[b]), quality), wavelength_nm=asked.wavelength_nm)
        return solve(scene, progress=progress, cached=False)

    begin = time.process_time()
    with progress_bar() as bar:
        data = PragueMaker(axes, asked, rank, polarisation).make(field_of, bar)
    size = write_prague(output, data)
    for air in airs:
        depth = "its own aerosol" if air.depth is None else f"aerosol optical depth {air.depth:.3g}"
        print(f"visibility {air.visibility_km:.4g} km: {air.series.config({}).title}, {depth}")
    print(f"wrote {output}: {size / 1e6:.1f} MB, {' x '.join(map(str, axes.shape))} (visibilities, albedos, altitudes, "
          f"suns, channels)")  # fmt: skip
    print(f"processor time: {time.process_time() - begin:.0f} s")


def shader(
    climate: Annotated[str, argument("CLIMATE", "Name or file of a climate or configuration.")],
    keys: options.SolverSettings,
    output: Annotated[Path | None, option("DIR", "New folder; without it, out/CLIMATE-shader.")] = None,
) -> None:
    """Write the sky of a climate for one observer and every sun as GLSL and WGSL with two textures, and a page."""
    from twilight.cli.compiling import announce_compiling
    from twilight.engine import solve
    from twilight.scene import resolve
    from twilight.show.shader import shader_sky
    from twilight.show.skies import check_altitudes
    from twilight.studies.export.prague import check_new, write_folder

    chosen, names = keys.chosen()
    config = options.load_one_scene(climate, chosen, names, "export shader")
    scene = resolve(config)
    name = scene.medium.name or config.title
    check_altitudes(scene, None, name)
    folder = output or Path("out") / f"{options.file_stem(name, 'sky')}-shader"
    check_new(folder)
    announce_compiling(config.chosen_solver.name)
    with progress_bar() as bar:
        from twilight.base.progress import part_of

        solved = solve(scene, progress=part_of(bar, 0.0, 0.3))
        files = shader_sky(solved, name, config.solar_spectrum, progress=part_of(bar, 0.3, 0.7)).files()
    write_folder(folder, files)
    size = len(files["sky.bin"]) + len(files["lines.bin"])
    print(f"wrote {folder}: {', '.join(sorted(files))}; textures of {size / 1e6:.1f} MB; open index.html in a browser")


app = typer.Typer(name="export", help="Tables for other programs.", no_args_is_help=True)
for command in (shader, prague):
    app.command()(with_errors_as_sentences(command))
