"""Bands of water vapour and oxygen between 300 and 1000 nm as exponential sums (k-distributions).

A band is thousands of lines, and light of 10 nm does not fall exponentially in it.  The source is SPCTRL2 (Bird and
Riordan 1984, SERI/TR-215-2436; coefficients after Leckner 1978, as shipped by pvlib): of the absorber along a slant
path that holds m times the vertical column,

    T(m) = exp(-s x / (1 + b x)^0.45),  x = a(wavelength) m W (water vapour, W in cm), x = a m p / 1013 hPa (oxygen)

The exponent has a completely monotone derivative, so T is a mixture of exponentials with weights that are not negative
(Bernstein):

    T(m) = sum_i w_i exp(-k_i m),  sum_i w_i = 1,  radiance = sum_i w_i L_i.

Few terms are enough: within FIT_ERROR of T for m from 0.5 to 12.  A term is grey absorption with a vertical optical
depth k_i; its radiance L_i solves a transfer equation as that of any other wavelength.  Where both gases absorb, the
terms of one are multiplied with those of the other, as SPCTRL2 multiplies their transmissions.

With altitude a term absorbs as n (p / 1013 hPa)^P (273 K / T)^Q, n the density of the gas: the scaled amounts of
LOWTRAN 7 (Kneizys et al. 1988), with its exponents; spectral lines are narrower in thin air.  The scaling gives the
fraction of the column at each altitude above the ground, whatever the ground's altitude.

Between the source's wavelengths `a` goes linearly; next to a wavelength where it is 0 it is 0 from EDGE_NM on.
SPCTRL2 has no band of oxygen at 629 nm.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np

from twilight.atmosphere.levels import layer_mean, vertical_integral
from twilight.atmosphere.medium import Medium
from twilight.atmosphere.profiles import AirProfile
from twilight.base.conventions import ROUNDING
from twilight.base.errors import TwilightError
from twilight.base.shipped_data import data_numbers

WATER_VAPOUR = "water vapour"

OXYGEN = "oxygen"

GASES = (WATER_VAPOUR, OXYGEN)
"""Absorbers whose bands are exponential sums."""

STRENGTH = {WATER_VAPOUR: 0.2385, OXYGEN: 1.41}
"""s of SPCTRL2's transmission."""

SATURATION = {WATER_VAPOUR: 20.07, OXYGEN: 118.3}
"""b of SPCTRL2's transmission (118.3 as in NREL's program; the report has 118.93)."""

GROWTH = 0.45
"""Exponent of SPCTRL2's transmission."""

EDGE_NM = 5.0
"""Half of SPCTRL2's resolution [nm]: from so far beside a wavelength of 0 a coefficient is 0."""

STANDARD_HPA = 1013.0
"""Pressure at which SPCTRL2's coefficients hold [hPa]."""

ICE_POINT_K = 273.15
"""Temperature to which LOWTRAN's amounts are scaled [K]."""

PRESSURE_SCALING = {
    WATER_VAPOUR: ((0.0, 0.6656, 0.5061), (622.7, 0.6642, 0.2764), (672.8, 0.8088, 0.2816), (765.0, 0.7982, 0.0588),
                   (866.4, 0.8874, -0.2576)),
    OXYGEN: ((0.0, 0.9353, 0.1936),),
}  # fmt: skip
"""From which wavelength [nm] on, and the exponents P and Q of pressure and temperature: LOWTRAN 7."""

WATER_G_PER_MOLECULE = 18.01528 / 6.02214076e23
"""Molar mass of water [g mol^-1] over Avogadro's number (SI 2019)."""

FIT_ERROR = 0.008
"""Error of the exponential sum that is aimed at, of T and relative to it in WELL_FITTED_MASSES (test_bands.py)."""

MOST_TERMS = 5
"""Terms of the exponential sum at most: enough for FIT_ERROR in all columns of water that there are."""

FITTED_MASSES = np.geomspace(0.02, 40.0, 90)
"""Air masses m at which the exponential sum is fitted."""

