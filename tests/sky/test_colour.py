import warnings
from dataclasses import replace

import colour as science
import numpy as np
import pytest
from toy_sky import texture_grid

from twilight.base.errors import TwilightError, TwilightWarning
from twilight.config.scene import Wavelengths
from twilight.io.picture import render_view
from twilight.numerics import spectrum
from twilight.sky import colour
from twilight.sky.sky import Sky


def one_colour_sky(factor, wavelength):
    elevation, azimuth = texture_grid(45.0)
    return Sky(wavelength, elevation, azimuth, np.broadcast_to(factor, (2, 8, len(wavelength))), 10.0)


@pytest.mark.parametrize("observer", list(spectrum.OBSERVERS))
def test_a_spectrum_at_one_nm_has_the_xyz_of_colour_science(observer):
    # The factor is a black body divided by the sun, so that the light is the black body.
    """All colours would be off; black-body light over the sun's as factor."""
    black_body = science.sd_blackbody(5000, science.SpectralShape(360, 830, 1))
    factor = black_body.values / spectrum.solar_at_visible()
    xyz = colour.spectrum_to_xyz(factor, spectrum.VISIBLE_NM, observer=observer)
    cmfs = science.MSDS_CMFS[spectrum.OBSERVERS[observer]]
    reference = science.sd_to_XYZ(black_body, cmfs=cmfs, k=683.002, method="Integration")
    np.testing.assert_allclose(xyz, reference, rtol=1e-9)


@pytest.mark.parametrize("observer", list(spectrum.OBSERVERS))
def test_d65_is_neutral_with_either_observer(observer):
    """White would be tinted."""
    d65 = science.SDS_ILLUMINANTS["D65"]
    light = np.interp(spectrum.VISIBLE_NM, d65.wavelengths, d65.values, right=0.0)
    xyz = light @ spectrum.colour_matching_functions(observer)
    rgb = colour.xyz_to_linear_rgb(xyz / xyz[1], observer)
    np.testing.assert_allclose(rgb, 1.0, atol=3e-4)


def test_rgb_matrix_of_the_two_degree_observer_is_that_of_rec709():
    """Primaries would not be those of displays, or sunlight have another colour."""
    matrix = np.linalg.inv(spectrum.xyz_to_rgb_matrix("cie1931_2deg"))
    np.testing.assert_allclose(matrix[1], colour.REC709_LUMINANCE, atol=1e-8)
    primaries = matrix / matrix.sum(axis=0)
    np.testing.assert_allclose(primaries[:2].T, [[0.64, 0.33], [0.30, 0.60], [0.15, 0.06]], atol=1e-12)
    xyz = colour.spectrum_to_xyz(np.ones(3), np.array([450.0, 550.0, 650.0]), observer="cie1931_2deg")
    np.testing.assert_allclose(xyz[:2] / xyz.sum(), [0.3234, 0.3327], atol=3e-4)


@pytest.mark.parametrize("observer", list(spectrum.OBSERVERS))
def test_luminance_of_the_colours_is_the_luminance_of_the_sky(observer):
    """A picture would be brighter than its sky."""
    wavelength = np.linspace(380, 720, 18)
    sky = one_colour_sky(0.02 * (wavelength / 550) ** -4, wavelength)
    rgb = colour.sky_to_linear_rgb(sky, observer=observer)
    np.testing.assert_allclose(rgb @ colour.REC709_LUMINANCE, sky.luminance(), rtol=1e-9)


@pytest.mark.parametrize(("samples", "limit"), [(8, 2e-3), (16, 1e-3), (35, 1e-4)])
def test_colour_of_coarse_samples_is_near_that_of_one_nm(samples, limit):
    """Few wavelengths would give other colours than documented."""

    def spectrum_of(w):
        band = np.exp(-(((w - 600) / 55) ** 2))
        return (w / 550) ** -4 * np.exp(-1.0 * (w / 550) ** -4 - 0.5 * band)

    wavelength = np.linspace(380, 720, samples)
    coarse = colour.spectrum_to_xyz(spectrum_of(wavelength), wavelength)
    fine = colour.spectrum_to_xyz(spectrum_of(spectrum.VISIBLE_NM), spectrum.VISIBLE_NM)
    assert np.linalg.norm(colour.uv_of_xyz(coarse) - colour.uv_of_xyz(fine)) < limit
    assert coarse[1] == pytest.approx(fine[1], rel=5 * limit)


def test_black_is_black():
    """Black would be NaN, or one wavelength coloured."""
    sky = one_colour_sky(np.zeros(3), np.array([450.0, 550.0, 650.0]))
    rgb = colour.sky_to_linear_rgb(sky)
    assert (rgb == 0).all()
    ev = colour.auto_exposure_ev100(sky.luminance())
    assert np.isfinite(ev)
    for name in colour.TONE_MAPPINGS:
        assert (colour.tone_map(rgb, ev, name) == 0).all()
    sky = one_colour_sky(np.array([0.01]), np.array([550.0]))
    rgb = colour.sky_to_linear_rgb(sky)
    np.testing.assert_allclose(rgb, sky.luminance()[..., None] * np.ones(3), rtol=1e-9)
    assert colour.colour_note(sky).startswith("grey: 550 to 550 nm")
    assert colour.colour_is_defined(np.array([450.0, 550.0, 650.0]))


