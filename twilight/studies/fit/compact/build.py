"""`fit_compact`: from a climate to a compact sky, and how far it is from skies that it has not seen."""

from __future__ import annotations

import io
import itertools
import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from twilight import __version__, solvers
from twilight.base.errors import TwilightError
from twilight.base.progress import Progress, part_of, silent
from twilight.base.whole_files import whole_file
from twilight.config.scene import Config
from twilight.io.provenance import configuration_hash
from twilight.scene.medium import climate_medium
from twilight.solvers.base import Solver
from twilight.solvers.compact.compact_sky import CompactSky, SkySplines, TuckerTerm, spline_matrix
from twilight.solvers.compact.recognise import stored_air
from twilight.studies.fit.compact import training
from twilight.studies.fit.compact.decompose import absorption_spectra, decompose, refine_wavelengths
from twilight.studies.fit.compact.terms import GROUND_ALBEDOS, added_light, ground_light, splines_of
from twilight.studies.fit.compact.training import Skies, TrainingAir, compute_skies

GRID = SkySplines(
    elevation_intervals=20, azimuth_intervals=14, angle_intervals=24, elevation_power=2.0, angle_scale_deg=0.5
)
"""Splines of the model over the sky."""
RANKS = {"dark": (70, 32, 12, 8), "ground": (30, 16, 8, 4), "ozone": (20, 12, 8, 2)}
"""Ranks of each term of the Tucker decomposition in direction, sun, wavelength and amount."""
SMOOTH_QUALITY = "draft"
"""Quality of `zones` for the light of the ground and the change with ozone, which are small parts of the light."""
GROUND_DEPTHS = 4
"""Aerosol loads at which the light of the ground is computed."""
GROUND_SUNS = 2
"""The light of the ground is computed for one sun in this many."""
OZONE_FACTORS = (0.6, 1.0, 1.4)
"""Ozone columns over the climate's own at which the change with ozone is computed."""
FINE_NM = np.arange(training.WAVELENGTHS_NM[0], training.WAVELENGTHS_NM[-1] + 0.5, 1.0)
"""Wavelengths of the model."""
BLACK_GROUND_TIME = 0.66
"""Fraction of the time for the sky over black ground, which progress is reported by."""
GROUND_AND_OZONE_TIME = 0.14
"""Fraction of the time for the light of the ground and for ozone; the rest is for skies to test with."""
SUN_RANGES_DEG = ((-18.0, 90.0), (-18.0, -12.0), (-12.0, -6.0), (-6.0, 0.0), (0.0, 10.0), (10.0, 90.0))
"""Elevations of the sun over which errors are reported."""


@dataclass(frozen=True)
class HeldOutError:
    """|model / solver - 1| over all held-out airs and wavelengths, the suns of a range and a part of the sky."""

    sun_elevation_deg: tuple[float, float]
    part: str
    count: int
    median: float
    p95: float
    largest: float


@dataclass(frozen=True)
class CompactFit:
    """A model, its errors, and the time of its fit [s], of the processor and by the clock, without held-out skies."""

    model: CompactSky
    errors: tuple[HeldOutError, ...]
    cpu_s: float
    wall_s: float


def fit_compact(config: Config, depths: Sequence[float] | None = None, progress: Progress | None = None) -> CompactFit:
    """The compact sky of a configuration's climate, by its solver at its quality.

    depths: aerosol optical depths at 550 nm, `training.optical_depths` where they are not given
    Errors: TwilightError for another solver, a climate without aerosol, and loads that it cannot have.
    """
    tell = progress or silent
    name, quality, settings = config.chosen_solver
    solver = solvers.load(name)
    if not _fits(name):
        able = ", ".join(n for n in solvers.SOLVERS if _fits(n))
        raise TwilightError(f"solver.name is {name}; a compact sky takes {able}, whose one field serves every sun")
    ground_km = config.climate.ground.altitude_km
    if config.observer.altitude_km != ground_km:
        raise TwilightError(
            f"observer.altitude_km is {config.observer.altitude_km:g}; a compact sky is seen from the ground, "
            f"{ground_km:g} km"
        )
    depths = check_depths(training.optical_depths(config) if depths is None else depths)
    begin = time.process_time(), time.perf_counter()
    wavelength, fine = np.array(training.WAVELENGTHS_NM), FINE_NM
    training.medium_of(config, TrainingAir(depths[0]), wavelength[:1])  # says at once what the climate cannot have
    clean = climate_medium(config.climate.model_copy(update={"aerosol": None, "stratosphere": None}), fine)
    shapes = absorption_spectra(clean)
    reference_du = float(clean.notes["ozone_column_du"])
    dark = _dark(config, solver, settings, depths, part_of(tell, 0.0, BLACK_GROUND_TIME))
    ground, returned, ozone, columns = _smooth_terms(
        config, solver, depths, reference_du, part_of(tell, BLACK_GROUND_TIME, GROUND_AND_OZONE_TIME)
    )
    tensors = {"dark": dark, "ground": ground, "ozone": ozone}
    terms: dict[str, Any] = {
        key: _term(tensor, RANKS[key], wavelength, fine, shapes) for key, tensor in tensors.items()
    }
    model = CompactSky(
        grid=GRID,
        sun_elevation_deg=np.array(training.SUNS_DEG),
        wavelength_nm=fine,
        optical_depth_550nm=np.array(depths),
        load_offset=training.LOAD_OFFSET,
        ozone_column_du=columns,
        ozone_reference_du=reference_du,
        returned=refine_wavelengths(wavelength, returned.T, fine, shapes).T.astype(np.float32),
        air=air_of_climate(config, depths),
        **terms,
    )
    cpu_s, wall_s = time.process_time() - begin[0], time.perf_counter() - begin[1]
    fitted = BLACK_GROUND_TIME + GROUND_AND_OZONE_TIME
    ranges = (depths[0], depths[-1]), (float(columns[0]), float(columns[-1]))
    report = part_of(tell, fitted, 1.0 - fitted, "held out:")
    held_out = training.held_out_skies(config, solver, settings, *ranges, report)
    errors = errors_of(model, held_out)
    facts = _facts(config, name, quality, cpu_s, errors)
    return CompactFit(replace(model, provenance=facts), errors, cpu_s, wall_s)