WELL_FITTED_MASSES = (0.5, 12.0)
"""Range of m in which the error is FIT_ERROR relative to T; 12 is a sun 4 deg above the horizon."""

MOST_LOG_DEPTH = 100.0
"""ln of a term's optical depth beyond which a fit looks no further: no light passes long before."""

WEAK = 1e-3
"""A gas that absorbs less than this fraction over the largest of FITTED_MASSES has no terms."""


@dataclass(frozen=True)
class GasBands:
    """Terms of the exponential sums of a medium with L levels and W wavelengths, N in all, ordered by wavelength.

    wavelength_index (N,): which of the medium's wavelengths a term belongs to; every one has one term at least
    weight (N,): w_i of the terms, not negative, of sum 1 at each wavelength
    absorption_per_km (L, N): of the term, in addition to the medium's own absorption [km^-1]"""

    wavelength_index: np.ndarray
    weight: np.ndarray
    absorption_per_km: np.ndarray

    def __post_init__(self) -> None:
        sums = np.bincount(self.wavelength_index, self.weight)
        if (
            np.any(np.diff(self.wavelength_index) < 0)
            or np.any(self.weight < 0)
            or not np.allclose(sums, 1.0, atol=ROUNDING)
        ):
            raise TwilightError("bands: the terms of each wavelength need weights that are not negative and sum to 1")

    @property
    def term_counts(self) -> np.ndarray:
        """How many terms each wavelength has, (W,)."""
        return np.bincount(self.wavelength_index)

    def select(self, part: slice | np.ndarray) -> GasBands:
        """The terms of some of the wavelengths, a range or ascending indices, which count from 0 again."""
        wanted = np.arange(part.start, part.stop) if isinstance(part, slice) else part
        inside = np.isin(self.wavelength_index, wanted)
        return GasBands(
            np.searchsorted(wanted, self.wavelength_index[inside]),
            self.weight[inside],
            self.absorption_per_km[:, inside],
        )

    def expand(self, medium: Medium, terms: np.ndarray | None = None) -> Medium:
        """The medium with a column for each term instead of each wavelength; its grid medium is air without bands.

        terms: indices (n,) of some of the terms, which alone are columns; None: all.
        """
        which = slice(None) if terms is None else terms
        wide = medium.select(self.wavelength_index[which])
        without = medium.grid_medium and medium.grid_medium.for_any_optics()
        absorption = wide.absorption_per_km + self.absorption_per_km[:, which]
        return replace(wide, absorption_per_km=absorption, grid_medium=without)

    def sum_terms(self, values: np.ndarray) -> np.ndarray:
        """Weighted sums (..., W) over the terms of each wavelength, from values of the terms (..., N)."""
        return np.add.reduceat(
            values * self.weight, np.searchsorted(self.wavelength_index, np.arange(self.term_counts.size)), axis=-1
        )


@lru_cache(maxsize=1)
def _source() -> tuple[np.ndarray, dict[str, np.ndarray]]:
    wavelength, water, mixed = data_numbers("gases/spectrl2_bands.csv")[1].T
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


PLANNED_PER_DECADE = 5
"""Amounts of a gas in each factor of ten for which a plan fits exponential sums; a fit costs 0.05 processor s."""


