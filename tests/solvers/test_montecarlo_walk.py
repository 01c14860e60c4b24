"""Monte-Carlo: what must not move the answer (sampling, stopping, chunks, threads, interruption); what is refused."""

from dataclasses import replace

import numba
import numpy as np
import pytest
from montecarlo_media import assert_all_agree, hazy_earth, slab
from scipy.stats import chi2, norm

from twilight.base.errors import TwilightError, TwilightWarning
from twilight.numerics.phase import PhaseFunction
from twilight.solvers.montecarlo import MonteCarloSettings, prepare

VIEW = (np.array([30.0, -3.0, -5.0]), np.array([20.0, 60.0, 8.0]), np.array([140.0, 90.0, 10.0]))
FIXED = MonteCarloSettings(target_stderr=None, samples=96)
VARIANTS = {
    "default": {},
    "no importance": dict(
        importance_sweeps=0, importance_point_fraction=0.0, importance_direction_fraction=0.0, samples=2000
    ),
    "no roulette": dict(roulette_threshold=0.0, samples=48),
    "much roulette": dict(roulette_threshold=3.0),
    "one path": dict(paths_per_sample=1, samples=500),
    "half by importance": dict(importance_point_fraction=0.5, importance_direction_fraction=0.4, samples=192),
    "all by importance": dict(importance_point_fraction=0.99, importance_direction_fraction=0.99),
    "rough legs": dict(
        first_leg_step_km=60.0, first_leg_step_depth=1.0, later_leg_step_km=200.0, later_leg_step_depth=1.0
    ),
    "fine legs": dict(
        first_leg_step_km=5.0, first_leg_step_depth=0.05, later_leg_step_km=10.0, later_leg_step_depth=0.1, samples=48
    ),
    "rarely checked sun": dict(exact_beam_fraction=0.01),
    "exact sun": dict(exact_beam_fraction=1.0),
    "no control": dict(control_variate=False),
    "one candidate": dict(direction_candidates=1),
    "many candidates": dict(direction_candidates=20, samples=48),
    "few continuations": dict(splitting_rate=0.3),
    "many continuations": dict(splitting_rate=3.0, samples=48),
}

SOME = ("no roulette", "half by importance", "rough legs", "rarely checked sun", "no control", "few continuations")
"""One variant of every part of the sampling."""


@pytest.fixture(scope="module")
def field():
    return prepare(hazy_earth(), FIXED)


def variant(field, **change):
    """The same question with other settings."""
    settings = replace(FIXED, seed=11, **change)
    if settings.importance_sweeps != FIXED.importance_sweeps:
        return prepare(field.medium, settings)
    sun = field.sun._replace(exact_beam_fraction=settings.exact_beam_fraction)
    return replace(field, settings=settings, sun=sun)


@pytest.mark.parametrize(
    ("some", "samples"), [(SOME, 600), pytest.param(tuple(VARIANTS), 1500, marks=pytest.mark.slow)], ids=["some", "all"]
)
def test_answer_is_independent_of_every_sampling_option(field, some, samples):
    """Every option of the sampling changes the noise alone: fails if one of them moves the mean."""
    results = {name: variant(field, **VARIANTS[name]).radiance_with_error(*VIEW) for name in some}
    value = np.array([r.radiance[:, 0] for r in results.values()])
    error = np.array([r.standard_error[:, 0] for r in results.values()])
    # not their weighted mean: samples without importance are skewed, a low mean goes with a low estimate of its error
    truth = variant(field, samples=samples).radiance_with_error(*VIEW)
    z = (value - truth.radiance[:, 0]) / np.hypot(error, truth.standard_error[:, 0])
    statistic = (z**2).sum()
    assert np.all(np.median(error / value, axis=0) < 0.08)
    assert chi2.sf(statistic, z.size) > 1e-3, dict(zip(results, z.round(1).tolist(), strict=True))


