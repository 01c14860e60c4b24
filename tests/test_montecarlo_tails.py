"""Monte-Carlo, stated errors in media with thin layers far away and with clouds; limits of time."""

import time
from dataclasses import replace

import numpy as np
import pytest
from montecarlo_media import assert_all_agree, hazy_earth, slab
from scipy.stats import chi2

from twilight.numerics.phase import PhaseFunction
from twilight.solvers.montecarlo import MonteCarloSettings, prepare

VIEW = (30.0, np.array([90.0, 20.0, 5.0, 1.0]), np.array([0.0, 60.0, 60.0, 60.0]))
FIXED = MonteCarloSettings(target_stderr=None, samples=300)


def layered(bottom_km, depth, thickness_km=1.0, ground=0.0):
    """Air of scale height 8 km with one white layer, g = 0.7, of sharp edges."""
    top = bottom_km + thickness_km
    regular = [
        z for z in (0.0, 5.0, 10.0, 15.0, 20.0, 25.0, 30.0, 40.0, 60.0, 80.0, 100.0) if not bottom_km <= z <= top
    ]
    z = np.sort([*regular, bottom_km, bottom_km, top, top])
    inside = np.zeros((z.size, 1))
    k = int(np.searchsorted(z, bottom_km, side="right")) - 1
    inside[k : k + 2] = depth / thickness_km
    one = np.ones((z.size, 1))
    return replace(
        slab(1.0, 1.0),
        altitude_km=z,
        air_scattering_per_km=0.0121 * np.exp(-z / 8.0)[:, None],
        absorption_per_km=0.0 * one,
        aerosol_extinction_per_km=inside,
        aerosol_single_scattering_albedo=one,
        aerosol_phase_fraction=one[None],
        phase_functions=(PhaseFunction.henyey_greenstein([0.7]),),
        refractivity=0.0 * one,
        ground_albedo=np.array([ground]),
        earth_radius_km=6371.0,
    )


@pytest.fixture(scope="module")
def far():
    return prepare(layered(50.0, 1.0), FIXED)


def test_errors_of_a_layer_far_away_are_the_scatter_between_seeds(far):
    """Light of a layer that few paths find: fails if rare bright paths make errors look small."""
    runs = [replace(far, settings=replace(FIXED, seed=s)).radiance_with_error(*VIEW) for s in range(10)]
    value = np.array([r.radiance[:, 0] for r in runs])
    error = np.array([r.standard_error[:, 0] for r in runs])
    assert np.all(error < 0.05 * value)
    assert not np.any([r.untrusted for r in runs])
    weight = error**-2.0
    mean = (weight * value).sum(axis=0) / weight.sum(axis=0)
    statistic = (((value - mean) / error) ** 2).sum()
    freedom = value.size - value.shape[1]
    assert 1e-3 < chi2.sf(statistic, freedom) < 1 - 1e-4
    # sampling without the importance function agrees
    natural = replace(
        FIXED,
        importance_point_fraction=0.0,
        importance_direction_fraction=0.0,
        roulette_threshold=0.0,
        control_variate=False,
        samples=600,
    )
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
    assert np.all(r.samples >= 4) and np.all(r.radiance > 0)


def test_few_samples_are_not_trusted(far):
    """Four samples say nothing of their error, and the result says so."""
    r = replace(far, settings=replace(FIXED, samples=4)).radiance_with_error(*VIEW)
    assert np.all(r.untrusted)


def test_ordinary_air_raises_no_alarm():
    """Five suns from day to the end of twilight at 5 %: every radiance is trusted."""
    field = prepare(hazy_earth(refractivity=0.0), MonteCarloSettings(target_stderr=0.05, polarisation=False))
    for sun in (40.0, 0.0, -6.0, -12.0, -16.0):
        assert not field.radiance_with_error(sun, *VIEW[1:]).untrusted.any(), sun
