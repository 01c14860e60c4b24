"""Light interpolated over the spectrum, beside light that is solved at every wavelength."""

from dataclasses import replace

import numpy as np
import pytest

from twilight.atmosphere.grid_medium import GridMedium
from twilight.config import load
from twilight.engine import plan, problem, solve
from twilight.engine.problem import full_cost
from twilight.scene import resolve
from twilight.solvers import zones
from twilight.solvers.zones.spectrum import STATED_ERROR, STATED_ERROR_IN_BANDS, choose_nodes, kriging_weights
from twilight.transport.beam import prepare_beam, traced_wavelengths
from twilight.transport.beam_lookup import beam_at

SMALL = {
    "degree": 4, "max_degree": 4, "polar_directions": 4, "azimuth_directions": 5, "late_degree": 3,
    "late_polar_directions": 4, "late_azimuth_directions": 4, "altitude_density": 0.3, "zenith_density": 0.4,
    "step_density": 0.3, "first_order_step_density": 0.5, "line_of_sight_density": 0.5, "beam_density": 0.4,
    "polarisation_degree": 4, "late_polarisation_degree": 3,
}  # fmt: skip
"""Options that solve a field in a second."""
SUNS_DEG = (30.0, 0.0, -6.0)
ELEVATION_DEG, AZIMUTH_DEG = (a.ravel() for a in np.meshgrid([2.0, 15.0, 70.0], [0.0, 60.0, 180.0]))


def scene_of(climate, wavelength_nm, option="auto"):
    solver = {"quality": "draft", "polarisation": True, "expert": SMALL | {"spectral_interpolation": option}}
    return resolve(load(climate, {"solver": solver, "wavelengths": {"list_nm": [float(w) for w in wavelength_nm]}}))


def stokes(scene, wavelengths=None, interpolation=None):
    """Stokes parameters (suns, directions, 3, W) at some of the wavelengths."""
    index = np.arange(scene.medium.n_wavelengths) if wavelengths is None else np.asarray(wavelengths)
    medium, bands = scene.medium.select(index), scene.bands and scene.bands.select(index)
    field = zones.prepare(
        bands.expand(medium) if bands else medium, scene.settings, sun_elevations_deg=SUNS_DEG,
        interpolation=interpolation,
    )  # fmt: skip
    seen = np.stack([field.stokes(sun, ELEVATION_DEG, AZIMUTH_DEG) for sun in SUNS_DEG])
    return bands.sum_terms(seen) if bands else seen


def test_between_bands_it_is_as_near_as_stated():
    """Interpolated wavelengths would be worse than the plan says."""
    scene = scene_of("pure-air", np.linspace(400.0, 580.0, 49))
    one = plan(scene, SUNS_DEG).interpolations[0]
    assert 0 < one.n_nodes <= 24 and not one.in_band
    some = np.arange(1, 49, 6)
    assert not set(scene.medium.wavelength_nm[some]) <= set(one.medium.wavelength_nm)
    new, old = stokes(scene, some, one), stokes(scene, some)
    error = np.abs(new[..., 0, :] / old[..., 0, :] - 1.0)
    assert np.percentile(error, 95) < STATED_ERROR
    assert np.percentile(np.abs(new - old)[..., 1:, :] / old[..., :1, :], 95) < STATED_ERROR


@pytest.mark.slow
def test_in_bands_it_is_as_near_as_stated(tmp_path):
    """Among them is 937 nm, where the clearest term is darker than the grid of the range is made for."""
    nm = (688.0, 694.0, 720.0, 730.0, 762.0, 768.0, 820.0, 824.0, 900.0, 930.0, 937.0, 940.0, 970.0, 980.0, 990.0)
    scene = scene_of("pure-air", nm)
    one = plan(scene, SUNS_DEG).interpolations[0]
    assert one.in_band and one.n_nodes < scene.bands.weight.size
    some = np.array([3, 8, 12])
    new, old = stokes(scene, some, one), stokes(scene, some)
    error = np.abs(new[..., 0, :] / old[..., 0, :] - 1.0)
    assert np.percentile(error, 95) < STATED_ERROR_IN_BANDS
    dark = scene.bands.select(np.array([10])).expand(scene.medium.select(np.array([10])))
    field = zones.prepare(dark, scene.settings, sun_elevations_deg=SUNS_DEG, interpolation=one)
    field.save(tmp_path / "field.h5")
    question = (0.0, ELEVATION_DEG, AZIMUTH_DEG)
    np.testing.assert_array_equal(zones.load(tmp_path / "field.h5").stokes(*question), field.stokes(*question))


def test_of_grey_air_it_is_exact():
    """Air that is the same at every wavelength has light that is."""
    scene = scene_of("pure-air", [550.0])
    grey = replace(scene.medium.select(np.zeros(30, int)), wavelength_nm=np.linspace(400.0, 690.0, 30))
    scene = replace(scene, medium=replace(grey, grid_medium=GridMedium.of(scene.medium)))
    one = plan(scene, SUNS_DEG).interpolations[0]
    assert one.n_nodes < 30
    some = np.array([0, 7, 17])
    np.testing.assert_allclose(stokes(scene, some, one), stokes(scene, some), rtol=2e-5, atol=1e-12)


def test_weights_are_exact_at_nodes_and_give_planes():
    """What is linear in the logarithms of the optical properties, as thin air's light is, would be bent."""
    draw = np.random.default_rng(3)
    nodes, at = draw.normal(size=(20, 3)), draw.normal(size=(50, 3))
    plane = np.array([0.3, -2.0, 1.0])
    np.testing.assert_allclose((nodes @ plane + 4.0) @ kriging_weights(nodes, at), at @ plane + 4.0, atol=0.02)
    np.testing.assert_allclose(kriging_weights(nodes, nodes), np.eye(20), atol=1e-6)


