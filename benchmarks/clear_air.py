"""Measure the errors of the model of all clear air, which `clear_air_fit.py` fits.

    python benchmarks/clear_air.py climates                              writes clear_air.csv
    python benchmarks/clear_air.py calibrate AIRS                        the error that it estimates; writes
                                                                         clear_air_estimated.csv
    python benchmarks/clear_air.py drawn AIRS APPROXIMATE                writes clear_air_drawn.csv
    python benchmarks/clear_air.py times                                 writes clear_air_times.csv
    python benchmarks/clear_air.py picture                               draws ../docs/clear-air.png

`climates` compares it with the Monte-Carlo reference solution of thirteen climates (`zones_error.py`), `drawn` with the
drawn airs that the fit held out, by type, wavelength, observer and stratosphere (arguments as of `clear_air_fit.py`);
`times` are processor seconds in a warm process.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from importlib import import_module
from pathlib import Path
from time import process_time
from typing import Any, get_args

import numpy as np
import results

sys.path.insert(0, str(Path(__file__).with_name("builders")))
from clear_air_airs import APART, SIDE_BY_SIDE, UNSOLVED, airs_of
from clear_air_airs import drawn as drawn_air
from clear_air_fit import COVERED, HELD_OUT, JUDGED_SUNS, LEAST_LEFT, SINGLE_ERROR, off, read
from clear_air_kept import degrees
from zones_error import CLIMATES
from zones_error import errors as zones_errors

import twilight
from twilight.base.errors import TwilightError
from twilight.base.threads import one_blas_thread
from twilight.base.whole_files import save_figure, whole_file
from twilight.clear_air import Model, Skies
from twilight.clear_air.entry import SHIPPED, ClearAir, diffuse_of, load_model
from twilight.clear_air.model import NODES, SUN_DEG
from twilight.clear_air.of_medium import air_of
from twilight.clear_air.skies import LEAST_SHARE
from twilight.config.aerosol import AerosolType
from twilight.config.load import load_climate
from twilight.scene.medium import climate_medium
from twilight.sky import colour
from twilight.solvers.compact import Field

REFERENCE_COVERED = 0.97
"""Fraction of the reference skies that `calibrate` covers, so that COVERED hold in others: errors of light
scattered once, and of the solutions that the fit learnt from, are in these alone."""
COLUMNS = (
    *("climate", "sun_elevation_deg", "median_percent", "p95_percent", "max_percent", "reference_percent"),
    *("excess_percent", "estimated_percent", "p95_degree_of_polarisation"),
)
PICTURED = (("urban", 10.0), ("desert", 1.0), ("continental-average", -4.0), ("maritime-tropical", -9.0))
"""Climates and suns of the picture."""
PICTURED_NM = np.linspace(385.0, 735.0, 8)


KINDS = (*get_args(AerosolType), "angstrom", "angstrom")
"""Aerosols of drawn airs, in turn."""
OBSERVERS = 2
"""Of each drawn air."""
LOADED_DEPTH = 0.05
"""Optical depth of aerosol above 12 km of a loaded stratosphere."""
TIMED = "continental-average"
"""Climate of `times`."""
TIMED_WAVELENGTHS = (1, 3, 8, 40)
"""How many wavelengths it has there."""
TIMED_SUNS_DEG = (20.0, 5.0, 0.5, -1.5, -4.0, -7.0, -12.0)
"""Suns there, of which the median counts: by day, and where the shadow of the Earth asks for finer nodes."""


def calibrate(path: Path, airs: Path) -> None:
    """Renew the error that a model estimates, `Model.error`, by the drawn airs that the fit held out and by
    `clear_air.csv`; `climates` comes first.  Calibrated on a half of either, it is judged on the others, and written
    into a table; calibrated on all, into the file."""
    model, table = load_model(path), results.read_rows(results.FOLDER / "clear_air.csv")
    names = list(dict.fromkeys(row["climate"] for row in table))
    half, sun, off, estimated, share = np.array(
        [
            (
                names.index(row["climate"]) % 2,
                float(row["sun_elevation_deg"]),
                0.01 * float(row["excess_percent"]),
                0.01 * float(row["estimated_percent"]),
                LEAST_SHARE if row["climate"] == "pure-air" else 1.0,
            )
            for row in table
        ]
    ).T
    fixed, times = (np.interp(sun, SUN_DEG, row) for row in model.error)
    of_climates = np.stack([half, sun, off, (estimated / share - fixed) / times, share], axis=1)
    of_drawn, rows = held_out(model, airs), []
    print("calibrated on drawn, climates; judged on the others: climates, drawn, of these to -9 deg, without particles")
    for d, c in ((0, 0), (0, 1), (1, 0), (1, 1)):
        some, others = (of_drawn[of_drawn[:, 0] == one] for one in (d, 1 - d))
        error = _error_of(some, of_climates[half == c])
        rows.append([d, c, *(f"{100.0 * held:.1f}" for held in _covered(error, others, of_climates[half != c]))])
        print(*rows[-1], sep="\t")
    error = _error_of(of_drawn, of_climates)
    rows.append(["both", "both", *(f"{100.0 * held:.1f}" for held in _covered(error, of_drawn, of_climates))])
    columns = ("climates", "drawn", "drawn_to_9_deg", "drawn_without_particles")
    results.write(
        results.FOLDER / "clear_air_estimated.csv",
        ("half_of_drawn", "half_of_climates", *(f"{name}_covered_percent" for name in columns)),
        rows,
    )
    with np.load(path) as file:
        arrays = {key: file[key] for key in file.files} | {"error": error.astype(np.float32)}
    with whole_file(path) as unfinished, open(unfinished, "wb") as written:
        np.savez_compressed(written, **arrays)


def held_out(model: Model, airs: Path) -> np.ndarray:
    """Of each sky of the drawn airs that the fit held out, of one wavelength: half (of the files), sun, error of light
    and spread of the networks at 95 % of the directions, `Skies.share`, (N, 5)."""
    suns, degree, rows = SUN_DEG[list(JUDGED_SUNS)], degrees(airs), []
    with np.load(airs) as file:
        kept = {key: file[f"light{key}"] for key in ("", "_scale", "_vectors", "_mean")} | {"number": file["number"]}

    def once(of: Sequence[Skies]) -> np.ndarray:
        return np.array([[one.single_scattering(float(sun))[:, :, 0] for sun in suns] for one in of])

    numbers = [number for number in sorted(degree) if number % HELD_OUT == 0 and number < UNSOLVED]
    for n, number in enumerate(numbers):
        medium, observers = drawn_air(number)
        air, some = airs_of(medium, number), kept["number"] == number
        light = (kept[""][some] * kept["_scale"]) @ kept["_vectors"].astype(float) + kept["_mean"]
        light = np.exp(light.reshape(2, medium.n_wavelengths, *NODES)[:, :, list(JUDGED_SUNS)])
        multiple, of = np.moveaxis(light, 1, -1), [Skies(model, air, above) for above in observers]
        single = once(of)
        if not (air.degree == degree[number]).all():  # all light is the same in both
            followed = air._replace(degree=np.full_like(air.degree, degree[number]))
            more = once([Skies(None, followed, above) for above in observers]) - single
            multiple = np.maximum(multiple + more, LEAST_LEFT * multiple)
        for one, exact, beside in zip(of, multiple, single, strict=True):
            ratio, spread = (np.moveaxis(one.at_nodes[k][:, list(JUDGED_SUNS)], 0, -1) for k in (0, 3))
            part = exact / (exact + beside)
            far = np.abs(ratio - np.log(exact / one.base(suns))) * part
            parts = (np.percentile(values, 95, axis=(1, 2)) for values in (far, np.abs(spread) * part))
            shares, of_sun = one.share.real, np.repeat(suns, medium.n_wavelengths)
            rows.append([np.full(of_sun.size, n % 2), of_sun, *(x.ravel() for x in parts), np.tile(shares, suns.size)])
        print(number, end=" ", flush=True)
    return np.concatenate([np.transpose(row) for row in rows])


def _error_of(of_drawn: np.ndarray, of_climates: np.ndarray) -> np.ndarray:
    """`Model.error`: by sun so that COVERED of drawn skies are as near as it says, all times one factor so that
    REFERENCE_COVERED of those of climates are."""
    suns, times = SUN_DEG[list(JUDGED_SUNS)], []
    for sun in suns:
        _, _, off, spread, share = of_drawn[of_drawn[:, 1] == sun].T
        beside = np.maximum(off / share - np.interp(sun, SUN_DEG, SINGLE_ERROR), 0.0)
        times.append(np.quantile(beside / spread, COVERED))
    error = np.stack([SINGLE_ERROR, np.interp(SUN_DEG, suns, times)])
    return error * np.quantile(of_climates[:, 2] / _says(error, of_climates), REFERENCE_COVERED)


def _says(error: np.ndarray, of: np.ndarray) -> np.ndarray:
    """The error (N,) that a model estimates of skies (N, 5)."""
    fixed, times = (np.interp(of[:, 1], SUN_DEG, row) for row in error)
    return of[:, 4] * (fixed + times * of[:, 3])


def _covered(error: np.ndarray, of_drawn: np.ndarray, of_climates: np.ndarray) -> list[float]:
    """Parts of the skies of climates, of drawn ones, of these to -9 deg and without particles that are as near."""
    groups = of_climates, of_drawn, of_drawn[of_drawn[:, 1] <= -9.0], of_drawn[of_drawn[:, 4] < 1.05 * LEAST_SHARE]
    return [float(np.mean(of[:, 2] <= _says(error, of))) for of in groups]


def climates(model: Model) -> None:
    """Compare the model with the reference solutions of climates, and write the table."""
    rows = []
    for name, table_name in CLIMATES.items():
        table = results.read_numbers(results.FOLDER / "reference" / f"{table_name}.csv")
        medium = climate_medium(load_climate(name), np.unique(table["wavelength_nm"]))
        try:
            field = Field(ClearAir(medium, model), medium.bottom_km, polarisation=True)
        except TwilightError as refused:
            print(name, refused)
            continue
        for sun, median, most, largest, _, own, excess in zones_errors(field, table):
            some = table[table["sun_elevation_deg"] == sun]
            place = np.arange(some.size), slice(None), np.searchsorted(medium.wavelength_nm, some["wavelength_nm"])
            light = field.stokes(sun, some["elevation_deg"], some["azimuth_deg"])[place[0], :, place[2]]
            estimated = 100.0 * field.convergence.error
            degree = np.hypot(light[:, 1], light[:, 2]) / light[:, 0]
            right = np.hypot(some["q_per_sr"], some["u_per_sr"]) / some["radiance_per_sr"]
            off = np.percentile(np.abs(degree - right), 95)
            percent = (f"{value:.2f}" for value in (median, most, largest, own, excess, estimated))
            rows.append([name, f"{sun:g}", *percent, f"{off:.4f}"])
            print(*rows[-1], sep="\t", flush=True)
    results.write(results.FOLDER / "clear_air.csv", COLUMNS, rows)
    for sun in dict.fromkeys(row[1] for row in rows):
        excess, estimated = ([float(row[k]) for row in rows if row[1] == sun] for k in (6, 7))
        print(
            f"sun {sun}: excess {np.median(excess):.2f} (median climate), {max(excess):.2f} (largest); estimated",
            estimated,
        )


def drawn(model: Model, airs: Path, approximate: Path) -> None:
    """Errors in the airs that the fit held out, by groups of samples, and write the table."""
    data = read(airs, approximate, held_out_alone=True)
    light, turned = off(model, data, np.ones(data.number.size, bool))
    sky = 100.0 * np.percentile(light, 95, axis=(2, 3))  # N S
    degree = np.percentile(turned, 95, axis=(1, 3, 4))
    groups = [("all", np.full(data.number.size, "all"))]
    numbers = list(dict.fromkeys(data.number.tolist()))
    wavelengths, kinds, observers = [], [], []
    for number in numbers:
        nm = drawn_air(number)[0].wavelength_nm
        wavelengths += [f"{w:g} nm" for w in nm] * OBSERVERS
        own = KINDS[number % len(KINDS)] if number < SIDE_BY_SIDE else "each wavelength another"
        kinds += [own] * (OBSERVERS * nm.size)
        observers += np.repeat(["on the ground", "aloft"], nm.size).tolist()
    loaded = _stratosphere(data.limits_of)
    groups += [("aerosol", np.array(kinds)), ("wavelength", np.array(wavelengths)), ("observer", np.array(observers))]
    groups.append(("stratosphere", loaded))
    groups.append(("drawn", np.where(data.number >= APART, "where networks disagree", "at random")))
    rows = []
    for group, names in groups:
        for name in sorted(set(names.tolist())):
            some = names == name
            for s in JUDGED_SUNS:
                of = sky[some, s], degree[some, s]
                values = (f"{x:.2f}" for x in (np.median(of[0]), np.percentile(of[0], 95)))
                rows.append([group, name, some.sum(), f"{SUN_DEG[s]:g}", *values, f"{np.median(of[1]):.4f}"])
    columns = ("group", "name", "skies", "sun_elevation_deg", "median_p95_percent", "p95_p95_percent", "median_p95_q_u")
    results.write(results.FOLDER / "clear_air_drawn.csv", columns, rows)


def _stratosphere(limits: np.ndarray) -> np.ndarray:
    """Names of the stratospheres of samples, by what limits their airs (N, 10)."""
    return np.where(limits[:, 3] > LOADED_DEPTH, "loaded", "usual")


@one_blas_thread()
def times(model: Model) -> None:
    """Processor time of an air with its first sun, and of one more, in the median of some, and write the table."""
    import_module("numba")  # as a process has it that has computed some skies
    rows = []
    for count in TIMED_WAVELENGTHS:
        medium, of_airs, of_suns = climate_medium(load_climate(TIMED), np.linspace(380.0, 780.0, count)), [], []
        for sun in TIMED_SUNS_DEG:
            began = process_time()
            skies = Skies(model, air_of(medium), diffuse=diffuse_of)
            skies.sky(sun)
            first = process_time()
            skies.sky(sun - 1.0)
            of_airs.append(first - began)
            of_suns.append(process_time() - first)
        rows.append([count, *(f"{1e3 * np.median(some):.0f}" for some in (of_airs, of_suns))])
        print(*rows[-1], sep="\t", flush=True)
    columns = ("wavelengths", "new_air_and_sun_processor_ms", "one_more_sun_processor_ms")
    results.write(results.FOLDER / "clear_air_times.csv", columns, rows)


def picture(path: Path) -> None:
    """The model, zones and the ratio of their luminances, half a sky each: azimuth 0 to 180 deg to the right."""
    from matplotlib.figure import Figure

    e, a = np.meshgrid(np.arange(1.0, 90.0, 2.0), np.arange(0.0, 180.1, 2.0), indexing="ij")
    figure = Figure(figsize=(12, 2.2 * len(PICTURED)), layout="constrained")
    axes = figure.subplots(len(PICTURED), 3)
    for (climate, sun), line in zip(PICTURED, axes, strict=True):
        fields = [
            twilight.solve(climate, wavelength_nm=PICTURED_NM, sun_elevation_deg=[sun], **how)
            for how in ({"solver": "compact"}, {"quality": "standard"})
        ]
        near, true = (np.asarray(field.radiance(sun, e, a)) for field in fields)
        titles = [f"{name}: {climate}, sun {sun:g}°" for name in ("compact", "zones")]
        titles.append(f"luminance [%]; spectral 95 % {100 * np.percentile(np.abs(near / true - 1), 95):.1f}")
        draw_beside(figure, line, (near, true), PICTURED_NM, e, titles, 5.0)
    save_figure(path, figure, 80)


def draw_beside(
    figure: Any,
    axes: Sequence[Any],
    skies: tuple[np.ndarray, np.ndarray],
    wavelength_nm: np.ndarray,
    elevation_deg: np.ndarray,
    titles: Sequence[str],
    largest_percent: float,
) -> None:
    """Two skies (E, A, W), half a sky each, at the exposure of the second, and the difference of their luminances."""
    xyz = [colour.spectrum_to_xyz(sky, wavelength_nm) for sky in skies]
    ev = colour.auto_exposure_ev100(xyz[1][..., 1], np.cos(np.radians(elevation_deg)))
    half_sky: dict[str, Any] = {"origin": "lower", "extent": (0, 180, 0, 90), "aspect": "auto"}
    for axis, values in zip(axes, xyz, strict=False):
        axis.imshow(colour.tone_map(colour.xyz_to_linear_rgb(values), ev), **half_sky)
    percent = 100.0 * (xyz[0][..., 1] / xyz[1][..., 1] - 1.0)
    image = axes[2].imshow(percent, cmap="RdBu_r", vmin=-largest_percent, vmax=largest_percent, **half_sky)
    figure.colorbar(image, ax=axes[2])
    for axis, title in zip(axes, titles, strict=True):
        axis.set_title(title, fontsize=9)


def main(words: Sequence[str]) -> None:
    match words:
        case ["climates"]:
            climates(load_model(SHIPPED))
        case ["calibrate", airs]:
            calibrate(SHIPPED, Path(airs))
        case ["drawn", airs, approximate]:
            drawn(load_model(SHIPPED), Path(airs), Path(approximate))
        case ["times"]:
            times(load_model(SHIPPED))
        case ["picture"]:
            picture(results.ROOT / "docs" / "clear-air.png")
        case _:
            sys.exit(__doc__)


if __name__ == "__main__":
    results.say_help(__doc__)
    main(sys.argv[1:])
