"""How a scene is solved: its wavelengths in blocks, and what memory and time that takes.

A `Problem` is a scene and how it is to be solved.  Its wavelengths are divided into blocks of as many as the solver
takes at once, so that 1000 need no more memory than one block.
"""

from collections.abc import Hashable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from twilight import solvers
from twilight.atmosphere.bands import GasBands
from twilight.atmosphere.medium import Medium
from twilight.base.errors import TwilightError
from twilight.base.reading import memory_bytes
from twilight.config.scene import Config
from twilight.engine.carried import HIGHEST_OBSERVER_KM, LANES, LOWEST_SUN_DEG, MODEL, Carrier, carriers
from twilight.scene.medium import wavelengths_of
from twilight.scene.scene import Scene
from twilight.scene.suns import count_suns
from twilight.sky.colour import TONE_MAPPINGS
from twilight.solvers.base import Cost

FIELD_BYTES = 1.0e9
"""Most memory of a block of wavelengths: what is more is divided into blocks, which do not change what is computed."""
FEW_WAVELENGTHS = 8
"""Up to so many are one block, whatever memory that takes: to know it would cost 4 % of a `draft` field's time."""
CARRIED_AT_ONCE = 160
"""Most wavelengths of a block, or terms of their sums, whose light the fitted model carries: 5 MB each."""
VALUES_AT_ONCE = 400_000
"""Directions times wavelengths of a texture or a view that a solver is asked for at once, by rows: the memory that each
of them takes is free before the next rows."""
ARRAYS_AT_ONCE = 4
"""Copies of a sky's radiance that a render holds at the same time: blocks, the whole, physical units, the file's."""
NIGHT_ARRAYS = 7
"""Copies more where other lights are added: each of five, their sum, and the sum with the sun's sky."""
BYTES_BY_ROWS = 24
"""Memory of a pixel of a view that is made by rows [bytes]: four channels of the EXR, or the 8 bit picture twice."""
BYTES_WHOLE = 200
"""Memory of a pixel beyond BYTES_BY_ROWS where the whole view is held [bytes]: its rays, the tone's channels."""
PROGRAM_BYTES = 2.5e8
"""Memory of the program with its libraries and machine code [bytes] (benchmarks/memory.py)."""
BYTES_PER_DIRECTION = 1050
"""Memory of a direction and wavelength while a field is evaluated there [bytes] (benchmarks/memory.py)."""
POLARISED_FACTOR = 1.35
"""By how much more memory the evaluation of a polarised field takes (benchmarks/memory.py)."""
FIELD_FRACTION_HELD = 0.5
"""Fraction of a field's memory while it is solved that is still held when it is evaluated."""
START_S = 1.8
"""Processor seconds of the program's start: its libraries, the compiled kernels (`benchmarks/results/memory.csv`)."""
PIXEL_S = 3e-6
"""Processor seconds of a pixel of a view of eight wavelengths (`twilight.engine.view`)."""
TERRAIN_S = 4.0
"""Processor seconds of a view with terrain whatever its size: aerial perspective at its nodes, the shadows' grid."""
TERRAIN_PIXEL_S = 5.8e-6
"""Processor seconds of a pixel and wavelength of a view with terrain (`ridges 1920x1080 draft` of the table)."""
SUN_S = 0.3
"""Processor seconds of a sun's sky besides its directions: its beam, its colours."""
FILES_S = 1.0
"""Processor seconds of a sun's files: pictures 0.7, environment maps and HDF5 0.3."""
USUAL_GRID = (90, 140)
"""Rows and columns of a sky where no texture is asked for, about (`twilight.sky.plain_grid`)."""
USUAL_NODES = 1150
"""Directions of the table that it is read from, about (`twilight.engine.table.fill`)."""
VIEW_NODES = 4000
"""The same of the table of a view (`twilight.engine.view`)."""


