"""Finite segments of lines of sight: transmittance in closed form, limits, and the solvers against each other."""

import numpy as np
import pytest
from airs import turbid
from hazy_zones import QUICK

from twilight.base.errors import TwilightError
from twilight.solvers import montecarlo, zones
from twilight.solvers.montecarlo import MonteCarloSettings

ELEVATION = np.array([0.5, 5.0, 40.0, -4.0])[:, None]
AZIMUTH = np.array([20.0, 90.0, 150.0, 40.0])[:, None]
DISTANCE = np.array([0.1, 2.0, 15.0, 100.0])
ALTITUDE = 2.0


@pytest.fixture(scope="module")
def air():
    return turbid(3.0, wavelength_nm=np.array([550.0]))


@pytest.fixture(scope="module")
def field(air):
    return zones.prepare(air, QUICK)


def ask(field, sun, distance, **more):
    return field.inscatter(sun, ELEVATION, AZIMUTH, distance, observer_altitude_km=ALTITUDE, **more)


def test_limits_of_a_segment(field):
    """A segment of no length would glow, or the longest not be the sky."""
    light, passed = ask(field, 10.0, 0.0)
    assert np.abs(light).max() == 0.0 and (passed == 1.0).all()
    whole, _ = ask(field, 10.0, np.inf)
    radiance = field.radiance(10.0, ELEVATION, AZIMUTH, observer_altitude_km=ALTITUDE)
    np.testing.assert_allclose(whole[:3], radiance[:3], rtol=1e-5)
    assert (whole[3] < radiance[3]).all()
    light, passed = ask(field, 10.0, DISTANCE)
    assert (np.diff(light, axis=1) >= 0.0).all() and (np.diff(passed, axis=1) <= 0.0).all()
    kept, more = ask(field, 10.0, DISTANCE, peak_passes=True)
    assert (kept <= light + 1e-12).all() and (more >= passed - 1e-12).all()
    with pytest.raises(TwilightError, match="0 or more"):
        ask(field, 10.0, -1.0)


def test_transmittance_is_that_of_the_air(air, field):
    """Straight down and up: the exponential of the air's own integral."""
    _, passed = field.inscatter(10.0, np.array([-90.0, 90.0]), 0.0, np.array([2.0, 5.0]), observer_altitude_km=2.0)
    for found, (low, high) in zip(passed, ((0.0, 2.0), (2.0, 7.0)), strict=True):
        z = np.linspace(low, high, 20001)
        depth = np.trapezoid(air.at(z).extinction, z, axis=0)
        np.testing.assert_allclose(found, np.exp(-depth), rtol=1e-3)


@pytest.fixture(scope="module")
def reference(air):
    return montecarlo.prepare(air, MonteCarloSettings(samples=300), observer_altitude_km=ALTITUDE)


@pytest.mark.parametrize("sun", [20.0, -4.0])
def test_zones_against_the_reference_solution(field, reference, sun):
    """Air before objects would be too bright or too clear."""
    found, seen = reference.inscatter_with_error(sun, ELEVATION, AZIMUTH, DISTANCE)
    light, passed = ask(field, sun, DISTANCE)
    scale = field.radiance(sun, ELEVATION, AZIMUTH, observer_altitude_km=ALTITUDE).max()
    np.testing.assert_allclose(passed, seen, atol=2e-3)
    # draft: 2 % of the scale, and four standard errors of a short run
    assert (np.abs(light - found.radiance) < 0.02 * scale + 4.0 * found.standard_error).all()
