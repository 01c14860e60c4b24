from dataclasses import replace

import numpy as np
import pytest
from toy_sky import texture_grid

from twilight.base.errors import TwilightError
from twilight.numerics import spectrum
from twilight.sky.sky import Sky

WAVELENGTHS = np.array([400.0, 500.0, 600.0, 700.0])


def make_sky(function, step_deg=3.0, wavelength=WAVELENGTHS, grid=None, **fields):
    elevation, azimuth = texture_grid(step_deg) if grid is None else grid
    values = function(np.radians(elevation)[:, None, None], np.radians(azimuth)[None, :, None])
    values = np.broadcast_to(values, (elevation.size, azimuth.size, wavelength.size)).copy()
    return Sky(wavelength, elevation, azimuth, values, 5.0, **fields)


def test_default_texture_is_that_of_the_contract():
    """Files would have other rows and columns than promised."""
    elevation, azimuth = texture_grid()
    assert elevation.size == 30 and azimuth.size == 120
    np.testing.assert_allclose(elevation[[0, 1, -1]], [1.5, 4.5, 88.5])
    np.testing.assert_allclose(azimuth[[0, 1, -1]], [0.0, 3.0, 357.0])


@pytest.mark.parametrize(
    "grid",
    [
        texture_grid(3.0),
        texture_grid(90.0),
        (
            np.sort(90.0 * np.linspace(0.0, 1.0, 40) ** 2),
            180.0 * np.linspace(0.0, 2.0, 90, endpoint=False) ** 1.2 / 2.0**0.2,
        ),
        (np.array([0.0, 10.0, 45.0, 90.0]), np.array([0.0])),
    ],
    ids=["texture", "one row", "crowded", "uneven with horizon and zenith"],
)
def test_uniform_sky_gives_pi_and_two_pi(grid):
    """Solid angles would not sum to the hemisphere."""
    sky = make_sky(lambda e, a: 1.0, grid=grid)
    np.testing.assert_allclose(sky.irradiance_factor(), np.pi, rtol=1e-12)
    np.testing.assert_allclose(sky.irradiance_factor(horizontal=False), 2 * np.pi, rtol=1e-12)
    np.testing.assert_allclose(sky.solid_angle_sr().sum(), 2 * np.pi, rtol=1e-12)


def test_irradiance_of_graded_skies_converges_to_the_closed_form():
    # Moon and Spencer's overcast sky 1 + 2 sin e gives 7 pi / 3; a gradient along the azimuth of the sun cancels.
    """Irradiances would be off on coarse textures."""

    def graded(e, a):
        return 1 + 2 * np.sin(e) + 0.5 * np.cos(e) * np.cos(a)

    errors = [make_sky(graded, step).irradiance_factor()[0] / (7 * np.pi / 3) - 1 for step in (6.0, 3.0)]
    assert abs(errors[1]) < 5e-4
    assert errors[0] / errors[1] == pytest.approx(4.0, rel=0.05)


def test_direct_beam_is_added_with_the_cosine_of_the_apparent_sun():
    """The sun would light the ground from its true place, or from below."""
    sky = make_sky(lambda e, a: 1.0, direct_irradiance=np.full(4, 0.5), apparent_sun_elevation_deg=30.0)
    np.testing.assert_allclose(sky.irradiance_factor(direct=True), np.pi + 0.25)
    np.testing.assert_allclose(sky.irradiance_factor(horizontal=False, direct=True), 2 * np.pi + 0.5)
    below = replace(sky, apparent_sun_elevation_deg=-3.0)
    np.testing.assert_allclose(below.irradiance_factor(direct=True), np.pi)
    with pytest.raises(TwilightError, match="direct_irradiance"):
        replace(sky, direct_irradiance=None).irradiance_factor(direct=True)


def test_samples_at_grid_points_are_the_grid():
    """Sampling would move what is computed."""
    rng = np.random.default_rng(1)
    sky = make_sky(lambda e, a: rng.lognormal(size=(30, 120, 4)))
    grid = np.meshgrid(sky.elevation_deg, sky.azimuth_deg, indexing="ij")
    np.testing.assert_allclose(sky.sample(*grid), sky.sun_normalised_radiance, rtol=1e-12)
    np.testing.assert_allclose(sky.smooth(sky.sun_normalised_radiance, *grid), sky.sun_normalised_radiance, rtol=1e-12)
    rows = sky.smooth(sky.sun_normalised_radiance, sky.elevation_deg[:, None], sky.azimuth_deg[None, :])
    np.testing.assert_allclose(rows, sky.sun_normalised_radiance, rtol=1e-12)


