"""prepare: solve a field, at a quality or to a target error, or read it from a file; its cost before it is solved.

Settings for a target error are those of the cheapest quality that has it in air of this kind, known before anything is
solved.  The errors of the qualities were measured beside Monte-Carlo references in thirteen climates
(`benchmarks/zones_error.py`).  They depend on how low the sun is and on what kind of particles there are, which is
known beforehand: fine ones, coarse ones (dust and sea salt, whose phase functions need the degree to grow), or some
high up.
"""

import math
import warnings
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np

from twilight.atmosphere.medium import Medium, observer_at
from twilight.base.errors import TwilightWarning
from twilight.base.progress import Progress, silent
from twilight.solvers.base import Convergence
from twilight.solvers.zones import constants as tuned
from twilight.solvers.zones.air_needs import degree_needed, thin_layers
from twilight.solvers.zones.field import ZonesField
from twilight.solvers.zones.grids import FieldGrids, spectral_groups, zenith_range
from twilight.solvers.zones.orders import solve
from twilight.solvers.zones.scattering import Solution
from twilight.solvers.zones.settings import QUALITIES, ZonesSettings
from twilight.solvers.zones.storage import field_hash, read, stored_hash

MAX_COMPARED_DEPTH = 100.0
"""Vertical optical depth of scattering, forward peaks left out, up to which thick air of conservative scattering was
compared with doubling (`tests/solvers/test_zones_thick.py`)."""
PEAKED_ASYMMETRY = 0.88
"""Asymmetry parameter of an aerosol beyond which errors of `standard` exceed 2 % (`benchmarks/odd_air.py`)."""
PEAKED_ERRORS = {"draft": (21, 7), "standard": (17, 5)}
"""Largest errors [%] by quality, the coarsest first, some 15 deg from a sun at 15 and 40 deg in air of asymmetry 0.98
and depth 0.5 and 1, beside `montecarlo`: 0.5 deg above the horizon and higher up (`benchmarks/results/sharp_peaks.csv`,
whose reference has a standard error of 1 to 2 %)."""
PEAKED_DEPTH = 0.02
"""Vertical optical depth of such an aerosol from which on it counts: at 0.026 the light after sunset is 16 to 48 % off,
seen from 33 km (case 159 of `benchmarks/odd_air.py`)."""
HIGH_KM = 10.0
"""Base [km] of a thin layer from which on the light that leaks along it after sunset was compared in one case alone."""
MAX_DEPTH_RATIO = 1000.0
"""Ratio of the optical depths of two wavelengths beyond which the grid that serves both may be wrong for the thinner:
at draft by 0.25 % where it is 10, 0.6 % at 100, 1.3 % at 1000, sun at -6 deg."""


def carried(settings: ZonesSettings) -> bool:
    """Whether the fitted model may carry light over the spectrum: it has all orders and all physics."""
    physics = ("polarisation", "refraction", "bent_lines_of_sight", "bent_paths")
    whole = settings.max_orders > 1 and all(getattr(settings, key) for key in physics)
    return whole and settings.spectrum == "auto" and not settings.field_file and not settings.target_error


class Errors(NamedTuple):
    """Largest errors [%] that 95 % of the radiances stay within, over the climates of a kind.

    day: sun above LAST_DAY_DEG; twilight: above LAST_TWILIGHT_DEG; deep: below
    """

    day: float
    twilight: float
    deep: float


LAST_DAY_DEG = -7.5
"""Sun elevation [deg] down to which the errors of +30 to -6 deg hold."""
LAST_TWILIGHT_DEG = -13.0
"""Sun elevation [deg] down to which those of -9 and -12 deg hold; below, that of -18 deg."""
SAFETY_FACTORS = {"fine": 1.45, "coarse": 1.45, "aloft": 2.1}
"""Factor of safety for air that is none of the climates, by its kind: each climate in turn left out of the table, its
errors stay within so many times the largest of the others of its kind (benchmarks/results/target_error.csv).  High up
there are but two, far apart."""
MEASURED_ERRORS: dict[str, dict[str, Errors]] = {
    "draft": {"fine": Errors(1.4, 2.1, 2.3), "coarse": Errors(1.7, 2.4, 2.8), "aloft": Errors(3.3, 4.5, 3.8)},
    "standard": {"fine": Errors(0.9, 1.6, 1.8), "coarse": Errors(1.2, 1.5, 1.6), "aloft": Errors(1.4, 1.5, 4.0)},
    "reference": {"fine": Errors(0.4, 0.8, 0.2)},
}
"""By quality, the cheapest first, and kind of air (benchmarks/results/zones_error.csv);
`reference`: continental air alone."""


NOT_OF_QUALITY = (
    *("max_orders", "polarisation", "refraction", "bent_lines_of_sight", "bent_paths"),
    *("target_error", "spectrum", "field_file"),
)
"""Settings that stay as they are where a target error chooses the quality: physics, the target and the file."""


