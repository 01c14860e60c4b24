"""`twilight fit`: analytic models fitted to computed skies."""

from __future__ import annotations

import itertools
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import typer

from twilight.base.errors import TwilightError
from twilight.base.extras import require
from twilight.cli import options
from twilight.cli.options import argument, flag, option
from twilight.cli.terminal import print_table, progress_bar, with_errors_as_sentences

TURBIDITIES = (2.0, 3.0, 4.0, 5.0, 6.0)
"""Turbidities that the coefficients are fitted to (Preetham 1999 sec. 3.2)."""
SUNS = 12
"""Elevations of the sun that the coefficients are fitted to (Preetham 1999 sec. 3.2)."""
LOWEST_SUN_DEG = 5.0
"""Lowest of these elevations [deg]."""
DIRECTIONS = 343
"""Directions of each sky that the coefficients are fitted to (Preetham 1999 sec. 3.2)."""
HELD_OUT_TURBIDITIES = (2.5, 4.5, 5.5)
"""Turbidities, between those of the fit, in which its error is reported."""
HELD_OUT_SUN_ZENITH_DEG = (12.0, 43.0, 66.0, 81.0)
"""Solar zenith angles [deg], between those of the fit, in which its error is reported."""

PER_SKY_COLUMNS = ("sky", "quantity", "A", "B", "C", "D", "E", "zenith", "median_error", "p95_error")
"""Of the table of several skies; zenith: cd m^-2, or x and y of it; errors of |model / sky - 1| by solid angle."""


@dataclass(frozen=True, kw_only=True)
class FitSettings(options.SolverSettings):
    """The solver too."""

    solver: options.Solver = None


def perez(
    keys: FitSettings,
    scene: Annotated[
        str, argument("CLIMATE_OR_CONFIG", "Climate or configuration; with --per-sky also a sky.h5 or a sweep's Zarr.")
    ] = "continental-average",
    per_sky: Annotated[bool, flag("--per-sky", "Fit the five parameters to each sky of the scene.")] = False,
    sun_elevation: Annotated[float | None, option("DEG", "With --per-sky: true elevation of the sun.")] = None,
    haze: Annotated[
        str | None, option("NAME", "Aerosol of the skies: climate (default), scaled, or preetham1999, the paper's.")
    ] = None,
    output: Annotated[Path | None, option("FILE.yaml", "Coefficients; without it, out/perez_NAME.yaml.")] = None,
) -> None:
    """Fit Perez's sky, as Preetham did: 5 turbidities, 12 suns, 343 directions; or five parameters to one sky."""
    options.check_suffix(output, "--output", ".yaml", ".yml", *([".csv"] if per_sky else []))
    if per_sky and haze is not None:
        raise TwilightError("--haze: takes part in the fit over turbidities, not in --per-sky")
    if not per_sky and sun_elevation is not None:
        raise TwilightError("--sun-elevation: is for --per-sky; the fit over turbidities has its own suns")
    sun = None if sun_elevation is None else {"elevation_deg": sun_elevation}
    chosen, names = keys.chosen({"sun": (sun, "--sun-elevation")})
    if per_sky:
        _each_sky(scene, chosen, names, output)
    else:
        _set(scene, chosen, names, haze or "climate", output)


