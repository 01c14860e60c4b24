"""Coefficients on levels fine enough for linear interpolation: what kernels march through."""

from typing import NamedTuple

import numpy as np

from twilight.atmosphere.medium import Medium
from twilight.jit.kernels import njit

BIN_KM = 0.05
"""Width of the bins of altitude by which `locate` finds a level [km]."""

SMOOTH_STEP_KM = 0.5
"""Altitude that a step may cross at the ground where the air is not layered [km]."""

SMOOTH_STEP_GROWTH = 0.08
"""By how much of the height above the ground SMOOTH_STEP_KM grows."""

SMOOTH_CHANGE = 0.6
"""Air is not layered where ln of its coefficients changes by no more than this over SMOOTH_STEP_KM, grown."""

SMOOTH_PER_KM = 0.6
"""Air is not layered where ln of its coefficients changes by no more than this per km: the stratosphere never is."""

LAYER_STEP = 0.35
"""Change of ln of a coefficient between two stops, beyond that of air that is not layered."""

EXPECTED_PER_KM = 0.4
"""Extinction that steps are made for at the ground [km^-1]."""

EXPECTED_SCALE_KM = 4.0
"""Scale height of EXPECTED_PER_KM [km]."""

EXPECTED_HIGH_PER_KM = 0.025
"""Least extinction that steps are made for, at any altitude [km^-1]."""

EXPECTED_FACTORS = ((1.0, 4.0), (1.0, 4.0, 16.0))
"""Multiples of the expected extinction, of its part that falls with altitude and of its least, that steps are made for.

The smallest that hold all of the air are taken, so that many wavelengths have equal steps; in air that exceeds the
largest steps follow the extinction itself.
"""

GUIDE_PER_KM = 0.1
"""Extinction at the ground by which the one point of a step is placed, the same for all wavelengths [km^-1]."""

GUIDE_SCALE_KM = 7.0
"""Scale height of GUIDE_PER_KM [km]."""

NEGLIGIBLE = 1e-26
"""Scattering optical depth of a step, over that of all the air if it is thin, below which the step is left out."""

FAINTEST = 1e-280
"""Least scattering optical depth that counts at all: below, double precision loses its digits."""

THIN_PER_KM = 3e-6
"""Coefficient below which air is not layered, whatever its changes [km^-1]."""

FOOT = 0.02
"""A layer is resolved down to this fraction of its largest coefficient: what it adds below is lost in its rest."""

CLOSE_KM = 1e-6
"""Least distance of two breaks [km]."""

SUDDEN_KM = 0.02
"""A change by e within this altitude is a break: nothing is interpolated across it [km]."""

JUMP = 0.05
"""Change of ln of a coefficient at a doubled level up to which the light in the air is smooth there."""


class Profile(NamedTuple):
    """Air of N refined levels at W wavelengths, with K aerosol phase functions, as kernels march through it.

    altitude_km (N,); a doubled level is a jump
    extinction, scattering: (N, W) totals [km^-1]; species_scattering: (1 + K, N, W), air first
    level_of_bin: for each BIN_KM of altitude the last level at or below the bin's start
    stop_km (S,): altitudes that no step crosses: bottom, top, jumps, and where the air is layered as many as it needs
    break_km: those stops that are jumps or the ends of sudden changes, without the bottom and the top
    sharp_km: those breaks at which the light is not smooth: coefficients change by more than JUMP
    gradient_per_km (N,): d ln n/dz that bends rays, 0 where they are straight
    thickest_per_km (N,): extinction by which steps are shortened: the expected one, or the largest of all wavelengths
    guide_per_km (N,): extinction by which the one point of a step is placed: the guide, or where steps follow the
        largest extinction, that one
    clearest_per_km (N,): extinction of the clearest of the wavelengths that steps are made for, behind whose optical
        depth they grow
    negligible (W,): scattering optical depth of a step below which it is left out, at each wavelength
    """

    altitude_km: np.ndarray
    extinction: np.ndarray
    scattering: np.ndarray
    species_scattering: np.ndarray
    level_of_bin: np.ndarray
    stop_km: np.ndarray
    break_km: np.ndarray
    sharp_km: np.ndarray
    gradient_per_km: np.ndarray
    thickest_per_km: np.ndarray
    guide_per_km: np.ndarray
    clearest_per_km: np.ndarray
    negligible: np.ndarray
    earth_radius_km: float