def kind_of(medium: Medium) -> str:
    """`aloft` where there are particles high up, `coarse` beside dust or sea salt, else `fine`; one for a spectrum."""
    medium = medium.at_grid_wavelengths or medium
    scattering = medium.aerosol_extinction_per_km * medium.aerosol_single_scattering_albedo
    z = medium.altitude_km
    high = np.where(z[:, None] >= tuned.ALOFT_KM, scattering, 0.0)
    if np.trapezoid(high, z, axis=0).max() > tuned.LEAST_ALOFT_DEPTH:
        return "aloft"
    standard = QUALITIES["standard"]
    return "coarse" if degree_needed(standard, medium) > standard.degree else "fine"


def expected_error(quality: str, medium: Medium, sun_elevations_deg: Sequence[float] | None) -> float:
    """Fraction that 95 % of errors are expected to stay within at a quality, for the lowest of the suns; None: any.

    Infinite where the quality was not measured in such air.
    """
    kind = kind_of(medium)
    errors = MEASURED_ERRORS[quality].get(kind)
    if errors is None:
        return math.inf
    lowest = -90.0 if sun_elevations_deg is None else min(sun_elevations_deg)
    ranges = 1 if lowest >= LAST_DAY_DEG else 2 if lowest >= LAST_TWILIGHT_DEG else 3
    return 0.01 * SAFETY_FACTORS[kind] * max(errors[:ranges])


def quality_for(
    settings: ZonesSettings, medium: Medium, sun_elevations_deg: Sequence[float] | None
) -> tuple[str, float]:
    """The cheapest quality that has the target error, and the error expected of it; the best where none has."""
    errors = [(name, expected_error(name, medium, sun_elevations_deg)) for name in MEASURED_ERRORS]
    return next((row for row in errors if row[1] <= settings.target_error), errors[-1])


def at_quality(settings: ZonesSettings, name: str) -> ZonesSettings:
    """The settings with the grids of a quality; those NOT_OF_QUALITY stay as they are."""
    return replace(QUALITIES[name], **{key: getattr(settings, key) for key in NOT_OF_QUALITY})


def settings_to_solve(
    medium: Medium, settings: ZonesSettings, sun_elevations_deg: Sequence[float] | None
) -> tuple[ZonesSettings, float | None]:
    """The settings that a field is solved with: those asked for, or where they have a target error those of the quality
    that reaches it, with the fraction that 95 % of its errors are expected to stay within."""
    if not settings.target_error:
        return settings, None
    name, expected = quality_for(settings, medium, sun_elevations_deg)
    return at_quality(settings, name), expected


def prepare(
    medium: Medium,
    settings: ZonesSettings | None = None,
    *,
    observer_altitude_km: float = 0.0,
    progress: Progress | None = None,
    sun_elevations_deg: Sequence[float] | None = None,
) -> ZonesField:
    """Solve the field of a medium, for every position of the sun or for those of a scene, as of `solvers.base.Solver`.

    All wavelengths share one set of grids, as fine as any of them needs.  Wavelengths of one range of a climate
    (`twilight.atmosphere.grid_medium`) need the same grids; others are moved by as much as the quality leaves open, and
    `twilight.engine` solves them apart.

    Errors: TwilightError for an observer below the ground, and a field file that cannot be written.  Warns where
    target_error is not reached, max_orders end the solution before tolerance does, the air is one in which `zones` was
    found wrong or not compared, and where wavelengths of optical depths in a ratio of more than MAX_DEPTH_RATIO need
    different grids."""
    settings = settings or QUALITIES["standard"]
    needed = zenith_range(medium, sun_elevations_deg, observer_altitude_km)
    if settings.field_file:
        stored = stored_hash(settings.field_file)
        for extent in (needed, (0.0, tuned.LAST_ZENITH_DEG)):
            if stored is not None and stored == field_hash(medium, settings, extent):
                field = load(settings.field_file, observer_altitude_km=observer_altitude_km)
                _warn(field, settings)
                return field
    _warn_of_neighbours(medium, settings)
    chosen, expected = settings_to_solve(medium, settings, sun_elevations_deg)
    observer_at(medium, observer_altitude_km)
    grids = FieldGrids.of(medium, chosen, needed)
    progress = progress or silent
    progress("sunbeam", 0.0)
    beam = grids.sunbeam()
    solutions: Sequence[Solution] = ()
    convergence: Convergence | None = None
    if chosen.max_orders > 1:
        solutions, convergence = solve(grids, beam, progress)
    progress("field", 1.0)
    field = ZonesField(grids, beam, solutions, convergence, observer_altitude_km)
    if expected is not None:
        field.convergence = replace(field.convergence or Convergence(1, 0.0), error=expected)
        field.requested_settings = settings
    _warn(field, settings)
    if settings.field_file:
        field.save(settings.field_file)
    return field