def _set(scene: str, chosen: dict[str, Any], names: dict[str, str], haze: str, output: Path | None) -> None:
    import numpy as np

    from twilight.base.progress import part_of
    from twilight.solvers.analytic.coefficients import load_coefficients
    from twilight.studies.fit.perez import fit_set
    from twilight.studies.fit.truth import compute_truth, error_of, write_set

    config = options.load_one_scene(scene, chosen, names, "fit perez")
    name = config.title if haze == "climate" else f"{config.title}-{haze}"
    path = _path(output, name)
    solver, quality, _ = config.chosen_solver
    suns = [float(z) for z in np.linspace(0.0, 90.0 - LOWEST_SUN_DEG, SUNS)]
    with progress_bar() as bar:
        fraction = len(TURBIDITIES) / (len(TURBIDITIES) + len(HELD_OUT_TURBIDITIES))
        truth = compute_truth(config, TURBIDITIES, suns, DIRECTIONS, haze, part_of(bar, 0.0, 0.9 * fraction))
        held_out = compute_truth(
            config,
            HELD_OUT_TURBIDITIES,
            HELD_OUT_SUN_ZENITH_DEG,
            DIRECTIONS,
            haze,
            part_of(bar, 0.9 * fraction, 0.9 * (1.0 - fraction), "held out:"),
        )
        bar("least squares", 0.9)
        fitted = fit_set(truth.skies, name, f"twilight fit perez, {solver} ({quality}), haze: {haze}")
    sets = {"preetham1999": load_coefficients("preetham1999"), "this fit": fitted}
    groups = {"fitted skies": truth.skies, "held-out skies": held_out.skies}
    errors = {(s, g): error_of(coefficients, skies) for s, coefficients in sets.items() for g, skies in groups.items()}
    facts = {
        "climate": config.climate.name,
        "haze": haze,
        "solver": solver,
        "quality": quality,
        "ground_albedo": config.climate.ground.model_dump(mode="json")["albedo"],
        "turbidities": list(TURBIDITIES),
        "sun_zenith_deg": [round(z, 3) for z in suns],
        "directions": DIRECTIONS,
        "cpu_hours": round(truth.cpu_s / 3600.0, 4),
        "errors": {
            f"{s}, {g}": {key: round(value, 4) for key, value in vars(error).items()}
            for (s, g), error in errors.items()
        },
    }
    write_set(fitted, facts, path)
    columns = ["coefficients", "skies", "mean", "luminance", "distribution", "u'v'"]
    rows = [[s, g, *_error_cells(error)] for (s, g), error in errors.items()]
    print_table(columns, rows, right=(2, 3, 4, 5))
    print(
        "errors: mean of ln(model / truth); then median / 95th percentile of |model / truth - 1|, of the same with the"
    )
    print("best scale for every sky, and of the distance in u'v'")
    print(
        f"{len(truth.skies)} skies of {DIRECTIONS} directions by {solver} ({quality}): {truth.cpu_s / 3600.0:.3g} CPU "
        f"hours (Preetham 1999: 600), {truth.wall_s:.0f} s"
    )
    print(f"wrote {path}")


def _error_cells(error: Any) -> list[str]:
    return [
        f"{100 * error.luminance_bias:+.0f} %",
        f"{100 * error.luminance_median:.1f} / {100 * error.luminance_p95:.0f} %",
        f"{100 * error.distribution_median:.1f} / {100 * error.distribution_p95:.0f} %",
        f"{error.chromaticity_median:.4f} / {error.chromaticity_p95:.4f}",
    ]


def _each_sky(scene: str, chosen: dict[str, Any], names: dict[str, str], output: Path | None) -> None:
    from twilight.base.whole_files import write_csv
    from twilight.studies.fit.perez import fit_sky, single_set
    from twilight.studies.fit.truth import from_sky, write_set

    title, skies = _skies(scene, chosen, names)
    path = _path(output, title)
    rows, sets, numbers = [], [], []
    for label, sky in skies:
        colours = from_sky(sky)
        fits = fit_sky(colours)
        for fit in fits:
            values = [f"{p:.4g}" for p in fit.parameters]
            zenith = f"{fit.zenith:.4g}" + (" cd/m^2" if fit.quantity == "luminance" else "")
            error = f"{100 * fit.median_error:.2f} / {100 * fit.p95_error:.1f} %"
            rows.append([label, fit.quantity, *values, zenith, error])
            numbers.append([label, fit.quantity, *fit.parameters, fit.zenith, fit.median_error, fit.p95_error])
        facts = {
            "sky": label,
            "errors": {f.quantity: {"median": round(f.median_error, 5), "p95": round(f.p95_error, 5)} for f in fits},
        }
        sets.append((single_set(colours, fits, label, f"twilight fit perez --per-sky {scene}"), facts))
    if len(sets) == 1:
        write_set(*sets[0], path)
    else:
        path = path.with_suffix(".csv")
        write_csv(path, PER_SKY_COLUMNS, numbers, f"twilight fit perez --per-sky {scene}")
    print_table(["sky", "quantity", "A", "B", "C", "D", "E", "zenith", "error"], rows, right=tuple(range(2, 9)))
    print("error: median / 95th percentile of |model / sky - 1| by solid angle, without the aureole")
    print(f"wrote {path}")


