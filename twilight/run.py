"""From a configuration to a sky: the one place where all parts meet."""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from datetime import datetime, timedelta
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from twilight import __version__, solvers
from twilight.air import climate_medium, name_by_content, wavelengths_of
from twilight.config.climate import climate_files
from twilight.config.scene import Config, SunAt, SunElevation, SunElevations, SunInterval
from twilight.config.solver import complete_solver, resolve_solver
from twilight.errors import TwilightError
from twilight.io.provenance import configuration_hash
from twilight.plan import Plan, make_plan
from twilight.sky import Sky, latlong_grid

if TYPE_CHECKING:
    from twilight.atmosphere.medium import Medium

Progress = Callable[[str, float], None]
"""Called with a few words on what is being done and the share of the work that is done."""

ARRAYS_AT_ONCE = 4
"""Copies of a sky's radiance that a render holds at the same time: blocks, the whole, physical units, the file's."""

NIGHT_ARRAYS = 3
"""Copies more where the night sky is added: of its parts, the whole, and the sum with the sun's sky."""

WAVELENGTH_BLOCK = 32
"""Wavelengths that a solver holds at once; more are done in blocks, so that 1000 need no more memory than 32."""


@dataclass(frozen=True)
class Frame:
    """One sky of a sequence: a name for its folder, the sky, and its latitude-longitude picture where asked for."""

    name: str
    sky: Sky
    panorama: Sky | None = None


@dataclass(frozen=True)
class SunPosition:
    """One sun of a sequence, and the configuration that asks for this sun alone."""

    name: str
    section: SunElevation | SunAt
    elevation_deg: float
    azimuth_deg: float | None = None
    distance_au: float = 1.0
    time: datetime | None = None


@dataclass
class _Radiance:
    """What the solver gives for one sun, filled block by block."""

    texture: list[np.ndarray] = field(default_factory=list)
    panorama: list[np.ndarray] = field(default_factory=list)
    texture_error: list[np.ndarray] = field(default_factory=list)
    panorama_error: list[np.ndarray] = field(default_factory=list)
    direct: list[np.ndarray] = field(default_factory=list)
    bending_deg: float = 0.0
    seconds: float = 0.0
    convergence: dict[str, Any] = field(default_factory=dict)
    facts: dict[str, Any] = field(default_factory=dict)


def run(config: Config, progress: Progress | None = None) -> Sky:
    """The sky of a configuration with one sun.

    Errors: TwilightError for a configuration with several suns (`frames` gives them one by one), and for whatever in
    the configuration cannot be computed.
    """
    count = count_frames(config)
    if count > 1:
        raise TwilightError(f"sun: the configuration has {count} suns; frames gives them one by one")
    return next(iter(frames(config, progress))).sky


def count_frames(config: Config) -> int:
    """How many skies `frames` will give."""
    sun = config.sun
    if isinstance(sun, SunElevations):
        return len(sun.elevations_deg)
    if isinstance(sun, SunInterval):
        return len(_moments(sun))
    return 1


