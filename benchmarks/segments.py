"""Aerial perspective: light that a segment of air scatters in, and its transmittance, against Monte-Carlo.

    python benchmarks/segments.py [--solvers zones,tables] [--wavelengths 550] [--samples 20000]

Writes benchmarks/segments.csv: for each solver, sun and distance the largest and the median difference over directions
and wavelengths, in percent of the radiance scale (the largest sky radiance of the wavelength in the same directions),
and the median standard error of the referee.  Observers stand at the ground and fly at 3 km.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np
from results import write

from twilight.config import load_climate
from twilight.scene.medium import climate_medium
from twilight.solvers import load
from twilight.solvers.montecarlo import MonteCarloSettings

OUT = Path(__file__).with_name("segments.csv")
SUNS_DEG = (30.0, 10.0, 2.0, -2.0, -6.0)
DISTANCES_KM = (0.1, 1.0, 10.0, 50.0, 300.0)
DIRECTIONS = ((0.2, 30.0), (0.2, 150.0), (2.0, 80.0), (10.0, 40.0), (40.0, 120.0))
"""(elevation, azimuth from the sun) [deg] from the ground."""
DOWN = ((-0.5, 30.0), (-0.5, 150.0), (-3.0, 80.0), (-15.0, 40.0))
"""From 3 km."""
PLACES = ((0.0, DIRECTIONS), (3.0, DOWN))


def questions(directions, distances) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Elevation (D, 1), azimuth (D, 1) and distance (1, N)."""
    elevation, azimuth = np.array(directions).T
    return elevation[:, None], azimuth[:, None], np.array(distances)[None, :]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n", 1)[0])
    parser.add_argument("--climate", default="continental-average")
    parser.add_argument("--solvers", default="zones,tables")
    parser.add_argument("--quality", default="standard")
    parser.add_argument("--wavelengths", default="550")
    parser.add_argument("--samples", type=int, default=20000)
    args = parser.parse_args()
    medium = climate_medium(load_climate(args.climate), np.array([float(w) for w in args.wavelengths.split(",")]))
    referee = load("montecarlo")
    truth = {}
    for altitude, directions in PLACES:
        field = referee.prepare(medium, MonteCarloSettings(samples=args.samples), observer_altitude_km=altitude)
        where = questions(directions, DISTANCES_KM)
        for sun in SUNS_DEG:
            found, passed = field.inscatter_with_error(sun, *where)
            truth[altitude, sun] = found.radiance, found.standard_error, passed
            print(f"referee {altitude:g} km, sun {sun:+g}", flush=True)
    rows = []
    for name in args.solvers.split(","):
        solver = load(name)
        field = solver.prepare(medium, solver.QUALITIES[args.quality])
        for sun in SUNS_DEG:
            worst: list[list[np.ndarray]] = [[] for _ in DISTANCES_KM]
            noise: list[list[np.ndarray]] = [[] for _ in DISTANCES_KM]
            passing: list[list[np.ndarray]] = [[] for _ in DISTANCES_KM]
            for altitude, directions in PLACES:
                where = questions(directions, DISTANCES_KM)
                light, passed = field.inscatter(sun, *where, observer_altitude_km=altitude)
                radiance, error, seen = truth[altitude, sun]
                scale = field.radiance(sun, *where[:2], observer_altitude_km=altitude).max(axis=(0, 1))
                for i in range(len(DISTANCES_KM)):
                    worst[i].append(np.abs(light - radiance)[:, i] / scale)
                    noise[i].append(error[:, i] / scale)
                    passing[i].append(np.abs(passed - seen)[:, i])
            for i, distance in enumerate(DISTANCES_KM):
                off, grain = np.concatenate(worst[i]), np.concatenate(noise[i])
                rows.append(
                    [
                        name,
                        f"{sun:g}",
                        f"{distance:g}",
                        f"{100 * np.median(off):.3f}",
                        f"{100 * np.quantile(off, 0.95):.2f}",
                        f"{100 * off.max():.2f}",
                        f"{100 * np.median(grain):.3f}",
                        f"{np.concatenate(passing[i]).max():.1e}",
                    ]
                )
                print(*rows[-1], flush=True)
    columns = "solver,sun_deg,distance_km,median_percent,p95_percent,largest_percent,referee_percent,transmittance_off"
    note = f"{args.climate}, {args.quality}, {args.wavelengths} nm; referee with {args.samples} samples a pixel"
    write(OUT, columns.split(","), rows, notes=[note, "percent of the largest radiance of the sky in the directions"])


if __name__ == "__main__":
    main()
