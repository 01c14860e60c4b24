"""What leaving polarisation out costs, and how well `zones` follows it.

    python benchmarks/polarisation.py scalar     error of scalar theory in I, luminance and colour: polarisation.csv
    python benchmarks/polarisation.py reference  `zones` against `montecarlo` in I, Q and U: polarisation_reference.csv
    python benchmarks/polarisation.py stored     the reference's Stokes vectors in clear air for a test of `zones`

Names of climates behind limit the table to them.  Errors of `scalar` are those of the scalar solution against the
polarised one of `zones` at draft, whose steps cancel in the comparison, over a texture of half the sky.
The reference's Stokes vectors are those of reference/CLIMATE.csv, which montecarlo_reference.py makes: nine suns, 26
directions.
"""

from __future__ import annotations

import sys
from dataclasses import replace

import montecarlo_reference
import numpy as np
import results

from twilight.atmosphere.medium_table import medium_from_table
from twilight.config.load import load_climate
from twilight.scene.medium import climate_medium
from twilight.solvers import montecarlo, zones
from twilight.studies.compare.accuracy import colour_errors

STANDARD = zones.QUALITIES["standard"]
DRAFT = replace(zones.QUALITIES["draft"], polarisation=True)
CLIMATES = ("pure-air", "continental-average", "desert", "volcanic-extreme")
EIGHT_NM = (380.0, 440.0, 472.0, 548.0, 580.0, 616.0, 676.0, 720.0)
SUNS_DEG = (60.0, 30.0, 10.0, 5.0, 0.0, -2.0, -4.0, -6.0, -9.0, -12.0)
NOISE = 2e-3
"""Standard error of I that the reference solution works to."""


def texture() -> tuple[np.ndarray, np.ndarray]:
    """Elevations and azimuths of half the sky, the middles of 6 deg cells, with the lowest 3 deg twice as fine."""
    elevation = np.concatenate([[0.75, 2.25, 4.5], np.arange(9.0, 90.0, 6.0)])
    grid = np.meshgrid(elevation, np.arange(3.0, 180.0, 6.0))
    return grid[0].ravel(), grid[1].ravel()


def scalar(climates) -> None:
    elevation, azimuth = texture()
    rows = []
    for climate in climates or CLIMATES:
        medium = climate_medium(load_climate(climate), np.array(EIGHT_NM))
        right = zones.prepare(medium, DRAFT)
        plain = zones.prepare(medium, replace(DRAFT, polarisation=False))
        for sun in SUNS_DEG:
            i, j = (f.radiance(sun, elevation, azimuth) for f in (right, plain))
            error = 100.0 * (j / i - 1.0)
            found = [(f"{nm:g} nm", e) for nm, e in zip(EIGHT_NM, error.T, strict=True)]
            for name, e in found:
                size = np.abs(e)
                numbers = (np.median(size), np.percentile(size, 95), size.max(), e.min(), e.max(), e.mean())
                rows.append([climate, f"{sun:g}", name, *(f"{x:.2f}" for x in numbers)])
            colours = colour_errors(j, i, None, medium.wavelength_nm)
            if colours is not None:
                for name, s in (("luminance", colours.luminance), ("CIEDE2000", colours.ciede2000)):
                    rows.append(
                        [climate, f"{sun:g}", name, *(f"{x:.2f}" for x in (s.median, s.p95, s.largest)), "", "", ""]
                    )
            print(climate, sun, *(f"{np.sqrt(np.mean(e**2)):.2f}" for _, e in found), flush=True)
    columns = ["climate", "sun_elevation_deg", "quantity", "median", "p95", "largest", "lowest", "highest", "mean"]
    notes = [
        "errors of scalar theory in I and luminance [%] and colour; a median is one of sizes, lowest to mean have signs"
    ]
    results.write(results.FOLDER / "polarisation.csv", columns, rows, notes=notes)


