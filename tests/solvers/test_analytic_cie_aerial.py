"""The CIE standard skies, and aerial perspective against quadrature and limits."""

from itertools import pairwise

import numpy as np
import pytest
from airs import as_sky, turbid
from scipy.integrate import quad

from twilight.base.errors import TwilightError
from twilight.solvers.analytic import aerial, cie, preetham
from twilight.solvers.analytic.aerial import aerial_perspective, path_integrals
from twilight.solvers.analytic.cie import CieSettings
from twilight.solvers.analytic.coefficients import angles
from twilight.solvers.analytic.daylight import hemisphere


def test_type_12_is_the_clear_sky_that_the_paper_quotes():
    """Preetham 1999 eq. 1, Kittler's clear sky."""
    field = cie.prepare(turbid(), CieSettings(sky_type=12))
    e, a = np.meshgrid(np.linspace(0.5, 90.0, 20), np.linspace(0.0, 180.0, 19), indexing="ij")
    cosine, gamma = angles(40.0, e, a)
    sun_zenith = np.radians(50.0)

    def indicatrix(angle):
        return 0.91 + 10.0 * np.exp(-3.0 * angle) + 0.45 * np.cos(angle) ** 2

    quoted = indicatrix(gamma) * (1 - np.exp(-0.32 / cosine)) / (indicatrix(sun_zenith) * (1 - np.exp(-0.32)))
    np.testing.assert_allclose(field.relative_luminance(40.0, e, a), quoted, rtol=3e-4)


def test_overcast_skies():
    """The uniform and the traditional overcast sky would not have the distribution and illuminance of the standard."""
    e = np.linspace(0.0, 90.0, 10)
    uniform = cie.prepare(turbid(), CieSettings(sky_type=5)).relative_luminance(30.0, e, 0.0)
    np.testing.assert_allclose(uniform, 1.0)
    traditional = cie.prepare(turbid(), CieSettings(sky_type=16))
    np.testing.assert_allclose(traditional.relative_luminance(30.0, e, 77.0), (1 + 2 * np.sin(np.radians(e))) / 3)
    # Moon and Spencer's sky lights a plane with 7 pi / 9 times its zenith
    expected = 9.0 / (7.0 * np.pi) * (300.0 + 21000.0 * 0.5)
    assert traditional.zenith_luminance(30.0) == pytest.approx(expected, rel=1e-6)
    assert as_sky(traditional, 30.0).illuminance_lux() == pytest.approx(10800.0, rel=0.02)
    steep = cie.prepare(turbid(), CieSettings(sky_type=1)).relative_luminance(30.0, np.array([0.0, 90.0]), 0.0)
    assert steep[0] / steep[1] == pytest.approx(1.0 / 3.0, rel=0.01)


@pytest.mark.parametrize("sky_type", range(1, 17))
def test_every_type_is_finite_and_positive(sky_type):
    """A standard sky would be infinite or negative somewhere."""
    field = cie.prepare(turbid(), CieSettings(sky_type=sky_type))
    for sun in (0.0, 10.0, 60.0, 90.0):
        radiance = field.radiance(sun, np.array([-90.0, -1.0, 0.0, 1e-9, sun, 90.0])[:, None], np.array([0.0, 180.0]))
        assert np.isfinite(radiance).all() and (radiance > 0).all()
        assert field.relative_luminance(sun, 90.0, 0.0) == pytest.approx(1.0)


def test_zenith_luminance_can_be_set():
    """It would do nothing."""
    settings = CieSettings(sky_type=14, zenith_luminance_cd_per_m2=1234.0)
    field = cie.prepare(turbid(), settings)
    sky = as_sky(field, 50.0)
    zenith = sky.resample([85.0, 90.0], [0.0, 180.0]).luminance()[1, 0]
    assert zenith == pytest.approx(1234.0, rel=0.05)
    assert field.zenith_luminance(50.0) == 1234.0
    clear = cie.prepare(turbid(3.0))
    expected = preetham.prepare(turbid(3.0)).coefficients.zenith_luminance_cd_per_m2(40.0, 3.0)
    assert clear.zenith_luminance(50.0) == pytest.approx(expected, rel=2e-3)


def test_a_spectrum_has_the_luminance_of_its_sky():
    """What is drawn and what is written would be of two brightnesses."""
    sky = as_sky(cie.prepare(turbid(), CieSettings(sky_type=16)), 50.0)
    daylight = cie.prepare(turbid(), CieSettings(sky_type=16)).luminance(50.0, sky.elevation_deg[3], 40.0)
    assert sky.luminance()[3, 4] == pytest.approx(daylight, rel=0.01)


THREE_NM = np.array([380.0, 550.0, 720.0])
RAYS = [
    (0.0, 0.0, 1.0), (0.0, 0.0, 100.0), (0.0, 1e-7, 50.0), (0.0, 0.02, 100.0), (1.0, -0.05, 20.0),
    (2.0, -0.02, 100.0), (1.0, -1.0, 1.0), (0.0, 0.1, 20.0), (0.0, 0.3, 10.0), (0.0, 1.0, 0.01), (0.0, 1.0, 10.0),
]  # fmt: skip


