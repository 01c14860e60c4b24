"""The comparison itself: every preset of every solver on one scene, sun by sun.

Radiances computed elsewhere, from a table of one's own, are judged like a solver (`twilight compare --add`).
"""

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from twilight import solvers
from twilight.base.errors import TwilightError
from twilight.base.progress import Progress, part_of, silent
from twilight.base.sections import unknown
from twilight.config.scene import Config, Wavelengths
from twilight.config.solver import choose_solver
from twilight.numerics.spectrum import solar_irradiance
from twilight.scene.medium import wavelengths_of
from twilight.studies.compare.accuracy import ColourErrors, ErrorQuantiles, colour_errors, radiance_errors
from twilight.studies.compare.bench import Bench
from twilight.studies.compare.job import Job, JobOutcome, SampleDirections, Timing
from twilight.studies.compare.reference_solution import ReferenceSolution, ReferenceSolver, read_lines, read_number

ADDED = "added"
"""In place of a quality: radiances that were computed elsewhere, of which no time is known."""


@dataclass(frozen=True)
class SolverPreset:
    """A solver at one of its qualities."""

    solver: str
    quality: str

    @property
    def name(self) -> str:
        return f"{self.solver} {self.quality}"


@dataclass(frozen=True)
class ComparisonRow:
    """What was found for one preset and one sun; what is missing is None, and `reason` says why in one sentence.

    error: relative errors of the radiance [%] over directions and wavelengths; by_wavelength: over directions.
    """

    preset: SolverPreset
    sun_elevation_deg: float
    error: ErrorQuantiles | None = None
    by_wavelength: Mapping[float, ErrorQuantiles] = field(default_factory=dict)
    colour: ColourErrors | None = None
    timing: Timing | None = None
    texture_directions: int = 1
    wavelengths: int = 1
    reason: str = ""

    @property
    def set_up_s(self) -> float:
        """Median over the runs of the time for what serves all suns of the comparison [s]."""
        return float(np.median(self._known.set_up_s))

    @property
    def sky_s(self) -> float:
        """Median time of one sky over the whole texture [s]; in proportion where fewer directions were timed."""
        return float(np.median(self._known.sky_s)) * self._scale

    @property
    def time_s(self) -> float:
        return self.set_up_s + self.sky_s

    @property
    def cpu_s(self) -> float:
        """The same sum in processor time [s], over all threads."""
        return float(np.median(self._known.set_up_cpu_s)) + self.sky_cpu_s

    @property
    def sky_cpu_s(self) -> float:
        """`sky_s` in processor time [s]."""
        return float(np.median(self._known.sky_cpu_s)) * self._scale

    @property
    def _known(self) -> Timing:
        if self.timing is None:
            raise ValueError("the row has no timing")
        return self.timing

    @property
    def _scale(self) -> float:
        return self.texture_directions / self._known.directions

    @property
    def radiances_per_s(self) -> float:
        """Directions times wavelengths of one sky, over the time of set-up and sky."""
        return self.texture_directions * self.wavelengths / self.time_s


def solver_presets(names: Sequence[str] | None, where: str = "--solvers") -> list[SolverPreset]:
    """The presets that names such as `cells` or `cells:draft` stand for; None: all of all installed solvers.

    Errors: TwilightError for a solver or quality that does not exist.
    """
    presets: list[SolverPreset] = []
    for name in names or solvers.installed():
        solver, colon, quality = (part.strip() for part in name.partition(":"))
        if solver not in solvers.SOLVERS:
            raise TwilightError(f"{where}: {solver} {unknown(solver, solvers.SOLVERS, 'solver')}")
        qualities = list(solvers.load(solver).QUALITIES)
        if colon and quality not in qualities:
            raise TwilightError(f"{where}: {quality} {unknown(quality, qualities, f'quality of {solver}')}")
        presets += [SolverPreset(solver, q) for q in ([quality] if colon else qualities)]
    return list(dict.fromkeys(presets))


def with_preset(config: Config, preset: SolverPreset) -> Config:
    """The configuration with the solver of a preset; options of its `solver` section stay if that is the solver which
    the section names."""
    own = config.solver.get("name", solvers.DEFAULT) == preset.solver
    section = {**(config.solver if own else {}), "name": preset.solver, "quality": preset.quality}
    choose_solver(section)
    return config.model_copy(update={"solver": section})


