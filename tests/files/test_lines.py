"""Lines of sight by Runge-Kutta steps against the layered ray tracer, closed forms and optical depths."""

from dataclasses import replace

import numpy as np
import pytest
from airs import on_levels
from bent_rays import trace_ray
from stability_media import Air, medium_of

from twilight.atmosphere.build import build_medium
from twilight.transport.lines import DISTANCE, END_ANGLE, END_COSINE, GROUND, OUT, new_line, trace_line, with_refraction
from twilight.transport.profile import prepare_profile


@pytest.fixture(scope="module")
def air():
    medium = build_medium(np.array([450.0, 550.0, 680.0]), aerosol=None)
    profile = prepare_profile(medium)
    return medium, profile


def follow(air, altitude_km, elevation_deg, *, bent=True, fineness=2.0):
    medium, profile = air
    if bent:
        profile = with_refraction(profile, medium)
    line = new_line(profile)
    n, status = trace_line(profile, altitude_km, np.sin(np.radians(elevation_deg)), fineness, False, line)
    return n, status, line


@pytest.mark.parametrize("elevation_deg", [0.0, 0.5, 1.5, 5.0, 30.0, 90.0])
def test_a_bent_line_is_that_of_the_ray_tracer(air, elevation_deg):
    """Lines of sight and rays of the sun would refract differently."""
    medium = air[0]
    _, status, line = follow(air, 0.0, elevation_deg)
    ray = trace_ray(medium, 0.0, 90.0 - elevation_deg, wavelength=1)
    assert status == OUT
    assert line.end[END_ANGLE] == pytest.approx(np.radians(ray.geocentric_angle_deg[-1]), abs=2e-5)
    assert line.end[END_COSINE] == pytest.approx(np.cos(np.radians(ray.zenith_deg[-1])), abs=2e-6)
    assert -np.log(line.transmittance[1]) == pytest.approx(ray.optical_depth[-1], rel=3e-4)


@pytest.mark.parametrize("elevation_deg", [-3.0, 0.0, 2.0, 40.0])
def test_the_invariant_of_refraction_is_kept_along_the_line(air, elevation_deg):
    """A refracted line would drift off Bouguer's invariant."""
    medium = air[0]
    n, _, line = follow(air, 20.0, elevation_deg)
    z, cosine = line.place[:n, 0], line.place[:n, 2]
    index = 1.0 + medium.at(z).refractivity[:, 1]
    invariant = index * (medium.earth_radius_km + z) * np.sqrt(1.0 - cosine**2)
    start = (
        (1.0 + medium.at(20.0).refractivity[1]) * (medium.earth_radius_km + 20.0) * np.cos(np.radians(elevation_deg))
    )
    # merged points average two places of a step
    np.testing.assert_allclose(invariant, start, rtol=3e-6, atol=0.02)


def test_a_straight_line_is_a_chord(air):
    """A line in air with n = 1 would bend."""
    medium = air[0]
    n, status, line = follow(air, 50.0, -6.0, bent=False)
    radius = medium.earth_radius_km
    assert status == OUT
    z, psi = line.place[:n, 0], line.place[:n, 1]
    # radius x cos(angle from the lowest point) is the same everywhere
    lowest = (radius + 50.0) * np.cos(np.radians(6.0))
    np.testing.assert_allclose((radius + z) * np.cos(psi - np.radians(6.0)), lowest, rtol=1e-6)


def test_lines_that_meet_the_ground_or_miss_the_air(air):
    """A line would end on the wrong side of the horizon."""
    _, status, line = follow(air, 10.0, -30.0, bent=False)
    assert status == GROUND
    radius = air[0].earth_radius_km
    expected = np.arcsin((radius + 10.0) / radius * np.sin(np.radians(120.0))) - np.radians(60.0)
    assert line.end[END_ANGLE] == pytest.approx(expected, abs=1e-7)
    assert follow(air, 0.0, -1.0)[:2] == (0, GROUND)
    assert follow(air, 400.0, 10.0)[:2] == (0, OUT)
    assert follow(air, 400.0, -15.0)[:2] == (0, OUT)
    assert follow(air, 400.0, -90.0)[1] == GROUND


@pytest.mark.parametrize("elevation_deg", [0.0, 10.0, 90.0])
def test_scattering_and_what_is_left_add_up_without_absorption(air, elevation_deg):
    """Energy would be lost along a line of sight."""
    medium = replace(air[0], absorption_per_km=np.zeros_like(air[0].absorption_per_km))
    profile = prepare_profile(medium)
    n, _, line = follow((medium, profile), 0.0, elevation_deg)
    np.testing.assert_allclose(line.weight[:n].sum(axis=0) + line.transmittance, 1.0, rtol=2e-4)


def test_index_that_jumps_between_layers_bends_a_line_as_the_smooth_one_does(air):
    """Layers would reflect lines of sight at their edges."""
    medium = air[0]
    edges = np.linspace(0.0, 100.0, 101)
    z = np.repeat(edges, 2)[1:-1]
    middle = np.repeat(0.5 * (edges[1:] + edges[:-1]), 2)
    stepped = on_levels(medium, z, middle)
    profile = prepare_profile(stepped)
    smooth, layered = follow(air, 0.0, 1.0)[2], follow((stepped, profile), 0.0, 1.0)[2]
    straight = follow(air, 0.0, 1.0, bent=False)[2]
    bending = smooth.end[END_ANGLE] - straight.end[END_ANGLE]
    assert bending > 0.005
    assert layered.end[END_ANGLE] - straight.end[END_ANGLE] == pytest.approx(bending, rel=0.03)


def test_light_from_behind_black_air_does_not_depend_on_clearer_air_beside_it():
    """Lines would end behind 25 optical depths where a wavelength is alone."""
    clear, thick = Air(aerosol=0.5), Air(aerosol=1.0, ozone=2.0)
    seen = []
    for airs in ((thick,), (thick, clear)):
        profile = prepare_profile(medium_of(*airs))
        line = new_line(profile)
        n, _ = trace_line(profile, 0.0, 0.0, 1.0, False, line)
        distance = line.place[:n, DISTANCE]
        near = distance < 60.0
        seen.append(float(line.weight[:n, 0][near] @ np.exp(distance[near] / 1.7)))
    assert seen[0] == pytest.approx(seen[1], rel=2e-3)


def test_no_step_is_left_out_because_all_of_the_air_is_thin():
    """Very thin air would scatter no light."""
    counts = []
    for depth in (1e-3, 1e-13):
        profile = prepare_profile(medium_of(Air(air=depth, aerosol=0.0)))
        counts.append(trace_line(profile, 0.0, 0.5, 1.0, False, new_line(profile))[0])
    assert counts[0] == counts[1] > 0
