"""Air cut into layers so fine that light is as smooth as in the air that they were cut from.

Every jump has a node altitude, is an end of steps along rays and has rows of its own in the sunbeam's tables.  At one
whose coefficients a below and b above differ by no more than SMALL_JUMP of the extinction, one level with sqrt(a b)
takes the place of both: the mean over a layer between two such jumps, each a change by e^d, grows by a fraction of
d^2/24, 1e-4 at most.
"""

from dataclasses import replace

import numpy as np

from twilight.atmosphere.grid_medium import GridMedium
from twilight.atmosphere.medium import ON_LEVELS, Medium
from twilight.solvers.zones import constants as tuned


def without_small_jumps(medium: Medium) -> Medium:
    """The medium, and the air that its grids are laid out for, with one level at each small jump."""
    doubled = np.flatnonzero(np.diff(medium.altitude_km) <= 0.0)
    if not doubled.size:
        return medium
    fixed = medium.at_grid_wavelengths
    if fixed is not None and not np.array_equal(fixed.altitude_km, medium.altitude_km):
        return medium
    small = _small(medium, doubled) & (True if fixed is None else _small(fixed, doubled))
    # of three levels at one altitude the middle one belongs to two jumps
    small &= ~np.isin(doubled + 1, doubled) & ~np.isin(doubled - 1, doubled)
    lower = doubled[small]
    if not lower.size:
        return medium
    joined = _joined(medium, lower)
    return joined if fixed is None else replace(joined, grid_medium=GridMedium.of(_joined(fixed, lower)))


def _small(medium: Medium, lower: np.ndarray) -> np.ndarray:
    """Whether the jumps between the levels `lower` and the next ones are small at every wavelength."""
    scattered = medium.aerosol_extinction_per_km * medium.aerosol_single_scattering_albedo
    parts = (
        medium.air_scattering_per_km, medium.absorption_per_km, medium.aerosol_extinction_per_km, scattered,
        *(scattered * fraction for fraction in medium.aerosol_phase_fraction),
    )  # fmt: skip
    extinction = medium.extinction_per_km
    least = np.minimum(extinction[lower], extinction[lower + 1])
    small = np.all([np.abs(x[lower + 1] - x[lower]) <= tuned.SMALL_JUMP * least for x in parts], axis=(0, 2))
    n = medium.refractivity
    return small & np.all(np.abs(n[lower + 1] - n[lower]) <= tuned.SMALL_JUMP * n[lower], axis=1)


def _joined(medium: Medium, lower: np.ndarray) -> Medium:
    """The medium with one level in place of each level `lower` and the next one."""

    def joined(values: np.ndarray) -> np.ndarray:
        a, b = values[lower], values[lower + 1]
        values = values.copy()
        values[lower] = np.where((a > 0.0) & (b > 0.0), np.sqrt(a * b), 0.5 * (a + b))
        return np.delete(values, lower + 1, axis=0)

    fractions = np.array([joined(fraction) for fraction in medium.aerosol_phase_fraction])
    fractions = fractions.reshape(len(medium.phase_functions), -1, medium.n_wavelengths)
    total = fractions.sum(axis=0)
    return replace(
        medium,
        altitude_km=np.delete(medium.altitude_km, lower + 1),
        aerosol_phase_fraction=fractions / np.where(total > 0.0, total, 1.0),
        **{key: joined(getattr(medium, key)) for key in ON_LEVELS},  # type: ignore[arg-type]
    )
