"""The sun at the ground by quadrature: closed forms, and the program's own traced rays."""

import math
from dataclasses import replace

import numpy as np
import pytest
from airs import pure_air

from twilight.config import load
from twilight.scene.medium import climate_medium
from twilight.transport.ground_sun import GroundSun
from twilight.transport.rays import ApparentRays

RADIUS_KM = 6371.0
"""Of the planet [km]."""
TOP_KM = 20.0
"""Of its air [km]."""
PER_KM = 0.03
"""Extinction [km^-1]."""


@pytest.fixture(scope="module")
def even_air():
    """One layer that is the same everywhere and bends nothing."""
    medium = pure_air([0.0, TOP_KM], refractivity=0.0, wavelengths=(550.0,))
    return replace(medium, air_scattering_per_km=np.full((2, 1), PER_KM), earth_radius_km=RADIUS_KM)


@pytest.mark.parametrize("elevation_deg", [90.0, 60.0, 10.0, 1.0, 0.1, 0.0])
def test_straight_rays_through_even_air(even_air, elevation_deg):
    """The sunlight at the ground would be off the closed form of even air."""
    cosine = math.sin(math.radians(elevation_deg))
    path = math.sqrt((RADIUS_KM * cosine) ** 2 + 2.0 * RADIUS_KM * TOP_KM + TOP_KM**2) - RADIUS_KM * cosine
    irradiance, bending = GroundSun(even_air).at(elevation_deg)
    assert irradiance[0] == pytest.approx(math.exp(-PER_KM * path), rel=1e-6)
    assert bending == pytest.approx(0.0, abs=1e-9)


def test_from_the_zenith_light_takes_the_column():
    """Light that does not bend was 3e-4 off, by the slope of one side."""
    medium = climate_medium(load("continental-average").climate, np.array([440.0, 700.0]))
    z = np.linspace(medium.bottom_km, medium.top_km, 400_001)
    depth = np.trapezoid(medium.at(z).extinction, z, axis=0) + medium.overhead_absorption_optical_depth
    irradiance, bending = GroundSun(medium).at(90.0)
    assert bending == 0.0
    np.testing.assert_allclose(irradiance, np.exp(-depth), rtol=3e-5)


def test_below_the_horizon_it_is_dark(even_air):
    """The sun would shine through the Earth."""
    assert GroundSun(even_air).at(-0.01)[0] == 0.0


@pytest.mark.parametrize("name", ["continental-average", "desert"])
def test_bending_and_light_are_those_of_traced_rays(name):
    """Sunlight at the ground in numpy alone would differ from that of traced rays."""
    medium = climate_medium(load(name).climate, np.array([440.0, 700.0]))
    sun = GroundSun(medium)
    apparent = np.array([0.05, 0.5, 3.0, 40.0])
    true, passed = ApparentRays(medium).follow(medium.bottom_km, apparent, np.array([0, 1]))
    for k, seen in enumerate(apparent):
        for w in range(2):
            one = GroundSun(medium.select(slice(w, w + 1)))
            irradiance, bending = one.at(true[k, w])
            assert bending == pytest.approx(seen - true[k, w], abs=3e-5)
            # the spreading by differential refraction is what traced rays of one direction do not have
            step = 1e-3
            about, _ = ApparentRays(medium).follow(
                medium.bottom_km, np.array([seen - step, seen + step]), np.array([w])
            )
            spread = 2.0 * step / (about[1, 0] - about[0, 0])
            sines = math.cos(math.radians(seen)) / math.cos(math.radians(true[k, w]))
            assert irradiance[0] == pytest.approx(passed[k, w] * spread * sines, rel=3e-3)
    assert sun.at(float(true[1, 0]))[0].shape == (2,)
