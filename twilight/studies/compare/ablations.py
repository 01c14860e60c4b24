"""What a scene may leave out: each simplification against the same solver without it."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from twilight.base.errors import TwilightError
from twilight.base.progress import Progress, part_of, silent
from twilight.config import load
from twilight.config.scene import PLACED_NM, Config
from twilight.scene.medium import wavelengths_of
from twilight.studies.compare.accuracy import ColourErrors, ErrorQuantiles, colour_errors, radiance_errors
from twilight.studies.compare.bench import Bench
from twilight.studies.compare.comparison import ComparisonRow
from twilight.studies.compare.job import Job, SampleDirections, stratified_directions
from twilight.studies.compare.presets import SolverPreset

DIRECTIONS = 240
"""Directions of the texture that are compared, about one in eight of its half."""

ZONES = {"solver.name": "zones"}
HABER = {"solver.name": "cells", "solver.max_orders": 20, "solver.expert.tolerance": 1e-3}
LOW_TOP = {"atmosphere.top_km": 35.0}
FEW_NM = {"wavelengths": {"list_nm": [440.0, 550.0, 680.0]}}
"""For what costs much and hardly depends on how many wavelengths there are."""


@dataclass(frozen=True)
class Ablation:
    """A simplification as settings on top of the scene, and the settings that it is compared with.

    colour_only: the wavelengths differ, so that only colours can be compared.
    """

    name: str
    settings: Mapping[str, Any]
    against: Mapping[str, Any] = field(default_factory=lambda: ZONES)
    colour_only: bool = False


def _zones(name: str, **settings: Any) -> Ablation:
    return Ablation(name, {**ZONES, **{key.replace("__", "."): value for key, value in settings.items()}})


def _haber(name: str, against: Mapping[str, Any], **settings: Any) -> Ablation:
    base = {**HABER, **FEW_NM}
    changed = {f"solver.{key}": value for key, value in settings.items()}
    return Ablation(name, {**base, **changed}, {**base, **against})


ABLATIONS: tuple[Ablation, ...] = (
    _zones("no polarisation", solver__polarisation=False),
    _zones("refraction off", refraction__model="none"),
    _zones("straight lines of sight", solver__bent_lines_of_sight=False),
    _zones("ozone as a vertical filter", gases__ozone__treatment="overhead_filter"),
    _zones("no ozone", gases__ozone__treatment="none"),
    _zones("no NO2 and O4", gases__no2=False, gases__o4=False),
    *(_zones(f"top at {top:g} km", atmosphere__top_km=top) for top in (35.0, 50.0, 60.0, 80.0)),
    _zones("Henyey-Greenstein instead of Mie", aerosol__phase_function="henyey_greenstein"),
    _zones("single scattering alone", solver__max_orders=1),
    *(_zones(f"{n} orders of scattering", solver__max_orders=n, solver__expert__tolerance=0.0) for n in (2, 3, 5, 8)),
    *(
        Ablation(
            f"{n} wavelengths against 40", {**ZONES, "wavelengths.count": n}, {**ZONES, "wavelengths.count": 40}, True
        )
        for n in (4, 8, 16)
    ),
    Ablation(
        "8 placed wavelengths (the default) against 40",
        {**ZONES, "wavelengths": {"list_nm": list(PLACED_NM)}},
        {**ZONES, "wavelengths.count": 40},
        True,
    ),
    *(
        Ablation(
            f"N = {n} layers of equal mass to 35 km",
            {**ZONES, **LOW_TOP, "atmosphere.layers": {"equal_air_mass": n}},
            {**ZONES, **LOW_TOP},
        )
        for n in (10, 20, 30, 50, 70, 100)
    ),
    _zones("N = 100 layers of equal mass to 100 km", atmosphere__layers={"equal_air_mass": 100}),
    Ablation("Haber's cells (cells)", {**HABER, **FEW_NM}, {**ZONES, **FEW_NM}),
    *(
        _haber(f"every {n}th shell active against all (cells)", {"solver.active_shell_step": 1}, active_shell_step=n)
        for n in (2, 4, 8)
    ),
    _haber("similarity in extinction too (cells)", {}, **{"expert.reduce_extinction": True}),
    *(_haber(f"S = {s} against 120 (cells)", {"solver.azimuth_cells": 120}, azimuth_cells=s) for s in (36, 60, 90)),
)


@dataclass(frozen=True)
class AblationRow:
    """What one simplification does at one sun: differences from the run without it, and both run times [s]."""

    name: str
    sun_elevation_deg: float
    difference: ErrorQuantiles | None = None
    colour: ColourErrors | None = None
    simplified: ComparisonRow | None = None
    full: ComparisonRow | None = None
    reason: str = ""


def chosen_ablations(names: str, where: str = "--ablations") -> tuple[Ablation, ...]:
    """The ablations that have one of the comma-separated names in their own, in the order of `ABLATIONS`; `all`: all.

    Errors: TwilightError that lists them for a name that none has.
    """
    wanted = [name.strip().lower() for name in names.split(",")]
    if wanted == ["all"]:
        return ABLATIONS
    for name in wanted:
        if not name or not any(name in a.name.lower() for a in ABLATIONS):
            listed = "; ".join(a.name for a in ABLATIONS)
            raise TwilightError(f"{where}: {name or 'a name'} is in the name of no ablation: all, or {listed}")
    return tuple(a for a in ABLATIONS if any(name in a.name.lower() for name in wanted))


COLUMNS = (
    *("ablation", "sun_elevation_deg"),
    *(f"{name}_percent" for name in ("median", "p95", "max", "mean")),
    *(f"ciede2000_{name}" for name in ("median", "p95", "max")),
    *(f"luminance_{name}_percent" for name in ("median", "p95", "mean")),
    *("time_s", "time_without_s", "cpu_s", "cpu_without_s", "reason"),
)
PRINTED = {
    "ablation": "ablation",
    "sun": "sun_elevation_deg",
    "median %": "median_percent",
    "95 %": "p95_percent",
    "ΔE00": "ciede2000_median",
    "lum. %": "luminance_median_percent",
    "time s": "time_s",
    "full s": "time_without_s",
}
"""Headings of the printed columns, and their names in `COLUMNS`."""


def ablate(
    scene: str | Path,
    chosen: Mapping[str, Any],
    suns: tuple[float, ...],
    bench: Bench,
    *,
    ablations: tuple[Ablation, ...] = ABLATIONS,
    repeats: int = 1,
    progress: Progress | None = None,
) -> Iterator[list[AblationRow]]:
    """For each ablation its rows, one for each sun; `chosen` are settings of the scene, which ablations override.

    A simplification that the scene has no place for (the top of a tabulated medium) gives rows with the reason.
    """
    tell = progress or silent
    for i, ablation in enumerate(ablations):
        report = part_of(tell, i / len(ablations), 1.0 / len(ablations), f"{ablation.name}:")
        report("starting", 0.0)
        try:
            full = _measured(scene, {**chosen, **ablation.against}, suns, bench, repeats, report)
            simplified = _measured(scene, {**chosen, **ablation.settings}, suns, bench, repeats, report)
        except TwilightError as error:
            yield [AblationRow(ablation.name, sun, reason=str(error)) for sun in suns]
            continue
        yield [_row(ablation, sun, simplified, full) for sun in suns]


def _measured(
    scene: str | Path,
    settings: Mapping[str, Any],
    suns: tuple[float, ...],
    bench: Bench,
    repeats: int,
    report: Progress,
) -> tuple[Config, Job, dict[float, Any]]:
    config = load(scene, settings)
    elevation, azimuth = stratified_directions(config.texture.shape, DIRECTIONS)
    directions = SampleDirections(tuple(elevation.tolist()), tuple(azimuth.tolist()))
    job = Job(config, suns, dict.fromkeys(suns, directions), repeats=repeats)
    return config, job, bench.measure(job, report)


def _row(ablation: Ablation, sun: float, simplified: Any, full: Any) -> AblationRow:
    rows, wavelengths = [], []
    for config, job, outcomes in (simplified, full):
        outcome = outcomes[sun]
        if outcome.reason:
            return AblationRow(ablation.name, sun, reason=outcome.reason)
        n = config.texture.shape[0] * config.texture.shape[1]
        rows.append(
            ComparisonRow(SolverPreset(job.solver, job.quality), sun, timing=outcome.timing, texture_directions=n)
        )
        wavelengths.append(wavelengths_of(config))
    value, right = simplified[2][sun].radiance, full[2][sun].radiance
    row = AblationRow(ablation.name, sun, simplified=rows[0], full=rows[1])
    if not ablation.colour_only:
        row = replace(row, difference=radiance_errors(value, right, np.zeros_like(right)))
    if wavelengths[0] is not None and wavelengths[1] is not None:
        config = full[0]
        colour = colour_errors(
            value,
            right,
            None,
            wavelengths[0],
            wavelengths[1],
            solar_spectrum=config.solar_spectrum,
            observer=config.output.colour_observer,
        )
        row = replace(row, colour=colour)
    return row


def lines(rows: list[AblationRow]) -> list[list[str]]:
    """The rows as text in the order of `COLUMNS`."""
    return [_line(row) for row in rows]


def printed(rows: list[AblationRow]) -> list[list[str]]:
    """Lines of the columns `PRINTED`."""
    indices = [COLUMNS.index(name) for name in PRINTED.values()]
    return [[line[i] for i in indices] for line in lines(rows)]


def _line(row: AblationRow) -> list[str]:
    d, c = row.difference, row.colour
    numbers: list[float | None] = [None] * 14
    if d is not None:
        numbers[0:4] = [d.median, d.p95, d.largest, d.mean]
    if c is not None:
        e, y = c.ciede2000, c.luminance
        numbers[4:10] = [e.median, e.p95, e.largest, y.median, y.p95, y.mean]
    if row.simplified is not None and row.full is not None:
        numbers[10:14] = [row.simplified.time_s, row.full.time_s, row.simplified.cpu_s, row.full.cpu_s]
    return [row.name, f"{row.sun_elevation_deg:g}", *("" if v is None else f"{v:.3g}" for v in numbers), row.reason]