def test_nodes_are_those_whose_light_counts():
    """A term that is all but black would take a node from one that is bright."""
    line = np.linspace(0.0, 1.0, 33)[:, None]
    bright = choose_nodes(line, np.where(line[:, 0] < 0.7, 1e-4, 1e6))
    assert bright.size % 8 == 0 and line[bright].max() <= 0.75


def test_terms_share_rays_and_their_sunbeam_is_that_of_each_alone():
    """Of terms of one wavelength few are traced; all light of each is that of tables of its own."""
    scene = scene_of("pure-air", [690.0, 720.0, 820.0, 940.0])
    terms = scene.bands.expand(scene.medium)
    traced, share = traced_wavelengths(terms)
    assert traced.size < terms.n_wavelengths and np.allclose(share.sum(axis=0), 1.0)
    few = {"cosine_nodes": 16, "distance_nodes": 8, "guess_nodes": 16}
    mixed, own = prepare_beam(terms, mixed=True, **few), prepare_beam(terms, **few)
    one, other = np.empty((2, terms.n_wavelengths))
    for altitude_km, zenith_deg in ((0.0, 30.0), (0.0, 89.0), (3.0, 91.0), (12.0, 92.5), (30.0, 94.0)):
        for beam, light in ((mixed, one), (own, other)):
            beam_at(beam, altitude_km, np.cos(np.radians(zenith_deg)), light)
        assert other.max() > 0.01
        np.testing.assert_allclose(scene.bands.sum_terms(one), scene.bands.sum_terms(other), rtol=1e-3)
        np.testing.assert_allclose(one[traced], other[traced], rtol=1e-10)


def test_one_interpolation_serves_all_ranges_and_bands():
    """Each range and the bands would be solved alone: 24 wavelengths' time for eight."""
    scene = scene_of("pure-air", np.linspace(330.0, 1000.0, 8))
    planned = plan(scene, SUNS_DEG)
    assert len(set(planned._groups)) == 3 and len(set(map(id, planned.interpolations))) == 1
    assert planned.interpolations[0].n_nodes <= 16 and len(planned.slices) == 1


def test_few_wavelengths_and_off_are_solved_bit_for_bit_as_ever():
    """A few wavelengths would be interpolated."""
    few = plan(scene_of("pure-air", np.linspace(400.0, 580.0, 16)))
    off = plan(scene_of("pure-air", np.linspace(400.0, 580.0, 49), "off"))
    single = scene_of("pure-air", np.linspace(400.0, 580.0, 49))
    single = plan(replace(single, settings=replace(single.settings, max_orders=1)))
    for planned in (few, off, single):
        assert set(planned.interpolations) == {None}
    assert any(plan(scene_of("pure-air", np.linspace(400.0, 600.0, 41))).interpolations)


def test_blocks_of_the_engine_take_it_and_say_so(tmp_path, monkeypatch):
    """Interpolation would be lost in blocks, in the cache, or not be recorded."""
    monkeypatch.setenv("TWILIGHT_CACHE_DIR", str(tmp_path))
    monkeypatch.setenv("TWILIGHT_CACHE_GB", "1")
    monkeypatch.setattr(problem, "INTERPOLATED_AT_ONCE", 16)
    scene = scene_of("pure-air", np.linspace(400.0, 585.0, 38))
    first = solve(scene, SUNS_DEG)
    again = solve(scene, SUNS_DEG)
    off = solve(replace(scene, settings=replace(scene.settings, spectral_interpolation="off")), SUNS_DEG, cached=False)
    assert len(first.blocks) > 1 and all(block.from_disk for block in again.blocks)
    question = (-6.0, ELEVATION_DEG, AZIMUTH_DEG)
    seen, same, solved = (each.radiance(*question) for each in (first, again, off))
    np.testing.assert_array_equal(seen, same)
    assert 0.0 < np.abs(seen / solved - 1.0).max() and np.percentile(np.abs(seen / solved - 1.0), 95) < STATED_ERROR
    for block in (*first.blocks, *again.blocks):
        assert block.field.convergence.spectral_nodes == first.problem.interpolations[0].n_nodes
        assert block.field.convergence.interpolation_error == STATED_ERROR
    assert off.blocks[0].field.convergence.spectral_nodes is None


def test_a_plan_knows_of_it():
    """A plan would say minutes for what takes seconds."""
    wavelengths = np.linspace(400.0, 580.0, 81).tolist()
    scene = resolve(load("pure-air", {"solver": {"quality": "draft"}, "wavelengths": {"list_nm": wavelengths}}))

    def planned(option):
        return full_cost(replace(scene, settings=replace(scene.settings, spectral_interpolation=option)))

    auto, off = planned("auto"), planned("off")
    assert auto.solved > 0 and off.solved == 0 and auto.cpu_s < 0.9 * off.cpu_s


@pytest.mark.parametrize("ground", [0.0, 0.3])
def test_the_ground_has_the_albedo_of_its_wavelength(ground):
    """Light of the ground would be that of the nodes' albedos."""
    scene = scene_of("pure-air", np.linspace(400.0, 580.0, 49))
    albedo = ground * np.linspace(0.5, 1.0, 49)
    scene = replace(scene, medium=replace(scene.medium, ground_albedo=albedo))
    one = plan(scene, SUNS_DEG).interpolations[0]
    some = np.arange(2, 49, 9)
    new, old = stokes(scene, some, one)[..., 0, :], stokes(scene, some)[..., 0, :]
    assert np.percentile(np.abs(new / old - 1.0), 95) < STATED_ERROR
