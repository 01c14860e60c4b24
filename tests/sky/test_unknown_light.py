"""Light that a solver with noise does not know: nan in skies, files and sums, and never a number made of it."""

from dataclasses import replace

import numpy as np
import pytest
from montecarlo_media import hazy_earth
from toy_sky import glow_sky

from twilight import solvers
from twilight.base.errors import TwilightError, TwilightWarning
from twilight.engine import solve
from twilight.engine.block import Block
from twilight.io import read_latlong_exr, read_sky, read_spectral_exr, write_rgb_exr, write_sky, write_spectral_exr
from twilight.io.picture import render_view
from twilight.scene import Scene
from twilight.solvers.montecarlo import MonteCarloSettings
from twilight.studies.compare.reference_solution import computed


@pytest.fixture(scope="module")
def gappy():
    """A sky that is not known in a patch at all wavelengths, and in one direction at one of them."""
    sky = glow_sky(step_deg=5.0, ground_albedo=np.full(7, 0.3), direct_irradiance=np.full(7, 0.5))
    radiance = sky.sun_normalised_radiance.copy()
    radiance[4:7, 10:13] = np.nan
    radiance[10, 30, 2] = np.nan
    return replace(sky, sun_normalised_radiance=radiance, standard_error=0.01 * radiance)


def test_a_file_keeps_what_is_not_known(gappy, tmp_path):
    """sky.h5 would hold a number, or be refused."""
    write_sky(gappy, tmp_path / "sky.h5")
    back = read_sky(tmp_path / "sky.h5")
    unknown = np.isnan(gappy.sun_normalised_radiance)
    for values in (back.sun_normalised_radiance, back.standard_error):
        np.testing.assert_array_equal(np.isnan(values), unknown)


def test_samples_and_sums_do_not_know_it_either(gappy):
    """A spline would carry nan over the whole sky, or fill the gap with what looks like an answer."""
    at = gappy.elevation_deg[5], gappy.azimuth_deg[11]
    assert np.isnan(gappy.sample(*at)).all()
    assert np.isfinite(gappy.sample(80.0, at[1])).all()
    assert np.isnan(gappy.irradiance_factor()).all() and np.isnan(gappy.luminance_at(*at))
    again = gappy.resample(gappy.elevation_deg, gappy.azimuth_deg)
    np.testing.assert_array_equal(np.isnan(again.standard_error), np.isnan(gappy.standard_error))


def test_pictures_show_the_nearest_known_direction(gappy, tmp_path):
    """A renderer would spread nan over its whole picture."""
    assert np.isfinite(render_view(gappy, view="panorama", width=64)[0]).all()
    write_rgb_exr(gappy, tmp_path / "rgb.exr", width=32)
    write_spectral_exr(gappy, tmp_path / "spectral.exr", width=32)
    assert np.isfinite(read_latlong_exr(tmp_path / "rgb.exr").rgb).all()
    assert np.isfinite(read_spectral_exr(tmp_path / "spectral.exr")[1]).all()


def test_nan_without_noise_is_refused(gappy):
    """A fault of a solver would pass for light that is not known."""
    with pytest.raises(TwilightError, match="must be finite and not negative"):
        replace(gappy, standard_error=None)
    with pytest.raises(TwilightError, match="must be finite and not negative"):
        replace(gappy, standard_error=np.full(gappy.standard_error.shape, 0.01))
    with pytest.raises(TwilightError, match="standard_error must"):
        known = np.nan_to_num(gappy.sun_normalised_radiance, nan=1.0)
        replace(gappy, sun_normalised_radiance=known)


@pytest.fixture(scope="module")
def hurried():
    """A field of `montecarlo` whose time is up before it begins."""
    solver = solvers.load("montecarlo")
    settings = MonteCarloSettings(time_limit_s=0.0, importance_sweeps=1)
    return solve(Scene(hazy_earth(), None, solver, settings), cached=False)


def test_the_engine_hands_it_on_with_a_warning(hurried):
    """The engine would refuse it, or call it darkness."""
    block: Block = hurried.blocks[0]
    with pytest.warns(TwilightWarning, match="too few paths find light in 6 of 6 .* no value"):
        found = block.texture(-6.0, np.array([10.0, 40.0]), np.array([0.0, 90.0, 180.0]))
    for values in found:
        assert values.shape[2] == 3 and np.isnan(values).all()


@pytest.mark.filterwarnings("ignore::twilight.TwilightWarning")
def test_a_comparison_has_no_reference_of_it(hurried):
    """Errors would be counted from a reference of which nothing is known, as if it had no noise."""
    directions = np.array([10.0, 40.0]), np.array([0.0, 90.0])
    with pytest.raises(TwilightError, match=r"knows no radiance of the sun at -6 deg; raise --time-limit"):
        computed(hurried, -6.0, directions)
