"""The compact sky: its file, its evaluation, and its fit to skies that are known."""

from __future__ import annotations

import json
import subprocess
import sys
from dataclasses import replace
from importlib import resources
from pathlib import Path

import numpy as np
import pytest
from scipy.interpolate import BSpline, CubicSpline

from twilight.base.errors import TwilightError
from twilight.config import load
from twilight.solvers.compact import compact_sky
from twilight.solvers.compact.compact_sky import CompactSky, CompactSkyError, SkySplines, spline_matrix
from twilight.studies.fit.compact import build, training

GRID = SkySplines(
    elevation_intervals=12, azimuth_intervals=8, angle_intervals=10, elevation_power=2.0, angle_scale_deg=2.0
)
REFERENCE_DU = 334.3453955433108
"""Ozone column of the climate's profile."""
SUNS = (-18.0, -15.0, -12.0, -9.0, -6.0, -3.0, 0.0, 5.0, 15.0, 30.0, 50.0, 90.0)


def toy_sky(sun, e, a, wavelength, air):
    """A radiance factor (D, W) that is smooth in all it depends on, with a glow around the sun and a ground."""
    sun_rad, e_rad = np.radians(sun), np.radians(e)
    cosine = np.sin(sun_rad) * np.sin(e_rad) + np.cos(sun_rad) * np.cos(e_rad) * np.cos(np.radians(a))
    angle = np.degrees(np.arccos(np.clip(cosine, -1.0, 1.0)))
    x = wavelength / 500.0
    shape = (-4.0 * np.log1p(np.exp(-0.2 * (sun + 2.0))) - 0.3 * np.sin(e_rad))[:, None] - 3.0 * np.log(x)
    glow = np.log1p(30.0 * air.optical_depth_550nm * np.exp(-angle / 12.0))[:, None] * np.ones_like(x)
    ozone = 1.0 if air.ozone_column_du is None else air.ozone_column_du / REFERENCE_DU
    dark = np.exp(shape + glow - 0.2 * (ozone - 1.0))
    r = toy_returned(wavelength, air.optical_depth_550nm)
    ground = 0.2 * np.exp(shape - 0.2 * (ozone - 1.0) - 0.1 * np.cos(e_rad)[:, None])
    return dark + air.ground_albedo / (1.0 - air.ground_albedo * r) * ground


def toy_returned(wavelength, depth):
    return 0.1 * (wavelength / 500.0) ** -3.0 + 0.05 * depth


def toy_compute(config, solver, settings, air, wavelength_nm, suns, directions, progress=None):
    if progress:
        progress("toy", 0.5)
    wavelength, suns = np.asarray(wavelength_nm, float), np.asarray(suns, float)
    where = [directions(float(sun)) for sun in suns]
    elevation, azimuth = (tuple(w[i] for w in where) for i in (0, 1))
    radiance = tuple(toy_sky(sun, e, a, wavelength, air) for sun, (e, a) in zip(suns, where, strict=True))
    return training.Skies(air, wavelength, suns, elevation, azimuth, radiance)


@pytest.fixture(scope="module")
def toy():
    """A fit to the toy sky."""
    patch = pytest.MonkeyPatch()
    patch.setattr(build, "compute_skies", toy_compute)
    patch.setattr(training, "compute_skies", toy_compute)
    patch.setattr(training, "SUNS_DEG", SUNS)
    patch.setattr(build, "GRID", GRID)
    patch.setattr(build, "GROUND_SUNS", 1)
    reported = []
    yield build.fit_compact(load("continental-average"), progress=lambda _, part: reported.append(part)), reported
    patch.undo()


@pytest.fixture(scope="module")
def shipped():
    return CompactSky.load(Path(str(resources.files("twilight"))) / "data/compact/continental-average.npz")


