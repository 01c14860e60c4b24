"""The frontiers of `zones` and of sasktran2 on the same skies.

    python benchmarks/frontier.py peers         goes on from benchmarks/frontier_peers.csv: MINUTES for each search
    python benchmarks/frontier.py peers 0.3     0.3 processor minutes for each
    python benchmarks/frontier.py peers anew    forgets the points there are
    python benchmarks/frontier.py peers 0       the table and the picture of the points there are

Both codes get the same air (SCENES, at the wavelengths of its reference table), the same suns and directions, one
thread's worth of processor time counted from the air to all radiances, and the same search over what their users can
set.  Errors are those of `twilight frontier` beside the same Monte-Carlo references, polarised and refracted.
The suns are divided into those that sasktran2 is made for and those of twilight (SUNS): its source is found for all of
them in one run.  Every point goes to benchmarks/frontier_peers.csv.
"""

from __future__ import annotations

import time
from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import results
from zones_error import CLIMATES as TABLES

from twilight.base.peak_memory import forget_peak, peak_mib
from twilight.config.load import load_climate
from twilight.scene.medium import climate_medium
from twilight.solvers import sasktran2, zones
from twilight.studies.compare.reference_solution import read_references
from twilight.studies.frontier.measure import Measurement, excess_percent
from twilight.studies.frontier.search import Point, frontier, search
from twilight.studies.frontier.space import ZONES, SearchedOption, Space

HERE = Path(__file__).resolve().parent
TABLE = HERE / "frontier_peers.csv"
PICTURE = HERE.parent / "docs" / "frontier-peers.png"
SCENES = ("continental-average", "desert")
SUNS = {"day": (30.0, 10.0, 5.0), "twilight": (0.0, -6.0)}
MINUTES = 3.0
"""Processor minutes of the search of each code, after which no new point is begun."""
LONGEST_S = 20.0
"""Mean processor seconds beyond which a point is given up."""
LEBEDEV = (26, 38, 50, 74, 86, 110, 146, 170, 194, 230, 266, 302, 350, 434, 590)
"""Numbers of directions for which sasktran2 has quadratures (Lebedev's rules)."""
PLAIN = replace(sasktran2.QUALITIES["draft"], threads=1)
QUICK = replace(PLAIN, discrete_ordinates=True, zenith_step_deg=2.0, single_step_km=0.05, single_growth=0.1)
SASKTRAN2 = Space(
    dimensions=(
        SearchedOption("discrete_ordinates", 0, 1),
        SearchedOption("polarisation", 0, 1),
        SearchedOption("refraction", 0, 1),
        SearchedOption("delta_scaling", 0, 1),
        SearchedOption("streams", 4, 40, choices=tuple(range(4, 41, 2))),
        SearchedOption("incoming", 26, 590, choices=LEBEDEV),
        SearchedOption("outgoing", 26, 590, choices=LEBEDEV),
        SearchedOption("single_step_km", 0.005, 0.5, whole=False),
        SearchedOption("single_growth", 0.01, 0.3, whole=False),
        SearchedOption("multiple_step_km", 0.25, 4.0, whole=False),
        SearchedOption("source_step_km", 0.25, 4.0, whole=False),
        SearchedOption("source_growth", 0.05, 0.6, whole=False),
        SearchedOption("zenith_step_deg", 0.2, 10.0, whole=False),
        SearchedOption("tolerance", 1e-4, 3e-2, whole=False),
    ),
    starts={
        "discrete ordinates": QUICK,
        "layers of 0.5 km": replace(QUICK, multiple_step_km=0.5, zenith_step_deg=5.0),
        "layers of 0.25 km": replace(QUICK, multiple_step_km=0.25, zenith_step_deg=6.0, single_step_km=0.02),
        "polarised": replace(QUICK, multiple_step_km=1.0, zenith_step_deg=6.0, polarisation=True, streams=8),
        "24 streams": replace(QUICK, multiple_step_km=1.0, zenith_step_deg=6.0, streams=24),
        "refracted": replace(QUICK, multiple_step_km=0.5, zenith_step_deg=5.0, refraction=True, single_step_km=0.02),
        "successive orders": replace(QUICK, discrete_ordinates=False, multiple_step_km=2.0, source_step_km=2.0),
    },
)
"""What decides error and time in sasktran2; altitudes for multiple scattering are even (docs/notes/sasktran2.md)."""
COLUMNS = "suns,solver,point,origin,complete,on_frontier,scene,processor_s,peak_mib,error_percent"
SUN = "error_percent_sun_"
"""How the columns of errors begin."""
COLOURS = {"zones": "#D55E00", "sasktran2": "#0072B2"}


