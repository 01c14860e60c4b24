"""The air of a medium in the layers of the model of all clear air (`clear_air.Air`), and its limits."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from twilight.atmosphere.medium import Medium
from twilight.clear_air.model import ANGLES_DEG
from twilight.clear_air.shells import AIR, ALTITUDE_KM, EXTINCTION, HIGH, LOW, MOST_DEGREE, Air, sublayers
from twilight.clear_air.skies import PEAK_DEGREE
from twilight.numerics.phase import TABLE, PhaseFunction, table_angles_rad

SPLIT_KM = 12.0
"""Altitude above the ground up to which the aerosol has the lower one of two mean phase functions [km]."""

LEAST_DEGREE = 12
"""Degree of the Legendre series that phase functions are followed to; the peak beyond counts as not scattered.  Beside
coarse particles it grows to MOST_DEGREE, as that of `zones` does (`directions.degree_needed`)."""

MOST_PEAK = 0.055
"""Fraction of the scattering in the peak up to which the degree does not grow."""

HAZE_DEPTHS = (3.0, 5.0)
"""Vertical optical depths of scattering between which the growth of the degree ends."""

LAYER_DEPTH = 0.02
"""Optical depth of scattering above 10 km from which the degree is the largest: below a volcano's layer."""

NEGLIGIBLE = 0.01
"""Fraction of the largest scattering coefficient below which air does not count."""

FEW_PARTICLES = 1e-3
"""Optical depth of aerosol below which its albedo and asymmetry mean nothing."""
FEW_HIGH = 1e-7
"""Optical depth of aerosol above 60 km beside which it does not count where it is."""

LIMITED = (
    "the optical depth of scattering by air",
    "the part of scattering by air above 39 km",
    "the optical depth of aerosol",
    "the optical depth of aerosol above 12 km",
    "the optical depth of aerosol above 60 km",
    "the single scattering albedo of the aerosol",
    "the asymmetry parameter of the aerosol below 12 km",
    "the asymmetry parameter of the aerosol above 12 km",
    "the refractivity of air at the ground, in 1e-4",
    "the part above 78 km of the aerosol above 60 km",
)
"""What must lie between the least and the largest value that the fit saw; in the words of messages."""


