"""Any number of wavelengths at the price of a few: the fitted model carries a solver's light over the spectrum.

Of the light L of a solver and the light C of the fitted model of clear air (`compact`), ln(L/C) is smooth where L is
not: gas bands, ozone and aerosol are in C.  So the solver solves a few wavelengths, or terms of the exponential sums of
gas bands, the nodes n, and at each term t

    L(t) = C(t) exp(sum_n w_n(t) ln(L(n)/C(n))),   Q(t)/L(t) = Q_C(t)/C(t) + sum_n w_n(t) (Q/L - Q_C/C)(n),

U as Q.  The weights are those of kriging (Sacks, Welch, Mitchell and Wynn 1989, Statistical Science 4, 409) over the
logarithm of the wavelength and of what gas bands absorb low and high up; they depend on no direction.  Nodes are taken
one by one where the others know least, by eight, for a solver computes as many at once.

What it adds is measured, not assumed: each node is left out in turn and found from the others, which scales the
variance of kriging.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np

from twilight import solvers
from twilight.atmosphere.bands import GasBands
from twilight.atmosphere.grid_medium import range_of
from twilight.atmosphere.medium import Medium
from twilight.base.conventions import DARK
from twilight.base.errors import TwilightError
from twilight.solvers.base import BareField, Convergence

LANES = 8
"""Wavelengths, or terms, that solvers compute as one: lanes of a vector."""
MODEL = "compact"
"""The solver that carries: the fitted model of all clear air."""
LOWEST_SUN_DEG = -18.0
"""Lowest sun of the fitted model [deg]."""
HIGHEST_OBSERVER_KM = 0.1
"""Height above the ground up to which a sky has no rows below the horizontal, which the fitted model lacks."""
LOW_KM = 8.0
"""Altitude above the ground that parts what absorbs low (water vapour) from what absorbs high up (oxygen)."""
WAVELENGTH_SCALE = 0.3
"""Change of ln(wavelength) over which ln(L/C) changes in another way (benchmarks/hyperspectral.py)."""
WEAK_DEPTH = 0.1
"""Vertical optical depth of a band's absorption below LOW_KM up to which its coordinate grows in proportion."""
WEAK_HIGH_DEPTH = 0.02
"""The same above LOW_KM."""
LEVEL_VARIANCE = 10.0
"""Variance of the unknown mean of ln(L/C), relative to that about a plane."""
NUGGET = 1e-4
"""Variance of a node's own value, relative to that about a plane: solvers compute light to 1e-4."""
TOLERANCE = 0.2
"""Standard deviation of a term's ln(L/C), relative to that about a plane (1 to 2 %), at which no more nodes are taken:
adds 0.2 to 0.5 % at 95 % of directions in twilight (benchmarks/hyperspectral.py)."""
MOST_NODES = 3 * LANES
"""Most nodes of a range of wavelengths."""
AIR_MASSES = (1.0, 6.0, 30.0)
"""Air masses at which a term's part in the light of its wavelength is evaluated; the largest counts."""
LEAST_PART = 1e-3
"""Least part in its wavelength's light that a term counts with."""
SLACK = 0.05
"""How far beyond those of the nodes ln(L/C) of a term may be."""
REMEMBERED = 16
"""Questions whose light at the nodes is kept: blocks of many wavelengths begin with the same, some four each."""
COVERAGE = 1.5
"""Standard deviations of kriging that cover 95 % of what is added (benchmarks/hyperspectral.py)."""


def coordinates(medium: Medium, bands: GasBands | None) -> np.ndarray:
    """Coordinates (N, 3) of a medium's wavelengths, or of its bands' terms: wavelength, absorption low and high."""
    index = np.arange(medium.n_wavelengths) if bands is None else bands.wavelength_index
    place = np.zeros((index.size, 3))
    place[:, 0] = np.log(medium.wavelength_nm[index]) / WAVELENGTH_SCALE
    if bands is not None:
        z = medium.altitude_km
        low = (z <= medium.bottom_km + LOW_KM)[:, None]
        for column, inside, weak in ((1, low, WEAK_DEPTH), (2, ~low, WEAK_HIGH_DEPTH)):
            place[:, column] = np.log1p(np.trapezoid(np.where(inside, bands.absorption_per_km, 0.0), z, axis=0) / weak)
    return place


