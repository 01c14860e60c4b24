"""The comparison itself: every preset of every solver on one scene, sun by sun."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from twilight.base.progress import Progress, part_of, silent
from twilight.config.scene import Config
from twilight.scene.medium import wavelengths_of
from twilight.studies.compare.accuracy import ColourErrors, ErrorQuantiles, colour_errors, radiance_errors
from twilight.studies.compare.bench import Bench
from twilight.studies.compare.job import Job, JobOutcome, SampleDirections, Timing
from twilight.studies.compare.presets import SolverPreset, with_preset
from twilight.studies.compare.reference_solution import ReferenceSolution


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