def test_sampling_is_exact_for_an_exponential_in_elevation_down_to_the_horizon():
    """The horizon would be read too bright."""
    sky = make_sky(lambda e, a: np.exp(-3 * e) + 0 * a)
    e = np.array([0.0, 0.7, 10.0, 45.2, 80.0])
    np.testing.assert_allclose(sky.sample(e, 17.0)[:, 0], np.exp(-3 * np.radians(e)), rtol=1e-10)
    np.testing.assert_allclose(
        sky.smooth(sky.sun_normalised_radiance, e, np.full(5, 17.0))[:, 0], np.exp(-3 * np.radians(e)), rtol=1e-10
    )


def test_azimuth_wraps_and_any_multiple_of_a_turn_is_the_same():
    """There would be a seam at azimuth 0, or radiances of another distance or bin."""
    sky = make_sky(lambda e, a: 2 + np.cos(a))
    np.testing.assert_allclose(sky.sample(20.0, 359.0), sky.sample(20.0, -1.0), rtol=1e-12)
    np.testing.assert_allclose(sky.sample(20.0, 359.0), sky.sample(20.0, 719.0), rtol=1e-12)
    np.testing.assert_allclose(sky.sample(20.0, 359.0), 2 + np.cos(np.radians(1.0)), rtol=1e-5)
    sky = make_sky(lambda e, a: 0.01, distance_au=2.0)
    expected = 0.01 * spectrum.solar_irradiance(WAVELENGTHS) / 4
    np.testing.assert_allclose(sky.radiance[3, 5], expected, rtol=1e-14)
    np.testing.assert_allclose(sky.irradiance(), np.pi * expected, rtol=1e-12)


@pytest.mark.parametrize("step", [3.0, 10.0], ids=["even columns", "36 columns"])
def test_the_zenith_has_one_value_and_the_sky_is_continuous_there(step):
    """The zenith would be a pinwheel."""
    sky = make_sky(lambda e, a: np.exp(0.8 * np.cos(e) * np.cos(a)), step)
    azimuths = np.linspace(0, 360, 13)
    at_zenith = sky.sample(90.0, azimuths)
    np.testing.assert_allclose(at_zenith, at_zenith[0, 0], rtol=1e-12)
    np.testing.assert_allclose(at_zenith[0, 0], 1.0, rtol=1e-3)
    near = sky.sample(89.0, azimuths)[:, 0]
    np.testing.assert_allclose(near, np.exp(0.8 * np.cos(np.radians(89.0)) * np.cos(np.radians(azimuths))), rtol=2e-3)
    smooth = sky.smooth(sky.sun_normalised_radiance, np.full(13, 90.0), azimuths)
    np.testing.assert_allclose(smooth, 1.0, rtol=3e-3)


def test_interpolation_error_falls_with_the_third_power_of_the_step_at_least():
    """A finer texture would not be a better sky."""

    def function(e, a):
        return np.exp(np.cos(e) * np.cos(a) - 2 * np.sin(e) ** 2)

    e, a = np.meshgrid(np.linspace(5, 85, 37), np.linspace(0, 350, 41), indexing="ij")
    truth = function(np.radians(e), np.radians(a))
    error = []
    for step in (6.0, 3.0):
        sky = make_sky(function, step)
        error.append(np.abs(sky.sample(e, a)[..., 0] / truth - 1).max())
    assert error[1] < 1e-4 and error[0] / error[1] > 8


def test_zeros_are_interpolated_linearly_and_never_give_nan():
    """Black beside light would be NaN."""
    values = np.zeros((30, 120, 4))
    values[10, 4] = 1.0
    sky = make_sky(lambda e, a: values)
    np.testing.assert_allclose(sky.sample(31.5, 12.0), 1.0)
    np.testing.assert_allclose(sky.sample(31.5, 13.5), 0.5)
    np.testing.assert_allclose(sky.sample(33.0, 13.5), 0.25)
    everywhere = sky.sample(*np.meshgrid(np.linspace(0, 90, 50), np.linspace(0, 360, 70)))
    assert np.isfinite(everywhere).all() and (everywhere >= 0).all() and everywhere.max() <= 1
    smooth = sky.smooth(sky.sun_normalised_radiance, np.linspace(0, 90, 50)[:, None], np.linspace(0, 360, 70)[None, :])
    assert np.isfinite(smooth).all() and (smooth >= 0).all()