def largest_parts(medium: Medium, bands: GasBands | None) -> np.ndarray:
    """Largest part (N,) of each term in the light of its wavelength; 1 without terms."""
    if bands is None:
        return np.ones(medium.n_wavelengths)
    depth = np.trapezoid(bands.absorption_per_km, medium.altitude_km, axis=0)
    largest = np.full(depth.size, LEAST_PART)
    for mass in AIR_MASSES:
        light = bands.weight * np.exp(-mass * depth)
        largest = np.maximum(largest, light / np.bincount(bands.wavelength_index, light)[bands.wavelength_index])
    return largest


def _covariance(one: np.ndarray, other: np.ndarray) -> np.ndarray:
    """Covariance (N, M) of ln(L/C) at places (N, 3) and (M, 3) from a common origin: of a plane through it, and of what
    is bent about that, Matern's of smoothness 7/2."""
    r = np.sqrt(7.0 * ((one[:, None] - other[None]) ** 2).sum(axis=2))
    return (1.0 + r + 0.4 * r**2 + r**3 / 15.0) * np.exp(-r) + one @ other.T


def choose_nodes(place: np.ndarray, part: np.ndarray) -> np.ndarray | None:
    """Indices (n,), ascending, of the nodes among terms at places (N, 3) with parts (N,) in their wavelengths' light: a
    multiple of LANES; None where MOST_NODES do not suffice."""
    centred = place - place.mean(axis=0)
    left = 1.0 + (centred**2).sum(axis=1) + LEVEL_VARIANCE
    factors, chosen = np.zeros((part.size, 0)), list[int]()
    while len(chosen) < part.size:
        deviation = np.sqrt(np.maximum(left, 0.0)) * part
        deviation[chosen] = 0.0
        worst = int(np.argmax(deviation))
        if len(chosen) % LANES == 0 and chosen and deviation[worst] < TOLERANCE:
            return np.sort(chosen)
        if len(chosen) == MOST_NODES:
            return None
        column = _covariance(centred, centred[worst : worst + 1])[:, 0] + LEVEL_VARIANCE
        column = (column - factors @ factors[worst]) / np.sqrt(max(left[worst], NUGGET))
        factors = np.concatenate([factors, column[:, None]], axis=1)
        left = left - column**2
        chosen.append(worst)
    return None


class Weights(NamedTuple):
    """Kriging from n nodes to N terms: weight (n, N), of sum 1; deviation (N,), the standard deviation of each term;
    without (n, n), the weights that give each node from the others, and their standard deviations left_out (n,)."""

    weight: np.ndarray
    deviation: np.ndarray
    without: np.ndarray
    left_out: np.ndarray


def weights(nodes: np.ndarray, at: np.ndarray) -> Weights:
    """Weights of nodes (n, 3) in terms at places (N, 3)."""
    centre = nodes.mean(axis=0)
    inner, across = _covariance(nodes - centre, nodes - centre), _covariance(nodes - centre, at - centre)
    inverse = np.linalg.inv(inner + NUGGET * np.eye(len(nodes)) + LEVEL_VARIANCE)
    to_terms = inverse @ (across + LEVEL_VARIANCE)
    own = 1.0 + ((at - centre) ** 2).sum(axis=1) + LEVEL_VARIANCE
    deviation = np.sqrt(np.maximum(own - ((across + LEVEL_VARIANCE) * to_terms).sum(axis=0), 0.0))
    precision = np.diag(inverse)
    without = -inverse / precision  # of the column's node from the others (Dubrule 1983)
    np.fill_diagonal(without, 0.0)
    return Weights(to_terms + (1.0 - to_terms.sum(axis=0)) / len(nodes), deviation, without, precision**-0.5)


class Carrier:
    """Wavelengths of one range, or terms of their exponential sums, whose light is carried from nodes among them.

    nodes: the medium of the nodes; place (n, 3): their coordinates; chosen (n,): which of `n_terms` terms they are;
    model: the fitted model's field of them
    """

    def __init__(self, nodes: Medium, place: np.ndarray, chosen: np.ndarray, n_terms: int, model: Any):
        self.nodes, self.place, self.chosen, self.n_terms, self.model = nodes, place, chosen, n_terms, model
        self._solved: dict[float, Any] = {}
        self._asked: dict[tuple[Any, ...], np.ndarray] = {}

    @property
    def n_nodes(self) -> int:
        """Columns that are solved."""
        return self.nodes.n_wavelengths

    def solved(self, altitude_km: float, solve: Callable[[], Any]) -> Any:
        """The solver's field of the nodes for an observer, solved when it is first asked for."""
        if altitude_km not in self._solved:
            self._solved, self._asked = {altitude_km: solve()}, {}
        return self._solved[altitude_km]

    def light(self, field: Any, method: str, question: tuple[Any, ...], observer: dict[str, Any]) -> np.ndarray:
        """Stokes parameters (..., 1 or 3, n) by a method of the solver's field of the nodes, or the model's: blocks ask
        for the same."""
        sun, *directions = question
        arrays = [np.asarray(d, float) for d in directions]
        key = (id(field), method, sun, *((a.shape, a.tobytes()) for a in arrays), *observer.items())
        if key not in self._asked:
            if len(self._asked) == REMEMBERED:
                del self._asked[next(iter(self._asked))]
            self._asked[key] = stokes_by(field, method, question, observer)
        return self._asked[key]


