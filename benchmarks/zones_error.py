"""Error of the zones solver against the committed Monte-Carlo reference solution, by climate, with time and memory.

    python benchmarks/zones_error.py                      draft and standard, all climates whose tables are there
    python benchmarks/zones_error.py standard             one quality
    python benchmarks/zones_error.py standard urban       and one climate

Writes results/zones_error.csv after every climate, and keeps rows that were not asked for: relative errors of the
radiance over all directions and wavelengths of results/reference/CLIMATE.csv, whose light is polarised, as theirs
is.  The table's standard error is subtracted in the mean square: `excess_percent` is what 95 % of normally distributed
errors of the rest would stay below.  Times are of the processor, for all suns and the three wavelengths, which take as
long as eight do (a block of the solver), compilation apart; memory is the peak of the process while the field is made
(Linux).
"""

from __future__ import annotations

import sys
import time
from dataclasses import replace

import numpy as np
import results

from twilight.config.load import load_climate
from twilight.scene.medium import climate_medium
from twilight.solvers import zones
from twilight.studies.compare.worker import forget_peak, peak_mib

CLIMATES = {
    name: "pure-air-climate" if name == "pure-air" else name
    for name in (
        *("continental-average", "urban", "desert", "maritime-clean", "pure-air", "volcanic-extreme"),
        *("volcanic-stratosphere", "continental-clean", "continental-polluted", "maritime-polluted"),
        *("maritime-tropical", "arctic", "antarctic"),
    )
}
"""Names of the tables of the reference solution in results/reference, by climate."""
USUAL = ("draft", "standard")
HEADER = (
    "climate,quality,sun_elevation_deg,median_percent,p95_percent,max_percent,mean_percent,reference_percent,"
    "excess_percent,set_up_processor_s,peak_mib"
)


def errors(field, table: np.ndarray) -> list[tuple[float, ...]]:
    """(sun, median, 95th percentile, largest, mean, the reference solution's own, excess) in percent, per sun."""
    rows = []
    for sun in sorted(set(table["sun_elevation_deg"]), reverse=True):
        some = table[table["sun_elevation_deg"] == sun]
        place = np.searchsorted(field.medium.wavelength_nm, some["wavelength_nm"])
        radiance = field.radiance(sun, some["elevation_deg"], some["azimuth_deg"])[np.arange(some.size), place]
        error = 100.0 * (radiance / some["radiance_per_sr"] - 1.0)
        own = 100.0 * some["standard_error_per_sr"] / some["radiance_per_sr"]
        size = np.abs(error)
        excess = results.excess(error, own)
        rows.append((sun, np.median(size), np.percentile(size, 95), size.max(), error.mean(), np.median(own), excess))
    return rows


def compile_kernels() -> None:
    """Solve a sky of few nodes, so that nothing is compiled later."""
    medium = climate_medium(load_climate("continental-average"), np.array([450.0, 550.0, 680.0]))
    for name in USUAL:
        few = replace(zones.QUALITIES[name], altitude_density=0.2, zenith_density=0.3, polar_directions=3)
        zones.prepare(medium, few, sun_elevations_deg=[-4.0]).radiance(-4.0, 30.0, 0.0)


def main(qualities: list[str], climates: list[str]) -> None:
    path = results.FOLDER / "zones_error.csv"
    rows = [list(row.values()) for row in results.read_rows(path)]
    compile_kernels()
    for quality in qualities:
        for climate in climates:
            file = results.FOLDER / "reference" / f"{CLIMATES[climate]}.csv"
            if not file.exists():
                print(f"{climate}: no {file.name} (benchmarks/montecarlo_reference.py {climate} makes it)")
                continue
            table = results.read_numbers(file)
            wavelength_nm = np.unique(table["wavelength_nm"])
            medium = climate_medium(load_climate(climate), wavelength_nm)
            forget_peak()
            start = time.process_time()
            field = zones.prepare(medium, zones.QUALITIES[quality])
            seconds = time.process_time() - start
            memory = peak_mib()
            rows = [row for row in rows if row[:2] != [climate, quality]]
            for row in errors(field, table):
                numbers = [f"{row[0]:g}", *(f"{x:.2f}" for x in row[1:]), f"{seconds:.1f}", f"{memory:.0f}"]
                print(climate, quality, *numbers, sep="\t", flush=True)
                rows.append([climate, quality, *numbers])
            order = [(q, c) for q in zones.QUALITIES for c in CLIMATES]
            results.write(path, HEADER.split(","), sorted(rows, key=lambda row: order.index((row[1], row[0]))))


if __name__ == "__main__":
    results.say_help(__doc__)
    names = [a for a in sys.argv[1:] if a in zones.QUALITIES]
    places = [a for a in sys.argv[1:] if a in CLIMATES]
    main(names or list(USUAL), places or list(CLIMATES))