def test_splines_over_the_sky_are_those_of_scipy():
    rng = np.random.default_rng(1)
    e, a = rng.uniform(0.0, 90.0, 50), rng.uniform(-180.0, 540.0, 50)
    index, value = GRID.splines(20.0, e, a)
    assert index.min() >= 0 and index.max() < GRID.size
    assert value.sum(axis=0) == pytest.approx(2.0)  # both sets sum to 1
    coefficients = rng.normal(size=GRID.size)
    got = np.sum(value * coefficients[index], axis=0)
    n_e, n_a, n_t = GRID.elevation_intervals, GRID.azimuth_intervals, GRID.angle_intervals
    table = coefficients[: (n_e + 3) * (n_a + 1)].reshape(n_e + 3, n_a + 1)
    mirrored = np.concatenate([table[:, 1:2], table, table[:, -2:-1]], axis=1)
    folded = np.abs(np.mod(a + 180.0, 360.0) - 180.0)
    by_row = BSpline(np.arange(-3, n_e + 4), mirrored, 3)(np.sqrt(e / 90.0) * n_e)
    expected = [
        float(BSpline(np.arange(-3, n_a + 4), row, 3)(x / 180.0 * n_a)) for row, x in zip(by_row, folded, strict=True)
    ]
    cosine = np.sin(np.radians(e)) * np.sin(np.radians(20.0))
    cosine += np.cos(np.radians(e)) * np.cos(np.radians(20.0)) * np.cos(np.radians(a))
    angle = np.degrees(np.arccos(np.clip(cosine, -1.0, 1.0)))
    ring = np.log1p(angle / 2.0) / np.log1p(90.0) * n_t
    expected += BSpline(np.arange(-3, n_t + 4), coefficients[-(n_t + 3) :], 3)(ring)
    assert got == pytest.approx(expected, abs=1e-9)


@pytest.mark.parametrize("n", [1, 2, 3, 4, 5, 9])
def test_the_spline_between_nodes_is_not_a_knot(n):
    nodes = np.cumsum(np.random.default_rng(n).uniform(0.5, 2.0, n))
    values = np.random.default_rng(0).normal(size=n)
    x = np.linspace(nodes[0], nodes[-1], 40)
    got = spline_matrix(nodes, x) @ values
    if n < 4:
        expected = np.polyval(np.polyfit(nodes, values, n - 1), x)
    else:
        expected = CubicSpline(nodes, values)(x)
    assert got == pytest.approx(expected, abs=1e-9)


def test_a_fit_finds_the_sky_it_was_made_of(toy):
    fit, reported = toy
    whole = next(e for e in fit.errors if e.part == "all" and e.sun_elevation_deg == (-18.0, 90.0))
    assert whole.median < 0.004 and whole.p95 < 0.02
    assert reported == sorted(reported) and reported[-1] <= 1.0


def test_a_fit_finds_what_the_air_sends_back_to_the_ground(toy):
    model = toy[0].model
    truth = toy_returned(model.wavelength_nm[:, None], model.optical_depth_550nm[None])
    assert model.returned == pytest.approx(truth, abs=2e-3)


def test_light_of_the_ground_and_ozone_are_there(toy):
    model = toy[0].model
    e, a = np.array([5.0, 40.0]), np.array([30.0, 100.0])
    for air in (training.TrainingAir(0.15, 0.8), training.TrainingAir(0.15, 0.0, 0.7 * REFERENCE_DU)):
        sky = model.sky(20.0, [450.0, 600.0], air.optical_depth_550nm, air.ground_albedo, air.ozone_column_du)
        assert sky.radiance(e, a) == pytest.approx(toy_sky(20.0, e, a, np.array([450.0, 600.0]), air), rel=0.02)


def test_a_file_gives_the_same_sky_and_says_what_it_is(toy, tmp_path):
    model = toy[0].model
    path = tmp_path / "model.npz"
    size = build.write_model(model, path)
    assert size == path.stat().st_size
    again = CompactSky.load(path)
    skies = [m.sky(-3.3, [400.0, 555.5], 0.07, [0.1, 0.3], 300.0) for m in (model, again)]
    assert np.array_equal(*(sky.radiance([3.0, 80.0], [10.0, 170.0]) for sky in skies))
    with np.load(path, allow_pickle=False) as data:
        assert "radiance factor" in str(data["documentation"])
        facts = json.loads(str(data["provenance"]))
        for name in data.files:  # every array is explained
            assert name.partition("_")[0] in str(data["documentation"])
    assert facts["climate"] == "continental-average" and facts["hash"]
    assert facts["errors_of_held_out_skies"][0]["median"] == pytest.approx(toy[0].errors[0].median, abs=1e-5)


ALONE = """
import sys
class Only:
    def find_spec(self, name, path=None, target=None):
        top = name.partition(".")[0]
        if top not in sys.stdlib_module_names and top not in ("numpy", "compact"):
            raise ImportError(f"{name} is not here")
sys.meta_path.insert(0, Only())
import compact
import numpy as np
model = compact.CompactSky.load(sys.argv[1])
sky = model.sky(-4.3, [431.5, 555.0, 702.0], 0.123, 0.3, 300.0)
np.save(sys.argv[2], sky.radiance(np.linspace(0.0, 90.0, 50), np.linspace(0.0, 360.0, 50)))
"""