def stokes_by(field: Any, method: str, question: tuple[Any, ...], observer: dict[str, Any]) -> np.ndarray:
    """Stokes parameters (..., 1 or 3, W) by `radiance` or `stokes` of a field."""
    light: np.ndarray = getattr(field, method)(*question, **observer)
    return light[..., None, :] if method == "radiance" else light


def carriers(medium: Medium, bands: GasBands | None, altitude_km: float) -> list[Carrier | None]:
    """What carries the light of each wavelength of a medium, (W,); None where it is solved.

    One for each range of wavelengths that share a grid and fill more blocks of LANES than their nodes do.
    """
    found: list[Carrier | None] = [None] * medium.n_wavelengths
    model = solvers.load(MODEL)
    ranges = np.array([range_of(w) for w in medium.wavelength_nm])
    for members in (np.flatnonzero(ranges == r) for r in np.unique(ranges)):
        some, terms = medium.select(members), None if bands is None else bands.select(members)
        place, part = coordinates(some, terms), largest_parts(some, terms)
        if part.size <= LANES:
            continue
        chosen = choose_nodes(place, part)
        if chosen is None or chosen.size + LANES > LANES * -(-part.size // LANES):
            continue
        nodes = some.select(chosen) if terms is None else terms.expand(some, chosen)
        try:
            one = Carrier(
                nodes, place[chosen], chosen, part.size, model.prepare(nodes, observer_altitude_km=altitude_km)
            )
        except TwilightError:  # air, wavelengths or an observer that the model does not have
            continue
        for w in members:
            found[w] = one
    return found


class CarriedEstimate(NamedTuple):
    """An estimate of a solver with noise, and its standard error."""

    radiance: np.ndarray
    stokes: np.ndarray
    standard_error: np.ndarray


@dataclass(eq=False)
class CarriedField(BareField):
    """The field of the terms of a block, from a solver's field of the nodes.

    medium: of the terms; part (N,): the largest part of each in its wavelength's light; at_nodes: the solver's field of
    the nodes; model: the fitted model's of the terms; error: of `convergence`
    """

    medium: Medium
    carrier: Carrier
    weights: Weights
    part: np.ndarray
    at_nodes: Any
    model: Any
    error: float = 0.0

    @staticmethod
    def of(
        medium: Medium,
        without_terms: Medium,
        bands: GasBands | None,
        carrier: Carrier,
        at_nodes: Any,
        altitude_km: float,
    ) -> CarriedField:
        """The field of a block's terms; without_terms: its wavelengths, whose terms the medium has."""
        return CarriedField(
            medium,
            carrier,
            weights(carrier.place, coordinates(without_terms, bands)),
            largest_parts(without_terms, bands),
            at_nodes,
            solvers.load(MODEL).prepare(medium, observer_altitude_km=altitude_km),
        )

    @property
    def convergence(self) -> Convergence | None:  # type: ignore[override]
        """That of the nodes, how many they are, and what carrying added in the skies that were asked for so far."""
        known = self.at_nodes.convergence or Convergence(0, 0.0)
        return replace(known, spectral_nodes=self.carrier.n_nodes, interpolation_error=self.error)

    @property
    def polarised(self) -> bool:
        """Whether the solver's field is."""
        return bool(self.at_nodes.polarised)

    @property
    def sun_range_deg(self) -> tuple[float, float]:
        """Lowest and highest sun [deg] of the solver's field."""
        return getattr(self.at_nodes, "sun_range_deg", (-90.0, 90.0))

    def serves(self, sun_elevation_deg: float, elevation_deg: Any, altitude_km: float | None) -> bool:
        """Whether the model has a sun, directions and an observer; else all wavelengths have to be solved."""
        up = bool(np.all(np.asarray(elevation_deg) >= 0.0))
        high = altitude_km is not None and altitude_km > self.medium.bottom_km + HIGHEST_OBSERVER_KM
        return up and not high and sun_elevation_deg >= LOWEST_SUN_DEG

    def radiance(self, sun_elevation_deg: float, elevation_deg, azimuth_deg, **observer: Any) -> np.ndarray:
        """Sun-normalised radiance [sr^-1], shape of the directions plus (N,); arguments as of the solver's."""
        question = (sun_elevation_deg, elevation_deg, azimuth_deg)
        at_nodes = self.carrier.light(self.at_nodes, "radiance", question, observer)
        return self._carried(question, at_nodes, observer)[..., 0, :]

    def stokes(self, sun_elevation_deg: float, elevation_deg, azimuth_deg, **observer: Any) -> np.ndarray:
        """Sun-normalised Stokes parameters I, Q, U [sr^-1], shape of the directions plus (3, N)."""
        question = (sun_elevation_deg, elevation_deg, azimuth_deg)
        return self._carried(question, self.carrier.light(self.at_nodes, "stokes", question, observer), observer)

    def radiance_with_error(self, sun_elevation_deg: float, elevation_deg, azimuth_deg, **more: Any) -> CarriedEstimate:
        """Radiance of a solver with noise; the standard error is that of the nodes' logarithms, carried."""
        question = (sun_elevation_deg, elevation_deg, azimuth_deg)
        estimate = self.at_nodes.radiance_with_error(*question, **more)
        return self._with_error(question, estimate.radiance[..., None, :], estimate.standard_error[..., None, :])

    def stokes_with_error(self, sun_elevation_deg: float, elevation_deg, azimuth_deg, **more: Any) -> CarriedEstimate:
        """Stokes parameters of a solver with noise, as `radiance_with_error`."""
        question = (sun_elevation_deg, elevation_deg, azimuth_deg)
        estimate = self.at_nodes.stokes_with_error(*question, **more)
        return self._with_error(question, estimate.stokes, estimate.standard_error)

    def _with_error(self, question: tuple[Any, ...], stokes: np.ndarray, error: np.ndarray) -> CarriedEstimate:
        light = self._carried(question, stokes, {})
        relative = error / np.maximum(stokes[..., :1, :], DARK)
        carried = np.sqrt(relative**2 @ self.weights.weight**2) * light[..., :1, :]
        return CarriedEstimate(light[..., 0, :], light, carried if light.shape[-2] > 1 else carried[..., 0, :])

    def _carried(self, question: tuple[Any, ...], at_nodes: np.ndarray, observer: dict[str, Any]) -> np.ndarray:
        """Stokes parameters (..., S, N) of the terms from those of the nodes, (..., S, n)."""
        method, carrier = "stokes" if at_nodes.shape[-2] > 1 else "radiance", self.carrier
        wanted = stokes_by(self.model, method, question, observer)
        whole = self.medium.n_wavelengths == carrier.n_terms
        known = wanted[..., carrier.chosen] if whole else carrier.light(carrier.model, method, question, observer)
        solved, model = (np.maximum(light[..., 0, :], DARK) for light in (at_nodes, known))
        ratio = np.log(solved / model)
        self.error = max(self.error, self._added(ratio))
        low, high = ratio.min(axis=-1, keepdims=True) - SLACK, ratio.max(axis=-1, keepdims=True) + SLACK
        out = np.empty((*wanted.shape[:-2], at_nodes.shape[-2], self.medium.n_wavelengths))
        out[..., 0, :] = wanted[..., 0, :] * np.exp(np.clip(ratio @ self.weights.weight, low, high))
        if method == "stokes":
            more = at_nodes[..., 1:, :] / solved[..., None, :] - known[..., 1:, :] / model[..., None, :]
            of_model = wanted[..., 1:, :] / np.maximum(wanted[..., :1, :], DARK)
            out[..., 1:, :] = out[..., :1, :] * (of_model + more @ self.weights.weight)
        return out

    def _added(self, ratio: np.ndarray) -> float:
        """Relative error that carrying adds at 95 % of directions and terms, from nodes that are left out in turn."""
        flat = ratio.reshape(-1, ratio.shape[-1])
        found = flat @ self.weights.without
        scale = np.sqrt((((found - flat) / self.weights.left_out) ** 2).mean(axis=1))
        if not scale.size:
            return 0.0
        return float(COVERAGE * np.percentile(scale, 95) * np.percentile(self.weights.deviation * self.part, 95))