class Skies:
    """Skies of one climate, computed by one code."""

    def __init__(self, name: str, module: ModuleType, physics: Any, suns: Iterable[float]):
        self.name, self.module, self.physics = name, module, physics
        stored = read_references(HERE / "reference" / f"{TABLES[name]}.csv")
        self.references = {sun: stored[sun] for sun in suns}
        self.medium = climate_medium(load_climate(name), next(iter(stored.values())).wavelength_nm)

    def warm_up(self) -> None:
        """Kernels are loaded, or compiled, before the clock runs."""
        few = {"altitude_density": 0.3, "zenith_density": 0.4} if self.module is zones else {"zenith_step_deg": 20.0}
        self.measure(replace(self.physics, **few))

    def measure(self, settings: Any) -> Measurement:
        """Processor time and memory from the air to the radiances of all suns, and their errors."""
        forget_peak()
        start = time.process_time()
        if self.module is zones:
            field = zones.prepare(self.medium, settings, sun_elevations_deg=list(self.references))
            skies = [field.radiance(s, r.elevation_deg, r.azimuth_deg) for s, r in self.references.items()]
        else:
            right = self.references.values()
            sun = np.concatenate([np.full(r.elevation_deg.size, s) for s, r in self.references.items()])
            elevation, azimuth = (
                np.concatenate([getattr(r, k) for r in right]) for k in ("elevation_deg", "azimuth_deg")
            )
            found = sasktran2.prepare(self.medium, settings).radiance(sun, elevation, azimuth)
            skies = np.split(found, np.cumsum([r.elevation_deg.size for r in right])[:-1])
        seconds, memory = time.process_time() - start, peak_mib()
        error = {s: excess_percent(sky, r) for sky, (s, r) in zip(skies, self.references.items(), strict=True)}
        return Measurement(seconds, error, memory)


def searches(minutes: float, known: dict[tuple[str, str], list[Point]]) -> None:
    """Every point of both codes for both ranges of suns; the table is written after each search.

    minutes: of the processor for a search of each code, after which it begins no new point
    """
    codes = {
        "zones": (zones, zones.QUALITIES["standard"], ZONES, ("draft", "standard")),
        "sasktran2": (sasktran2, PLAIN, SASKTRAN2, ("draft",)),
    }
    found = {key: list(points) for key, points in known.items()}
    for range_name, suns in SUNS.items():
        for name, (module, physics, space, qualities) in codes.items():
            scenes = [Skies(scene, module, physics, suns) for scene in SCENES]
            starts = {**space.starts, **{q: replace(module.QUALITIES[q], **_kept(module)) for q in qualities}}
            points = found.setdefault((range_name, name), [])
            for point in search(
                scenes,
                starts,
                budget_s=60.0 * minutes,
                most_points=300,
                longest_s=LONGEST_S,
                known=tuple(points),
                seed=1,
                space=space,
            ):
                points.append(point)
                print(range_name, name, point.origin, point.complete, f"{point.processor_s:.2f} s", end=" ")
                print(f"{point.peak_mib:.0f} MiB", f"{point.error_percent:.2f} %", flush=True)
            write(found)


def _kept(module: ModuleType) -> dict[str, Any]:
    return {"threads": 1} if module is sasktran2 else {}


