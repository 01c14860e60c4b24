"""`zones` beside `montecarlo` in air, suns and observers drawn from all that the program permits (`odd_airs`)."""

from dataclasses import replace

import numpy as np
import pytest
from montecarlo_media import assert_all_agree
from odd_airs import drawn

from twilight.solvers import montecarlo, zones

SCALAR = replace(zones.QUALITIES["draft"], polarisation=False)
NUMBERS = (1, 3, 5, 9, 13, 15, 19, 21, 22, 23, 25, 30)
"""Cases of `benchmarks/results/odd_air.csv` that take seconds."""
TOLERATED = 0.03
"""Error of `draft` that counts as none."""
FAINTEST = 1e-12
"""Radiance [sr^-1] below which light is a thousandth of any night's, and grids are not made for it."""


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::twilight.TwilightWarning")
@pytest.mark.parametrize("numbers", [NUMBERS[:4], NUMBERS[4:8], NUMBERS[8:]])
def test_two_solvers_agree_in_odd_air(numbers):
    """A fault of either in some corner of what is permitted."""
    skies = []
    for number in numbers:
        air = drawn(number)
        question, at = (air.sun_deg, air.elevation_deg, air.azimuth_deg), {"observer_altitude_km": air.altitude_km}
        settings = montecarlo.MonteCarloSettings(target_stderr=None, samples=600, polarisation=False)
        exact = montecarlo.prepare(air.medium, settings, **at).radiance_with_error(*question)
        draft = zones.prepare(air.medium, SCALAR, sun_elevations_deg=[air.sun_deg], **at)
        skies.append((exact.radiance, exact.standard_error, draft.radiance(*question, **at)))
    value, error, other = (np.concatenate([np.ravel(part) for part in parts]) for parts in zip(*skies, strict=True))
    known = value > FAINTEST
    assert known.sum() >= value.size // 2
    assert_all_agree(other[known], np.hypot(error, TOLERATED * value)[known], value[known])
