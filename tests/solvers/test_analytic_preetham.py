"""Preetham 1999: sunlight, turbidity, sky, and what the solver refuses."""

import warnings
from importlib import resources

import numpy as np
import pytest
import yaml
from airs import as_sky, turbid

from twilight.base.errors import TwilightError
from twilight.numerics import spectrum
from twilight.solvers.analytic import daylight, preetham
from twilight.solvers.analytic.coefficients import (
    angles,
    load_coefficients,
    parse_coefficients,
    perez_ratio,
    shipped_sets,
)
from twilight.solvers.analytic.daylight import daylight_chromaticity, daylight_spectrum, locus_y, turbidity_of
from twilight.solvers.analytic.preetham import PreethamSettings


def test_optical_mass_is_one_overhead_and_38_or_so_at_the_horizon():
    """The relative optical mass would be mistyped."""
    assert daylight.relative_optical_mass(0.0) == pytest.approx(1.0, abs=1e-3)
    assert daylight.relative_optical_mass(60.0) == pytest.approx(2.0, abs=0.01)
    assert 36.0 < daylight.relative_optical_mass(90.0) < 39.0
    with pytest.raises(TwilightError, match="0 to 90"):
        daylight.relative_optical_mass(91.0)


@pytest.mark.parametrize("turbidity", [2.0, 3.0, 4.0, 5.0, 6.0])
def test_angstroms_beta_keeps_the_definition_of_turbidity(turbidity):
    """(tau_air + tau_aerosol) / tau_air at 550 nm is the turbidity."""
    depth = {k: -np.log(v[0]) for k, v in daylight.transmittances([550.0], 0.0, turbidity).items()}
    assert (depth["air"] + depth["aerosol"]) / depth["air"] == pytest.approx(turbidity, rel=0.01)


def test_sunlight_is_dimmed_by_each_constituent_and_reddened_by_the_path():
    """A constituent would not dim the sunlight."""
    wavelength = np.arange(380.0, 781.0, 10.0)
    parts = daylight.transmittances(wavelength, 60.0, 3.0)
    assert set(parts) == {"air", "aerosol", "ozone", "mixed_gases", "water"}
    assert all(((v > 0) & (v <= 1)).all() and v.min() < 1 for v in parts.values())
    product = daylight.direct_transmittance(wavelength, 60.0, 3.0)
    np.testing.assert_allclose(product, np.prod(list(parts.values()), axis=0))
    low = daylight.direct_transmittance(wavelength, 85.0, 3.0)
    assert (low < product).all() and low[0] / product[0] < low[-10] / product[-10]
    none = daylight.transmittances(wavelength, 60.0, 3.0, ozone_cm=0.0, precipitable_water_cm=0.0)
    assert (none["ozone"] == 1).all() and (none["water"] == 1).all()


def test_daylight_spectra_have_the_chromaticity_they_were_made_from():
    """A daylight spectrum would not have the chromaticity that it was made for."""
    functions = spectrum.colour_matching_functions("cie1931_2deg")
    nodes = np.arange(300.0, 831.0, 10.0)
    for x, y in [(0.25, 0.26), (0.3127, 0.329), (0.36, 0.36), (0.24, 0.25)]:
        at_1_nm = np.interp(spectrum.VISIBLE_NM, nodes, daylight_spectrum(x, y))
        xyz = at_1_nm @ functions
        assert xyz[:2] / xyz.sum() == pytest.approx([x, y], abs=1.5e-3)
        assert spectrum.LUMINOUS_EFFICACY_LM_PER_W * xyz[1] == pytest.approx(1.0, rel=1e-6)


def test_daylight_of_6504_k_is_d65():
    """The daylight locus would be off."""
    assert daylight_chromaticity(6504.0) == pytest.approx((0.3127, 0.3290), abs=2e-4)


def test_angles_near_and_far_from_the_sun():
    """The angle to the sun would lose its digits beside it."""
    cosine, gamma = angles(30.0, np.array([30.0, 30.0 + 1e-6, 90.0, 30.0]), np.array([0.0, 0.0, 0.0, 180.0]))
    np.testing.assert_allclose(cosine, [0.5, 0.5, 1.0, 0.5], atol=1e-7)
    np.testing.assert_allclose(np.degrees(gamma), [0.0, 1e-6, 60.0, 120.0], rtol=1e-6, atol=1e-12)