@lru_cache(maxsize=4096)
def terms(gas: str, amount: float) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """Weights (sum 1) and vertical optical depths of the fewest terms that give the transmission of m columns.

    amount: x of one vertical column.  Within FIT_ERROR, relative to the transmission, for m in WELL_FITTED_MASSES; of
    1 below; with MOST_TERMS terms at most, which is enough for the columns of water that there are.
    """
    from scipy.optimize import least_squares  # start-up

    true = transmission(gas, amount * FITTED_MASSES)
    if true[-1] > 1.0 - WEAK:
        return (1.0,), (0.0,)
    well = (FITTED_MASSES >= WELL_FITTED_MASSES[0]) & (FITTED_MASSES <= WELL_FITTED_MASSES[1])
    scale = 1.0 / np.where(FITTED_MASSES <= WELL_FITTED_MASSES[1], true, np.maximum(true, 0.02))
    depth = -float(np.log(transmission(gas, amount)))

    def parts(parameters: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        logarithm, rates = np.split(parameters, 2)
        weight = np.exp(logarithm - logarithm.max())
        return weight / weight.sum(), np.exp(np.minimum(rates, MOST_LOG_DEPTH))

    def error(parameters: np.ndarray) -> np.ndarray:
        weight, rate = parts(parameters)
        return np.exp(-np.outer(FITTED_MASSES, rate)) @ weight - true

    def derivatives(parameters: np.ndarray) -> np.ndarray:
        weight, rate = parts(parameters)
        depths = np.outer(FITTED_MASSES, rate)
        passed = np.exp(-depths)
        return np.concatenate([passed - (passed @ weight)[:, None], -depths * passed], axis=1) * np.tile(weight, 2)

    for n in range(1, MOST_TERMS + 1):
        first = np.geomspace(0.1 * depth, 30.0 * depth, n) if n > 1 else np.array([depth])
        start = np.concatenate([np.zeros(n), np.log(first)])
        jacobian = {"jac": lambda p: derivatives(p) * scale[:, None]}
        best = least_squares(lambda p: error(p) * scale, start, max_nfev=300, **jacobian).x
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
    own = water_column_mm(profile)
    column = own if column_mm is None else column_mm
    if own == 0.0 and column > 0.0:
        raise TwilightError(
            f"gases.water_vapour.column_mm is {column:g}, but the levels have no water vapour at any altitude; allowed "
            "is 0"
        )
    return coefficient(gas, wavelength_nm) * 0.1 * column


def make_gas_bands(
    medium: Medium,
    full: AirProfile,
    gases: tuple[str, ...] = GASES,
    water_vapour_mm: float | None = None,
    *,
    layers: bool = False,
    for_plan: bool = False,
) -> GasBands | None:
    """The exponential sums of a medium that was built from a whole profile; None where no wavelength lies in a band.

    water_vapour_mm: precipitable water above the ground; None: the profile's own.  layers: the medium is homogeneous
    between its levels, and takes means.  for_plan: amounts are rounded to PLANNED_PER_DECADE, so that few sums are
    fitted; how many terms they have is then about right.
    """
    profile = full.above(medium.bottom_km)
    nm = medium.wavelength_nm
    paths = {gas: amounts(gas, profile, nm, water_vapour_mm) for gas in gases}
    wavelength_index, weight, columns = [], [], []
    shapes: dict[tuple[str, int], np.ndarray] = {}
    for w in range(nm.size):
        sums = [(1.0, np.zeros(medium.altitude_km.size))]
        for gas, x in paths.items():
            row = int(np.searchsorted([edge for edge, _, _ in PRESSURE_SCALING[gas]], nm[w], side="right")) - 1
            amount = float(x[w])
            if for_plan and amount > 0.0:
                amount = 10.0 ** (round(PLANNED_PER_DECADE * math.log10(amount)) / PLANNED_PER_DECADE)
            weights, depths = terms(gas, amount)
            if len(weights) == 1 and depths[0] == 0.0:
                continue
            if (gas, row) not in shapes:
                _, pressure, temperature = PRESSURE_SCALING[gas][row]
                shapes[gas, row] = _shape(gas, profile, medium, pressure, temperature, layers)
            shape = shapes[gas, row]
            sums = [(q * s, k + d * shape) for q, k in sums for s, d in zip(weights, depths, strict=True)]
        wavelength_index += [w] * len(sums)
        weight += [q for q, _ in sums]
        columns += [k for _, k in sums]
    absorption = np.stack(columns, axis=1)
    return GasBands(np.array(wavelength_index), np.array(weight), absorption) if absorption.any() else None


def _shape(
    gas: str, profile: AirProfile, medium: Medium, pressure: float, temperature: float, layers: bool
) -> np.ndarray:
    """Density over the scaled column [km^-1] at the levels of a medium, (L,), with an integral of 1."""
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
    return at / float(vertical_integral(at, levels))
