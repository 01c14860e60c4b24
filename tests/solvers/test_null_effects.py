"""What is there in name only changes no light, bit for bit: once for all solvers that know the thing."""

from dataclasses import replace

import numpy as np
import pytest
from hazy_zones import QUICK

from twilight.atmosphere.screen import Screen
from twilight.config import load_climate
from twilight.scene.medium import climate_medium
from twilight.solvers import compact, montecarlo, tables, zones

ZONES = replace(
    QUICK, altitude_density=0.3, zenith_density=0.4, polar_directions=4, late_polar_directions=4,
    line_of_sight_density=0.6, max_orders=3,
)  # fmt: skip
TABLES = replace(
    tables.QUALITIES["bruneton2017"], step_density=0.7, scattering_r=8, scattering_mu=8, scattering_mu_s=6,
    scattering_nu=3, max_orders=2, lowest_sun_deg=-12.0,
)  # fmt: skip
MONTECARLO = replace(montecarlo.QUALITIES["standard"], target_stderr=None, samples=8, max_orders=2, importance_sweeps=0)
SOLVERS = {"zones": (zones, ZONES), "tables": (tables, TABLES), "montecarlo": (montecarlo, MONTECARLO),
           "compact": (compact, compact.QUALITIES["standard"])}  # fmt: skip
SUNS_DEG = (20.0, 0.0, -4.0, -12.0)
ELEVATION_DEG, AZIMUTH_DEG = np.array([1.0, 12.0, 90.0]), np.array([0.0, 130.0, 0.0])


@pytest.fixture(scope="module")
def air():
    return climate_medium(load_climate("continental-average"), np.array([450.0, 650.0]))


def sky(solver, medium, settings):
    field = solver.prepare(medium, settings)
    return np.stack([field.radiance(sun, ELEVATION_DEG, AZIMUTH_DEG) for sun in SUNS_DEG])


@pytest.mark.parametrize("name", SOLVERS)
def test_a_screen_that_all_beams_pass_is_none(name, air):
    """A clean horizon that is written out would not be the clean horizon."""
    solver, settings = SOLVERS[name]
    screened = replace(air, screen=Screen((0.0, 8.0), (1.0, 1.0), 300.0))
    np.testing.assert_array_equal(sky(solver, screened, settings), sky(solver, air, settings))


@pytest.mark.parametrize("name", ["zones", "montecarlo"])
def test_air_that_bends_nothing_is_air_without_refraction(name, air):
    """Refraction with n = 1 would not be none."""
    solver, settings = SOLVERS[name]
    vacuum = replace(air, refractivity=0.0 * air.refractivity)
    off = {"refraction": False, "bent_lines_of_sight": False} | ({"bent_paths": False} if name == "zones" else {})
    np.testing.assert_array_equal(sky(solver, vacuum, settings), sky(solver, vacuum, replace(settings, **off)))


@pytest.mark.parametrize("name", SOLVERS)
def test_ozone_of_no_depth_is_none(name):
    """A column of 0 DU would leave some ozone, or another profile's."""
    solver, settings = SOLVERS[name]
    without = load_climate("pure-air", {"gases.ozone.treatment": "none"})
    empty = load_climate("pure-air", {"gases.ozone.column_du": 0})
    there = climate_medium(load_climate("pure-air"), np.array([600.0]))
    one, other = (climate_medium(climate, np.array([450.0, 600.0])) for climate in (without, empty))
    assert there.absorption_per_km.max() > 2.0 * one.absorption_per_km[:, 1].max()  # what is left is NO2
    np.testing.assert_array_equal(sky(solver, one, settings), sky(solver, other, settings))
