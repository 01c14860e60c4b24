"""Reference radiances: of shipped climates, and of two tabulated media that any code can be run on.

    python benchmarks/montecarlo_reference.py                            all that follows
    python benchmarks/montecarlo_reference.py urban desert               writes reference/urban.csv, desert.csv
    python benchmarks/montecarlo_reference.py hazy-air-albedo-0 pure-air-albedo-0
    python benchmarks/montecarlo_reference.py media                      writes reference/pure-air.csv, hazy-air.csv
    python benchmarks/montecarlo_reference.py check                      all tables beside today's code
    python benchmarks/montecarlo_reference.py check urban                one of them
    python benchmarks/montecarlo_reference.py speed                      writes montecarlo_speed.csv

Climates are built at the three wavelengths, with their Mie phase matrices and ground; pure-air is written to
pure-air-climate.csv.  Sun-normalised I, Q, U [sr^-1] with standard errors, per wavelength, sun and direction; observer
on the ground; the elevation of a direction is the apparent one, and every leg of a path is bent.  The media are read
back from their tables: two climates without their aerosol, one with a Henyey-Greenstein one; their light is scalar and
its lines are straight.

The tables take hours.  `check` computes every third sun and every fourth direction of a table anew, with other random
numbers and a standard error of 2 %, and writes what it found into the table's second line.  A table
that has moved by more than four standard errors of the mean, or scatters by more than 1.3 of its stated errors, is left
as it is and named, and the command ends with code 1: it is to be made anew.

`speed`: processor seconds to 1 % standard error for one direction at one wavelength on one thread, from a fixed number
of samples and their standard error.
"""

from __future__ import annotations

import sys
import time
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numba
import numpy as np
import results

from twilight.atmosphere import medium_table
from twilight.atmosphere.build import build_medium
from twilight.atmosphere.medium_table import medium_from_table
from twilight.base.whole_files import write_csv
from twilight.config.load import load_climate
from twilight.scene.medium import climate_medium
from twilight.solvers.montecarlo import MonteCarloSettings, prepare
from twilight.studies.compare.reference_solution import COLUMNS

HERE = results.FOLDER / "reference"
WAVELENGTHS_NM = (450.0, 550.0, 680.0)
SUNS_DEG = (30.0, 5.0, 0.0, -2.0, -4.0, -6.0, -9.0, -12.0)
DIRECTIONS_DEG = (
    *((elevation, azimuth) for elevation in (1.5, 10.0, 30.0, 60.0) for azimuth in (0.0, 30.0, 90.0, 150.0, 180.0)),
    (4.0, 0.0),
    (20.0, 0.0),
    (5.0, 180.0),
    (45.0, 90.0),
    (90.0, 0.0),
)
CLIMATES = (
    *("continental-average", "urban", "desert", "maritime-clean", "pure-air", "volcanic-extreme"),
    *("continental-clean", "continental-polluted", "maritime-polluted", "maritime-tropical", "arctic", "antarctic"),
    "volcanic-stratosphere",
)
CLIMATE_SUNS_DEG = (30.0, 10.0, 5.0, 0.0, -4.0, -6.0, -9.0, -12.0, -18.0)
CLIMATE_DIRECTIONS_DEG = (
    *((elevation, azimuth) for elevation in (1.0, 2.5, 6.0, 12.0) for azimuth in (0.0, 180.0)),
    *((elevation, azimuth) for elevation in (20.0, 35.0) for azimuth in (30.0, 105.0, 180.0)),
    *((8.0, azimuth) for azimuth in (5.0, 50.0, 130.0)),
    (1.5, 90.0),
    (27.0, 0.0),
    (33.0, 8.0),
    (45.0, 90.0),
    *((60.0, azimuth) for azimuth in (0.0, 90.0, 180.0)),
    (75.0, 45.0),
    (90.0, 0.0),
)
STOKES_COLUMNS = (*COLUMNS, "q_per_sr", "q_standard_error_per_sr", "u_per_sr", "u_standard_error_per_sr", "samples")
CHECKED_SUNS = slice(0, None, 3)
CHECKED_DIRECTIONS = slice(0, None, 4)
CHECKED_ERROR = 0.02
"""Relative standard error asked of a value that is computed for a check."""
MOST_SIGMAS = 4.0
"""A table has moved whose mean difference is larger, in standard errors of that mean."""
MOST_SCATTER = 1.3
"""A table's errors are wrong where the differences scatter more, in their stated standard errors."""
SPEED_SUNS_DEG = (30.0, 10.0, 0.0, -4.0, -6.0, -9.0, -12.0, -15.0, -18.0)
SPEED_VIEWS = {"zenith": (90.0, 0.0), "10 deg sunward": (10.0, 0.0), "10 deg antisolar": (10.0, 180.0)}
SPEED_VIEWS["(45, 90)"] = (45.0, 90.0)
SPEED_SAMPLES = 400
"""Samples of a run, each of 8 paths."""


