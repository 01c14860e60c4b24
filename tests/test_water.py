"""A water surface as the ground: closed forms, reciprocity, energy, and both solvers that take it."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hazy_zones import QUICK
from montecarlo_media import hazy_earth, slab

from twilight import solvers
from twilight.atmosphere import water_surface
from twilight.base.errors import TwilightError
from twilight.config.load import load_climate
from twilight.scene import Scene
from twilight.scene.medium import climate_medium
from twilight.solvers import montecarlo, zones
from twilight.solvers.zones.water import N_COSINES, cosines, reflection

INDEX = 1.34
WIND_5 = water_surface.mean_square_slope(5.0)
FIXED = montecarlo.MonteCarloSettings(target_stderr=None, samples=400)


def sea(depth: float, wind_m_s: float = 5.0, albedo: float = 0.0):
    """Air of an optical depth, 1 km thick, over water on the Earth's sphere."""
    air = replace(slab(depth, 1.0, None, albedo, radius_km=6371.0), depolarisation=np.array([0.03]))
    return replace(air, water_mean_square_slope=water_surface.mean_square_slope(wind_m_s))


def test_fresnel():
    """Reflection of a flat surface would not have Fresnel's limits: normal, Brewster's angle, grazing."""
    assert water_surface.flat_reflectance(1.0, INDEX) == pytest.approx(((INDEX - 1) / (INDEX + 1)) ** 2)
    rp, rs = water_surface.fresnel(math.cos(math.atan(INDEX)), INDEX)
    assert rp == pytest.approx(0.0, abs=1e-12)
    assert rs == pytest.approx(-(INDEX**2 - 1) / (INDEX**2 + 1))
    assert water_surface.flat_reflectance(0.0, INDEX) == pytest.approx(1.0)
    # straight back, light that vibrates along one diagonal comes as along the other: as of a small sphere
    rp, rs = water_surface.fresnel(1.0, INDEX)
    assert rp == pytest.approx(-rs)


def test_index_of_sea_water():
    """The index of sea water would be off the literature."""
    # Austin & Halikas 1976, salinity 35, 15 deg C, over air: 1.3397 at 589 nm; water is bluer than that in blue
    assert float(water_surface.refractive_index(589.3)) == pytest.approx(1.3397, abs=3e-4)
    assert np.all(np.diff(water_surface.refractive_index(np.linspace(300.0, 1000.0, 50))) < 0.0)


def test_wind_out_of_range():
    """A wind that was never measured would be extrapolated."""
    with pytest.raises(TwilightError, match="allowed is 1 to 14"):
        water_surface.mean_square_slope(20.0)


def test_reciprocity():
    """The sea would reflect more one way than back."""
    generator = np.random.default_rng(3)
    for mu_in, mu_out, azimuth in generator.uniform([0.02, 0.02, 0.0], [1.0, 1.0, np.pi], (200, 3)):
        cosine = math.sqrt((1 - mu_in**2) * (1 - mu_out**2)) * math.cos(azimuth) - mu_in * mu_out
        there = np.array(water_surface.glitter(mu_in, mu_out, cosine, INDEX, WIND_5)) / mu_in
        back = np.array(water_surface.glitter(mu_out, mu_in, cosine, INDEX, WIND_5)) / mu_out
        np.testing.assert_allclose(there, back, rtol=1e-10)


def albedo(mu_in: float, index: float, slope2: float) -> float:
    """Fraction of a beam that the surface reflects, by quadrature over the sky."""
    node, weight = np.polynomial.legendre.leggauss(80)
    turns = (np.arange(180) + 0.5) * np.pi / 180
    total = 0.0
    for mu, w in zip(0.5 * (node + 1), 0.5 * weight, strict=True):
        flat = math.sqrt((1 - mu_in**2) * (1 - mu**2))
        found = [water_surface.glitter(mu_in, mu, flat * math.cos(a) - mu * mu_in, index, slope2)[0] for a in turns]
        total += w * mu * 2 * np.pi * np.mean(found)
    return total / mu_in


def test_energy():
    """The sea would reflect more light than it receives."""
    for wind, most_lost in ((1.0, 0.05), (14.0, 0.10)):
        slope2 = water_surface.mean_square_slope(wind)
        for mu_in in (1.0, 0.5, 0.2):
            # a perfect mirror reflects all but what meets a second facet
            assert 1.0 - most_lost < albedo(mu_in, 1e6, slope2) <= 1.0 + 1e-3
        assert albedo(1.0, INDEX, slope2) == pytest.approx(water_surface.flat_reflectance(1.0, INDEX), rel=0.02)


@pytest.fixture(scope="module")
def bare():
    """A sea without air to speak of."""
    return sea(1e-7)


