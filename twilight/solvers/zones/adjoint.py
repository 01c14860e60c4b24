"""The scattering operator run backwards, and what light scattered earlier is worth to an instrument.

All light solves U = K U + s.  Of a radiance R(U), g = dR/dU is what the light at each node adds to it along the line of
sight, and

    b = g + K'^T b

what it adds by way of all further scatterings too.  A change of the air that turns K U + s into K U + s + r then
changes R by b . r, whatever the change is: one solution for each line of sight and sun, none for each change.

K' is the derivative of K where the light is U (`adjoint_order`).  Light is that of one wavelength; the LANES hold
lines of sight and suns.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from twilight.solvers.zones.adjoint_order import RadianceAdjoint, analysis_back, scatter_back
from twilight.solvers.zones.next_order import RadianceField
from twilight.solvers.zones.ray_points import LANES, RayPoints
from twilight.solvers.zones.solution import FINE_PER_INTERVAL, MAX_OVERSHOOT, TINY, ScatteringOperator, normalised

NEGLIGIBLE = 1e-6
"""Fraction of a radiance below which a node's part in it is dropped."""


class NodeLight(NamedTuple):
    """Light at the nodes, or derivatives by it: moments (Z, T, C + 2 C', lanes), radiance of the ground (T, lanes)."""

    moments: np.ndarray
    ground: np.ndarray

    def lane(self, w: int) -> NodeLight:
        """One lane of it, repeated LANES times."""
        return NodeLight(repeated(self.moments, w), repeated(self.ground, w))

    def parts(self, light: NodeLight) -> tuple[np.ndarray, np.ndarray]:
        """What each node (Z, T, lanes), and the ground (T, lanes), of `light` adds, self being derivatives by it."""
        of_nodes = np.einsum("ztcw,ztcw->ztw", self.moments, light.moments, dtype=float)
        return of_nodes, (self.ground * light.ground).astype(float)

    def products(self, changes: NodeLight) -> np.ndarray:
        """Sums (lanes, N) of derivatives times N changes of the light."""
        of_nodes = np.einsum("xw,xn->wn", _flat(self.moments), _flat(changes.moments), dtype=float)
        return of_nodes + np.einsum("tw,tn->wn", self.ground, changes.ground, dtype=float)

    def __add__(self, other) -> NodeLight:
        return NodeLight(self.moments + other.moments, self.ground + other.ground)

    def times(self, factor: np.ndarray) -> NodeLight:
        """Each lane times a factor (lanes,)."""
        factor = np.asarray(factor, np.float32)
        return NodeLight(self.moments * factor, self.ground * factor)


def _flat(array: np.ndarray) -> np.ndarray:
    return array.reshape(-1, array.shape[-1])


def repeated(array: np.ndarray, w: int) -> np.ndarray:
    """One lane of an array (..., lanes), LANES times."""
    return np.ascontiguousarray(np.repeat(array[..., w : w + 1], LANES, axis=-1))


def repeated_points(points: RayPoints, w: int) -> RayPoints:
    """Points of rays with one wavelength in all lanes."""
    of_lanes = {key: repeated(getattr(points, key), w) for key in ("chi", "weight", "matrix")}
    return points._replace(**of_lanes)


