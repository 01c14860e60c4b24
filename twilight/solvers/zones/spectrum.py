"""The light of many wavelengths, interpolated from those at nodes in the spectrum.

The field, light scattered at least once, is smooth in the optical properties of the air: of its logarithm at every
place, and of its moments relative to it, a wavelength or a term of a gas's exponential sum takes a weighted mean over a
few others, the nodes.  Weights come from kriging (Sacks, Welch, Mitchell and Wynn 1989, Statistical Science
4, 409) over coordinates of the air's optics: logarithms of the wavelength and of scattering, growing logarithms of what
absorbs in four ranges of altitude, the ground's albedo.  They do not depend on the place, so that one small matrix
serves all of a field.  Nodes are taken one by one where the interpolation so far knows least (pivoted Cholesky
decomposition).
"""

from __future__ import annotations

from collections.abc import Hashable, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise

import numpy as np

from twilight.atmosphere.bands import GasBands
from twilight.atmosphere.grid_medium import range_of
from twilight.atmosphere.medium import Medium
from twilight.base.errors import TwilightError
from twilight.base.progress import Progress, part_of
from twilight.solvers.base import Convergence
from twilight.solvers.zones import constants as tuned
from twilight.solvers.zones.grids import FieldGrids, FieldNodes, serves_range
from twilight.solvers.zones.next_order import RadianceField
from twilight.solvers.zones.orders import solve
from twilight.solvers.zones.ray_points import LANES, block_values
from twilight.solvers.zones.scattering import TINY, Solution
from twilight.solvers.zones.settings import ZonesSettings

STATED_ERROR = 5e-3
"""What interpolation adds, at 95 % of directions, between bands of gases and in them, in the ten types of aerosol
(`benchmarks/hyperspectral.py`)."""
NODES_AT_ONCE = 3 * LANES
"""Nodes that are solved together: each such part has rays and a sunbeam of its own."""


def optical_coordinates(medium: Medium, bands: GasBands | None = None) -> np.ndarray:
    """Coordinates (N, F) of a medium's wavelengths, or of the terms of its bands, scaled to SCALES."""
    z = medium.altitude_km
    edges = medium.bottom_km + np.array([*tuned.ABSORPTION_RANGES_KM, np.inf])
    inside = [(z >= low) & (z <= high) for low, high in pairwise(edges)]

    def depths(per_km: np.ndarray, where: list[np.ndarray]) -> np.ndarray:
        return np.stack([np.trapezoid(np.where(w[:, None], per_km, 0.0), z, axis=0) for w in where], axis=1)

    absorption = depths(medium.absorption_per_km, inside)
    particles = medium.aerosol_extinction_per_km
    absorption += depths(particles * (1.0 - medium.aerosol_single_scattering_albedo), inside)
    of_air = depths(medium.air_scattering_per_km, [np.ones(z.size, bool)])
    scattering = of_air + depths(particles * medium.aerosol_single_scattering_albedo, [z >= z[0], z >= edges[2]])
    index = np.arange(medium.n_wavelengths) if bands is None else bands.wavelength_index
    if bands is not None:
        absorption = absorption[index] + depths(bands.absorption_per_km, inside)
    columns = [
        np.log(medium.wavelength_nm[index])[:, None] / tuned.WAVELENGTH_SCALE,
        np.log(scattering[index] + 1e-6) / tuned.SCATTERING_SCALE,
        np.log1p(absorption / tuned.WEAK_DEPTH) / tuned.ABSORPTION_SCALE,
        medium.ground_albedo[index][:, None] / tuned.ALBEDO_SCALE,
    ]
    return np.concatenate(columns, axis=1)


def largest_fractions(medium: Medium, bands: GasBands | None) -> np.ndarray:
    """Largest fraction (N,) of a term in its wavelength's light, at least MIN_TERM_FRACTION; 1 without terms."""
    if bands is None:
        return np.ones(medium.n_wavelengths)
    depth = np.trapezoid(bands.absorption_per_km, medium.altitude_km, axis=0)
    largest = np.full(bands.weight.size, tuned.MIN_TERM_FRACTION)
    for mass in tuned.AIR_MASSES:
        light = bands.weight * np.exp(-mass * depth)
        largest = np.maximum(largest, light / np.bincount(bands.wavelength_index, light)[bands.wavelength_index])
    return largest


def in_deep_band(medium: Medium, bands: GasBands | None) -> np.ndarray:
    """Whether each wavelength, or that of each term, is in a band that absorbs more than SHALLOW_BAND, (N,)."""
    if bands is None:
        return np.zeros(medium.n_wavelengths, bool)
    passed = np.exp(-np.trapezoid(bands.absorption_per_km, medium.altitude_km, axis=0))
    return (bands.sum_terms(passed) < 1.0 - tuned.SHALLOW_BAND)[bands.wavelength_index]


