"""Derivatives of a field's light by what is in the air, by the adjoint of the scattering operator.

All light solves U = F(U; p), F = K U + s with the parameter p in both, and a radiance is R(U; p): sunlight scattered
once on the line of sight and the light that is scattered into it.  With b of `adjoint`,

    dR/dp = dR/dp at fixed U + b . dF/dp at fixed U.

What is differentiated at fixed U is one evaluation, no solution: in place of the wavelengths of a medium stand airs
with a little more of each parameter, at one wavelength, through which the sunbeam, one order of scattering and the line
of sight are followed once, (F(U; p + h) - F(U; p)) / h.  The first orders, which have directions of their own, are
differentiated one by one:

    U_1 = s,   U_(n+1) = K_E U_n for n < N,   V = U_N + K_L V,   U = U_1 + ... + U_N + K_L V

with K_E and K_L the operators of early and late orders.  So b = g + K_L'^T b belongs to K_L V, y_N = b to U_N in so
far as it has the moments of late orders, and y_n = g + K_E'^T y_(n+1) to the orders before.
"""

from __future__ import annotations

import dataclasses
import math
from collections import OrderedDict
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from twilight.atmosphere.layer_changes import Changes, Shifted, changes_of
from twilight.base.errors import TwilightError
from twilight.solvers.base import Convergence, observer_at
from twilight.solvers.zones.adjoint import (
    AdjointOperator,
    NodeLight,
    empty_adjoint,
    first_wavelength_points,
    next_light,
    repeated,
    scattered_sunlight,
)
from twilight.solvers.zones.adjoint_order import view_adjoint
from twilight.solvers.zones.directions import near_edges
from twilight.solvers.zones.field import Field
from twilight.solvers.zones.field_grids import FieldGrids
from twilight.solvers.zones.lines_of_sight import trace_lines_of_sight
from twilight.solvers.zones.ray_points import LANES, SpeciesMoments, block_values, make_ray_points
from twilight.solvers.zones.solution import FINE_PER_INTERVAL, ScatteringOperator, Solution
from twilight.solvers.zones.solve import early_operators, late_operators
from twilight.solvers.zones.successive_orders import FEW_ORDERS
from twilight.solvers.zones.sunlight import make_sunlight
from twilight.transport.azimuth_series import RayDirections
from twilight.transport.lines import with_refraction
from twilight.transport.profile import at_wavelengths, prepare_profile
from twilight.transport.scaling import delta_scaled

if TYPE_CHECKING:
    from twilight.atmosphere.medium import Medium
    from twilight.transport.beam import Beam

MAX_STEPS = 150
"""Most scatterings that are followed backwards."""
MAX_LEFT = 2e-3
"""Fraction of the radiance that may be left of the equation of all orders backwards."""
MIXED = 12
"""Most scatterings whose sums are mixed."""
SLACK = 1e-9
"""Added to the diagonal of the products of terms, each of length 1: their own rounding, in float32."""
MAX_CACHED = 4
"""Most wavelengths whose `PerturbedAir` is cached for the next lines of sight."""


@dataclass
class Derivatives:
    """d ln I / dp of a field for the N parameters of some changes at each wavelength."""

    field: Field
    changes: Changes
    _cached: OrderedDict[int, PerturbedAir] = dataclasses.field(default_factory=OrderedDict, repr=False)

    def log_slopes(
        self, sun_elevation_deg, elevation_deg, azimuth_deg, observer_altitude_km: float | None = None
    ) -> tuple[np.ndarray, None]:
        """d ln I / dp, shape of suns and directions, broadcast, plus (N, W); nan where there is no light."""
        where = np.broadcast_arrays(*(np.asarray(a, float) for a in (sun_elevation_deg, elevation_deg, azimuth_deg)))
        sun, elevation, azimuth = (a.ravel() for a in where)
        altitude = observer_at(self.field.medium, observer_altitude_km, self.field.observer_altitude_km)
        order = np.argsort(sun, kind="stable")
        found = np.empty((sun.size, self.changes.n, self.field.medium.n_wavelengths))
        for w in range(found.shape[2]):
            air = self.perturbed_air(w)
            for start in range(0, order.size, LANES):
                some = order[start : start + LANES]
                found[some, :, w] = air.log_slopes(sun[some], elevation[some], azimuth[some], altitude)
        return found.reshape(*where[0].shape, *found.shape[1:]), None

    def perturbed_air(self, w: int) -> PerturbedAir:
        """The airs of the wavelength w."""
        air = self._cached.pop(w, None) or PerturbedAir(self.field, w, self.changes)
        self._cached[w] = air
        if len(self._cached) > MAX_CACHED:
            self._cached.popitem(last=False)
        return air


