"""Laws that hold in any air, tried on random climates (derandomised: the same ones in every run)."""

from dataclasses import replace

import numpy as np
import pytest
from hazy_zones import QUICK
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from stability_media import Air, medium_of
from toy_sky import texture_grid

from twilight.numerics import spectrum
from twilight.sky.sky import Sky
from twilight.solvers import zones
from twilight.solvers.cells.exchange import make_rings, pair_capture, sphere_capture
from twilight.solvers.cells.grid import make_grid, make_layers
from twilight.transport.beam import beam_at, prepare_beam
from twilight.transport.scaling import delta_scaled

TINY = replace(
    QUICK, altitude_density=0.3, zenith_density=0.4, polar_directions=4, late_polar_directions=4,
    line_of_sight_density=0.6, max_orders=6,
)  # fmt: skip
COMMON = {"deadline": None, "derandomize": True, "suppress_health_check": list(HealthCheck)}
FEW = settings(max_examples=3, **COMMON)
MANY = settings(max_examples=60, **COMMON)

airs = st.builds(
    Air, air=st.floats(0.0, 0.5), aerosol=st.one_of(st.just(0.0), st.floats(1e-4, 3.0)), albedo=st.floats(0.0, 1.0),
    asymmetry=st.floats(0.0, 0.9), ozone=st.one_of(st.just(0.0), st.floats(1e-4, 1.0)), ground=st.floats(0.0, 1.0),
)  # fmt: skip
suns = st.floats(-12.0, 90.0)
ELEVATION_DEG = np.array([-40.0, 1.0, 10.0, 45.0, 90.0])
AZIMUTH_DEG = np.array([0.0, 20.0, 90.0, 150.0, 0.0])


def sky(medium, sun, *, azimuth=AZIMUTH_DEG, **change):
    return zones.prepare(medium, replace(TINY, **change)).radiance(sun, ELEVATION_DEG, azimuth)


@pytest.mark.slow
@FEW
@given(st.lists(airs, min_size=8, max_size=8), suns)
def test_radiance_is_positive_and_left_is_right(some, sun):
    """Some air would be negative, or brighter on one side of the sun."""
    field = zones.prepare(medium_of(*some), TINY)
    radiance = field.radiance(sun, ELEVATION_DEG, AZIMUTH_DEG)
    assert np.all(np.isfinite(radiance)) and np.all(radiance >= 0.0)
    for azimuth in (-AZIMUTH_DEG, 360.0 - AZIMUTH_DEG, AZIMUTH_DEG + 360.0):
        np.testing.assert_allclose(field.radiance(sun, ELEVATION_DEG, azimuth), radiance, rtol=1e-6)
    zenith = field.radiance(sun, 90.0, np.array([0.0, 77.0, 180.0]))
    np.testing.assert_allclose(zenith, np.broadcast_to(zenith[0], zenith.shape), rtol=1e-6)


@pytest.mark.slow
@FEW
@given(airs, st.floats(5.0, 80.0))
def test_more_absorber_is_never_brighter(air, sun):
    """An absorber would make light."""
    amounts = (0.0, 1e-3, 0.01, 0.1, 0.3, 1.0, 3.0, 10.0)
    radiance = sky(medium_of(*(replace(air, ozone=air.ozone + o) for o in amounts)), sun, max_orders=3, tolerance=0.0)
    assert np.all(np.diff(radiance, axis=-1) <= 1e-5 * radiance[..., :-1])


@FEW
@given(airs, st.floats(5.0, 80.0))
def test_brighter_ground_is_never_darker(air, sun):
    """A brighter ground would darken the sky."""
    amounts = (0.0, 0.01, 0.1, 0.3, 0.5, 0.7, 0.9, 1.0)
    radiance = sky(medium_of(*(replace(air, ground=g) for g in amounts)), sun, max_orders=4, tolerance=0.0)
    assert np.all(np.diff(radiance, axis=-1) >= -1e-5 * radiance[..., 1:])


@pytest.mark.slow
@MANY
@given(airs, st.floats(-1.0, 1.0), st.floats(0.0, 70.0))
def test_sunlight_falls_with_every_extinction(air, cosine, altitude_km):
    """Monotone in the amount; multiplicative in the wavelengths, which share the path; 1 without extinction."""
    amounts = np.array([0.0, 0.01, 0.1, 0.5, 1.0, 2.0])
    scaled = [replace(air, air=air.air * a, aerosol=air.aerosol * a, ozone=air.ozone * a) for a in amounts]
    light = np.zeros(len(scaled))
    beam_at(prepare_beam(medium_of(*scaled, refractivity=0.0), refraction=False), altitude_km, cosine, light)
    assert np.all(light >= 0.0) and np.all(np.diff(light) <= 1e-9)
    assert light[0] == pytest.approx(1.0 if light[0] > 0.5 else 0.0, abs=1e-9)
    if light[0] > 0.5 and light[-1] > 1e-200:
        depth = -np.log(light)
        np.testing.assert_allclose(depth[1:], amounts[1:] * depth[-2], rtol=0.02, atol=1e-6)