def reference(climates) -> None:
    rows = []
    for climate in climates or CLIMATES:
        file = montecarlo_reference.file_of(climate)
        if not file.exists():
            sys.exit(f"{climate}: no {file.name} (benchmarks/montecarlo_reference.py {climate} makes it)")
        table = results.read_numbers(file)
        medium = climate_medium(load_climate(climate), np.unique(table["wavelength_nm"]))
        field = zones.prepare(medium, STANDARD)
        for sun in sorted(set(table["sun_elevation_deg"]), reverse=True):
            some = table[table["sun_elevation_deg"] == sun]
            place = np.searchsorted(medium.wavelength_nm, some["wavelength_nm"])
            ours = field.stokes(sun, some["elevation_deg"], some["azimuth_deg"])[np.arange(some.size), :, place]
            right = np.stack([some["radiance_per_sr"], some["q_per_sr"], some["u_per_sr"]], axis=1)
            noise = np.stack([some[f"{k}standard_error_per_sr"] for k in ("", "q_", "u_")], axis=1) / right[:, :1]
            rows.append([climate, f"{sun:g}", *(judged(ours, right, noise))])
            print(*rows[-1], sep="\t", flush=True)
    columns = (
        "climate,sun_elevation_deg,i_p95_percent,i_noise_percent,i_excess_percent,"
        "degree_p95,degree_noise,degree_excess,angle_p95_deg,angle_noise_deg,angle_excess_deg"
    )
    notes = [
        "all directions and wavelengths of a sun; angles where the degree exceeds 0.05; noise: the reference's, median",
        "excess: what 95 % of normally distributed errors stay below, of a mean square less the noise",
    ]
    results.write(results.FOLDER / "polarisation_reference.csv", columns.split(","), rows, notes=notes)


def judged(ours: np.ndarray, right: np.ndarray, noise: np.ndarray) -> list[str]:
    """Errors of I, degree and angle from Stokes vectors (N, 3); noise (N, 3): standard errors over I."""
    degree, found = (np.hypot(s[:, 1], s[:, 2]) / s[:, 0] for s in (right, ours))
    turn = 0.5 * np.degrees(np.arctan2(ours[:, 2], ours[:, 1]) - np.arctan2(right[:, 2], right[:, 1]))
    turn = (turn + 90.0) % 180.0 - 90.0
    # along the vibration the noise is that of the degree, across it that of the angle
    q, u = np.abs(right[:, 1:].T) / np.maximum(right[:, 0] * degree, 1e-300)
    of_degree = np.hypot(q * noise[:, 1], u * noise[:, 2])
    of_angle = np.degrees(0.5 * np.hypot(u * noise[:, 1], q * noise[:, 2]) / np.maximum(degree, 1e-300))
    polarised = degree > 0.05
    numbers: list[str] = []
    for error, own, digits in (
        (100.0 * (ours[:, 0] / right[:, 0] - 1.0), 100.0 * noise[:, 0], 2),
        (found - degree, of_degree, 4),
        (turn[polarised], of_angle[polarised], 2),
    ):
        excess = results.excess(error, own)
        numbers += [f"{x:.{digits}f}" for x in (np.percentile(np.abs(error), 95), np.median(own), excess)]
    return numbers


def stored(_climates) -> None:
    medium = medium_from_table(results.FOLDER / "reference" / "pure-air.csv")
    elevation, azimuth = (g.ravel() for g in np.meshgrid([3.0, 12.0, 35.0, 65.0, 88.0], [20.0, 90.0, 160.0]))
    judge = montecarlo.prepare(medium, montecarlo.MonteCarloSettings(target_stderr=NOISE))
    rows = []
    for sun in (5.0, -4.0, -6.0):
        answer = judge.stokes_with_error(sun, elevation, azimuth)
        for d, (e, a) in enumerate(zip(elevation, azimuth, strict=True)):
            for w, nm in enumerate(medium.wavelength_nm):
                numbers = (*answer.stokes[d, :, w], *answer.standard_error[d, :, w])
                rows.append([f"{sun:g}", f"{e:g}", f"{a:g}", f"{nm:g}", *(f"{x:.6g}" for x in numbers)])
    columns = "sun_elevation_deg,elevation_deg,azimuth_deg,wavelength_nm,i,q,u,i_error,q_error,u_error"
    results.write(results.ROOT / "tests" / "data" / "stokes_pure_air.csv", columns.split(","), rows)


if __name__ == "__main__":
    results.say_help(__doc__)
    tables = {"scalar": scalar, "reference": reference, "stored": stored}
    if len(sys.argv) < 2 or sys.argv[1] not in tables:
        sys.exit(f"one of {', '.join(tables)} comes first")
    tables[sys.argv[1]](sys.argv[2:])