@pytest.mark.parametrize("turbidity", [2.0, 3.0, 4.0, 5.0, 6.0])
def test_the_papers_coefficients_keep_the_limits_that_decide_their_signs(turbidity):
    """A coefficient of the paper would be mistyped."""
    own = load_coefficients("preetham1999")
    sun_zenith = np.linspace(0.0, 85.0, 18)
    x, y = own.zenith_chromaticity(sun_zenith, turbidity)
    assert np.abs(y - locus_y(x)).max() < 0.015
    assert (x > 0.23).all() and (x < 0.30).all()
    e, a = np.meshgrid(np.linspace(0.0, 90.0, 31), np.linspace(0.0, 180.0, 37), indexing="ij")
    for zenith in sun_zenith:
        luminance, x, y = own.sky(turbidity, 90.0 - zenith, e, a)
        assert luminance.min() > 1000.0 and luminance.max() < 80000.0
        assert 0.22 < x.min() and x.max() < 0.47 and 0.22 < y.min() and y.max() < 0.49
        # brightest beside the sun or at the horizon below it; the zenith of a low sun is darker than the sun's side
        assert a[np.unravel_index(np.argmax(luminance), e.shape)] == 0.0 or zenith < 1.0


def test_one_wrong_sign_is_noticed():
    """Each coefficient's sign matters: the opposite one breaks positivity, the locus, or moves the sky visibly."""
    own = load_coefficients("preetham1999")
    e, a = np.meshgrid(np.linspace(1.0, 90.0, 12), np.linspace(0.0, 180.0, 13), indexing="ij")
    for quantity, polynomials in own.distribution.items():
        right = own.sky(4.0, 30.0, e, a)[["luminance", "x", "y"].index(quantity)]
        for i, polynomial in enumerate(polynomials):
            for j in range(len(polynomial)):
                parameters = own.parameters(quantity, 4.0)
                parameters[i] -= 2 * polynomial[j] * 4.0 ** (len(polynomial) - 1 - j)
                cosine, gamma = angles(30.0, e, a)
                with np.errstate(over="ignore", invalid="ignore"):
                    ratio = perez_ratio(parameters, np.radians(60.0), cosine, gamma)
                zenith = right[-1, 0]
                moved = np.abs(ratio * zenith / right - 1.0).max()
                assert not moved < 5e-4


def test_turbidity_of_a_medium():
    """A medium would be given another turbidity than it has."""
    assert turbidity_of(turbid(1.0)) == 1.0
    for medium in (turbid(3.0), turbid(3.0, np.array([450.0])), turbid(3.0, np.array([600.0, 700.0]))):
        assert turbidity_of(medium) == pytest.approx(3.0, rel=1e-3)


def test_the_solver_gives_the_luminance_and_chromaticity_of_the_formula():
    """Spectra of the solver would not have the formula's luminance and chromaticity."""
    field = preetham.prepare(turbid(3.0))
    sky = as_sky(field, 35.0)
    luminance, x, y = field.coefficients.sky(field.turbidity, 35.0, sky.elevation_deg[:, None], sky.azimuth_deg)
    assert sky.luminance() / luminance == pytest.approx(1.0, abs=0.02)
    weight = spectrum.colour_matching_functions("cie1931_2deg") * spectrum.solar_at_visible()[:, None]
    xyz = spectrum.integrate(sky.sun_normalised_radiance, sky.wavelength_nm, weight)
    total = xyz.sum(axis=-1)
    assert xyz[..., 0] / total == pytest.approx(x, abs=0.006)
    assert xyz[..., 1] / total == pytest.approx(y, abs=0.006)


def test_bins_make_the_same_sky_at_any_sampling():
    """The sky would depend on the wavelengths asked for."""
    coarse = as_sky(preetham.prepare(turbid(3.0, np.linspace(380.0, 720.0, 8))), 35.0).luminance()
    fine = as_sky(preetham.prepare(turbid(3.0, np.arange(380.0, 741.0, 2.0))), 35.0).luminance()
    assert coarse / fine == pytest.approx(1.0, abs=0.02)