@dataclass(frozen=True)
class Problem:
    """How a scene is solved.

    sun_elevations_deg: all the suns that will be asked for [deg], which some solvers take to save time; None: any
    cached: whether solved fields are taken from the user's cache and left there; else every field is solved here
    numpy_only_sun: the sun's own light on the ground is found by quadrature, where tables do not pay for one sun"""

    scene: Scene
    sun_elevations_deg: tuple[float, ...] | None = None
    cached: bool = False
    numpy_only_sun: bool = False

    def __post_init__(self) -> None:
        scene, able = self.scene, self.scene.capabilities
        if len(self.slices) > 1 and self._in_one_file:
            raise TwilightError(
                f"solver.field_file: holds the field of up to {able.wavelengths_at_once} wavelengths, and "
                f"{scene.title or 'the medium'} has {scene.medium.n_wavelengths}"
            )

    @property
    def _in_one_file(self) -> bool:
        """Whether a file is to hold the field of all wavelengths, or holds it."""
        return bool(getattr(self.scene.settings, "field_file", None))

    @cached_property
    def cost(self) -> Cost | None:
        """Memory and processor time of the fields, where the solver knows them."""
        scene, able = self.scene, self.scene.capabilities
        if able.cost is None:
            return None
        return able.cost(scene.medium, scene.settings, self.sun_elevations_deg, scene.altitude_km)

    @cached_property
    def wavelengths_at_once(self) -> int:
        """Most wavelengths of a block: as many as the solver takes and as FIELD_BYTES hold, in bands too."""
        most = self.scene.capabilities.wavelengths_at_once
        if self.scene.medium.n_wavelengths <= FEW_WAVELENGTHS or self.cost is None:
            return most
        return self.cost.max_wavelengths(most, FIELD_BYTES, self.scene.bands is not None)

    @cached_property
    def term_counts(self) -> np.ndarray:
        """Terms of each wavelength, (W,); 1 without bands."""
        scene = self.scene
        return np.ones(scene.medium.n_wavelengths, int) if scene.bands is None else scene.bands.term_counts

    @cached_property
    def _groups(self) -> list[Hashable]:
        """A key for each wavelength: those of different keys are in different blocks."""
        scene, able = self.scene, self.scene.capabilities
        count = scene.medium.n_wavelengths
        keys: list[Hashable] = [0] * count
        if count > 1 and not self._in_one_file and able.kind != "fitted":
            if able.spectral_groups is not None:
                keys = list(able.spectral_groups(scene.medium, scene.settings))
            keys = [key if self.term_counts[w] == 1 else 1 for w, key in enumerate(keys)]
        return keys

    @cached_property
    def carriers(self) -> list[Carrier | None]:
        """What carries the light of each wavelength from a few nodes; None where it is solved."""
        scene, able = self.scene, self.scene.capabilities
        none: list[Carrier | None] = [None] * scene.medium.n_wavelengths
        if able.carried is None or not able.carried(scene.settings):
            return none
        config, lowest = scene.config, min(self.sun_elevations_deg or (0.0,))
        view = None if config is None else config.observer.view
        looks_down = view is not None and (config.terrain is not None or view.extent_deg[0][0] < 0.0)  # type: ignore[union-attr]
        high = scene.altitude_km > scene.medium.bottom_km + HIGHEST_OBSERVER_KM
        known = not (looks_down or high or lowest < LOWEST_SUN_DEG)
        found = carriers(scene.medium, scene.bands, scene.altitude_km) if known else none
        if scene.settings.spectrum == "carried" and not any(found) and self.term_counts.sum() > LANES:
            raise TwilightError(
                "solver.expert.spectrum: the fitted model of clear air does not have this air, observer or sun, and "
                "cannot carry the light of its wavelengths; allowed here is solved"
            )
        return found

    @cached_property
    def slices(self) -> list[slice]:
        """The blocks of wavelengths, as ranges of indices into those of the medium.

        A block holds `wavelengths_at_once` terms of exponential sums at most (CARRIED_AT_ONCE where their light is
        carried), at least one wavelength.  Wavelengths of different spectral groups are in different blocks, and so are
        those in a band and others, whose grids would follow the band's terms, unless they are carried from the same
        nodes, a file is to hold them all, or a fitted model has no grids.
        """
        term_counts = self.term_counts
        keys = [key if one is None else id(one) for key, one in zip(self._groups, self.carriers, strict=True)]
        most = [self.wavelengths_at_once if one is None else CARRIED_AT_ONCE for one in self.carriers]
        starts, held = [0], int(term_counts[0])
        for w in range(1, len(keys)):
            held += int(term_counts[w])
            if held > most[w] or keys[w] != keys[w - 1]:
                starts.append(w)
                held = int(term_counts[w])
        ends = [*starts[1:], self.scene.medium.n_wavelengths]
        return [slice(start, stop) for start, stop in zip(starts, ends, strict=True)]

    def part(self, index: int) -> tuple[Medium, GasBands | None]:
        """The medium and the exponential sums of one block; None: it has no terms."""
        scene, part = self.scene, self.slices[index]
        medium = scene.medium if part == slice(0, scene.medium.n_wavelengths) else scene.medium.select(part)
        bands = None if scene.bands is None else scene.bands.select(part)
        return medium, bands if bands is not None and bands.absorption_per_km.any() else None


