"""Odd air against the reference solution: python benchmarks/odd_air.py [drawn LAST | layers | peaks | again NUMBER ...]

`drawn` (200) writes results/odd_air.csv: cases drawn from all that the program permits (`tests/odd_airs.py`, whose
`drawn(number)` makes a case of the table again), every fourth a clear climate; cases that the table has stay.  `again`
solves cases anew with sixteen times the samples.  `layers` writes results/sharp_layers.csv: single layers from 10 m to
1 km, seen from below, from inside and from above.  `peaks` writes results/sharp_peaks.csv: aerosol of asymmetry 0.98
about 15 deg from the sun, whose largest errors `zones` warns of.  Scalar theory, one wavelength.

The reference takes a number of samples that costs SAMPLING_S processor seconds.  Where too few of its paths find light
it has no value, and neither has the row.  z: difference over the reference's standard error, to which TOLERATED of the
radiance is added in quadrature.  What takes longer than LIMIT_S processor seconds is stopped, and the row says so.
"""

from __future__ import annotations

import multiprocessing
import resource
import sys
import time
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import replace
from multiprocessing.connection import Connection
from typing import Any

import numpy as np
import results

sys.path.insert(0, str(results.ROOT / "tests"))
sys.path.insert(0, str(results.ROOT / "benchmarks" / "builders"))
from clear_air_airs import drawn_climate, load_climate_document
from layered_sky import layered
from odd_airs import OddAir, drawn, seen
from stability_media import Air, medium_of

from twilight.atmosphere.medium import Medium
from twilight.base.errors import TwilightError, TwilightWarning
from twilight.scene.medium import climate_medium
from twilight.solvers import compact, montecarlo, zones

TABLE = results.FOLDER / "odd_air.csv"
COLUMNS = (
    *("number", "case", "observer_km", "sun_elevation_deg", "elevation_deg", "azimuth_deg"),
    *("reference_per_sr", "reference_percent", "draft_percent", "draft_z", "compact_percent", "brief_z", "note"),
)
LAYER_COLUMNS = (
    *("case", "sun_elevation_deg", "observer_km", "elevation_deg", "azimuth_deg"),
    *("reference_per_sr", "reference_percent", "draft_percent", "standard_percent"),
)
CLEAR_EVERY = 4
"""Of so many numbers one is a clear climate, which `compact` knows too."""
SAMPLING_S = 1.0
"""Processor seconds of the reference's samples; its importance function takes some 3 more."""
PILOT = 16
"""Samples of a direction in the run that tells what one costs."""
BRIEF = 256
"""Samples of a direction in a run whose own errors are judged."""
MOST = 20_000
"""Most samples of a direction."""
LIMIT_S = 25.0
"""Processor seconds of `zones`, and of the reference solution, after which it is stopped."""
TOLERATED = 0.03
"""Error of `draft` that counts as none: it is off by as much at 95 % in ordinary air (`zones_error.csv`)."""
Directions = Sequence[tuple[float, float]]
"""Elevations and azimuths [deg]."""
PEAK_DEPTHS = (0.5, 1.0)
PEAK_VIEWS: dict[float, Directions] = {
    15.0: ((0.5, 0.0), (15.0, 15.5), (30.0, 0.0)),
    40.0: ((25.0, 0.0), (40.0, 19.6), (55.0, 0.0)),
}
"""By the sun's elevation [deg]: directions 15 deg from it."""
LAYER_SUNS_DEG = (30.0, -6.0)
LAYERS: dict[str, tuple[float, float, float, float]] = {
    "jump, 10 m at 3 km, depth 2": (3.0, 0.01, 2.0, 0.0),
    "jump, 1 km at 3 km, depth 10": (3.0, 1.0, 10.0, 0.0),
    "ramps of 1 m, 200 m at 3 km, depth 0.5": (3.0, 0.2, 0.5, 1e-3),
    "jump, 1 km at 10 km, depth 0.01": (10.0, 1.0, 0.01, 0.0),
    "jump, 500 m at 1 km, depth 50": (1.0, 0.5, 50.0, 0.0),
    "jump, 1 km at 50 km, depth 1": (50.0, 1.0, 1.0, 0.0),
}
"""base [km], thickness [km], optical depth, ramps [km]"""


