"""Referee radiances of two tabulated media: two climates without their aerosol, one with a Henyey-Greenstein one.

    python benchmarks/montecarlo_reference.py media        writes benchmarks/reference/{pure,hazy}-air.csv
    python benchmarks/montecarlo_reference.py pure 0.0     appends to benchmarks/reference/pure-air-albedo-0.0.csv
    python benchmarks/montecarlo_reference.py hazy 0.3     and so on

The media are read back from their tables, so any code can be run on exactly the same air.  Sun-normalised radiances
[sr^-1] with standard errors, per wavelength, sun and direction, with the first orders apart; an observer on the ground.
"""

from __future__ import annotations

import csv
import sys
import time
from pathlib import Path

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


def compute(name: str, albedo: float) -> None:
    """Append the suns that the result file does not hold yet."""
    from twilight.atmosphere.table import medium_from_table
    from twilight.solvers.montecarlo import MonteCarloSettings, prepare

    medium = medium_from_table(HERE / f"{name}-air.csv", ground_albedo=albedo)
    path = HERE / f"{name}-air-albedo-{albedo:g}.csv"
    done = set()
    if path.exists():
        with open(path) as stream:
            done = {float(row["sun_elevation_deg"]) for row in csv.DictReader(stream)}
    elevation, azimuth = np.array(DIRECTIONS_DEG).T
    for sun in SUNS_DEG:
        if sun in done:
            continue
        start = time.process_time()
        field = prepare(medium, MonteCarloSettings(target_stderr=target(sun), max_samples=200_000, seed=20))
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
            f"{name} albedo {albedo:g} sun {sun:5.1f}: error {np.median(error):.2f} % (largest {error.max():.2f} %), "
            f"{time.process_time() - start:.0f} s",
            flush=True,
        )


if __name__ == "__main__":
    if sys.argv[1:] == ["media"]:
        write_media()
    else:
        compute(sys.argv[1], float(sys.argv[2]))
