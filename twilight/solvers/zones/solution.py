"""The scattering operator of one block of wavelengths at all nodes, and the solution that its orders sum to."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from twilight.atmosphere.medium import Medium
from twilight.base.threads import in_slices
from twilight.solvers.zones.first_order import BeamAtPoints, PhaseTables, scatter_sunlight
from twilight.solvers.zones.grid import Angles, conserving, cubic_refinement
from twilight.solvers.zones.next_order import CubicRule, RadianceField, moments_of, scatter
from twilight.solvers.zones.ray_points import (
    LANES,
    RayGeometry,
    RayPoints,
    SpeciesMoments,
    SunlitRayPoints,
    lanes_of,
    make_sunlit_points,
)
from twilight.solvers.zones.spin2_harmonics import scattering_geometry
from twilight.solvers.zones.sunlight import Sunlight
from twilight.solvers.zones.water import (
    cells,
    mirror_sunlight,
    place_of_cosine,
    reflect,
    reflected_sky,
    surface_of,
)
from twilight.transport.lines import ALTITUDE
from twilight.transport.profile import Profile, at_wavelengths
from twilight.transport.ray_bundle import RayBundle, trace_rays
from twilight.transport.scaling import species_polarising_phase

TINY = 1e-30
"""Least mean radiance over F0 [sr^-1] that counts as light."""
PHASE_NODES = 2049
"""Cosines of the scattering angle, from -1 to 1, at which phase functions of sunlight are tabulated."""
MAX_OVERSHOOT = 0.2
"""Largest overshoot of an interpolated logarithm beyond the two nodes around it, over 1 + their difference."""
SUNLIT_AT_ONCE = 8
"""Altitudes whose rays for sunlight are there at one time: there are several times as many points as of the others."""
FINE_PER_INTERVAL = 3
"""Steps of the fine grids of altitudes and of solar zenith angles in every interval of the nodes."""


@dataclass(frozen=True)
class FieldNodes:
    """altitude_km (Z,), zenith_rad (T,): where the field is solved; fine_altitude_km (Z',), fine_rad (T',): finer grids
    to which it is interpolated by cubics, between which it is linear."""

    altitude_km: np.ndarray
    zenith_rad: np.ndarray
    fine_altitude_km: np.ndarray
    fine_rad: np.ndarray
    altitude_rule: tuple[np.ndarray, np.ndarray]
    zenith_rule: CubicRule

    @staticmethod
    def of(altitude_km: np.ndarray, zenith_deg: np.ndarray, jumps_km: np.ndarray) -> FieldNodes:
        zenith = np.radians(zenith_deg)
        fine, node, weight = cubic_refinement(zenith, FINE_PER_INTERVAL)
        fine_km, node_km, weight_km = cubic_refinement(altitude_km, FINE_PER_INTERVAL, jumps_km)
        return FieldNodes(
            altitude_km,
            zenith,
            fine_km,
            fine,
            (node_km, weight_km.astype(np.float32)),
            CubicRule(node, weight.astype(np.float32), FINE_PER_INTERVAL),
        )

    def refine_zenith(self, values: np.ndarray) -> np.ndarray:
        """Values (T, ...) on the fine grid of solar zenith angles."""
        return _apply(self.zenith_rule[:2], values)

    def refine_altitude(self, log_mean: np.ndarray, ratio: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Logarithms (Z, T, 8) and relative moments (Z, T, C, 8) on the fine grid of altitudes.

        A cubic through logarithms that differ by tens, in air that is black, would swing from order to order: it stays
        near its interval's ends.
        """
        log_fine = _apply(self.altitude_rule, log_mean)
        interval = np.minimum(np.arange(log_fine.shape[0]) // FINE_PER_INTERVAL, log_mean.shape[0] - 2)
        low, high = log_mean[interval], log_mean[interval + 1]
        slack = np.float32(MAX_OVERSHOOT) * (np.float32(1.0) + np.abs(high - low))
        np.clip(log_fine, np.minimum(low, high) - slack, np.maximum(low, high) + slack, out=log_fine)
        return log_fine, _apply(self.altitude_rule, ratio)


def _apply(rule: tuple[np.ndarray, np.ndarray], values: np.ndarray) -> np.ndarray:
    node, weight = rule
    flat = np.asarray(values, np.float32).reshape(values.shape[0], -1)
    out = np.zeros((node.shape[0], flat.shape[1]), np.float32)
    for j in range(4):
        out += weight[:, j, None] * flat[node[:, j]]
    return out.reshape(-1, *values.shape[1:])


@dataclass(frozen=True)
class Solution:
    """Light scattered at least once, the sum of all orders, for one block of wavelengths.

    log_mean, ratio, log_ground, amplitudes: as in `RadianceField`
    orders: orders of scattering that were followed, or steps of the solution for all orders at once; residual: largest
    relative change, at any node, that the last of them made to the sum with its estimated rest
    """

    log_mean: np.ndarray
    ratio: np.ndarray
    log_ground: np.ndarray
    amplitudes: np.ndarray
    orders: int
    residual: float

    @property
    def light(self) -> RadianceField:
        return RadianceField(self.log_mean, self.ratio, self.log_ground, self.amplitudes)


@dataclass(frozen=True)
class ScatteringOperator:
    """One order of scattering from the order before, U_(n+1) = K U_n, for one block of wavelengths.

    medium: before scaling, with its ground; scattering: of the scaled medium; forward_fraction (K, W): what scaling
    took from each aerosol's phase function; water: its reflection matrices for every wavelength of the block, of
    `reflection`, None for land; profile: through which rays go; first_order_step_density: of the steps on which
    sunlight is scattered
    """

    nodes: FieldNodes
    angles: Angles
    rays: RayBundle
    points: RayPoints
    geometry: RayGeometry
    medium: Medium
    scattering: SpeciesMoments
    forward_fraction: np.ndarray
    block: int
    water: np.ndarray | None
    profile: Profile
    first_order_step_density: float

    @property
    def polarised(self) -> bool:
        return self.angles.spin2_degree.size > 0

    def ground(self) -> tuple[np.ndarray, np.ndarray]:
        """Where rays end on the ground: (transmittance (R, LANES), place in the geometry table (R,))."""
        return (
            lanes_of(self.rays.ground_weight, self.block),
            (self.rays.ground_angle_rad / self.geometry.step_rad).astype(np.float32),
        )

    def _empty(self) -> np.ndarray:
        a = self.angles
        return np.zeros(
            (
                self.nodes.altitude_km.size,
                a.cosine.shape[1],
                self.nodes.zenith_rad.size,
                a.azimuth.size,
                3 if self.polarised else 1,
                LANES,
            ),
            np.float32,
        )

    def first_order(self, sunlight: Sunlight) -> np.ndarray:
        """Stokes parameters of sunlight scattered once."""
        out = self._empty()
        light, ground_light = lanes_of(sunlight.log_light, self.block), lanes_of(sunlight.ground, self.block)
        scattered = self._scattered()
        factor = (lanes_of(self.medium.ground_albedo, self.block) / np.pi).astype(np.float32)
        ground_weight, ground_angle = self.ground()
        n_polar = self.angles.cosine.shape[1]
        for start in range(0, out.shape[0], SUNLIT_AT_ONCE):
            nodes = slice(start, start + SUNLIT_AT_ONCE)
            rays, points = self._sunlit(nodes)
            z = rays.place[:, ALTITUDE]
            row = np.clip(np.searchsorted(sunlight.altitude_km, z, side="right") - 1, 0, sunlight.altitude_km.size - 2)
            fraction = np.clip((z - sunlight.altitude_km[row]) / np.diff(sunlight.altitude_km)[row], 0.0, 1.0)
            beams = BeamAtPoints(
                row, fraction.astype(np.float32), sunlight.edge_rad, sunlight.span_rad, light, ground_light
            )
            some = scattered._replace(angle=scattered.angle[nodes])
            if self.polarised:
                some = some._replace(turn=scattered.turn[nodes])
            of_nodes = slice(start * n_polar, (start + SUNLIT_AT_ONCE) * n_polar)
            in_slices(
                partial(
                    scatter_sunlight, rays.first, points, self.geometry.place, beams, some, ground_weight[of_nodes],
                    ground_angle[of_nodes], factor, n_polar, out[nodes],
                ),
                out[nodes].shape[0],
            )  # fmt: skip
        if self.water is not None:
            surface = surface_of(self.medium, lanes_of(np.arange(self.medium.n_wavelengths), self.block).astype(int))
            of_rays = cells(self.angles.cosine, self.angles.weight, self.rays.ground_cosine)
            in_slices(
                lambda begin, end: mirror_sunlight(
                    self.geometry.place, beams, ground_weight, ground_angle, of_rays, surface, out, begin, end
                ),
                out.shape[0],
            )
        return out

    def _sunlit(self, nodes: slice) -> tuple[RayBundle, SunlitRayPoints]:
        """Rays from some of the nodes for sunlight, two points a step, through the wavelengths of the block."""
        cosine = self.angles.cosine[nodes]
        profile = at_wavelengths(self.profile, slice(self.block * LANES, (self.block + 1) * LANES))
        start = np.repeat(self.nodes.altitude_km[nodes], cosine.shape[1])
        rays = trace_rays(profile, start, cosine.ravel(), self.first_order_step_density, pairs=True)
        return rays, make_sunlit_points(rays, self.scattering, self.geometry.step_rad, self.block)

    def _scattered(self) -> PhaseTables:
        a = self.angles
        chi = self.scattering.chi
        degree = np.arange(chi.shape[1])
        nodes = np.linspace(-1.0, 1.0, PHASE_NODES)
        legendre = np.polynomial.legendre.legvander(nodes, degree.size - 1) * ((2 * degree + 1) / (4 * np.pi))
        p11 = lanes_of(np.einsum("nl,slw->nsw", legendre, chi), self.block)
        p12 = np.zeros((1, 1, LANES), np.float32)
        turn = np.zeros((1, 1, 1, 1, 2), np.float32)
        azimuth = a.azimuth[None, None, None, :]
        cosine, twice_cos, twice_sin = scattering_geometry(
            a.cosine[:, :, None, None],
            np.cos(azimuth),
            np.sin(azimuth),
            self.nodes.zenith_rad[None, None, :, None],
        )
        if self.polarised:
            p12 = lanes_of(species_polarising_phase(self.medium, self.forward_fraction, nodes), self.block)
            turn = np.stack([twice_cos, twice_sin], axis=-1).astype(np.float32)
        return PhaseTables(p11, p12, ((cosine + 1.0) * (0.5 * (PHASE_NODES - 1))).astype(np.float32), turn)

    def next_order(self, mean: np.ndarray, moments: np.ndarray, ground: np.ndarray) -> np.ndarray:
        """Stokes parameters of the next order from the mean (Z, T, 8), the moments and the ground, as of `analyse`, of
        the one before."""
        out = self._empty()
        n = self.nodes
        light = RadianceField(*n.refine_altitude(*normalised(mean, moments)), *self.ground_light(ground))
        ground_weight, ground_angle = self.ground()
        of_land = ground_weight if self.water is None else np.zeros_like(ground_weight)
        series = self.angles.series
        in_slices(
            lambda begin, end: scatter(
                self.rays.first, self.points, self.geometry.place, light, n.zenith_rule, series, of_land, ground_angle,
                self.angles.cosine.shape[1], out, begin, end,
            ),
            out.shape[0],
        )  # fmt: skip
        if self.water is not None:
            ground_place = place_of_cosine(-self.rays.ground_cosine)
            in_slices(
                lambda begin, end: reflect(
                    self.geometry.place, light, ground_weight, ground_angle, ground_place, out, begin, end
                ),
                out.shape[0],
            )
        return out

    def analyse(self, radiance: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """(mean (Z, T, LANES), moments (Z, T, C + 2 C', 8), radiance of the lit ground (T, 8)) of light at the nodes.

        Water has a ground (1 + amplitudes, T, 8): the light that falls on it, over pi, and what `reflected_sky` makes
        of it.
        """
        a = self.angles
        moments = np.zeros((radiance.shape[0], radiance.shape[2], a.n_moments, LANES), np.float32)
        analysis = (a.analysis * a.share[:, None, None]).astype(np.float32)
        of_spin2 = a.spin2_analysis.astype(np.float32)
        in_slices(lambda begin, end: moments_of(radiance, analysis, of_spin2, moments, begin, end), radiance.shape[0])
        mean = moments[:, :, 0]
        lit = np.einsum("m,mtfw->tw", self.ground_fraction() / a.azimuth.size, radiance[0, :, :, :, 0])
        albedo = lanes_of(self.medium.ground_albedo, self.block)
        if self.water is None:
            return mean, moments, lit * albedo
        amplitudes = reflected_sky(self.water, radiance[0, a.below :], a.azimuth)
        amplitudes[:, 0, 0] += lit * albedo
        return mean, moments, np.concatenate([lit[None], amplitudes.reshape(-1, *lit.shape)]).astype(np.float32)

    def ground_light(self, ground: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """(log_ground, amplitudes) of `RadianceField` from the ground of `analyse`."""
        if self.water is None:
            return self.nodes.refine_zenith(np.log(np.maximum(ground, TINY))), np.zeros((0, 0, 0, 0, 0), np.float32)
        lit = np.maximum(ground[0], TINY)
        amplitudes = np.where(ground[0] > TINY, ground[1:] / lit, 0.0)
        _, azimuthal_orders, n_cosines, n_stokes = self.water.shape[:4]
        fine = self.nodes.refine_zenith(amplitudes.transpose(1, 0, 2))
        shape = (fine.shape[0], n_cosines, n_stokes, azimuthal_orders, LANES)
        return self.nodes.refine_zenith(np.log(lit)), np.ascontiguousarray(fine.reshape(shape))

    def conserving(self) -> ScatteringOperator:
        """The same operator with directions that conserve the energy of nearly isotropic light."""
        return replace(self, angles=conserving(self.angles))

    def ground_fraction(self) -> np.ndarray:
        """Fraction (M,) of each polar angle in the light that falls on the ground; of a uniform sky the sum is 1."""
        up = np.maximum(self.angles.cosine[0], 0.0) * self.angles.weight[0]
        return up / up.sum()


def normalised(mean: np.ndarray, moments: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(logarithm of the mean, moments relative to it); no light is isotropic and tiny."""
    lit = mean > TINY
    safe = np.where(lit, mean, 1.0)
    ratio = np.where(lit[:, :, None], moments / safe[:, :, None], 0.0)
    ratio[:, :, 0] = 1.0
    log_mean = np.log(np.where(lit, safe, TINY))
    return np.ascontiguousarray(log_mean, np.float32), np.ascontiguousarray(ratio, np.float32)