def prepare_profile(
    medium: Medium, max_thickness_km: float = 0.5, tolerance: float = 2e-4, like: Medium | None = None
) -> Profile:
    """The levels of a medium refined until linear interpolation between them is good to `tolerance`; straight rays.

    like: the same levels at other wavelengths, which say what levels are inserted and how rays step; None: the medium.
    """
    fine = medium.refined(max_thickness_km, tolerance, like)
    stepping = fine if like is None else like.refined(max_thickness_km, tolerance)
    aerosol = fine.aerosol_extinction_per_km * fine.aerosol_single_scattering_albedo
    species = np.concatenate([fine.air_scattering_per_km[None], aerosol[None] * fine.aerosol_phase_fraction])
    z = fine.altitude_km
    starts = z[0] + BIN_KM * np.arange(int(np.ceil((z[-1] - z[0]) / BIN_KM)) + 1)
    level = np.clip(np.searchsorted(z, starts, side="right") - 1, 0, z.size - 2)
    stops, breaks, sharp = _stops(z, np.concatenate([stepping.extinction_per_km, _scattering(stepping)], axis=1))
    largest = stepping.extinction_per_km.max(axis=1)
    expected = expected_extinction(z, expected_factors(z, largest) or (1.0, 1.0))
    guide = GUIDE_PER_KM * np.exp((z[0] - z) / GUIDE_SCALE_KM)
    scattering = species.sum(axis=0)
    return Profile(
        np.ascontiguousarray(z),
        np.ascontiguousarray(fine.extinction_per_km),
        np.ascontiguousarray(scattering),
        np.ascontiguousarray(species),
        level.astype(np.int64),
        stops,
        breaks,
        sharp,
        np.zeros(z.size),
        np.maximum(expected, largest),
        np.where(largest > expected, largest, guide),
        np.ascontiguousarray(stepping.extinction_per_km.min(axis=1)),
        np.maximum(FAINTEST, NEGLIGIBLE * np.minimum(1.0, np.trapezoid(scattering, z, axis=0))),
        float(medium.earth_radius_km),
    )


def with_steps_of(profile: Profile, other: Profile, factors: tuple[float, float]) -> Profile:
    """The profile with the stops and breaks of another profile of the same air.

    Steps are made for what the other expects, or for `expected_extinction` times factors, whichever is more; the
    profile's own coefficients may exceed that.
    """
    z = profile.altitude_km
    # beside a jump the larger of both sides
    sides = [np.clip(z + side * CLOSE_KM, z[0], z[-1]) for side in (-1.0, 1.0)]
    thickest, guide = (
        np.maximum(*(np.interp(at, other.altitude_km, values) for at in sides))
        for values in (other.thickest_per_km, other.guide_per_km)
    )
    return profile._replace(
        stop_km=other.stop_km,
        break_km=other.break_km,
        sharp_km=other.sharp_km,
        thickest_per_km=np.maximum(thickest, expected_extinction(z, factors)),
        guide_per_km=guide,
        clearest_per_km=np.interp(z, other.altitude_km, other.clearest_per_km),
    )


def at_wavelengths(profile: Profile, part: slice) -> Profile:
    """The profile at some of its wavelengths, with the steps that it has for all."""
    return profile._replace(
        extinction=np.ascontiguousarray(profile.extinction[:, part]),
        scattering=np.ascontiguousarray(profile.scattering[:, part]),
        species_scattering=np.ascontiguousarray(profile.species_scattering[:, :, part]),
        negligible=profile.negligible[part].copy(),
    )


def _scattering(medium: Medium) -> np.ndarray:
    aerosol = medium.aerosol_extinction_per_km * medium.aerosol_single_scattering_albedo
    return medium.air_scattering_per_km + (aerosol[None] * medium.aerosol_phase_fraction).sum(axis=0)


