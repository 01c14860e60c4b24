"""What is computed at one wavelength does not depend on which others are asked for."""

from dataclasses import replace

import numpy as np
import pytest
from stability_media import Air, medium_of

from twilight.config.load import load_climate
from twilight.engine.solve import Problem
from twilight.scene.medium import climate_medium
from twilight.solvers import zones
from twilight.transport.profile import expected_factors, prepare_profile

WAVELENGTH_NM = np.array([300.0, 550.0, 700.0, 1000.0])
SUNS_DEG = (30.0, 0.0, -4.0, -9.0)
ELEVATION_DEG, AZIMUTH_DEG = np.array([1.0, 5.0, 20.0, 90.0, 2.0]), np.array([0.0, 0.0, 40.0, 0.0, 180.0])
LEAST, MOST = 5e-4, 3e-3
"""What 90 % of the directions and suns stay below, and all of them: tables of the sunbeam are laid out for the most
refracted wavelength and up to 1 % off for others where it grazes a layer, which a node in the shadow's edge may see."""


def sky(medium, settings):
    """Radiance (suns, directions, W)."""
    problem = Problem(medium, zones, settings, sun_elevations_deg=SUNS_DEG)
    solved = problem.solve()
    return np.array([solved.radiance(sun, ELEVATION_DEG, AZIMUTH_DEG) for sun in SUNS_DEG])


def compare(climate, settings, wavelength_nm=WAVELENGTH_NM):
    medium = climate_medium(load_climate(climate), wavelength_nm)
    together = sky(medium, settings)
    for w in range(medium.n_wavelengths):
        alone = sky(medium.select(slice(w, w + 1)), settings)[..., 0]
        lit = alone > 1e-12
        moved = np.abs(together[..., w] / np.where(lit, alone, 1.0) - 1.0)[lit]
        assert np.percentile(moved, 90) < LEAST, f"{wavelength_nm[w]} nm: {np.sort(moved)[-4:]}"
        assert moved.max() < MOST, f"{wavelength_nm[w]} nm: {moved.max():.2e}"


def test_neighbours_do_not_move_a_wavelength_in_three_events():
    few = replace(zones.QUALITIES["draft"], max_events=3, tolerance=0.0)
    compare("continental-average", few, WAVELENGTH_NM[1:])


@pytest.mark.slow
@pytest.mark.ci
def test_neighbours_do_not_move_a_wavelength_at_draft():
    compare("continental-average", zones.QUALITIES["draft"])


@pytest.mark.slow
@pytest.mark.parametrize("climate", ["continental-average", "urban", "desert"])
def test_neighbours_do_not_move_a_wavelength(climate):
    compare(climate, zones.QUALITIES["standard"])


def test_only_wavelengths_that_need_other_grids_are_solved_apart():
    """From 360 nm on they share their grids; ozone is thick at 300 nm, less so at 330 nm."""
    medium = climate_medium(load_climate("continental-average"), np.array([300.0, 330.0, 360.0, 450.0, 550.0, 700.0]))
    problem = Problem(medium, zones, zones.QUALITIES["draft"])
    assert problem.slices == [slice(0, 1), slice(1, 2), slice(2, 6)]
    # a file holds one field
    kept = Problem(medium, zones, replace(zones.QUALITIES["draft"], field_file="field.h5"))
    assert kept.slices == [slice(0, 6)]


def test_steps_follow_the_air_where_it_is_thicker_than_they_are_made_for():
    profile = prepare_profile(medium_of(Air(aerosol=1.0), Air(aerosol=20.0)))
    assert expected_factors(profile.altitude_km, profile.extinction[:, 0]) == (4.0, 1.0)
    assert expected_factors(profile.altitude_km, profile.extinction[:, 1]) is None
    assert np.all(profile.thickest_per_km >= profile.extinction.max(axis=1))
