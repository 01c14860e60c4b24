"""The tabulated airs of the stored references, and settings of `zones` with which a field is solved in a second."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from twilight.solvers import zones

REFERENCE = Path(__file__).parents[1] / "benchmarks" / "reference"
SCALAR = replace(
    zones.QUALITIES["draft"], altitude_density=0.35, zenith_density=0.4, polar_directions=4, beam_density=0.4,
    polarisation=False,
)  # fmt: skip
SMALL = replace(SCALAR, polarisation=True, polarisation_degree=6)
ELEVATION, AZIMUTH = (g.ravel() for g in np.meshgrid([2.0, 15.0, 50.0, 85.0], [0.0, 45.0, 120.0, 180.0]))
