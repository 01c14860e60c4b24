"""Light that the fitted model carries over the spectrum, beside light that is solved at every wavelength."""

from dataclasses import replace

import numpy as np
import pytest

from twilight.base.errors import TwilightError
from twilight.config import load
from twilight.engine import plan, problem, solve
from twilight.engine.carried import carriers, choose_nodes, weights
from twilight.engine.problem import full_cost, n_nodes
from twilight.scene import resolve

SMALL = {
    "degree": 4, "max_degree": 4, "polar_directions": 4, "azimuth_directions": 5, "late_degree": 3,
    "late_polar_directions": 4, "late_azimuth_directions": 4, "altitude_density": 0.3, "zenith_density": 0.4,
    "step_density": 0.3, "first_order_step_density": 0.5, "line_of_sight_density": 0.5, "beam_density": 0.4,
    "polarisation_degree": 4, "late_polarisation_degree": 3,
}  # fmt: skip
"""Options that solve a field in a second."""
SUNS_DEG = (30.0, 0.0, -6.0)
ELEVATION_DEG, AZIMUTH_DEG = (a.ravel() for a in np.meshgrid([2.0, 15.0, 70.0], [0.0, 60.0, 180.0]))
VISIBLE_NM = np.linspace(400.0, 680.0, 29)
IN_BANDS_NM = (690.0, 720.0, 730.0, 762.0, 820.0, 900.0, 940.0, 980.0)


def scene_of(climate, wavelength_nm, spectrum="auto", **sections):
    solver = {"quality": "draft", "polarisation": True, "expert": SMALL | {"spectrum": spectrum}}
    nm = {"list_nm": [float(w) for w in wavelength_nm]}
    return resolve(load(climate, {"solver": solver, "wavelengths": nm} | sections))


def added(climate, wavelength_nm):
    """(relative error of radiance, of Q and U over I, what the field says) of carried light."""
    suns = dict(sun_elevations_deg=SUNS_DEG, cached=False)
    field = solve(scene_of(climate, wavelength_nm), **suns)
    old = solve(scene_of(climate, wavelength_nm, "solved"), **suns)
    assert n_nodes(field.problem) > 0 and n_nodes(old.problem) == 0
    one, other = (np.stack([f.stokes(s, ELEVATION_DEG, AZIMUTH_DEG) for s in SUNS_DEG]) for f in (field, old))
    said = max(block.field.convergence.interpolation_error for block in field.blocks)
    return (
        np.abs(one[..., 0, :] / other[..., 0, :] - 1.0),
        np.abs(one[..., 1:, :] / one[..., :1, :] - other[..., 1:, :] / other[..., :1, :]),
        said,
    )


def test_between_bands_it_is_near_and_says_how_near():
    """Carried wavelengths would be off by more than draft itself, or a field would not know by how much."""
    error, of_polarisation, said = added("pure-air", VISIBLE_NM)
    assert np.percentile(error, 95) < 0.004 and np.percentile(of_polarisation, 95) < 0.002
    assert 0.3 * np.percentile(error, 95) < said < 0.02


def test_in_bands_it_is_near_and_says_how_near():
    """Water's strong band absorbs all but a thousandth; oxygen absorbs high up."""
    error, of_polarisation, said = added("pure-air", IN_BANDS_NM)
    assert np.percentile(error, 95) < 0.004 and np.percentile(of_polarisation, 95) < 0.002
    assert 0.3 * np.percentile(error, 95) < said < 0.02


def test_weights_are_exact_at_nodes_and_keep_levels_and_slopes():
    """A term would not have the light of its own node, or what is the same everywhere or linear would be bent."""
    draw = np.random.default_rng(3)
    nodes, at = draw.normal(size=(20, 3)), draw.normal(size=(50, 3))
    plane = np.array([0.3, -2.0, 1.0])
    found = weights(nodes, at)
    np.testing.assert_allclose(found.weight.sum(axis=0), 1.0)
    missed = (nodes @ plane) @ found.weight - at @ plane
    assert np.std(missed) < 0.1 * np.std(at @ plane)
    np.testing.assert_allclose(weights(nodes, nodes).weight, np.eye(20), atol=2e-3)
    alone = weights(np.delete(nodes, 7, axis=0), nodes[7:8])
    np.testing.assert_allclose(np.delete(found.without[:, 7], 7), alone.weight[:, 0], atol=0.02)
    assert found.left_out[7] == pytest.approx(alone.deviation[0], rel=0.05)


def test_nodes_are_few_and_lie_where_light_is():
    """A black term would take a node from a bright one, or nodes would not fill the blocks that solvers compute."""
    line = np.stack([np.linspace(0.0, 2.0, 33), np.zeros(33), np.zeros(33)], axis=1)
    bright = choose_nodes(line, np.where(line[:, 0] < 1.4, 1.0, 1e-6))
    assert bright.size == 8 and line[bright, 0].max() <= 1.5
    assert choose_nodes(9.0 * np.random.default_rng(1).normal(size=(400, 3)), np.ones(400)) is None


def test_one_block_serves_eight_wavelengths_in_bands():
    """Some thirty terms would cost four blocks."""
    scene = scene_of("pure-air", IN_BANDS_NM)
    assert scene.bands.weight.size > 24 and n_nodes(plan(scene, SUNS_DEG)) == 8


