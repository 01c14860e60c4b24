"""A medium with changes in single layers: what is differentiated.

A layer's change is a box: the coefficient jumps at the layer's two altitudes, which become doubled levels.  Temperature
alone goes over from layer to layer (`soft_layers`), because a refractive index that jumps reflects.  How far a quantity
moves is small enough that the light does so in proportion.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np

from twilight.atmosphere.levels import layer_mean
from twilight.atmosphere.medium import ON_LEVELS, Medium
from twilight.base.errors import TwilightError
from twilight.numerics.phase import HENYEY_GREENSTEIN, TABLE, table_angles_rad

MIN_LAYER_KM = 0.01
"""Least thickness [km] of a layer."""
MAX_CHANGE = 0.35
"""Change of the logarithm of a coefficient between two levels: what is added to a layer is then even to 1 %."""
MOST_PARTS = 12
"""Most levels that one is divided into."""
DEPTH_STEP = 1e-4
"""Vertical optical depth that a layer gains: of light that crosses it 40 times this takes 0.4 %, and the derivative
is 0.2 % too small."""
ALBEDO_STEP = 1e-3
"""Change of an albedo of the ground or of single scattering."""
ASYMMETRY_STEP = 0.002
"""Change of the asymmetry parameter; one of Henyey-Greenstein's phase function curves by less than 0.5 %."""
MAX_TILT = 0.45
"""Largest eps of a tilted phase function P (1 + eps (mu - g)): nowhere is it below 0.1 P."""
RAMP_KM = 1.0
"""Half of the altitude [km] over which the temperature of a layer goes over into that of the next, where both are twice
as thick: tables of the sunbeam, whose nodes are 0.6 km apart, know a change that is no steeper."""
RAMP_PARTS = 8
"""Intervals between levels in that altitude."""
CLOSE_KM = 1e-3
"""Distance [km] to a level within which there is no other."""
BENT_STEPS = 16.0
"""Steps of temperature by which the refractive index moves each way: the light's change is then far above the rounding
of the sunbeam's tables, and even to 0.1 % in proportion, because the difference is central."""
GUIDE_PER_KM = 4e-4
"""Absorption [km^-1] of every other layer in the air that tables of the sunbeam are laid out for, which so know of
every edge: twice the least jump that they hold in closed form."""


def layer_edges(medium: Medium, edges_km) -> np.ndarray:
    """Altitudes (J + 1,) [km] that bound J layers of a medium.

    Errors: TwilightError for fewer than two, for layers thinner than MIN_LAYER_KM, and for altitudes outside the air.
    """
    edges = np.asarray(edges_km, dtype=float)
    if edges.ndim != 1 or edges.size < 2 or not np.all(np.isfinite(edges)):
        raise TwilightError("edges_km must be two or more altitudes [km], which bound layers")
    if np.any(np.diff(edges) < MIN_LAYER_KM):
        raise TwilightError(f"edges_km must grow by {MIN_LAYER_KM:g} km or more from one to the next")
    if edges[0] < medium.bottom_km - 1e-9 or edges[-1] > medium.top_km + 1e-9:
        raise TwilightError(
            f"edges_km must lie within the air, from {medium.bottom_km:g} to {medium.top_km:g} km; they go from "
            f"{edges[0]:g} to {edges[-1]:g}"
        )
    return np.clip(edges, medium.bottom_km, medium.top_km)


def with_doubled_levels(medium: Medium, edges_km: np.ndarray, like: Medium | None = None) -> Medium:
    """The same air with a doubled level at each of the altitudes (E,) [km] inside it, and with levels in between.

    The rule between two levels is exponential: as much more at both is most in the middle, by q^2 / 8 where the
    coefficients change by exp(q).  Levels in between keep q below MAX_CHANGE.

    like: the same levels at other wavelengths, whose coefficients say where; None: the medium's own.
    """
    z = medium.altitude_km
    whose = like or medium
    inside = edges_km[(edges_km > z[0]) & (edges_km < z[-1])]
    change = np.zeros(z.size - 1)
    for per_km in (whose.absorption_per_km, whose.aerosol_extinction_per_km):
        lower, upper = per_km[:-1], per_km[1:]
        positive = (lower > 0.0) & (upper > 0.0)
        ratio = np.where(positive, upper, 1.0) / np.where(positive, lower, 1.0)
        change = np.maximum(change, np.abs(np.log(ratio)).max(axis=1))
    pieces = [z[:1]]
    for low, high, q in zip(z[:-1], z[1:], change, strict=True):
        parts = min(max(1, int(np.ceil(q / MAX_CHANGE))), MOST_PARTS) if high > low else 1
        within = inside[(inside > low) & (inside < high)]
        between = np.linspace(low, high, parts + 1)[1:-1]
        single = high in inside and np.count_nonzero(z == high) == 1
        new = np.sort(np.concatenate([np.repeat(within, 2), np.setdiff1d(between, within)]))
        pieces.append(np.concatenate([new, [high, high] if single else [high]]))
    return medium.on_levels(pieces)


