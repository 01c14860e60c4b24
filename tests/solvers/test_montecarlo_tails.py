"""Monte-Carlo, stated errors in media with thin layers far away and with clouds; limits of time."""

import time
from dataclasses import replace

import numpy as np
import pytest
from layered_sky import layered
from montecarlo_media import assert_all_agree, hazy_earth
from scipy.stats import chi2

from twilight.base.errors import TwilightWarning
from twilight.solvers.montecarlo import MonteCarloSettings, prepare

VIEW = (30.0, np.array([90.0, 20.0, 5.0, 1.0]), np.array([0.0, 60.0, 60.0, 60.0]))
FIXED = MonteCarloSettings(target_stderr=None, samples=300)


@pytest.fixture(scope="module")
def far():
    return prepare(layered(50.0, 1.0, 1.0), FIXED)


@pytest.mark.slow
def test_errors_of_a_layer_far_away_are_the_scatter_between_seeds(far):
    """Light of a layer that few paths find: fails if rare bright paths make errors look small."""
    runs = [replace(far, settings=replace(FIXED, seed=s)).radiance_with_error(*VIEW) for s in range(10)]
    value = np.array([r.radiance[:, 0] for r in runs])
    error = np.array([r.standard_error[:, 0] for r in runs])
    assert np.all(error < 0.05 * value)
    weight = error**-2.0
    mean = (weight * value).sum(axis=0) / weight.sum(axis=0)
    statistic = (((value - mean) / error) ** 2).sum()
    freedom = value.size - value.shape[1]
    assert 1e-3 < chi2.sf(statistic, freedom) < 1 - 1e-4
    # sampling without the importance function agrees
    natural = replace(
        FIXED, importance_point_fraction=0.0, importance_direction_fraction=0.0, roulette_threshold=0.0,
        control_variate=False, samples=600,
    )  # fmt: skip
    r = replace(far, settings=natural).radiance_with_error(*VIEW)
    assert_all_agree(r.radiance[:, 0], np.hypot(r.standard_error[:, 0], weight.sum(axis=0) ** -0.5), mean)


def test_a_run_ends_when_the_time_is_up(far):
    """A time limit holds where the target needs hours."""
    settings = replace(FIXED, target_stderr=1e-5, time_limit_s=0.5)
    here = replace(far, settings=settings)
    started = time.process_time()
    r = here.radiance_with_error(*VIEW)
    assert not r.complete
    # samples were still worth hours of time; processor time, because a busy machine stands still in between
    assert time.process_time() - started < 20.0
    assert np.all(r.samples >= 4)


def test_few_samples_are_not_trusted(far):
    """Four samples would be trusted, or ordinary air at five suns at 5 % not."""
    with pytest.warns(TwilightWarning, match="too few paths"):
        r = replace(far, settings=replace(FIXED, samples=4)).radiance_with_error(*VIEW)
    assert np.all(np.isnan(r.radiance))
    field = prepare(hazy_earth(refractivity=0.0), MonteCarloSettings(target_stderr=0.05, polarisation=False))
    for sun in (40.0, 0.0, -6.0, -12.0, -16.0):
        assert np.isfinite(field.radiance(sun, *VIEW[1:])).all(), sun
