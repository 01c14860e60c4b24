"""The sunbeam and light scattered once beside edges of layers and of the Earth, against quadrature of the medium."""

import math
from dataclasses import replace

import numpy as np
import pytest
from airs import pure_air
from exact_sunbeam import ExactSunbeam, scattered_once
from layered_sky import layered

from twilight.solvers.zones import QUALITIES, prepare
from twilight.transport.beam import beam_at, beam_at_one, prepare_beam

RADIUS = 6371.0
MM = 1e-6
"""A millimetre in km."""
ASKED = 0.01
"""Largest relative error that is allowed."""
DARK = 1e-8
"""Transmittance below which nothing is asked."""
ROUNDING_DEG = 3e-8
"""A sun known to double precision at a layer of 1000 per km: what its ray through the topmost millimetre is worth."""
REFRACTED_DEG = 2e-4
"""How far the refracted sun may be off its place: a thousandth of its disc's diameter."""
SHELLS = [(3.0, 0.001, 1.0), (0.5, 0.5, 10.0), (10.0, 1.0, 0.3), (15.0, 5.0, 0.1), (0.0, 2.0, 0.6)]
"""Base [km], thickness [km], vertical optical depth: a metre, a stratus, a cirrus, a veil, haze from the ground."""


def altitudes(base, thickness):
    """[km]: a millimetre from both sides of every edge, inside, below and above."""
    top = base + thickness
    found = {0.0, base - MM, base + MM, base + 0.4 * thickness, top - MM, top + MM, top + 0.02, top + 3.0, 0.5 * base}
    return sorted(z for z in found if z >= 0.0)


def suns_through_horizons(altitude_km, edges_km, step_deg=0.01, half_deg=0.05):
    """Elevations [deg] around those under which an observer sees the edges below, and around the horizontal."""
    below = [z for z in edges_km if z < altitude_km]
    horizons = [0.0, *(-math.degrees(math.acos((RADIUS + z) / (RADIUS + altitude_km))) for z in below)]
    around = np.arange(-half_deg, half_deg + 1e-9, step_deg) + 0.0007
    return np.unique(np.concatenate([h + around for h in horizons]))


def wrong_straight(medium, base, thickness, step_deg=0.01):
    """(number of values asked for, those that are wrong) of `beam_at` without refraction."""
    beam, exact = prepare_beam(medium, refraction=False), ExactSunbeam(medium)
    count, wrong, out = 0, [], np.empty(medium.n_wavelengths)
    for z in altitudes(base, thickness):
        suns = suns_through_horizons(z, [0.0, base, base + thickness], step_deg)
        expected = [
            np.exp(-exact.straight_depth(np.full(suns.size, z), np.sin(np.radians(suns + shift))))
            for shift in (-ROUNDING_DEG, 0.0, ROUNDING_DEG)
        ]
        for sun, low, middle, high in zip(suns, *expected, strict=True):
            if middle < DARK:
                continue
            count += 1
            beam_at(beam, z, math.sin(math.radians(sun)), out)
            if not min(low, middle, high) * (1.0 - ASKED) < out[0] < max(low, middle, high) * (1.0 + ASKED):
                wrong.append((z, sun, out[0], middle))
    return count, wrong


@pytest.mark.parametrize(("base", "thickness", "depth"), SHELLS)
def test_direct_light_through_every_horizon_of_a_layer(base, thickness, depth):
    """If this failed, the sun seen along a layer's top would be wrong by tens of per cent in every solver."""
    count, wrong = wrong_straight(layered(base, thickness, depth), base, thickness)
    assert count > 20
    assert wrong == []


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(10))
def test_direct_light_beside_layers_of_any_thickness_and_altitude(seed):
    """1 m to 5 km thick, from the ground to 60 km, of optical depth 0.01 to 10, some with ramps of 1 m."""
    rng = np.random.default_rng(seed)
    thickness = 10.0 ** rng.uniform(-3.0, math.log10(5.0))
    base = 0.0 if seed % 5 == 0 else float(rng.uniform(0.0, 60.0))
    depth = 10.0 ** rng.uniform(-2.0, 1.0)
    ramp = 0.001 if seed % 3 == 2 and thickness > 0.01 else 0.0
    count, wrong = wrong_straight(layered(base, thickness, depth, ramp), base, thickness)
    assert count > 10
    assert wrong == []


def refracting(base, thickness, depth):
    """Refracting air with a jumping layer, at 400, 550 and 700 nm."""
    top = base + thickness
    levels = [z for z in np.arange(0.0, 101.0) if not base - 1e-9 < z < top + 1e-9]
    levels = np.sort([*levels, *([base] if base == 0.0 else [base, base]), top, top])
    inside = (levels >= base) & (levels <= top)
    outer = np.flatnonzero(inside)
    inside[outer[-1]] = False
    if base > 0.0:
        inside[outer[0]] = False
    aerosol = np.where(inside, depth / thickness, 0.0)
    return replace(pure_air(levels), aerosol_extinction_per_km=np.repeat(aerosol[:, None], 3, axis=1))