def of_layer(altitude_km: np.ndarray, low_km: float, high_km: float) -> np.ndarray:
    """Which levels (L,) belong to a layer whose two altitudes are doubled levels, or the ends of the air."""
    z = altitude_km
    inside = (z >= low_km) & (z <= high_km)
    # of a doubled level the upper one belongs to the layer above, the lower one to that below
    first_of_two = np.append(z[1:] == z[:-1], False)
    second_of_two = np.insert(z[1:] == z[:-1], 0, False)
    return inside & ~((z == low_km) & first_of_two) & ~((z == high_km) & second_of_two)


def soft_layers(medium: Medium, edges_km: np.ndarray) -> tuple[list[np.ndarray], np.ndarray]:
    """Levels and weights of layers between edges_km (J + 1,) [km] that go over into each other.

    About an edge e the weight of the layer above is f^2 (3 - 2 f), f = (z - e + r) / 2 r from 0 to 1, and that of the
    layer below the rest, with r = RAMP_KM or half of the thinner of both: the weights of all layers add up to 1.  There
    is no layer below the ground, nor above the top of the air, and no ramp.

    Returns
    -------
    pieces, weight
        New levels of the medium as of `Medium.on_levels`; weight (J, L) of the layers at these levels.
    """
    bounds = np.array([medium.bottom_km, *edges_km, medium.top_km])
    thickness = np.diff(bounds)
    half = np.minimum(RAMP_KM, 0.5 * np.minimum(thickness[:-1], thickness[1:]))
    half[edges_km <= medium.bottom_km] = 0.0
    half[edges_km >= medium.top_km] = 0.0
    ramps = [np.linspace(e - r, e + r, RAMP_PARTS + 1) for e, r in zip(edges_km, half, strict=True) if r > 0.0]
    new = np.unique(np.round(ramps, 6))
    new = new[np.abs(new[:, None] - medium.altitude_km).min(axis=1) > CLOSE_KM]
    pieces = [medium.altitude_km[:1]]
    for low, high in pairwise(medium.altitude_km):
        pieces.append(np.append(new[(new > low) & (new < high)], high))
    z = np.concatenate(pieces)
    above = []
    for e, r in zip(edges_km, half, strict=True):
        f = np.clip((z - e + r) / (2.0 * r), 0.0, 1.0) if r > 0.0 else np.full(z.size, float(e <= medium.bottom_km))
        above.append(f * f * (3.0 - 2.0 * f))
    return pieces, -np.diff(above, axis=0)


def layer_depth(per_km: np.ndarray, altitude_km: np.ndarray, edges_km: np.ndarray) -> np.ndarray:
    """Vertical optical depth (J, W) of each layer of a coefficient (L, W) [km^-1], at levels that hold the edges."""
    thickness = np.diff(altitude_km)[:, None]
    depth = layer_mean(per_km[:-1], per_km[1:]) * thickness
    middle = 0.5 * (altitude_km[1:] + altitude_km[:-1])
    layer = np.searchsorted(edges_km, middle) - 1
    out = np.zeros((edges_km.size - 1, per_km.shape[1]))
    known = (layer >= 0) & (layer < out.shape[0])
    np.add.at(out, layer[known], depth[known])
    return out


class Shifted(NamedTuple):
    """The air of a scene with something else in it, at the levels and wavelengths of its medium, and how much of it."""

    medium: Medium
    step: float


