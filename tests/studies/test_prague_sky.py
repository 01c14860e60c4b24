"""The sky of zones beside published values of the Prague sky model (docs/accuracy.md)."""

import math

import numpy as np
import pytest

import twilight
from twilight.numerics.spectrum import solar_irradiance

CHANNELS_NM = (460.0, 540.0, 620.0)
"""Centres of three of its channels, each 40 nm wide."""
SKIES = {
    "day, 45 deg, away from the sun": (0.5236, 45.0, 180.0, (5.8964049089e-02, 3.2599713676e-02, 1.9265830095e-02)),
    "day, zenith": (0.5236, 90.0, 0.0, (5.4639955885e-02, 3.2298205668e-02, 2.0553615445e-02)),
    "twilight, 45 deg above the sun": (-0.05, 45.0, 0.0, (1.0555130013e-03, 5.1896359629e-04, 3.5488616557e-04)),
}
"""Sun's elevation [rad], direction [deg], radiance [W m-2 sr-1 nm-1] at 50 km of visibility, ground albedo 0.5:
colour-science, colour/phenomena/sky/tests/test_wilkie2021.py (BSD 3-clause, Colour Developers)."""
AEROSOL_DEPTH = 0.132
"""At 550 nm: under it the transmittance of this air at 540 nm is that of theirs."""


@pytest.fixture(scope="module")
def air():
    """Continental air in the US standard atmosphere without what the Prague model does not have."""
    return twilight.solve(
        "continental-average",
        wavelength_nm=CHANNELS_NM,
        quality="draft",
        settings={
            "atmosphere.profile": "us_standard", "aerosol.optical_depth_550nm": AEROSOL_DEPTH,
            "aerosol.stratosphere": "none", "refraction.model": "none", "ground.albedo": 0.5, "horizon": "clean",
        },
    )  # fmt: skip


@pytest.mark.parametrize("name", SKIES)
def test_the_sky_without_refraction_and_stratospheric_aerosol_is_theirs(air, name):
    """An error of scale, of the ground's light or of the Earth's shadow would part the two; what remains is how the
    two aerosols differ in phase function and spectrum."""
    sun_rad, elevation, azimuth, theirs = SKIES[name]
    light = np.asarray(air.radiance(math.degrees(sun_rad), [elevation], [azimuth]))[0]
    solar = np.array([solar_irradiance(np.arange(c - 19.5, c + 20.0)).mean() for c in CHANNELS_NM])
    assert light * solar == pytest.approx(np.array(theirs), rel=0.08)