def differentiate(of: Field, quantity: str, edges_km: np.ndarray, shifted: Shifted | None = None) -> Derivatives:
    """Derivatives by one of `solvers.base.DIFFERENTIATED` in the layers between edges_km (J + 1,) [km].

    shifted: as of `changes_of`
    Errors: TwilightError for light of a few orders alone, and for edges that are none.
    """
    if 1 < of.settings.max_orders <= FEW_ORDERS:
        raise TwilightError(
            f"derivatives: zones cannot differentiate light of {of.settings.max_orders} orders alone; allowed is a "
            f"solver.max_orders of 1, or above {FEW_ORDERS}"
        )
    return Derivatives(of, changes_of(of.medium, quantity, edges_km, shifted))


def perturbed_grids(base: FieldGrids, columns: Medium, guide: Medium) -> FieldGrids:
    """Grids with the nodes of a field, on rays with steps of their own.

    columns: the field's air at one wavelength, then that air with each change; guide: one wavelength on the levels of
    the columns, which tables of the sunbeam are laid out for
    """
    scaled = delta_scaled(columns, base.scaled.degree)
    # every column has the steps of the first, or the difference of two would be that of their steps
    first = scaled.medium.select(np.zeros(1, int))
    profile = prepare_profile(scaled.medium, like=first)
    profile = near_edges(profile, profile)
    bent = with_refraction(profile, first)
    settings = base.settings
    layout = base.layout._replace(profile=profile, beam=delta_scaled(guide, base.scaled.degree).medium, bends=first)
    return replace(
        base,
        medium=columns,
        scaled=scaled,
        scattering=SpeciesMoments.of(columns, scaled, base.spin2_degree),
        profile=profile,
        line_profile=bent if settings.bent_lines_of_sight else profile,
        path_profile=bent if settings.bent_paths else profile,
        layout=layout,
    )  # fmt: skip


def bent_grids(grids: FieldGrids, bent: Medium, guide: Medium) -> FieldGrids:
    """Grids for the field's air with another refractive index, by which sunbeams and lines of sight bend; rays between
    two scatterings stay.

    grids, guide: of `perturbed_grids`; bent: that air, at one wavelength
    """
    scaled, air = delta_scaled(bent, grids.scaled.degree), delta_scaled(guide, grids.scaled.degree).medium
    profile = at_wavelengths(grids.profile, slice(0, 1))
    line = with_refraction(profile, scaled.medium) if grids.settings.bent_lines_of_sight else profile
    # the tables' reference is the most refracted of the medium and the guide: both have one index
    beam = replace(air, refractivity=scaled.medium.refractivity)
    return replace(
        grids,
        medium=bent,
        scaled=scaled,
        scattering=SpeciesMoments.of(bent, scaled, grids.spin2_degree),
        profile=profile,
        line_profile=line,
        path_profile=at_wavelengths(grids.path_profile, slice(0, 1)),
        layout=grids.layout._replace(profile=profile, beam=beam, bends=scaled.medium),
    )


def _contributions(derivatives: NodeLight, light: NodeLight) -> np.ndarray:
    """What each node and each point of the ground (N, LANES) of the light adds to that whose derivatives are given."""
    of_nodes, of_ground = derivatives.contributions(light)
    return np.concatenate([of_nodes.reshape(-1, of_nodes.shape[-1]), of_ground])


