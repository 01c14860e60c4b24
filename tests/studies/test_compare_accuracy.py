"""Errors beside a reference with noise of its own, their picture, the directions that are compared, bad tables."""

import numpy as np
import pytest

from twilight.base.errors import TwilightError
from twilight.studies.compare.accuracy import colour_errors, noise_largest, noise_quantile, radiance_errors
from twilight.studies.compare.job import half_texture, stratified_directions
from twilight.studies.compare.reference_solution import COLUMNS, read_references
from twilight.studies.compare.report import LARGEST_PERCENT, FigurePoint, draw, read_points

NM = (450.0, 550.0, 680.0)


def test_noise_quantiles_are_those_of_the_normal_distribution():
    """Quantiles of noise would be off."""
    same = np.full(50, 0.3)
    assert noise_quantile(same, 0.5) == pytest.approx(0.3 * 0.6744898, rel=1e-6)
    assert noise_quantile(same, 0.95) == pytest.approx(0.3 * 1.9599640, rel=1e-6)
    assert noise_quantile(np.zeros(5), 0.95) == pytest.approx(0.0, abs=1e-12)


def test_noise_of_unequal_deviations_agrees_with_draws():
    """Noise of unequal deviations would be taken for equal."""
    sigma = np.geomspace(0.01, 1.0, 60)
    draws = np.abs(sigma * np.random.default_rng(0).standard_normal((20_000, 60)))
    for fraction in (0.5, 0.95):
        assert noise_quantile(sigma, fraction) == pytest.approx(np.quantile(draws, fraction), rel=0.02)
    assert noise_largest(sigma) == pytest.approx(np.median(draws.max(axis=1)), rel=0.02)


def test_errors_without_noise_are_plain_quantiles():
    """Errors would be no quantiles."""
    reference = np.array([1.0, 2.0, 4.0, 5.0, 0.0])
    errors = radiance_errors(np.array([1.01, 1.96, 4.0, 5.5, 3.0]), reference, np.zeros(5))
    assert errors.median == pytest.approx(1.5)  # of 0, 1, 2 and 10 %; the black direction does not count
    assert errors.largest == pytest.approx(10.0)
    assert errors.mean == pytest.approx((1 - 2 + 0 + 10) / 4)
    assert radiance_errors(np.ones(3), np.zeros(3), np.zeros(3)) is None


@pytest.mark.parametrize("true_percent", (0.0, 0.5, 2.0))
def test_the_noise_of_the_reference_is_taken_out(true_percent):
    """The reference's noise would be taken for a solver's error."""
    rng = np.random.default_rng(3)
    n = 200_000
    value = 1.0 + true_percent / 100.0 * rng.standard_normal(n)
    noisy = 1.0 + 0.01 * rng.standard_normal(n)
    errors = radiance_errors(value, noisy, np.full(n, 0.01))
    assert errors.noise_median == pytest.approx(0.6745, rel=0.02)
    for found, factor in ((errors.median, 0.67449), (errors.p95, 1.95996)):
        # the quadratic difference of two quantiles that are each known to 0.3 %
        assert abs(found**2 - (factor * true_percent) ** 2) < 0.02 * factor**2 * (1 + true_percent**2)


def test_a_change_of_brightness_alone_has_its_closed_form_colour_difference():
    """Colour differences would be in another unit."""
    grey = np.full((5, 8), 0.01)
    nm = np.linspace(380.0, 720.0, 8)
    errors = colour_errors(1.1 * grey, grey, None, nm)
    assert errors.luminance.median == pytest.approx(10.0, rel=1e-6)
    # a spectrum in proportion to the sun's is nearly neutral; its lightness is that of middle grey, and 1.1 times it
    lightness = [116.0 * y ** (1 / 3) - 16.0 for y in (0.18, 0.18 * 1.1)]
    mean = 0.5 * sum(lightness)
    weight = 1.0 + 0.015 * (mean - 50.0) ** 2 / np.sqrt(20.0 + (mean - 50.0) ** 2)
    assert errors.ciede2000.median == pytest.approx((lightness[1] - lightness[0]) / weight, rel=0.05)
    same = colour_errors(grey, grey, None, nm)
    assert same.ciede2000.largest == 0.0 and same.luminance.largest < 1e-9