@dataclass(frozen=True)
class Changes:
    """N changes of a medium at W wavelengths: of one quantity in N layers, or of one that all layers share.

    base: the medium, with levels that the changes need; changed: it with each change, but with the refractive index of
    the base; step (N, W): of each; guide: the air that tables of the sunbeam are laid out for; bent: where a change
    moves the refractive index, the base with the index of each change bent_step less and bent_step more, else empty
    """

    base: Medium
    changed: tuple[Medium, ...]
    step: np.ndarray
    guide: Medium
    bent: tuple[tuple[Medium, Medium], ...] = ()
    bent_step: float = 1.0

    @property
    def n(self) -> int:
        """How many they are."""
        return len(self.changed)

    def columns(self, w: int) -> tuple[Medium, Medium]:
        """(The medium of one wavelength as N + 1 columns, the first without a change; the guide at this wavelength)."""
        one = np.array([w])
        media = [m.select(one) for m in (self.base, *self.changed)]
        many = media[0].select(np.zeros(len(media), int))
        joined: dict[str, Any] = {key: np.concatenate([getattr(m, key) for m in media], axis=1) for key in ON_LEVELS}
        fraction = np.concatenate([m.aerosol_phase_fraction for m in media], axis=2)
        albedo = np.concatenate([m.ground_albedo for m in media])
        overhead = np.concatenate([m.overhead_absorption_optical_depth for m in media])
        columns = replace(
            many, **joined, aerosol_phase_fraction=fraction, ground_albedo=albedo,
            overhead_absorption_optical_depth=overhead, grid_medium=None,
        )  # fmt: skip
        return columns, replace(self.guide.select(one), grid_medium=None)

    def bent_columns(self, w: int) -> list[list[Medium]]:
        """Of each change, one wavelength with less and with more of the refractive index; empty where none moves it."""
        one = np.array([w])
        return [[replace(medium.select(one), grid_medium=None) for medium in pair] for pair in self.bent]


def changes_of(medium: Medium, quantity: str, edges_km: np.ndarray, shifted: Shifted | None = None) -> Changes:
    """The changes that differentiate by one of `solvers.base.DIFFERENTIATED` in the layers between edges_km (J + 1,).

    shifted: for ozone_column and temperature, which a medium does not hold
    Errors: TwilightError for edges that are none.
    """
    edges = layer_edges(medium, edges_km)
    if quantity == "ground_albedo":
        h = ALBEDO_STEP if medium.ground_albedo.max() < 0.5 else -ALBEDO_STEP
        shifted = Shifted(replace(medium, ground_albedo=medium.ground_albedo + h), h)
    if quantity in ("ground_albedo", "ozone_column"):
        assert shifted is not None
        return Changes(medium, (shifted.medium,), np.full((1, medium.n_wavelengths), shifted.step), medium)
    if quantity == "temperature":
        assert shifted is not None
        return _warmer(medium, edges, shifted)
    base, change = with_doubled_levels(medium, edges), _IN_LAYERS.get(quantity)
    if quantity == "aerosol_asymmetry":
        base, step = with_tilted_aerosol(base)
        change = partial(_tilted, step=step)
    assert change is not None
    layers = list(pairwise(edges))
    insides = [of_layer(base.altitude_km, low, high)[:, None] for low, high in layers]
    found = [change(base, inside, *layer) for inside, layer in zip(insides, layers, strict=True)]
    steps = np.array([np.broadcast_to(h, medium.n_wavelengths) for _, h in found])
    guide = replace(base, absorption_per_km=base.absorption_per_km + GUIDE_PER_KM * np.any(insides[::2], axis=0))
    return Changes(base, tuple(m for m, _ in found), steps, guide)


def _warmer(medium: Medium, edges: np.ndarray, shifted: Shifted) -> Changes:
    """Each of the soft layers as in the shifted air: ln of scattering and refractivity, and absorption, by its weight.

    The refractive index of `changed` is that of the base: all columns have the rays of the base, because tables of
    sunbeams know one index.
    """
    pieces, weights = soft_layers(medium, edges)
    base, other = medium.on_levels(pieces), shifted.medium.on_levels(pieces)
    changed, bent = [], []
    for weight in weights[:, :, None]:
        scattering = _towards(base.air_scattering_per_km, other.air_scattering_per_km, weight)
        absorption = base.absorption_per_km + weight * (other.absorption_per_km - base.absorption_per_km)
        changed.append(replace(base, air_scattering_per_km=scattering, absorption_per_km=absorption))
        less, more = (_towards(base.refractivity, other.refractivity, way * BENT_STEPS * weight) for way in (-1.0, 1.0))
        if not np.array_equal(less, more):
            bent.append((replace(base, refractivity=less), replace(base, refractivity=more)))
    step = np.full((len(changed), medium.n_wavelengths), shifted.step)
    return Changes(base, tuple(changed), step, base, tuple(bent), BENT_STEPS * shifted.step)