def least_mixture(terms: list[np.ndarray]) -> np.ndarray:
    """gamma (n, LANES), whose sum is 1 in each lane, with the least |sum gamma_k term_k| of n terms (N, LANES)."""
    size = np.array([np.sqrt((term * term).sum(axis=0)) for term in terms])
    inverse = 1.0 / np.where(size > 0.0, size, 1.0)
    unit = [term * one for term, one in zip(terms, inverse, strict=True)]
    # sums of products without a linear algebra library, whose threads might change the last digits
    gram = np.array([[(a * b).sum(axis=0) for b in unit] for a in unit])
    found = np.empty_like(inverse)
    for w in range(inverse.shape[1]):
        one = np.linalg.solve(gram[:, :, w] + SLACK * np.eye(len(terms)), inverse[:, w])
        found[:, w] = one * inverse[:, w] / (one * inverse[:, w]).sum()
    return found


class PerturbedAir:
    """One wavelength of a field in N + 1 airs, the columns of one medium: the field's own, then one with a little more
    of each parameter."""

    def __init__(self, of: Field, w: int, changes: Changes):
        self.step = changes.step[:, w]
        columns, guide = changes.columns(w)
        grids = perturbed_grids(of.grids, columns, guide)
        self.grids, beam = grids, grids.sunbeam()
        self.several = of.settings.max_orders > 1
        solutions: list[Solution] = []
        if self.several:
            block, lane = divmod(w, LANES)
            light = of.solutions[block].light
            self.light = light._replace(
                log_mean=repeated(light.log_mean, lane),
                ratio=repeated(light.ratio, lane),
                log_ground=repeated(light.log_ground, lane),
            )
            solutions = [of.solutions[block]._replace(light=self.light)] * -(-columns.n_wavelengths // LANES)

        def field(of_grids: FieldGrids, of_beam: Beam) -> Field:
            converged = Convergence(1, 0.0) if self.several else None
            blocks = solutions[: -(-of_grids.medium.n_wavelengths // LANES)]
            return Field(of_grids, of_beam, blocks, converged, of.observer_altitude_km)

        self.field = field(grids, beam)
        self.bent_step = changes.bent_step
        bent = [[bent_grids(grids, column, guide) for column in pair] for pair in changes.bent_columns(w)]
        self.bent = [[field(g, g.sunbeam()) for g in pair] for pair in bent]
        if self.several:
            self._differentiate_orders(beam)

    def _differentiate_orders(self, beam: Beam) -> None:
        """One evaluation of F in every air at the light of the field, and the adjoint operators at that light."""
        grids, early, late = self.grids, early_operators(self.grids), late_operators(self.grids)
        sunlight = make_sunlight(beam, grids.nodes.altitude_km, grids.profile.break_km)
        n_early = max(1, grids.directions.early_orders)
        nodes = slice(None, None, FINE_PER_INTERVAL)
        mean = np.exp(self.light.log_mean[nodes])
        ground = self.light.log_ground[:: grids.nodes.zenith.per_interval]
        total = NodeLight(mean[:, :, None] * self.light.ratio[nodes], np.exp(ground))
        changed: list[list[NodeLight]] = []
        orders: list[NodeLight] = []
        for block in range(-(-grids.medium.n_wavelengths // LANES)):
            one, last = early(block), late(block)
            found = [scattered_sunlight(one, sunlight)]
            if block == 0:
                orders = [found[0].first_wavelength()]
            for n in range(n_early - 1):
                found.append(next_light(one, orders[n]))
                if block == 0:
                    orders.append(found[-1].first_wavelength())
            if block == 0:
                self.retained = one.angles.shared_with(last.angles)
                self.rest = self._late_light(total, orders)
            found.append(next_light(last, self.rest))
            if block == 0:
                adjoints = [AdjointOperator.of(one, a, b) for a, b in pairwise(orders)]
                self.adjoints = [*adjoints, AdjointOperator.of(last, self.rest, found[-1].first_wavelength())]
                self.first, unchanged = orders[0], [part.first_wavelength() for part in found]
                bent = [[self._sunlit(one, of) for of in pair] for pair in self.bent]
            changed.append([part - of for part, of in zip(found, unchanged, strict=True)])
        step = self.step.astype(np.float32)
        self.changes = [
            NodeLight(
                np.concatenate([parts[n].moments for parts in changed], axis=-1)[..., 1 : step.size + 1] / step,
                np.concatenate([parts[n].ground for parts in changed], axis=-1)[..., 1 : step.size + 1] / step,
            )
            for n in range(len(unchanged))
        ]
        for j, (less, more) in enumerate(bent):
            slope = more - less
            self.changes[0].moments[..., j] += slope.moments[..., 0] / (2.0 * self.bent_step)
            self.changes[0].ground[..., j] += slope.ground[..., 0] / (2.0 * self.bent_step)

    def _sunlit(self, operator: ScatteringOperator, bent: Field) -> NodeLight:
        """Sunlight scattered once in the unchanged air where the sunbeam is that of another refractive index."""
        sunlight = make_sunlight(bent.beam, self.grids.nodes.altitude_km, self.grids.profile.break_km)
        return scattered_sunlight(operator, sunlight).first_wavelength()

    def _late_light(self, total: NodeLight, orders: list[NodeLight]) -> NodeLight:
        """V, all light from order N on, with the moments of late orders."""
        moments, ground = total.moments[:, :, self.retained], total.ground.copy()
        for order in orders[:-1]:
            moments = moments - order.moments[:, :, self.retained]
            ground = ground - order.ground
        # the followed light and that of the field differ by their rays: never less than its first order
        least = orders[-1].moments[:, :, 0]
        factor = np.maximum(moments[:, :, 0], least) / np.where(moments[:, :, 0] > 0.0, moments[:, :, 0], 1.0)
        late = np.where((moments[:, :, 0] > 0.0)[:, :, None], moments * factor[:, :, None], 0.0)
        late[:, :, 0] = np.maximum(moments[:, :, 0], least)
        return NodeLight(np.ascontiguousarray(late, np.float32), np.maximum(ground, orders[-1].ground))

    def log_slopes(self, sun: np.ndarray, elevation: np.ndarray, azimuth: np.ndarray, altitude_km: float) -> np.ndarray:
        """d ln I / dp (Q, N) for Q lines of sight, each with its sun; no more than LANES."""
        light = _radiances(self.field, sun, elevation, azimuth, altitude_km)
        slopes = (light[:, 1:] - light[:, :1]) / self.step
        for j, pair in enumerate(self.bent):
            less, more = (_radiances(field, sun, elevation, azimuth, altitude_km)[:, 0] for field in pair)
            slopes[:, j] += (more - less) / (2.0 * self.bent_step)
        if self.several and (light[:, 0] > 0.0).any():
            slopes += self._scattered(sun, elevation, azimuth, altitude_km, light[:, 0])
        lit = light[:, :1] > 0.0
        return np.where(lit, slopes / np.where(lit, light[:, :1], 1.0), np.nan)

    def _scattered(self, sun, elevation, azimuth, altitude_km: float, radiance: np.ndarray) -> np.ndarray:
        """b . dF/dp (Q, N) at fixed light; radiance (Q,): of the lines of sight."""
        late = self.adjoints[-1]
        # lanes without a line of sight repeat the last one's radiance, and have no derivatives
        total = np.append(radiance, np.full(LANES - radiance.size, radiance[-1]))
        direct = self._direct(sun, elevation, azimuth, altitude_km)
        term = NodeLight(np.ascontiguousarray(direct.moments[:, :, self.retained]), direct.ground)
        by_late = self._all_orders(late, term, total)
        found = by_late.products(self.changes[-1])
        moments = direct.moments.copy()
        moments[:, :, self.retained] = by_late.moments
        derivatives = NodeLight(moments, by_late.ground)
        for n in range(len(self.changes) - 2, -1, -1):
            found += derivatives.products(self.changes[n])
            if n > 0:
                derivatives = direct + self.adjoints[n - 1](derivatives, total)
        return found[: sun.size]

    def _all_orders(self, late: AdjointOperator, term: NodeLight, total: np.ndarray) -> NodeLight:
        """b = g + K_L'^T b from g, by orders t_n = K_L'^T t_(n-1) and the mixture of their sums that leaves least.

        With S_n = t_0 + ... + t_n and the gammas of `least_mixture`, whose sum is 1, b = sum gamma_n S_n leaves
        sum gamma_n t_(n+1) of its equation (reduced rank extrapolation).
        """
        terms: list[NodeLight] = [term]
        contributions: list[np.ndarray] = []
        before = np.abs(_contributions(term, self.rest)).sum(axis=0)
        for _ in range(MAX_STEPS):
            terms.append(late(terms[-1], total))
            contributions.append(_contributions(terms[-1], self.rest))
            del contributions[:-MIXED]
            gamma = least_mixture(contributions)
            left = np.abs(sum(g * part for g, part in zip(gamma, contributions, strict=True))).sum(axis=0)
            here = np.abs(contributions[-1]).sum(axis=0)
            ratio = np.clip(here / np.where(before > 0.0, before, 1.0), 0.0, 0.99)
            before = here
            if np.all(left <= MAX_LEFT * (1.0 - ratio) * np.abs(total)):
                # with one more scattering of the mixture, which is there: sum gamma_n S_(n+1)
                found, first = terms[0], len(terms) - len(contributions)
                for n, one in enumerate(terms[1:], start=1):
                    found = found + one.times(gamma[max(n - first, 0) :].sum(axis=0))
                return found
        raise TwilightError(
            f"derivatives: zones cannot differentiate light that takes more than {MAX_STEPS} scatterings; "
            "montecarlo can"
        )

    def _direct(self, sun, elevation, azimuth, altitude_km: float) -> NodeLight:
        """g of each line of sight in a lane of its own: derivatives of its radiance by the light at the nodes."""
        grids, s, nodes = self.grids, self.grids.directions, self.grids.nodes
        series = grids.line_series
        adjoint = empty_adjoint(self.light)
        for one in np.unique(elevation):
            ends = np.array([[one], [np.inf]])
            lines = trace_lines_of_sight(
                grids.line_profile, grids.scaled.medium, altitude_km, ends, s.line_of_sight_density, True,
                grids.layout.thin_layer,
            )  # fmt: skip
            points = make_ray_points(lines.rays, grids.scattering, nodes.fine_altitude_km, 1.0, series, 0)
            points = first_wavelength_points(points)
            rays = lines.rays._replace(ground_weight=repeated(block_values(lines.rays.ground_weight, 0), 0))
            for q in np.flatnonzero(elevation == one):
                where = RayDirections(
                    np.array([0, 1]), np.cos(np.radians(azimuth[q : q + 1])), math.radians(90.0 - sun[q])
                )
                in_lane = np.zeros(LANES, np.float32)
                in_lane[q] = 1.0
                view_adjoint(rays, points, where, self.light, nodes.zenith, series, in_lane, adjoint)
        some = slice(None, None, FINE_PER_INTERVAL)
        log_mean = np.ascontiguousarray(self.light.log_mean[some])
        ground = np.exp(self.light.log_ground[:: nodes.zenith.per_interval])
        at_total = replace(
            self.adjoints[0], mean=np.exp(log_mean), log_mean=log_mean, ratio=self.light.ratio[some], ground=ground
        )
        return at_total.at_nodes(adjoint)


def _radiances(field: Field, sun: np.ndarray, elevation: np.ndarray, azimuth: np.ndarray, altitude_km: float):
    """Radiances (Q, W) in Q lines of sight, each with its sun."""
    out = np.empty((sun.size, field.medium.n_wavelengths))
    for one in np.unique(sun):
        of = sun == one
        out[of] = field.radiance(one, elevation[of], azimuth[of], observer_altitude_km=altitude_km)
    return out
