"""Directions of the zones solver: how many, where they lie, and what sums over them lose."""

from dataclasses import replace

import numpy as np
import pytest
from hazy_zones import QUICK

from twilight.atmosphere.build import build_medium
from twilight.config.load import load_climate
from twilight.scene.medium import climate_medium
from twilight.solvers import zones
from twilight.solvers.zones.air_needs import altitude_nodes, directions_needed, rims_km, with_degree
from twilight.solvers.zones.angles import conserving_angles, even_harmonics, make_angles
from twilight.solvers.zones.constants import RIM_POLAR
from twilight.solvers.zones.lines_of_sight import sun_lift
from twilight.transport.lines import horizon_cosine, trace_rays, with_refraction
from twilight.transport.profile import prepare_profile
from twilight.transport.scaling import delta_scaled

STANDARD = zones.QUALITIES["standard"]
WAVELENGTH_NM = np.array([450.0, 680.0])


@pytest.fixture(scope="module")
def desert():
    return climate_medium(load_climate("desert"), WAVELENGTH_NM)


def moments_of(light, horizon):
    """Moments of order 0 of light by the cosine, which may jump at the horizon, by a fine quadrature."""
    x, w = np.polynomial.legendre.leggauss(300)
    below, above = horizon + 1.0, 1.0 - horizon
    fine = np.concatenate([0.5 * (x + 1.0) * below - 1.0, 0.5 * (x + 1.0) * above + horizon])
    return (np.concatenate([w * below, w * above]) / 4.0 * light(fine)) @ even_harmonics(fine, STANDARD.degree, 0)


@pytest.mark.parametrize("horizon", [0.0, -0.1])
@pytest.mark.parametrize(
    ("above", "below", "allowed"),
    [
        (lambda x: 1.0 + 0.0 * x, lambda x: 0.3 + 0.0 * x, 1e-9),
        (lambda x: 1.0 - 0.7 * x, lambda x: 0.3 + 0.2 * x, 1e-9),
        (lambda x: np.exp(-x / 0.3), lambda x: 0.3 * np.exp(-x / 0.5), 4e-3),
        (lambda x: np.exp(-x / 0.02), lambda x: 0.0 * x, 1e-3),
    ],
    ids=["even", "linear", "smooth", "glow at the horizon"],
)
def test_few_polar_angles_find_no_harmonics_in_light_that_has_none(horizon, above, below, allowed):
    """Moments of light that is the same all around, jumps at the horizon and is smooth or narrow above it; error
    relative to its mean, as large as 0.4 if the quadrature's weights alone do it."""

    def light(cosine):
        x = np.abs(cosine - horizon)
        return np.where(cosine > horizon, above(x), below(x))

    angles = make_angles(np.array([horizon]), STANDARD.polar_directions, STANDARD.azimuth_directions, STANDARD.degree)
    truth = moments_of(light, horizon)
    got = angles.analysis[0][angles.order == 0].sum(axis=2) @ light(angles.cosine[0])
    assert np.abs(got - truth).max() < allowed * truth[0]


def test_directions_that_keep_energy_lose_no_high_degree():
    """Light that is linear in the cosine on either side of the horizon; relative to its mean."""
    angles = make_angles(np.array([-0.03]), STANDARD.polar_directions, STANDARD.azimuth_directions, STANDARD.degree)

    def light(cosine):
        return np.where(cosine > -0.03, 1.0 - 0.7 * cosine, 0.3 + 0.2 * cosine)

    truth = moments_of(light, -0.03)
    got = conserving_angles(angles).analysis[0][angles.order == 0].sum(axis=2) @ light(angles.cosine[0])
    assert np.abs(got - truth).max() < 1e-3 * truth[0]


def test_rays_part_at_the_horizon_bent_or_straight():
    """A ray a hundredth of a degree above `horizon_cosine` misses the ground, one as much below hits it."""
    medium = build_medium(WAVELENGTH_NM, aerosol=None)
    straight = prepare_profile(medium)
    bent = with_refraction(straight, medium)
    altitude = np.array([0.5, 3.0, 20.0, 60.0])
    for profile in (straight, bent):
        horizon = np.arccos(horizon_cosine(profile, altitude))
        for aside, hits in ((-1e-4, False), (1e-4, True)):
            rays = trace_rays(profile, altitude, np.cos(horizon + aside), 2.0)
            assert np.array_equal(rays.ground_weight.max(axis=1) > 0.0, np.full(4, hits))
    radius = medium.earth_radius_km
    np.testing.assert_allclose(
        horizon_cosine(straight, altitude), -np.sqrt(1.0 - (radius / (radius + altitude)) ** 2), rtol=1e-9
    )
    assert horizon_cosine(bent, np.zeros(1))[0] == 0.0
    raised = np.degrees(np.arccos(horizon_cosine(straight, altitude)) - np.arccos(horizon_cosine(bent, altitude)))
    assert np.all(raised > 0.05) and np.all(raised < 0.2)