def covariance(one: np.ndarray, other: np.ndarray) -> np.ndarray:
    """Covariance (N, M) of ln of the light, of coordinates (N, F) and (M, F) from a common origin: of a plane through
    it with slopes of PLANE_VARIANCE, and of what is bent about that."""
    squared = ((one[:, None] - other[None]) ** 2).sum(axis=2)
    r = np.sqrt(7.0 * squared)  # Matern's covariance of smoothness 7/2
    bent = tuned.CURVATURE**2 * (1.0 + r + 0.4 * r**2 + r**3 / 15.0) * np.exp(-r)
    return bent + tuned.PLANE_VARIANCE * one @ other.T


def choose_nodes(coordinates: np.ndarray, tolerance: np.ndarray) -> np.ndarray:
    """Indices (n,), ascending, of the nodes among columns (N, F): a multiple of LANES of them where there are so many.

    tolerance (N,): standard deviation of ln of the light of each column at which no more are taken
    """
    count = coordinates.shape[0]
    place = coordinates - coordinates.mean(axis=0)
    # of the level, which is unknown, as much as of a plane's slope
    left = tuned.CURVATURE**2 + tuned.PLANE_VARIANCE * (1.0 + (place**2).sum(axis=1))
    factors = np.zeros((count, 0))
    chosen: list[int] = []
    while len(chosen) < count:
        deviation = np.sqrt(np.maximum(left, 0.0)) / tolerance
        deviation[chosen] = 0.0
        worst = int(np.argmax(deviation))
        if deviation[worst] < 1.0 and len(chosen) % LANES == 0:
            break
        column = covariance(place, place[worst : worst + 1])[:, 0] + tuned.PLANE_VARIANCE
        column = (column - factors @ factors[worst]) / np.sqrt(max(left[worst], tuned.NUGGET))
        factors = np.concatenate([factors, column[:, None]], axis=1)
        left = left - column**2
        chosen.append(worst)
    return np.sort(np.array(chosen))


def kriging_weights(nodes: np.ndarray, at: np.ndarray) -> np.ndarray:
    """Weights (n, N), of sum 1, of the nodes (n, F) in columns with coordinates (N, F); at a node its own is 1."""
    centre, n = nodes.mean(axis=0), nodes.shape[0]
    matrix = np.ones((n + 1, n + 1))
    matrix[:n, :n] = covariance(nodes - centre, nodes - centre) + tuned.NUGGET * np.eye(n)
    matrix[n, n] = 0.0
    right = np.concatenate([covariance(nodes - centre, at - centre), np.ones((1, at.shape[0]))])
    return np.linalg.lstsq(matrix, right, rcond=1e-13)[0][:n]


def _same(one: FieldNodes, other: FieldNodes) -> bool:
    """Whether two fields have the same nodes, and so the same fine grids."""
    return np.array_equal(one.altitude_km, other.altitude_km) and np.array_equal(
        one.zenith.nodes_rad, other.zenith.nodes_rad
    )


def _mixed(array: np.ndarray, weight: np.ndarray) -> np.ndarray:
    """Weighted sums (..., LANES) over the last axis, of n nodes."""
    return (array.reshape(-1, array.shape[-1]) @ weight).reshape(*array.shape[:-1], LANES)


def _log_albedo(albedo: np.ndarray) -> np.ndarray:
    """Logarithm of the ground's albedo, 0 for a black one, whose light counts as none anyway."""
    return np.log(np.where(albedo > 0.0, albedo, 1.0))


@dataclass(frozen=True)
class _LightAtNodes:
    """Light at the n nodes, along the last axis of its arrays; the ground's without its albedo."""

    light: RadianceField
    nodes: FieldNodes
    convergence: Convergence


