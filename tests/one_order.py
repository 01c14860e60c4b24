"""One order of scattering by `zones` on very few nodes: `python one_order.py FILE.npz` writes what comes of it."""

import sys
from dataclasses import replace

import numpy as np
from hazy_zones import QUICK
from layered_sky import layered

from twilight.solvers.zones.grids import FieldGrids
from twilight.solvers.zones.scattering import scattering_operators

SETTINGS = replace(
    QUICK, degree=2, late_degree=2, max_degree=2, polarisation=True, polarisation_degree=2,
    late_polarisation_degree=2, altitude_density=0.2, zenith_density=0.3, step_density=0.3, bent_paths=False,
    bent_lines_of_sight=False,
)  # fmt: skip


def one_order() -> tuple[np.ndarray, ...]:
    """Mean radiance, moments and the ground's radiance that random light makes of itself."""
    grids = FieldGrids.of(layered(2.0, 1.0, 0.3), SETTINGS, (80.0, 95.0))
    operator = scattering_operators(grids, 2, 3, 2, 2)(0)
    shape = grids.nodes.altitude_km.size, grids.nodes.zenith.nodes_rad.size
    random = np.random.default_rng(1)
    mean = random.uniform(0.5, 1.0, (*shape, 8)).astype(np.float32)
    moments = random.normal(scale=0.1, size=(*shape, operator.angles.n_moments, 8)).astype(np.float32)
    moments = moments * mean[:, :, None]
    moments[:, :, 0] = mean
    ground = random.uniform(0.5, 1.0, (shape[1], 8)).astype(np.float32)
    return operator.analyse(operator.next_order(mean, moments, ground))


if __name__ == "__main__":
    np.savez(sys.argv[1], *one_order())
