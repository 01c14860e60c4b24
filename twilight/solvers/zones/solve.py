"""The solution of a field: successive orders of scattering, block by block of wavelengths."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from functools import cache, partial

import numpy as np

from twilight.base.progress import Progress
from twilight.solvers.base import Convergence
from twilight.solvers.zones.directions import shares
from twilight.solvers.zones.field_grids import FieldGrids
from twilight.solvers.zones.grid import make_angles
from twilight.solvers.zones.ray_points import LANES, lanes_of, make_ray_geometry, make_ray_points
from twilight.solvers.zones.solution import ScatteringOperator, Solution
from twilight.solvers.zones.successive_orders import solve_orders
from twilight.solvers.zones.sunlight import make_sunlight
from twilight.solvers.zones.water import reflection, surface_of
from twilight.transport.beam import Beam
from twilight.transport.lines import ANGLE, horizon_cosine
from twilight.transport.profile import Profile
from twilight.transport.ray_bundle import trace_rays
from twilight.transport.scaling import ScaledMedium

POLAR_PER_DEGREE = 2
"""Polar angles a side for each degree of the light in thick air of conservative scattering: fewer let through 3 to 5 %
too much of it."""
SLOW_DEPTH = 2.0
"""Vertical optical depth of scattering, reduced by 1 - g, beyond which all orders are solved at once."""


def solve(grids: FieldGrids, beam: Beam, progress: Progress) -> tuple[list[Solution], Convergence]:
    """Solutions for each block of LANES wavelengths, and how well the worst of them converged."""
    s = grids.directions
    progress("rays", 0.05)
    reach = grids.layout.reach
    early = scattering_operators(grids, s.polar_directions, reach.orders, s.degree, grids.spin2_degree)
    late_degrees = reach.late_degree, s.late_polarisation_degree if s.polarisation else 0

    @cache
    def late_operators() -> Callable[[int], ScatteringOperator]:
        return scattering_operators(grids, s.late_polar_directions, reach.late_orders, *late_degrees)

    @cache
    def thick_operators() -> Callable[[int], ScatteringOperator]:
        # made where there is thick air of conservative scattering only
        polar = max(s.late_polar_directions, POLAR_PER_DEGREE * s.late_degree)
        return scattering_operators(grids, polar, reach.late_orders, *late_degrees)

    def thick(block: int) -> ScatteringOperator:
        return thick_operators()(block)

    sunlight = make_sunlight(beam, grids.nodes.altitude_km, grids.profile.break_km)
    n_blocks = -(-grids.medium.n_wavelengths // LANES)
    slow = reduced_depth(grids.scaled, grids.profile) > SLOW_DEPTH
    solutions: list[Solution] = []
    for block in range(n_blocks):

        def report(order: int, residual: float, block: int = block) -> None:
            progress(f"order of scattering {order}", 0.1 + 0.9 * (block + min(0.95, order / 12)) / n_blocks)

        # made where it is needed, and dropped with its block
        late = cache(lambda block=block: late_operators()(block))
        solutions.append(
            solve_orders(
                early(block), late, partial(thick, block), lanes_of(slow, block) > 0.0,
                s.early_orders, sunlight, s.max_orders, s.tolerance, report,
            )
        )  # fmt: skip
    return solutions, Convergence(max(x.orders for x in solutions), max(x.residual for x in solutions))


def reduced_depth(scaled: ScaledMedium, profile: Profile) -> np.ndarray:
    """Vertical optical depth of scattering (W,), that of each species times 1 - g; profile: of the scaled air."""
    turned = profile.species_scattering * (1.0 - scaled.moments[:, 1])[:, None]
    return np.trapezoid(turned.sum(axis=0), profile.altitude_km, axis=0)


def _rim_cosine(grids: FieldGrids) -> np.ndarray:
    """Cosines (Z,) of the zenith angles under which nodes see the rim of haze that is next below them, NaN without."""
    z, rims = grids.nodes.altitude_km, grids.layout.rims_km
    rim = np.append(np.nan, rims)[np.searchsorted(rims, z, side="right")]
    return horizon_cosine(grids.path_profile, z, rim)


def scattering_operators(
    grids: FieldGrids, polar: int, orders: float, degree: float, spin2_degree: int
) -> Callable[[int], ScatteringOperator]:
    """Operators by block of wavelengths.

    polar: polar angles a side; orders: azimuthal ones, with as many azimuths over half a turn; degree, spin2_degree: of
    the harmonics of I and of Q and U; orders and degree as in `Reach`
    """
    n, medium, settings = grids.nodes, grids.medium, grids.settings
    horizon = horizon_cosine(grids.path_profile, n.altitude_km)
    highest = math.ceil(degree)
    angles = make_angles(horizon, polar, math.ceil(orders), highest, spin2_degree, _rim_cosine(grids))
    angles = replace(angles, share=shares(angles.order, orders) * shares(angles.degree, degree + 1))
    start = np.repeat(n.altitude_km, angles.cosine.shape[1])
    rays = trace_rays(grids.path_profile, start, angles.cosine.ravel(), settings.step_density)
    # air with nothing in it has no points along its rays
    longest = float(max(rays.place[:, ANGLE].max(initial=1e-6), rays.ground_angle_rad.max(initial=0.0)))
    geometry = make_ray_geometry(n.zenith_rad, angles.azimuth, n.fine_rad, longest)
    scattering = grids.scattering._replace(chi=grids.scattering.chi[:, : highest + 1])
    # as many azimuthal orders as sunlight scattered once can have
    azimuthal_orders = grids.directions.degree + 1
    above = angles.cosine[0, angles.below :]

    def of(block: int) -> ScatteringOperator:
        points = make_ray_points(rays, scattering, n.fine_altitude_km, geometry.step_rad, angles.series, block)
        water = None
        if medium.has_water:
            surface = surface_of(medium, lanes_of(np.arange(medium.n_wavelengths), block).astype(int))
            water = reflection(above, azimuthal_orders, 3 if settings.polarisation else 1, *surface)
        return ScatteringOperator(
            n, angles, rays, points, geometry, medium, scattering, grids.scaled.forward_fraction, block, water,
            grids.path_profile, settings.first_order_step_density,
        )  # fmt: skip

    return of
