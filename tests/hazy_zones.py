"""The tabulated airs of the stored references, and settings of `zones` with which a field is solved in a second."""

from dataclasses import replace
from pathlib import Path

import numpy as np

from twilight.solvers import zones

REFERENCE = Path(__file__).parents[1] / "benchmarks" / "results" / "reference"
QUICK = zones.ZonesSettings(
    degree=12, max_degree=20, polar_directions=9, azimuth_directions=9, late_degree=5, late_polar_directions=6,
    late_azimuth_directions=6, altitude_density=0.5, zenith_density=0.6, step_density=0.4,
    first_order_step_density=1.0, line_of_sight_density=1.0, beam_density=0.5, tolerance=1e-2, polarisation=False,
    polarisation_degree=6, late_polarisation_degree=3,
)  # fmt: skip
"""Of scalar theory and coarser than `draft`, some per cent off: a field takes half the time."""
SCALAR = replace(QUICK, altitude_density=0.35, zenith_density=0.4, polar_directions=4, beam_density=0.4)
SMALL = replace(SCALAR, polarisation=True, polarisation_degree=6)


def read_table(path: Path) -> np.ndarray:
    """A table of numbers with names of columns, below lines of notes."""
    with open(path, encoding="utf-8") as file:
        return np.genfromtxt((line for line in file if not line.startswith("#")), delimiter=",", names=True)


ELEVATION, AZIMUTH = (g.ravel() for g in np.meshgrid([2.0, 15.0, 50.0, 85.0], [0.0, 45.0, 120.0, 180.0]))
