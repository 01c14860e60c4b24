"""Memory and processor time of a field before it is solved."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from twilight.atmosphere.medium import Medium
from twilight.solvers.base import Cost
from twilight.solvers.zones import constants as tuned
from twilight.solvers.zones.air_needs import reduced_depth
from twilight.solvers.zones.angles import Truncation, zenith_nodes
from twilight.solvers.zones.grids import Layout, lay_out, settings_for, zenith_range
from twilight.solvers.zones.ray_points import LANES
from twilight.solvers.zones.settings import ZonesSettings
from twilight.solvers.zones.small_jumps import without_small_jumps
from twilight.solvers.zones.solver import settings_to_solve
from twilight.transport.scaling import ScaledMedium, delta_scaled

POINTS_PER_RAY = 95.0
"""Points of a ray between nodes at step_density 1: `draft` and `standard` in continental air have 93 to 98."""
BAND_POINTS_FACTOR = 1.35
"""The same in a band of a gas, over that without."""
RAY_BYTES = 8
"""Bytes of a point of a ray for each wavelength of a field."""
WORKING_COPIES = 4.0
"""Copies of an order's radiances and moments while it is scattered."""
BLOCK_BYTES = 15e6
"""Bytes of a block of LANES wavelengths beside its moments: the sunbeam's tables, and what is left of making it."""
BLOCK_S = 0.35
"""Processor seconds of what every block of LANES wavelengths takes."""
BREAK_S = 0.09
"""Processor seconds of a block per jump or sudden change of the air, whose sunbeam has tables of its own."""
EARLY_S = 1.6e-6
"""Processor seconds of a block per altitude, solar zenith angle (ZENITHS more) and radiance of the early orders."""
LATE_S = 7e-8
"""The same of one of the later orders, per radiance and azimuth."""
FEWEST_ORDERS = 4.0
"""Later orders that are followed in thin air."""
MORE_ORDERS = 1.5
"""How many more where the air is thick."""
SLOW_AZIMUTHS = 11
"""Azimuths that count at most where all orders are solved at once: more of them stand for light that goes forward,
of which fewer steps are left (desert dust of depth 20)."""
ZENITHS = 5
"""Solar zenith angles that stand for what is done once at a node, whatever the sun."""
BAND_CPU_FACTOR = 1.3
"""Processor time of terms of a gas's exponential sum over that of as many wavelengths."""
DIRECTION_S = 5.5e-6
"""Processor seconds of a direction and wavelength, scalar."""
POLARISED_DIRECTION_S = 1e-5
"""Processor seconds of a direction and wavelength, polarised."""


class _OrderSizes:
    """Sizes of the early or the late orders of scattering: polar angles, radiances of a node, moments, and bytes of a
    point of a ray in a block of LANES wavelengths."""

    def __init__(self, polar: int, around: int, degree: int, spin2_degree: int):
        series = Truncation.of(degree, spin2_degree, around)
        harmonics = sum(series.degree + 1 - m for m in range(series.azimuthal_orders))
        n_spin2 = sum(series.spin2_degree + 1 - max(m, 2) for m in range(series.spin2_orders))
        self.polar = polar + max(7 * polar // 10, 2)
        self.radiances = self.polar * around * (3 if spin2_degree else 1)
        self.moments = harmonics + 2 * n_spin2
        matrix = 3 * (spin2_degree + 1) * LANES if spin2_degree else 0
        self.point_bytes = 4 * ((degree + 1) * LANES + self.moments + matrix + 3 * LANES + 5)


class Work(NamedTuple):
    """What the time of a block of LANES wavelengths is proportional to: breaks of the air, radiances of the early
    orders, and radiances times azimuths of the later ones."""

    breaks: int
    early: float
    late: float


def work_of_block(layout: Layout, scaled: ScaledMedium, suns: int, early: _OrderSizes, late: _OrderSizes) -> Work:
    """suns: solar zenith angles; early, late: of the layout's directions."""
    d, profile = layout.directions, layout.profile
    nodes = layout.altitude_km.size * (suns + ZENITHS)
    depth = float(np.trapezoid(profile.scattering, profile.altitude_km, axis=0).max())
    azimuthal_orders = d.late_azimuth_directions
    orders, radiances = FEWEST_ORDERS + MORE_ORDERS * depth / (1.0 + depth), float(late.radiances)
    if reduced_depth(scaled, profile).max() > tuned.SLOW_DEPTH:
        radiances *= max(1.0, tuned.POLAR_PER_DEGREE * d.late_degree / d.late_polar_directions)
        azimuthal_orders = min(azimuthal_orders, SLOW_AZIMUTHS)
    return Work(profile.break_km.size, nodes * early.radiances, nodes * orders * radiances * azimuthal_orders)


def cost(
    medium: Medium, settings: ZonesSettings, sun_elevations_deg: Sequence[float] | None, observer_altitude_km: float
) -> Cost:
    """Cost of a field in the air of the medium's first wavelength; where each has grids of its own, of the middle one,
    than whose those of the others are finer or coarser."""
    one = medium.n_wavelengths // 2 if medium.at_grid_wavelengths is None else 0
    monochromatic = without_small_jumps(medium).select(slice(one, one + 1))
    settings, _ = settings_to_solve(medium, settings, sun_elevations_deg)
    settings, degree = settings_for(monochromatic, settings)
    scaled = delta_scaled(monochromatic, degree)
    layout = lay_out(monochromatic, scaled, settings)
    d, altitudes = layout.directions, layout.altitude_km.size
    suns = zenith_nodes(
        *zenith_range(monochromatic, sun_elevations_deg, observer_altitude_km), settings.zenith_density
    ).size
    spin2_degree, late_spin2_degree = (
        (d.polarisation_degree, d.late_polarisation_degree) if settings.polarisation else (0, 0)
    )
    early = _OrderSizes(d.polar_directions, d.azimuth_directions, d.degree, spin2_degree)
    late = _OrderSizes(d.late_polar_directions, d.late_azimuth_directions, d.late_degree, late_spin2_degree)
    each = 4 * LANES
    radiance = altitudes * suns * early.radiances * each
    light = (tuned.FINE_PER_INTERVAL * (altitudes - 1) + 1) * suns * early.moments * each
    of_a_ray = POINTS_PER_RAY * settings.step_density * altitudes
    points = of_a_ray * (early.polar * early.point_bytes + late.polar * late.point_bytes)
    rays = of_a_ray * (early.polar + late.polar) * RAY_BYTES
    work = work_of_block(layout, scaled, suns, early, late)
    seconds = BLOCK_S + BREAK_S * work.breaks + EARLY_S * work.early + LATE_S * work.late
    return Cost(
        fixed_bytes=points + WORKING_COPIES * (radiance + light),
        bytes_per_wavelength=(light + BLOCK_BYTES) / LANES + rays,
        cpu_s_per_wavelength=seconds / LANES,
        cpu_s_per_direction=POLARISED_DIRECTION_S if spin2_degree else DIRECTION_S,
        block_size=LANES,
        band_bytes=(BAND_POINTS_FACTOR - 1.0) * points,
        band_cpu_factor=BAND_CPU_FACTOR,
    )
