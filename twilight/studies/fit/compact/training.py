"""The skies that a compact sky is fitted to, and those that it is judged by."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from twilight.atmosphere.medium import Medium
from twilight.base.errors import TwilightError
from twilight.base.progress import Progress, part_of, silent
from twilight.config.scene import Config
from twilight.engine.solve import Problem
from twilight.scene import Scene
from twilight.scene.medium import climate_medium
from twilight.solvers.base import Solver

Directions = Callable[[float], tuple[np.ndarray, np.ndarray]]

SUNS_DEG = (
    -18.0, -16.7, -15.4, -14.2, -13.0, -12.0, -11.0, -10.0, -9.2, -8.4, -7.6, -6.8, -6.0, -5.3, -4.6, -4.0, -3.4, -2.8,
    -2.2, -1.7, -1.2, -0.8, -0.4, 0.0, 0.4, 0.8, 1.3, 2.0, 2.8, 3.7, 4.8, 6.2, 8.0, 10.0, 12.5, 15.5, 19.0, 23.0, 28.0,
    34.0, 41.0, 49.0, 58.0, 68.0, 79.0, 90.0,
)  # fmt: skip
"""Elevations of the sun of the fit, close together where the light falls fast: around the horizon and after sunset."""
WAVELENGTHS_NM = (
    380.0, 384.0, 388.0, 420.0, 456.0, 464.0, 480.0, 484.0, 492.0, 504.0, 520.0, 528.0, 564.0, 568.0, 580.0, 588.0,
    608.0, 620.0, 628.0, 644.0, 652.0, 680.0, 712.0, 740.0,
)  # fmt: skip
"""24 wavelengths from which, with the gases' own absorption spectra, the others follow best: chosen by a search over 36
spectra of the sky at 91 wavelengths, which they give to 0.2 % (mean), 0.7 % (95th percentile), 2.3 % (largest)."""
OPTICAL_DEPTHS = (0.01, 0.043, 0.095, 0.18, 0.3, 0.5, 0.8)
"""Aerosol optical depths at 550 nm of the fit, evenly in ln(depth + LOAD_OFFSET)."""
LOAD_OFFSET = 0.05
"""Thin haze scatters light in proportion to its depth; along the horizon thick haze dims light exponentially in the
depth: with nodes evenly in ln(depth + 0.02) the horizon below a low sun was 17 % off at depth 0.65."""
REPLACED = 0.05
"""Relative distance from a climate's own optical depth within which that replaces one of OPTICAL_DEPTHS."""

ROWS = 24
"""Elevations at which a sky is computed, closer together near the horizon."""
COLUMNS = 16
"""Azimuths from 0 to 180 deg at which a sky is computed."""
COARSE_ROWS = 16
"""Elevations for what is smooth over the sky: the light of the ground, the change with ozone."""
COARSE_COLUMNS = 9
"""Azimuths for what is smooth over the sky."""
FROM_SUN_DEG = (0.2, 0.5, 1.0, 1.8, 3.0, 5.0, 8.0, 12.0, 18.0)
"""Distances from the sun [deg] at which elevations and azimuths are added."""
AUREOLE_SEEN_ABOVE_DEG = -6.0
"""Sun elevation [deg] above which directions around the sun are added."""


@dataclass(frozen=True)
class TrainingAir:
    """What a compact sky is a function of, beside sun, direction and wavelength."""

    optical_depth_550nm: float
    ground_albedo: float = 0.0
    ozone_column_du: float | None = None


@dataclass(frozen=True)
class Skies:
    """Sun-normalised radiance [sr^-1] of one air under several suns.

    sun_elevation_deg (S,); for each sun elevation_deg, azimuth_deg (D,) and radiance (D, W).
    """

    air: TrainingAir
    wavelength_nm: np.ndarray
    sun_elevation_deg: np.ndarray
    elevation_deg: tuple[np.ndarray, ...]
    azimuth_deg: tuple[np.ndarray, ...]
    radiance: tuple[np.ndarray, ...]


def fine_directions(sun_elevation_deg: float) -> tuple[np.ndarray, np.ndarray]:
    """Elevation and azimuth from the sun [deg] of the directions of one sky, (D,): a grid, finer around the sun."""
    rows = 90.0 * np.linspace(0.0, 1.0, ROWS) ** 2
    columns = np.linspace(0.0, 180.0, COLUMNS)
    near = np.array(FROM_SUN_DEG)
    if sun_elevation_deg > AUREOLE_SEEN_ABOVE_DEG:
        beside = sun_elevation_deg + np.concatenate([-near[::-1], [0.0], near])
        rows = np.concatenate([rows, beside[(beside > 0.0) & (beside < 90.0)]])
    columns = np.concatenate([columns, near / max(np.cos(np.radians(sun_elevation_deg)), 1e-3)])
    return _product(_apart(rows), _apart(columns[columns <= 180.0]))


def coarse_directions(sun_elevation_deg: float) -> tuple[np.ndarray, np.ndarray]:
    """Directions for every sun: a grid, finer at the horizon."""
    return _product(90.0 * np.linspace(0.0, 1.0, COARSE_ROWS) ** 2, np.linspace(0.0, 180.0, COARSE_COLUMNS))


