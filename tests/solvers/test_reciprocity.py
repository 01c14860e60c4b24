"""Reciprocity of odd air between planes: R(mu, mu0, phi) = R(mu0, mu, phi) of the reflected radiance over mu0 F0."""

from dataclasses import replace

import numpy as np
import pytest
from energy_media import ODD, odd_medium
from hazy_zones import QUICK
from thick_media import FLAT_KM

from twilight.solvers import zones

COSINES = np.array([0.25, 0.5, 0.9])
AZIMUTHS_DEG = np.array([20.0, 80.0, 150.0])


def elevation_deg(cosine):
    return np.degrees(np.arcsin(cosine))


@pytest.mark.slow
def test_zones_are_reciprocal():
    """Sun and observer above the air change places; with QUICK up to 2.3 % off, a conservative layer over a white
    ground."""
    medium = replace(odd_medium(*ODD.values(), refractivity=0.0), earth_radius_km=FLAT_KM)
    settings = replace(QUICK, max_orders=200, tolerance=1e-3)
    field = zones.prepare(
        medium, settings, observer_altitude_km=medium.top_km, sun_elevations_deg=elevation_deg(COSINES)
    )
    for i, azimuth in enumerate(AZIMUTHS_DEG):
        a, b = COSINES[i], COSINES[(i + 1) % 3]
        there, back = (
            field.radiance(elevation_deg(sun), -elevation_deg(view), azimuth, observer_altitude_km=medium.top_km) / sun
            for sun, view in ((a, b), (b, a))
        )
        np.testing.assert_allclose(there, back, rtol=0.03)
