"""The adjoint of the scattering operator, and derivatives of a radiance by light that was scattered earlier.

All light solves U = K U + s.  Of a radiance R(U), g = dR/dU is what the light at each node adds to it along the line of
sight, and

    b = g + K'^T b

what it adds by way of all further scatterings too.  A change of the air that turns K U + s into K U + s + r then
changes R by b . r, whatever the change is: one solution for each line of sight and sun, none for each change.

K' is the derivative of K where the light is U (`adjoint_order`).  Light is that of one wavelength, repeated in all
SIMD lanes; derivatives are in each lane those of the radiance in another line of sight or under another sun.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from twilight.solvers.zones.adjoint_order import RadianceAdjoint, analysis_adjoint, scatter_adjoint
from twilight.solvers.zones.next_order import RadianceField
from twilight.solvers.zones.ray_points import LANES, NodeRays, RayPoints
from twilight.solvers.zones.solution import FINE_PER_INTERVAL, MAX_OVERSHOOT, TINY, ScatteringOperator, normalised
from twilight.solvers.zones.sunlight import Sunlight

NEGLIGIBLE = 1e-6
"""Fraction of a radiance below which a node's part in it is dropped."""


class NodeLight(NamedTuple):
    """Light at the nodes, or derivatives by it: moments (Z, T, C + 2 C', LANES), radiance of the ground (T, LANES)."""

    moments: np.ndarray
    ground: np.ndarray

    def first_wavelength(self) -> NodeLight:
        """The light of the block's first wavelength, in all lanes."""
        return NodeLight(repeated(self.moments, 0), repeated(self.ground, 0))

    def contributions(self, light: NodeLight) -> tuple[np.ndarray, np.ndarray]:
        """What each node (Z, T, LANES), and the ground (T, LANES), of `light` adds, self being derivatives by it."""
        of_nodes = np.einsum("ztcw,ztcw->ztw", self.moments, light.moments, dtype=float)
        return of_nodes, (self.ground * light.ground).astype(float)

    def products(self, changes: NodeLight) -> np.ndarray:
        """Sums (LANES, N) of derivatives times N changes of the light."""
        of_nodes = np.einsum("xw,xn->wn", _flat(self.moments), _flat(changes.moments), dtype=float)
        return of_nodes + np.einsum("tw,tn->wn", self.ground, changes.ground, dtype=float)

    def __add__(self, other) -> NodeLight:
        return NodeLight(self.moments + other.moments, self.ground + other.ground)

    def __sub__(self, other) -> NodeLight:
        return NodeLight(self.moments - other.moments, self.ground - other.ground)

    def times(self, factor: np.ndarray) -> NodeLight:
        """Each lane times a factor (LANES,)."""
        factor = np.asarray(factor, np.float32)
        return NodeLight(self.moments * factor, self.ground * factor)


def _flat(array: np.ndarray) -> np.ndarray:
    return array.reshape(-1, array.shape[-1])


def repeated(array: np.ndarray, w: int) -> np.ndarray:
    """One wavelength of an array (..., W), in all LANES."""
    return np.ascontiguousarray(np.repeat(array[..., w : w + 1], LANES, axis=-1))


def first_wavelength_points(points: RayPoints) -> RayPoints:
    """Points of rays with the block's first wavelength in all lanes."""
    return points._replace(**{key: repeated(getattr(points, key), 0) for key in ("chi", "weight", "matrix")})


def scattered_sunlight(operator: ScatteringOperator, sunlight: Sunlight) -> NodeLight:
    """Sunlight scattered once."""
    return NodeLight(*operator.analyse(operator.first_order(sunlight))[1:])


def next_light(operator: ScatteringOperator, light: NodeLight) -> NodeLight:
    """Light of the next order of scattering."""
    mean = np.ascontiguousarray(light.moments[:, :, 0])
    return NodeLight(*operator.analyse(operator.next_order(mean, light.moments, light.ground))[1:])


