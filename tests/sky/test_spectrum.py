import numpy as np
import pytest

from twilight.base.errors import TwilightError
from twilight.numerics import spectrum


def test_solar_irradiance_over_coarse_bins_keeps_the_total():
    """Coarse sampling would change the solar constant."""
    grid, sun = spectrum.solar_spectrum()
    wavelength = np.array([400.0, 450.0, 500.0, 550.0, 600.0])
    bounds = spectrum.wavelength_bounds(wavelength)
    np.testing.assert_allclose(bounds[0], [375.0, 425.0])
    total = (spectrum.solar_irradiance(wavelength) * np.diff(bounds, axis=1)[:, 0]).sum()
    inside = (grid > 375) & (grid < 625)
    # 375 and 625 are the middles of 1 nm bins, half of which counts.
    expected = sun[inside].sum() + 0.5 * (sun[grid == 375] + sun[grid == 625])[0]
    assert total == pytest.approx(expected, rel=1e-12)


def test_solar_irradiance_at_one_nm_is_the_table_and_goes_with_the_square_of_distance():
    """The solar table would be interpolated, end too soon, or the Earth's distance be ignored."""
    grid, sun = spectrum.solar_spectrum()
    np.testing.assert_allclose(spectrum.solar_irradiance(grid[50:90]), sun[50:90], rtol=1e-11)
    np.testing.assert_allclose(spectrum.solar_irradiance(np.array([500.0])), sun[grid == 500], rtol=1e-11)
    ratio = spectrum.solar_irradiance(grid[:3], distance_au=0.983) / sun[:3]
    np.testing.assert_allclose(ratio, 0.983**-2, rtol=1e-11)
    assert np.isfinite(spectrum.solar_irradiance(np.linspace(300, 1000, 8))).all()
    with pytest.raises(TwilightError, match="outside the solar spectrum"):
        spectrum.solar_irradiance(np.array([250.0]))
    with pytest.raises(TwilightError, match="choose one of"):
        spectrum.solar_spectrum("nothing")


@pytest.mark.parametrize("name", spectrum.solar_spectra())
def test_every_solar_spectrum_is_positive_and_near_the_others(name):
    """A solar spectrum would be in another unit."""
    grid, sun = spectrum.solar_spectrum(name)
    assert (sun > 0).all() and np.all(np.diff(grid) == 1)
    assert grid[0] <= 301 and grid[-1] >= 900
    visible = (grid >= 380) & (grid <= 780)
    reference = spectrum.solar_irradiance(np.arange(380.0, 781.0)).sum()
    assert sun[visible].sum() == pytest.approx(reference, rel=0.04)


def test_hermite_reproduces_nodes_lines_and_parabolas():
    """Spectral interpolation would not keep its order."""
    rng = np.random.default_rng(3)
    x = np.sort(rng.random(8))
    t = np.linspace(x[0], x[-1], 40)
    matrix = spectrum.hermite_matrix(x, t)
    np.testing.assert_allclose(matrix @ (2 - 3 * x), 2 - 3 * t, atol=1e-13)
    np.testing.assert_allclose(spectrum.hermite_matrix(x, x), np.eye(8), atol=1e-14)
    inner = (t >= x[1]) & (t <= x[-2])
    np.testing.assert_allclose((matrix @ x**2)[inner], t[inner] ** 2, atol=1e-13)
    assert (np.count_nonzero(np.abs(matrix) > 1e-15, axis=1) <= 4).all()
    # Beyond the nodes the outermost value is held; one node is a constant.
    np.testing.assert_allclose(spectrum.hermite_matrix(x, [-1.0, 2.0]) @ x, x[[0, -1]])
    np.testing.assert_allclose(spectrum.hermite_matrix([5.0], [1.0, 9.0]), 1.0)


@pytest.mark.parametrize("samples", [2, 3, 8, 100])
def test_a_power_law_is_exact_within_and_beyond_the_samples(samples):
    """Rayleigh's blue would depend on the sampling."""
    wavelength = np.linspace(420, 680, samples)
    np.testing.assert_allclose(
        spectrum.expand(3.0 * wavelength**-4.0, wavelength), 3.0 * spectrum.VISIBLE_NM**-4.0, rtol=1e-10
    )