@pytest.mark.parametrize("sun", [0.0, 1.0, 5.0, 45.0, 89.9, 90.0])
@pytest.mark.parametrize("turbidity", [2.0, 6.0])
def test_every_direction_is_finite_and_not_negative(sun, turbidity):
    """Some direction, sun or turbidity would be infinite, negative or not mirrored."""
    settings = PreethamSettings(turbidity=turbidity)
    field = preetham.prepare(turbid(3.0, np.arange(300.0, 831.0, 10.0)), settings)
    elevation = np.array([-90.0, -10.0, -1e-9, 0.0, 1e-9, 0.01, sun, min(sun + 1e-7, 90.0), 90.0])[:, None]
    radiance = field.radiance(sun, elevation, np.array([0.0, 1e-8, 90.0, 180.0, 360.0]))
    assert radiance.shape == (9, 5, 54)
    assert np.isfinite(radiance).all() and (radiance >= 0).all()
    assert (radiance.sum(axis=-1) > 0).all()
    np.testing.assert_allclose(radiance[:, 0], radiance[:, 4], rtol=1e-9)


def test_below_the_horizon_is_the_ground_under_this_sky():
    """The ground would not reflect the light of this sky and sun."""
    field = preetham.prepare(turbid(3.0, albedo=0.5))
    ground = field.radiance(35.0, -20.0, 10.0)
    sky = as_sky(field, 35.0)
    irradiance = sky.irradiance_factor() + field.sunlight(35.0) * np.sin(np.radians(35.0))
    assert ground == pytest.approx(0.5 / np.pi * irradiance, rel=0.01)
    assert not preetham.prepare(turbid(3.0, albedo=0.0)).radiance(35.0, -20.0, 10.0).any()


def test_a_set_turbidity_takes_the_place_of_the_mediums():
    """The option `turbidity` would do nothing."""
    field, hazy = preetham.prepare(turbid(3.0), PreethamSettings(turbidity=5.0)), preetham.prepare(turbid(5.0))
    np.testing.assert_allclose(field.radiance(20.0, 40.0, 50.0), hazy.radiance(20.0, 40.0, 50.0), rtol=2e-3)
    assert field.turbidity == 5.0 and field.medium_turbidity is None


def test_air_clearer_than_the_model_takes_its_clearest_sky_and_says_so():
    """Air outside the fit would be extrapolated in silence."""
    with pytest.warns(UserWarning, match="turbidity of test-air is 1; the preetham solver takes 2"):
        field = preetham.prepare(turbid(1.0))
    assert (field.turbidity, field.medium_turbidity) == (2.0, 1.0)
    with pytest.warns(UserWarning, match="takes 100"):
        preetham.prepare(turbid(120.0))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        preetham.prepare(turbid(4.0))


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: preetham.prepare(turbid()).radiance(float("nan"), 10.0, 0.0), "sun.elevation_deg is nan"),
        (
            lambda: preetham.prepare(turbid(), observer_altitude_km=400.0),
            "observer.altitude_km is 400, allowed is 0 to 1",
        ),
        (lambda: preetham.prepare(turbid()).inscatter(20.0, -30.0, 0.0, 1.0), "ends below it"),
    ],
)
def test_what_cannot_be_done_is_one_sentence(make, words):
    """What the formula does not have would not be refused in one sentence."""
    with pytest.raises(TwilightError, match=words) as caught:
        make()
    assert "\n" not in str(caught.value)


def changed(*path, value):
    """The file of the paper's set with another value of a key, or for None without the key."""
    file = resources.files("twilight").joinpath("data/analytic/perez_preetham1999.yaml")
    inner = data = yaml.safe_load(file.read_text(encoding="utf-8"))
    for part in path[:-1]:
        inner = inner[part]
    inner[path[-1]] = value
    if value is None:
        del inner[path[-1]]
    return data


