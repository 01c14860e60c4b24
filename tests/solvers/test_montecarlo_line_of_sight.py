"""Monte-Carlo, the line of sight: bent as the ray tracer bends it, straight without refraction, no noise on it."""

from dataclasses import replace

import numpy as np
import pytest
from bent_rays import trace_ray
from montecarlo_media import hazy_earth

from twilight.solvers.montecarlo import MonteCarloSettings, prepare
from twilight.solvers.montecarlo.chunks import observer_ray
from twilight.solvers.montecarlo.leg import LENGTH, RESCATTERED, SCATTERED, new_leg, trace
from twilight.solvers.montecarlo.line_of_sight import (
    LINE_OF_SIGHT_CHORDS,
    LINE_OF_SIGHT_PIECES,
    integrate_line_of_sight,
)
from twilight.solvers.montecarlo.rays import DIRECTION, ORIGIN

SETTINGS = MonteCarloSettings(target_stderr=None, samples=4, max_orders=1, importance_sweeps=0)


def follow(field, height, elevation_deg, bent, later=False):
    """`Leg` and `LegTotals` of one line of sight at azimuth 0, the sun 10 deg up; `later`: as a later leg."""
    leg = new_leg(1 + len(field.medium.phase_functions), LINE_OF_SIGHT_PIECES, LINE_OF_SIGHT_CHORDS)
    ray, to_sun = np.empty(9), np.empty(3)
    observer_ray(*np.radians([10.0, elevation_deg, 0.0]), height, field.air.earth_radius_km, ray, to_sun)
    walk = field.settings.walk(True)
    scene = (field.air, field.sun, field.importance, 0)
    if later:
        totals = trace(*scene, ray, to_sun, walk.later._replace(bent=bent), np.ones(1, dtype=np.uint64), leg)
    else:
        totals = integrate_line_of_sight(*scene, walk.first._replace(bent=bent), ray, to_sun, np.inf, leg)
    return leg._replace(pieces=leg.pieces[: totals.n_pieces], chords=leg.chords[: totals.last_chord + 1]), totals


@pytest.fixture(scope="module")
def field():
    return prepare(hazy_earth(), SETTINGS)


@pytest.mark.parametrize("later", [False, True])
@pytest.mark.parametrize(
    ("height", "elevation"), [(0.0, 0.1), (0.0, 2.0), (0.0, 20.0), (10.0, -1.0), (10.0, -2.5), (20.0, -8.0)]
)
def test_bent_line_is_the_traced_ray(field, height, elevation, later):
    """Chords against a ray tracer: fails if a leg has the wrong direction, length, end or optical depth."""
    leg, totals = follow(field, height, elevation, True, later)
    pieces = leg.pieces
    ray = trace_ray(field.medium, height, 90.0 - elevation)
    assert ray.hits_ground == (totals.ground_km >= 0.0)
    chord = leg.chords[totals.last_chord]
    heading = np.arctan2(chord[DIRECTION], chord[DIRECTION + 2])
    depth = -np.log(totals.transmittance)
    if ray.hits_ground:
        x, z = chord[ORIGIN::2][:2] + totals.ground_km * chord[DIRECTION : DIRECTION + 3 : 2]
        angle = np.degrees(np.arctan2(x, z))
        assert angle == pytest.approx(ray.geocentric_angle_deg[-1], abs=1e-3 if later else 2e-4)
    # the medium's optical depth; on the ground (n_observer / n)^2 comes on top
    assert depth == pytest.approx(ray.optical_depth[-1], rel=2e-3, abs=6e-4)
    # direction in the observer's frame: local zenith angle plus the angle between the verticals; a chord has the mean
    # direction of its arc, which differs by up to 0.005 deg from that at its end
    assert np.degrees(heading) == pytest.approx(ray.zenith_deg[-1] + ray.geocentric_angle_deg[-1], abs=6e-3)
    assert pieces[:, LENGTH].sum() == pytest.approx(ray.length_km[-1], rel=1e-3)


def test_without_refractivity_the_line_is_straight():
    """Null effect: bent lines in air with n = 1 are straight ones."""
    field = prepare(hazy_earth(refractivity=0.0), SETTINGS)
    for elevation in (1.0, 30.0):
        bent, totals = follow(field, 0.0, elevation, True)
        straight, other = follow(field, 0.0, elevation, False)
        assert totals.sun_i == pytest.approx(other.sun_i, rel=2e-4)
        assert totals.sun_q == pytest.approx(other.sun_q, rel=2e-4)
        for column in (SCATTERED, RESCATTERED):
            assert bent.pieces[-1, column] == pytest.approx(straight.pieces[-1, column], rel=2e-4)


def test_refracted_beam_and_bent_lines_off_is_air_without_refractivity():
    """`refraction` off leaves nothing of the refractivity, bit for bit."""
    settings = MonteCarloSettings(target_stderr=None, samples=8, importance_sweeps=0)
    off = prepare(hazy_earth(), replace(settings, refraction=False)).radiance(-3.0, 30.0, [0.0, 90.0])
    none = prepare(hazy_earth(refractivity=0.0), settings).radiance(-3.0, 30.0, [0.0, 90.0])
    np.testing.assert_array_equal(off, none)


def test_bent_lines_lift_the_horizon():
    """At 1 deg the ray comes from 0.5 deg lower, at 60 deg from nowhere else: fails if apparent angles are lost."""
    field = prepare(hazy_earth(), SETTINGS)
    straight = replace(field, settings=replace(SETTINGS, bent_lines_of_sight=False))
    low, high = field.radiance(30.0, [1.0, 60.0], 90.0)[:, 0], straight.radiance(30.0, [1.0, 60.0], 90.0)[:, 0]
    assert 0.001 < abs(low[0] / high[0] - 1) < 0.1
    assert abs(low[1] / high[1] - 1) < 1e-3