def test_the_file_alone_with_numpy_alone_gives_the_same(shipped, tmp_path):
    (tmp_path / "compact.py").write_text(Path(compact_sky.__file__).read_text(encoding="utf-8"), encoding="utf-8")
    (tmp_path / "alone.py").write_text(ALONE, encoding="utf-8")
    build.write_model(shipped, tmp_path / "model.npz")
    done = subprocess.run(
        [sys.executable, "alone.py", "model.npz", "out.npy"], cwd=tmp_path, capture_output=True, text=True
    )
    assert done.returncode == 0, done.stderr
    here = shipped.sky(-4.3, [431.5, 555.0, 702.0], 0.123, 0.3, 300.0)
    here = here.radiance(np.linspace(0.0, 90.0, 50), np.linspace(0.0, 360.0, 50))
    assert np.load(tmp_path / "out.npy") == pytest.approx(here, rel=1e-12)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"sun_elevation_deg": -18.5}, "sun_elevation_deg is -18.5; allowed is -18 to 90 deg"),
        ({"sun_elevation_deg": float("nan")}, "sun_elevation_deg is nan"),
        ({"wavelength_nm": [500.0, 900.0]}, "wavelength_nm is 900; allowed is 380 to 740 nm"),
        ({"optical_depth_550nm": 3.0}, "optical_depth_550nm is 3; allowed is 0.01 to 0.8"),
        ({"ground_albedo": 1.5}, "ground_albedo is 1.5; allowed is 0 to 1"),
        ({"ground_albedo": [0.1, 0.2, 0.3]}, "ground_albedo has 3 values for 1 wavelengths"),
        ({"ozone_column_du": 1000.0}, r"ozone_column_du is 1000; allowed is 200\.6"),
    ],
)
def test_what_the_model_does_not_hold_is_refused_in_a_sentence(shipped, changes, words):
    wanted = {"sun_elevation_deg": 5.0, "wavelength_nm": 500.0, "optical_depth_550nm": 0.1} | changes
    with pytest.raises(CompactSkyError, match=words) as caught:
        shipped.sky(**wanted)
    assert "\n" not in str(caught.value)


def test_directions_below_the_horizon_are_refused(shipped):
    sky = shipped.sky(5.0, 500.0, 0.1)
    with pytest.raises(CompactSkyError, match="elevation_deg is -1; allowed is 0 to 90 deg"):
        sky.radiance([10.0, -1.0], 0.0)
    with pytest.raises(CompactSkyError, match="azimuth_deg must be finite"):
        sky.radiance(10.0, float("inf"))


def test_files_that_are_no_model_are_refused_in_a_sentence(shipped, tmp_path):
    (tmp_path / "text.npz").write_text("not a model")
    np.savez(tmp_path / "other.npz", format="something else")
    arrays = shipped.arrays()
    np.savez(tmp_path / "cut.npz", **(arrays | {"dark_sun": arrays["dark_sun"][:, :-1]}))
    build.write_model(shipped, tmp_path / "whole.npz")
    (tmp_path / "torn.npz").write_bytes((tmp_path / "whole.npz").read_bytes()[:5000])
    for name, words in (
        ("text.npz", "is not a compact sky"),
        ("other.npz", "is not a compact sky of format"),
        ("cut.npz", "the arrays dark_. do not fit together"),
        ("torn.npz", "is not a compact sky"),
        ("missing.npz", "cannot be read: No such file"),
    ):
        with pytest.raises(CompactSkyError, match=words) as caught:
            CompactSky.load(tmp_path / name)
        assert str(tmp_path / name) in str(caught.value)


def test_the_shipped_model_is_small_and_as_near_as_it_says(shipped):
    assert sum(array.nbytes for array in shipped.arrays().values()) < 3e6
    errors = {(tuple(e["sun_elevation_deg"]), e["part"]): e for e in shipped.provenance["errors_of_held_out_skies"]}
    assert errors[(-18.0, 90.0), "all"]["median"] < 0.02 and errors[(-18.0, 90.0), "all"]["p95"] < 0.05