def _towards(one: np.ndarray, other: np.ndarray, part: np.ndarray) -> np.ndarray:
    """one (other / one)^part, 0 where one of both is 0."""
    positive = (one > 0.0) & (other > 0.0)
    ratio = np.where(positive, other, 1.0) / np.where(positive, one, 1.0)
    return np.where(positive, one * ratio**part, 0.0)


def _deeper(base: Medium, inside: np.ndarray, low: float, high: float, *, key: str) -> tuple[Medium, float]:
    """More of a coefficient in a layer, DEPTH_STEP of vertical optical depth.

    Between levels that differ, a little more at both is not quite as much more in between.
    """
    values = getattr(base, key)
    rough = values + inside * DEPTH_STEP / (high - low)
    before, after = (layer_depth(v, base.altitude_km, np.array([low, high]))[0] for v in (values, rough))
    return replace(base, **{key: values + (rough - values) * DEPTH_STEP / (after - before)}), DEPTH_STEP


def _less_absorbing(base: Medium, inside: np.ndarray, *_: float) -> tuple[Medium, np.ndarray]:
    """Aerosol with another single scattering albedo in a layer: up where it is small, else down."""
    key = "aerosol_single_scattering_albedo"
    albedo = base.aerosol_single_scattering_albedo
    h = np.where((albedo * inside).max(axis=0) < 0.5, ALBEDO_STEP, -ALBEDO_STEP)
    return replace(base, **{key: np.clip(albedo + inside * h, 0.0, 1.0)}), h


def _tilted(base: Medium, inside: np.ndarray, *_: float, step: np.ndarray) -> tuple[Medium, np.ndarray]:
    """All scattering of the aerosol in a layer by the tilted phase functions of `with_tilted_aerosol`."""
    n = len(base.phase_functions) // 2
    fraction = base.aerosol_phase_fraction.copy()
    fraction[n:] = fraction[:n] * inside
    fraction[:n] *= ~inside
    return replace(base, aerosol_phase_fraction=fraction), step


_IN_LAYERS: dict[str, Callable[..., tuple[Medium, float | np.ndarray]]] = {
    "absorption": partial(_deeper, key="absorption_per_km"),
    "aerosol_extinction": partial(_deeper, key="aerosol_extinction_per_km"),
    "aerosol_albedo": _less_absorbing,
}
"""What changes a layer of a medium: from (medium, levels inside, bottom, top) the medium and the step."""


def with_tilted_aerosol(medium: Medium) -> tuple[Medium, np.ndarray]:
    """The medium with a second of each phase function of its aerosol, of which there is none, and its step (W,).

    The second has an asymmetry parameter larger by the step: Henyey-Greenstein's that of its formula, a table P the
    matrix P (1 + eps (mu - g)), whose mean cosine is g + eps (<mu^2> - g^2) and which polarises as P does.
    """
    moments = [phase.legendre_moments(2) for phase in medium.phase_functions]
    width = [(1.0 + 2.0 * m[:, 2]) / 3.0 - m[:, 1] ** 2 for m in moments]
    least = np.min([v for v, p in zip(width, medium.phase_functions, strict=True) if p.kind == TABLE] or [1.0])
    step = min(ASYMMETRY_STEP, MAX_TILT * float(least))
    tilted = []
    for phase, m, v in zip(medium.phase_functions, moments, width, strict=True):
        g = phase.asymmetry if phase.kind == HENYEY_GREENSTEIN else m[:, 1]
        if phase.kind == HENYEY_GREENSTEIN:
            tilted.append(replace(phase, asymmetry=np.minimum(g + step, 0.5 * (1.0 + g))))
            continue
        mu = np.cos(table_angles_rad(phase.log_table.shape[1]))
        tilt = np.log1p((step / v)[:, None] * (mu - g[:, None]))
        tilted.append(replace(phase, asymmetry=g + step, log_table=phase.log_table + tilt))
    fraction = np.concatenate([medium.aerosol_phase_fraction, np.zeros_like(medium.aerosol_phase_fraction)])
    phases = (*medium.phase_functions, *tilted)
    return (
        replace(medium, aerosol_phase_fraction=fraction, phase_functions=phases, grid_medium=None),
        np.full(medium.n_wavelengths, step),
    )
