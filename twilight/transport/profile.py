"""Coefficients on levels fine enough for linear interpolation: what kernels march through."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit

from twilight.atmosphere.medium import Medium

BIN_KM = 0.05
LAYER_STEP = 0.35
"""Change of the logarithm of the extinction within one step up or down."""
THIN_PER_KM = 1e-5


class Profile(NamedTuple):
    """N refined levels, W wavelengths, K aerosol phase functions.

    altitude_km (N,); a doubled level is a jump.
    extinction, scattering: (N, W) totals [km^-1]; species_scattering: (1 + K, N, W), air first.
    level_of_bin: for each BIN_KM of altitude the last level at or below the bin's start.
    layer_step_km (N,): how far up or down one step may go from a level without missing a layer.
    """

    altitude_km: np.ndarray
    extinction: np.ndarray
    scattering: np.ndarray
    species_scattering: np.ndarray
    level_of_bin: np.ndarray
    layer_step_km: np.ndarray
    earth_radius_km: float


def prepare_profile(medium: Medium, max_thickness_km: float = 0.5, tolerance: float = 2e-4) -> Profile:
    """Refine a medium until linear interpolation of its coefficients is good to `tolerance`."""
    fine = medium.refined(max_thickness_km, tolerance)
    aerosol = fine.aerosol_extinction_per_km * fine.aerosol_single_scattering_albedo
    species = np.concatenate([fine.air_scattering_per_km[None], aerosol[None] * fine.aerosol_share])
    z = fine.altitude_km
    starts = z[0] + BIN_KM * np.arange(int(np.ceil((z[-1] - z[0]) / BIN_KM)) + 1)
    level = np.clip(np.searchsorted(z, starts, side="right") - 1, 0, z.size - 2)
    return Profile(
        np.ascontiguousarray(z),
        np.ascontiguousarray(fine.extinction_per_km),
        np.ascontiguousarray(species.sum(axis=0)),
        np.ascontiguousarray(species),
        level.astype(np.int64),
        _layer_steps(z, fine.extinction_per_km),
        float(medium.earth_radius_km),
    )


def _layer_steps(altitude_km: np.ndarray, extinction_per_km: np.ndarray) -> np.ndarray:
    """Steps [km] that change the logarithm of the extinction by LAYER_STEP at most, there and on the way there."""
    thickness = np.diff(altitude_km)
    change = np.abs(np.diff(np.log(np.maximum(extinction_per_km, THIN_PER_KM)), axis=0)).max(axis=1)
    inside = np.where(thickness > 0, LAYER_STEP * thickness / np.maximum(change, 1e-9), np.inf)
    step = np.minimum(np.append(inside, np.inf), np.insert(inside, 0, np.inf))
    for k in range(1, step.size):
        step[k] = min(step[k], step[k - 1] + thickness[k - 1])
    for k in range(step.size - 2, -1, -1):
        step[k] = min(step[k], step[k + 1] + thickness[k])
    return step


@njit(cache=True)
def locate(profile, z):
    """(i, f): level index below z and the fraction of the way to level i + 1; z is clamped to the profile."""
    levels = profile.altitude_km
    last = levels.size - 1
    if z <= levels[0]:
        return 0, 0.0
    if z >= levels[last]:
        return last - 1, 1.0
    i = profile.level_of_bin[int((z - levels[0]) / BIN_KM)]
    while levels[i + 1] <= z:
        i += 1
    return i, (z - levels[i]) / (levels[i + 1] - levels[i])