def case(number: int) -> OddAir:
    """The air, observer and sun of a number."""
    if number % CLEAR_EVERY:
        return drawn(number)
    rng = np.random.default_rng([66, number])
    while True:
        try:
            nm = rng.uniform(320.0, 1000.0)
            medium = climate_medium(load_climate_document(drawn_climate(rng, number // CLEAR_EVERY)), [nm])
            break
        except TwilightError:  # less aerosol in all than in the stratosphere alone: another one
            continue
    depth = float(medium.optical_depth("aerosol")[0])
    return seen(rng, f"clear climate, {nm:.0f} nm, aerosol {depth:.2g}", medium)


def reference(air: OddAir, sampling_s: float) -> tuple[Any, np.ndarray]:
    """The reference solution, and radiance and standard error (2, D) [sr^-1] of a run of BRIEF samples."""
    settings = montecarlo.MonteCarloSettings(target_stderr=None, samples=PILOT, polarisation=False)
    field = montecarlo.prepare(air.medium, settings, observer_altitude_km=air.altitude_km)

    def run(samples: int, seed: int) -> Any:
        here = replace(field, settings=replace(settings, samples=samples, seed=seed))
        return here.radiance_with_error(air.sun_deg, air.elevation_deg, air.azimuth_deg)

    run(2, 3)
    begun = time.process_time()
    run(PILOT, 3)
    per_sample_s = max(1e-5, (time.process_time() - begun) / PILOT)
    brief = run(BRIEF, 2)
    found = run(int(np.clip(sampling_s / per_sample_s, BRIEF, MOST)), 1)
    return found, np.array([brief.radiance[:, 0], brief.standard_error[:, 0]])


def draft(air: OddAir) -> np.ndarray:
    """Radiance (D,) of `zones` at draft."""
    settings = replace(zones.QUALITIES["draft"], polarisation=False)
    at = {"observer_altitude_km": air.altitude_km}
    field = zones.prepare(air.medium, settings, sun_elevations_deg=[air.sun_deg], **at)
    return field.radiance(air.sun_deg, air.elevation_deg, air.azimuth_deg, **at)[:, 0]


def fitted(air: OddAir) -> np.ndarray | None:
    """Radiance (D,) of `compact`, None: it does not serve."""
    try:
        field = compact.prepare(air.medium, observer_altitude_km=air.altitude_km)
        return field.radiance(air.sun_deg, air.elevation_deg, air.azimuth_deg)[:, 0]
    except TwilightError:
        return None


def serve(pipe: Connection, sampling_s: float) -> None:
    """Solve the cases that are asked for, (number, by which solver), one after the other."""
    warnings.simplefilter("ignore", TwilightWarning)
    solvers = {"reference": lambda air: reference(air, sampling_s), "draft": draft, "compact": fitted}
    for solve in solvers.values():  # machine code is made outside any limit
        solve(case(1))
    while True:
        number, solver = pipe.recv()
        air = case(number)
        used = resource.getrusage(resource.RUSAGE_SELF)
        limit = used.ru_utime + used.ru_stime + LIMIT_S * max(1.0, sampling_s / SAMPLING_S)
        resource.setrlimit(resource.RLIMIT_CPU, (int(np.ceil(limit)), resource.RLIM_INFINITY))
        try:
            pipe.send(solvers[solver](air))
        except TwilightError as error:
            pipe.send(str(error))


class Worker:
    """A process that solves cases, and is started anew where a limit ended it."""

    def __init__(self, sampling_s: float):
        self.sampling_s = sampling_s
        self.process: multiprocessing.process.BaseProcess | None = None

    def solve(self, number: int, solver: str) -> Any:
        """What `serve` finds; a sentence where it finds nothing."""
        if self.process is None or not self.process.is_alive():
            context = multiprocessing.get_context("spawn")
            self.pipe, other = context.Pipe()
            self.process = context.Process(target=serve, args=(other, self.sampling_s), daemon=True)
            self.process.start()
            other.close()
        self.pipe.send((number, solver))
        try:
            return self.pipe.recv()
        except EOFError:
            self.process.join()
            return f"{solver} stopped after {LIMIT_S:g} processor s"


def rows_of(number: int, worker: Worker) -> list[list]:
    """The rows of a case, one for each direction."""
    air = case(number)
    found = worker.solve(number, "reference")
    sky = worker.solve(number, "draft")
    model = worker.solve(number, "compact")
    said = [answer for answer in (found, sky) if isinstance(answer, str)]
    nothing = np.full(air.elevation_deg.size, np.nan)
    value, error, brief = nothing, nothing, (nothing, nothing)
    if not isinstance(found, str):
        value, error, brief = found[0].radiance[:, 0], found[0].standard_error[:, 0], found[1]
    sky, model = (nothing if isinstance(answer, str) or answer is None else answer for answer in (sky, model))
    with np.errstate(invalid="ignore", divide="ignore"):
        z = (sky - value) / np.hypot(error, TOLERATED * value)
        percent = [100.0 * (other / value - 1.0) for other in (sky, model)]
        brief_z = (brief[0] - value) / np.hypot(brief[1], error)
        noise = 100.0 * error / value
    rows = []
    for d in range(value.size):
        numbers = [f"{air.altitude_km:.5g}", f"{air.sun_deg:.6g}", f"{air.elevation_deg[d]:.5g}"]
        numbers += [f"{air.azimuth_deg[d]:.4g}", f"{value[d]:.4g}", f"{noise[d]:.2f}", f"{percent[0][d]:.2f}"]
        numbers += [f"{z[d]:.2f}", f"{percent[1][d]:.2f}", f"{brief_z[d]:.2f}"]
        rows.append([number, air.what.replace(",", ";"), *numbers, "; ".join(said).replace(",", ";")])
    return rows


def solve_drawn(numbers: Sequence[int], sampling_s: float) -> None:
    """Add the rows of cases to the table, each as soon as it is there; those of the same number go."""
    begun = results.read_rows(TABLE) if TABLE.exists() else []
    kept = [list(row.values()) for row in begun if int(row["number"]) not in numbers]
    worker = Worker(sampling_s)
    for number in numbers:
        rows = rows_of(number, worker)
        kept += rows
        results.write(TABLE, COLUMNS, kept, command="python benchmarks/odd_air.py drawn")
        print(*rows[0][:2], *([row[8], row[9]] for row in rows), rows[0][-1], sep="\t", flush=True)


def beside(what: str, medium: Medium, seen: Mapping[tuple[float, float], Directions]) -> list[list]:
    """The rows of a medium: directions by altitude [km] and sun [deg], each in `draft` and `standard`."""
    altitudes_km, suns_deg = zip(*seen, strict=True)
    fields = [
        zones.prepare(
            medium,
            replace(zones.QUALITIES[quality], polarisation=False),
            observer_altitude_km=max(altitudes_km),
            sun_elevations_deg=sorted(set(suns_deg)),
        )
        for quality in ("draft", "standard")
    ]
    settings = montecarlo.MonteCarloSettings(target_stderr=0.01, max_samples=MOST, polarisation=False)
    exact = {km: montecarlo.prepare(medium, settings, observer_altitude_km=km) for km in set(altitudes_km)}
    rows = []
    for (km, sun), views in seen.items():
        e, a = np.transpose(views)
        found = exact[km].radiance_with_error(sun, e, a)
        value, error = found.radiance[:, 0], found.standard_error[:, 0]
        skies = [f.radiance(sun, e, a, observer_altitude_km=km)[:, 0] for f in fields]
        for d in range(value.size):
            numbers = [f"{sun:g}", f"{km:g}", f"{e[d]:g}", f"{a[d]:g}", f"{value[d]:.5g}"]
            numbers += [f"{100.0 * error[d] / value[d]:.2f}"]
            rows.append([what, *numbers, *(f"{100.0 * (sky[d] / value[d] - 1.0):.2f}" for sky in skies)])
            print(*rows[-1], sep="\t", flush=True)
    return rows


def solve_layers() -> None:
    """Write the table of single layers."""
    rows = []
    for what, (base, thickness, depth, ramp) in LAYERS.items():
        below, inside, above = (3.0, 20.0, 90.0), (-20.0, 0.5, 20.0), (-90.0, -20.0, 10.0)
        altitudes_km = 0.0, base + 0.5 * thickness, base + thickness + 5.0
        views = {km: [(e, 40.0) for e in up] for km, up in zip(altitudes_km, (below, inside, above), strict=True)}
        seen = {(km, sun): views[km] for km in altitudes_km for sun in LAYER_SUNS_DEG}
        rows += beside(what, layered(base, thickness, depth, ramp), seen)
    results.write(results.FOLDER / "sharp_layers.csv", LAYER_COLUMNS, rows)


def solve_peaks() -> None:
    """Write the table of aerosol that scatters sharply forward."""
    rows = []
    for depth in PEAK_DEPTHS:
        medium = medium_of(Air(aerosol=depth, asymmetry=0.98))
        rows += beside(f"asymmetry 0.98, depth {depth:g}", medium, {(0.0, sun): v for sun, v in PEAK_VIEWS.items()})
    results.write(results.FOLDER / "sharp_peaks.csv", LAYER_COLUMNS, rows)


def main(arguments: list[str]) -> None:
    if arguments[:1] == ["layers"]:
        solve_layers()
    elif arguments[:1] == ["peaks"]:
        solve_peaks()
    elif arguments[:1] == ["again"]:
        solve_drawn([int(a) for a in arguments[1:]], 16.0 * SAMPLING_S)
    else:
        last = int(arguments[1]) if len(arguments) > 1 else 200
        there = {int(row["number"]) for row in results.read_rows(TABLE)} if TABLE.exists() else set()
        solve_drawn([number for number in range(last) if number not in there], SAMPLING_S)


if __name__ == "__main__":
    results.say_help(__doc__)
    main(sys.argv[1:])