def test_expansion_converges_on_a_spectrum_with_an_absorption_band():
    """More wavelengths would not give a better spectrum."""

    def truth(w):
        return (w / 550) ** -3.7 * np.exp(-0.8 * np.exp(-(((w - 600) / 50) ** 2)))

    errors = []
    for samples in (9, 18, 35):
        wavelength = np.linspace(380, 720, samples)
        inside = (spectrum.VISIBLE_NM >= 380) & (spectrum.VISIBLE_NM <= 720)
        ratio = spectrum.expand(truth(wavelength), wavelength) / truth(spectrum.VISIBLE_NM)
        errors.append(np.abs(ratio - 1)[inside].max())
    assert errors[1] < 1e-2 and errors[2] < 2e-3
    assert errors[0] > 3 * errors[1] > 9 * errors[2]


def test_zeros_one_sample_and_steep_edges_stay_finite():
    """A dark wavelength would make a spectrum infinite."""
    wavelength = np.array([400.0, 500.0, 600.0])
    out = spectrum.expand(np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 0.0], [1e-30, 1.0, 1e-30]]), wavelength)
    assert np.isfinite(out).all() and (out >= 0).all()
    assert out[0, spectrum.VISIBLE_NM == 450][0] == pytest.approx(0.5)
    assert (out[1] == 0).all()
    # Continued as at most the 8th power of the wavelength.
    assert out[2, -1] == pytest.approx(1e-30 * (830 / 600) ** -8.0)
    np.testing.assert_array_equal(spectrum.expand(np.array([2.0]), np.array([550.0])), np.full(471, 2.0))


def test_integrate_is_the_sum_of_the_expansion_in_float32_too():
    """Large pictures would have other colours than small ones."""
    rng = np.random.default_rng(5)
    wavelength = np.linspace(390, 710, 12)
    factor = rng.lognormal(sigma=0.2, size=(100_001, 12)) * 1e-9
    weight = rng.random((471, 3))
    out = spectrum.integrate(factor, wavelength, weight)
    some = slice(0, None, 9973)
    np.testing.assert_allclose(out[some], spectrum.integrate(factor[some], wavelength, weight), rtol=5e-6)
    np.testing.assert_allclose(spectrum.integrate(factor[0], wavelength, weight[:, 0]), out[0, 0], rtol=5e-6)
    fine = np.arange(400.0, 700.0, 2.0)
    factor = rng.lognormal(sigma=0.2, size=(5, 150))
    expected = spectrum.expand(factor, fine) @ weight
    np.testing.assert_allclose(spectrum.integrate(factor, fine, weight), expected, rtol=1e-12)


@pytest.mark.parametrize("samples", [1, 3, 8, 35, 60])
def test_integrate_by_five_nm_is_the_sum_over_one_nm(samples):
    """The fast integration would have other colours."""
    wavelength = np.linspace(380, 720, samples) if samples > 1 else np.array([550.0])
    factor = (wavelength / 550) ** -4 * np.exp(
        -2 * (wavelength / 550) ** -4 - np.exp(-(((wavelength - 600) / 40) ** 2))
    )
    weight = spectrum.colour_matching_functions() * spectrum.solar_at_visible()[:, None]
    expected = spectrum.expand(factor, wavelength) @ weight
    np.testing.assert_allclose(spectrum.integrate(factor, wavelength, weight), expected, rtol=2e-5)


@pytest.mark.parametrize("name", list(spectrum.OBSERVERS))
def test_observers_are_those_of_colour_science(name):
    """The shipped table, which is read in place of an import of seconds, would change all colours."""
    import colour as science

    functions = science.MSDS_CMFS[spectrum.OBSERVERS[name]]
    np.testing.assert_array_equal(spectrum.VISIBLE_NM, functions.wavelengths)
    np.testing.assert_array_equal(spectrum.colour_matching_functions(name), functions.values)
    white = science.CCS_ILLUMINANTS[spectrum.OBSERVERS[name]]["D65"]
    rgb = spectrum.xyz_to_rgb_matrix(name) @ science.xy_to_XYZ(white)
    np.testing.assert_allclose(rgb, 1.0, atol=1e-4)
