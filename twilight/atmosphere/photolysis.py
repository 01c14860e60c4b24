"""Photolysis: what light of a wavelength does to a molecule, as cross section times quantum yield.

    J = int sigma(lambda, T) phi(lambda, T) F(lambda) dlambda,  F = actinic flux [photons cm^-2 s^-1 nm^-1]

| reaction | cross section | quantum yield |
|---|---|---|
| NO2 -> NO + O(3P) | Vandaele et al. 1998 (`atmosphere.gases`) | JPL 2011, 248 and 298 K |
| O3 -> O2 + O(1D) | Serdyuchenko et al. 2014, Malicet et al. 1995 | Matsumi et al. 2002, 200 to 320 K |
| O3 -> O2 + O(3P) | the same | what the other channel of O3 leaves of 1 |
| NO3 -> NO + O2 | JPL 2011, 298 K, with its dependence on temperature | JPL 2011, 190, 230 and 298 K |
| NO3 -> NO2 + O(3P) | the same | the same; 1 below 585 nm |

JPL 2011: Sander et al., JPL Publication 10-6; Matsumi et al.: J. Geophys. Res. 107, 4024.  Tables are in
data/photolysis (its SOURCES.md).  They are linear in wavelength and temperature, and keep the edge values outside the
tabulated temperatures.
"""

from __future__ import annotations

from functools import lru_cache
from typing import NamedTuple

import numpy as np

from twilight.atmosphere.gases import TemperatureTable, cross_section
from twilight.base.errors import TwilightError


class Reaction(NamedTuple):
    """A reaction by light.

    equation: as chemists write it; first_nm, last_nm: range of wavelengths in which it goes on below 100 km and down to
    the ground, beyond which less than 1 % of it does.
    """

    equation: str
    first_nm: float
    last_nm: float


REACTIONS = {
    "no2": Reaction("NO2 -> NO + O(3P)", 300.0, 422.0),
    "o3_o1d": Reaction("O3 -> O2 + O(1D)", 290.0, 340.0),
    "o3_o3p": Reaction("O3 -> O2 + O(3P)", 300.0, 800.0),
    "no3_no": Reaction("NO3 -> NO + O2", 585.0, 640.0),
    "no3_no2": Reaction("NO3 -> NO2 + O(3P)", 410.0, 640.0),
}
"""By the names that files and commands use."""

_TABLES = {"no2": "no2_yield", "no3_no": "no3_no_yield", "no3_no2": "no3_no2_yield", "no3": "no3_cross_section"}
NO3_ROOM_K = 298.0
"""Temperature of NO3's table of cross sections [K]."""


@lru_cache(maxsize=len(_TABLES))
def _table(name: str) -> TemperatureTable:
    return TemperatureTable.read(f"photolysis/{_TABLES[name]}_jpl2011.csv")


def _interpolate(name: str, nm: np.ndarray, kelvin: np.ndarray, below: float) -> np.ndarray:
    """A table at temperatures and wavelengths, (Z, W): `below` below its first wavelength, 0 above its last one."""
    return _table(name).at(nm, kelvin, below, 0.0)


def excited_oxygen_yield(nm: np.ndarray, kelvin: np.ndarray) -> np.ndarray:
    """Atoms O(1D) per photon that ozone absorbs, (Z, W): Matsumi et al. 2002, for 200 to 320 K.

    0.90 below 305 nm (down to 280 nm), their sum of three peaks to 328 nm, 0.08 to 340 nm, 0 beyond.
    """
    t, w = kelvin[:, None], nm[None, :]
    lower = 1.0 / (1.0 + np.exp(-825.518 / (0.695 * t)))
    peaks = (
        0.8036 * lower * np.exp(-(((304.225 - w) / 5.576) ** 4))
        + 8.9061 * (1.0 - lower) * (t / 300.0) ** 2 * np.exp(-(((314.957 - w) / 6.601) ** 2))
        + 0.1192 * (t / 300.0) ** 1.5 * np.exp(-(((310.737 - w) / 2.187) ** 2))
        + 0.0765
    )
    return np.select([w <= 305.0, w <= 328.0, w <= 340.0], [0.90 + 0.0 * t, peaks, 0.08 + 0.0 * t], 0.0)


def no3_cross_section(nm: np.ndarray, kelvin: np.ndarray) -> np.ndarray:
    """Of NO3 [cm^2 per molecule], (Z, W), 403 to 691 nm; its temperature dependence is that of the peak at 662 nm."""

    def ground_state(t):
        return 1.0 - np.exp(-1096.4 / t) - 2.0 * np.exp(-529.5 / t)

    room = _interpolate("no3", nm, np.full(kelvin.size, NO3_ROOM_K), 0.0)
    return room * (ground_state(kelvin) / ground_state(NO3_ROOM_K))[:, None]


def effective_cross_section(reaction: str, wavelength_nm: np.ndarray, temperature_k: np.ndarray) -> np.ndarray:
    """Cross section times quantum yield [cm^2 per molecule], (Z, W).

    Parameters
    ----------
    reaction
        One of REACTIONS.
    wavelength_nm : (W,)
        280 to 1000 nm.
    temperature_k : (Z,)
        Of the air [K].

    Raises
    ------
    TwilightError
        For a reaction that is not known.
    """
    nm, kelvin = np.asarray(wavelength_nm, dtype=float), np.asarray(temperature_k, dtype=float)
    if reaction not in REACTIONS:
        raise TwilightError(f"reaction: {reaction} is not known; allowed are {', '.join(REACTIONS)}")
    if reaction == "no2":
        return cross_section("no2", nm, kelvin) * _interpolate("no2", nm, kelvin, 1.0)
    if reaction.startswith("o3"):
        excited = excited_oxygen_yield(nm, kelvin)
        return cross_section("o3", nm, kelvin) * (excited if reaction == "o3_o1d" else 1.0 - excited)
    below = 1.0 if reaction == "no3_no2" else 0.0
    return no3_cross_section(nm, kelvin) * _interpolate(reaction, nm, kelvin, below)
