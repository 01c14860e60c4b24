"""What a field takes before it is solved: memory and processor time, from the sizes of its grids."""

from __future__ import annotations

from collections.abc import Sequence

from twilight.atmosphere.medium import Medium
from twilight.solvers.base import Takes
from twilight.solvers.zones.alike import lay_out
from twilight.solvers.zones.grid import Series, directions_below, zenith_nodes
from twilight.solvers.zones.paths import LANES
from twilight.solvers.zones.reach import zenith_range
from twilight.solvers.zones.settings import ZonesSettings
from twilight.solvers.zones.solution import PER_INTERVAL
from twilight.transport.scaling import delta_scaled

WORKING_COPIES, KEPT_COPIES, PER_BLOCK_BYTES = 6.0, 5.5, 30e6
"""Of an order's light in directions and moments while it is scattered, and of its moments that every block of LANES
wavelengths leaves; measured at `draft` and `standard` in continental air, to 15 %."""
BLOCK_S, PRODUCT_S, LOOK_S = 0.7, 2.5e-8, 5e-6
"""Processor seconds of a block of LANES wavelengths: of its tables, and of the product of nodes, directions and
moments; of a direction and wavelength.  From profiles of continental air, not fitted: an order of magnitude."""


def takes(
    medium: Medium, settings: ZonesSettings, sun_elevations_deg: Sequence[float] | None, observer_altitude_km: float
) -> Takes:
    """What a field takes in the air of the medium's first wavelength, whose grids are about those of the others."""
    one = medium.select(slice(0, 1))
    grids = lay_out(one, delta_scaled(one, settings.degree), settings)
    directions, altitudes = grids.directions, grids.altitude_km.size
    suns = zenith_nodes(*zenith_range(one, sun_elevations_deg, observer_altitude_km), settings.zenith_density).size
    patterns = directions.polarisation_degree if settings.polarisation else 0
    series = Series.of(directions.degree, patterns, directions.azimuth_directions)
    moments = sum(series.degree + 1 - m for m in range(series.orders))
    moments += 2 * sum(series.pattern_degree + 1 - m for m in range(series.pattern_orders))
    polar = directions.polar_directions + directions_below(directions.polar_directions)
    around = polar * directions.azimuth_directions * (3 if patterns else 1)
    each = 4 * LANES
    radiance = altitudes * suns * around * each
    light = (PER_INTERVAL * (altitudes - 1) + 1) * suns * moments * each
    seconds = BLOCK_S + PRODUCT_S * altitudes * suns * around * moments
    return Takes(
        fixed_bytes=WORKING_COPIES * (radiance + light),
        bytes_per_wavelength=(KEPT_COPIES * light + PER_BLOCK_BYTES) / LANES,
        cpu_s_per_wavelength=seconds / LANES,
        cpu_s_per_look=LOOK_S,
        together=LANES,
    )
