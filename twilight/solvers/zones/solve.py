"""The solution of a field: successive orders of scattering, block by block of wavelengths."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from functools import cache, partial

import numpy as np

from twilight.base.progress import Progress
from twilight.solvers.base import Convergence
from twilight.solvers.zones.directions import taper
from twilight.solvers.zones.field_grids import FieldGrids
from twilight.solvers.zones.grid import make_angles
from twilight.solvers.zones.ray_points import LANES, block_values, make_ray_geometry, make_ray_points
from twilight.solvers.zones.solution import ScatteringOperator, Solution
from twilight.solvers.zones.successive_orders import solve_orders
from twilight.solvers.zones.sunlight import make_sunlight
from twilight.transport.beam import Beam
from twilight.transport.lines import ANGLE, horizon_cosine, trace_rays
from twilight.transport.profile import Profile
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
    early = early_operators(grids)
    thick_polar = max(s.late_polar_directions, POLAR_PER_DEGREE * s.late_degree)

    # made where they are needed: with thick_polar in thick air of conservative scattering alone
    of_polar = cache(partial(late_operators, grids))

    def late_operator(polar: int, block: int) -> ScatteringOperator:
        return of_polar(polar)(block)

    sunlight = make_sunlight(beam, grids.nodes.altitude_km, grids.profile.break_km)
    n_blocks = -(-grids.medium.n_wavelengths // LANES)
    slow = reduced_depth(grids.scaled, grids.profile) > SLOW_DEPTH
    solutions: list[Solution] = []
    for block in range(n_blocks):

        def report(order: int, residual: float, block: int = block) -> None:
            progress(f"order of scattering {order}", 0.1 + 0.9 * (block + min(0.95, order / 12)) / n_blocks)

        # dropped with its block
        late = cache(partial(late_operator, s.late_polar_directions, block))
        solutions.append(
            solve_orders(
                early(block), late, partial(late_operator, thick_polar, block), block_values(slow, block) > 0.0,
                s.early_orders, sunlight, s.max_orders, s.tolerance, report,
            )
        )  # fmt: skip
    return solutions, Convergence(max(x.orders for x in solutions), max(x.residual for x in solutions))


def reduced_depth(scaled: ScaledMedium, profile: Profile) -> np.ndarray:
    """Vertical optical depth of scattering (W,), that of each species times 1 - g; profile: of the scaled air."""
    reduced = profile.species_scattering * (1.0 - scaled.moments[:, 1])[:, None]
    return np.trapezoid(reduced.sum(axis=0), profile.altitude_km, axis=0)


def _rim_cosine(grids: FieldGrids) -> np.ndarray:
    """Cosines (Z,) of the zenith angles under which nodes see the rim of haze that is next below them, NaN without."""
    z, rims = grids.nodes.altitude_km, grids.layout.rims_km
    rim = np.append(np.nan, rims)[np.searchsorted(rims, z, side="right")]
    return horizon_cosine(grids.path_profile, z, rim)


def early_operators(grids: FieldGrids) -> Callable[[int], ScatteringOperator]:
    """Operators of the early orders of scattering, by block of wavelengths."""
    s, series = grids.directions, grids.layout.truncation
    return scattering_operators(grids, s.polar_directions, series.azimuthal_orders, s.degree, grids.spin2_degree)


def late_operators(grids: FieldGrids, polar: int) -> Callable[[int], ScatteringOperator]:
    """Operators of the later orders, by block of wavelengths; polar: polar angles a side."""
    s, series = grids.directions, grids.layout.truncation
    spin2_degree = s.late_polarisation_degree if s.polarisation else 0
    return scattering_operators(grids, polar, series.late_azimuthal_orders, series.late_degree, spin2_degree)


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
    geometry = make_ray_geometry(n.zenith.nodes_rad, angles.azimuth, n.zenith.fine_rad, longest)
    scattering = grids.scattering._replace(chi=grids.scattering.chi[:, : highest + 1])

    def of(block: int) -> ScatteringOperator:
        points = make_ray_points(rays, scattering, n.fine_altitude_km, geometry.step_rad, angles.series, block)
        return ScatteringOperator(
            n, angles, rays, points, geometry, medium, scattering, grids.scaled.forward_fraction, block,
            grids.path_profile, settings.first_order_step_density,
        )  # fmt: skip

    return of