def test_auto_exposure_follows_the_light_one_to_one_and_ignores_zeros():
    """A film's exposure would not follow its light."""
    rng = np.random.default_rng(2)
    light = rng.lognormal(size=500)
    ev = colour.auto_exposure_ev100(light)
    assert colour.auto_exposure_ev100(light * 2.0**-20) == pytest.approx(ev - 20)
    assert colour.auto_exposure_ev100(np.append(light, np.zeros(300))) == pytest.approx(ev)
    np.testing.assert_allclose(colour.expose(np.ones(3), 3.0), 0.18)  # 1 cd/m^2 is metered at EV100 = 3
    # An evenly lit sky lands at 1.5 times middle grey; one bright spot in a dark sky is held at 24 times.
    flat = colour.expose(np.full(3, 7.0), colour.auto_exposure_ev100(np.full(9, 7.0)))
    np.testing.assert_allclose(flat, 1.5 * colour.MIDDLE_GREY)
    spot = np.append(np.full(99, 1e-6), 1.0)
    held = colour.expose(np.ones(3), colour.auto_exposure_ev100(spot))
    np.testing.assert_allclose(held, 24 * colour.MIDDLE_GREY)


def test_gamut_mapping_keeps_luminance_and_removes_negatives():
    """Renderers would get negative or brighter light."""
    rng = np.random.default_rng(4)
    rgb = rng.normal(size=(1000, 3))
    rgb = rgb[rgb @ colour.REC709_LUMINANCE > 0.01]
    mapped = colour.into_gamut(rgb)
    assert (mapped >= 0).all()
    np.testing.assert_allclose(mapped @ colour.REC709_LUMINANCE, rgb @ colour.REC709_LUMINANCE, rtol=1e-9)
    inside = rgb[(rgb >= 0).all(axis=1)]
    np.testing.assert_array_equal(colour.into_gamut(inside), inside)


def test_tone_curves_rise_and_end_at_white():
    """A brighter sky would be darker on the screen or of another hue, or the sun's disc orange."""
    x = np.geomspace(1e-6, 1e6, 400)
    y = colour.filmic(x[:, None] * np.ones(3))[:, 1]
    assert (np.diff(y) >= 0).all() and y[0] == pytest.approx(x[0], rel=1e-4) and y[-1] == pytest.approx(1.0)
    encoded = colour.srgb_encode(np.linspace(0, 1, 101))
    np.testing.assert_allclose(encoded, science.cctf_encoding(np.linspace(0, 1, 101), "sRGB"), atol=1e-7)
    assert colour.tone_map(np.full(3, 1e30), 0.0).max() == pytest.approx(1.0)
    bright = colour.filmic(np.array([8.0, 4.0, 0.5]))
    assert 1 > bright[0] > bright[1] > bright[2] > 0
    assert colour.filmic(np.zeros((2, 3))).max() == 0
    orange = np.array([1.0, 0.5, 0.2])
    sky, disc = colour.photographic(4.0 * orange), colour.photographic(1000.0 * orange)
    as_before = colour.photographic(6.0 * orange)
    assert sky[2] < 0.75 * sky[0] and as_before[2] < 0.8 * as_before[0]
    assert disc.min() > 0.95 and colour.photographic(np.array([1e3, 100.0, 0.0])).min() > 0.9


def test_unknown_names_are_refused_with_the_choices():
    """A misspelt name would be a KeyError."""
    with pytest.raises(TwilightError, match="filmic, gamma"):
        colour.tone_map(np.ones(3), 0.0, "aces")
    with pytest.raises(TwilightError, match="cie1964_10deg"):
        spectrum.xyz_to_rgb_matrix("cat")
    with pytest.raises(TwilightError, match="cie1964_10deg"):
        spectrum.colour_matching_functions("cat")


@pytest.mark.parametrize(
    ("wavelength", "says"),
    [
        ([450, 550, 650], "the 3 from 450 to 650 nm give wrong ones"),
        ([440, 550, 680], "the 3 from 440 to 680 nm give wrong ones"),
        ([400, 480, 560, 640, 720], "at most 78 nm apart; the 5 from 400 to 720 nm"),
        ([500, 550, 590], "the 3 from 500 to 590 nm give a grey picture"),
        ([550], "550 nm alone gives a grey picture"),
        ([420, 490, 560, 630, 700], None),
        ([300, 420, 490, 560, 630, 700, 1000], None),
        (Wavelengths().wavelength_nm, None),
        (Wavelengths(count=8).wavelength_nm, None),
    ],
)
def test_too_few_wavelengths_for_a_colour_are_said_wherever_one_is_made(wavelength, says):
    """Wrong colours would be shown without a word."""
    sky = one_colour_sky(np.full(len(wavelength), 0.01), np.array(wavelength, float))
    makers = [lambda: colour.sky_to_linear_rgb(replace(sky))]
    tones = ("photographic", "eye", "camera") if says is None or "wrong" in says else ("photographic", "eye")
    makers += [lambda name=name: render_view(sky, width=8, tone_mapping=name) for name in tones]
    for make in makers:
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always")
            make()
        said = {str(one.message) for one in caught if issubclass(one.category, TwilightWarning)}
        assert len(said) == (says is not None) and all(says in sentence for sentence in said), said
        assert all("420, 490, 560, 630 and 700 nm" in sentence for sentence in said)
