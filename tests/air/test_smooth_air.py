"""Air goes through its levels without bends: the rule in closed form, and one index for all that bends light."""

import numpy as np
import pytest
from airs import on_levels, pure_air

from twilight.atmosphere.build import build_medium
from twilight.atmosphere.levels import monotone_cubic, monotone_slopes
from twilight.atmosphere.profiles import PROFILES, load_profile
from twilight.solvers.montecarlo.air import prepare_air
from twilight.transport.beam_tables import full_bending
from twilight.transport.lines import with_refraction
from twilight.transport.profile import prepare_profile
from twilight.transport.ray_profile import ray_profile, refractivity_at


@pytest.fixture(scope="module")
def summer():
    return build_medium([550.0], profile="midlatitude_summer")


def test_the_curve_keeps_lines_parabolas_and_bounds():
    """The curve through levels would overshoot, or bend a straight line."""
    x = np.array([0.0, 0.4, 1.0, 1.1, 3.0, 7.0])
    np.testing.assert_allclose(
        monotone_cubic(np.linspace(0, 7, 50), x, 3.0 - 2.0 * x), 3.0 - 2.0 * np.linspace(0, 7, 50)
    )
    # a parabola that is steep enough everywhere is its own derivative's
    np.testing.assert_allclose(monotone_slopes(x, (x + 20.0) ** 2), 2.0 * (x + 20.0), rtol=1e-12)
    rng = np.random.default_rng(5)
    for _ in range(200):
        x, y = np.cumsum(rng.uniform(0.01, 2.0, 12)), rng.normal(size=12)
        for i in range(11):
            piece = monotone_cubic(np.linspace(x[i], x[i + 1], 40), x, y)
            steps = np.diff(piece) * np.sign(y[i + 1] - y[i])
            assert steps.min() > -1e-12


@pytest.mark.parametrize("name", PROFILES)
def test_the_state_of_the_air_has_continuous_slopes(name):
    """The profile would have kinks at its levels."""
    profile = load_profile(name)
    h = 1e-5
    inner = profile.altitude_km[1:-1]
    for key in ("temperature_k", "pressure_hpa", "air_per_cm3", "h2o_per_cm3"):
        low, here, high = (np.log(getattr(profile.at(z), key)) for z in (inner - h, inner, inner + h))
        # a bend of the straight pieces would be their difference of slopes
        pieces = np.diff(np.log(getattr(profile, key))) / np.diff(profile.altitude_km)
        assert np.abs((high - 2.0 * here + low) / h).max() < 1e-3 * max(np.abs(np.diff(pieces)).max(), 1e-3)


def test_index_and_scattering_of_a_medium_have_continuous_slopes(summer):
    """Kinks at the levels would focus light, or the column not be the curve's integral."""
    levels, h = summer.altitude_km[1:-1], 1e-5
    for key in ("refractivity", "air_scattering"):
        low, here, high = (np.log(getattr(summer.at(z), key)[:, 0]) for z in (levels - h, levels, levels + h))
        below, above = (here - low) / h, (high - here) / h
        np.testing.assert_allclose(above, below, atol=3e-5)
    fine = summer.refined(0.05, 1e-6)
    np.testing.assert_allclose(summer.optical_depth("air"), fine.optical_depth("air"), rtol=1e-7)


def test_all_that_bends_light_has_the_same_index(summer):
    """Beam, lines of sight and medium would refract by different curves."""
    z = np.random.default_rng(2).uniform(0.0, 90.0, 400)
    index = summer.at(z).refractivity[:, 0]
    profile = ray_profile(summer)
    np.testing.assert_allclose([refractivity_at(profile, 0, y) for y in z], index, rtol=1e-12)
    air = prepare_air(summer)
    np.testing.assert_allclose(np.interp(z, air.level_km, air.refractivity[0]), index, rtol=2e-4, atol=1e-10)
    bent = with_refraction(prepare_profile(summer), summer)
    low, high = (summer.at(y).refractivity[:, 0] for y in (z - 1e-3, z + 1e-3))
    found = np.interp(z, bent.altitude_km, bent.gradient_per_km)
    np.testing.assert_allclose(found, np.log1p(high - low) / 2e-3, rtol=0.02, atol=1e-8)


def test_the_sunbeam_spreads_without_spikes_at_the_levels(summer):
    """Widening 500 km behind the limb, of rays 0.1 km apart beside the mean of their neighbours: under straight pieces
    of the index's logarithm single rays stood out by a factor of 3."""
    profile = ray_profile(summer)
    lowest = np.arange(1.0, 60.0, 0.1)
    pairs = [(full_bending(profile, 0, z - 0.005), full_bending(profile, 0, z + 0.005)) for z in lowest]
    wide = np.array([1.0 - 500.0 * (b[1] - a[1]) / (b[0] - a[0]) for a, b in pairs])
    rough = np.abs(wide[1:-1] / (0.5 * (wide[2:] + wide[:-2])) - 1.0)
    assert rough.max() < 0.05
    assert np.sqrt(np.mean(rough**2)) < 0.004


def test_a_jump_of_the_scattering_stays_a_jump():
    """A jump would be smoothed, or a joined index would jump."""
    medium = pure_air(np.linspace(0.0, 60.0, 31))
    levels = np.sort(np.append(medium.altitude_km, 10.0))
    scattering = medium.at(levels).air_scattering * np.where(np.arange(levels.size) < 6, 2.0, 1.0)[:, None]
    jump = on_levels(medium, levels, air_scattering_per_km=scattering)
    z = np.linspace(0.3, 59.7, 199)
    expected = medium.at(z).air_scattering * np.where(z < 10.0, 2.0, 1.0)[:, None]
    np.testing.assert_allclose(jump.at(z).air_scattering, expected, rtol=1e-12)
    np.testing.assert_allclose(jump.refined().at(z).refractivity, medium.at(z).refractivity, rtol=1e-9)


def test_what_kernels_interpolate_keeps_the_column_of_layers():
    """Layers of constant scattering: refined levels take each side of a jump from its own layer."""
    air = pure_air(np.linspace(0.0, 60.0, 31))
    z = np.repeat(np.arange(0.0, 6.0), 2)[1:-1]
    per_km = np.repeat([0.025, 0.023, 0.02, 0.012, 0.011], 2)[:, None] * np.ones(air.wavelength_nm.size)
    layers = on_levels(air, z, air_scattering_per_km=per_km, refractivity=np.zeros_like(per_km))
    for profile in (layers.refined(), prepare_profile(layers)):
        levels = profile.altitude_km
        scattering = profile.air_scattering_per_km if hasattr(profile, "refined") else profile.scattering
        np.testing.assert_allclose(np.trapezoid(scattering, levels, axis=0), 0.091, rtol=1e-12)