def test_noise_shows_in_the_colours_and_narrow_spectra_have_none():
    """Noise would be taken for a colour."""
    nm = np.array(NM)
    right = np.full((400, 3), 0.01)
    noisy = right * (1.0 + 0.02 * np.random.default_rng(5).standard_normal(right.shape))
    errors = colour_errors(right, noisy, 0.02 * right, nm)
    assert errors.ciede2000.noise_median > 0.2
    assert errors.ciede2000.median < 0.5 * errors.ciede2000.noise_median
    assert errors.luminance.median < 0.5 * errors.luminance.noise_median
    assert colour_errors(right, right, None, np.array([500.0, 550.0, 590.0])) is None


@pytest.mark.parametrize("count", (24, 48, 240))
def test_directions_are_pixels_spread_over_the_half_texture(count):
    """Some parts of the sky would count more than others."""
    elevation, azimuth = stratified_directions((30, 120), count)
    assert 0.97 * count <= elevation.size <= count
    assert len({*zip(elevation, azimuth, strict=True)}) == elevation.size
    assert np.allclose((elevation - 1.5) % 3.0, 0.0) and np.allclose(azimuth % 3.0, 0.0)
    assert azimuth.min() >= 0.0 and azimuth.max() <= 180.0
    whole = half_texture((30, 120))
    for f in (lambda e, a: np.cos(np.radians(a)), lambda e, a: e / 90.0, lambda e, a: e / 90.0 * np.cos(np.radians(a))):
        assert abs(f(elevation, azimuth).mean() - f(*whole).mean()) < 1.5 / count


def test_many_directions_are_the_half_texture():
    """A direction would count twice."""
    assert stratified_directions((10, 40), 10_000)[0].size == 10 * 21


HEADER = ",".join(COLUMNS)


@pytest.mark.parametrize(
    "text, says",
    (
        ("", "holds no radiances"),
        (HEADER, "holds no radiances"),
        (HEADER.replace("azimuth_deg,", "") + "\n5,10,500,1,0", "lacks the column azimuth_deg"),
        (HEADER + "\n5,10,0,500,nan,0", "radiance_per_sr is 'nan'"),
        (HEADER + "\n5,10,0,500,-1,0", "radiance_per_sr is '-1'"),
        (HEADER + "\n5,10,0,500,1", "line 2: has 5 cells, the header has 6"),
        (HEADER + "\n5,100,0,500,1,0", "elevation_deg is '100'"),
        (HEADER + "\n5,10,0,500,1,0\n5,10,0,500,1,0", "one row for each direction"),
        (HEADER + "\n5,10,0,500,1,0\n5,20,0,600,1,0", "one row for each direction"),
    ),
)
def test_a_bad_table_is_one_sentence(tmp_path, text, says):
    """A gap in a reference would be a wrong error."""
    path = tmp_path / "bad.csv"
    path.write_text(text + "\n")
    with pytest.raises(TwilightError, match=says) as caught:
        read_references(path)
    assert "bad.csv" in str(caught.value)


def test_the_picture_needs_marks_and_holds_errors_of_any_size(tmp_path):
    """An error would fall off the picture."""
    assert not draw([], tmp_path / "none.png") and not (tmp_path / "none.png").exists()
    marks = [
        FigurePoint("a", "draft", 5.0, 0.1, 1e4, 0.2),
        FigurePoint("a", "standard", 5.0, 10.0, 0.0, 0.2),
        FigurePoint("b", "other", -6.0, 1.0, 3.0),
    ]
    assert marks[0].drawn_percent == LARGEST_PERCENT and marks[1].drawn_percent == pytest.approx(0.1)
    assert not marks[1].resolved and marks[2].resolved
    assert draw(marks, tmp_path / "p.png", title="x")
    with pytest.raises(TwilightError, match="not a table"):
        (tmp_path / "t.csv").write_text("a,b\n1,2\n")
        read_points(tmp_path / "t.csv")
