"""Bands of water vapour and oxygen between 300 and 1000 nm, as sums of exponentials.

A band is thousands of lines, and light of 10 nm does not fall exponentially in it.  The source is SPCTRL2 (Bird and
Riordan 1984, SERI/TR-215-2436; coefficients after Leckner 1978, as shipped by pvlib): of the absorber along a slant
path that holds m times the vertical column,

    T(m) = exp(-s x / (1 + b x)^0.45),  x = a(wavelength) m W (water vapour, W in cm), x = a m p / 1013 hPa (oxygen)

The exponent has a completely monotone derivative, so T is a mixture of exponentials with weights that are not negative
(Bernstein):

    T(m) = sum_i w_i exp(-k_i m),  sum_i w_i = 1.

Few terms are enough: within FIT_ERROR of T for m from 0.5 to 12.  Each term is a lane: grey absorption with a vertical
optical depth k_i, for which a transfer equation is solved as at any other wavelength; the light is the weighted sum.
Where both gases absorb their terms are multiplied, as SPCTRL2 multiplies their transmissions.

With altitude a lane absorbs as n (p / 1013 hPa)^P (273 K / T)^Q, n the density of the gas: the scaled amounts of
LOWTRAN 7 (Kneizys et al. 1988), with its exponents; lines are narrower in thin air.  What is scaled so is the share of
the column that is above the ground, whatever the ground's altitude.

Between the source's wavelengths `a` goes linearly; next to a wavelength where it is 0 it is 0 from EDGE_NM on.
SPCTRL2 has no band of oxygen at 629 nm.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache
from importlib import resources

import numpy as np

from twilight.atmosphere.medium import Medium, layer_mean
from twilight.atmosphere.profiles import AirProfile, load_profile
from twilight.atmosphere.reference import Reference
from twilight.errors import TwilightError

WATER_VAPOUR, OXYGEN = "water vapour", "oxygen"
GASES = (WATER_VAPOUR, OXYGEN)

STRENGTH = {WATER_VAPOUR: 0.2385, OXYGEN: 1.41}
SATURATION = {WATER_VAPOUR: 20.07, OXYGEN: 118.3}
GROWTH = 0.45
"""s, b and the exponent of SPCTRL2's transmission (118.3 as in NREL's program; the report has 118.93)."""

EDGE_NM = 5.0
"""Half of SPCTRL2's resolution."""

STANDARD_HPA = 1013.0
ICE_POINT_K = 273.15

PRESSURE_SCALING = {
    WATER_VAPOUR: ((0.0, 0.6656, 0.5061), (622.7, 0.6642, 0.2764), (672.8, 0.8088, 0.2816), (765.0, 0.7982, 0.0588),
                   (866.4, 0.8874, -0.2576)),
    OXYGEN: ((0.0, 0.9353, 0.1936),),
}  # fmt: skip
"""From which wavelength [nm] on, and the exponents P and Q of pressure and temperature: LOWTRAN 7."""

WATER_G_PER_MOLECULE = 18.01528 / 6.02214076e23

FIT_ERROR = 0.008
MOST_TERMS = 5
FITTED_MASSES = np.geomspace(0.02, 40.0, 90)
WELL_FITTED_MASSES = (0.5, 12.0)
LARGEST_MASS = 40.0
"""About what the sun's light crosses of either gas on its longest path."""
WEAK = 1e-3
"""A gas that takes less than this over LARGEST_MASS columns has no terms."""