def test_a_file_of_coefficients_is_used(tmp_path):
    """A user's coefficients would be ignored."""
    path = tmp_path / "set.yaml"
    path.write_text(yaml.safe_dump(changed("sun_zenith_deg", value=[0, 80])), encoding="utf-8")
    field, own = preetham.prepare(turbid(), PreethamSettings(coefficients=str(path))), preetham.prepare(turbid())
    np.testing.assert_array_equal(field.radiance(20.0, 40.0, 50.0), own.radiance(20.0, 40.0, 50.0))
    with pytest.raises(TwilightError, match="allowed is 10 to 90"):
        field.radiance(5.0, 40.0, 50.0)


@pytest.mark.parametrize("name", shipped_sets())
def test_every_set_that_is_shipped_is_used(name):
    """The solver would take another set than the one that is named: the sky's luminance is that of its formula."""
    own = load_coefficients(name)
    field = preetham.prepare(turbid(3.0), PreethamSettings(coefficients=name))
    for sun in (90.0 - own.sun_zenith_deg[1], 30.0, 90.0):
        sky = as_sky(field, sun)
        luminance, _, _ = own.sky(field.turbidity, sun, sky.elevation_deg[:, None], sky.azimuth_deg)
        np.testing.assert_allclose(sky.luminance(), luminance, rtol=5e-3)


def test_the_refitted_set_is_darker_than_the_papers_and_goes_the_same_way():
    """Preetham's luminances are known to be high; both fall with the sun and rise with the turbidity."""
    own, refit = load_coefficients("preetham1999"), load_coefficients("continental-average")
    zenith = np.linspace(30.0, 80.0, 6)
    for turbidity in (2.0, 4.0, 6.0):
        paper, again = (s.zenith_luminance_cd_per_m2(zenith, turbidity) for s in (own, refit))
        assert (again < paper).all() and (again > 0.2 * paper).all()
        assert (np.diff(again) < 0).all()
    assert (refit.zenith_luminance_cd_per_m2(zenith, 5.0) > refit.zenith_luminance_cd_per_m2(zenith, 2.0)).all()


@pytest.mark.parametrize(
    ("document", "words"),
    [
        (changed("version", value=2), "version must be 1"),
        (changed("turbidity", value=[6, 2]), "turbidity must be two numbers"),
        (changed("x", "distribution", "C", value=None), "x.distribution.C is missing"),
        (changed("y", "zenith", value=[[1.0]]), r"y.zenith\[1\] is missing"),
        (changed("luminance", "distribution", "A", value=["a"]), r"distribution.A\[0\] must be a number"),
        (changed("luminance", "distribution", "B", value=[0.5]), "luminance.distribution.B is 0.5"),
        (changed("luminance", "distribution", "A", value=[-3.0]), "a luminance that is not positive"),
        (changed("x", "zenith", value=[[5.0] for _ in range(4)]), "a chromaticity outside 0 to 1"),
    ],
)
def test_a_broken_set_is_refused(document, words):
    """Coefficients that give an impossible sky would be used."""
    with pytest.raises(TwilightError, match="here: .*" + words):
        parse_coefficients(yaml.safe_dump(document), "here")


def test_a_turbid_sky_goes_over_to_the_overcast_one():
    """Between turbidity 6 and 10 the sky would stop at 6, or jump to the overcast sky (sec. 5)."""
    where = 40.0, np.array([5.0, 45.0, 90.0]), np.array([0.0, 90.0, 0.0])

    def sky(turbidity):
        field = preetham.prepare(turbid(3.0), PreethamSettings(turbidity=turbidity))
        return field.radiance(*where), field.sunlight(40.0)

    clear, half, grey = (sky(t) for t in (6.0, 8.0, 30.0))
    np.testing.assert_allclose(half[0], 0.5 * (clear[0] + grey[0]), rtol=1e-12)
    expected = (1.0 + 2.0 * np.sin(np.radians(where[1]))) / 3.0
    np.testing.assert_allclose(grey[0] / grey[0][2], np.broadcast_to(expected[:, None], grey[0].shape), rtol=1e-12)
    assert np.all(grey[1] == 0.0) and np.all(half[1] > 0.0)