def expected_extinction(altitude_km: np.ndarray, factors: tuple[float, float] = (1.0, 1.0)) -> np.ndarray:
    """Extinction [km^-1] that steps are made for at levels (N,).

    factors: on its part that falls with altitude, and on its least.
    """
    falling = EXPECTED_PER_KM * np.exp((altitude_km[0] - altitude_km) / EXPECTED_SCALE_KM)
    return np.maximum(factors[0] * falling, factors[1] * EXPECTED_HIGH_PER_KM)


def expected_factors(altitude_km: np.ndarray, extinction_per_km: np.ndarray) -> tuple[float, float] | None:
    """The least EXPECTED_FACTORS with which extinction (N,) is no larger than expected; None where none are."""
    height = altitude_km - altitude_km[0]
    high = height > EXPECTED_SCALE_KM * np.log(EXPECTED_PER_KM / EXPECTED_HIGH_PER_KM)
    ratio = extinction_per_km / expected_extinction(altitude_km)
    least = [
        next((f for f in factors if np.max(ratio[part], initial=0.0) <= f), None)
        for part, factors in zip((~high, high), EXPECTED_FACTORS, strict=True)
    ]
    return None if least[0] is None or least[1] is None else (least[0], least[1])


def _stops(altitude_km: np.ndarray, per_km: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """`stop_km`, `break_km` and `sharp_km` of coefficients per_km (N, C) at levels altitude_km (N,)."""
    z = altitude_km
    thickness = np.diff(z)
    step = SMOOTH_STEP_KM + SMOOTH_STEP_GROWTH * (z[:-1] - z[0])
    smooth = thickness * np.maximum(SMOOTH_CHANGE / step, SMOOTH_PER_KM)
    # the largest coefficient of the run of steep intervals that a level belongs to
    steep = np.abs(np.diff(np.log(np.maximum(per_km, THIN_PER_KM)), axis=0)) > smooth[:, None]
    foot = np.full(per_km.shape, THIN_PER_KM)
    for c in range(per_km.shape[1]):
        ends = np.flatnonzero(np.diff(np.concatenate([[0], steep[:, c].astype(np.int8), [0]])))
        for first, last in zip(ends[::2], ends[1::2], strict=True):
            run = slice(first, last + 1)
            foot[run, c] = np.maximum(foot[run, c], FOOT * per_km[run, c].max())
    floor = np.maximum(foot[1:], foot[:-1])
    change = np.abs(np.log(np.maximum(per_km[1:], floor)) - np.log(np.maximum(per_km[:-1], floor)))
    excess = np.maximum(0.0, change - smooth[:, None])
    sudden = (thickness > 0) & (change.max(axis=1) > thickness / SUDDEN_KM)
    ends = np.concatenate([[False], sudden[1:] != sudden[:-1], [False]])
    begins = ends | np.insert(thickness <= 0.0, 0, False)
    breaks = z[begins]
    sharp = z[ends | np.insert((thickness <= 0.0) & (change.max(axis=1) > JUMP), 0, False)]
    stops = [z[0], z[-1], *breaks]
    since = np.zeros(per_km.shape[1])
    for i in range(thickness.size):
        if begins[i]:
            since = np.zeros_like(since)
        since = since + excess[i]
        if np.any(since > LAYER_STEP):
            stops += [z[i], z[i + 1]]
            since = np.zeros_like(since)
    breaks = np.unique(breaks)
    breaks = breaks[np.diff(breaks, prepend=-np.inf) > CLOSE_KM]
    breaks = breaks[(breaks > z[0]) & (breaks < z[-1])]
    return np.unique(stops), breaks, breaks[np.isin(breaks, sharp)]


@njit(inner=True, cache=True, makes_arrays=False)
def locate(profile, z):
    """(i, f): level below the altitude z [km] and fraction of the way to level i + 1; z is clamped to the profile.

    profile: `Profile`.
    """
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