def _warn_of_neighbours(medium: Medium, settings: ZonesSettings) -> None:
    """Say that one grid cannot serve all wavelengths of a medium, where it is known to matter."""
    if medium.at_grid_wavelengths is not None:
        return
    depth = np.trapezoid(medium.extinction_per_km, medium.altitude_km, axis=0)
    depth = depth[depth > 0.0]
    if (
        depth.size > 1
        and depth.max() > MAX_DEPTH_RATIO * depth.min()
        and len(set(spectral_groups(medium, settings))) > 1
    ):
        warnings.warn(
            f"the medium's wavelengths have optical depths from {depth.min():.2g} to {depth.max():.2g} and need "
            "different grids: solved in one field the thinner ones may be off by more than 1 %; solve them apart, as "
            "twilight.engine does",
            TwilightWarning,
            stacklevel=3,
        )


def _warn(field: ZonesField, settings: ZonesSettings) -> None:
    """Say what a user should know about a field, solved here or read from a file."""
    for doubt in _doubts(field, settings):
        warnings.warn(doubt, TwilightWarning, stacklevel=3)


def _doubts(field: ZonesField, settings: ZonesSettings) -> Iterator[str]:
    """Sentences on what may be wrong with a field, which was asked for with these settings."""
    convergence, solved = field.convergence, field.settings
    if convergence and settings.tolerance > 0.0 and convergence.residual >= solved.tolerance:
        yield (
            f"solver.max_orders {settings.max_orders} was not enough: the last order still moved the light by "
            f"{convergence.residual:.2g} of itself, and solver.expert.tolerance is {solved.tolerance:g}"
        )
    if convergence and convergence.error is not None and convergence.error > settings.target_error:
        known = (
            f"which is within {convergence.error:.2g} at 95 % of the directions in such air"
            if math.isfinite(convergence.error)
            else "which was not measured in such air"
        )
        target = f"solver.target_error {settings.target_error:g}"
        yield f"{target} is not known to be reached: quality reference was taken, {known}"
    if settings.max_orders == 1:
        return
    profile = field.grids.profile
    depth = float(np.trapezoid(profile.scattering, profile.altitude_km, axis=0).max())
    if depth > MAX_COMPARED_DEPTH:
        yield (
            f"the air scatters with an optical depth of {depth:.0f} from the ground to its top: the light of the zones "
            f"solver was compared with other solutions up to {MAX_COMPARED_DEPTH:g}, and may be wrong beyond"
        )
    peak, peaked_depth = _sharpest_peak(field.medium)
    if peak > PEAKED_ASYMMETRY:
        coarse = [name for name in PEAKED_ERRORS if solved.max_degree <= QUALITIES[name].max_degree]
        known = "reference was not compared"
        if coarse:
            at_horizon, above = PEAKED_ERRORS[coarse[0]]
            known = f"{coarse[0]} is up to {at_horizon} % off at the horizon 15 deg from the sun, {above} % higher up"
        yield (
            f"an aerosol of asymmetry {peak:.2g} scatters more sharply forward than the series of the zones solver can "
            f"follow: at an asymmetry of 0.98 and optical depths to 1 quality {known}; here the depth is "
            f"{peaked_depth:.2g}"
        )
    layers, layer_depth = thin_layers(profile)
    base = layers[:, 0]
    high = base >= HIGH_KM
    if high.any() and field.sun_range_deg[0] < 0.0:
        yield (
            f"a layer of optical depth {layer_depth[high][0]:.2g}, thinner than 2 km, at {base[high][0]:.3g} km: with "
            "the sun below the horizon light leaks along it by tens of scatterings; the zones solver was compared with "
            "the reference solution for one such layer alone, 1 km of optical depth 1 at 50 km, sun at -6 deg, where "
            "standard is 1.5 to 3.7 % darker"
        )


def _sharpest_peak(medium: Medium) -> tuple[float, float]:
    """(the largest asymmetry parameter of the kinds of aerosol that there is more of than PEAKED_DEPTH, and the largest
    vertical optical depth of that kind); zeros where there is none."""
    peaks = [(0.0, 0.0)]
    for phase, fraction in zip(medium.phase_functions, medium.aerosol_phase_fraction, strict=True):
        depth = np.trapezoid(medium.aerosol_extinction_per_km * fraction, medium.altitude_km, axis=0).max()
        if depth > PEAKED_DEPTH:
            peaks.append((float(phase.legendre_moments(1)[:, 1].max()), float(depth)))
    return max(peaks)


def load(path: str | Path, *, observer_altitude_km: float = 0.0) -> ZonesField:
    """Read a field that `ZonesField.save` wrote.  Errors: TwilightError for a file that is missing, broken or none."""
    stored = read(path)
    grids = FieldGrids.of(stored.medium, stored.settings, stored.zenith_range_deg)
    field = ZonesField(grids, stored.beam, stored.solutions, stored.convergence, observer_altitude_km)
    field.requested_settings = stored.requested_settings
    return field