@pytest.mark.parametrize(("base", "thickness", "depth"), [SHELLS[1], SHELLS[2], (1.0, 0.01, 0.3)])
def test_refracted_light_beside_a_layer_at_every_wavelength(base, thickness, depth):
    """If this failed, wavelengths other than the most refracted one would see edges at its places, not their own."""
    medium = refracting(base, thickness, depth)
    beam = prepare_beam(medium)
    top = base + thickness
    count = 0
    for w in (0, 2):
        exact = ExactSunbeam(medium, wavelength=w)
        for z in (top - MM, top + MM, top + 1.0):
            dip = math.degrees(math.acos((RADIUS + top) / (RADIUS + z))) if z > top else 0.0
            for sun in -dip + np.array([-0.9, -0.5, -0.3, -0.06, 0.0, 0.04]):
                expected = [exact.irradiance(z, sun + shift) for shift in (-REFRACTED_DEG, 0.0, REFRACTED_DEG)]
                if expected[1] < 1e-5:
                    continue
                count += 1
                found, _ = beam_at_one(beam, z, math.sin(math.radians(sun)), w)
                assert min(expected) * (1.0 - ASKED) < found < max(expected) * (1.0 + ASKED), (w, z, sun)
    assert count > 10


def wrong_sky(base, thickness, depth, suns):
    """(number of directions asked for, those that are wrong) of light scattered once, seen from below and above."""
    medium = layered(base, thickness, depth)
    field = prepare(medium, replace(QUALITIES["standard"], max_orders=1, degree=32, refraction=False))
    top = base + thickness
    count, wrong = 0, []
    for z, elevation, azimuth in ((0.0, 60.0, 30.0), (0.0, 8.0, 170.0), (top + MM, 3.0, 20.0), (top + 0.5, -1.5, 60.0)):
        for sun in suns:
            expected = scattered_once(medium, z, elevation, azimuth, sun)
            if expected < 1e-7:  # through more than ten optical depths
                continue
            count += 1
            found = float(field.radiance(sun, [elevation], azimuth, observer_altitude_km=z)[0, 0])
            if abs(found / expected - 1.0) > ASKED:
                wrong.append((z, elevation, sun, found, expected))
    return count, wrong


@pytest.mark.parametrize(("base", "thickness", "depth"), SHELLS[:2])
def test_light_scattered_once_beside_a_layer(base, thickness, depth):
    """If this failed, the sky above a stratus or below a thin shell would be wrong while the sun sets on the layer."""
    count, wrong = wrong_sky(base, thickness, depth, (0.02, 0.3))
    assert count > 3
    assert wrong == []


@pytest.mark.slow
@pytest.mark.parametrize(("base", "thickness", "depth"), [*SHELLS[2:], (8.0, 0.05, 0.5), (40.0, 3.0, 0.02)])
def test_light_scattered_once_through_the_suns_that_graze_a_layer(base, thickness, depth):
    """As above, while the sun sets on layers of every kind."""
    count, wrong = wrong_sky(base, thickness, depth, (0.01, 0.02, 0.03, 0.05, 0.1, 0.2, 0.5, 1.0))
    assert count > 12
    assert wrong == []


@pytest.mark.parametrize(
    ("altitude_km", "elevation", "azimuth", "sun"),
    [(0.0, 0.0, 180.0, 0.0), (0.0, 0.0, 180.0, 0.01), (0.0, 0.0, 90.0, 0.0), (5e-5, 0.0, 180.0, -1e-4),
     (5e-5, -1e-4, 180.0, -1e-4), (MM, 0.0, 180.0, -1e-4), (5e-5, -0.005, 0.0, 0.0)],
)  # fmt: skip
def test_the_horizon_itself(altitude_km, elevation, azimuth, sun):
    """If this failed, rounding would decide which points of a ray that touches the ground are lit."""
    medium = layered(3.0, 1.0, 0.0)
    field = prepare(medium, replace(QUALITIES["standard"], max_orders=1, refraction=False))
    found = float(field.radiance(sun, [elevation], azimuth, observer_altitude_km=altitude_km)[0, 0])
    assert found == pytest.approx(scattered_once(medium, altitude_km, elevation, azimuth, sun), rel=ASKED)


@pytest.mark.parametrize("altitude", [10.0, pytest.param(400.0, marks=pytest.mark.slow)])
def test_the_ray_that_grazes_haze_from_above(altitude):
    """Within 0.01 deg the light changes up to a hundredfold there: that is the air's own edge, not a grid's."""
    medium = layered(0.0, 2.0, 0.2)
    field = prepare(medium, replace(QUALITIES["standard"], max_orders=1, degree=32, refraction=False))
    horizon = -math.degrees(math.acos((RADIUS + 2.0) / (RADIUS + altitude)))
    elevation = horizon + np.array([-0.02, -0.001, 0.001, 0.02])
    for sun in (5.0, -3.0):
        found = field.radiance(sun, elevation, 40.0, observer_altitude_km=altitude)[:, 0]
        expected = [scattered_once(medium, altitude, e, 40.0, sun) for e in elevation]
        np.testing.assert_allclose(found, expected, rtol=ASKED)
        # the edge is there to be seen: 3.5 % from 10 km, 1.4 % from 400
        assert np.abs(np.diff(np.log(expected))).max() > 0.01
