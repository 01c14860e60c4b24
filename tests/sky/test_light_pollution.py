"""Light pollution: a given zenith brightness with a published gradient."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from twilight.base.errors import TwilightError
from twilight.config import load
from twilight.numerics import spectrum
from twilight.scene.lights import levels_of
from twilight.scene.scene import resolve
from twilight.sky.night import NightLevels, night_radiance
from twilight.sky.night.world import BORTLE_ZENITH_MAG, artificial_zenith_cd_per_m2, gradient, lamp_spectrum

NM = np.linspace(380.0, 720.0, 12)
CITY = {"night.light_pollution": {"bortle_class": 8}}


def test_world_atlas():
    """A natural zenith has 22.0 mag and 174 ucd m^-2 (Falchi et al. 2016): 0.64, 1.28, 2.56 of it are 111, 223, 445."""
    for ratio, ucd in ((0.64, 111.0), (1.28, 223.0), (2.56, 445.0)):
        total_mag = 22.0 - 2.5 * np.log10(1.0 + ratio)
        assert artificial_zenith_cd_per_m2(total_mag) == pytest.approx(ucd * 1e-6, rel=0.005)
    assert artificial_zenith_cd_per_m2(22.0) == 0.0
    with pytest.raises(TwilightError, match="darker than a natural one"):
        artificial_zenith_cd_per_m2(22.3)


def test_gradient_is_garstangs():
    """1 in the zenith; X = 1.89 at 60 deg from it (0.96 sin^2), 5 at the horizon, 1.06 mag brighter there."""
    assert gradient(90.0) == pytest.approx(1.0)
    assert gradient(30.0) == pytest.approx(1.8898 * 10 ** (-0.4 * 0.172 * 0.8898), rel=1e-4)
    assert 2.5 * np.log10(gradient(0.0)) == pytest.approx(2.5 * np.log10(5.0) - 0.172 * 4.0, abs=1e-9)
    assert gradient(-5.0) == gradient(0.0)
    lamps = lamp_spectrum(spectrum.VISIBLE_NM)
    visible = spectrum.LUMINOUS_EFFICACY_LM_PER_W * spectrum.colour_matching_functions("cie1931_2deg")[:, 1]
    assert_allclose(lamps @ visible, 1.0)


def test_it_is_added_to_the_night():
    """A city's night is the natural one and the lamps', and its classes grow brighter."""
    scene = resolve(load("continental-average", {"wavelengths.list_nm": NM.tolist(), **CITY}))
    where = (scene.medium, np.array([20.0, 90.0]), np.array([0.0, 90.0]))
    levels = levels_of(scene.configuration.night)
    with_lamps, natural = night_radiance(*where, levels), night_radiance(*where, NightLevels())
    lamps = artificial_zenith_cd_per_m2(18.1) * gradient(where[1])[:, None] * lamp_spectrum(NM)
    assert_allclose(with_lamps - natural, np.repeat(lamps[:, None], 2, axis=1), rtol=1e-9)
    assert np.all(np.diff(BORTLE_ZENITH_MAG) < 0)
