"""Whether a sky fits into this machine."""

from __future__ import annotations

import os
from dataclasses import dataclass, replace

import numpy as np

from twilight import solvers
from twilight.colour import TONE_MAPPINGS
from twilight.config.scene import Config
from twilight.config.solver import resolve_solver
from twilight.engine.solve import VALUES_AT_ONCE, problem_of
from twilight.engine.view import most_nodes
from twilight.errors import TwilightError
from twilight.scene.medium import wavelengths_of
from twilight.scene.suns import count_suns, suns_of

ARRAYS_AT_ONCE = 4
"""Copies of a sky's radiance that a render holds at the same time: blocks, the whole, physical units, the file's."""

NIGHT_ARRAYS = 3
"""Copies more where the night sky is added: of its parts, the whole, and the sum with the sun's sky."""


BYTES_BY_ROWS = 24
"""Of a pixel of a view that is made by rows: four channels of the EXR, or the 8 bit picture twice."""

BYTES_WHOLE = 200
"""More where the whole view is held: its rays, the film's channels and what develops them."""


PROGRAM_BYTES = 2.5e8
"""Of the program with its libraries and machine code."""
BYTES_OF_A_LOOK, POLARISED_LOOK = 1050, 1.35
"""Of a direction and wavelength while a field is asked for it; times so many where it is polarised."""
LEFT = 0.5
"""Of a field's memory that is still held when it is asked for directions."""
PIXEL_S = 3.5e-6
"""Processor seconds of a pixel of a view."""


@dataclass(frozen=True)
class SceneTakes:
    """What a scene takes.

    blocks: in which its wavelengths are solved, one after the other, of at most `at_once`
    sky_bytes: of the arrays of one sky and its pictures at the same time; view_bytes: of the picture of a view.
    field_bytes: of the field of one block, while it is solved; total_bytes: the most that all take together, with the
        program; cpu_s: processor time on a quiet core of some 3 GHz, machine code being there.  None for solvers that
        do not say.
    """

    suns: int
    wavelengths: int
    at_once: int
    blocks: int
    sky_bytes: int
    view_bytes: int
    field_bytes: float | None = None
    total_bytes: float | None = None
    cpu_s: float | None = None


def takes_in_full(config: Config) -> SceneTakes:
    """What a configuration's scene takes, its field too; a second's work at many wavelengths.

    Errors: TwilightError for whatever in the configuration cannot be computed.
    """
    sizes = takes(config)
    suns = [sun.elevation_deg for sun in suns_of(config)]
    problem = problem_of(config, None if config.terrain is not None else suns)
    blocks = len(problem.slices)
    sizes = replace(sizes, wavelengths=problem.medium.n_wavelengths, at_once=problem.wavelengths_at_once, blocks=blocks)
    found = problem.takes
    if found is None:
        return sizes
    lanes = np.ones(problem.medium.n_wavelengths, int) if problem.bands is None else problem.bands.lanes
    of_blocks = [int(lanes[part].sum()) for part in problem.slices]
    in_band = [problem.bands is not None and bool((lanes[part] > 1).any()) for part in problem.slices]
    field = max(found.n_bytes(n, band) for n, band in zip(of_blocks, in_band, strict=True))
    rows, columns = config.texture.shape
    directions = rows * (columns // 2 + 1)
    width = config.texture.latlong_width
    if width is not None:
        directions += width // 4 * (width // 2 + 1)
    polarised = problem.capabilities.stokes and problem.settings.polarisation
    values, pixels = min(VALUES_AT_ONCE, directions * max(of_blocks)), 0
    if config.observer.view is not None:
        of_view = most_nodes(config.observer.view, problem.altitude_km - problem.medium.bottom_km)
        directions += of_view
        values, pixels = max(values, of_view * max(of_blocks)), int(np.prod(config.observer.view.shape))
    look = BYTES_OF_A_LOOK * (POLARISED_LOOK if polarised else 1.0) * values
    seconds = PIXEL_S * len(suns) * pixels
    for n, band in zip(of_blocks, in_band, strict=True):
        times = found.band_cpu if band else 1.0
        seconds += times * found.cpu_s_per_wavelength * -(-n // found.together) * found.together
        seconds += times * found.cpu_s_per_look * len(suns) * directions * n
    # one copy of a sky grows while its blocks are solved and asked; all are there while the last field still is
    held = sizes.sky_bytes / ARRAYS_AT_ONCE
    most = max(field + held, LEFT * field + look + held, LEFT * field + sizes.sky_bytes)
    return replace(sizes, field_bytes=field, total_bytes=PROGRAM_BYTES + most + sizes.view_bytes, cpu_s=seconds)


def takes(config: Config) -> SceneTakes:
    """What a configuration's skies take, without their field; a table's wavelengths, which are in its file, count as
    one."""
    rows, columns = config.texture.shape
    width, spectral_width = config.texture.latlong_width or config.output.width, config.output.spectral_width
    wavelength_nm = wavelengths_of(config)
    n_wavelengths = 1 if wavelength_nm is None else len(wavelength_nm)
    name, _, settings = resolve_solver(config.solver)
    able = solvers.load(name).CAPABILITIES
    values = rows * columns * n_wavelengths * (2 if able.standard_error else 1)
    if able.stokes and settings.polarisation:
        values *= 3
    if config.texture.latlong_width is not None:
        values += width * width // 4 * n_wavelengths
    arrays = ARRAYS_AT_ONCE + (NIGHT_ARRAYS if config.night is not None else 0)
    at_once = min(able.wavelengths_at_once, n_wavelengths)
    return SceneTakes(
        count_suns(config),
        n_wavelengths,
        at_once,
        -(-n_wavelengths // at_once),
        8 * (arrays * values + spectral_width * spectral_width // 2 * n_wavelengths + width * width * 2),
        _view_bytes(config, n_wavelengths),
    )


def check_size(config: Config) -> None:
    """Raise TwilightError where the sky and its pictures alone would not fit into this machine's memory."""
    rows, columns = config.texture.shape
    sizes = takes(config)
    n_wavelengths, needed = sizes.wavelengths, sizes.sky_bytes
    memory = _memory()
    if config.observer.view is not None:
        _check_view(config, sizes.view_bytes, memory)
    if needed > memory:
        raise TwilightError(
            f"{config.title}: texture ({rows} x {columns} directions), {n_wavelengths} wavelengths and the pictures "
            f"need {needed / 1e9:.3g} GB, and this machine has {memory / 1e9:.3g} GB: take a larger "
            f"texture.resolution_deg, fewer wavelengths or a smaller texture.latlong_width or output.spectral_width"
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


def _check_view(config: Config, needed: int, memory: float) -> None:
    view = config.observer.view
    assert view is not None
    height, width = view.shape
    if needed > memory:
        why = ""
        if needed > BYTES_BY_ROWS * height * width:
            why = ", for terrain and the tones eye and camera need all of it at once"
        raise TwilightError(
            f"{config.title}: a picture of {width} x {height} pixels takes {needed / 1e9:.3g} GB{why}, "
            f"and this machine has {memory / 1e9:.3g} GB: take a smaller observer.view.width (--size)"
        )


def _memory() -> float:
    """Memory of this machine [bytes]; infinite where the system does not say."""
    try:
        return float(os.sysconf("SC_PHYS_PAGES")) * os.sysconf("SC_PAGE_SIZE")
    except (AttributeError, ValueError, OSError):
        return float("inf")