def test_only_coarse_particles_take_more_directions(desert):
    """Ordinary air would pay for directions that dust needs."""

    def of(medium):
        scaled = delta_scaled(medium, STANDARD.degree)
        return directions_needed(STANDARD, scaled, prepare_profile(scaled.medium))

    for climate in ("pure-air", "continental-average", "urban"):
        assert of(climate_medium(load_climate(climate), WAVELENGTH_NM)) == STANDARD
    more = of(desert)
    assert STANDARD.azimuth_directions + 4 <= more.azimuth_directions <= STANDARD.degree + 1
    assert more.late_degree >= 9 and more.late_polar_directions >= 9 and more.late_azimuth_directions >= 9
    asked = replace(STANDARD, azimuth_directions=30, late_degree=16, late_polar_directions=24)
    scaled = delta_scaled(desert, STANDARD.degree)
    profile = prepare_profile(scaled.medium)
    more_polar = asked.polar_directions + RIM_POLAR
    assert directions_needed(asked, scaled, profile) == replace(asked, polar_directions=more_polar)
    by_hand = directions_needed(replace(STANDARD, late_degree=12), scaled, profile)
    assert by_hand.late_polar_directions == by_hand.late_degree == 12


def test_the_top_of_dust_is_a_rim_that_polar_angles_part_at(desert):
    """A glow that begins at the rim, 4 times as bright as the haze below it: its mean, from 7, 10 and 40 km up.

    Quadrature across the jump is off by up to 13 %.
    """
    assert rims_km(prepare_profile(desert), STANDARD.altitude_density).tolist() == [6.0]
    assert not rims_km(prepare_profile(desert), zones.QUALITIES["draft"].altitude_density).size
    for climate in ("continental-average", "urban", "maritime-clean"):  # the air itself hides what is behind
        profile = prepare_profile(climate_medium(load_climate(climate), WAVELENGTH_NM))
        assert not rims_km(profile, STANDARD.altitude_density).size
    altitude = np.array([7.0, 10.0, 40.0])
    profile = prepare_profile(desert)
    horizon, rim = (horizon_cosine(profile, altitude, at) for at in (None, np.full(3, 6.0)))
    polar = STANDARD.polar_directions + RIM_POLAR
    worst = []
    for rims in (rim, None):
        angles, errors = make_angles(horizon, polar, 9, STANDARD.degree, 0, rims), []
        for h, r, mu, weight in zip(horizon, rim, angles.cosine, angles.weight, strict=True):
            assert weight.sum() == pytest.approx(1.0) and np.all(np.diff(mu) > 0.0)
            light = np.where(mu > r, np.exp((r - mu) / 0.03), np.where(mu > h, 0.25, 0.0))
            truth = 0.5 * (0.03 * (1.0 - np.exp((r - 1.0) / 0.03)) + 0.25 * (r - h))
            errors.append(abs(weight @ light / truth - 1.0))
        worst.append(max(errors))
    assert worst[0] < 1e-3 < worst[1]
    without, closer = (altitude_nodes(0.0, 100.0, np.array([6.0, 17.0]), 0.7, rims) for rims in (None, np.array([6.0])))
    assert np.array_equal(without[without <= 6.0], closer[closer <= 6.0])
    for jump in (6.0, 17.0):
        assert np.diff(closer[closer >= jump])[0] < 1.3 < np.diff(without[without >= jump])[0]


@pytest.mark.parametrize("climate", ["volcanic-stratosphere", "volcanic-extreme"])
def test_later_orders_below_a_volcano_follow_its_peak(climate):
    """With degree 9 there 95 % of errors at 680 nm were below 5.1 and 11 % at -12 and -18 deg, with 12 below 2.6 and
    3.2 %."""
    medium = climate_medium(load_climate(climate), np.array([680.0]))
    scaled = delta_scaled(medium, STANDARD.degree)
    asked = directions_needed(STANDARD, scaled, prepare_profile(scaled.medium))
    assert asked.late_degree == asked.late_polar_directions == 12
    assert asked.azimuth_directions == asked.late_azimuth_directions == STANDARD.azimuth_directions
    grown = with_degree(STANDARD, medium)
    assert grown.degree == 20 and grown.altitude_density == pytest.approx(1.4 * STANDARD.altitude_density)
    quiet = climate_medium(load_climate("continental-average"), np.array([680.0]))
    assert with_degree(STANDARD, quiet) == STANDARD


def test_the_glow_beside_the_sun_is_that_of_a_sun_where_it_appears(desert):
    """Refraction lifts a sun at 5 deg by 0.15 deg: dust glows beside it as beside a sun that stands there.

    Behind as much air: the bent ways are longer, by the same fraction for all these directions.
    """
    alone = replace(QUICK, max_orders=1)
    bent, straight = (
        zones.prepare(desert, replace(alone, refraction=on, bent_lines_of_sight=on, bent_paths=on))
        for on in (True, False)
    )
    lift = np.degrees(sun_lift(bent.beam, 0.0, np.radians(85.0)))
    assert 0.13 < lift < 0.18
    elevation = np.array([6.0, 5.6, 4.2, 8.0])
    glow = bent.radiance(5.0, elevation, np.zeros(4)) / straight.radiance(5.0 + lift, elevation, np.zeros(4))
    np.testing.assert_allclose(glow / glow[-1], 1.0, atol=0.01)
