"""The light of many wavelengths, interpolated from those at the nodes in the spectrum."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from twilight.atmosphere.bands import GasBands
from twilight.atmosphere.medium import Medium
from twilight.base.errors import TwilightError
from twilight.base.progress import Progress, part_of
from twilight.solvers.base import Convergence
from twilight.solvers.zones import spectral_nodes
from twilight.solvers.zones.field_grids import FieldGrids
from twilight.solvers.zones.layout import serves_range
from twilight.solvers.zones.next_order import RadianceField
from twilight.solvers.zones.ray_points import LANES, block_values
from twilight.solvers.zones.settings import ZonesSettings
from twilight.solvers.zones.solution import TINY, FieldNodes, Solution
from twilight.solvers.zones.solve import solve

MOST_FRACTION = 0.75
"""Nodes over wavelengths, or terms, beyond which nothing is interpolated: it would hardly save time."""
STATED_ERROR = 2e-3
"""Error that interpolation adds between bands, at 95 % of directions (`benchmarks/hyperspectral.py`)."""
STATED_ERROR_IN_BANDS = 5e-3
"""The same within bands of gases."""
AT_ONCE = 2 * LANES
"""Nodes that are solved together: each such part has rays and a sunbeam of its own."""


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
    """Light of the wavelengths, or terms of exponential sums, of one spectral group, by interpolation.

    medium: its columns are the n nodes; coordinates (n, F): theirs; settings: of the field; in_band: whether the nodes
    are terms of a band.  The nodes are solved when they are first needed.
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
        made = self._solved[key]
        if not _same(made.nodes, grids.nodes):
            raise TwilightError(
                "solver.expert.spectral_interpolation: the field and its nodes in the spectrum differ in grids; "
                "allowed is off"
            )
        weight = spectral_nodes.kriging_weights(self.coordinates, spectral_nodes.coordinates(grids.medium))
        albedo = grids.medium.ground_albedo
        blocks = -(-grids.medium.n_wavelengths // LANES)
        found = []
        for block in range(blocks):
            of_block = block_values(weight, block)
            log_mean, ratio, log_ground = (_mixed(array, of_block) for array in made.light)
            log_ground = log_ground + _log_albedo(block_values(albedo, block))
            lowest = np.float32(np.log(TINY))
            light = RadianceField(np.maximum(log_mean, lowest), ratio, np.maximum(log_ground, lowest))
            found.append(Solution(light, made.convergence.orders, made.convergence.residual))
        return found, made.convergence

    def _solve(self, zenith_range_deg: tuple[float, float], progress: Progress) -> _LightAtNodes:
        starts = range(0, self.n_nodes, AT_ONCE)
        parts: list[list[np.ndarray]] = []
        worst = Convergence(0, 0.0)
        nodes: FieldNodes | None = None
        for k, start in enumerate(starts):
            medium = self.medium.select(np.arange(start, min(start + AT_ONCE, self.n_nodes)))
            grids = FieldGrids.of(medium, self.settings, zenith_range_deg, of_terms=self.in_band)
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
        error = STATED_ERROR_IN_BANDS if self.in_band else STATED_ERROR
        return _LightAtNodes(light, nodes, replace(worst, spectral_nodes=self.n_nodes, interpolation_error=error))


def interpolation(
    medium: Medium, bands: GasBands | None, wavelengths: np.ndarray, settings: ZonesSettings
) -> SpectralInterpolation | None:
    """What interpolates the light of some wavelengths of a medium, all of one spectral group.

    None where it is switched off, or would not save time, or the grids are not known to be those of a range.

    bands: exponential sums of the medium's wavelengths; wavelengths (N,): indices
    """
    if settings.spectral_interpolation == "off" or settings.max_orders == 1:
        return None
    # these have grids of their own, or none that are known to be shared
    if settings.target_error > 0.0 or settings.field_file or medium.at_grid_wavelengths is None:
        return None
    albedo = medium.ground_albedo[wavelengths]
    if (albedo == 0.0).any() and (albedo > 0.0).any():
        return None
    some = medium.select(wavelengths)
    terms = None if bands is None else bands.select(wavelengths)
    in_band = terms is not None and bool((terms.term_counts > 1).any())
    columns = wavelengths.size if terms is None else terms.weight.size
    if columns <= spectral_nodes.MIN_COLUMNS or not serves_range(some).all():
        return None
    place = spectral_nodes.coordinates(some, terms)
    tolerance = spectral_nodes.TOLERANCE_IN_BANDS if in_band else spectral_nodes.TOLERANCE
    chosen = spectral_nodes.choose_nodes(place, spectral_nodes.largest_fractions(some, terms), tolerance)
    if chosen.size > MOST_FRACTION * columns:
        return None
    nodes = some.select(chosen) if terms is None else terms.expand(some, chosen)
    return SpectralInterpolation(nodes, place[chosen], settings, in_band)
