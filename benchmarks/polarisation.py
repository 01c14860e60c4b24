"""What leaving polarisation out costs, and how well `zones` follows it.

    python benchmarks/polarisation.py scalar     error of scalar theory in I, luminance and colour: polarisation.csv
    python benchmarks/polarisation.py reference  `zones` against `montecarlo` in I, Q and U: polarisation_reference.csv
    python benchmarks/polarisation.py sky        neutral points, polarisation of the zenith: polarisation_sky.csv, and
                                                 docs/polarisation.png
    python benchmarks/polarisation.py volcano    the same under volcanic stratospheres: polarisation_volcano.csv, and
                                                 docs/polarisation-volcano.png

    python benchmarks/polarisation.py cost       time and memory of polarised and scalar fields: polarisation_cost.csv

    python benchmarks/polarisation.py stored     the reference's Stokes vectors in clear air for a test of `zones`

Names of climates behind limit the table to them.  Errors of the first are
those of the scalar solution against the polarised one of the same solver, over a texture of half the sky.  `scalar`
and `volcano` use `zones` at quality draft, polarised, whose steps cancel in the comparison, the others at standard.
The reference's Stokes vectors are those of reference/CLIMATE.csv, which montecarlo_reference.py makes: nine suns, 26
directions.
"""

from __future__ import annotations

import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import montecarlo_reference
import neutral_points as neutral
import numpy as np
import results

import twilight
from twilight.atmosphere.medium_table import medium_from_table
from twilight.base.peak_memory import forget_peak, peak_mib
from twilight.config.load import load, load_climate
from twilight.io import write_polarisation_png
from twilight.scene.medium import climate_medium
from twilight.solvers import montecarlo, zones
from twilight.studies.compare.accuracy import colour_errors

HERE = Path(__file__).parent
STANDARD = zones.QUALITIES["standard"]
DRAFT = replace(zones.QUALITIES["draft"], polarisation=True)
CLIMATES = ("pure-air", "continental-average", "desert", "volcanic-extreme")
SKY_CLIMATES = ("pure-air", "continental-average", "urban")
STRATOSPHERES = ("background", "moderate_volcanic", "high_volcanic", "extreme_volcanic")
EIGHT_NM = (380.0, 440.0, 472.0, 548.0, 580.0, 616.0, 676.0, 720.0)
THREE_NM = (450.0, 550.0, 650.0)
SUNS_DEG = (60.0, 30.0, 10.0, 5.0, 0.0, -2.0, -4.0, -6.0, -9.0, -12.0)
SKY_SUNS_DEG = (30.0, 20.0, 10.0, 5.0, 2.0, 0.0, -1.0, -2.0, -3.0, -4.0, -5.0, -6.0, -7.0, -8.0)
VOLCANO_SUNS_DEG = (20.0, 10.0, 5.0, 2.0, 1.0, 0.0, -1.0, -1.5, -2.0, -3.0, -3.5, -4.0, -4.5, -5.0, -6.0, -7.0, -8.0)
VOLCANO_NM = (450.0, 550.0, 700.0)
MAUNA_LOA_KM = 3.4
"""Altitude of the observatory that the sky under volcanic aerosol was measured from [km]."""
SEA_ALBEDO = 0.06
"""Of the sea around it."""
SKY_COLUMNS = [
    "climate", "sun_elevation_deg", "wavelength_nm", "babinet_deg", "brewster_deg", "arago_deg", "zenith_degree",
]  # fmt: skip
SKY_NOTES = ["Babinet's and Brewster's points from the sun, Arago's from the antisolar point; empty: not above 0.5 deg"]
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
    results.write(HERE / "polarisation.csv", columns, rows, notes=notes)


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
    results.write(HERE / "polarisation_reference.csv", columns.split(","), rows, notes=notes)


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
    for climate in climates or SKY_CLIMATES:
        field = zones.prepare(climate_medium(load_climate(climate), np.array(THREE_NM)), STANDARD)
        for sun in SKY_SUNS_DEG:
            points, zenith = neutral.neutral_points(field, sun), neutral.zenith_polarisation(field, sun)
            for w, nm in enumerate(THREE_NM):
                places = ("" if np.isnan(p[w]) else f"{p[w]:.1f}" for p in points)
                rows.append([climate, f"{sun:g}", f"{nm:g}", *places, f"{zenith[w]:.3f}"])
                print(*rows[-1], sep="\t", flush=True)
    results.write(HERE / "polarisation_sky.csv", SKY_COLUMNS, rows, notes=SKY_NOTES)
    picture = twilight.render("continental-average", sun_elevation_deg=-4.0)
    write_polarisation_png(picture, HERE.parent / "docs" / "polarisation.png")


