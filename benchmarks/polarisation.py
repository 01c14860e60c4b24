"""What leaving polarisation out costs, and how well `zones` follows it.

    python benchmarks/polarisation.py scalar     error of scalar theory in I, luminance and colour: polarisation.csv
    python benchmarks/polarisation.py referee    `zones` against `montecarlo` in I, Q and U: polarisation_referee.csv
    python benchmarks/polarisation.py sky        neutral points, polarisation of the zenith: polarisation_sky.csv

    python benchmarks/polarisation.py stored     the referee's Stokes vectors in clear air that a test of `zones` reads

Names of climates behind limit the table to them.  Errors of the first are those of the scalar solution against the
polarised one of the same solver, over a texture of half the sky; `zones` at quality standard in all three.
"""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import results

from twilight.atmosphere.table import medium_from_table
from twilight.compare.accuracy import colour_spread
from twilight.config.load import load_climate
from twilight.scene.medium import climate_medium
from twilight.solvers import montecarlo, zones
from twilight.validate.phenomena.neutral import degree_of_polarisation, neutral_points, zenith_polarisation

HERE = Path(__file__).parent
STANDARD = zones.QUALITIES["standard"]
CLIMATES = ("pure-air", "continental-clean", "continental-average", "urban")
EIGHT_NM = (380.0, 440.0, 472.0, 548.0, 580.0, 616.0, 676.0, 720.0)
THREE_NM = (450.0, 550.0, 650.0)
SUNS_DEG = (60.0, 30.0, 10.0, 5.0, 0.0, -2.0, -4.0, -6.0, -9.0, -12.0)
REFEREE_SUNS_DEG = (30.0, 5.0, 0.0, -4.0, -6.0, -9.0)
SKY_SUNS_DEG = (30.0, 20.0, 10.0, 5.0, 2.0, 0.0, -1.0, -2.0, -3.0, -4.0, -5.0, -6.0, -7.0, -8.0)
NOISE = 2e-3
"""Standard error of I that the referee works to."""


def texture() -> tuple[np.ndarray, np.ndarray]:
    """Elevations and azimuths of half the sky, the middles of 6 deg cells, with the lowest 3 deg twice as fine."""
    elevation = np.concatenate([[0.75, 2.25, 4.5], np.arange(9.0, 90.0, 6.0)])
    grid = np.meshgrid(elevation, np.arange(3.0, 180.0, 6.0))
    return grid[0].ravel(), grid[1].ravel()


def scalar(climates) -> None:
    elevation, azimuth = texture()
    rows = []
    for climate in climates:
        medium = climate_medium(load_climate(climate), np.array(EIGHT_NM))
        right = zones.prepare(medium, STANDARD)
        plain = zones.prepare(medium, replace(STANDARD, polarisation=False))
        for sun in SUNS_DEG:
            i, j = (f.radiance(sun, elevation, azimuth) for f in (right, plain))
            error = 100.0 * (j / i - 1.0)
            found = [(f"{nm:g} nm", e) for nm, e in zip(EIGHT_NM, error.T, strict=True)]
            for name, e in found:
                size = np.abs(e)
                numbers = (np.median(size), np.percentile(size, 95), size.max(), e.min(), e.max(), e.mean())
                rows.append([climate, f"{sun:g}", name, *(f"{x:.2f}" for x in numbers)])
            colours = colour_spread(j, i, None, medium.wavelength_nm)
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
    results.write(HERE / "polarisation.csv", columns, rows, notes=notes)


def referee(climates) -> None:
    elevation, azimuth = (
        g.ravel() for g in np.meshgrid([3.0, 10.0, 25.0, 50.0, 75.0, 88.0], [15.0, 60.0, 120.0, 165.0])
    )
    rows = []
    for climate in climates:
        medium = climate_medium(load_climate(climate), np.array(THREE_NM))
        field = zones.prepare(medium, STANDARD)
        judge = montecarlo.prepare(medium, montecarlo.MonteCarloSettings(target_stderr=NOISE))
        for sun in REFEREE_SUNS_DEG:
            ours, answer = field.stokes(sun, elevation, azimuth), judge.stokes_with_error(sun, elevation, azimuth)
            right, noise = answer.stokes, answer.standard_error / answer.stokes[:, :1]
            error = 100.0 * (ours[:, 0] / right[:, 0] - 1.0)
            degree = degree_of_polarisation(right)
            off = np.abs(degree_of_polarisation(ours) - degree)
            turn = 0.5 * np.degrees(np.arctan2(ours[:, 2], ours[:, 1]) - np.arctan2(right[:, 2], right[:, 1]))
            turn = np.abs((turn + 90.0) % 180.0 - 90.0)
            for w, nm in enumerate(THREE_NM):
                polarised = degree[:, w] > 0.05
                numbers = [
                    np.median(np.abs(error[:, w])),
                    np.percentile(np.abs(error[:, w]), 95),
                    error[:, w].mean(),
                    100.0 * np.median(noise[:, 0, w]),
                ]
                of_degree = [np.median(off[:, w]), np.percentile(off[:, w], 95), np.median(noise[:, 1:, w])]
                of_angle = [np.median(turn[polarised, w]), np.percentile(turn[polarised, w], 95)]
                row = [climate, f"{sun:g}", f"{nm:g}", *(f"{x:.3f}" for x in numbers)]
                rows.append(row + [f"{x:.4f}" for x in of_degree] + [f"{x:.2f}" for x in of_angle])
                print(*rows[-1], sep="\t", flush=True)
    columns = (
        "climate,sun_elevation_deg,wavelength_nm,i_median_percent,i_p95_percent,i_mean_percent,i_noise_percent,"
        "degree_median,degree_p95,degree_noise,angle_median_deg,angle_p95_deg"
    )
    results.write(HERE / "polarisation_referee.csv", columns.split(","), rows)


def stored(_climates) -> None:
    medium = medium_from_table(HERE / "reference" / "pure-air.csv")
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
    results.write(HERE.parent / "tests" / "data" / "stokes_pure_air.csv", columns.split(","), rows)


def sky(climates) -> None:
    rows = []
    for climate in climates:
        field = zones.prepare(climate_medium(load_climate(climate), np.array(THREE_NM)), STANDARD)
        for sun in SKY_SUNS_DEG:
            points, zenith = neutral_points(field, sun), zenith_polarisation(field, sun)
            for w, nm in enumerate(THREE_NM):
                places = ("" if np.isnan(p[w]) else f"{p[w]:.1f}" for p in points)
                rows.append([climate, f"{sun:g}", f"{nm:g}", *places, f"{zenith[w]:.3f}"])
                print(*rows[-1], sep="\t", flush=True)
    columns = [
        "climate",
        "sun_elevation_deg",
        "wavelength_nm",
        "babinet_deg",
        "brewster_deg",
        "arago_deg",
        "zenith_degree",
    ]
    notes = ["Babinet's and Brewster's points from the sun, Arago's from the antisolar point; empty: not above 0.5 deg"]
    results.write(HERE / "polarisation_sky.csv", columns, rows, notes=notes)


if __name__ == "__main__":
    tables = {"scalar": scalar, "referee": referee, "sky": sky, "stored": stored}
    if len(sys.argv) < 2 or sys.argv[1] not in tables:
        sys.exit(f"one of {', '.join(tables)} comes first")
    tables[sys.argv[1]](sys.argv[2:] or CLIMATES)