def test_few_wavelengths_and_what_the_model_lacks_are_solved():
    """A few would be carried, or air, observers, suns and orders that the model was not fitted to."""
    few = plan(scene_of("pure-air", VISIBLE_NM[:8]))
    single = scene_of("pure-air", VISIBLE_NM)
    low = plan(single, (-20.0,))
    high = plan(scene_of("pure-air", VISIBLE_NM, observer={"altitude_km": 2.0}))
    single = plan(replace(single, settings=replace(single.settings, max_orders=1)))
    for planned in (few, single, low, high):
        assert not any(planned.carriers)
    dark = scene_of("pure-air", [float(w) for w in range(300, 319)])
    assert not any(carriers(dark.medium, dark.bands, 0.0))


def test_views_of_the_sky_alone_are_carried():
    """A panorama would take as long as all its wavelengths, or ground be made up."""
    for kind, carried in (("panorama", True), ("perspective", False)):
        scene = scene_of("pure-air", VISIBLE_NM, observer={"view": {"kind": kind, "width": 64}})
        assert any(plan(scene).carriers) == carried


def test_below_the_horizon_and_low_suns_are_solved_when_they_are_asked_for():
    """The fitted model has no ground and no sun below -18 deg; both would be refused or made up."""
    field = solve(scene_of("pure-air", VISIBLE_NM[::2]), cached=False)
    old = solve(scene_of("pure-air", VISIBLE_NM[::2], "solved"), cached=False)
    assert n_nodes(field.problem)
    for question in ((5.0, [-30.0, 20.0], [0.0, 90.0]), (-19.0, [10.0], [0.0]), (5.0, [10.0], [0.0], 3.0)):
        np.testing.assert_array_equal(field.radiance(*question), old.radiance(*question))
    np.testing.assert_array_equal(field.inscatter(5.0, 10.0, 0.0, 20.0), old.inscatter(5.0, 10.0, 0.0, 20.0))


def test_blocks_share_their_nodes_and_the_cache_keeps_them(tmp_path, monkeypatch):
    """Every block would solve the nodes anew, or another set of wavelengths be taken for this one."""
    monkeypatch.setenv("TWILIGHT_CACHE_DIR", str(tmp_path))
    monkeypatch.setenv("TWILIGHT_CACHE_GB", "1")
    monkeypatch.setattr(problem, "CARRIED_AT_ONCE", 16)
    scene = scene_of("pure-air", VISIBLE_NM)
    first, again = solve(scene, SUNS_DEG), solve(scene, SUNS_DEG)
    assert len(first.blocks) == 2 and again.blocks[0].from_disk and len(list(tmp_path.rglob("*.h5"))) == 1
    question = (-6.0, ELEVATION_DEG, AZIMUTH_DEG)
    np.testing.assert_array_equal(first.radiance(*question), again.radiance(*question))
    assert len({*first.keys, *solve(scene_of("pure-air", VISIBLE_NM[:-1]), SUNS_DEG).keys}) > len(first.keys)


def test_a_plan_knows_of_it():
    """A plan would say minutes for what takes seconds."""
    auto, solved = (full_cost(scene_of("pure-air", np.linspace(400.0, 580.0, 81), how)) for how in ("auto", "solved"))
    assert auto.solved == 8 and solved.solved == 0 and auto.cpu_s < solved.cpu_s


@pytest.mark.parametrize("ground", [0.0, 0.3])
def test_the_ground_has_the_albedo_of_its_wavelength(ground):
    """Light of the ground would be that of the nodes' albedos."""
    scene = scene_of("pure-air", VISIBLE_NM)
    albedo = ground * np.linspace(0.5, 1.0, VISIBLE_NM.size)
    scene = replace(scene, medium=replace(scene.medium, ground_albedo=albedo))
    solved = replace(scene, settings=replace(scene.settings, spectrum="solved"))
    new, old = (solve(one, (30.0,), cached=False).radiance(30.0, ELEVATION_DEG, AZIMUTH_DEG) for one in (scene, solved))
    assert np.percentile(np.abs(new / old - 1.0), 95) < 0.003


def test_the_judge_takes_it_when_asked_alone():
    """A reference solution would stand on the fitted model unasked, or its standard errors be lost."""
    nm = {"list_nm": VISIBLE_NM[::2].tolist()}
    solver = {"name": "montecarlo", "target_stderr": None, "samples": 16}
    scene = resolve(load("pure-air", {"solver": solver, "wavelengths": nm}))
    assert not any(plan(scene).carriers)
    carried = {"solver": solver | {"expert": {"spectrum": "carried", "importance_sweeps": 2}}, "wavelengths": nm}
    field = solve(resolve(load("pure-air", carried)), cached=False)
    radiance, error = field.radiance_with_error(-2.0, [20.0], [40.0])
    assert n_nodes(field.problem) == 8 and (error > 0.0).all()
    assert (error < 0.3 * radiance).all()
    high = resolve(load("pure-air", carried | {"observer": {"altitude_km": 40}}))
    with pytest.raises(TwilightError, match=r"solver\.expert\.spectrum: the fitted model"):
        plan(high).carriers  # noqa: B018
    cut = resolve(load("pure-air", carried | {"solver": carried["solver"] | {"max_orders": 2}}))
    with pytest.raises(TwilightError, match="all orders"):
        solve(cut)