def _fits(name: str) -> bool:
    """Whether a solver's skies can be fitted: all suns at once, and not from a fit themselves."""
    able = solvers.load(name).CAPABILITIES
    return able.every_sun and able.kind != "fitted"


def air_of_climate(config: Config, depths: Sequence[float]) -> dict[str, np.ndarray]:
    """The columns of a climate's air by which a model knows it again: `CompactSky.air`."""
    bare = config.climate.model_copy(update={"aerosol": None, "stratosphere": None})
    gases = bare.gases
    no_ozone = gases.model_copy(update={"ozone": gases.ozone.model_copy(update={"treatment": "none"})})
    with_ozone = climate_medium(bare, FINE_NM).optical_depth("absorption")
    without = climate_medium(bare.model_copy(update={"gases": no_ozone}), FINE_NM).optical_depth("absorption")
    wavelength = np.array(training.WAVELENGTHS_NM)
    loaded = [training.medium_of(config, TrainingAir(depth), wavelength) for depth in depths]
    return stored_air(loaded, FINE_NM, without, with_ozone - without)


def check_depths(depths: Sequence[float]) -> tuple[float, ...]:
    """The aerosol loads; TwilightError unless there are at least four, increasing, from 0 to 100."""
    made = tuple(float(depth) for depth in depths)
    if len(made) < GROUND_DEPTHS or not all(0.0 < a < b <= 100.0 for a, b in itertools.pairwise(made)):
        raise TwilightError(
            f"--optical-depths: {', '.join(f'{d:g}' for d in made)}; at least {GROUND_DEPTHS} that increase from above "
            "0 to 100 at most are needed"
        )
    return made


def _dark(config: Config, solver: Solver, settings: Any, depths: Sequence[float], tell: Progress) -> np.ndarray:
    """Coefficients (K, S, W, T) of the logarithm of the sky over black ground."""
    out = []
    for i, depth in enumerate(depths):
        where = training.WAVELENGTHS_NM, training.SUNS_DEG, training.fine_directions
        report = part_of(tell, i / len(depths), 1.0 / len(depths), f"optical depth {depth:g},")
        out.append(compute_skies(config, solver, settings, TrainingAir(depth), *where, report))
    return splines_of(GRID, out[0], [skies.radiance for skies in out])