def _skies(scene: str, chosen: dict[str, Any], names: dict[str, str]) -> tuple[str, Iterator[tuple[str, Any]]]:
    """A title, and labels and skies of a scene or of a file.

    Suns below the horizon are left out with a word.  What can be refused is refused before a sky is computed.
    """
    path = Path(scene)
    is_set = path.is_dir() and (path / "zarr.json").exists()
    if path.suffix in (".h5", ".nc") or is_set:
        if chosen:
            raise TwilightError(f"{names[next(iter(chosen))]}: {scene} is computed and takes no settings")
        if is_set:
            return options.file_stem(path.stem, "skies"), _skies_of_set(path)
        from twilight.io.netcdf import read_sky

        label = f"{path.resolve().parent.name}_{path.stem}"
        return label, iter([(label, read_sky(scene))])
    from twilight.config import load_series
    from twilight.scene.medium import wavelengths_of
    from twilight.scene.suns import suns_of
    from twilight.sky.colour import colour_is_defined

    wanted: list[tuple[Any, list[str]]] = []
    below: list[float] = []
    for case in load_series(scene, chosen, names):
        suns = list(suns_of(case.config))
        below += [sun.elevation_deg for sun in suns if sun.elevation_deg < 0.0]
        wanted.append((case, [sun.name for sun in suns if sun.elevation_deg >= 0.0]))
        nm = wavelengths_of(case.config)
        if nm is not None and not colour_is_defined(nm):
            raise TwilightError("wavelengths must reach from 480 to 600 nm: the fit needs luminance and chromaticity")
    _say_below(below, sum(len(suns) for _, suns in wanted))
    return options.file_stem(wanted[0][0].config.title, "skies"), _computed(wanted)


def _computed(wanted: list[tuple[Any, list[str]]]) -> Iterator[tuple[str, Any]]:
    from twilight.base.progress import part_of
    from twilight.engine import frames
    from twilight.scene import resolve

    total, done = sum(len(suns) for _, suns in wanted), 0
    with progress_bar() as bar:
        for case, suns in wanted:
            if not suns:
                continue
            part = part_of(bar, done / total, len(suns) / total, case.name)
            for frame in frames(resolve(case.config), part, wanted=suns):
                yield "_".join(part for part in (case.config.title, case.name, frame.name) if part), frame.sky
            done += len(suns)


def _skies_of_set(path: Path) -> Iterator[tuple[str, Any]]:
    """The skies of a data set that `twilight sweep` has written."""
    require(f"{path}: a data set of `twilight sweep`", "xarray", "zarr", "dask")
    import xarray  # optional

    import twilight.api.accessor  # noqa: F401 - optional: the accessor .sky

    try:
        data = xarray.open_zarr(path)
    except Exception as error:  # what a damaged store raises depends on the library
        raise TwilightError(f"{path}: cannot be read as a data set ({str(error).splitlines()[0]})") from None
    if "sun_normalised_radiance" not in data or "solar_elevation_angle" not in data.variables:
        raise TwilightError(f"{path}: holds no skies that twilight sweep has written")
    dims = [
        str(dim) for dim in data["sun_normalised_radiance"].dims if dim not in ("elevation", "azimuth", "wavelength")
    ]
    shape = [data.sizes[dim] for dim in dims]
    places = [dict(zip(dims, index, strict=True)) for index in itertools.product(*map(range, shape))]
    scenes = [(data.isel(place), place) for place in places]
    there = [(one, place) for one, place in scenes if int(one.get("status", 1)) == 1]
    suns = [float(one["solar_elevation_angle"]) for one, _ in there]
    _say_below([sun for sun in suns if sun < 0.0], sum(sun >= 0.0 for sun in suns))
    with progress_bar() as bar:
        for n, ((one, place), sun) in enumerate(zip(there, suns, strict=True)):
            if sun >= 0.0:
                label = " ".join(f"{dim} {_value(one, dim, i)}" for dim, i in place.items()) or path.stem
                bar(f"fitting {label}", n / len(suns))
                yield label, one.sky.scene()


def _value(scene: Any, dim: str, number: int) -> str:
    """Where a scene lies along a dimension: its value, else its number, as of draws."""
    if dim not in scene.coords:
        return str(number)
    value = scene[dim].item()
    return f"{value:g}" if isinstance(value, float) else str(value)


def _say_below(below: list[float], left: int) -> None:
    """Say which suns are left out; TwilightError where none is left."""
    if not below and left:
        return
    which = f"{min(below):g} to {max(below):g} deg" if len(set(below)) > 1 else "".join(f"{b:g} deg" for b in below[:1])
    if not left:
        raise TwilightError(f"there is no sun from 0 to 90 deg to fit to; those of the scene are at {which or 'none'}")
    print(
        f"twilight: {len(below)} of {len(below) + left} suns are left out, at {which}: the five parameters are for a "
        "sun from 0 to 90 deg",
        file=sys.stderr,
    )


def _path(output: Path | None, name: str) -> Path:
    """Where the coefficients go; the folder is checked before anything is computed."""
    from twilight.base.whole_files import check_file

    path = output or Path("out") / f"perez_{name}.yaml"
    check_file(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    return path


app = typer.Typer(name="fit", help="Fit analytic models to computed skies.", no_args_is_help=True)
app.command()(with_errors_as_sentences(perez))
