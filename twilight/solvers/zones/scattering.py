"""The scattering operator of one block of wavelengths at all nodes, and the solution that its orders sum to."""

from __future__ import annotations

import functools
import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from typing import NamedTuple

import numpy as np

from twilight.atmosphere.medium import Medium
from twilight.base.conventions import DARK
from twilight.base.threads import in_slices
from twilight.solvers.zones import constants as tuned
from twilight.solvers.zones import ray_points
from twilight.solvers.zones.air_needs import taper
from twilight.solvers.zones.angles import Angles, conserving_angles, make_angles, scattering_geometry
from twilight.solvers.zones.first_order import BeamAtPoints, PhaseTables, Sunlight, scatter_sunlight
from twilight.solvers.zones.grids import FieldGrids, FieldNodes
from twilight.solvers.zones.next_order import RadianceField, moments_of, scatter
from twilight.transport.lines import ALTITUDE, ANGLE, RayBundle, horizon_cosine, trace_rays
from twilight.transport.profile import Profile, at_wavelengths
from twilight.transport.scaling import species_polarising_phase

SUNLIT_AT_ONCE = 8
"""Altitudes whose rays for sunlight are there at one time: there are several times as many points as of the others."""


class Solution(NamedTuple):
    """Light scattered at least once, the sum of all orders, for one block of wavelengths.

    orders: orders of scattering that were followed, or steps of the solution for all orders at once; residual: largest
    relative change, at any node, that the last of them made to the sum with its estimated rest
    """

    light: RadianceField
    orders: int
    residual: float


