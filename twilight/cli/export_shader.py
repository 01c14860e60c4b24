"""`twilight export shader`: the sky of one air for shaders."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from twilight.cli import options
from twilight.cli.options import argument, option
from twilight.cli.terminal import progress_bar


def shader(
    climate: Annotated[str, argument("CLIMATE", "Name or file of a climate or configuration.")],
    output: Annotated[Path | None, option("DIR", "New folder; without it, out/CLIMATE-shader.")] = None,
    quality: Annotated[str | None, options.QUALITY] = None,
    settings: Annotated[list[str] | None, options.SETTINGS] = None,
) -> None:
    """Write the sky of a climate for one observer and every sun as GLSL and WGSL with two textures, and a page."""
    from twilight.cli.first_run import announce_compiling
    from twilight.engine import solve
    from twilight.scene import resolve
    from twilight.studies.export.folder import check_new, write_folder
    from twilight.viewer import check_altitudes
    from twilight.viewer.shader import shader_sky

    chosen, names = options.settings_of(settings)
    options.put_options(chosen, names, {"solver.quality": (quality, "--quality")})
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
