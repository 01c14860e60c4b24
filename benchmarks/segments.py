"""Aerial perspective: light that a segment of air scatters in, and its transmittance, against Monte-Carlo.

    python benchmarks/segments.py [--climate NAME] [--solvers zones,tables,tables:fine] [--wavelengths 550] [--keep]

Writes benchmarks/segments.csv: for each solver, sun and distance how far it is from the reference in percent of the
radiance scale (the largest sky radiance of the wavelength in the same directions): median, 95th percentile and largest
over directions and wavelengths, and the median standard error of that.  Observers stand on the ground and fly at
3 km.  `tables` refract nothing; it is judged in the air without refraction.
"""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path

import numpy as np
from results import write

from twilight.atmosphere.medium import Medium
from twilight.config import load_climate
from twilight.scene.medium import climate_medium
from twilight.solvers import load
from twilight.solvers.montecarlo import MonteCarloSettings

OUT = Path(__file__).with_name("segments.csv")
SUNS_DEG = (30.0, 5.0, 0.0, -4.0, -6.0)
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


def truth(air: Medium, error: float) -> dict:
    """(radiance, standard error, transmittance) of the reference solution by (altitude, sun)."""
    found = {}
    for altitude, directions in PLACES:
        settings = MonteCarloSettings(target_stderr=error)
        field = load("montecarlo").prepare(air, settings, observer_altitude_km=altitude)
        for sun in SUNS_DEG:
            seen, passed = field.inscatter_with_error(sun, *questions(directions, DISTANCES_KM))
            found[altitude, sun] = seen.radiance, seen.standard_error, passed
            print(f"reference {altitude:g} km, sun {sun:+g}", flush=True)
    return found


def compared(name: str, air: Medium, quality: str, true: dict) -> list[list[str]]:
    """Rows of one solver."""
    solver = load(name)
    field, rows = solver.prepare(air, solver.QUALITIES[quality]), []
    name = title(f"{name}:{quality}")
    for sun in SUNS_DEG:
        off: list[list[np.ndarray]] = [[] for _ in DISTANCES_KM]
        noise: list[list[np.ndarray]] = [[] for _ in DISTANCES_KM]
        transmittance_off = [0.0] * len(DISTANCES_KM)
        for altitude, directions in PLACES:
            where = questions(directions, DISTANCES_KM)
            light, passed = field.inscatter(sun, *where, observer_altitude_km=altitude)
            radiance, error, seen = true[altitude, sun]
            scale = field.radiance(sun, *where[:2], observer_altitude_km=altitude).max(axis=(0, 1))
            for i in range(len(DISTANCES_KM)):
                off[i].append(np.abs(light - radiance)[:, i] / scale)
                noise[i].append(error[:, i] / scale)
                transmittance_off[i] = max(transmittance_off[i], float(np.abs(passed - seen)[:, i].max()))
        for i, distance in enumerate(DISTANCES_KM):
            errors = 100.0 * np.concatenate(off[i])
            numbers = np.median(errors), np.quantile(errors, 0.95), errors.max()
            percent = [f"{v:.3f}" for v in (*numbers, 100.0 * np.median(np.concatenate(noise[i])))]
            rows.append([name, f"{sun:g}", f"{distance:g}", *percent, f"{transmittance_off[i]:.1e}"])
            print(*rows[-1], flush=True)
    return rows


def title(asked: str) -> str:
    """The name in the table of SOLVER or SOLVER:QUALITY."""
    name, _, quality = asked.partition(":")
    return name if quality in ("", "standard") else f"{name} {quality}"


def others(asked: list[str]) -> tuple[list[list[str]], list[str]]:
    """Rows of the table that are of other solvers, and the lines above it that say how they were made."""
    lines = OUT.read_text(encoding="utf-8").splitlines()
    rows = [line.split(",") for line in lines if not line.startswith(("#", "solver,"))]
    rows = [row for row in rows if row[0] not in {title(one) for one in asked}]
    names = ", ".join(dict.fromkeys(row[0] for row in rows))
    about = "; ".join(line[2:] for line in lines if line.startswith("#") and "percent of the" not in line)
    return rows, [f"rows of {names}: {about}"]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n", 1)[0])
    parser.add_argument("--climate", default="continental-average")
    parser.add_argument("--solvers", default="zones,tables,tables:fine", help="SOLVER or SOLVER:QUALITY, standard")
    parser.add_argument("--wavelengths", default="550")
    parser.add_argument("--error", type=float, default=0.004, help="relative standard error of the reference solution")
    parser.add_argument("--keep", action="store_true", help="keep the rows of other solvers")
    args = parser.parse_args()
    medium = climate_medium(load_climate(args.climate), np.array([float(w) for w in args.wavelengths.split(",")]))
    other_rows, notes_before = others(args.solvers.split(",")) if args.keep else ([], [])
    straight = replace(medium, refractivity=np.zeros_like(medium.refractivity))
    true: dict[bool, dict] = {}
    rows: list[list[str]] = []
    for asked in args.solvers.split(","):
        name, _, quality = asked.partition(":")
        bent = name == "zones"
        air = medium if bent else straight
        if bent not in true:
            true[bent] = truth(air, args.error)
        rows += compared(name, air, quality or "standard", true[bent])
    columns = "solver,sun_deg,distance_km,median_percent,p95_percent,largest_percent,reference_percent,"
    columns += "transmittance_off"
    note = f"{args.climate}, {args.wavelengths} nm, standard unless said; reference to {100 * args.error:g} % each"
    notes = [note, "percent of the largest radiance of the sky in the directions", *notes_before]
    write(OUT, columns.split(","), other_rows + rows, notes=notes)


if __name__ == "__main__":
    main()
