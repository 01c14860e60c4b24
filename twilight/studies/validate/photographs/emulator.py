"""Skies of one climate under neighbouring suns, as splines over the sky: what libraries are made of.

A photograph tells the air to some percent.  A climate is therefore solved once for a window of suns, by its solver at
QUALITY where it has that and at eight wavelengths at most, and evaluated in some 200 directions for each sun of the
window.  ln(XYZ) becomes coefficients of the splines of `sky_splines`, in elevation, in azimuth
and around the sun, and these are splined over the suns: whole skies of any sun in the window follow in milliseconds.
How far they are off is found from computed skies of climates, suns and directions that they were not made from
(`library.make_library`).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from pathlib import Path

import numpy as np

from twilight import solvers
from twilight.atmosphere.medium import Medium
from twilight.base import cache
from twilight.base.digest import code_digest
from twilight.base.errors import TwilightError
from twilight.base.progress import Progress, silent
from twilight.base.reading import first_line, open_npz
from twilight.base.whole_files import whole_file
from twilight.config.load import load
from twilight.config.scene import PLACED_NM, Config
from twilight.engine.night import levels_of
from twilight.engine.solve import Problem
from twilight.engine.sunbeam import Sunbeam
from twilight.io.provenance import configuration_hash
from twilight.numerics import spectrum
from twilight.numerics.splines import spline_matrix
from twilight.scene import resolve
from twilight.sky import colour
from twilight.sky.night import night_radiance
from twilight.studies.validate.photographs.photo import OBSERVER
from twilight.studies.validate.photographs.sky_splines import SkySplines, spline_coefficients

QUALITY = "draft"
WINDOWS = (
    ((-18.0, -10.0), (-18.0, -16.0, -14.0, -12.0, -10.0, -8.0)),
    ((-10.0, -6.5), (-12.0, -10.0, -8.0, -6.5, -5.0)),
    ((-6.5, -2.0), (-8.0, -6.5, -5.0, -4.0, -3.0, -2.0, -1.0)),
    ((-2.0, 1.0), (-3.0, -2.0, -1.0, 0.0, 1.0, 2.5)),
    ((1.0, 7.0), (0.0, 1.0, 2.5, 4.5, 7.0, 10.0)),
    ((7.0, 19.0), (4.5, 7.0, 10.0, 14.0, 19.0, 25.0)),
    ((19.0, 43.0), (14.0, 19.0, 25.0, 33.0, 43.0, 55.0)),
    ((43.0, 90.0), (33.0, 43.0, 55.0, 70.0, 90.0)),
)
"""Lowest and highest sun [deg] for which a window serves, and its nodes, some of which lie beyond these."""

GRID = SkySplines(
    elevation_intervals=10, azimuth_intervals=8, angle_intervals=10, elevation_power=2.0, angle_scale_deg=2.0
)
ROWS = 13
"""Elevations in which a sky is computed, closer together near the horizon."""
COLUMNS = 10
"""Azimuths from 0 to 180 deg in which a sky is computed."""
FROM_SUN_DEG = (1.5, 4.0, 8.0, 14.0)
"""Distances [deg] from a visible sun at which elevations and azimuths are added."""
AUREOLE_ABOVE_DEG = -4.0
"""Sun elevation [deg] from which on elevations and azimuths are added: the aureole is over the horizon."""


def sun_nodes(config: Config, sun_elevations_deg: Sequence[float]) -> tuple[float, ...]:
    """The suns [deg] for which a climate is computed where these will be asked for.

    The nodes of all windows that hold them; for a solver whose field is of one sun, or of the day alone, just these.
    """
    able = solvers.load(config.chosen_solver.name).CAPABILITIES
    low, high = min(sun_elevations_deg), max(sun_elevations_deg)
    first, last = WINDOWS[0][0][0], WINDOWS[-1][0][1]
    if not (able.every_sun and able.kind != "formula") or low < first or high > last:
        return tuple(sorted(set(sun_elevations_deg)))
    serving = [nodes for (begin, end), nodes in WINDOWS if max(begin, low) < min(end, high)]
    if not serving:  # one sun
        serving = [nodes for (begin, end), nodes in WINDOWS if begin <= low <= end][:1]
    return tuple(sorted({node for nodes in serving for node in nodes}))


def quick(config: Config) -> Config:
    """The configuration at QUALITY, where its solver has that, and with eight wavelengths at most."""
    data = config.model_dump(mode="json", exclude_none=True, exclude_unset=True)
    settings: dict[str, object] = {}
    if QUALITY in solvers.load(config.chosen_solver.name).QUALITIES:
        settings["solver.quality"] = QUALITY
    if config.wavelengths is not None and len(config.wavelengths.wavelength_nm) > len(PLACED_NM):
        data.pop("wavelengths")
    return load(data, settings)


def sampled(sun_elevation_deg: float) -> tuple[np.ndarray, np.ndarray]:
    """Elevations (E,) and azimuths from the sun (A,) [deg] in which a sky is computed."""
    rows = 90.0 * np.linspace(0.0, 1.0, ROWS) ** 2
    columns = np.linspace(0.0, 180.0, COLUMNS)
    if sun_elevation_deg > AUREOLE_ABOVE_DEG:
        near = np.array(FROM_SUN_DEG)
        beside = sun_elevation_deg + np.concatenate([-near, near])
        rows = np.concatenate([rows, beside[(beside > 0.0) & (beside < 90.0)]])
        columns = np.concatenate([columns, near / max(np.cos(np.radians(sun_elevation_deg)), 0.05)])
    return _apart(rows), _apart(columns[columns <= 180.0])


def _apart(values: np.ndarray) -> np.ndarray:
    values = np.unique(values)
    return values[np.concatenate([[True], np.diff(values) > 0.2])]


Directions = Callable[[float], tuple[np.ndarray, np.ndarray]]


def compute(
    config: Config, suns: Sequence[float], directions: Directions, progress: Progress = silent
) -> list[np.ndarray]:
    """XYZ (E, A, 3) [cd m^-2] of a configuration's climate under each of the suns, on rows and columns of its own.

    Errors: TwilightError for a sky that is black somewhere, and for whatever in the configuration cannot be computed.
    """
    problem = Problem(resolve(config), tuple(suns))
    where = [directions(float(sun)) for sun in suns]
    found: list[list[np.ndarray]] = [[] for _ in suns]
    for b in range(len(problem.slices)):
        progress("solving", b / len(problem.slices))
        block = problem.block(b)
        for s, (sun, (rows, columns)) in enumerate(zip(suns, where, strict=True)):
            progress(f"sun {sun:g} deg", (b + 0.6 + 0.4 * s / len(suns)) / len(problem.slices))
            e, a = np.meshgrid(rows, columns, indexing="ij")
            found[s].append(block.answer(float(sun), e, a).radiance)
        del block
    made = []
    for sun, (rows, columns), parts in zip(suns, where, found, strict=True):
        factor = np.concatenate(parts, axis=-1)
        if config.night is not None:
            factor = factor + _night(config, problem.scene.medium, sun, rows, columns)
        xyz = colour.factor_to_xyz(factor, problem.scene.medium.wavelength_nm, config.solar_spectrum, observer=OBSERVER)
        if not (xyz > 0.0).all():
            raise TwilightError(
                f"{config.title}: the sky under the sun at {sun:g} deg is black somewhere; choose other suns"
            )
        made.append(xyz)
    return made


def _night(config: Config, medium: Medium, sun: float, rows: np.ndarray, columns: np.ndarray) -> np.ndarray:
    assert config.night is not None
    levels, altitude_km = levels_of(config.night), config.observer.altitude_km
    light = night_radiance(medium, rows, columns, levels, sun_elevation_deg=sun, observer_altitude_km=altitude_km)
    return light / spectrum.solar_irradiance(medium.wavelength_nm, config.solar_spectrum)


def coefficients(config: Config, suns: Sequence[float], progress: Progress = silent) -> np.ndarray:
    """Coefficients (S, K, 3) of the splines over the sky of ln(XYZ), for each of the suns."""
    made = []
    for sun, xyz in zip(suns, compute(config, suns, sampled, progress), strict=True):
        rows, columns = sampled(float(sun))
        e, a = np.meshgrid(rows, columns, indexing="ij")
        made.append(spline_coefficients(GRID, float(sun), e.ravel(), a.ravel(), np.log(xyz).reshape(-1, 3)))
    return np.array(made, np.float32)


def at_sun(suns: Sequence[float], values: np.ndarray, sun_elevation_deg: float) -> np.ndarray:
    """Coefficients (K, N) under one sun of those under several, (S, K, N)."""
    weight = spline_matrix(np.array(suns), np.array([sun_elevation_deg]))[0] if len(suns) > 1 else np.ones(1)
    return np.tensordot(weight, values, 1)


def evaluate(at: np.ndarray, sun_elevation_deg: float, rows: np.ndarray, columns: np.ndarray) -> np.ndarray:
    """The logarithms (E, A, N) on rows and columns [deg] of coefficients (K, N)."""
    return GRID.on_rows_and_columns(sun_elevation_deg, rows, columns, at)


def apparent_elevations_deg(config: Config, suns: Sequence[float]) -> np.ndarray:
    """Where the suns are seen, lifted by refraction [deg]."""
    scene = resolve(config)
    beam = Sunbeam(scene.medium, numpy_only=True)
    return np.array([sun + beam.at(float(sun), scene.altitude_km).bending_deg for sun in suns])


# On disk --------------------------------------------------------------------------------------------------------


def key_of(*about: object) -> str:
    """A hash of configurations and numbers, and of the code that computes them."""
    config = next(one for one in about if isinstance(one, Config))
    solver = solvers.SOLVERS[config.chosen_solver.name]
    code = code_digest("twilight.studies.validate.photographs.emulator", solver)
    values = [one.model_dump(mode="json") if isinstance(one, Config) else one for one in about]
    return configuration_hash([code, *values])


def cached_or_made(key: str, make: Callable[[], Mapping[str, np.ndarray]]) -> dict:
    """Arrays from the user's cache where it has them; else made, and left there for the next time."""
    path = cache.find(cache.SKIES, key)
    if path is not None:
        with suppress(TwilightError):  # damaged
            stored = read(path, key)
            if stored is not None:
                return stored
    made = dict(make())
    cache.store(cache.SKIES, key, lambda to: write(to, key, made))
    return made


def write(path: Path, key: str, arrays: Mapping[str, np.ndarray]) -> None:
    """Write arrays under a key, whole or not at all."""
    with whole_file(path) as temporary, open(temporary, "wb") as stream:
        np.savez_compressed(stream, key=np.array(key), **arrays)  # type: ignore[arg-type]


def read(path: Path, key: str) -> dict[str, np.ndarray] | None:
    """What `write` wrote, None where it is of another key.  Errors: TwilightError for a damaged file."""
    try:
        with open_npz(path) as stored:
            if str(stored["key"]) != key:
                return None
            return {name: stored[name] for name in stored.files if name != "key"}
    except TwilightError:
        raise
    except Exception as error:  # zipfile, zlib, numpy and the system each have their own
        raise TwilightError(f"{path}: is not a complete library of skies ({first_line(error)})") from None
