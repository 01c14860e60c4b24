"""A lit layer far above the observer: light scattered once and twice, by plain quadrature, beside both solvers.

The layer is 1 km thick, white, HG 0.7, of optical depth 1, at 50 km, above air of optical depth 0.1 and black ground;
sun at 30 deg.  It is lit from the side behind the observer's horizon, which a walk from the observer rarely finds.
"""

from dataclasses import replace

import numpy as np
import pytest
from layered_sky import layered
from second_order import Layer, first_two_orders

from twilight.solvers import montecarlo, zones

BASE_KM = 50.0
"""Of the layer [km]."""
THICKNESS_KM = 1.0
"""Of the layer [km]."""
DEPTH = 1.0
"""Vertical optical depth of the layer."""
SUN_DEG = 30.0
"""Elevation of the sun [deg]."""
AZIMUTH_DEG = 40.0
"""Of the lines of sight, from the sun [deg]."""
EXACT = {
    1.0: (0.011751904, 0.018336834),
    5.0: (0.016247995, 0.026711230),
    20.0: (0.038397179, 0.047022426),
    90.0: (0.013067451, 0.015423319),
}
"""L/F0 [sr^-1] of the first and second order by view elevation [deg], by `first_two_orders` with 48 azimuths."""
ELEVATION_DEG = np.array(list(EXACT))
FIRST, SECOND = np.array(list(EXACT.values())).T


def layer():
    return layered(BASE_KM, THICKNESS_KM, DEPTH)


@pytest.mark.slow
def test_the_quadrature_has_settled():
    """With half the azimuths it moves by less than 1e-3."""
    air = Layer(0.1 / 8.0, 8.0, BASE_KM, BASE_KM + THICKNESS_KM, DEPTH, 0.7, 100.0, 6371.0)
    for elevation, exact in EXACT.items():
        np.testing.assert_allclose(first_two_orders(air, elevation, AZIMUTH_DEG, SUN_DEG, 24), exact, rtol=1e-3)


@pytest.mark.parametrize(
    ("quality", "allowed"), [("draft", 0.025), pytest.param("standard", 0.025, marks=pytest.mark.slow)]
)
def test_zones(quality, allowed):
    """The first order to 1e-4; the sum of both to 1.1 % at `draft` and 1.6 % at `standard`, both at the zenith."""
    settings = replace(zones.QUALITIES[quality], polarisation=False, tolerance=0.0, degree=32)
    for orders, exact, bound in ((1, FIRST, 2e-4), (2, FIRST + SECOND, allowed)):
        field = zones.prepare(layer(), replace(settings, max_orders=orders), sun_elevations_deg=[SUN_DEG])
        found = field.radiance(SUN_DEG, ELEVATION_DEG, AZIMUTH_DEG)[:, 0]
        np.testing.assert_allclose(found, exact, rtol=bound)


@pytest.mark.slow
def test_montecarlo_from_seed_to_seed():
    """Two seeds at 1 %: chi square of eight values; seldom above 26."""
    chi_square = 0.0
    for seed in (1, 2):
        settings = montecarlo.MonteCarloSettings(target_stderr=0.01, polarisation=False, max_orders=2, seed=seed)
        field = montecarlo.prepare(layer(), settings, observer_altitude_km=0.0)
        found = field.radiance_with_error(SUN_DEG, ELEVATION_DEG, np.full(ELEVATION_DEG.size, AZIMUTH_DEG))
        assert np.all(found.standard_error[:, 0] < 0.015 * found.radiance[:, 0])
        chi_square += float((((found.radiance[:, 0] - FIRST - SECOND) / found.standard_error[:, 0]) ** 2).sum())
    assert chi_square < 26.0, chi_square