@dataclass(frozen=True)
class ScatteringOperator:
    """One order of scattering from the order before, U_(n+1) = K U_n, for one block of wavelengths.

    medium: before scaling, with its ground; scattering: of the scaled medium; forward_fraction (K, W): what scaling
    took from each aerosol's phase function; profile: through which rays go; first_order_step_density: of the steps on
    which sunlight is scattered
    """

    nodes: FieldNodes
    angles: Angles
    rays: RayBundle
    points: ray_points.RayPoints
    geometry: ray_points.RayGeometry
    medium: Medium
    scattering: ray_points.SpeciesMoments
    forward_fraction: np.ndarray
    block: int
    profile: Profile
    first_order_step_density: float

    @property
    def polarised(self) -> bool:
        return self.angles.spin2_degree.size > 0

    def node_rays(self) -> ray_points.NodeRays:
        """The rays, for kernels."""
        ground_place = (self.rays.ground_angle_rad / self.geometry.step_rad).astype(np.float32)
        return ray_points.NodeRays(
            self.rays.first,
            self.geometry.place,
            ray_points.block_values(self.rays.ground_weight, self.block),
            ground_place,
        )

    @functools.cached_property
    def _sequence(self) -> np.ndarray:
        """`sequence` of `next_order.scatter`."""
        node, polar = np.divmod(
            np.repeat(np.arange(self.rays.first.size - 1), np.diff(self.rays.first)), self.angles.cosine.shape[1]
        )
        order = np.lexsort((self.points.node, node))
        return np.stack([order, polar[order]], axis=1)

    def no_light(self) -> np.ndarray:
        """Stokes parameters (Z, M, T, F, Stokes, LANES) of zero."""
        n_altitudes, n_polar = self.angles.cosine.shape
        n_zenith, n_azimuth = self.nodes.zenith.nodes_rad.size, self.angles.azimuth.size
        return np.zeros(
            (n_altitudes, n_polar, n_zenith, n_azimuth, 3 if self.polarised else 1, ray_points.LANES), np.float32
        )

    def first_order(self, sunlight: Sunlight) -> np.ndarray:
        """Stokes parameters of sunlight scattered once."""
        out = self.no_light()
        light, ground_light = (
            ray_points.block_values(sunlight.log_light, self.block),
            ray_points.block_values(sunlight.ground, self.block),
        )
        phases = self._phase_tables()
        factor = (ray_points.block_values(self.medium.ground_albedo, self.block) / np.pi).astype(np.float32)
        all_rays = self.node_rays()
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
            some = phases._replace(angle=phases.angle[nodes])
            if self.polarised:
                some = some._replace(rotation=phases.rotation[nodes])
            of_nodes = slice(start * n_polar, (start + SUNLIT_AT_ONCE) * n_polar)
            some_rays = ray_points.NodeRays(
                rays.first, all_rays.geometry, all_rays.ground_weight[of_nodes], all_rays.ground_place[of_nodes]
            )
            in_slices(
                partial(scatter_sunlight, some_rays, points, beams, some, factor, out[nodes]), out[nodes].shape[0]
            )
        return out

    def _sunlit(self, nodes: slice) -> tuple[RayBundle, ray_points.SunlitRayPoints]:
        """Rays from some of the nodes for sunlight, two points a step, through the wavelengths of the block."""
        cosine = self.angles.cosine[nodes]
        profile = at_wavelengths(
            self.profile, slice(self.block * ray_points.LANES, (self.block + 1) * ray_points.LANES)
        )
        start = np.repeat(self.nodes.altitude_km[nodes], cosine.shape[1])
        rays = trace_rays(profile, start, cosine.ravel(), self.first_order_step_density, pairs=True)
        return rays, ray_points.make_sunlit_points(rays, self.scattering, self.geometry.step_rad, self.block)

    def _phase_tables(self) -> PhaseTables:
        a = self.angles
        chi = self.scattering.chi
        degree = np.arange(chi.shape[1])
        nodes = np.linspace(-1.0, 1.0, tuned.PHASE_NODES)
        legendre = np.polynomial.legendre.legvander(nodes, degree.size - 1) * ((2 * degree + 1) / (4 * np.pi))
        p11 = ray_points.block_values(np.einsum("nl,slw->nsw", legendre, chi), self.block)
        p12 = np.zeros((1, 1, ray_points.LANES), np.float32)
        rotation = np.zeros((1, 1, 1, 1, 2), np.float32)
        azimuth = a.azimuth[None, None, None, :]
        cosine, twice_cos, twice_sin = scattering_geometry(
            a.cosine[:, :, None, None],
            np.cos(azimuth),
            np.sin(azimuth),
            self.nodes.zenith.nodes_rad[None, None, :, None],
        )
        if self.polarised:
            p12 = ray_points.block_values(
                species_polarising_phase(self.medium, self.forward_fraction, nodes), self.block
            )
            rotation = np.stack([twice_cos, twice_sin], axis=-1).astype(np.float32)
        return PhaseTables(p11, p12, ((cosine + 1.0) * (0.5 * (tuned.PHASE_NODES - 1))).astype(np.float32), rotation)

    def next_order(self, mean: np.ndarray, moments: np.ndarray, ground: np.ndarray) -> np.ndarray:
        """Stokes parameters of the next order from the mean (Z, T, LANES), the moments and the ground, as of `analyse`,
        of the order before."""
        out = self.no_light()
        light = RadianceField(*self.nodes.refine_altitude(*normalised(mean, moments)), self.log_ground(ground))
        rays = self.node_rays()
        of_points = rays, self.points, self._sequence
        in_slices(partial(scatter, *of_points, light, self.nodes.zenith, self.angles.series, out), out.shape[0])
        return out

    def analyse(self, radiance: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """(mean (Z, T, LANES), moments (Z, T, C + 2 C', LANES), radiance of the lit ground (T, LANES)) of light at the
        nodes."""
        a = self.angles
        moments = np.zeros((radiance.shape[0], radiance.shape[2], a.n_moments, ray_points.LANES), np.float32)
        analysis = (a.analysis * a.taper[:, None, None]).astype(np.float32)
        of_spin2 = a.spin2_analysis.astype(np.float32)
        in_slices(partial(moments_of, radiance, analysis, of_spin2, moments), radiance.shape[0])
        mean = moments[:, :, 0]
        lit = np.einsum("m,mtfw->tw", self.ground_fraction() / a.azimuth.size, radiance[0, :, :, :, 0])
        return mean, moments, lit * ray_points.block_values(self.medium.ground_albedo, self.block)

    def log_ground(self, ground: np.ndarray) -> np.ndarray:
        """`RadianceField.log_ground` from the ground of `analyse`."""
        return self.nodes.refine_zenith(np.log(np.maximum(ground, DARK)))

    def conserving(self) -> ScatteringOperator:
        """The same operator with directions that conserve the energy of nearly isotropic light."""
        return replace(self, angles=conserving_angles(self.angles))

    def ground_fraction(self) -> np.ndarray:
        """Fraction (M,) of each polar angle in the light that falls on the ground; of a uniform sky the sum is 1."""
        up = np.maximum(self.angles.cosine[0], 0.0) * self.angles.weight[0]
        return up / up.sum()


def normalised(mean: np.ndarray, moments: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(logarithm of the mean, moments relative to it); no light is isotropic and tiny."""
    lit = mean > DARK
    safe = np.where(lit, mean, 1.0)
    ratio = np.where(lit[:, :, None], moments / safe[:, :, None], 0.0)
    ratio[:, :, 0] = 1.0
    log_mean = np.log(np.where(lit, safe, DARK))
    return np.ascontiguousarray(log_mean, np.float32), np.ascontiguousarray(ratio, np.float32)


def _rim_cosine(grids: FieldGrids) -> np.ndarray:
    """Cosines (Z,) of the zenith angles under which nodes see the rim of haze that is next below them, NaN without."""
    z, rims = grids.nodes.altitude_km, grids.layout.rims_km
    rim = np.append(np.nan, rims)[np.searchsorted(rims, z, side="right")]
    return horizon_cosine(grids.path_profile, z, rim)


def scattering_operators(
    grids: FieldGrids, polar: int, azimuthal_orders: float, degree: float, spin2_degree: int
) -> Callable[[int], ScatteringOperator]:
    """Operators by block of wavelengths.

    polar: polar angles a side; azimuthal_orders: with as many azimuths over half a turn; degree, spin2_degree: of the
    harmonics of I and of Q and U; azimuthal_orders and degree as in `FractionalTruncation`
    """
    n, medium, settings = grids.nodes, grids.medium, grids.settings
    horizon = horizon_cosine(grids.path_profile, n.altitude_km)
    highest = math.ceil(degree)
    angles = make_angles(horizon, polar, math.ceil(azimuthal_orders), highest, spin2_degree, _rim_cosine(grids))
    weight = taper(angles.order, azimuthal_orders) * taper(angles.degree, degree + 1)
    angles = replace(angles, taper=weight)
    start = np.repeat(n.altitude_km, angles.cosine.shape[1])
    rays = trace_rays(grids.path_profile, start, angles.cosine.ravel(), settings.step_density)
    # air with nothing in it has no points along its rays
    longest = float(max(rays.place[:, ANGLE].max(initial=1e-6), rays.ground_angle_rad.max(initial=0.0)))
    geometry = ray_points.make_ray_geometry(n.zenith.nodes_rad, angles.azimuth, n.zenith.fine_rad, longest)
    scattering = grids.scattering._replace(chi=grids.scattering.chi[:, : highest + 1])

    def of(block: int) -> ScatteringOperator:
        points = ray_points.make_ray_points(
            rays, scattering, n.fine_altitude_km, geometry.step_rad, angles.series, block
        )
        return ScatteringOperator(
            n, angles, rays, points, geometry, medium, scattering, grids.scaled.forward_fraction, block,
            grids.path_profile, settings.first_order_step_density,
        )  # fmt: skip

    return of


def early_operators(grids: FieldGrids) -> Callable[[int], ScatteringOperator]:
    """Operators of the early orders of scattering, by block of wavelengths."""
    s, series = grids.directions, grids.layout.truncation
    return scattering_operators(grids, s.polar_directions, series.azimuthal_orders, s.degree, grids.spin2_degree)


def late_operators(grids: FieldGrids, polar: int) -> Callable[[int], ScatteringOperator]:
    """Operators of the later orders, by block of wavelengths; polar: polar angles a side."""
    s, series = grids.directions, grids.layout.truncation
    spin2_degree = s.late_polarisation_degree if s.polarisation else 0
    return scattering_operators(grids, polar, series.late_azimuthal_orders, series.late_degree, spin2_degree)
