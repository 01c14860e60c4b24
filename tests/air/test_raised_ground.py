"""The ground at its site's altitude: what the medium is then, and that solvers take the lowest level for it."""

from dataclasses import replace

import numpy as np
import pytest
from stability_media import Air, medium_of

from twilight import solvers
from twilight.atmosphere.build import Boundaries, EqualAirMass, build_medium
from twilight.atmosphere.medium import Medium
from twilight.atmosphere.opac import MineralLayer, opac_type
from twilight.atmosphere.profiles import load_profile
from twilight.base.errors import TwilightError
from twilight.config import load
from twilight.scene.medium import climate_medium
from twilight.sky.night import night_radiance
from twilight.transport.beam import beam_at, prepare_beam

RAISED_KM = 2.8
ELEVATION_DEG = np.array([2.0, 20.0, 60.0, 90.0, 10.0])
AZIMUTH_DEG = np.array([0.0, 5.0, 180.0, 0.0, 120.0])
SOLVERS = (
    "zones", "preetham", "cie", pytest.param("cells", marks=pytest.mark.slow),
    pytest.param("montecarlo", marks=pytest.mark.slow), pytest.param("sasktran2", marks=pytest.mark.slow),
)  # fmt: skip
NEARLY = {"cells": 1e-4}
"""Relative difference by rounding: points of the sky's table lie on different sides of an edge."""


@pytest.fixture(scope="module")
def low() -> Medium:
    made = medium_of(Air(air=0.25, aerosol=0.15), Air(air=0.05, aerosol=0.1, ozone=0.03))
    return replace(made, wavelength_nm=np.array([450.0, 650.0]))


def raised(medium: Medium) -> Medium:
    """The same spheres, called by other altitudes: every radius stays."""
    return replace(
        medium, altitude_km=medium.altitude_km + RAISED_KM, earth_radius_km=medium.earth_radius_km - RAISED_KM
    )


def quick(name: str):
    """Settings that are coarse and fast; what matters is that both media get the same."""
    from twilight.solvers.cells import CellsSettings
    from twilight.solvers.montecarlo import MonteCarloSettings

    made = {
        "cells": lambda: CellsSettings(azimuth_cells=24),
        "montecarlo": lambda: MonteCarloSettings(target_stderr=None, samples=64),
    }
    return made[name]() if name in made else solvers.load(name).QUALITIES[next(iter(solvers.load(name).QUALITIES))]


@pytest.mark.parametrize("name", SOLVERS)
def test_a_solver_knows_the_ground_by_its_lowest_level(low, name):
    """A solver would take sea level for the ground."""
    if not solvers.load(name).CAPABILITIES.installed:
        pytest.skip(f"needs {name}")
    solver, height_km = solvers.load(name), 0.6
    medium = replace(low, refractivity=0.0 * low.refractivity) if name == "sasktran2" else low
    fields = [
        solver.prepare(air, quick(name), observer_altitude_km=air.bottom_km + height_km)
        for air in (medium, raised(medium))
    ]
    if name == "montecarlo":  # rounding makes the paths others
        one, two = (field.radiance_with_error(4.0, ELEVATION_DEG, AZIMUTH_DEG) for field in fields)
        error = np.hypot(one.standard_error, two.standard_error)
        assert np.abs((two.radiance - one.radiance) / error).max() < 4.0
        assert (error / one.radiance).max() < 0.02
    else:
        one, two = (field.radiance(4.0, ELEVATION_DEG, AZIMUTH_DEG) for field in fields)
        np.testing.assert_allclose(two, one, rtol=NEARLY.get(name, 1e-6))
    with pytest.raises(TwilightError, match=r"observer|ground"):
        solver.prepare(raised(medium), quick(name), observer_altitude_km=1.0)


def test_the_beam_and_the_night_know_the_ground_by_the_lowest_level(low):
    """Sunbeam or night would take sea level for the ground."""
    beams = [prepare_beam(medium) for medium in (low, raised(low))]
    light = np.zeros((2, 2))
    for height_km, elevation_deg in ((0.0, 10.0), (0.0, 0.2), (3.0, -1.0)):
        bending = [
            beam_at(beam, medium.bottom_km + height_km, np.sin(np.radians(elevation_deg)), out)
            for beam, medium, out in zip(beams, (low, raised(low)), light, strict=True)
        ]
        assert light[0].min() > 0.0
        np.testing.assert_allclose(light[1], light[0], rtol=1e-6)
        assert bending[1] == pytest.approx(bending[0], rel=1e-6)
    nights = [
        night_radiance(medium, ELEVATION_DEG[:4], AZIMUTH_DEG[:3], observer_altitude_km=medium.bottom_km)
        for medium in (low, raised(low))
    ]
    np.testing.assert_allclose(nights[1], nights[0], rtol=5e-3)  # the airglow's layers stay at their own altitudes