def test_stated_error_is_the_scatter_of_repeated_runs(field):
    """Sixty seeds: fails if the standard error is too small or too large."""
    runs = [replace(field, settings=replace(FIXED, seed=s, samples=24)).radiance_with_error(*VIEW) for s in range(60)]
    value = np.array([r.radiance[:, 0] for r in runs])
    stated = np.sqrt(np.mean([r.standard_error[:, 0] ** 2 for r in runs], axis=0))
    scatter = ((value - value.mean(axis=0)) ** 2 / stated**2).sum(axis=0)
    freedom = value.shape[0] - 1
    # too little and too much; the values' kurtosis is 2.4 to 3.8, so that chi-square holds
    for found, n in ((scatter.sum(), scatter.size * freedom), (scatter, freedom)):
        likely = 2 * np.minimum(chi2.sf(found, n), chi2.cdf(found, n))
        assert np.all(likely > 1e-3), (np.sqrt(found / n), likely)


def stopping_bias(field, runs, samples):
    """(mean of many short adaptive runs) / (one long run of a count fixed in advance) - 1, and its standard error."""
    view = (-8.0, 60.0, 90.0)
    settings = MonteCarloSettings(target_stderr=0.05, pilot_samples=4)
    adaptive = np.array([replace(field, settings=replace(settings, seed=s)).radiance(*view)[0] for s in range(runs)])
    fixed = replace(field, settings=replace(FIXED, samples=samples, seed=999)).radiance_with_error(*view)
    error = np.hypot(adaptive.std(ddof=1) / np.sqrt(adaptive.size), fixed.standard_error[0])
    return adaptive.mean() / fixed.radiance[0] - 1, error / fixed.radiance[0]


def test_stopping_on_the_error_does_not_bias(field):
    """Adaptive runs have the mean of fixed ones: fails if an arm sets its own number of samples."""
    bias, error = stopping_bias(field, 400, 6000)
    assert error < 0.006
    assert 2 * norm.sf(abs(bias) / error) > 0.005


@pytest.mark.slow
def test_stopping_on_the_error_does_not_bias_by_a_quarter_of_a_percent(field):
    """The same with ten times the runs, to 0.25 %."""
    bias, error = stopping_bias(field, 4000, 60_000)
    assert error < 0.0016
    assert abs(bias) < 0.0025


def test_target_is_reached(field):
    """The error asked for is the error obtained, in the median to a fifth."""
    settings = MonteCarloSettings(target_stderr=0.03)
    r = replace(field, settings=settings).radiance_with_error(*VIEW)
    relative = r.standard_error / r.radiance
    assert np.all(relative < 0.045) and np.median(relative) < 0.036
    assert r.complete and r.samples.min() >= 2 * settings.pilot_samples


def test_orders_add_up_and_are_cut(field):
    """Orders add up to the radiance, and `max_orders` cuts the series: fails if an order is counted twice or lost."""
    r = field.radiance_with_error(*VIEW)
    # the orders' own sum lacks the control variate, which has the mean 0
    error = np.sqrt((r.order_standard_error**2).sum(axis=0))
    assert_all_agree(r.order_radiance.sum(axis=0), error, r.radiance)
    without = variant(field, control_variate=False).radiance_with_error(*VIEW)
    assert_all_agree(without.radiance, np.hypot(without.standard_error, r.standard_error), r.radiance)
    cut = variant(field, max_orders=2).radiance_with_error(*VIEW)
    error = np.hypot(cut.standard_error, np.sqrt((r.order_standard_error[:2] ** 2).sum(axis=0)))
    assert_all_agree(cut.radiance, error, r.order_radiance[:2].sum(axis=0))
    assert np.all(cut.order_radiance[2:] == 0) and np.all(cut.order_radiance[1] > 0)
    error = np.hypot(cut.order_standard_error[1], r.order_standard_error[1])
    assert_all_agree(cut.order_radiance[1], error, r.order_radiance[1])
    np.testing.assert_allclose(cut.order_radiance[0], r.order_radiance[0], rtol=1e-12)


def test_threads_and_order_of_work_change_nothing(field):
    """Bit for bit with one thread, two threads, batches backwards, and without neighbours."""
    question = (np.linspace(-6, 20, 8), 15.0, 40.0)
    chunked = replace(field, settings=replace(FIXED, chunk_samples=7, samples=63))
    threads = numba.get_num_threads()
    try:
        numba.set_num_threads(1)
        one = chunked.radiance_with_error(*question)
        numba.set_num_threads(min(2, numba.config.NUMBA_NUM_THREADS))
        two = chunked.radiance_with_error(*question)
        backwards = chunked.radiance_with_error(*question, batch_order=lambda n: np.arange(n)[::-1])
    finally:
        numba.set_num_threads(threads)
    for other in (two, backwards):
        np.testing.assert_array_equal(one.radiance, other.radiance)
        np.testing.assert_array_equal(one.order_standard_error, other.order_standard_error)
    # and a pixel does not depend on its neighbours
    alone = chunked.radiance(question[0][5], 15.0, 40.0)
    np.testing.assert_array_equal(alone, one.radiance[5])