def check_size(config: Config) -> None:
    """Raise TwilightError where the sky and its pictures alone would not fit into this machine's memory."""
    rows, columns = config.texture.shape
    width, spectral_width = config.texture.latlong_width or config.output.width, config.output.spectral_width
    wavelength_nm = wavelengths_of(config)
    n_wavelengths = 1 if wavelength_nm is None else len(wavelength_nm)  # a table's are in its file
    values = rows * columns * n_wavelengths * (2 if config.solver.get("name") == "montecarlo" else 1)
    if config.texture.latlong_width is not None:
        values += width * width // 4 * n_wavelengths
    arrays = ARRAYS_AT_ONCE + (NIGHT_ARRAYS if config.night is not None else 0)
    needed = 8 * (arrays * values + spectral_width * spectral_width // 2 * n_wavelengths + width * width * 2)
    memory = _memory()
    if needed > memory:
        raise TwilightError(
            f"{config.title}: texture ({rows} x {columns} directions), {n_wavelengths} wavelengths and the pictures "
            f"need {needed / 1e9:.3g} GB, and this machine has {memory / 1e9:.3g} GB: take a larger "
            f"texture.resolution_deg, fewer wavelengths or a smaller texture.latlong_width or output.spectral_width"
        )


def _memory() -> float:
    """Memory of this machine [bytes]; infinite where the system does not say."""
    try:
        return float(os.sysconf("SC_PHYS_PAGES")) * os.sysconf("SC_PAGE_SIZE")
    except (AttributeError, ValueError, OSError):
        return float("inf")


def frames(config: Config, progress: Progress | None = None) -> Iterator[Frame]:
    """The skies of a configuration, one for each sun; what does not depend on the sun is computed once for all.

    Up to WAVELENGTH_BLOCK wavelengths a frame is given as soon as it is done.
    """
    tell = progress or (lambda doing, share: None)
    tell("setting up", 0.0)
    check_size(config)
    started = time.perf_counter()
    suns = list(suns_of(config))
    plan = make_plan(config)
    wavelength_nm = wavelengths_of(config)
    medium = climate_medium(plan.climate, wavelength_nm)
    name, quality, settings = resolve_solver_of(config)
    solver = solvers.load(name)
    set_up_s = time.perf_counter() - started
    at_once: int = getattr(solver, "WAVELENGTH_BLOCK", WAVELENGTH_BLOCK)
    blocks = [slice(i, i + at_once) for i in range(0, medium.n_wavelengths, at_once)]
    if len(blocks) > 1 and getattr(settings, "field_file", None):
        raise TwilightError(
            f"solver.field_file: holds the field of up to {at_once} wavelengths, and {config.title} has "
            f"{medium.n_wavelengths}"
        )
    more: dict[str, Any] = (
        {"sun_elevations_deg": [sun.elevation_deg for sun in suns]} if hasattr(solver, "TAKES_SUNS") else {}
    )
    results = [_Radiance() for _ in suns]
    elevation, azimuth = _texture(config)
    meter = _Meter(tell)
    several = len(suns) > 1
    phase = 1.0 / (len(blocks) * (1 + len(suns)))
    for b, block in enumerate(blocks):
        start = b * (1 + len(suns)) * phase
        begin = time.perf_counter()
        part = medium if len(blocks) == 1 else medium.select(block)
        meter.phase("all suns" if several else "", start, phase)
        made = solver.prepare(part, settings, observer_altitude_km=config.observer.altitude_km, progress=meter, **more)
        beam = _Sunbeam(part, config.observer.altitude_km)
        set_up_s += time.perf_counter() - begin
        for s, (sun, result) in enumerate(zip(suns, results, strict=True)):
            begin = time.perf_counter()
            meter.phase(sun.name if several else "", start + (1 + s) * phase, phase)
            _evaluate(made, sun, elevation, azimuth, config.texture.latlong_width, result)
            _direct(beam, sun, result)
            result.seconds += time.perf_counter() - begin
            if b == len(blocks) - 1:
                yield _frame(config, plan, medium, sun, result, (name, quality), set_up_s)
                results[s] = _Radiance()
    tell("done", 1.0)


class _Meter:
    """Turns a solver's progress within one phase of the work into progress of the whole; it never goes back."""

    def __init__(self, tell: Progress):
        self.tell = tell
        self.label = ""
        self.done = self.start = self.span = 0.0

    def phase(self, label: str, start: float, span: float) -> None:
        self.label, self.start, self.span = label, start, span
        self("", 0.0)

    def __call__(self, doing: str | float, share: float | str) -> None:
        if isinstance(share, str):  # montecarlo tells the share first
            doing, share = share, doing
        self.done = max(self.done, self.start + self.span * min(max(float(share), 0.0), 1.0))
        self.tell(f"{self.label} {doing}".strip(), self.done)


def resolve_solver_of(config: Config) -> tuple[str, str, Any]:
    """(solver, quality, settings) of a validated configuration."""
    from twilight.config.validate import Origins

    return resolve_solver(config.solver, Origins())


def resolved_configuration(config: Config, section: SunElevation | SunAt) -> dict[str, Any]:
    """The configuration of one frame with every default written out, as JSON values; rendering it gives the frame.

    Tables of the climate are named by their files' names and the SHA-256 of their content, not by where they were.
    """
    data = config.model_copy(update={"sun": section, "vary": {}}).model_dump(mode="json", exclude_none=True)
    data["solver"] = complete_solver(config.solver)
    rows, columns = config.texture.shape
    data["texture"] = {"elevation_count": rows, "azimuth_count": columns}
    if config.texture.latlong_width is not None:
        data["texture"]["latlong_width"] = config.texture.latlong_width
    wavelength_nm = wavelengths_of(config)
    if wavelength_nm is not None:
        data["wavelengths"] = {"list_nm": wavelength_nm.tolist()}
    name_by_content(data["climate"])
    for holder, _, name, _ in climate_files(data["climate"]):
        holder[name] = Path(holder[name]).name
    if config.climate.medium is not None:
        for key in ("atmosphere", "gases", "refraction"):
            data["climate"].pop(key)
    return data


def _frame(
    config: Config,
    plan: Plan,
    medium: Medium,
    sun: SunPosition,
    result: _Radiance,
    solver: tuple[str, str],
    set_up_s: float,
) -> Frame:
    configuration = resolved_configuration(config, sun.section)
    provenance = {
        "version": __version__,
        "configuration": configuration,
        "hash": configuration_hash(configuration),
        "run_time_s": set_up_s + result.seconds,
        "set_up_time_s": set_up_s,
        "solver": solver[0],
        "quality": solver[1],
        "left_out": [item.part for item in plan.left_out],
    }
    if result.convergence:
        provenance["convergence"] = result.convergence
    if result.facts:
        provenance["model"] = result.facts
    place = sun.section if isinstance(sun.section, SunAt) else None

    def sky(texture: list, error: list, elevation: np.ndarray, azimuth: np.ndarray) -> Sky:
        return Sky(
            wavelength_nm=medium.wavelength_nm,
            elevation_deg=elevation,
            azimuth_deg=azimuth,
            sun_normalised_radiance=np.concatenate(texture, axis=-1),
            sun_elevation_deg=sun.elevation_deg,
            sun_azimuth_deg=sun.azimuth_deg,
            distance_au=sun.distance_au,
            observer_altitude_km=config.observer.altitude_km,
            latitude_deg=place.latitude_deg if place else None,
            longitude_deg=place.longitude_deg if place else None,
            time=sun.time,
            ground_albedo=medium.ground_albedo,
            standard_error=np.concatenate(error, axis=-1) if error else None,
            direct_irradiance=np.concatenate(result.direct),
            apparent_sun_elevation_deg=sun.elevation_deg + result.bending_deg,
            solar_spectrum=config.solar_spectrum,
            night_radiance=_night(config, medium, sun, elevation, azimuth),
            provenance=provenance,
        )

    panorama = None
    if config.texture.latlong_width is not None:
        grid = latlong_grid(config.texture.latlong_width, sun.azimuth_deg)
        panorama = sky(result.panorama, result.panorama_error, *grid)
    return Frame(sun.name, sky(result.texture, result.texture_error, *_texture(config)), panorama)


def _night(
    config: Config, medium: Medium, sun: SunPosition, elevation: np.ndarray, azimuth: np.ndarray
) -> np.ndarray | None:
    """Radiance of the night sky (E, A, W) where the configuration asks for it."""
    if config.night is None:
        return None
    from twilight.night import NightLevels, Place, night_radiance

    at = sun.section
    place = Place(at.latitude_deg, at.longitude_deg, sun.time) if isinstance(at, SunAt) and sun.time else None
    return night_radiance(
        medium,
        elevation,
        azimuth,
        NightLevels(**config.night.model_dump()),
        sun_elevation_deg=sun.elevation_deg,
        sun_azimuth_deg=sun.azimuth_deg,
        place=place,
        observer_altitude_km=config.observer.altitude_km,
    )


def _texture(config: Config) -> tuple[np.ndarray, np.ndarray]:
    """Elevations of the rows and azimuths of the columns of the texture [deg]."""
    rows, columns = config.texture.shape
    return (np.arange(rows) + 0.5) * (90.0 / rows), np.arange(columns) * (360.0 / columns)


def _evaluate(
    made: Any, sun: SunPosition, elevation: np.ndarray, azimuth: np.ndarray, width: int | None, result: _Radiance
) -> None:
    grids = [(elevation, azimuth, result.texture, result.texture_error)]
    if width is not None:
        grids.append((*latlong_grid(width, sun.azimuth_deg), result.panorama, result.panorama_error))
    for rows, columns, values, errors in grids:
        value, error = _on_grid(made, sun.elevation_deg, rows, columns)
        values.append(value)
        if error is not None:
            errors.append(error)
    result.facts.update(getattr(made, "facts", {}))
    converged = getattr(made, "convergence", None)
    if converged is not None:  # the worst block of wavelengths
        worst = result.convergence
        for key in ("events", "residual", "error"):
            here = getattr(converged, key, None)
            if here is not None:
                worst[key] = max(worst.get(key, here), here)


def _on_grid(
    made: Any, sun_elevation_deg: float, elevation: np.ndarray, azimuth: np.ndarray
) -> tuple[np.ndarray, np.ndarray | None]:
    """Radiance (E, A, W) and its standard error where the solver has one.

    The sky is its own mirror image about the sun's vertical: a deterministic solver is asked for one half only.
    """
    stochastic = hasattr(made, "radiance_with_error")
    columns, back = np.arange(azimuth.size), np.arange(azimuth.size)
    if not stochastic:
        folded = np.round(np.minimum(azimuth, 360.0 - azimuth), 9)
        _, columns, back = np.unique(folded, return_index=True, return_inverse=True)
    grid = np.meshgrid(elevation, azimuth[columns], indexing="ij")
    if stochastic:
        result = made.radiance_with_error(sun_elevation_deg, *grid)
        # few samples of a faint pixel may average below 0, which no sky is; its standard error says how little it means
        return np.maximum(result.radiance, 0.0), result.standard_error
    return made.radiance(sun_elevation_deg, *grid)[:, back], None


class _Sunbeam:
    """Direct sunlight at the observer; its tables are made for the first sun that can reach it."""

    DARK_BELOW_HORIZON_DEG = 2.0
    """Refraction lifts the sun by 1.2 deg at most at the horizon, down and up again (Haber 2005 sec. 4.4: below 2)."""

    def __init__(self, medium: Medium, altitude_km: float):
        self.medium, self.altitude_km = medium, altitude_km
        radius = medium.earth_radius_km
        self.dip_deg = float(np.degrees(np.arccos(radius / (radius + max(altitude_km, 0.0)))))
        self.made: Any = None

    def at(self, sun_elevation_deg: float) -> tuple[np.ndarray, float]:
        """(irradiance at normal incidence over F0 (W,), bending [deg])."""
        out = np.zeros(self.medium.n_wavelengths)
        if sun_elevation_deg < -self.dip_deg - self.DARK_BELOW_HORIZON_DEG:
            return out, 0.0
        from twilight.transport.beam import beam_at, prepare_beam

        if self.made is None:
            self.made = prepare_beam(self.medium)
        bending = beam_at(self.made, self.altitude_km, np.sin(np.radians(sun_elevation_deg)), out)
        return out, float(np.degrees(bending)) if out.any() else 0.0


def _direct(beam: _Sunbeam, sun: SunPosition, result: _Radiance) -> None:
    direct, result.bending_deg = beam.at(sun.elevation_deg)
    result.direct.append(direct)


def suns_of(config: Config) -> Iterator[SunPosition]:
    """The positions of the sun of a configuration, one by one."""
    sun = config.sun
    if isinstance(sun, SunElevation):
        yield SunPosition(_elevation_name(sun.elevation_deg), sun, sun.elevation_deg, distance_au=sun.distance_au)
    elif isinstance(sun, SunElevations):
        for elevation in sun.elevations_deg:
            one = SunElevation(elevation_deg=elevation, distance_au=sun.distance_au)
            yield SunPosition(_elevation_name(elevation), one, elevation, distance_au=sun.distance_au)
    else:
        from twilight.sun.ephemeris import sun_position

        for moment in _moments(sun):
            place = {key: getattr(sun, key) for key in ("latitude_deg", "longitude_deg", "time_zone")}
            one_at = SunAt(at=moment, **place)
            at = sun_position(moment, sun.latitude_deg, sun.longitude_deg, config.observer.altitude_km)
            name = moment.strftime("%Y-%m-%dT%H%M%S" if moment.second else "%Y-%m-%dT%H%M")
            yield SunPosition(
                name, one_at, float(at.elevation_deg), float(at.azimuth_deg), float(at.distance_au), moment
            )


def _elevation_name(elevation_deg: float) -> str:
    return f"sun{elevation_deg:+06.2f}"


def _moments(sun: SunAt | SunInterval) -> list[datetime]:
    """The times with their offsets; a daylight-saving change within an interval does not disturb the steps."""
    if isinstance(sun, SunAt):
        return [sun.aware(sun.at)]
    start, stop = sun.aware(sun.start), sun.aware(sun.stop)
    step = timedelta(minutes=sun.step_minutes)
    count = int((stop.timestamp() - start.timestamp()) / step.total_seconds() + 1e-9) + 1
    return [datetime.fromtimestamp(start.timestamp() + i * step.total_seconds(), start.tzinfo) for i in range(count)]


__all__ = ["Frame", "Progress", "check_size", "count_frames", "frames", "resolved_configuration", "run"]
