"""Sharp layers are seen: light scattered once in layered air against an independent quadrature; no flicker."""

import math
from dataclasses import replace

import numpy as np
import pytest
from exact_sunbeam import scattered_once
from layered_sky import layered

from twilight.solvers.zones import prepare
from twilight.solvers.zones.settings import QUALITIES
from twilight.transport.lines import END_DISTANCE, GROUND, new_line, trace_line
from twilight.transport.profile import prepare_profile
from twilight.transport.steps import chord_depth

SEEN = 1e-11
"""Radiance over F0 [sr^-1] below which an error does not count: light scattered once that crosses more than 25 optical
depths, beside which light scattered often is ten orders of magnitude brighter."""


def views(base, thickness):
    """Observer altitudes [km] below, inside and above a layer, and elevations from there [deg]."""
    yield 0.0, (0.5, 3.0, 90.0)
    yield base + 0.5 * thickness, (-90.0, -0.5, 0.5, 20.0)
    yield base + thickness + 5.0, (-20.0, -3.0, 10.0)


def worst_error(medium, base, thickness, quality):
    # HG 0.7 to the power 33 is nothing; the radiance of light scattered once is that of scalar theory
    settings = replace(QUALITIES[quality], max_orders=1, degree=32, polarisation=False)
    field = prepare(medium, settings)
    errors = []
    for altitude, elevations in views(base, thickness):
        found = field.radiance(30.0, elevations, 40.0, observer_altitude_km=altitude)[:, 0]
        exact = np.array([scattered_once(medium, altitude, e, 40.0, 30.0) for e in elevations])
        errors.extend(np.abs(found - exact) / np.maximum(exact, SEEN))
    return max(errors)


@pytest.mark.parametrize("quality", ["draft", pytest.param("standard", marks=pytest.mark.slow)])
@pytest.mark.parametrize(
    ("base", "thickness", "depth", "ramp_km"), [(3.0, 0.01, 2.0, 0.0), (3.0, 1.0, 10.0, 0.0), (3.0, 0.2, 0.5, 1e-6)]
)
def test_a_sharp_layer_is_seen(base, thickness, depth, ramp_km, quality):
    """A thin layer would be stepped over by the solver."""
    assert worst_error(layered(base, thickness, depth, ramp_km), base, thickness, quality) < 2e-3


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(12))
def test_many_layers(seed):
    """A layer, 1 m to 2 km thick, of optical depth 0.01 to 50, from 0 to 90 km, would be stepped over or blurred.

    Qualities take turns: in twelve layers each has four, of which one has ramps.
    """
    rng = np.random.default_rng(seed)
    thickness = 10.0 ** rng.uniform(-3.0, math.log10(2.0))
    base = 0.0 if seed % 5 == 0 else float(rng.uniform(0.0, 90.0 - thickness))
    depth = 10.0 ** rng.uniform(-2.0, math.log10(50.0))
    ramp_km = 1e-6 if seed % 4 == 3 else 0.0
    quality = tuple(QUALITIES)[seed % len(QUALITIES)]
    medium = layered(base, thickness, depth, ramp_km)
    assert worst_error(medium, base, thickness, quality) < 1e-2, (base, thickness, depth, ramp_km, quality)


@pytest.mark.parametrize("ramp_km", [0.0, 1e-6])
@pytest.mark.parametrize(
    ("altitude_km", "elevation_deg"), [(0.0, 0.3), (0.0, 50.0), (3.0, 0.0), (9.0, -2.49), (9.0, -40.0)]
)
def test_optical_depth_through_a_thin_layer(ramp_km, altitude_km, elevation_deg):
    """A layer of 2 m: the depth is coefficient times the length of the chord inside, by Pythagoras."""
    base, thickness, depth = 3.0, 0.002, 0.005
    clear, hazy = layered(base, thickness, 0.0, ramp_km), layered(base, thickness, depth, ramp_km)
    cosine = math.sin(math.radians(elevation_deg))
    passed = []
    for medium in (clear, hazy):
        profile = prepare_profile(medium)
        line = new_line(profile)
        _, status = trace_line(profile, altitude_km, cosine, 0.5, False, line)
        out = np.empty(1)
        length = line.end[END_DISTANCE] - (1e-6 if status == GROUND else 0.0)
        assert chord_depth(profile, altitude_km, cosine, length, out)
        if np.all(out < 20.0):
            np.testing.assert_allclose(-np.log(line.transmittance), out, rtol=1e-3)
        passed.append(out[0])
    r = 6371.0 + altitude_km
    perigee = r * math.sqrt(1.0 - cosine**2)

    def chord(z):
        return np.sqrt(np.maximum(0.0, (6371.0 + z - perigee) * (6371.0 + z + perigee)))

    crossings = 1 if cosine >= 0.0 or perigee < 6371.0 else 2
    # a layer with linear ramps is the mean of layers that jump anywhere within the ramps
    moved = ramp_km * (np.arange(4000) + 0.5) / 4000
    low = np.maximum(base + moved, altitude_km if cosine >= 0.0 else 0.0)
    inside = crossings * np.mean(chord(base + thickness - moved) - chord(low))
    exact = depth / (thickness - ramp_km) * inside
    assert passed[1] - passed[0] == pytest.approx(exact, rel=1e-3 if ramp_km else 1e-4, abs=1e-3)