@dataclass(frozen=True)
class Bands:
    """Lanes of a medium with L levels, N in all, in the order of their wavelengths.

    place (N,): which of the medium's wavelengths; weight (N,): sums to 1 over the lanes of a wavelength.
    absorption_per_km (L, N): in addition to the medium's own.
    """

    place: np.ndarray
    weight: np.ndarray
    absorption_per_km: np.ndarray

    def __post_init__(self) -> None:
        sums = np.bincount(self.place, self.weight)
        if np.any(np.diff(self.place) < 0) or np.any(self.weight < 0) or not np.allclose(sums, 1.0, atol=1e-9):
            raise TwilightError("bands: the lanes of each wavelength need weights that are not negative and sum to 1")

    @property
    def lanes(self) -> np.ndarray:
        """How many lanes each wavelength has, (W,)."""
        return np.bincount(self.place)

    def select(self, part: slice) -> Bands:
        """The lanes of some of the wavelengths, which count from 0 again."""
        inside = (self.place >= part.start) & (self.place < part.stop)
        return Bands(self.place[inside] - part.start, self.weight[inside], self.absorption_per_km[:, inside])

    def expand(self, medium: Medium) -> Medium:
        """The medium with a column for each lane instead of each wavelength, and the reference of the air without."""
        wide = medium.select(self.place)
        wide = replace(wide, absorption_per_km=wide.absorption_per_km + self.absorption_per_km)
        return wide if medium.reference is None else wide.with_reference(Reference.of(medium.reference))

    def summed(self, values: np.ndarray) -> np.ndarray:
        """From values of the lanes (..., N) those of the wavelengths (..., W)."""
        return np.add.reduceat(values * self.weight, np.searchsorted(self.place, np.arange(self.lanes.size)), axis=-1)


@lru_cache(maxsize=1)
def _source() -> tuple[np.ndarray, dict[str, np.ndarray]]:
    path = resources.files("twilight") / "data" / "gases" / "spectrl2_bands.csv"
    with path.open(encoding="utf-8") as file:
        wavelength, water, mixed = np.loadtxt(file, delimiter=",", skiprows=1, unpack=True)
    return wavelength, {WATER_VAPOUR: water, OXYGEN: mixed}


def coefficient(gas: str, wavelength_nm: np.ndarray) -> np.ndarray:
    """SPCTRL2's a at wavelengths [nm] (W,): of water vapour [cm^-1 of precipitable water], of oxygen [1]."""
    at, columns = _source()
    value = columns[gas]
    points = dict(zip(at.tolist(), value.tolist(), strict=True))
    for i in np.flatnonzero(value[:-1] > 0.0):  # the last is beyond 1000 nm
        points |= {float(at[i] + side * EDGE_NM): 0.0 for side in (-1, 1) if value[i + side] == 0.0}
    nm, a = np.array(sorted(points.items())).T
    return np.interp(wavelength_nm, nm, a)


def transmission(gas: str, amount: np.ndarray | float) -> np.ndarray:
    """SPCTRL2's transmission for amounts x = a m W; completely monotone, 1 for 0."""
    x = np.asarray(amount, dtype=float)
    return np.exp(-STRENGTH[gas] * x / (1.0 + SATURATION[gas] * x) ** GROWTH)


