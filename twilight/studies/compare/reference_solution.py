"""The reference solution: radiances with standard errors, from a stored table or from the Monte-Carlo solver."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from twilight import solvers
from twilight.atmosphere.csv_columns import cells_of
from twilight.base.errors import TwilightError
from twilight.base.progress import PhasedProgress, Progress
from twilight.base.whole_files import write_csv
from twilight.config.scene import Config
from twilight.config.sun import SunElevation
from twilight.engine.field import Field, solve
from twilight.io.provenance import configuration_hash
from twilight.scene import resolve
from twilight.scene.scene import resolved_configuration
from twilight.studies.compare.job import SampleDirections, code_of

NAME = "montecarlo"
SEED = 977
"""Not that of any quality, so that the Monte-Carlo solver under comparison does not meet its own noise."""

LIMITS = {
    "sun_elevation_deg": (-90.0, 90.0),
    "elevation_deg": (-90.0, 90.0),
    "azimuth_deg": (-math.inf, math.inf),
    "wavelength_nm": (0.0, math.inf),
    "radiance_per_sr": (0.0, math.inf),
    "standard_error_per_sr": (0.0, math.inf),
}
"""Columns of a stored table, and the finite numbers that they may hold."""
COLUMNS = tuple(LIMITS)


@dataclass(frozen=True)
class ReferenceSolution:
    """Sun-normalised radiance and its standard error [sr^-1], (D, W), in directions [deg] (D,), for one sun."""

    elevation_deg: np.ndarray
    azimuth_deg: np.ndarray
    wavelength_nm: np.ndarray
    radiance: np.ndarray
    standard_error: np.ndarray

    @property
    def directions(self) -> SampleDirections:
        return SampleDirections(
            tuple(self.elevation_deg.tolist()), tuple(self.azimuth_deg.tolist()), tuple(self.wavelength_nm.tolist())
        )


def read_lines(path: Path) -> tuple[int, list[str], list[tuple[int, dict[str, str]]]]:
    """(line of the header, its columns, (line, cells by column) of each row) of a table (CSV) of radiances.

    Empty lines and those that begin with # are left out.
    Errors: TwilightError that names the file, and the line of a row with other cells than the header.
    """
    numbered = cells_of(path)
    if not numbered:
        raise TwilightError(f"{path}: holds no radiances")
    (line_of_header, header), *rows = numbered
    return line_of_header, header, [(line, dict(zip(header, cells, strict=True))) for line, cells in rows]


def read_number(path: Path, line: int, row: Mapping[str, str], column: str, low: float, high: float) -> float:
    """The number in a column of a row; TwilightError for what is none, not finite or not from `low` to `high`."""
    try:
        value = float(row[column])
    except ValueError:
        value = math.nan
    if not (math.isfinite(value) and low <= value <= high):
        allowed = f"from {low:g} to {high:g}" if math.isfinite(high) else f"{low:g} or more"
        raise TwilightError(f"{path}: line {line}: {column} is {row[column].strip()!r}; it must be a number, {allowed}")
    return value


def read_references(path: str | Path) -> dict[float, ReferenceSolution]:
    """The suns of a stored table (CSV with at least `COLUMNS`, one row for each sun, direction and wavelength).

    Errors: TwilightError that names the file and the line or column for anything else.
    """
    path = Path(path)
    _, header, rows = read_lines(path)
    missing = [column for column in COLUMNS if column not in header]
    if missing:
        raise TwilightError(f"{path}: lacks the column {missing[0]}; it needs {', '.join(COLUMNS)}")
    if not rows:
        raise TwilightError(f"{path}: holds no radiances")
    table = np.array(
        [[read_number(path, line, row, column, *limits) for column, limits in LIMITS.items()] for line, row in rows]
    )
    return {float(sun): _one_sun(path, sun, table[table[:, 0] == sun]) for sun in dict.fromkeys(table[:, 0].tolist())}


def _one_sun(path: Path, sun: float, table: np.ndarray) -> ReferenceSolution:
    wavelength = np.unique(table[:, 3])
    directions, index = np.unique(table[:, 1:3], axis=0, return_inverse=True)
    radiance = np.full((len(directions), wavelength.size), np.nan)
    error = radiance.copy()
    place = (index.ravel(), np.searchsorted(wavelength, table[:, 3]))
    radiance[place], error[place] = table[:, 4], table[:, 5]
    if table.shape[0] != radiance.size or np.isnan(radiance).any():
        raise TwilightError(f"{path}: sun {sun:g}: needs one row for each direction and each of the wavelengths")
    return ReferenceSolution(directions[:, 0], directions[:, 1], wavelength, radiance, error)


def select_suns(
    stored: Mapping[float, ReferenceSolution], suns: list[float] | None, where: str
) -> dict[float, ReferenceSolution]:
    """The references of some suns, None: of all; TwilightError names the suns that there are."""
    missing = [sun for sun in suns or () if sun not in stored]
    if missing:
        there = ", ".join(f"{sun:g}" for sun in stored)
        raise TwilightError(f"{where}: has no sun at {missing[0]:g} deg; it has {there}")
    return {sun: stored[sun] for sun in (stored if suns is None else suns)}


def write_references(path: Path, references: Mapping[float, ReferenceSolution]) -> None:
    """The table that :func:`read_references` reads."""
    rows = []
    for sun, r in references.items():
        for d in range(r.elevation_deg.size):
            for w, nm in enumerate(r.wavelength_nm):
                where = (float(v) for v in (sun, r.elevation_deg[d], r.azimuth_deg[d], nm))
                rows.append([*where, f"{r.radiance[d, w]:.6g}", f"{r.standard_error[d, w]:.3g}"])
    write_csv(path, COLUMNS, rows)


@dataclass(frozen=True)
class ReferenceSolver:
    """Computes references of a scene with the Monte-Carlo solver; each sun is cached in `folder` when it is done.

    target_stderr: relative standard error of every direction and wavelength; time_limit_s: of one sun.
    """

    config: Config
    folder: Path
    target_stderr: float
    time_limit_s: float | None = None

    def references(
        self, suns: list[float], directions: tuple[np.ndarray, np.ndarray], progress: Progress
    ) -> dict[float, ReferenceSolution]:
        """References of the suns in the directions (elevation, azimuth) [deg]."""
        solver = solvers.load(NAME)
        settings = replace(
            solver.QUALITIES["reference"], target_stderr=self.target_stderr, seed=SEED, time_limit_s=self.time_limit_s
        )
        self.folder.mkdir(parents=True, exist_ok=True)
        solutions: dict[float, ReferenceSolution] = {}
        solved: Field | None = None
        meter = PhasedProgress(progress)
        for i, sun in enumerate(suns):
            file = self.folder / f"reference{sun:+g}-{self._key(sun, directions, repr(settings))}.csv"
            meter.phase(f"reference solution, sun {sun:g} deg:", i / len(suns), 1.0 / len(suns))
            if not file.exists():
                if solved is None:
                    scene = resolve(self.config, solver=(solver, settings))
                    solved = solve(scene, progress=meter, cached=False)
                write_references(file, {sun: computed(solved, sun, directions)})
            solutions[sun] = read_references(file)[sun]
        return solutions

    def _key(self, sun: float, directions: tuple[np.ndarray, np.ndarray], settings: str) -> str:
        hashed = resolved_configuration(self.config, SunElevation(elevation_deg=sun))
        hashed = {part: hashed.get(part) for part in ("climate", "observer", "wavelengths", "omit_negligible")}
        hashed["directions"] = [d.tolist() for d in directions]
        hashed["settings"] = settings
        hashed["code"] = code_of(NAME)
        return configuration_hash(hashed)[:24]


def computed(solved: Field, sun: float, directions: tuple[np.ndarray, np.ndarray]) -> ReferenceSolution:
    """The reference of one sun, in those directions whose light is known at all wavelengths."""
    estimate, standard_error = solved.radiance_with_error(sun, *directions)
    assert standard_error is not None
    known = np.isfinite(estimate).all(axis=-1)
    if not known.any():
        raise TwilightError(f"the reference solution knows no radiance of the sun at {sun:g} deg; raise --time-limit")
    elevation, azimuth, radiance, error = (values[known] for values in (*directions, estimate, standard_error))
    return ReferenceSolution(elevation, azimuth, solved.medium.wavelength_nm, radiance, error)