def _product(rows: np.ndarray, columns: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    e, a = np.meshgrid(rows, columns, indexing="ij")
    return e.ravel(), a.ravel()


def _apart(values: np.ndarray) -> np.ndarray:
    """In order, without those that are almost the same."""
    values = np.unique(values)
    return values[np.concatenate([[True], np.diff(values) > 0.05])]


def medium_of(config: Config, air: TrainingAir, wavelength_nm: np.ndarray) -> Medium:
    """The medium of the configuration's climate with that aerosol load, ground and ozone.

    Errors: TwilightError for a climate without aerosol, and for a load that it cannot have.
    """
    climate = config.climate
    if climate.aerosol is None or climate.medium is not None:
        raise TwilightError(f"{climate.name}: has no aerosol whose optical depth could be varied")
    gases = climate.gases
    if air.ozone_column_du is not None:
        ozone = gases.ozone.model_copy(update={"column_du": air.ozone_column_du, "day_of_year": None})
        gases = gases.model_copy(update={"ozone": ozone})
    changed = {
        "aerosol": climate.aerosol.model_copy(update={"optical_depth_550nm": air.optical_depth_550nm}),
        "ground": climate.ground.model_copy(update={"albedo": air.ground_albedo}),
        "gases": gases,
    }
    return climate_medium(climate.model_copy(update=changed), wavelength_nm)


def optical_depths(config: Config) -> tuple[float, ...]:
    """Aerosol optical depths at 550 nm that a climate is fitted at: OPTICAL_DEPTHS, and that which it has by itself.

    Errors: as `medium_of`.
    """
    climate = config.climate
    if climate.aerosol is None or climate.medium is not None:
        return OPTICAL_DEPTHS  # `medium_of` says what is wrong
    own = float(climate_medium(climate, np.array([550.0])).optical_depth("aerosol")[0])
    others = [depth for depth in OPTICAL_DEPTHS if abs(depth - own) > REPLACED * own]
    return tuple(sorted([*others, own]))


def compute_skies(
    config: Config,
    solver: Solver,
    settings: Any,
    air: TrainingAir,
    wavelength_nm: Sequence[float] | np.ndarray,
    sun_elevation_deg: Sequence[float] | np.ndarray,
    directions: Directions,
    progress: Progress | None = None,
) -> Skies:
    """Skies of one air by a solver with these settings; `directions` gives those of a sun."""
    tell = progress or silent
    medium = medium_of(config, air, np.asarray(wavelength_nm, float))
    suns = np.asarray(sun_elevation_deg, float)
    where = [directions(float(sun)) for sun in suns]
    parts: list[list[np.ndarray]] = [[] for _ in suns]
    problem = Problem(Scene(medium, None, solver, settings, title=medium.name))
    count = len(problem.slices)
    for b in range(count):
        tell("solving", b / count)
        block = problem.block(b)
        for s, (sun, (e, a)) in enumerate(zip(suns, where, strict=True)):
            tell(f"sun {sun:g} deg", (b + 0.3 + 0.7 * s / suns.size) / count)
            parts[s].append(block.answer(float(sun), e, a).radiance)
        del block  # before the next is solved
    elevation, azimuth = (tuple(w[i] for w in where) for i in (0, 1))
    radiance = tuple(np.concatenate(part, axis=1) for part in parts)
    return Skies(air, medium.wavelength_nm, suns, elevation, azimuth, radiance)


HELD_OUT_SEED = 20260101
"""Seed of the generator that draws the held-out airs: always the same ones."""
HELD_OUT_AIRS = 6
"""Airs, drawn at random, whose computed skies the model is compared with."""
HELD_OUT_WAVELENGTHS = 8
"""Wavelengths of each held-out air."""
PARTS_OF_SKY = ("whole sky", "below 10 deg", "within 20 deg of the sun")
"""Names of the thirds of `random_directions`, in sequence."""


def held_out_skies(
    config: Config,
    solver: Solver,
    settings: Any,
    depths: tuple[float, float],
    ozone_du: tuple[float, float],
    progress: Progress,
) -> list[Skies]:
    """Skies of random airs, grounds, suns, wavelengths and directions, none of them at a node; always the same ones.

    Suns: nine evenly over twilight, three up to 10 deg, four evenly over the day's half of the sphere.  Directions:
    a third evenly over the solid angle of the sky, a third below 10 deg, a third around the sun.
    """
    rng = np.random.default_rng(HELD_OUT_SEED)
    out = []
    for i in range(HELD_OUT_AIRS):
        air = TrainingAir(float(rng.uniform(*depths)), float(rng.uniform(0.0, 0.9)), float(rng.uniform(*ozone_du)))
        wavelength = np.sort(rng.uniform(WAVELENGTHS_NM[0], WAVELENGTHS_NM[-1], HELD_OUT_WAVELENGTHS))
        day = np.degrees(np.arcsin(rng.random(4)))
        suns = np.sort(np.concatenate([rng.uniform(-18.0, 0.0, 9), rng.uniform(0.0, 10.0, 3), day]))
        chosen = {float(sun): random_directions(rng, float(sun)) for sun in suns}
        tell = part_of(progress, i / HELD_OUT_AIRS, 1.0 / HELD_OUT_AIRS)
        out.append(compute_skies(config, solver, settings, air, wavelength, suns, chosen.__getitem__, tell))
    return out


def random_directions(rng: np.random.Generator, sun_elevation_deg: float) -> tuple[np.ndarray, np.ndarray]:
    """Three times 48 directions, (144,): over the whole sky, below 10 deg, within 20 deg of the sun (if they exist)."""
    rows, each = 16, 3
    whole = np.degrees(np.arcsin(rng.random(rows)))
    low = rng.uniform(0.0, 10.0, rows)
    sun = sun_elevation_deg
    near = rng.uniform(max(0.0, sun - 14.0), min(90.0, max(sun, 0.0) + 14.0), rows)
    e = np.repeat(np.concatenate([whole, low, near]), each)
    a = rng.uniform(0.0, 180.0, e.size)
    last = slice(2 * rows * each, None)
    a[last] = np.minimum(180.0, rng.uniform(0.0, 14.0, rows * each) / max(np.cos(np.radians(sun)), 0.1))
    return e, a