@MANY
@given(airs, st.integers(0, 12))
def test_delta_scaling_keeps_absorption_and_never_adds_extinction(air, degree):
    """Delta scaling would absorb light."""
    medium = medium_of(air)
    scaled = delta_scaled(medium, degree).medium
    absorbed = [
        m.aerosol_extinction_per_km * (1.0 - m.aerosol_single_scattering_albedo) + m.absorption_per_km
        for m in (medium, scaled)
    ]
    np.testing.assert_allclose(absorbed[1], absorbed[0], rtol=1e-9, atol=1e-15)
    assert np.all(scaled.extinction_per_km <= medium.extinction_per_km * (1 + 1e-12))
    assert np.all(scaled.extinction_per_km >= 0.0)


@MANY
@given(st.floats(1e-12, 1e3), st.floats(1.0, 10.0))
def test_a_thicker_cell_captures_more_of_its_own_light(depth, factor):
    """A cell would capture more light than it has."""
    less, more = sphere_capture(depth), sphere_capture(depth * factor)
    assert 0.0 <= less <= more * (1 + 1e-12) <= 1.0 + 1e-12


@pytest.mark.slow
@settings(max_examples=20, **COMMON)
@given(airs.filter(lambda a: a.air > 0.01), st.integers(0, 2**31))
def test_the_transfer_between_cells_is_reciprocal(air, seed):
    """Of cells that are small for their distance: captured / (extinction volume) is the same both ways.

    Light goes from one to the other through the same air: exp(-depth) / (4 pi distance^2) either way.
    """
    medium = medium_of(air, refractivity=0.0)
    layers = make_layers(medium, False)
    grid = make_grid(36, 1.0, 30.0, 0.0, medium.top_km, medium.earth_radius_km)
    rings = make_rings(grid, layers, np.arange(grid.ring_radius_km.size))
    extinction = layers.extinction[rings.layer]
    rng = np.random.default_rng(seed)
    depth, there, back, toward = np.zeros(1), np.zeros(1), np.zeros(1), np.zeros(3)
    compared = 0
    for _ in range(400):
        i, j = rng.integers(rings.radius.size, size=2)
        turn = rng.uniform(0, 2 * np.pi)
        lit = pair_capture(layers, layers.extinction, rings, (i, j, turn), depth, there, back, toward)
        chord = np.max(rings.size[[i, j]])
        thick = chord * max(extinction[i, 0], extinction[j, 0])
        held = [extinction[k, 0] * rings.volume[k] for k in (i, j)]
        if lit and min(held) > 0.0 and thick < 0.05 and min(there[0], back[0]) > 0.0:
            seen = max(there[0] / extinction[i, 0], back[0] / extinction[j, 0]) / rings.size[[i, j]].min()
            if seen < 1e-3:  # a cell that covers more of the sky is no point
                assert there[0] / held[0] == pytest.approx(back[0] / held[1], rel=0.01)
                compared += 1
    if air.air + air.aerosol < 0.05:
        assert compared


@pytest.mark.slow
@FEW
@given(airs, suns)
def test_null_effects_are_exact(air, sun):
    """What is there in name only changes nothing, to the last bit."""
    plain = medium_of(replace(air, aerosol=0.0, ground=0.0), refractivity=0.0)
    without = replace(plain, aerosol_phase_fraction=plain.aerosol_phase_fraction[:0], phase_functions=())
    expected = sky(plain, sun)
    np.testing.assert_allclose(sky(without, sun), expected, rtol=1e-6)
    straight = {"refraction": False, "bent_lines_of_sight": False, "bent_paths": False}
    off = sky(replace(plain, refractivity=medium_of(air).refractivity), sun, **straight)
    assert np.array_equal(off, sky(plain, sun, **straight))
    np.testing.assert_allclose(expected, off, rtol=1e-6, atol=1e-30)


@pytest.mark.parametrize("name", spectrum.solar_spectra())
@pytest.mark.parametrize("distance_au", [0.9833, 1.0, 1.0167])
def test_a_white_sky_is_as_bright_as_the_sun_outside_the_air(name, distance_au):
    """All the sunlight, spread evenly over the hemisphere (1 / pi of F0 everywhere), lights the ground as the sun in
    the zenith would: 133.3 klx at 1 au (Darula, Kittler, Gueymard 2005), 1 / distance^2 of that elsewhere."""
    elevation, azimuth = texture_grid(3.0)
    wavelength_nm = np.arange(380.0, 781.0, 10.0)
    even = np.full((elevation.size, azimuth.size, wavelength_nm.size), 1.0 / np.pi)
    fields = {"sun_elevation_deg": 30.0, "distance_au": distance_au, "solar_spectrum": name}
    sky = Sky(wavelength_nm, elevation, azimuth, even, **fields)
    # the five spectra lie between 133.10 and 134.24 klx
    assert sky.illuminance_lux() == pytest.approx(133.3e3 / distance_au**2, rel=0.008)