def test_resample_keeps_everything_else_and_interpolates_the_standard_error():
    """Another grid would lose the record or the noise, or a small file have other values."""
    sky = make_sky(lambda e, a: 1 + np.sin(e), standard_error=np.full((30, 120, 4), 0.1), provenance={"solver": "x"})
    finer = sky.resample(np.array([10.0, 20.0]), np.array([0.0, 90.0, 180.0, 270.0]))
    assert finer.provenance == {"solver": "x"} and finer.sun_elevation_deg == sky.sun_elevation_deg
    np.testing.assert_allclose(finer.standard_error, 0.1)
    np.testing.assert_allclose(finer.sun_normalised_radiance[1, 2], sky.sample(20.0, 180.0))
    sky = make_sky(lambda e, a: 1e-9 * np.exp(-e))
    single = replace(sky, sun_normalised_radiance=sky.sun_normalised_radiance.astype(np.float32))
    assert single.sample(12.3, 45.6).dtype == np.float32
    np.testing.assert_allclose(single.sample(12.3, 45.6), sky.sample(12.3, 45.6), rtol=1e-5)
    np.testing.assert_allclose(single.luminance(), sky.luminance(), rtol=1e-5)


def test_luminance_and_illuminance_of_a_uniform_sky_follow_the_sum_rule():
    # 133.1 klx: the illuminance of the sun outside the air (ASTM G173: 1366 W m^-2 and 97.4 lm/W).
    """Lux would be off 133.1 klx of the sun outside the air."""
    sky = make_sky(lambda e, a: 1.0)
    grid, sun = spectrum.solar_spectrum()
    v = np.interp(grid, spectrum.VISIBLE_NM, spectrum.colour_matching_functions("cie1931_2deg")[:, 1], 0, 0)
    outside = 683.002 * (sun * v).sum()
    assert outside == pytest.approx(133.1e3, rel=1e-3)
    np.testing.assert_allclose(sky.luminance(), outside, rtol=1e-12)
    assert sky.illuminance_lux() == pytest.approx(np.pi * outside, rel=1e-12)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"sun_normalised_radiance": np.ones((2, 2, 2))}, "shape"),
        ({"sun_normalised_radiance": np.full((30, 120, 4), -1.0)}, "not negative"),
        ({"sun_normalised_radiance": np.full((30, 120, 4), np.nan)}, "finite"),
        ({"wavelength_nm": WAVELENGTHS[::-1]}, "wavelength_nm"),
        ({"elevation_deg": np.linspace(90, 0, 30)}, "elevation_deg"),
        ({"azimuth_deg": np.linspace(0, 180, 120)}, "azimuth_deg"),
        ({"azimuth_deg": np.arange(120) * 3.0 + 4.0}, "azimuth_deg"),
        ({"azimuth_deg": np.arange(120) * 1.5}, "all round"),
        ({"standard_error": np.ones(3)}, "standard_error"),
        ({"ground_albedo": np.full(4, 1.5)}, "ground_albedo"),
        ({"distance_au": 0.0}, "distance_au"),
        ({"solar_spectrum": "sun"}, "astm_g173_etr"),
    ],
)
def test_what_is_no_sky_is_said_in_one_sentence(change, message):
    """An impossible sky would be shown."""
    with pytest.raises(TwilightError, match=message) as caught:
        replace(make_sky(lambda e, a: 1.0), **change)
    assert "\n" not in str(caught.value)


def test_directions_below_the_sky_are_refused():
    """Light of the lowest row would stand for the ground."""
    with pytest.raises(TwilightError, match="elevation_deg"):
        make_sky(lambda e, a: 1.0).sample(-1.0, 0.0)
    high = make_sky(lambda e, a: 1.0, grid=(np.linspace(-8, 89, 98), np.arange(8) * 45.0))
    assert high.sample(-8.4, 10.0)[0] == pytest.approx(1.0)
    np.testing.assert_allclose(high.irradiance_factor(), np.pi)
