"""What a field takes before it is solved: memory and processor time, from the sizes of its grids."""

from __future__ import annotations

from collections.abc import Sequence

from twilight.atmosphere.medium import Medium
from twilight.solvers.base import Takes
from twilight.solvers.zones.alike import lay_out, settings_for
from twilight.solvers.zones.grid import Series, zenith_nodes
from twilight.solvers.zones.paths import LANES
from twilight.solvers.zones.reach import zenith_range
from twilight.solvers.zones.settings import ZonesSettings
from twilight.solvers.zones.solution import PER_INTERVAL
from twilight.transport.scaling import delta_scaled

POINTS_OF_A_RAY, IN_A_BAND = 95.0, 2.3
"""Points of a ray between nodes at step_density 1, and how many times as many there are in a band of a gas: `draft` and
`standard` in continental air have 93 to 98."""
RAY_BYTES = 8
"""Of a point of a ray for each wavelength of a field."""
WORKING_COPIES, PER_BLOCK_BYTES = 4.0, 15e6
"""Of an order's light in directions and in moments while it is scattered; and of every block of LANES wavelengths
beside its moments: the sunbeam's tables, and what is left of making it."""
BLOCK_S, PRODUCT_S, BAND_TIMES = 0.7, 2.8e-8, 1.7
"""Processor seconds of a block of LANES wavelengths: of its tables, and of the product of nodes, directions and
moments; times so many for lanes of a band.  Of a quiet core, in continental air, to 30 %."""
LOOK_S, POLARISED_LOOK_S = 5.5e-6, 1e-5
"""Processor seconds of a direction and wavelength."""


class _Stage:
    """Numbers of what the early or the late orders of scattering need: rays, bytes of a point in a block of LANES
    wavelengths, directions of a node, and moments."""

    def __init__(self, polar: int, around: int, degree: int, pattern_degree: int):
        series = Series.of(degree, pattern_degree, around)
        harmonics = sum(series.degree + 1 - m for m in range(series.orders))
        patterns = sum(series.pattern_degree + 1 - max(m, 2) for m in range(series.pattern_orders))
        self.polar = polar + max(7 * polar // 10, 2)
        self.around = self.polar * around * (3 if pattern_degree else 1)
        self.moments = harmonics + 2 * patterns
        matrix = 3 * (pattern_degree + 1) * LANES if pattern_degree else 0
        self.point_bytes = 4 * ((degree + 1) * LANES + self.moments + matrix + 3 * LANES + 5)


def takes(
    medium: Medium, settings: ZonesSettings, sun_elevations_deg: Sequence[float] | None, observer_altitude_km: float
) -> Takes:
    """What a field takes in the air of the medium's first wavelength, whose grids are about those of the others."""
    one = medium.select(slice(0, 1))
    settings = settings_for(one, settings)
    grids = lay_out(one, delta_scaled(one, settings.degree), settings)
    d, altitudes = grids.directions, grids.altitude_km.size
    suns = zenith_nodes(*zenith_range(one, sun_elevations_deg, observer_altitude_km), settings.zenith_density).size
    patterns, late_patterns = (d.polarisation_degree, d.late_polarisation_degree) if settings.polarisation else (0, 0)
    early = _Stage(d.polar_directions, d.azimuth_directions, d.degree, patterns)
    late = _Stage(d.late_polar_directions, d.late_azimuth_directions, d.late_degree, late_patterns)
    each = 4 * LANES
    radiance = altitudes * suns * early.around * each
    light = (PER_INTERVAL * (altitudes - 1) + 1) * suns * early.moments * each
    of_a_ray = POINTS_OF_A_RAY * settings.step_density * altitudes
    points = of_a_ray * (early.polar * early.point_bytes + late.polar * late.point_bytes)
    rays = of_a_ray * (early.polar + late.polar) * RAY_BYTES
    seconds = BLOCK_S + PRODUCT_S * altitudes * suns * early.around * early.moments
    return Takes(
        fixed_bytes=points + WORKING_COPIES * (radiance + light),
        bytes_per_wavelength=(light + PER_BLOCK_BYTES) / LANES + rays,
        cpu_s_per_wavelength=seconds / LANES,
        cpu_s_per_look=POLARISED_LOOK_S if patterns else LOOK_S,
        together=LANES,
        band_bytes=(IN_A_BAND - 1.0) * points,
        band_cpu=BAND_TIMES,
    )