@pytest.mark.parametrize("turbidity", [2.0, 6.0])
@pytest.mark.parametrize(("height", "cosine", "distance"), RAYS)
def test_closed_form_against_quadrature(turbidity, height, cosine, distance):
    """The closed form of aerial perspective would be off the integral that it stands for."""
    haze = aerial.haze_scattering_per_km(THREE_NM, turbidity)
    clean = aerial.air_scattering_per_km(THREE_NM)
    made = path_integrals(haze, clean, height, [cosine], [distance])

    def column(decay, x):
        a = decay * cosine * x
        return np.exp(-decay * height) * x * (1.0 if abs(a) < 1e-9 else -np.expm1(-a) / a)

    pairs = ((aerial.HAZE_DECAY_PER_KM, made.haze[0]), (aerial.AIR_DECAY_PER_KM, made.air[0]))

    def depths(j, x):
        return haze[j] * column(aerial.HAZE_DECAY_PER_KM, x), clean[j] * column(aerial.AIR_DECAY_PER_KM, x)

    for j in range(3):
        assert (made.haze_depth[0, j], made.air_depth[0, j]) == pytest.approx(depths(j, distance), rel=1e-10)
        for decay, value in pairs:

            def integrand(x, j=j, decay=decay):
                return np.exp(-decay * (height + x * cosine) - sum(depths(j, x)))

            edges = np.linspace(0.0, distance, 9)
            exact = sum(quad(integrand, p, q, epsrel=1e-9)[0] for p, q in pairwise(edges))
            assert value[j] == pytest.approx(exact, rel=4e-3)


def test_scattering_coefficients_keep_the_definition_of_turbidity():
    """Optical depths of haze over air at 550 nm: T - 1, within what the paper's rounded index makes of it (16 %)."""
    for turbidity in (2.0, 4.0, 6.0):
        haze = aerial.haze_scattering_per_km(550.0, turbidity) / aerial.HAZE_DECAY_PER_KM
        clean = aerial.air_scattering_per_km(550.0) / aerial.AIR_DECAY_PER_KM
        assert haze / clean == pytest.approx(turbidity - 1.0, rel=0.22)
        assert clean == pytest.approx(0.098 * (3.0 / 2.78) ** 2, rel=0.06)


def test_phase_functions_integrate_to_one():
    """Scattering in the aerial perspective would not conserve energy."""
    mu, weight = np.polynomial.legendre.leggauss(400)
    haze = aerial.haze_phase(np.arccos(mu), THREE_NM)
    assert 2 * np.pi * weight @ haze == pytest.approx(1.0, abs=2e-3)
    assert 2 * np.pi * weight @ aerial.air_phase(np.arccos(mu)) == pytest.approx(1.0, abs=1e-9)
    # the table itself, at one of its nodes: eta / (2 pi K)
    node = aerial.haze_phase(np.radians(90.0), np.array([550.0]))
    assert node == pytest.approx(0.1320 / (2 * np.pi * 0.677739), rel=3e-3)


def test_a_uniform_sky_over_level_ground_fills_half_of_what_the_air_takes():
    """Level ray, no haze, no sun: air sees the upper half of all directions, so Lin = (1 - tau) / 2."""
    sky = lambda e, a: np.ones((e.size, 3))  # noqa: E731
    where = 40.0, 0.0, 0.0, np.array([0.0, 90.0]), 30.0
    light, transmittance = aerial_perspective(THREE_NM, 0.0, sky, np.zeros(3), *where)
    np.testing.assert_allclose(light, 0.5 * (1 - transmittance), rtol=1e-6)


def test_perspective_of_the_solver():
    """Distant objects would not fade into haze, sooner in blue."""
    field = preetham.prepare(turbid(3.0))
    distance = np.array([0.0, 0.001, 1.0, 10.0, 50.0])
    light, transmittance = field.inscatter(20.0, 0.0, 90.0, distance)
    assert transmittance.shape == light.shape == (5, field.medium.n_wavelengths)
    assert (transmittance[0] == 1).all() and (light[0] == 0).all()
    assert (np.diff(transmittance, axis=0) < 0).all() and (np.diff(light, axis=0) > 0).all()
    # the blue goes first, and what comes in instead is bluer near than far
    assert (np.diff(transmittance[3]) > 0).all()
    assert light[2, 0] / light[2, -1] > light[4, 0] / light[4, -1]
    # towards the sun the haze glows
    glow = field.inscatter(20.0, 0.0, 0.0, 5.0)[0]
    assert (glow > 2 * field.inscatter(20.0, 0.0, 120.0, 5.0)[0]).all()
    with pytest.raises(TwilightError, match="distance_km must be finite"):
        field.inscatter(20.0, 0.0, 0.0, -1.0)


def test_quadrature_of_the_hemisphere():
    """Irradiances of skies would be off."""
    elevation, _, solid = hemisphere()
    sine = np.sin(np.radians(elevation))
    assert solid.sum() == pytest.approx(2 * np.pi)
    assert solid @ sine == pytest.approx(np.pi)
    assert solid @ sine**4 == pytest.approx(2 * np.pi / 5)