def refinement_adjoint(rule, adjoint: RadianceAdjoint, log_mean: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Derivatives by logarithm (Z, T, LANES) and relative moments (Z, T, C, LANES) at the nodes, from those on the fine
    altitudes: `FieldNodes.refine_altitude` backwards.

    rule: `FieldNodes.altitude_rule`; log_mean (Z, T, LANES): logarithm of the mean radiance at the nodes
    """
    node, weight = rule
    rough = np.zeros((node.shape[0], *log_mean.shape[1:]), np.float32)
    for j in range(4):
        rough += weight[:, j, None, None] * log_mean[node[:, j]]
    interval = np.minimum(np.arange(rough.shape[0]) // FINE_PER_INTERVAL, log_mean.shape[0] - 2)
    low, high = log_mean[interval], log_mean[interval + 1]
    slack = np.float32(MAX_OVERSHOOT) * (np.float32(1.0) + np.abs(high - low))
    below, above = rough < np.minimum(low, high) - slack, rough > np.maximum(low, high) + slack
    of_log, of_ratio = np.zeros_like(log_mean), np.zeros((*log_mean.shape[:2], *adjoint.ratio.shape[2:]), np.float32)
    free = np.where(below | above, np.float32(0.0), adjoint.log_mean)
    for k in range(node.shape[0]):
        for j in range(4):
            if weight[k, j] != 0.0:
                of_log[node[k, j]] += weight[k, j] * free[k]
                of_ratio[node[k, j]] += weight[k, j] * adjoint.ratio[k]
    if below.any() or above.any():
        # a bound moves with its own end of the interval, and its slack with both
        at_low = (below & (low <= high)) | (above & (low > high))
        at_high = (below | above) & ~at_low
        own, other = np.float32(1.0 + MAX_OVERSHOOT) * adjoint.log_mean, np.float32(-MAX_OVERSHOOT) * adjoint.log_mean
        np.add.at(of_log, interval, np.where(at_low, own, np.where(at_high, other, 0.0)))
        np.add.at(of_log, interval + 1, np.where(at_high, own, np.where(at_low, other, 0.0)))
    return of_log, of_ratio


def normalisation_adjoint(of_log: np.ndarray, of_ratio: np.ndarray, mean: np.ndarray, ratio: np.ndarray) -> np.ndarray:
    """Derivatives by moments (Z, T, C, LANES) from those by the logarithm of their mean and the moments over it."""
    lit = mean > TINY
    inverse = np.where(lit, 1.0 / np.where(lit, mean, 1.0), 0.0).astype(np.float32)
    moments = of_ratio * inverse[:, :, None]
    through_mean = np.einsum("ztcw,ztcw->ztw", of_ratio[:, :, 1:], ratio[:, :, 1:])
    moments[:, :, 0] = (of_log - through_mean) * inverse
    return moments


@dataclass(frozen=True)
class AdjointOperator:
    """K'^T at the light of one order, or of all, for one wavelength in all lanes.

    operator, rays: of K, with points and transmittances of that wavelength; mean (Z, T, LANES), log_mean, ratio: of the
    light at the nodes; ground (T, LANES): radiance of the lit ground; light: on fine altitudes; after: K of the light,
    by which what is negligible is known
    """

    operator: ScatteringOperator
    rays: NodeRays
    mean: np.ndarray
    log_mean: np.ndarray
    ratio: np.ndarray
    ground: np.ndarray
    light: RadianceField
    albedo: float
    after: NodeLight

    @staticmethod
    def of(operator: ScatteringOperator, light: NodeLight, after: NodeLight) -> AdjointOperator:
        """Of the operator of a block at its first wavelength; light, after: of that wavelength in all lanes."""
        mean = light.moments[:, :, 0]
        log_mean, ratio = normalised(mean, light.moments)
        rays = operator.node_rays()
        return AdjointOperator(
            replace(operator, points=first_wavelength_points(operator.points)),
            rays._replace(ground_weight=repeated(rays.ground_weight, 0)),
            mean,
            log_mean,
            ratio,
            light.ground,
            RadianceField(*operator.nodes.refine_altitude(log_mean, ratio), operator.log_ground(light.ground)),
            float(operator.medium.ground_albedo[operator.block * LANES]),
            after,
        )

    def __call__(self, derivatives: NodeLight, total: np.ndarray) -> NodeLight:
        """Derivatives by the light from those by the light one scattering later.

        total (LANES,): the number whose derivatives they are, of which NEGLIGIBLE parts are dropped
        """
        o, a = self.operator, self.operator.angles
        of_nodes, of_ground = derivatives.contributions(self.after)
        counts = np.abs(of_nodes) > NEGLIGIBLE * total
        ground_counts = np.abs(of_ground) > NEGLIGIBLE * total
        moments = np.ascontiguousarray(derivatives.moments * counts[:, :, None], np.float32)
        radiance = o.no_light()
        lit = (o.ground_fraction() * (self.albedo / a.azimuth.size)).astype(np.float32)
        radiance[0, :, :, :, 0] += (lit[:, None, None] * (derivatives.ground * ground_counts))[:, :, None]
        analysis = (a.analysis * a.taper[:, None, None]).astype(np.float32)
        analysis_adjoint(moments, analysis, a.spin2_analysis.astype(np.float32), radiance)
        seen = np.repeat(counts.any(axis=2)[:, None], a.cosine.shape[1], axis=1)
        seen[0] |= ground_counts.any(axis=1)
        adjoint = empty_adjoint(self.light)
        scatter_adjoint(self.rays, o.points, self.light, o.nodes.zenith, a.series, radiance, seen, adjoint)
        return self.at_nodes(adjoint)

    def at_nodes(self, adjoint: RadianceAdjoint) -> NodeLight:
        """Derivatives by the light at the nodes from those by the light between them."""
        nodes = self.operator.nodes
        of_log, of_ratio = refinement_adjoint(nodes.altitude_rule, adjoint, self.log_mean)
        moments = normalisation_adjoint(of_log, of_ratio, self.mean, self.ratio)
        of_ground = np.zeros_like(self.ground)
        for j in range(4):
            np.add.at(of_ground, nodes.zenith.node[:, j], nodes.zenith.weight[:, j, None] * adjoint.log_ground)
        return NodeLight(moments, (of_ground / np.maximum(self.ground, TINY)).astype(np.float32))


def empty_adjoint(light: RadianceField) -> RadianceAdjoint:
    """No derivatives yet."""
    return RadianceAdjoint(np.zeros_like(light.log_mean), np.zeros_like(light.ratio), np.zeros_like(light.log_ground))