def _smooth_terms(
    config: Config, solver: Solver, depths: Sequence[float], reference_du: float, tell: Progress
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Light of the ground (K, S, W, T), fraction that comes back (W, T), change with ozone (K, S, W, Z), columns."""
    settings = solver.QUALITIES[SMOOTH_QUALITY]
    suns = np.array(training.SUNS_DEG)
    some = suns[np.unique(np.append(np.arange(0, suns.size, GROUND_SUNS), suns.size - 1))]
    few = [depths[i] for i in np.round(np.linspace(0, len(depths) - 1, GROUND_DEPTHS)).astype(int)]
    factors = [f for f in OZONE_FACTORS if f != 1.0] if reference_du > 0.0 else []
    steps = len(few) * (1 + len(GROUND_ALBEDOS)) + len(factors)
    step = 0

    def at(air: TrainingAir) -> Skies:
        nonlocal step
        report = part_of(tell, step / steps, 1.0 / steps, "ground and ozone,")
        step += 1
        where = training.WAVELENGTHS_NM, some, training.coarse_directions
        return compute_skies(config, solver, settings, air, *where, report)

    lights, fractions = [], []
    middle = few[len(few) // 2]
    for depth in few:
        black = at(TrainingAir(depth))
        fraction, light = ground_light(
            [added_light(black, at(TrainingAir(depth, albedo)), albedo) for albedo in GROUND_ALBEDOS]
        )
        lights.append(light)
        fractions.append(fraction)
        if depth == middle:
            skies = {factor: at(TrainingAir(depth, 0.0, factor * reference_du)).radiance for factor in factors}
            skies[1.0] = black.radiance
    columns = sorted(skies)
    splines = splines_of(GRID, black, [*lights, *(skies[factor] for factor in columns)])
    grounds, ozone = splines[..., : len(few)], splines[..., len(few) :]
    ozone = ozone - ozone[..., [columns.index(1.0)]]
    loads = np.log(np.array(few) + training.LOAD_OFFSET), np.log(np.array(depths) + training.LOAD_OFFSET)
    to_loads, to_suns = spline_matrix(*loads), spline_matrix(some, suns)
    ground = np.einsum("kswt,Tt,Ss->kSwT", grounds, to_loads, to_suns, optimize=True)
    returned = np.stack(fractions, axis=-1) @ to_loads.T
    return ground, returned, np.einsum("kswz,Ss->kSwz", ozone, to_suns), reference_du * np.array(columns)


def _term(
    tensor: np.ndarray, ranks: Sequence[int], wavelength: np.ndarray, fine: np.ndarray, shapes: np.ndarray
) -> TuckerTerm:
    made = decompose(tensor, ranks)
    spectra = refine_wavelengths(wavelength, made.wavelength.astype(float), fine, shapes)
    return replace(made, wavelength=spectra.astype(np.float32))


def errors_of(model: CompactSky, held_out: Sequence[Skies]) -> tuple[HeldOutError, ...]:
    """Errors for all suns and by range of the sun, over all directions and by part of the sky."""
    suns, parts, errors = [], [], []
    for skies in held_out:
        for i, sun in enumerate(skies.sun_elevation_deg):
            air = skies.air
            sky = model.sky(sun, skies.wavelength_nm, air.optical_depth_550nm, air.ground_albedo, air.ozone_column_du)
            error = np.abs(sky.radiance(skies.elevation_deg[i], skies.azimuth_deg[i]) / skies.radiance[i] - 1.0)
            errors.append(error.ravel())
            third = np.repeat(np.arange(error.shape[0]) * 3 // error.shape[0], error.shape[1])
            parts.append(third)
            suns.append(np.full(error.size, sun))
    sun, part, error = np.concatenate(suns), np.concatenate(parts), np.concatenate(errors)
    out = []
    for low, high in SUN_RANGES_DEG:
        inside = (sun >= low) & (sun <= high)
        groups = {"all": inside} | {name: inside & (part == k) for k, name in enumerate(training.PARTS_OF_SKY)}
        for name, chosen in groups.items():
            if chosen.any():
                median, p95 = np.percentile(error[chosen], [50, 95])
                numbers = float(median), float(p95), float(error[chosen].max())
                out.append(HeldOutError((low, high), name, int(chosen.sum()), *numbers))
    return tuple(out)


def _facts(config: Config, name: str, quality: str, cpu_s: float, errors: Sequence[HeldOutError]) -> dict[str, Any]:
    asked = {
        "climate": config.climate.model_dump(mode="json", exclude_none=True),
        "solver": dict(config.solver) | {"name": name, "quality": quality},
    }
    return {
        "version": __version__,
        "configuration": asked,
        "hash": configuration_hash(asked),
        "climate": config.climate.name,
        "solver": name,
        "quality": quality,
        "cpu_minutes": round(cpu_s / 60.0, 2),
        "held_out_seed": training.HELD_OUT_SEED,
        "errors_of_held_out_skies": [
            {"sun_elevation_deg": list(e.sun_elevation_deg), "part": e.part, "values": e.count}
            | {key: round(getattr(e, key), 5) for key in ("median", "p95", "largest")}
            for e in errors
        ],
    }


def write_model(model: CompactSky, path: Path) -> int:
    """Write the model as .npz, whole or not at all; its bytes.  TwilightError where it cannot be written."""
    buffer = io.BytesIO()
    np.savez_compressed(buffer, **model.arrays())  # type: ignore[arg-type]
    with whole_file(path) as temporary:
        temporary.write_bytes(buffer.getvalue())
    return buffer.tell()


def seconds_per_value(model: CompactSky, wavelengths: int = 8) -> tuple[float, float, float]:
    """Processor seconds per direction and wavelength of `radiance` and of `on_grid`, and of `sky`: the best of five."""
    rng = np.random.default_rng(0)
    rows, columns = np.linspace(0.5, 89.5, 100), np.linspace(0.0, 180.0, 200)
    n = rows.size * columns.size
    e, a = np.degrees(np.arcsin(rng.random(n))), rng.uniform(0.0, 180.0, n)
    nm = np.linspace(model.wavelength_nm[0], model.wavelength_nm[-1], wavelengths)
    depth = float(np.sqrt(model.optical_depth_550nm[0] * model.optical_depth_550nm[-1]))
    best = np.full(3, np.inf)
    for _ in range(5):
        marks = [time.process_time()]
        sky = model.sky(-4.0, nm, depth, 0.2)
        marks.append(time.process_time())
        sky.radiance(e, a)
        marks.append(time.process_time())
        sky.on_grid(rows, columns)
        marks.append(time.process_time())
        of_sky, directions, grid = np.diff(marks)
        best = np.minimum(best, [directions / (n * wavelengths), grid / (n * wavelengths), of_sky])
    return float(best[0]), float(best[1]), float(best[2])