@dataclass(frozen=True)
class SpectralInterpolation:
    """Light of wavelengths, or of terms of their exponential sums, by interpolation.

    medium: its columns are the n nodes; coordinates (n, F): theirs; settings: of the field; in_band: whether it serves
    terms.  The nodes are solved when they are first needed.
    """

    medium: Medium
    coordinates: np.ndarray
    settings: ZonesSettings
    in_band: bool
    _solved: dict[tuple[float, float], _LightAtNodes] = field(default_factory=dict, repr=False, compare=False)

    @property
    def n_nodes(self) -> int:
        """Columns that are solved."""
        return self.coordinates.shape[0]

    def light(self, grids: FieldGrids, progress: Progress) -> tuple[list[Solution], Convergence]:
        """The solution of each block of LANES columns of a field, and how well the nodes converged.

        grids: of the field

        Errors: TwilightError where the field has other grids than the nodes.
        """
        key = grids.zenith_range_deg
        if key not in self._solved:
            self._solved[key] = self._solve(key, progress)
        at_nodes = self._solved[key]
        if not _same(at_nodes.nodes, grids.nodes):
            raise TwilightError(
                "solver.expert.spectral_interpolation: the field and its nodes in the spectrum differ in grids; "
                "allowed is off"
            )
        weight = kriging_weights(self.coordinates, optical_coordinates(grids.medium))
        albedo = grids.medium.ground_albedo
        blocks = -(-grids.medium.n_wavelengths // LANES)
        solutions = []
        for block in range(blocks):
            of_block = block_values(weight, block)
            log_mean, ratio, log_ground = (_mixed(array, of_block) for array in at_nodes.light)
            log_ground = log_ground + _log_albedo(block_values(albedo, block))
            lowest = np.float32(np.log(TINY))
            light = RadianceField(np.maximum(log_mean, lowest), ratio, np.maximum(log_ground, lowest))
            solutions.append(Solution(light, at_nodes.convergence.orders, at_nodes.convergence.residual))
        return solutions, replace(at_nodes.convergence, interpolation_error=STATED_ERROR)

    def _solve(self, zenith_range_deg: tuple[float, float], progress: Progress) -> _LightAtNodes:
        starts = range(0, self.n_nodes, NODES_AT_ONCE)
        parts: list[list[np.ndarray]] = []
        worst = Convergence(0, 0.0)
        nodes: FieldNodes | None = None
        for k, start in enumerate(starts):
            medium = self.medium.select(np.arange(start, min(start + NODES_AT_ONCE, self.n_nodes)))
            grids = FieldGrids.of(medium, self.settings, zenith_range_deg, joined=True)
            solutions, converged = solve(grids, grids.sunbeam(), part_of(progress, k / len(starts), 1 / len(starts)))
            if nodes is not None and not _same(nodes, grids.nodes):
                raise TwilightError(
                    "solver.expert.spectral_interpolation: nodes have different grids; allowed here is off"
                )
            nodes = grids.nodes
            worst = Convergence(max(worst.orders, converged.orders), max(worst.residual, converged.residual))
            for block, s in enumerate(solutions):
                used = min(LANES, medium.n_wavelengths - block * LANES)
                albedo = _log_albedo(block_values(medium.ground_albedo, block))
                light = s.light._replace(log_ground=s.light.log_ground - albedo)
                parts.append([a[..., :used] for a in light])
        assert nodes is not None
        light = RadianceField(*(np.concatenate(arrays, axis=-1) for arrays in zip(*parts, strict=True)))
        return _LightAtNodes(light, nodes, replace(worst, spectral_nodes=self.n_nodes))


def interpolation(
    medium: Medium, bands: GasBands | None, groups: Sequence[Hashable], settings: ZonesSettings
) -> list[SpectralInterpolation | None]:
    """What interpolates the light of each wavelength of a medium, (W,): one for all whose ranges are joined.

    None where it is switched off, or would not save time, or the grids are not known to be those of a range.

    bands: exponential sums of the medium's wavelengths; groups (W,): keys, wavelengths of different keys being solved
    in different blocks
    """
    found: list[SpectralInterpolation | None] = [None] * medium.n_wavelengths
    if settings.spectral_interpolation == "off" or settings.max_orders == 1:
        return found
    # these have grids of their own, or none that are known to be shared
    if settings.target_error > 0.0 or settings.field_file or medium.at_grid_wavelengths is None:
        return found
    first = np.array([range_of(w) == 0 for w in medium.wavelength_nm])
    served = serves_range(medium)
    for members in (np.flatnonzero(served & first), np.flatnonzero(served & ~first)):
        one = _of_members(medium, bands, members, [groups[int(w)] for w in members], settings) if members.size else None
        for w in members:
            found[w] = one
    return found


def _of_members(
    medium: Medium, bands: GasBands | None, wavelengths: np.ndarray, groups: list[Hashable], settings: ZonesSettings
) -> SpectralInterpolation | None:
    """What interpolates the light of some wavelengths (N,), indices, with their keys (N,)."""
    some = medium.select(wavelengths)
    terms = None if bands is None else bands.select(wavelengths)
    counts = np.ones(wavelengths.size, int) if terms is None else terms.term_counts
    if (some.ground_albedo == 0.0).any() and (some.ground_albedo > 0.0).any():
        return None
    solved = sum(-(-int(counts[[g == key for g in groups]].sum()) // LANES) for key in set(groups))
    if solved == 1:
        return None
    place = optical_coordinates(some, terms)
    tolerance = np.where(in_deep_band(some, terms), tuned.SPECTRAL_TOLERANCE_IN_BANDS, tuned.SPECTRAL_TOLERANCE)
    chosen = choose_nodes(place, tolerance / largest_fractions(some, terms))
    if -(-chosen.size // LANES) > tuned.MOST_FRACTION * solved:
        return None
    nodes = some.select(chosen) if terms is None else terms.expand(some, chosen)
    return SpectralInterpolation(nodes, place[chosen], settings, bool((counts > 1).any()))
