"""Monte-Carlo, the line of sight: bent as the ray tracer bends it, straight without refraction, no noise on it."""

from dataclasses import replace

import numpy as np
import pytest
from montecarlo_media import hazy_earth

from twilight.solvers.montecarlo import MonteCarloSettings, prepare
from twilight.solvers.montecarlo.leg import DEPTH, LENGTH, LOWER, MIDDLE, PLAIN, STEERED, UPPER
from twilight.solvers.montecarlo.sight import (
    DIRECTION,
    GROUND,
    LANDING,
    N_SUMMARY,
    SIGHT_COLUMNS,
    SIGHT_PIECES,
    THROUGH,
    look,
)
from twilight.transport.bent import trace_ray

SETTINGS = MonteCarloSettings(target_stderr=None, samples=4, max_orders=1, steering_sweeps=0)


def follow(field, height, elevation_deg, bent):
    """Pieces and summary of one line of sight at azimuth 0, the sun 10 deg up."""
    pieces, summary = np.empty((SIGHT_PIECES, SIGHT_COLUMNS)), np.empty(N_SUMMARY)
    e, sun = np.radians([elevation_deg, 10.0])
    point = np.array([0.0, 0.0, field.air.earth_radius_km + height])
    direction = np.array([np.cos(e), 0.0, np.sin(e)])
    to_sun = np.array([np.cos(sun), 0.0, np.sin(sun)])
    n = look(field.air, field.sun, field.steering, 0, bent, point, direction, to_sun, 10.0, 0.2, pieces, summary)
    return pieces[:n], summary


@pytest.fixture(scope="module")
def field():
    return prepare(hazy_earth(), SETTINGS)


@pytest.mark.parametrize(
    ("height", "elevation"), [(0.0, 0.1), (0.0, 2.0), (0.0, 20.0), (10.0, -1.0), (10.0, -2.5), (20.0, -8.0)]
)
def test_bent_line_is_the_traced_ray(field, height, elevation):
    pieces, summary = follow(field, height, elevation, True)
    ray = trace_ray(field.medium, height, 90.0 - elevation)
    assert ray.hits_ground == (summary[GROUND] >= 0.0)
    if ray.hits_ground:
        depth = -np.log(summary[THROUGH])
        x, z = summary[LANDING], summary[LANDING + 2]
        angle = np.degrees(np.arctan2(x, z))
        heading = np.arctan2(summary[LANDING + 3], summary[LANDING + 5])
        assert angle == pytest.approx(ray.geocentric_angle_deg[-1], abs=2e-4)
    else:
        last = pieces[-1]
        depth = last[DEPTH] + last[LENGTH] * (last[LOWER] + 4 * last[MIDDLE] + last[UPPER]) / 6
        heading = np.arctan2(last[DIRECTION], last[DIRECTION + 2])
    # the medium's optical depth; on the ground (n_observer / n)^2 comes on top
    assert depth == pytest.approx(ray.optical_depth[-1], rel=2e-3, abs=6e-4)
    # direction in the observer's frame: local zenith angle plus the angle between the verticals; a chord has the mean
    # direction of its arc, which differs by up to 0.005 deg from that at its end
    assert np.degrees(heading) == pytest.approx(ray.zenith_deg[-1] + ray.geocentric_angle_deg[-1], abs=6e-3)
    assert pieces[:, LENGTH].sum() == pytest.approx(ray.length_km[-1], rel=1e-3)


def test_without_refractivity_the_line_is_straight():
    field = prepare(hazy_earth(refractivity=0.0), SETTINGS)
    for elevation in (1.0, 30.0):
        bent, summary = follow(field, 0.0, elevation, True)
        straight, other = follow(field, 0.0, elevation, False)
        np.testing.assert_allclose(summary[:2], other[:2], rtol=2e-4)
        for column in (PLAIN, STEERED):
            assert bent[-1, column] == pytest.approx(straight[-1, column], rel=2e-4)


def test_refracted_beam_and_bent_lines_off_is_air_without_refractivity():
    settings = MonteCarloSettings(target_stderr=None, samples=8, steering_sweeps=0)
    off = prepare(hazy_earth(), replace(settings, refraction=False)).radiance(-3.0, 30.0, [0.0, 90.0])
    none = prepare(hazy_earth(refractivity=0.0), settings).radiance(-3.0, 30.0, [0.0, 90.0])
    np.testing.assert_array_equal(off, none)


def test_bent_lines_lift_the_horizon():
    # at 1 deg the ray that is seen comes from 0.5 deg lower: more air, dimmer towards a high sun
    field = prepare(hazy_earth(), SETTINGS)
    straight = replace(field, settings=replace(SETTINGS, bent_lines_of_sight=False))
    low, high = field.radiance(30.0, [1.0, 60.0], 90.0)[:, 0], straight.radiance(30.0, [1.0, 60.0], 90.0)[:, 0]
    assert 0.001 < abs(low[0] / high[0] - 1) < 0.1
    assert abs(low[1] / high[1] - 1) < 1e-3
