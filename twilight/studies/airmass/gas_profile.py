"""Altitude profiles of an absorber: of the scene's model atmosphere, or of the user's own table."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from twilight.atmosphere.csv_columns import read_columns
from twilight.atmosphere.levels import interpolate_coefficient, layer_mean
from twilight.atmosphere.profiles import load_profile
from twilight.base.errors import TwilightError

GASES = ("o3", "no2")
"""Gases whose profiles come with the model atmospheres."""
COLUMNS = {"altitude_km": (-1e6, 1e6, "-1e6 to 1e6"), "density_per_cm3": (0.0, 1e300, "0 to 1e300")}
"""Columns of a user's profile, and the numbers that they may hold."""


@dataclass(frozen=True)
class GasProfile:
    """Number density (Z,) [cm^-3] at altitudes (Z,) [km], exponential in between."""

    name: str
    altitude_km: np.ndarray
    density_per_cm3: np.ndarray

    def columns_per_cm2(self, edges_km: np.ndarray) -> np.ndarray:
        """Vertical columns (J,) [cm^-2] between altitudes (J + 1,) [km]; outside the profile there is none."""
        z = self.altitude_km
        levels = np.union1d(z, np.clip(edges_km, z[0], z[-1]))
        i = np.clip(np.searchsorted(z, levels, side="right") - 1, 0, z.size - 2)
        f = (levels - z[i]) / (z[i + 1] - z[i])
        density = interpolate_coefficient(self.density_per_cm3[i], self.density_per_cm3[i + 1], f)
        column = layer_mean(density[:-1], density[1:]) * np.diff(levels) * 1e5
        middle = 0.5 * (levels[1:] + levels[:-1])
        return np.histogram(middle, edges_km, weights=column)[0]


def of_atmosphere(gas: str, atmosphere: str) -> GasProfile:
    """The profile of `o3` or `no2` in one of the AFGL atmospheres.

    Errors: TwilightError for another gas.
    """
    if gas not in GASES:
        raise TwilightError(f"--gas: {gas} is in no model atmosphere; allowed are {', '.join(GASES)}, or --profile")
    profile = load_profile(atmosphere)
    return GasProfile(gas, profile.altitude_km, getattr(profile, f"{gas}_per_cm3"))


def read_profile(path: str | Path, name: str) -> GasProfile:
    """A profile from a CSV file with the columns altitude_km and density_per_cm3.

    Errors: TwilightError for a file that is not such a table.
    """
    _, rows, _ = read_columns(Path(path), COLUMNS, others=True)
    altitude, density = rows.T
    if altitude.size < 2 or not np.all(np.diff(altitude) > 0.0):
        raise TwilightError(f"{path}: altitude_km must hold two or more numbers that increase")
    return GasProfile(name, altitude, density)