@pytest.mark.parametrize("name", ["montecarlo", "zones"])
def test_sun_on_a_sea_without_air(bare, name):
    """Radiance and Stokes parameters of the glint are those of the closed form; at Brewster's angle all of the light
    vibrates horizontally."""
    if name == "montecarlo":
        field = montecarlo.prepare(bare, replace(FIXED, samples=4, importance_sweeps=0), observer_altitude_km=1.0)
    else:
        field = zones.prepare(bare, replace(QUICK, polarisation=True), observer_altitude_km=1.0)
    index = float(water_surface.refractive_index(500.0))
    brewster = math.degrees(math.atan(index))
    sun, azimuth = 90.0 - brewster, np.array([0.0, 20.0, -20.0])
    stokes = field.stokes(sun, -(90.0 - brewster), azimuth)[..., 0]
    # the planet is nearly flat under a kilometre
    mu = math.cos(math.radians(brewster))
    for k, a in enumerate(np.radians(azimuth)):
        p11, p12, _ = water_surface.glitter(
            mu, mu, (1 - mu * mu) * math.cos(a) - mu * mu, index, bare.water_mean_square_slope
        )
        assert stokes[k, 0] == pytest.approx(p11, rel=3e-3)
        assert np.hypot(*stokes[k, 1:]) == pytest.approx(-p12, rel=3e-3)
    assert stokes[0, 1] == pytest.approx(-stokes[0, 0], rel=1e-4)
    assert stokes[1, 2] == pytest.approx(-stokes[2, 2], rel=1e-4)
    # the vibration is normal to the plane of incidence, which contains the sun and the line of sight
    sine, turn = math.sin(math.radians(brewster)), math.radians(20.0)
    look = np.array([sine * math.cos(turn), sine * math.sin(turn), -mu])
    across = np.cross([sine, 0.0, mu], look)
    right = np.array([-math.sin(turn), math.cos(turn), 0.0])
    upward = np.array([mu * math.cos(turn), mu * math.sin(turn), sine])
    chi = math.atan2(across @ right, across @ upward)
    assert stokes[1, 1] == pytest.approx(np.hypot(*stokes[1, 1:]) * math.cos(2 * chi), rel=1e-3)
    assert stokes[1, 2] == pytest.approx(np.hypot(*stokes[1, 1:]) * math.sin(2 * chi), rel=1e-2)


def test_reflected_sky_is_the_integral_of_the_glitter():
    """The matrices of the zones solver against a fine sum over directions."""
    cosine = np.linspace(0.0, 1.0, 9) ** 1.5
    table = reflection(cosine, 3, 1, np.array([INDEX]), WIND_5)[0]
    node, weight = np.polynomial.legendre.leggauss(120)
    mu_in = 0.5 * (node + 1)
    turns = (np.arange(240) + 0.5) * np.pi / 240
    for k in (4, 9, N_COSINES - 2):
        mu = float(cosines()[k])
        for m in (0, 1, 2):
            # light 1 - cosine falls in, times cos(m azimuth)
            total = 0.0
            for x, w in zip(mu_in, 0.5 * weight, strict=True):
                flat = math.sqrt((1 - x * x) * (1 - mu * mu))
                found = [water_surface.glitter(x, mu, flat * math.cos(a) - x * mu, INDEX, WIND_5)[0] for a in turns]
                total += w * 2 * np.pi * (1 - x) * np.mean(found * np.cos(m * turns))
            assert table[m, k, 0, :, 0] @ (1 - cosine) == pytest.approx(total, rel=0.01)


ELEVATION = np.array([-70.0, -40.0, -20.0, -8.0, 10.0, 50.0])
AZIMUTH = np.array([20.0, 20.0, 70.0, 20.0, 20.0, 110.0])


@pytest.fixture(scope="module")
def hazy_sea():
    """Fields by the reference solution, by `zones`, and by `zones` without the water."""
    air = replace(hazy_earth(ground=0.02), water_mean_square_slope=WIND_5)
    draft = replace(QUICK, polarisation=True)
    exact = montecarlo.prepare(air, FIXED, observer_altitude_km=1.5)
    quick, land = (
        zones.prepare(medium, draft, observer_altitude_km=1.5)
        for medium in (air, replace(air, water_mean_square_slope=0.0))
    )
    return exact, quick, land


@pytest.mark.parametrize("sun", [*(pytest.param(sun, marks=pytest.mark.slow) for sun in (40.0, 8.0)), -3.0])
def test_both_solvers_see_the_same_sea(hazy_sea, sun):
    """zones and montecarlo would see different seas."""
    field, quick, land = hazy_sea
    exact = field.stokes_with_error(sun, ELEVATION, AZIMUTH)
    ours, right, noise = quick.stokes(sun, ELEVATION, AZIMUTH), exact.stokes, exact.standard_error / exact.stokes[:, :1]
    assert noise.max() < 0.04
    error = np.abs(ours - right) / right[:, :1]
    assert np.all(error < 0.02 + 3.0 * noise), error[..., 0]
    # and water is seen to polarise: without it these directions are those of a black ground
    assert np.any(np.abs(land.stokes(sun, ELEVATION, AZIMUTH) - right)[:4] / right[:4, :1] > 0.1)


def test_a_climate_over_water(tmp_path):
    """A configuration's water would not arrive, or solvers without water take it for land."""
    path = tmp_path / "sea.yaml"
    path.write_text("version: 1\nground: {kind: water, wind_speed_m_s: 10, albedo: 0.03}\naerosol: null\n")
    medium = climate_medium(load_climate(str(path)), np.array([550.0]))
    assert medium.water_mean_square_slope == pytest.approx(0.0542)
    assert medium.select(slice(0, 1)).has_water
    for name in ("tables", "cells"):
        module = solvers.load(name)
        with pytest.raises(TwilightError, match=f"ground.kind: water cannot be seen by the solver {name}"):
            Scene(medium, None, module, module.QUALITIES["standard"])


@pytest.mark.parametrize(
    ("ground", "words"),
    [
        ("{wind_speed_m_s: 5}", "wind_speed_m_s is for kind: water"),
        ("{kind: water, wind_speed_m_s: 30}", "wind_speed_m_s"),
        ("{kind: water, albedo: 0.6}", "at most 0.2"),
        ("{kind: ice}", "kind"),
    ],
)
def test_grounds_that_are_refused(tmp_path, ground, words):
    """A contradictory ground would be computed."""
    path = tmp_path / "sea.yaml"
    path.write_text(f"version: 1\nground: {ground}\n")
    with pytest.raises(TwilightError, match=words):
        load_climate(str(path))
