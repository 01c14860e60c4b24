"""`twilight fit compact`: a climate's skies in one small file."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from twilight.base.errors import TwilightError
from twilight.cli import options
from twilight.cli.options import argument, option
from twilight.cli.terminal import print_table, progress_bar

FITTED_KEYS = (
    "sun",
    "wavelengths",
    "texture",
    "output",
    "observer",
    "night",
    "moon",
    "vary",
    "solar_spectrum",
    "omit_negligible",
)
"""Keys and sections of a configuration that change nothing in a compact model."""
FITTED_CLIMATE_KEYS = ("aerosol.optical_depth_550nm", "ground.albedo")
"""Keys of a climate that a compact model is a function of."""


def compact(
    climate: Annotated[str, argument("CLIMATE", "Climate or configuration.")] = "continental-average",
    output: Annotated[Path | None, option("FILE.npz", "Model; without it, out/compact_NAME.npz.")] = None,
    quality: Annotated[str | None, option("NAME", "Preset of the solver zones.")] = None,
    optical_depths: Annotated[
        str | None,
        option("LIST", "Aerosol optical depths at 550 nm, at least 4; 7 from 0.01 to 0.8 and the climate's own."),
    ] = None,
    settings: Annotated[list[str] | None, options.SETTINGS] = None,
) -> None:
    """Fit a compact spectral sky: every sun to -18 deg, direction, 380 to 740 nm, aerosol load, albedo and ozone."""
    from twilight.base.whole_files import check_file
    from twilight.studies.fit.compact.build import fit_compact, seconds_per_value, write_model

    options.check_suffix(output, "--output", ".npz")
    depths = None if optical_depths is None else options.parse_numbers(optical_depths, "--optical-depths", 0.0, 100.0)
    chosen, names = options.settings_of(settings, {"solver.quality": (quality, "--quality")})
    for key in chosen:
        if key.split(".")[0] in FITTED_KEYS or key.removeprefix("climate.") in FITTED_CLIMATE_KEYS:
            raise TwilightError(f"--set {key}: changes nothing in a compact sky, which is for all of these")
    config = options.load_one_scene(climate, chosen, names, "fit compact")
    path = output or Path("out") / f"compact_{config.climate.name}.npz"
    check_file(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    with progress_bar() as bar:
        fit = fit_compact(config, depths, bar)
    size = write_model(fit.model, path)
    value_s, grid_s, sky_s = seconds_per_value(fit.model)
    rows = []
    for e in fit.errors:
        percents = [f"{100.0 * error:.2f} %" for error in (e.median, e.p95, e.largest)]
        rows.append([f"{e.sun_elevation_deg[0]:g} to {e.sun_elevation_deg[1]:g}", e.part, *percents])
    print_table(["sun [deg]", "directions", "median", "95 %", "largest"], rows, right=(2, 3, 4))
    print(f"errors against {fit.model.provenance['solver']} ({fit.model.provenance['quality']}) of skies that were not")
    print("fitted: random suns, directions, wavelengths, aerosol loads, albedos and ozone columns")
    print(f"{fit.cpu_s / 60.0:.3g} minutes of processor time, {fit.wall_s / 60.0:.3g} minutes")
    print(f"{value_s * 1e9:.0f} ns for a direction and wavelength, {grid_s * 1e9:.0f} ns on rows and columns, ", end="")
    print(f"{sky_s * 1e3:.2g} ms for a sun")
    print(f"wrote {path} ({size / 1e6:.2f} MB)")
