"""What the orders of scattering need at one number of directions, harmonics and patterns, for blocks of wavelengths."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from twilight.atmosphere.medium import Medium
from twilight.solvers.zones.grid import Edge, make_angles
from twilight.solvers.zones.paths import Scattering, lanes_of, make_points, make_turning
from twilight.solvers.zones.settings import ZonesSettings
from twilight.solvers.zones.solution import Nodes, Passes
from twilight.solvers.zones.water import reflection, surface_of
from twilight.transport.bundle import trace_rays
from twilight.transport.lines import ANGLE, horizon_cosine
from twilight.transport.profile import Profile


@dataclass(frozen=True)
class Air:
    """What all stages share.

    scattering: of the scaled medium; forward_share (K, W): what scaling took from each aerosol's phase function;
    profile: that rays go through; edge: where polar angles part
    """

    medium: Medium
    settings: ZonesSettings
    scattering: Scattering
    forward_share: np.ndarray
    profile: Profile
    nodes: Nodes
    edge: Edge | None


def make_stage(air: Air, polar: int, around: int, degree: int, pattern_degree: int) -> Callable[[int], Passes]:
    """Passes for each block of wavelengths, by its number."""
    n = air.nodes
    horizon = horizon_cosine(air.profile, n.altitude_km)
    angles = make_angles(horizon, polar, around, degree, pattern_degree, air.edge)
    start, cosine = np.repeat(n.altitude_km, angles.cosine.shape[1]), angles.cosine.ravel()
    rays = trace_rays(air.profile, start, cosine, air.settings.step_density)
    # air with nothing in it has no points along its rays
    longest = float(max(rays.place[:, ANGLE].max(initial=1e-6), rays.ground_angle_rad.max(initial=0.0)))
    turning = make_turning(n.zenith_rad, angles.azimuth, n.fine_rad, longest)
    scattering = air.scattering._replace(chi=air.scattering.chi[:, : degree + 1])
    # as many as the first light of the early events can have
    orders = air.settings.degree + 1
    above = angles.cosine[0, angles.below :]

    def of(block: int) -> Passes:
        points = make_points(rays, scattering, n.fine_altitude_km, turning.step_rad, angles.series, block)
        water = None
        if air.medium.has_water:
            surface = surface_of(air.medium, lanes_of(np.arange(air.medium.n_wavelengths), block).astype(int))
            water = reflection(above, orders, 3 if air.settings.polarisation else 1, *surface)
        return Passes(n, angles, rays, points, turning, air.medium, scattering, air.forward_share, block, water)

    return of
