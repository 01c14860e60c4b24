"""Monte-Carlo's own word in air drawn at random: its standard errors hold, and where they would not it has no value.

The truth is plane-parallel doubling and adding in slabs, the light of the zenith from below and of the nadir from
above, and a long run of the same solver in odd air (`odd_airs`).
"""

from dataclasses import replace
from functools import cache, partial

import numpy as np
import pytest
from montecarlo_media import assert_all_agree, slab
from odd_airs import drawn
from plane_parallel import Slabs, henyey_greenstein
from stability_media import Air, medium_of

from twilight.base.errors import TwilightWarning
from twilight.numerics.phase import PhaseFunction
from twilight.solvers.montecarlo import MonteCarloSettings, prepare

SETTINGS = MonteCarloSettings(target_stderr=None, samples=256, polarisation=False)
CURVATURE = 2e-3
"""Relative error that is not noise: a planet that is not quite flat, and doubling with few streams."""


def judge(cases, least_known):
    """z-tests of all that is known, (values, errors, truths) together; at least so many must be."""
    value, error, truth = (np.concatenate([np.ravel(part) for part in parts]) for parts in zip(*cases, strict=True))
    known = np.isfinite(value)
    assert np.array_equal(known, np.isfinite(error))
    assert known.sum() >= least_known, f"{known.sum()} of {known.size}"
    known &= (value != 0.0) | (truth != 0.0) | (error != 0.0)  # space above the air has no light at all
    assert_all_agree(value[known], np.hypot(error, CURVATURE * truth)[known], truth[known])


@cache
def drawn_slab(number):
    """(medium, sine of the sun's elevation, radiances of zenith and nadir from below and from above)."""
    rng = np.random.default_rng([3, number])
    depth, asymmetry = np.exp(rng.uniform(np.log(0.1), np.log(20.0))), rng.uniform(0.0, 0.9)
    albedo, ground, sine = rng.choice([1.0, rng.uniform(0.2, 1.0)]), rng.uniform(0.0, 1.0), rng.uniform(0.1, 0.95)
    exact = Slabs([(depth, albedo, henyey_greenstein(asymmetry, 95))], ground, sine, 48)
    vertical = int(np.flatnonzero(exact.cosine == 1.0)[0])
    medium = slab(depth, albedo, PhaseFunction.henyey_greenstein([asymmetry]), ground)
    return medium, sine, (exact.down[-1, vertical], exact.up[0, vertical])


def of_slab(number, prepared):
    """Values, errors and truths of both directions; prepared: makes a field of a medium."""
    medium, sine, truth = drawn_slab(number)
    field = prepared(medium)
    found = [
        replace(field, observer_altitude_km=altitude).radiance_with_error(np.degrees(np.arcsin(sine)), view, 0.0)
        for altitude, view in ((0.0, 90.0), (1.0, -90.0))
    ]
    return [r.radiance[0] for r in found], [r.standard_error[0] for r in found], truth


def hastily(medium, **place):
    """A field whose importance function the time limit cut short."""
    return replace(prepare(medium, replace(SETTINGS, time_limit_s=0.0), **place), settings=SETTINGS)


@pytest.mark.filterwarnings("ignore::twilight.TwilightWarning")
@pytest.mark.parametrize("prepared", [hastily, lambda medium: prepare(medium, SETTINGS)], ids=["hastily", "whole"])
def test_stated_errors_hold_in_slabs(prepared):
    """Where the time limit cut the importance function short, values would be up to 400 standard errors off."""
    judge([of_slab(number, prepared) for number in range(6)], 6)


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::twilight.TwilightWarning")
@pytest.mark.parametrize("settings", [
    *(replace(SETTINGS, samples=samples) for samples in (16, 64, 512)),
    *(replace(SETTINGS, target_stderr=0.05, time_limit_s=seconds) for seconds in (0.05, 0.3, 3.0)),
])  # fmt: skip
def test_stated_errors_hold_in_many_slabs(settings):
    """The same with limits of time, which also cut the importance function short."""
    judge([of_slab(number, partial(prepare, settings=replace(settings, seed=number))) for number in range(20)], 0)


def test_no_value_where_few_paths_find_light():
    """A mean 740 times too small would have an error a thousandth of what it lacks."""
    medium = medium_of(Air(aerosol=20.0, albedo=1.0, asymmetry=0.9), refractivity=0.0)
    field = prepare(medium, replace(SETTINGS, target_stderr=0.01, time_limit_s=0.0))
    with pytest.warns(TwilightWarning, match=r"too few paths find light in 2 of 2 .*no value"):
        found = field.radiance_with_error(15.0, [90.0, 5.0], 0.0)
    assert np.isnan(found.radiance).all() and np.isnan(found.standard_error).all()
    assert np.all(found.order_radiance[0] > 0.0) and np.isnan(found.order_radiance[1:]).all()
    with pytest.warns(TwilightWarning, match="no value"):
        assert np.isnan(field.inscatter(15.0, 5.0, 0.0, 10.0)[0]).all()


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::twilight.TwilightWarning")
@pytest.mark.parametrize("third", range(3))
def test_stated_errors_hold_in_odd_air(third):
    """Brief runs beside long ones, with the importance function and with one that was cut short."""
    cases = []
    for number in range(third, 15, 3):
        air = drawn(number)
        question = air.sun_deg, air.elevation_deg, air.azimuth_deg
        field = prepare(air.medium, SETTINGS, observer_altitude_km=air.altitude_km)
        hasty = hastily(air.medium, observer_altitude_km=air.altitude_km)
        truth = replace(field, settings=replace(SETTINGS, samples=2000, seed=9)).radiance_with_error(*question)
        for brief in (field, hasty):
            r = brief.radiance_with_error(*question)
            cases.append((r.radiance, np.hypot(r.standard_error, truth.standard_error), truth.radiance))
    value, error, truth = (np.concatenate([np.ravel(part) for part in parts]) for parts in zip(*cases, strict=True))
    both = np.isfinite(truth)
    judge([(value[both], error[both], truth[both])], both.sum() // 3)