def refined_back(rule, back: RadianceAdjoint, log_mean: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Derivatives by logarithm (Z, T, LANES) and relative moments (Z, T, C, LANES) at the nodes, from those on the fine
    altitudes: `FieldNodes.refine_altitude` backwards.

    rule: that of its altitudes; log_mean (Z, T, LANES): logarithm of the mean radiance at the nodes
    """
    node, weight = rule
    rough = np.zeros((node.shape[0], *log_mean.shape[1:]), np.float32)
    for j in range(4):
        rough += weight[:, j, None, None] * log_mean[node[:, j]]
    interval = np.minimum(np.arange(rough.shape[0]) // FINE_PER_INTERVAL, log_mean.shape[0] - 2)
    low, high = log_mean[interval], log_mean[interval + 1]
    slack = np.float32(MAX_OVERSHOOT) * (np.float32(1.0) + np.abs(high - low))
    below, above = rough < np.minimum(low, high) - slack, rough > np.maximum(low, high) + slack
    of_log, of_ratio = np.zeros_like(log_mean), np.zeros((*log_mean.shape[:2], *back.ratio.shape[2:]), np.float32)
    free = np.where(below | above, np.float32(0.0), back.log_mean)
    for k in range(node.shape[0]):
        for j in range(4):
            if weight[k, j] != 0.0:
                of_log[node[k, j]] += weight[k, j] * free[k]
                of_ratio[node[k, j]] += weight[k, j] * back.ratio[k]
    if below.any() or above.any():
        # a bound moves with its own end of the interval, and its slack with both
        at_low = (below & (low <= high)) | (above & (low > high))
        at_high = (below | above) & ~at_low
        own, other = np.float32(1.0 + MAX_OVERSHOOT) * back.log_mean, np.float32(-MAX_OVERSHOOT) * back.log_mean
        np.add.at(of_log, interval, np.where(at_low, own, np.where(at_high, other, 0.0)))
        np.add.at(of_log, interval + 1, np.where(at_high, own, np.where(at_low, other, 0.0)))
    return of_log, of_ratio


def normalised_back(of_log: np.ndarray, of_ratio: np.ndarray, mean: np.ndarray, ratio: np.ndarray) -> np.ndarray:
    """Derivatives by moments (Z, T, C, LANES) from those by the logarithm of their mean and the moments over it."""
    lit = mean > TINY
    inverse = np.where(lit, 1.0 / np.where(lit, mean, 1.0), 0.0).astype(np.float32)
    moments = of_ratio * inverse[:, :, None]
    through_mean = np.einsum("ztcw,ztcw->ztw", of_ratio[:, :, 1:], ratio[:, :, 1:])
    moments[:, :, 0] = (of_log - through_mean) * inverse
    return moments


@dataclass(frozen=True)
class BackwardOperator:
    """K'^T at the light of one order, or of all, for one wavelength in all lanes.

    operator: K, whose points are those of one wavelength; mean (Z, T, LANES), log_mean, ratio: of the light at the
    nodes; ground (T, LANES): radiance of the lit ground; light: on fine altitudes; after: K of the light, by which what
    is negligible is known
    """

    operator: ScatteringOperator
    mean: np.ndarray
    log_mean: np.ndarray
    ratio: np.ndarray
    ground: np.ndarray
    light: RadianceField
    albedo: float
    ground_weight: np.ndarray
    ground_angle: np.ndarray
    after: NodeLight

    @staticmethod
    def of(operator: ScatteringOperator, w: int, light: NodeLight, after: NodeLight) -> BackwardOperator:
        """Of the operator of a block at its wavelength w; light, after: of that wavelength in all lanes."""
        n = operator.nodes
        mean = light.moments[:, :, 0]
        log_mean, ratio = normalised(mean, light.moments)
        weight, angle = operator.ground()
        one = replace(operator, points=repeated_points(operator.points, w))
        field = RadianceField(*n.refine_altitude(log_mean, ratio), *operator.ground_light(light.ground))
        index = min(operator.block * LANES + w, operator.medium.n_wavelengths - 1)
        albedo = float(operator.medium.ground_albedo[index])
        return BackwardOperator(
            one, mean, log_mean, ratio, light.ground, field, albedo, repeated(weight, w), angle, after
        )

    def __call__(self, wanted: NodeLight, total: np.ndarray) -> NodeLight:
        """Derivatives by the light from those by the light one scattering later.

        total (LANES,): the number whose derivatives they are, of which NEGLIGIBLE parts are dropped
        """
        o, a, n = self.operator, self.operator.angles, self.operator.nodes
        of_nodes, of_ground = wanted.parts(self.after)
        kept = np.abs(of_nodes) > NEGLIGIBLE * total
        kept_ground = np.abs(of_ground) > NEGLIGIBLE * total
        moments = np.ascontiguousarray(wanted.moments * kept[:, :, None], np.float32)
        radiance = np.zeros((moments.shape[0], a.cosine.shape[1], moments.shape[1], a.azimuth.size,
                             3 if o.polarised else 1, LANES), np.float32)  # fmt: skip
        lit = (o.ground_fraction() * (self.albedo / a.azimuth.size)).astype(np.float32)
        radiance[0, :, :, :, 0] += (lit[:, None, None] * (wanted.ground * kept_ground))[:, :, None]
        analysis = (a.analysis * a.share[:, None, None]).astype(np.float32)
        analysis_back(moments, analysis, a.spin2_analysis.astype(np.float32), radiance)
        seen = np.repeat(kept.any(axis=2)[:, None], a.cosine.shape[1], axis=1)
        seen[0] |= kept_ground.any(axis=1)
        back = empty_back(self.light)
        scatter_back(
            o.rays.first, o.points, o.geometry.place, self.light, n.zenith_rule, a.series, self.ground_weight,
            self.ground_angle, a.cosine.shape[1], radiance, seen, back,
        )  # fmt: skip
        return self.at_nodes(back)

    def at_nodes(self, back: RadianceAdjoint) -> NodeLight:
        """Derivatives by the light at the nodes from those by the light between them."""
        of_log, of_ratio = refined_back(self.operator.nodes.altitude_rule, back, self.log_mean)
        moments = normalised_back(of_log, of_ratio, self.mean, self.ratio)
        node, weight = self.operator.nodes.zenith_rule[:2]
        of_ground = np.zeros_like(self.ground)
        for j in range(4):
            np.add.at(of_ground, node[:, j], weight[:, j, None] * back.log_ground)
        return NodeLight(moments, (of_ground / np.maximum(self.ground, TINY)).astype(np.float32))


def empty_back(light: RadianceField) -> RadianceAdjoint:
    """No derivatives yet."""
    return RadianceAdjoint(np.zeros_like(light.log_mean), np.zeros_like(light.ratio), np.zeros_like(light.log_ground))