def test_time_limit_ends_a_run_with_what_there_is(field):
    """A limit of 0 s would not end, or progress not at 1 with the standard error; light scattered once is known."""
    settings = MonteCarloSettings(target_stderr=1e-4, time_limit_s=0.0)
    with pytest.warns(TwilightWarning, match=r"too few paths find light in \d+ of \d+ .* no value"):
        r = replace(field, settings=settings).radiance_with_error(*VIEW)
    assert not r.complete
    assert np.all(np.isnan(r.radiance)) and np.all(np.isnan(r.standard_error))
    assert np.all(r.order_radiance[0] > 0) and np.all(r.order_standard_error[0] == 0)
    said = []
    replace(field, progress=lambda doing, fraction: said.append((doing, fraction))).radiance(*VIEW)
    assert said[-1][1] == 1.0 and "standard error" in said[-1][0]


@pytest.mark.slow
def test_isotropic_after_first_keeps_single_scattering_and_changes_the_rest():
    """Haber's approximation: fails if it touches light scattered once or leaves the rest as it is."""
    usual = MonteCarloSettings(target_stderr=0.01, refraction=False)
    thin = hazy_earth(ground=0.0)
    view = (10.0, np.array([20.0, 60.0]), np.array([0.0, 120.0]))
    exact = prepare(thin, usual).radiance_with_error(*view)
    haber = prepare(thin, replace(usual, approximation="isotropic_after_first")).radiance_with_error(*view)
    # single scattering differs by the forward peak on the line of sight alone, so it brightens, and not by much
    assert np.all(haber.order_radiance[0] > exact.order_radiance[0])
    assert np.all(haber.order_radiance[0] < 1.2 * exact.order_radiance[0])
    assert np.any(np.abs(haber.radiance / exact.radiance - 1) > 5 * haber.standard_error / haber.radiance)


@pytest.mark.parametrize("target", [0.01, pytest.param(0.005, marks=pytest.mark.slow)])
def test_isotropic_after_first_is_exact_where_scattering_is_isotropic(target):
    """Null effect: with g = 0 the approximation is none."""
    medium = slab(0.5, 0.9, PhaseFunction.henyey_greenstein([0.0]), ground=0.4)
    view = (30.0, np.array([10.0, 50.0]), 0.0)
    settings = MonteCarloSettings(target_stderr=target)
    exact = prepare(medium, settings).radiance_with_error(*view)
    haber = prepare(medium, replace(settings, seed=2, approximation="isotropic_after_first")).radiance_with_error(*view)
    assert_all_agree(haber.radiance, np.hypot(haber.standard_error, exact.standard_error), exact.radiance)


def test_empty_air_is_black():
    """No air, no light, no nan."""
    medium = hazy_earth(ground=0.0)
    nothing = np.zeros_like(medium.air_scattering_per_km)
    empty = replace(medium, air_scattering_per_km=nothing, aerosol_extinction_per_km=nothing, absorption_per_km=nothing)
    r = prepare(empty, FIXED).radiance_with_error(10.0, [-30.0, 30.0], 0.0)
    assert np.all(r.radiance == 0) and np.all(r.standard_error == 0)


def test_bad_questions_are_refused(field):
    """Angles, distances and altitudes out of range are refused by their name."""
    with pytest.raises(TwilightError, match="elevation_deg must be between"):
        field.radiance(10.0, 95.0, 0.0)
    with pytest.raises(TwilightError, match="azimuth_deg must be finite"):
        field.radiance(10.0, 45.0, np.nan)
    with pytest.raises(TwilightError, match=r"observer\.altitude_km is -1; allowed is 0 \(the ground\)"):
        prepare(hazy_earth(), FIXED, observer_altitude_km=-1.0)