def compare(
    config: Config,
    presets: Sequence[SolverPreset],
    references: Mapping[float, ReferenceSolution],
    bench: Bench,
    *,
    repeats: int = 3,
    progress: Progress | None = None,
) -> Iterator[list[ComparisonRow]]:
    """For each preset its rows, one for each sun of the references, as soon as they are known."""
    tell = progress or silent
    own_nm = wavelengths_of(config)
    rows, columns = config.texture.shape
    for i, preset in enumerate(presets):
        report = part_of(tell, i / len(presets), 1.0 / len(presets), f"{preset.name}:")
        report("starting", 0.0)
        directions = {sun: _directions(r, own_nm) for sun, r in references.items()}
        job = Job(with_preset(config, preset), tuple(references), directions, repeats=repeats)
        outcomes = bench.measure(job, report)
        yield [
            replace(
                judged(preset, sun, outcomes[sun], reference, config),
                texture_directions=rows * columns,
                wavelengths=reference.wavelength_nm.size if own_nm is None else own_nm.size,
            )
            for sun, reference in references.items()
        ]


def _directions(reference: ReferenceSolution, own_nm: np.ndarray | None) -> SampleDirections:
    """Those of the reference; its wavelengths are named only where they are not the scene's own."""
    directions = reference.directions
    same = own_nm is not None and np.array_equal(own_nm, reference.wavelength_nm)
    return replace(directions, wavelength_nm=None) if same else directions


def judged(
    preset: SolverPreset, sun: float, outcome: JobOutcome, reference: ReferenceSolution, config: Config
) -> ComparisonRow:
    """The row of one preset and sun: its radiances against the reference."""
    row = ComparisonRow(preset, sun, timing=outcome.timing, reason=outcome.reason)
    value = outcome.radiance
    if value is None:
        return row
    right, noise, nm = reference.radiance, reference.standard_error, reference.wavelength_nm
    error = radiance_errors(value, right, noise)
    if error is None:
        return replace(row, reason="the sky of the reference solution is black")
    by_wavelength = {float(w): radiance_errors(value[:, i], right[:, i], noise[:, i]) for i, w in enumerate(nm)}
    colour = colour_errors(
        value, right, noise, nm, solar_spectrum=config.solar_spectrum, observer=config.output.colour_observer
    )
    return replace(row, error=error, by_wavelength={w: s for w, s in by_wavelength.items() if s}, colour=colour)


PLACE_COLUMNS = {
    "sun_elevation_deg": (-90.0, 90.0),
    "elevation_deg": (-90.0, 90.0),
    "azimuth_deg": (-360.0, 360.0),
    "wavelength_nm": (1.0, 1e5),
}
"""Columns that say where a radiance is, and what they may hold."""
SUN_NORMALISED = "radiance_per_sr"
ABSOLUTE = "radiance_w_per_m2_sr_nm"
"""Columns of the radiance: over the sun's irradiance above the air [sr^-1], or in W m^-2 sr^-1 nm^-1."""
DIGITS = 4
"""Decimals to which directions [deg] and wavelengths [nm] are the same."""
Place = tuple[float, float, float, float]
"""Sun, elevation, azimuth in [0, 360) [deg], wavelength [nm]."""


@dataclass(frozen=True)
class AddedTable:
    """Radiances by place, in the unit of the column that held them."""

    name: str
    path: Path
    column: str
    values: Mapping[Place, float]

    def suns(self) -> list[float]:
        """Elevations of its suns [deg], in the order of the table."""
        return list(dict.fromkeys(place[0] for place in self.values))

    def wavelength_nm(self) -> list[float]:
        """Its wavelengths [nm], increasing."""
        return sorted({place[3] for place in self.values})

    def directions(self, sun: float) -> tuple[np.ndarray, np.ndarray]:
        """Elevations and azimuths [deg] of a sun's directions, in the order of the table."""
        places = dict.fromkeys(place[1:3] for place in self.values if place[0] == sun)
        elevation, azimuth = np.array(list(places)).T
        return elevation, azimuth

    def radiance(self, sun: float, reference: ReferenceSolution, config: Config) -> np.ndarray:
        """Sun-normalised radiance [sr^-1] (D, W) where a reference solution has its own.

        A direction is found on the other side of the sun's azimuth too, where the sky is the same.
        Errors: TwilightError for a value that the table lacks.
        """
        directions = list(zip(reference.elevation_deg, reference.azimuth_deg, strict=True))
        radiance = np.array([[self.value(sun, e, a, nm) for nm in reference.wavelength_nm] for e, a in directions])
        if self.column == SUN_NORMALISED:
            return radiance
        distance_au = getattr(config.sun, "distance_au", None) or 1.0
        return radiance / solar_irradiance(reference.wavelength_nm, config.solar_spectrum, distance_au)

    def value(self, sun: float, elevation: float, azimuth: float, nm: float) -> float:
        """The number of one place, or of that across the sun's vertical; TwilightError where there is none."""
        for side in (azimuth, -azimuth):
            value = self.values.get(_place((sun, elevation, side, nm)))
            if value is not None:
                return value
        raise TwilightError(
            f"{self.path}: has no radiance for sun {sun:g}, elevation {elevation:g}, azimuth {azimuth:g} deg and "
            f"{nm:g} nm, where it is to be judged"
        )