@lru_cache(maxsize=4096)
def terms(gas: str, amount: float) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """Weights (sum 1) and vertical optical depths of the fewest terms that give the transmission of m columns.

    amount: x of one vertical column.  Within FIT_ERROR, relative to the transmission, for m in WELL_FITTED_MASSES; of
    1 below; with MOST_TERMS terms at most, which is enough for the columns of water that there are.
    """
    from scipy.optimize import least_squares

    true = transmission(gas, amount * FITTED_MASSES)
    if true[-1] > 1.0 - WEAK:
        return (1.0,), (0.0,)
    well = (FITTED_MASSES >= WELL_FITTED_MASSES[0]) & (FITTED_MASSES <= WELL_FITTED_MASSES[1])
    scale = 1.0 / np.where(FITTED_MASSES <= WELL_FITTED_MASSES[1], true, np.maximum(true, 0.02))
    depth = -float(np.log(transmission(gas, amount)))

    def parts(parameters: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        logarithm, rates = np.split(parameters, 2)
        weight = np.exp(logarithm - logarithm.max())
        return weight / weight.sum(), np.exp(rates)

    def error(parameters: np.ndarray) -> np.ndarray:
        weight, rate = parts(parameters)
        return np.exp(-np.outer(FITTED_MASSES, rate)) @ weight - true

    for n in range(1, MOST_TERMS + 1):
        first = np.geomspace(0.1 * depth, 30.0 * depth, n) if n > 1 else np.array([depth])
        start = np.concatenate([np.zeros(n), np.log(first)])
        best = least_squares(lambda p: error(p) * scale, start, max_nfev=300).x
        left = np.abs(error(best))
        if left.max() < FIT_ERROR and (left / true)[well].max() < FIT_ERROR:
            break
    weight, rate = parts(best)
    order = np.argsort(rate)
    return tuple(weight[order].tolist()), tuple(rate[order].tolist())


def water_column_mm(profile: AirProfile) -> float:
    """Precipitable water [mm] of a profile: its column as a liquid of 1 g cm^-3."""
    return 10.0 * profile.column_per_cm2(profile.h2o_per_cm3) * WATER_G_PER_MOLECULE


def amounts(gas: str, profile: AirProfile, wavelength_nm: np.ndarray, column_mm: float | None) -> np.ndarray:
    """SPCTRL2's x of one vertical column above the ground of a profile, (W,); column_mm: of water, None: its own."""
    if gas == OXYGEN:
        return coefficient(gas, wavelength_nm) * float(profile.pressure_hpa[0]) / STANDARD_HPA
    column = water_column_mm(profile) if column_mm is None else column_mm
    return coefficient(gas, wavelength_nm) * 0.1 * column


def make_bands(
    medium: Medium,
    profile_name: str,
    gases: tuple[str, ...] = GASES,
    water_vapour_mm: float | None = None,
    *,
    layers: bool = False,
) -> Bands | None:
    """The lanes of a medium that was built from a profile; None where none of its wavelengths lies in a band.

    water_vapour_mm: precipitable water above the ground; None: the profile's own.  layers: the medium is homogeneous
    between its levels, and takes means.
    """
    profile = load_profile(profile_name).above(medium.bottom_km)
    nm = medium.wavelength_nm
    found = {gas: amounts(gas, profile, nm, water_vapour_mm) for gas in gases}
    place, weight, columns = [], [], []
    shapes: dict[tuple[str, int], np.ndarray] = {}
    for w in range(nm.size):
        lanes = [(1.0, np.zeros(medium.altitude_km.size))]
        for gas, x in found.items():
            row = int(np.searchsorted([edge for edge, _, _ in PRESSURE_SCALING[gas]], nm[w], side="right")) - 1
            shares, depths = terms(gas, float(x[w]))
            if len(shares) == 1 and depths[0] == 0.0:
                continue
            if (gas, row) not in shapes:
                _, pressure, temperature = PRESSURE_SCALING[gas][row]
                shapes[gas, row] = _shape(gas, profile, medium, pressure, temperature, layers)
            shape = shapes[gas, row]
            lanes = [(q * s, k + d * shape) for q, k in lanes for s, d in zip(shares, depths, strict=True)]
        place += [w] * len(lanes)
        weight += [q for q, _ in lanes]
        columns += [k for _, k in lanes]
    absorption = np.stack(columns, axis=1)
    return Bands(np.array(place), np.array(weight), absorption) if absorption.any() else None


def _shape(
    gas: str, profile: AirProfile, medium: Medium, pressure: float, temperature: float, layers: bool
) -> np.ndarray:
    """Share of the scaled column [km^-1] at the levels of a medium, (L,), with an integral of 1."""
    levels = medium.altitude_km
    fine = np.unique(np.concatenate([profile.altitude_km[profile.altitude_km < levels[-1]], levels]))
    state = profile.at(fine)
    density = state.h2o_per_cm3 if gas == WATER_VAPOUR else state.air_per_cm3
    scaled = (
        density * (state.pressure_hpa / STANDARD_HPA) ** pressure * (ICE_POINT_K / state.temperature_k) ** temperature
    )
    if layers:
        column = np.concatenate([[0.0], np.cumsum(layer_mean(scaled[:-1], scaled[1:]) * np.diff(fine))])
        bottom, top = levels[0::2], levels[1::2]
        means = (np.interp(top, fine, column) - np.interp(bottom, fine, column)) / (top - bottom)
        at = np.repeat(means, 2)
    else:
        at = np.interp(levels, fine, scaled)
    thickness = np.diff(levels)
    return at / float(np.sum(layer_mean(at[:-1], at[1:]) * thickness))