def plan(
    scene: Scene,
    sun_elevations_deg: Sequence[float] | None = None,
    *,
    cached: bool = False,
    numpy_only_sun: bool = False,
) -> Problem:
    """How a scene is going to be solved: its blocks of wavelengths and their cost; arguments as of `solve`."""
    known = None if sun_elevations_deg is None else tuple(float(sun) for sun in sun_elevations_deg)
    return Problem(scene, known, cached, numpy_only_sun)


@dataclass(frozen=True)
class SceneCost:
    """What a scene costs.

    blocks: in which its wavelengths are solved, one after the other, of at most `max_wavelengths`
    solved: of these wavelengths, or terms of exponential sums, those that are solved and from which the light of the
        rest is carried; 0: all are solved
    sky_bytes: of the arrays of one sky and its pictures at the same time; view_bytes: of the picture of a view.
    field_bytes: of the field of one block, while it is solved; total_bytes: the most that all need together, with the
        program; cpu_s: processor time on a quiet core of some 3 GHz, machine code being there.  None for solvers that
        do not say.
    """

    suns: int
    wavelengths: int
    max_wavelengths: int
    blocks: int
    sky_bytes: int
    view_bytes: int
    field_bytes: float | None = None
    total_bytes: float | None = None
    cpu_s: float | None = None
    solved: int = 0


def full_cost(scene: Scene) -> SceneCost:
    """What a scene costs, its field too; a second's work at many wavelengths."""
    config = scene.configuration
    sizes = cost(config)
    suns = scene.sun_elevations_deg
    problem = Problem(scene, None if config.terrain is not None else suns)
    largest = max(part.stop - part.start for part in problem.slices)
    blocks = len(problem.slices)
    sizes = replace(sizes, wavelengths=scene.medium.n_wavelengths, max_wavelengths=largest, blocks=blocks)
    per_block = problem.cost
    if per_block is None:
        return sizes
    of_blocks = [int(problem.term_counts[part].sum()) for part in problem.slices]
    in_band = [bool((problem.term_counts[part] > 1).any()) for part in problem.slices]
    model, carried = cost_of_model(problem), [problem.carriers[part.start] for part in problem.slices]
    each = 0.0 if model is None else model.bytes_per_wavelength
    field = max(
        per_block.n_bytes(n, band) if one is None else per_block.n_bytes(one.n_nodes, True) + each * n
        for n, band, one in zip(of_blocks, in_band, carried, strict=True)
    )
    directions = _directions(config)
    pixels = 0
    if config.observer.view is not None:
        directions += VIEW_NODES
        pixels = int(np.prod(config.observer.view.shape))
    polarised = getattr(scene.settings, "polarisation", False)
    values = min(VALUES_AT_ONCE, directions * max(of_blocks))
    evaluation = BYTES_PER_DIRECTION * (POLARISED_FACTOR if polarised else 1.0) * values
    seconds = START_S + len(suns) * (SUN_S + FILES_S + PIXEL_S * pixels)
    if config.terrain is not None:
        seconds += len(suns) * (TERRAIN_S + TERRAIN_PIXEL_S * pixels * scene.medium.n_wavelengths)
    seconds += field_cpu_s(problem, len(suns), directions)
    # one copy of a sky grows while its blocks are solved and evaluated; all are there while the last field still is
    copy, held = sizes.sky_bytes / ARRAYS_AT_ONCE, FIELD_FRACTION_HELD * field
    most = max(field + copy, held + evaluation + copy, held + sizes.sky_bytes)
    return replace(
        sizes,
        field_bytes=field,
        total_bytes=PROGRAM_BYTES + most + sizes.view_bytes,
        cpu_s=seconds,
        solved=n_nodes(problem),
    )


def cost_of_model(problem: Problem) -> Cost | None:
    """What the fitted model costs that carries light over the spectrum."""
    of_model = solvers.load(MODEL).CAPABILITIES.cost
    return None if of_model is None else of_model(problem.scene.medium, None, None, 0.0)