def read_added(text: str) -> AddedTable:
    """The table that `--add` names: `FILE.csv`, or `NAME=FILE.csv`; without a name, that of the file.

    CSV with the columns of `PLACE_COLUMNS` and one of `SUN_NORMALISED` and `ABSOLUTE`, others are left alone; lines
    that begin with # are comments.
    Errors: TwilightError that names the file, the line and the column.
    """
    name, equals, file = text.partition("=")
    path = Path(file if equals else text)
    line_of_header, header, rows = read_lines(path)
    column = _column(path, line_of_header, header)
    values: dict[Place, float] = {}
    first: dict[Place, int] = {}
    for line, row in rows:
        place = _place([read_number(path, line, row, key, *limits) for key, limits in PLACE_COLUMNS.items()])
        if place in values:
            again = f"has the sun, direction and wavelength of line {first[place]} again"
            raise TwilightError(f"{path}: line {line}: {again}")
        values[place], first[place] = read_number(path, line, row, column, 0.0, math.inf), line
    if not values:
        raise TwilightError(f"{path}: holds no radiances")
    return AddedTable((name if equals else path.stem).strip() or path.stem, path, column, values)


def _column(path: Path, line: int, header: Sequence[str]) -> str:
    """Which of the two columns of a radiance there is."""
    for key in PLACE_COLUMNS:
        if key not in header:
            raise TwilightError(
                f"{path}: line {line}: lacks the column {key}; needed are {', '.join(PLACE_COLUMNS)} and "
                f"{SUN_NORMALISED} or {ABSOLUTE}"
            )
    columns = [key for key in (SUN_NORMALISED, ABSOLUTE) if key in header]
    if len(columns) != 1:
        got = "both" if columns else "neither"
        raise TwilightError(
            f"{path}: line {line}: needs one column of radiances, {SUN_NORMALISED} (over the sun's irradiance) or "
            f"{ABSOLUTE}, and has {got}"
        )
    return columns[0]


def _place(values: Iterable[float]) -> Place:
    sun, elevation, azimuth, nm = (round(float(value), DIGITS) for value in values)
    return sun, elevation, round(azimuth % 360.0, DIGITS) % 360.0, nm


def scene_of(config: Config, added: AddedTable) -> Config:
    """The scene at the wavelengths of a table.

    Errors: TwilightError for a table with gaps: it needs every sun's directions at every wavelength.
    """
    own, asked = wavelengths_of(config), added.wavelength_nm()
    for sun in added.suns():
        for elevation, azimuth in zip(*added.directions(sun), strict=True):
            for nm in asked:
                added.value(sun, elevation, azimuth, nm)
    if own is not None and np.array_equal(np.round(own, DIGITS), asked):
        return config
    return config.model_copy(update={"wavelengths": Wavelengths.model_validate({"list_nm": asked})})


def references_of(
    added: AddedTable, solver: ReferenceSolver, suns: Sequence[float], progress: Progress
) -> dict[float, ReferenceSolution]:
    """Reference solutions in the directions of a table, under some of its suns."""
    references: dict[float, ReferenceSolution] = {}
    for i, sun in enumerate(suns):
        if sun not in added.suns():
            there = ", ".join(f"{s:g}" for s in added.suns())
            raise TwilightError(f"{added.path}: has no sun at {sun:g} deg; it has {there}")
        tell = part_of(progress, i / len(suns), 1.0 / len(suns))
        references |= solver.references([sun], added.directions(sun), tell)
    return references


def rows_of(added: AddedTable, references: Mapping[float, ReferenceSolution], config: Config) -> list[ComparisonRow]:
    """The errors of a table's radiances, a row for each sun, without times.

    Errors: TwilightError for a value that the table lacks.
    """
    preset = SolverPreset(added.name, ADDED)
    rows = []
    for sun, reference in references.items():
        outcome = JobOutcome(radiance=added.radiance(sun, reference, config))
        row = judged(preset, sun, outcome, reference, config)
        rows.append(replace(row, wavelengths=reference.wavelength_nm.size))
    return rows
