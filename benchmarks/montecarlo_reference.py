"""Referee radiances: of shipped climates, and of two tabulated media that any code can be run on.

    python benchmarks/montecarlo_reference.py climate continental-average   appends to reference/continental-average.csv
    python benchmarks/montecarlo_reference.py climate continental-average unrefracted    ... -unrefracted.csv
    python benchmarks/montecarlo_reference.py media        writes reference/{pure,hazy}-air.csv
    python benchmarks/montecarlo_reference.py pure 0.0     appends to reference/pure-air-albedo-0.csv
    python benchmarks/montecarlo_reference.py hazy 0.3     and so on

The media are read back from their tables: two climates without their aerosol, one with a Henyey-Greenstein one.
Climates are built at the three wavelengths, with their Mie phase functions and ground; pure-air is written to
pure-air-climate.csv.  Sun-normalised radiances [sr^-1] with standard errors, per wavelength, sun and direction, with
the first orders apart; an observer on the ground; the elevation of a direction is the apparent one (bent lines of
sight), but in the tables of media and the unrefracted ones lines are straight.  A run goes on where it was stopped.
"""

from __future__ import annotations

import csv
import sys
import time
from dataclasses import replace
from pathlib import Path

import numba
import numpy as np

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
CLIMATE_SUNS_DEG = (0.0, -4.0, 30.0, -6.0, -12.0, 5.0, -9.0, -18.0)
UNREFRACTED_SUNS_DEG = (0.0, -4.0, 30.0, -6.0, -12.0, 5.0, -9.0, -15.0)
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
HEADER = (
    "sun_elevation_deg,elevation_deg,azimuth_deg,wavelength_nm,radiance_per_sr,standard_error_per_sr,"
    "order_1,order_2,order_3,order_4,order_5,samples"
)


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
    """Relative standard error asked for: 0.3 % down to -6 deg, 0.6 % below."""
    return 0.003 if sun_elevation_deg >= -6.0 else 0.006


def climate_target(sun_elevation_deg: float) -> float:
    """0.3 % down to -6 deg, 0.6 % to -12, 1.2 % below."""
    if sun_elevation_deg >= -6.0:
        return 0.003
    return 0.006 if sun_elevation_deg >= -12.0 else 0.012


def compute_table(name: str, albedo: float) -> None:
    """A tabulated medium."""
    from twilight.atmosphere.table import medium_from_table

    medium = medium_from_table(HERE / f"{name}-air.csv", ground_albedo=albedo)
    path = HERE / f"{name}-air-albedo-{albedo:g}.csv"
    compute(medium, path, SUNS_DEG, DIRECTIONS_DEG, target, bent_lines_of_sight=False)


def quick_target(sun_elevation_deg: float) -> float:
    """0.5 % down to -6 deg, 1 % to -12, 2 % below."""
    if sun_elevation_deg >= -6.0:
        return 0.005
    return 0.01 if sun_elevation_deg >= -12.0 else 0.02


def compute_climate(name: str, refraction: bool, quick: bool) -> None:
    """A shipped climate, with all refraction or without any; `quick` takes every second direction and larger errors."""
    from twilight.config.load import load_climate
    from twilight.scene.medium import climate_medium

    medium = climate_medium(load_climate(name), np.array(WAVELENGTHS_NM))
    file = "pure-air-climate" if name == "pure-air" else name
    path = HERE / (f"{file}.csv" if refraction else f"{file}-unrefracted.csv")
    suns = CLIMATE_SUNS_DEG if refraction else UNREFRACTED_SUNS_DEG
    directions = CLIMATE_DIRECTIONS_DEG[::2] if quick else CLIMATE_DIRECTIONS_DEG
    wanted, most = (quick_target, 40_000) if quick else (climate_target, 400_000)
    compute(medium, path, suns, directions, wanted, max_samples=most, refraction=refraction)


def compute(medium, path: Path, suns_deg, directions_deg, target, **change) -> None:
    """Append the suns that the result file does not hold yet."""
    from twilight.solvers.montecarlo import MonteCarloSettings, prepare

    done = set()
    if path.exists():
        with open(path) as stream:
            done = {float(row["sun_elevation_deg"]) for row in csv.DictReader(stream)}
    elevation, azimuth = np.array(directions_deg).T
    chosen: dict = {"max_samples": 400_000, "pilot_samples": 48, "seed": 20} | change
    settings = MonteCarloSettings(**chosen)
    field = prepare(medium, settings)
    for sun in suns_deg:
        if sun in done:
            continue
        start = time.process_time()
        field = replace(field, settings=replace(settings, target_stderr=target(sun)))
        result = field.radiance_with_error(sun, elevation, azimuth)
        lines = [] if path.exists() else [HEADER]
        for d in range(elevation.size):
            for w, nm in enumerate(medium.wavelength_nm):
                values = (
                    result.radiance[d, w],
                    result.standard_error[d, w],
                    *result.order_radiance[:5, d, w],
                )
                numbers = ",".join(f"{v:.6g}" for v in values)
                lines.append(f"{sun:g},{elevation[d]:g},{azimuth[d]:g},{nm:g},{numbers},{result.samples[d, w]}")
        with open(path, "a") as stream:
            stream.write("\n".join(lines) + "\n")
        error = 100 * result.standard_error / result.radiance
        print(
            f"{path.stem} sun {sun:5.1f}: error {np.median(error):.2f} % (largest {error.max():.2f} %), "
            f"{time.process_time() - start:.0f} s",
            flush=True,
        )


if __name__ == "__main__":
    if sys.argv[1:] == ["media"]:
        write_media()
    elif sys.argv[1] == "climate":
        numba.set_num_threads(1)
        compute_climate(sys.argv[2], "unrefracted" not in sys.argv[3:], "quick" in sys.argv[3:])
    else:
        compute_table(sys.argv[1], float(sys.argv[2]))