def field_cpu_s(problem: Problem, suns: int, directions: int) -> float:
    """Processor time [s] of solving a field and of evaluating it under so many suns, in `directions` of each.

    Errors: TwilightError for a solver that does not say.
    """
    cost = problem.cost
    if cost is None:
        raise TwilightError(f"solver: {problem.scene.solver_name} does not say what its field costs")
    seconds = 0.0
    model = cost_of_model(problem)
    for part in problem.slices:
        n, band = int(problem.term_counts[part].sum()), bool((problem.term_counts[part] > 1).any())
        times = cost.band_cpu_factor if band else 1.0
        if problem.carriers[part.start] is not None and model is not None:
            seconds += (model.cpu_s_per_wavelength + model.cpu_s_per_direction * directions * suns) * n
            continue
        seconds += times * cost.cpu_s_per_wavelength * -(-n // cost.block_size) * cost.block_size
        seconds += times * (cost.cpu_s_per_direction * directions + cost.cpu_s_per_sun) * suns * n
    at_nodes = cost.cpu_s_per_wavelength + (cost.cpu_s_per_direction * directions + cost.cpu_s_per_sun) * suns
    return seconds + cost.band_cpu_factor * at_nodes * n_nodes(problem)


def _directions(config: Config) -> int:
    """Directions in which a sky is evaluated: of light without noise on plain samples one half."""
    noisy = solvers.load(config.chosen_solver[0]).CAPABILITIES.standard_error
    if not (config.texture.plain or noisy):
        return USUAL_NODES
    rows, columns = config.texture.shape
    return rows * (columns if noisy else columns // 2 + 1)


def n_nodes(problem: Problem) -> int:
    """Wavelengths, or terms, that are solved and from which light of others is carried."""
    return sum(one.n_nodes for one in {id(one): one for one in problem.carriers if one is not None}.values())


def cost(config: Config) -> SceneCost:
    """What a configuration's skies cost, without their field; a table's wavelengths, which are in its file, count as
    one."""
    rows, columns = config.texture.shape if config.texture.plain else USUAL_GRID
    width, spectral_width = config.output.width, config.output.spectral_width
    wavelength_nm = wavelengths_of(config)
    n_wavelengths = 1 if wavelength_nm is None else len(wavelength_nm)
    name, _, settings = config.chosen_solver
    able = solvers.load(name).CAPABILITIES
    values = rows * columns * n_wavelengths * (2 if able.standard_error else 1)
    if getattr(settings, "polarisation", False):
        values *= 3
    arrays = ARRAYS_AT_ONCE + (NIGHT_ARRAYS if config.night is not None or config.moon is not None else 0)
    max_wavelengths = min(able.wavelengths_at_once, n_wavelengths)
    return SceneCost(
        count_suns(config),
        n_wavelengths,
        max_wavelengths,
        -(-n_wavelengths // max_wavelengths),
        8 * (arrays * values + spectral_width * spectral_width // 2 * n_wavelengths + width * width * 2),
        _view_bytes(config, n_wavelengths),
    )


def check_size(config: Config) -> None:
    """TwilightError for a configuration whose sky and pictures alone would not fit into this machine's memory.

    The error says how much memory they need, and what makes them smaller.
    """
    sizes, memory = cost(config), memory_bytes()
    available = f"and this machine has {memory / 1e9:.3g} GB: take"
    if sizes.view_bytes > memory:
        assert config.observer.view is not None
        height, width = config.observer.view.shape
        whole = sizes.view_bytes > BYTES_BY_ROWS * height * width
        why = ", for terrain and the tones eye and camera need all of it at once" if whole else ""
        raise TwilightError(
            f"{config.title}: a picture of {width} x {height} pixels takes {sizes.view_bytes / 1e9:.3g} GB{why}, "
            f"{available} a smaller observer.view.width (--size)"
        )
    if sizes.sky_bytes > memory:
        rows, columns = config.texture.shape
        raise TwilightError(
            f"{config.title}: texture ({rows} x {columns} directions), {sizes.wavelengths} wavelengths and the "
            f"pictures need {sizes.sky_bytes / 1e9:.3g} GB, {available} a larger "
            f"texture.resolution_deg, fewer wavelengths or a smaller output.spectral_width"
        )


def _view_bytes(config: Config, n_wavelengths: int) -> int:
    view = config.observer.view
    if view is None:
        return 0
    height, width = view.shape
    each = BYTES_BY_ROWS
    if config.output.tone_mapping not in TONE_MAPPINGS:
        each += BYTES_WHOLE + 4 * n_wavelengths
    if config.terrain is not None:
        each += BYTES_WHOLE + 12 * n_wavelengths
    return each * height * width
