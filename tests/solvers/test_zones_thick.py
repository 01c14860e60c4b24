"""Conservative scattering in thick clouds: solved in tens of steps, and right beside plane-parallel doubling and
adding."""

from dataclasses import replace

import numpy as np
import pytest
from hazy_zones import QUICK
from plane_parallel import Slabs, henyey_greenstein
from thick_media import cloud, slabs

from twilight.base.errors import TwilightWarning
from twilight.solvers import zones

SUN_COSINE = 0.5
SUN_DEG = float(np.degrees(np.arcsin(SUN_COSINE)))
MU, WEIGHT = np.polynomial.legendre.leggauss(16)
MU, WEIGHT = 0.5 * (MU + 1.0), 0.5 * WEIGHT
FOG = {"base_km": 0.0, "top_km": 0.05}


def test_the_plane_parallel_helper_keeps_energy_and_knows_a_published_value():
    """The comparison itself would be wrong."""
    for depth in (1.0, 100.0):
        white = Slabs([(depth, 1.0, henyey_greenstein(0.85))], 1.0, SUN_COSINE)
        np.testing.assert_allclose(white.flux_up, white.flux_down, rtol=1e-8)
        black = Slabs([(depth, 1.0, henyey_greenstein(0.85))], 0.0, SUN_COSINE)
        assert black.flux_up[0] + black.flux_down[-1] == pytest.approx(SUN_COSINE, rel=1e-8)
    # far inside a conservative medium transmission falls as 1 / ((1 - g) depth + 2 x 0.7104)
    thick, thicker = (Slabs([(d, 1.0, np.array([1.0]))], 0.0, SUN_COSINE).flux_down[-1] for d in (50.0, 100.0))
    assert thick / thicker == pytest.approx((100.0 + 2 * 0.7104) / (50.0 + 2 * 0.7104), rel=1e-4)


def _flux_down(field) -> np.ndarray:
    """Diffuse irradiance of the ground over F0."""
    azimuth = (np.arange(6) + 0.5) * 30.0
    sky = field.radiance(SUN_DEG, np.degrees(np.arcsin(MU))[:, None], azimuth)
    return 2.0 * np.pi * (WEIGHT * MU) @ sky.mean(axis=1)


def _check(depths, where):
    field = zones.prepare(cloud(*depths, **where), QUICK, sun_elevations_deg=[SUN_DEG, 60.0])
    assert field.convergence.residual < 1e-3
    assert field.convergence.orders < 60
    truth = [slabs(depth, SUN_COSINE, **where).flux_down[-1] for depth in depths]
    np.testing.assert_allclose(_flux_down(field), truth, rtol=0.02)


def test_thick_conservative_air_is_right_and_solved_in_tens_of_steps():
    """Measured up to 1.6 %, for a cloud of depth 100 over a black ground (the long test)."""
    _check((20.0,), {"ground": 0.0})


@pytest.mark.slow
@pytest.mark.parametrize("where", [FOG, {}, {"ground": 0.0}], ids=["fog over snow", "cloud over snow", "cloud"])
def test_conservative_air_of_every_depth_is_right_and_solved_in_tens_of_steps(where):
    """Clouds would be wrong, or take thousands of orders.  Depths of 20 and 50 have tests of their own."""
    _check((5.0, 100.0), where)


def test_air_thicker_than_was_compared_is_said():
    """Air beyond all comparisons would be solved without a word, or few orders not be followed."""
    two = replace(QUICK, max_orders=2, tolerance=0.0)
    with pytest.warns(TwilightWarning, match="scatters with an optical depth of 17[0-9]"):
        zones.prepare(cloud(200.0), two, sun_elevations_deg=[SUN_DEG, 60.0])
    few = replace(QUICK, max_orders=8)
    with pytest.warns(UserWarning, match="max_orders 8 was not enough"):
        assert zones.prepare(cloud(50.0, **FOG), few, sun_elevations_deg=[SUN_DEG, 60.0]).convergence.orders == 8


@pytest.mark.slow
def test_conservative_fog_over_snow_closely():
    """Light between fog and snow would be lost."""
    field = zones.prepare(cloud(50.0, **FOG), zones.QUALITIES["standard"], sun_elevations_deg=[SUN_DEG, 60.0])
    assert field.convergence.residual < 1e-3
    truth = slabs(50.0, SUN_COSINE, **FOG).flux_down[-1]
    np.testing.assert_allclose(_flux_down(field), truth, rtol=0.02)
