"""Cost of a field before it is solved: memory and processor time, from the sizes of its grids."""

from __future__ import annotations

import math
from collections.abc import Sequence

from twilight.atmosphere.medium import Medium
from twilight.solvers.base import Cost
from twilight.solvers.zones.grid import Truncation, zenith_nodes
from twilight.solvers.zones.layout import lay_out, settings_for
from twilight.solvers.zones.ray_points import LANES
from twilight.solvers.zones.settings import ZonesSettings
from twilight.solvers.zones.solution import FINE_PER_INTERVAL
from twilight.solvers.zones.solve import SLOW_DEPTH, reduced_depth
from twilight.solvers.zones.target import settings_to_solve
from twilight.solvers.zones.zenith_range import zenith_range
from twilight.transport.scaling import delta_scaled

POINTS_PER_RAY = 95.0
"""Points of a ray between nodes at step_density 1: `draft` and `standard` in continental air have 93 to 98."""
BAND_POINTS_FACTOR = 2.3
"""The same in a band of a gas, over that without."""
RAY_BYTES = 8
"""Bytes of a point of a ray for each wavelength of a field."""
WORKING_COPIES = 4.0
"""Copies of an order's radiances and moments while it is scattered."""
BLOCK_BYTES = 15e6
"""Bytes of a block of LANES wavelengths beside its moments: the sunbeam's tables, and what is left of making it."""
BLOCK_S = 0.5
"""Processor seconds of the tables of a block of LANES wavelengths (measured as ROOT_S)."""
ROOT_S = 2.1e-4
"""Processor seconds of a block per root of nodes x directions x moments: within 25 % of `continental-average`
at `draft` and at `standard`, `maritime-clean` at `draft`, `pure-air` and `desert` at `standard`; half of `urban`."""
THICK_S = 1.2e-5
"""Processor seconds of a block per altitude, radiance of a later order and zenith angle, THICK_ZENITHS more, in air so
thick that all later orders are solved at once: `draft` below stratus of depth 25, one sun and all suns."""
THICK_ZENITHS = 5
BAND_CPU_FACTOR = 1.7
"""Processor time of terms of a gas's exponential sum over that of as many wavelengths."""
INTERPOLATED_S = 0.06
"""Processor seconds of a wavelength whose light is interpolated over the spectrum: its sunbeam, above all."""
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


def cost(
    medium: Medium, settings: ZonesSettings, sun_elevations_deg: Sequence[float] | None, observer_altitude_km: float
) -> Cost:
    """Cost of a field in the air of the medium's first wavelength, whose grids are about those of the others."""
    one = medium.select(slice(0, 1))
    settings, _ = settings_to_solve(medium, settings, sun_elevations_deg)
    settings, degree = settings_for(one, settings)
    scaled = delta_scaled(one, degree)
    grids = lay_out(one, scaled, settings)
    d, altitudes = grids.directions, grids.altitude_km.size
    suns = zenith_nodes(*zenith_range(one, sun_elevations_deg, observer_altitude_km), settings.zenith_density).size
    spin2_degree, late_spin2_degree = (
        (d.polarisation_degree, d.late_polarisation_degree) if settings.polarisation else (0, 0)
    )
    early = _OrderSizes(d.polar_directions, d.azimuth_directions, d.degree, spin2_degree)
    late = _OrderSizes(d.late_polar_directions, d.late_azimuth_directions, d.late_degree, late_spin2_degree)
    each = 4 * LANES
    radiance = altitudes * suns * early.radiances * each
    light = (FINE_PER_INTERVAL * (altitudes - 1) + 1) * suns * early.moments * each
    of_a_ray = POINTS_PER_RAY * settings.step_density * altitudes
    points = of_a_ray * (early.polar * early.point_bytes + late.polar * late.point_bytes)
    rays = of_a_ray * (early.polar + late.polar) * RAY_BYTES
    seconds = BLOCK_S + ROOT_S * math.sqrt(altitudes * suns * early.radiances * early.moments)
    if reduced_depth(scaled, grids.profile).max() > SLOW_DEPTH:
        seconds += THICK_S * altitudes * (suns + THICK_ZENITHS) * late.radiances
    return Cost(
        fixed_bytes=points + WORKING_COPIES * (radiance + light),
        bytes_per_wavelength=(light + BLOCK_BYTES) / LANES + rays,
        cpu_s_per_wavelength=seconds / LANES,
        cpu_s_per_direction=POLARISED_DIRECTION_S if spin2_degree else DIRECTION_S,
        block_size=LANES,
        band_bytes=(BAND_POINTS_FACTOR - 1.0) * points,
        band_cpu_factor=BAND_CPU_FACTOR,
        cpu_s_per_interpolated=INTERPOLATED_S,
    )