def write_media() -> None:
    """Tables of the air of `pure-air` and of the same air under an exponential aerosol (g 0.7, depth 0.2 at 550 nm)."""
    wavelength = np.array(WAVELENGTHS_NM)
    air = build_medium(wavelength, aerosol=None)
    z = air.altitude_km
    for name, depth in (("pure-air", 0.0), ("hazy-air", 0.2)):
        height = 2.0
        extinction = np.where(z < 30.0, depth / height * np.exp(-z / height), 0.0)
        rows = [
            [f"{x:.9g}" for x in (
                z[i], nm, air.air_scattering_per_km[i, w], extinction[i] * (550.0 / nm) ** 1.3, 0.93, 0.7,
                air.absorption_per_km[i, w], air.refractivity[i, w],
            )]
            for w, nm in enumerate(wavelength)
            for i in range(z.size)
        ]  # fmt: skip
        write_csv(HERE / f"{name}.csv", list(medium_table.COLUMNS), rows)


def target(sun_elevation_deg: float) -> float:
    """Relative standard error asked for: 0.3 % down to -6 deg, 0.5 % to -12, 1 % below."""
    if sun_elevation_deg >= -6.0:
        return 0.003
    return 0.005 if sun_elevation_deg >= -12.0 else 0.01


class Reference(NamedTuple):
    """What a table is of: the field, its settings, suns, directions and whether it holds Q and U."""

    field: Any
    settings: Any
    suns_deg: tuple[float, ...]
    directions_deg: tuple[tuple[float, float], ...]
    polarised: bool


def reference(name: str) -> Reference:
    """A shipped climate, polarised with all refraction, or a tabulated medium in scalar theory with straight lines.

    name: of a climate, or NAME-air-albedo-ALBEDO
    """
    wavelength_nm = np.array(WAVELENGTHS_NM)
    if "-albedo-" in name:
        air, albedo = name.split("-albedo-")
        medium = medium_from_table(HERE / f"{air}.csv", ground_albedo=float(albedo))
        field, settings = prepared(medium, bent_lines_of_sight=False, polarisation=False)
        return Reference(field, settings, SUNS_DEG, DIRECTIONS_DEG, False)
    field, settings = prepared(climate_medium(load_climate(name), wavelength_nm))
    return Reference(field, settings, CLIMATE_SUNS_DEG, CLIMATE_DIRECTIONS_DEG, True)


def rows_of(of: Reference, sun: float):
    """Rows of a table at one sun."""
    elevation, azimuth = np.array(of.directions_deg).T
    field = replace(of.field, settings=replace(of.settings, target_stderr=target(sun)))
    if of.polarised:
        found = field.stokes_with_error(sun, elevation, azimuth)
        columns = [a[:, k] for k in range(3) for a in (found.stokes, found.standard_error)]
    else:
        found = field.radiance_with_error(sun, elevation, azimuth)
        columns = [found.radiance, found.standard_error]
    yield from numbers(sun, of.directions_deg, found.samples, *columns)


def file_of(name: str) -> Path:
    return HERE / ("pure-air-climate.csv" if name == "pure-air" else f"{name}.csv")


def prepared(medium, **change):
    """The Monte-Carlo solver with enough samples for the faintest direction, and its settings."""
    settings = MonteCarloSettings(max_samples=1_000_000, pilot_samples=48, seed=20, **change)
    return prepare(medium, settings), settings


def numbers(sun: float, directions, samples: np.ndarray, *values: np.ndarray):
    """Rows of a table from arrays (D, W)."""
    for d, (elevation, azimuth) in enumerate(directions):
        for w, nm in enumerate(WAVELENGTHS_NM):
            found = [f"{v[d, w]:.6g}" for v in values]
            yield [f"{sun:g}", f"{elevation:g}", f"{azimuth:g}", f"{nm:g}", *found, samples[d, w]]


