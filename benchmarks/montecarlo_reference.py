"""Reference radiances: of shipped climates, and of two tabulated media that any code can be run on.

    python benchmarks/montecarlo_reference.py                            all that follows
    python benchmarks/montecarlo_reference.py urban desert               writes reference/urban.csv, desert.csv
    python benchmarks/montecarlo_reference.py hazy-air-albedo-0 pure-air-albedo-0
    python benchmarks/montecarlo_reference.py media                      writes reference/pure-air.csv, hazy-air.csv

Climates are built at the three wavelengths, with their Mie phase matrices and ground; pure-air is written to
pure-air-climate.csv.  Sun-normalised I, Q, U [sr^-1] with standard errors, per wavelength, sun and direction; observer
on the ground; the elevation of a direction is the apparent one, and every leg of a path is bent.  The media are read
back from their tables: two climates without their aerosol, one with a Henyey-Greenstein one; their light is scalar and
its lines are straight, as in the solver `cells`.
"""

from __future__ import annotations

import csv
import sys
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import results

from twilight.studies.compare.reference_solution import COLUMNS

HERE = Path(__file__).parent / "reference"
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


def write_media() -> None:
    """Tables of the air of `pure-air` and of the same air under an exponential aerosol (g 0.7, depth 0.2 at 550 nm)."""
    from twilight.atmosphere.build import build_medium

    wavelength = np.array(WAVELENGTHS_NM)
    air = build_medium(wavelength, aerosol=None)
    z = air.altitude_km
    for name, depth in (("pure-air", 0.0), ("hazy-air", 0.2)):
        height = 2.0
        extinction = np.where(z < 30.0, depth / height * np.exp(-z / height), 0.0)
        with open(HERE / f"{name}.csv", "w", newline="") as stream:
            writer = csv.writer(stream, lineterminator="\n")
            writer.writerow(
                "altitude_km wavelength_nm air_scattering_per_km aerosol_extinction_per_km "
                "aerosol_single_scattering_albedo aerosol_asymmetry absorption_per_km refractivity".split()
            )
            for w, nm in enumerate(wavelength):
                spectral = (550.0 / nm) ** 1.3
                for i in range(z.size):
                    row = (
                        z[i],
                        nm,
                        air.air_scattering_per_km[i, w],
                        extinction[i] * spectral,
                        0.93,
                        0.7,
                        air.absorption_per_km[i, w],
                        air.refractivity[i, w],
                    )
                    writer.writerow(f"{x:.9g}" for x in row)


def target(sun_elevation_deg: float) -> float:
    """Relative standard error asked for: 0.3 % down to -6 deg, 0.5 % to -12, 1 % below."""
    if sun_elevation_deg >= -6.0:
        return 0.003
    return 0.005 if sun_elevation_deg >= -12.0 else 0.01


def of_medium(name: str) -> None:
    """A tabulated medium in scalar theory with straight lines: NAME-air-albedo-ALBEDO."""
    from twilight.atmosphere.medium_table import medium_from_table

    air, albedo = name.split("-albedo-")
    medium = medium_from_table(HERE / f"{air}.csv", ground_albedo=float(albedo))
    field, settings = prepared(medium, bent_lines_of_sight=False, polarisation=False)
    elevation, azimuth = np.array(DIRECTIONS_DEG).T

    def rows(sun: float):
        found = replace(field, settings=replace(settings, target_stderr=target(sun))).radiance_with_error(
            sun, elevation, azimuth
        )
        yield from numbers(sun, DIRECTIONS_DEG, medium, found.samples, found.radiance, found.standard_error)

    compute(name, SUNS_DEG, rows, (*COLUMNS, "samples"))


def of_climate(name: str) -> None:
    """A shipped climate, polarised, with all refraction."""
    from twilight.config.load import load_climate
    from twilight.scene.medium import climate_medium

    medium = climate_medium(load_climate(name), np.array(WAVELENGTHS_NM))
    field, settings = prepared(medium)
    elevation, azimuth = np.array(CLIMATE_DIRECTIONS_DEG).T

    def rows(sun: float):
        found = replace(field, settings=replace(settings, target_stderr=target(sun))).stokes_with_error(
            sun, elevation, azimuth
        )
        columns = [a[:, k] for k in range(3) for a in (found.stokes, found.standard_error)]
        yield from numbers(sun, CLIMATE_DIRECTIONS_DEG, medium, found.samples, *columns)

    compute("pure-air-climate" if name == "pure-air" else name, CLIMATE_SUNS_DEG, rows, STOKES_COLUMNS)


def prepared(medium, **change):
    """The Monte-Carlo solver with enough samples for the faintest direction, and its settings."""
    from twilight.solvers.montecarlo import MonteCarloSettings, prepare

    settings = MonteCarloSettings(max_samples=1_000_000, pilot_samples=48, seed=20, **change)
    return prepare(medium, settings), settings


def numbers(sun: float, directions, medium, samples: np.ndarray, *values: np.ndarray):
    """Rows of a table from arrays (D, W)."""
    for d, (elevation, azimuth) in enumerate(directions):
        for w, nm in enumerate(medium.wavelength_nm):
            found = [f"{v[d, w]:.6g}" for v in values]
            yield [f"{sun:g}", f"{elevation:g}", f"{azimuth:g}", f"{nm:g}", *found, samples[d, w]]


def compute(name: str, suns_deg, rows_of: Callable, columns) -> None:
    """All suns of one table, written at the end; what each took is printed."""
    rows: list = []
    for sun in suns_deg:
        start = time.process_time()
        new = list(rows_of(sun))
        error = np.array([100.0 * float(row[5]) / float(row[4]) for row in new])
        print(
            f"{name} sun {sun:5.1f}: error {np.median(error):.2f} % (largest {error.max():.2f} %), "
            f"{time.process_time() - start:.0f} s of processor time",
            flush=True,
        )
        rows += new
    results.write(HERE / f"{name}.csv", columns, rows, command=f"python benchmarks/montecarlo_reference.py {name}")


MEDIA = ("hazy-air-albedo-0", "pure-air-albedo-0")

if __name__ == "__main__":
    for name in sys.argv[1:] or (*CLIMATES, *MEDIA):
        if name == "media":
            write_media()
        elif "-albedo-" in name:
            of_medium(name)
        else:
            of_climate(name)