def test_the_shipped_sky_behaves_like_one(shipped):
    e, a = np.meshgrid([0.0, 1.0, 5.0, 20.0, 60.0, 90.0], [0.0, 45.0, 120.0, 180.0], indexing="ij")
    nm = np.arange(380.0, 741.0, 20.0)
    for depth in (0.01, 0.15, 0.8):
        before = None
        for sun in np.linspace(-18.0, 90.0, 28):
            sky = shipped.sky(sun, nm, depth, 0.2)
            here = sky.radiance(e, a)
            assert np.isfinite(here).all() and (here > 0.0).all()
            assert here == pytest.approx(sky.radiance(e, -a), rel=1e-12)
            assert here[-1] == pytest.approx(np.broadcast_to(here[-1, :1], here[-1].shape), rel=0.02)  # one zenith
            assert (here < shipped.sky(sun, nm, depth, 0.6).radiance(e, a)).all()
            if before is not None and sun < 0.0:
                assert (here > before).all()
            before = here


def test_more_ozone_makes_twilight_bluer(shipped):
    little, much = (shipped.sky(-5.0, [450.0, 600.0], 0.1, 0.1, du).radiance(90.0, 0.0) for du in (250.0, 400.0))
    assert much[0] / much[1] > 1.3 * little[0] / little[1]


def test_a_climate_is_fitted_at_its_own_load_and_between_loads_of_haze_along_the_horizon():
    loads = training.optical_depths(load("urban"))
    depth = training.climate_medium(load("urban").climate, np.array([550.0])).optical_depth("aerosol")[0]
    assert depth in loads and 0.6 < depth < 0.7
    assert np.all(np.diff(loads) > 0.0) and (loads[0], loads[-1]) == (0.01, 0.8)
    near = load("urban", {"climate.aerosol.optical_depth_550nm": 0.51})
    assert 0.5 not in training.optical_depths(near) and len(training.optical_depths(near)) == 7
    # 20 air masses of haze, and haze that is all the light: 1.5 and 0.5 % at most between the loads
    between = np.geomspace(0.01, 0.8, 200)
    at = spline_matrix(
        np.log(np.array(training.OPTICAL_DEPTHS) + training.LOAD_OFFSET), np.log(between + training.LOAD_OFFSET)
    )
    for light, allowed in ((lambda depth: -20.0 * depth, 0.015), (lambda depth: np.log(0.02 + depth), 0.005)):
        assert np.abs(at @ light(np.array(training.OPTICAL_DEPTHS)) - light(between)).max() < allowed


@pytest.mark.parametrize(
    ("climate", "settings", "depths", "words"),
    [
        ("continental-average", {"solver.name": "cells"}, None, "solver.name is cells; a compact sky takes zones"),
        ("continental-average", {"observer.altitude_km": 2.0}, None, "observer.altitude_km is 2"),
        ("pure-air", {}, None, "pure-air: has no aerosol"),
        ("continental-average", {}, (0.1, 0.2, 0.3), "--optical-depths"),
        ("continental-average", {}, (0.1, 0.1, 0.2, 0.3), "--optical-depths"),
        ("continental-average", {}, (0.0, 0.1, 0.2, 0.3), "--optical-depths"),
        ("continental-average", {}, (0.001, 0.1, 0.2, 0.3), "stratospheric aerosol's own"),
    ],
)
def test_what_cannot_be_fitted_is_refused(climate, settings, depths, words):
    with pytest.raises(TwilightError, match=words):
        build.fit_compact(load(climate, settings), depths)


def test_the_command_refuses_what_does_nothing():
    from typer.testing import CliRunner

    from twilight.cli.app import app

    for arguments, words in (
        (["--set", "ground.albedo=0.5"], "--set ground.albedo: changes nothing in a compact sky"),
        (["--set", "sun.elevation_deg=5"], "--set sun.elevation_deg: changes nothing"),
        (["--output", "model.h5"], "must end in .npz"),
        (["--optical-depths", "a,b"], "must be numbers"),
        (["--set", "solver.nme=zones"], "solver.nme"),
    ):
        result = CliRunner().invoke(app, ["fit", "compact", *arguments])
        assert result.exit_code == 2 and words in result.stderr


@pytest.mark.slow
def test_the_shipped_model_is_near_the_solver_of_today(shipped):
    from twilight.solvers import zones

    rng = np.random.default_rng(11)
    skies = training.compute_skies(
        load("continental-average"), zones, replace(zones.QUALITIES["draft"], polarisation=True),
        training.TrainingAir(0.13, 0.25, 300.0), [405.0, 477.0, 550.0, 602.0, 700.0], [-14.5, -7.1, -3.1, 0.7, 22.0],
        lambda sun: training.random_directions(rng, sun),
    )  # fmt: skip
    error = build.errors_of(shipped, [skies])[0]
    assert error.median < 0.02 and error.p95 < 0.06