def compute(name: str) -> None:
    """All suns of one table, written at the end; what each took is printed."""
    of = reference(name)
    rows: list = []
    for sun in of.suns_deg:
        start = time.process_time()
        new = list(rows_of(of, sun))
        error = np.array([100.0 * float(row[5]) / float(row[4]) for row in new])
        print(
            f"{name} sun {sun:5.1f}: error {np.median(error):.2f} % (largest {error.max():.2f} %), "
            f"{time.process_time() - start:.0f} s of processor time",
            flush=True,
        )
        rows += new
    columns = (*(STOKES_COLUMNS if of.polarised else COLUMNS), *(() if of.polarised else ("samples",)))
    results.write(file_of(name), columns, rows, command=f"python benchmarks/montecarlo_reference.py {name}")


def check(name: str) -> bool:
    """Whether a table is what today's code gives; if so its second line says so."""
    table = results.read_numbers(file_of(name))
    of = reference(name)
    of = of._replace(settings=replace(of.settings, seed=21, max_samples=20_000))
    elevation, azimuth = np.array(of.directions_deg[CHECKED_DIRECTIONS]).T
    differences, errors = [], []
    for sun in of.suns_deg[CHECKED_SUNS]:
        field = replace(of.field, settings=replace(of.settings, target_stderr=CHECKED_ERROR))
        found = field.radiance_with_error(sun, elevation, azimuth)
        was = table[table["sun_elevation_deg"] == sun].reshape(len(of.directions_deg), -1)[CHECKED_DIRECTIONS]
        differences.append(found.radiance / was["radiance_per_sr"] - 1.0)
        own = found.standard_error / found.radiance
        errors.append(np.hypot(own, was["standard_error_per_sr"] / was["radiance_per_sr"]))
    difference, error = np.ravel(differences), np.ravel(errors)
    weight = error**-2 / np.sum(error**-2)
    mean, mean_error = float(weight @ difference), float(np.sum(error**-2) ** -0.5)
    scatter = float(np.sqrt(np.mean((difference / error) ** 2)))
    same = abs(mean) < MOST_SIGMAS * mean_error and scatter < MOST_SCATTER
    said = (
        f"checked at {results.commit()}: {difference.size} values differ by "
        f"{100 * mean:+.2f} +- {100 * mean_error:.2f} %, scatter {scatter:.2f} of the stated errors"
    )
    print(f"{name}: {said}{'' if same else '; THE TABLE IS TO BE MADE ANEW'}", flush=True)
    if same:
        results.note_check(file_of(name), said)
    return same


def speed() -> None:
    """montecarlo_speed.csv"""
    numba.set_num_threads(1)
    medium = climate_medium(load_climate("continental-average"), np.array([550.0]))
    prepare(medium, MonteCarloSettings(target_stderr=None, samples=8)).radiance(1.0, 1.0, 1.0)  # compiles
    settings = MonteCarloSettings(target_stderr=None, samples=SPEED_SAMPLES)
    started = time.process_time()
    field = prepare(medium, settings)
    notes = [f"continental-average, 550 nm; prepare {time.process_time() - started:.1f} s"]
    rows = []
    for sun in SPEED_SUNS_DEG:
        needed, cost = [], []
        for direction in SPEED_VIEWS.values():
            samples = []
            for seed in (1, 2, 3, 4):
                begin = time.process_time()
                answer = replace(field, settings=replace(settings, seed=seed)).radiance_with_error(sun, *direction)
                cost.append((time.process_time() - begin) / answer.samples[0])
                samples.append((answer.standard_error[0] / answer.radiance[0]) ** 2 * answer.samples[0] / 0.01**2)
            needed.append(np.mean(samples))
        seconds = np.array([*needed, np.median(needed)]) * np.median(cost)
        rows.append([f"{sun:g}", *(f"{s:.4f}" for s in seconds), f"{1e6 * np.median(cost):.0f}"])
        print(*rows[-1], sep="\t", flush=True)
    columns = ["sun_elevation_deg", *(f"{name} [s]" for name in SPEED_VIEWS), "median [s]", "microseconds per sample"]
    results.write(results.FOLDER / "montecarlo_speed.csv", columns, rows, notes=notes)


ALL = (*CLIMATES, "hazy-air-albedo-0", "pure-air-albedo-0")


def main(arguments: list[str]) -> None:
    if arguments[:1] == ["check"]:
        results_of = [check(name) for name in arguments[1:] or ALL]
        sys.exit(not all(results_of))
    for name in arguments or ALL:
        {"media": write_media, "speed": speed}.get(name, partial(compute, name))()


if __name__ == "__main__":
    results.say_help(__doc__)
    main(sys.argv[1:])