def test_pressure_and_gases_are_those_of_the_altitude():
    """A mountain would have the air of the sea."""
    full = load_profile("us_standard")
    at_sea, high = (build_medium([550.0], profile="us_standard", ground_altitude_km=z) for z in (0.0, RAISED_KM))
    assert high.bottom_km == RAISED_KM and high.top_km == at_sea.top_km
    # Rayleigh scattering above the ground goes with the pressure there
    there = full.at(RAISED_KM).pressure_hpa[0] / full.pressure_hpa[0]
    assert there == pytest.approx(0.709, abs=0.002)  # US standard atmosphere 1976: 719 hPa at 2.8 km of 1013 hPa
    assert high.optical_depth("air")[0] / at_sea.optical_depth("air")[0] == pytest.approx(there, rel=0.005)
    z = np.array([3.0, 7.5, 22.0, 60.0])
    for part in ("air_scattering", "absorption", "refractivity"):
        np.testing.assert_allclose(getattr(high.at(z), part), getattr(at_sea.at(z), part), rtol=1e-12)
    assert 5.0 < at_sea.notes["ozone_column_du"] - high.notes["ozone_column_du"] < 15.0
    # a column that is asked for is the one above the ground
    asked = build_medium([602.0], ground_altitude_km=RAISED_KM, ozone_column_du=300.0, no2=False, o4=False)
    at_sea = build_medium([602.0], ozone_column_du=300.0, no2=False, o4=False)
    assert asked.optical_depth("absorption")[0] == pytest.approx(at_sea.optical_depth("absorption")[0], rel=2e-3)


def test_layers_begin_at_the_ground():
    """Layers would reach into the mountain."""
    for layers in (EqualAirMass(12), Boundaries((RAISED_KM, 5.0, 20.0, 100.0))):
        medium = build_medium([550.0], layers=layers, ground_altitude_km=RAISED_KM)
        smooth = build_medium([550.0], ground_altitude_km=RAISED_KM)
        assert medium.bottom_km == RAISED_KM
        assert medium.optical_depth()[0] == pytest.approx(smooth.optical_depth()[0], rel=1e-6)
    mass = -np.diff(np.exp(-EqualAirMass(12).boundaries_km(100.0, RAISED_KM) / 8.0))
    np.testing.assert_allclose(mass, mass[0], rtol=1e-9)


def test_the_boundary_layer_stands_on_the_ground_or_on_the_sea(tmp_path):
    """Haze would hang below the mountain, or be lost."""
    spec = opac_type("continental average")

    def medium(ground_km, **changes):
        one = replace(spec, **changes)
        return build_medium([550.0], aerosol=one, ground_altitude_km=ground_km)

    def depth(made, name="boundary layer"):
        return made.notes["optical_depth"].get(name, [0.0])[0]

    sea, on_ground = medium(0.0), medium(RAISED_KM)
    assert ("boundary layer", 2.8, 4.8) in on_ground.notes["regions"]
    assert depth(on_ground) == pytest.approx(depth(sea), rel=1e-9)
    at = on_ground.at([RAISED_KM]).aerosol_extinction[0, 0]
    assert at == pytest.approx(sea.at([0.0]).aerosol_extinction[0, 0], rel=1e-9)
    # counted from sea level: a hill cuts the layer, a mountain stands above it
    hill = medium(1.0, boundary_layer_base="sea_level")
    np.testing.assert_allclose(hill.at([1.5, 5.0]).aerosol_extinction, sea.at([1.5, 5.0]).aerosol_extinction, rtol=1e-9)
    assert 0.4 * depth(sea) < depth(hill) < 0.5 * depth(sea)
    mountain = medium(RAISED_KM, boundary_layer_base="sea_level")
    assert depth(mountain) == 0.0 and mountain.aerosol_extinction_per_km[0, 0] > 0.0
    assert depth(mountain, "free troposphere") < depth(sea, "free troposphere")
    dust = MineralLayer(2.0, 5.0, optical_depth_550nm=0.2)
    assert depth(medium(RAISED_KM, mineral_transported=dust), "mineral transported") == pytest.approx(0.2, rel=1e-9)
    assert depth(medium(6.0, mineral_transported=dust), "mineral transported") == 0.0
    scaled = medium(RAISED_KM, optical_depth_550nm=0.3)
    assert scaled.optical_depth("aerosol")[0] == pytest.approx(0.3, rel=1e-9)


def test_the_observer_stands_on_the_ground_unless_said_otherwise():
    """The observer would stand in the mountain."""
    high = {"ground.altitude_km": RAISED_KM}
    assert load("urban", high).observer.altitude_km == RAISED_KM
    assert load("urban").observer.altitude_km == 0.0
    assert load("urban", high | {"observer.altitude_km": 4.0}).observer.altitude_km == 4.0
    assert climate_medium(load("urban", high).climate, np.array([550.0])).bottom_km == RAISED_KM