def air_of(medium: Medium) -> Air:
    """The air of a medium."""
    merged, fine = two_phase_functions(medium), medium.refined()
    height = fine.altitude_km - fine.bottom_km
    scattering = fine.aerosol_extinction_per_km * fine.aerosol_single_scattering_albedo
    parts = [fine.air_scattering_per_km, fine.absorption_per_km, fine.aerosol_extinction_per_km]
    high = np.interp(fine.altitude_km, medium.altitude_km, merged.aerosol_phase_fraction[1, :, 0])[:, None]
    parts += [scattering * (1.0 - high), scattering * high]
    depth = np.array([_in_layers(height, part) for part in parts])
    aerosol_depth = [_in_layers(height, scattering * fraction) for fraction in fine.aerosol_phase_fraction]
    count, (layers, n) = len(medium.phase_functions), depth.shape[1:]
    angle = table_angles_rad()
    cosine, sine = np.cos(angle), np.sin(angle)
    matrices = np.reshape([phase.matrix(cosine)[:2] for phase in medium.phase_functions], (count, 2, n, angle.size))
    mixed = []
    for phase in merged.phase_functions:
        polarising = 2.0 * np.pi * np.trapezoid(phase.matrix(cosine)[1] * sine**3, angle, axis=-1)
        mixed.append(np.column_stack([polarising, np.log(phase(np.cos(np.radians(ANGLES_DEG))))]))
    mixed_moments = np.array([phase.legendre_moments(MOST_DEGREE + 1) for phase in merged.phase_functions])
    moments = [phase.legendre_moments(PEAK_DEGREE) for phase in medium.phase_functions]
    return Air(
        depth,
        np.reshape(aerosol_depth, (count, layers, n)),
        np.full(n, _degree(depth, mixed_moments)),
        np.reshape(moments, (count, n, PEAK_DEGREE + 1)),
        mixed_moments,
        np.array(mixed),
        np.swapaxes(np.log(np.maximum(matrices[:, 0], 1e-300)), 1, 2),
        np.swapaxes(matrices[:, 1] / np.maximum(matrices[:, 0], 1e-300), 1, 2),
        medium.depolarisation,
        medium.ground_albedo,
        np.full(n, medium.refractivity[0].mean()),
        medium.at(sublayers(ALTITUDE_KM) + medium.bottom_km).refractivity[:, n // 2],
        medium.earth_radius_km + medium.bottom_km,
    )


def side_by_side(airs: list[Air]) -> Air:
    """One air of the wavelengths of all; those of fewer aerosols get empty ones; refractivity, radius of the first."""
    most = max(len(air.aerosol_depth) for air in airs)
    axis = {"moments": 1, "mixed_moments": 1, "mixed_phase": 1}

    def part(air: Air, name: str) -> np.ndarray:
        values = getattr(air, name)
        of_aerosols = name in ("aerosol_depth", "moments", "log_phase", "polarising")
        empty = -100.0 if name == "log_phase" else 0.0
        missing = [(0, most - len(values)), (0, 0), (0, 0)]
        return np.pad(values, missing, constant_values=empty) if of_aerosols else values

    joined: dict[str, Any] = {
        name: np.concatenate([part(air, name) for air in airs], axis=axis.get(name, -1)) for name in Air._fields[:-2]
    }
    return airs[0]._replace(**joined)


def slope(low: Medium, high: Medium, step: float) -> Air:
    """Change of the air for each unit of a parameter, from two media that differ by a step of it: a direction of
    `entry.ClearAir.slopes`.  What both have in the same amount has none."""
    first, last = air_of(low), air_of(high)
    change = {key: (getattr(last, key) - getattr(first, key)) / step for key in Air._fields[:-2]}
    return first._replace(**change)


def limited(air: Air) -> np.ndarray:
    """What `LIMITED` names, (10, W); nan where there are no particles to have it."""
    d = air.depth
    above = [ALTITUDE_KM[:-1] >= z for z in (SPLIT_KM, 39.0, 60.0)]
    aerosol, of_air, scattered = d[EXTINCTION].sum(axis=0), d[AIR].sum(axis=0), d[LOW] + d[HIGH]
    rows = [of_air, d[AIR][above[1]].sum(axis=0) / of_air, aerosol]
    rows += [d[EXTINCTION][above[k]].sum(axis=0) for k in (0, 2)]
    few = aerosol < FEW_PARTICLES
    rows.append(np.where(few, np.nan, scattered.sum(axis=0) / np.maximum(aerosol, FEW_PARTICLES)))
    for k, row in ((0, LOW), (1, HIGH)):
        rows.append(np.where(d[row].sum(axis=0) < FEW_PARTICLES, np.nan, air.mixed_moments[k, :, 1]))
    highest = d[EXTINCTION][ALTITUDE_KM[:-1] >= 78.0].sum(axis=0) / (rows[4] + FEW_HIGH)
    return np.stack([*rows, 1e4 * air.ground_refractivity, highest])


def two_phase_functions(medium: Medium) -> Medium:
    """The medium with one phase function below SPLIT_KM above its ground and one above: means over what scatters."""
    angle = table_angles_rad()
    cosine, z = np.cos(angle), medium.altitude_km
    high = z - medium.bottom_km > SPLIT_KM
    scattering = medium.aerosol_extinction_per_km * medium.aerosol_single_scattering_albedo
    matrices = np.array([phase.matrix(cosine) for phase in medium.phase_functions])
    matrices = matrices.reshape(len(medium.phase_functions), 4, medium.n_wavelengths, angle.size)
    thickness = np.maximum(_thickness(z), 1e-6)
    phases = []
    for name, part in (("low", ~high), ("high", high)):
        weight = np.einsum("klw,lw,l->kw", medium.aerosol_phase_fraction[:, part], scattering[part], thickness[part])
        total = weight.sum(axis=0)
        mixed = np.einsum("kw,kiwn->iwn", weight / np.maximum(total, 1e-30), matrices)
        mixed[0, total <= 0.0] = 1.0 / (4.0 * np.pi)
        sine = np.sin(angle)
        norm = 2.0 * np.pi * np.trapezoid(mixed[0] * sine, angle, axis=1)
        asymmetry = 2.0 * np.pi * np.trapezoid(mixed[0] * sine * cosine, angle, axis=1) / norm
        ratios = np.zeros((4, *mixed[0].shape))
        ratios[:3] = mixed[1:] / mixed[0]
        phases.append(PhaseFunction(TABLE, asymmetry, np.log(mixed[0] / norm[:, None]), name, ratios))
    fraction = np.zeros((2, z.size, medium.n_wavelengths))
    fraction[0, ~high], fraction[1, high] = 1.0, 1.0
    return replace(medium, phase_functions=tuple(phases), aerosol_phase_fraction=fraction)


def _thickness(altitude_km: np.ndarray) -> np.ndarray:
    """Thickness of air that each level stands for: half the distance between the levels beside it [km]."""
    step = np.diff(altitude_km)
    return 0.5 * (np.append(step, step[-1:]) + np.append(step[:1], step))


def _in_layers(height_km: np.ndarray, per_km: np.ndarray) -> np.ndarray:
    """Optical depths of the layers (L, W) of a coefficient (Z, W) at heights above the ground."""
    step = np.diff(height_km)[:, None]
    below = np.cumsum(np.concatenate([np.zeros_like(per_km[:1]), 0.5 * step * (per_km[1:] + per_km[:-1])]), axis=0)
    return np.diff(np.stack([np.interp(ALTITUDE_KM, height_km, column) for column in below.T], axis=1), axis=0)


def _degree(depth: np.ndarray, moments: np.ndarray) -> float:
    """The degree to which phase functions are followed, from depths (5, L, W) and moments (2, W, N); a fraction stands
    between two."""
    scattered = depth[LOW] + depth[HIGH]
    everything = depth[AIR] + scattered
    per_km = everything / np.diff(ALTITUDE_KM)[:, None]
    counts = (everything > 0.0) & (per_km >= NEGLIGIBLE * per_km.max(axis=0))
    part = [np.where(counts, depth[row] / np.where(counts, everything, 1.0), 0.0) for row in (LOW, HIGH)]
    degree = float(LEAST_DEGREE)
    peak = np.array(
        [sum(part[k] * moments[k, :, n + 1] for k in (0, 1)).max() for n in range(LEAST_DEGREE, MOST_DEGREE + 1)]  # type: ignore[union-attr]
    )
    large = np.flatnonzero(peak > MOST_PEAK)
    thin, thick = HAZE_DEPTHS
    grows = float(np.clip((thick - everything.sum(axis=0).max()) / (thick - thin), 0.0, 1.0))
    if large.size:
        last = int(large[-1])
        enough = float(last)
        if last + 1 < peak.size:
            enough += float((peak[last] - MOST_PEAK) / (peak[last] - peak[last + 1]))
        degree += grows * enough
    aloft = ALTITUDE_KM[:-1] >= 10.0
    if scattered[aloft].sum(axis=0).max() > LAYER_DEPTH:
        degree = float(MOST_DEGREE)
    return degree
