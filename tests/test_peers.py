"""Other programs as solvers: they see the air that ours see, and refuse what they cannot do."""

from __future__ import annotations

import sys

import numpy as np
import pytest

from twilight import solvers
from twilight.config.load import load_climate
from twilight.errors import TwilightError
from twilight.scene.medium import climate_medium

WAVELENGTH_NM = np.array([450.0, 550.0, 650.0])


@pytest.fixture(scope="module")
def air():
    return climate_medium(load_climate("continental-average"), WAVELENGTH_NM)


def test_sunsky_is_a_day_sky_of_the_right_brightness_and_side(air):
    pytest.importorskip("mitsuba")
    field = solvers.load("sunsky").prepare(air)
    elevation, azimuth = np.array([30.0, 30.0, 88.0]), np.array([0.0, 180.0, 0.0])
    sky = field.radiance(30.0, elevation, azimuth)
    right = solvers.load("zones").prepare(air, solvers.load("zones").QUALITIES["draft"], sun_elevations_deg=[30.0])
    ratio = sky[1:] / right.radiance(30.0, elevation[1:], azimuth[1:])
    assert np.all((ratio > 0.6) & (ratio < 1.7)), ratio
    assert np.all(sky[0] > 1.8 * sky[1])
    assert np.array_equal(sky[1:2], field.radiance(30.0, [30.0], [180.0]))


def test_sunsky_refuses_what_it_cannot_do(air):
    pytest.importorskip("mitsuba")
    module = solvers.load("sunsky")
    field = module.prepare(air)
    for sun, elevation, words in ((-1.0, 30.0, "sun.elevation_deg is -1"), (30.0, -5.0, "no ground")):
        with pytest.raises(TwilightError, match=words):
            field.radiance(sun, [elevation], [0.0])
    with pytest.raises(TwilightError, match="800 nm"):
        module.prepare(climate_medium(load_climate("pure-air"), np.array([550.0, 800.0])))
    with pytest.raises(TwilightError, match=r"solver\.turbidity is 11"):
        module.SunskySettings(turbidity=11.0)


def test_sasktran2_sees_the_same_day_sky(air):
    pytest.importorskip("sasktran2")
    module, ours = solvers.load("sasktran2"), solvers.load("zones")
    small = module.Sasktran2Settings(zenith_step_deg=5.0, incoming=110, source_step_km=2.0, multiple_step_km=2.0)
    where = np.array([20.0, 60.0]), np.array([90.0, 180.0])
    sky = module.prepare(air, small).radiance(30.0, *where)
    right = ours.prepare(air, ours.QUALITIES["draft"], sun_elevations_deg=[30.0]).radiance(30.0, *where)
    assert np.allclose(sky, right, rtol=0.04)
    with pytest.raises(TwilightError, match="looks up only"):
        module.prepare(air, small).radiance(30.0, [-3.0], [0.0])


@pytest.mark.parametrize("name", ["sunsky", "sasktran2"])
def test_what_is_not_installed_says_how_to_install_it(name, air, monkeypatch):
    package = solvers.load(name).CAPABILITIES.package
    monkeypatch.setitem(sys.modules, package, None)
    with pytest.raises(TwilightError, match=f"install '{package}>="):
        solvers.load(name).prepare(air)