def write(found: dict[tuple[str, str], list[Point]]) -> None:
    """The table: a row for each point and scene, the errors of its suns and its settings as KEY=VALUE."""
    suns = [sun for some in SUNS.values() for sun in some]
    rows: list[list[Any]] = []
    for (range_name, name), points in found.items():
        best = frontier(points)
        for number, p in enumerate(points):
            for scene, m in p.found.items():
                what = [range_name, name, number, p.origin, int(p.complete), int(any(p is b for b in best)), scene]
                by_sun = [f"{m.error_percent[sun]:.3f}" if sun in m.error_percent else "" for sun in suns]
                numbers = [f"{m.processor_s:.3f}", f"{m.peak_mib:.0f}", f"{m.worst_percent:.3f}"]
                rows.append([*what, *numbers, *by_sun, " ".join(f"{k}={v:g}" for k, v in p.values.items())])
    columns = [*COLUMNS.split(","), *(f"{SUN}{sun:g}" for sun in suns), "settings"]
    results.write(TABLE, columns, rows, command="python benchmarks/frontier.py peers")


def read() -> dict[tuple[str, str], list[Point]]:
    """The points of the table, by range of suns and code."""
    found: dict[tuple[str, str], dict[str, Point]] = {}
    for row in results.read_rows(TABLE):
        pairs = (pair.split("=") for pair in row["settings"].split())
        values = {key: float(value) for key, value in pairs}
        points = found.setdefault((row["suns"], row["solver"]), {})
        space = ZONES if row["solver"] == "zones" else SASKTRAN2
        point = points.setdefault(row["point"], Point(space.within(values), row["origin"]))
        point.complete = row["complete"] == "1"
        suns = {float(key.removeprefix(SUN)): text for key, text in row.items() if key.startswith(SUN) and text}
        errors = {sun: float(text) for sun, text in suns.items()}
        point.found[row["scene"]] = Measurement(float(row["processor_s"]), errors, float(row["peak_mib"]))
    return {key: list(points.values()) for key, points in found.items()}


def draw() -> None:
    """The picture, of the table's points that were measured on every scene: a panel for each range of suns."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot
    from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

    known = read()
    figure: Any
    with pyplot.rc_context({"font.size": 10.5, "axes.spines.top": False, "axes.spines.right": False}):
        figure, panels = pyplot.subplots(1, 2, figsize=(10.0, 4.4), layout="constrained", sharey=True, sharex=True)
        for axes, (range_name, suns) in zip(panels, SUNS.items(), strict=True):
            axes.set(xscale="log", yscale="log", xlabel="processor time of the skies [s]")
            axes.grid(which="major", color="0.9", linewidth=0.8)
            axes.set_axisbelow(True)
            axes.set_title(f"{range_name}: suns at {', '.join(f'{s:g}' for s in suns)} deg", loc="left", fontsize=11)
            for name, colour in COLOURS.items():
                points = [p for p in known[range_name, name] if p.complete]
                some = [(p.processor_s, p.error_percent) for p in points]
                axes.scatter(*zip(*some, strict=True), s=14, color=colour, alpha=0.4, linewidths=0)
                best = frontier(points)
                some = [(p.processor_s, p.error_percent) for p in best]
                axes.step(*zip(*some, strict=True), where="post", color=colour, linewidth=1.6, marker="o", markersize=4)
                axes.plot([], [], color=colour, label=name)
                for p in {id(p): p for p in (best[0], best[-1])}.values():
                    where = (p.processor_s, p.error_percent)
                    axes.annotate(f"{p.peak_mib:.0f} MiB", where, xytext=(4, 6), textcoords="offset points", fontsize=8)
            for axis in (axes.xaxis, axes.yaxis):
                axis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
                axis.set_major_formatter(FuncFormatter(lambda value, position: f"{value:g}"))
                axis.set_minor_formatter(NullFormatter())
        panels[0].set_ylabel("error of the radiance at 95 % [%]")
        panels[0].legend(frameon=False, title=f"frontiers, {' and '.join(SCENES)}")
        figure.savefig(PICTURE, dpi=130)
        pyplot.close(figure)


def main(arguments: list[str]) -> None:
    known = read() if TABLE.exists() and arguments != ["anew"] else {}
    minutes = MINUTES if arguments in ([], ["anew"]) else float(arguments[0])
    if arguments != ["0"]:
        searches(minutes, known)
    draw()