def volcano(_climates) -> None:
    """Clean air seen from a high mountain in the sea, as Mauna Loa, under the stratospheres of LOWTRAN."""
    rows, drawn = [], {}
    for kind in STRATOSPHERES:
        config = load("pure-air", {"ground.albedo": SEA_ALBEDO, "stratosphere.kind": kind})
        medium = climate_medium(config.climate, np.array(VOLCANO_NM))
        field = zones.prepare(medium, DRAFT, observer_altitude_km=MAUNA_LOA_KM)
        for sun in VOLCANO_SUNS_DEG:
            points, zenith = neutral.neutral_points(field, sun), neutral.zenith_polarisation(field, sun)
            for w, nm in enumerate(VOLCANO_NM):
                places = [p[w] for p in points]
                drawn[kind, sun, nm] = (*places, zenith[w])
                shown = ("" if np.isnan(p) else f"{p:.1f}" for p in places)
                rows.append([kind, f"{sun:g}", f"{nm:g}", *shown, f"{zenith[w]:.3f}"])
                print(*rows[-1], sep="\t", flush=True)
    results.write(HERE / "polarisation_volcano.csv", ["stratosphere", *SKY_COLUMNS[1:]], rows, notes=SKY_NOTES)
    draw_volcano(drawn)


def cost(climates) -> None:
    """Processor time of a field at eight wavelengths and of a sky from it, and the memory that they need beside what
    the process had; each alone in a process, after a smaller field that compiles."""
    rows = []
    for climate in climates or ("pure-air", "continental-average"):
        for quality in ("draft", "standard"):
            found = {}
            for polarised in (False, True):
                command = [sys.executable, __file__, "one_cost", climate, quality, str(int(polarised))]
                text = subprocess.run(command, check=True, capture_output=True, text=True).stdout
                found[polarised] = [float(x) for x in text.split()]
            (field, sky_s, mib), (plain_field, plain_sky, plain_mib) = found[True], found[False]
            times = (plain_field, field, plain_sky, sky_s)
            ratios = ((field + sky_s) / (plain_field + plain_sky), mib / plain_mib)
            rows.append(
                [climate, quality, *(f"{x:.2f}" for x in times), f"{ratios[0]:.2f}",
                 f"{plain_mib:.0f}", f"{mib:.0f}", f"{ratios[1]:.2f}"]
            )  # fmt: skip
            print(*rows[-1], sep="\t", flush=True)
    columns = (
        "climate,quality,scalar_field_s,polarised_field_s,scalar_sky_s,polarised_sky_s,times_time,"
        "scalar_mib,polarised_mib,times_memory"
    )
    notes = ["eight wavelengths, any sun, processor time; the sky: one sun over a texture of half of it"]
    results.write(HERE / "polarisation_cost.csv", columns.split(","), rows, notes=notes)


def one_cost(arguments) -> None:
    """Print seconds of the field and of a sky, and MiB, for a climate, a quality and whether polarised."""
    climate, quality, polarised = arguments
    settings = replace(zones.QUALITIES[quality], polarisation=polarised == "1")
    elevation, azimuth = texture()
    small = replace(zones.QUALITIES["draft"], polarisation=settings.polarisation, altitude_density=0.2, max_orders=3)
    zones.prepare(climate_medium(load_climate(climate), np.array([550.0])), small).radiance(-4.0, elevation, azimuth)
    medium = climate_medium(load_climate(climate), np.array(EIGHT_NM))
    forget_peak()
    before, start = peak_mib(), time.process_time()
    field = zones.prepare(medium, settings)
    solved = time.process_time()
    (field.stokes if field.polarised else field.radiance)(-4.0, elevation, azimuth)
    print(solved - start, time.process_time() - solved, peak_mib() - before)


def draw_volcano(drawn: dict) -> None:
    """Polarisation of the zenith, Arago's and Babinet's points over the sun's elevation at the longest wavelength."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot

    figure, axes = pyplot.subplots(1, 3, figsize=(15, 4.5), layout="constrained")
    nm = VOLCANO_NM[-1]
    for axis, k, title in (
        (axes[0], 3, "degree of polarisation at the zenith"),
        (axes[1], 2, "Arago's point from the antisolar point [deg]"),
        (axes[2], 0, "Babinet's point from the sun [deg]"),
    ):
        for kind in STRATOSPHERES:
            values = [drawn[kind, sun, nm][k] for sun in VOLCANO_SUNS_DEG]
            axis.plot(VOLCANO_SUNS_DEG, values, ".-", label=kind.replace("_", " "))
        axis.set(xlabel="sun [deg]", title=f"{title}, {nm:g} nm")
        axis.invert_xaxis()
        axis.grid(alpha=0.3)
    axes[0].legend(fontsize=8)
    figure.savefig(HERE.parent / "docs" / "polarisation-volcano.png", dpi=100)
    pyplot.close(figure)


if __name__ == "__main__":
    tables = {"scalar": scalar, "reference": reference, "sky": sky, "stored": stored, "volcano": volcano}
    tables |= {"cost": cost, "one_cost": one_cost}
    if len(sys.argv) < 2 or sys.argv[1] not in tables:
        sys.exit(f"one of {', '.join(tables)} comes first")
    tables[sys.argv[1]](sys.argv[2:])
