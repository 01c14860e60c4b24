"""Monte-Carlo under a thick white cloud: its importance function, its errors, and when it is not to be trusted.

Truth is plane-parallel doubling and adding.
"""

from dataclasses import replace

import numpy as np
import pytest
from montecarlo_media import slab
from scipy.stats import chi2
from thick_media import cloud, slabs

from twilight.solvers.montecarlo import MonteCarloSettings, prepare
from twilight.solvers.montecarlo.chunks import Tally
from twilight.solvers.montecarlo.events import N_ORDERS
from twilight.solvers.montecarlo.paths import TOTAL

SUN_COSINE = 0.5
SUN_DEG = float(np.degrees(np.arcsin(SUN_COSINE)))
MU, WEIGHT = np.polynomial.legendre.leggauss(3)
MU, WEIGHT = 0.5 * (MU + 1.0), 0.5 * WEIGHT
DEPTH = 16.0
"""Optical depth of the cloud."""
ASYMMETRY = 0.7
"""Of its droplets."""
SETTINGS = MonteCarloSettings(target_stderr=None, samples=320, polarisation=False)


@pytest.fixture(scope="module")
def below():
    return prepare(cloud(DEPTH, asymmetry=ASYMMETRY, ground=0.0), SETTINGS)


def flux_down(field) -> tuple[float, float]:
    """Diffuse irradiance of the ground over F0 and its standard error.

    Under such a cloud radiance does not depend on the azimuth.
    """
    found = field.radiance_with_error(SUN_DEG, np.degrees(np.arcsin(MU)), 90.0)
    weight = 2.0 * np.pi * WEIGHT * MU
    error = np.sqrt(((weight * found.standard_error[:, 0]) ** 2).sum())
    return float(weight @ found.radiance[:, 0]), float(error)


@pytest.fixture(scope="module")
def truth():
    return slabs(DEPTH, SUN_COSINE, asymmetry=ASYMMETRY, ground=0.0).flux_down[-1]


def test_the_importance_function_knows_how_much_light_comes_through(below, truth):
    """Without diffusion it has 40 times too little light, and paths are split for nothing."""
    importance = below.importance
    assert 0.4 < np.interp(SUN_COSINE, importance.cos_sun, np.exp(importance.log_ground[0])) / truth < 2.0
    z = importance.altitude_km
    assert np.diff(z[(z >= 1.0) & (z <= 2.0)]).max() < 0.35


def test_light_through_a_cloud_is_within_its_error(below, truth):
    """Against doubling and adding: fails if light that diffuses is lost on the way."""
    value, error = flux_down(below)
    assert error < 0.08 * truth
    assert abs(value - truth) < 3.0 * error


@pytest.mark.slow
def test_errors_through_a_cloud_are_the_scatter_between_seeds(below, truth):
    """Stated errors are right where a path is scattered hundreds of times."""
    found = np.array([flux_down(replace(below, settings=replace(SETTINGS, seed=s))) for s in range(12)])
    statistic = (((found[:, 0] - truth) / found[:, 1]) ** 2).sum()
    assert 1e-3 < chi2.sf(statistic, found.shape[0]) < 1.0 - 1e-3


def test_air_without_aerosol_needs_no_altitudes_more():
    """Altitudes are added in thick air alone: fails if thin air pays for them."""
    for depth, more in ((1.0, False), (20.0, True)):
        z = prepare(slab(depth, 1.0), replace(SETTINGS, importance_sweeps=0)).importance.altitude_km
        assert (z.size > 20) == more


def tally_of(samples: np.ndarray, control_variate: np.ndarray) -> Tally:
    """One pixel whose arms have these samples: light of paths, and of the control variate."""
    tally = Tally(1, 1, np.ones(1))
    total = samples + control_variate
    tally.count[:] = samples.size
    for column, x in ((0, samples), (TOTAL, total)):
        tally.sums[..., 0, column] = x.sum()
        tally.squares[..., 0, column] = (x**2).sum()
    tally.high[..., 0], tally.high[..., 1] = (total**3).sum(), (total**4).sum()
    assert TOTAL == N_ORDERS
    return tally


def test_an_answer_that_hangs_on_few_paths_or_on_the_control_variate_is_not_trusted():
    """The rule `Tally.unknown`: a few samples or the control variate hold the light."""
    even = np.tile([0.8, 1.2], 50)
    assert not tally_of(even, 0.0 * even).unknown()
    # the paths found a tenth of the light that the importance function expects
    assert tally_of(0.1 * even, 0.9 * np.ones(100)).unknown()
    # one in fifty paths holds all the light: 70 % of error in each arm
    rare = np.where(np.arange(100) % 50 == 0, 1.0, 0.0)
    assert tally_of(rare, 0.0 * rare).unknown()
