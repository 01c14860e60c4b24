"""The air from a photograph: known parameters recovered from rendered and degraded photographs."""

import json
from dataclasses import replace

import numpy as np
import pytest
from photographs import eight_bit, fisheye, latlong, picture, take
from twilight.studies.validate.photographs.library import (
    AEROSOL,
    OTHERS,
    SUN,
    Design,
    Library,
    climate_settings,
    make_library,
    with_settings,
)
from typer.testing import CliRunner

from twilight.atmosphere.screen import Screen
from twilight.base.errors import TwilightError
from twilight.cli.app import app
from twilight.config import load
from twilight.engine import run
from twilight.numerics import spectrum
from twilight.numerics.grids import texture_grid
from twilight.scene import resolve
from twilight.scene.horizon import screen_of
from twilight.sky import colour
from twilight.sky.sky import Sky
from twilight.studies.camera import write_camera
from twilight.studies.camera.image import write_exr
from twilight.studies.validate.photographs import emulator
from twilight.studies.validate.photographs.estimate import estimate, facts, sentences, unconstrained_wavelengths
from twilight.studies.validate.photographs.photo import OBSERVER
from twilight.studies.validate.photographs.photograph import Photograph

HUMIDITY, OZONE, ALBEDO, HORIZON = OTHERS
TOY_DESIGN = Design((HUMIDITY, OZONE, ALBEDO))
ELEVATION, AZIMUTH = texture_grid(3.0)
TO_XYZ = np.linalg.inv(spectrum.xyz_to_rgb_matrix("cie1931_2deg"))
GRID = Sky(np.array([550.0]), ELEVATION, AZIMUTH, np.zeros((ELEVATION.size, AZIMUTH.size, 1)), 25.0)


def toy(aerosol, ozone=320.0, albedo=0.25, sun=25.0, steepness=1.0, **ignored):
    """XYZ of a sky of single scattering in plane layers, in three colours: a closed form in which every parameter but
    humidity leaves its mark."""
    e, a, s = np.radians(ELEVATION)[:, None, None], np.radians(AZIMUTH)[None, :, None], np.radians(sun)
    cosine = np.sin(e) * np.sin(s) + np.cos(e) * np.cos(s) * np.cos(a)
    air = np.array([0.06, 0.10, 0.21])
    haze = aerosol * np.array([0.84, 1.0, 1.25]) ** steepness
    g = 0.7
    forward = (1 - g * g) / (1 + g * g - 2 * g * cosine) ** 1.5
    path = 1.0 / (np.sin(e) + 0.06)
    total = air + haze
    light = (0.75 * (1 + cosine**2) * air + forward * haze) / total * (1 - np.exp(-total * path))
    light = light * np.exp(-total / (np.sin(s) + 0.06)) + albedo * (air + 0.3 * haze) * 0.7
    absorption = np.array([0.06, 0.09, 0.005]) * ozone / 320.0
    return 3e3 * (light * np.exp(-absorption * (0.3 * path + 2.0))) @ TO_XYZ.T


def toy_library(name="toy", suns=(25.0,), steepness=1.0):
    nodes = TOY_DESIGN.nodes
    xyz = [[toy(**node, sun=sun, steepness=steepness) for sun in suns] for node in nodes]
    return Library(TOY_DESIGN, name, np.array(suns), np.array(suns), np.array(xyz))


def seen(camera, truth, *, through=picture, cell_deg=6.0, change=lambda rgb: rgb, **more):
    rgb = change(take(GRID, camera, 40.0, xyz=toy(**truth), sun=False, **more))
    shot = Photograph(through(rgb), camera, cell_deg, min_elevation_deg=3.0)
    return shot.seen(40.0, truth.get("sun", 25.0)).sky


TRUTH = {"aerosol": 0.22, "ozone": 380.0, "albedo": 0.1}


def by_name(found):
    return {p.name: p for p in found.parameters}


def test_the_library_interpolates_between_its_climates():
    library = toy_library(suns=(20.0, 25.0, 30.0))
    table = np.log(library.xyz).reshape(-1, ELEVATION.size, AZIMUTH.size, 3)
    for values in (
        {"aerosol": 0.1, "ozone": 250.0, "albedo": 0.4},
        TRUTH,
        {"aerosol": 0.5, "ozone": 420, "albedo": 0.5},
    ):
        for sun in (22.0, 25.0):
            weights = library.weights({"humidity": 66.0, SUN: sun, **values})
            found = np.tensordot(weights, table, 1)
            off = found - np.log(toy(**values, sun=sun))
            off = np.abs(off - off.mean())  # the exposure is free
            near = np.hypot(ELEVATION[:, None] - sun, np.minimum(AZIMUTH, 360 - AZIMUTH)[None, :]) < 15
            assert off[~near].max() < 0.08, values
            assert off[~near].mean() < 0.025, values
    node = library.design.nodes[7]
    weights = library.weights({**node, SUN: 25.0})
    assert weights.sum() == pytest.approx(1.0)
    assert np.abs(np.tensordot(weights, table, 1) - table[7 * 3 + 1]).max() < 1e-9


@pytest.mark.parametrize("camera", [latlong(), fisheye()], ids=["latlong", "fisheye"])
def test_known_air_is_recovered(camera):
    found = by_name(estimate(seen(camera, TRUTH), [toy_library()], refine=lambda name, values: toy(**values))[0])
    for name, truth in TRUTH.items():
        p = found[name]
        assert p.constrained, name
        assert abs(p.value - truth) < 2.5 * p.standard_error, (name, p)
        assert p.low <= p.value <= p.high
    assert found["aerosol"].value == pytest.approx(0.22, rel=0.01)
    assert found["ozone"].value == pytest.approx(380, abs=5)


def test_what_leaves_no_mark_is_not_constrained():
    made = estimate(seen(latlong(), TRUTH), [toy_library()])
    humidity = by_name(made[0])["humidity"]
    assert not humidity.constrained and humidity.relative_width > 0.9
    assert humidity.low < 60 and humidity.high > 93
    assert any("humidity: the photograph cannot tell it" in line for line in sentences(made))
    assert not any(" 1)" in line or " 1 of" in line for line in sentences(made))  # a pure number's unit
    assert json.loads(json.dumps(facts(made)))[0]["parameters"]["humidity"]["constrained"] is False


def test_a_value_at_its_bound_is_not_constrained():
    """Clearer air than any that was tried fits best with the least aerosol of all, which says little of its amount."""
    made = estimate(seen(latlong(), TRUTH | {"aerosol": 0.005}), [toy_library()])
    aerosol = by_name(made[0])["aerosol"]
    assert aerosol.value == pytest.approx(aerosol.bounds[0]) and not aerosol.constrained
    assert aerosol.unit == "1" and f"aerosol: lies at the bound {aerosol.value:.3g} of what was tried" in " ".join(
        sentences(made)
    )


def vignetted(rgb):
    """A lens that darkens its corners by 6 %, which the camera file does not know."""
    y, x = np.indices(rgb.shape[:2]) / np.array(rgb.shape[:2])[:, None, None] - 0.5
    return rgb * (1 - 0.06 * (x**2 + y**2) / 0.25)[..., None]


@pytest.mark.parametrize(
    "degraded",
    [
        {"noise": 0.03},
        {"through": eight_bit},
        {"change": vignetted, "noise": 0.01},
        {"through": eight_bit, "noise": 0.02, "change": vignetted},
    ],
    ids=["noise", "8 bit", "vignetting", "all"],
)
def test_degraded_photographs_are_as_uncertain_as_they_say(degraded):
    """Noise, 8 bits or an unknown vignetting would move the air by more than its stated errors (2.55 at most)."""
    found = by_name(estimate(seen(fisheye(), TRUTH, **degraded), [toy_library()])[0])
    for name, truth in TRUTH.items():
        p = found[name]
        assert abs(p.value - truth) < 3 * p.standard_error, (name, p)
    assert found["aerosol"].value == pytest.approx(0.22, rel=0.06)
    assert found["ozone"].value == pytest.approx(380.0, abs=10.0)
    assert found["albedo"].value == pytest.approx(0.1, abs=0.06)


@pytest.mark.slow
def test_a_part_of_the_sky_says_less():
    wide = seen(latlong(), TRUTH)
    low = replace(
        wide, solid_angle_sr=np.where((wide.azimuth_deg > 90) & (wide.azimuth_deg < 180), wide.solid_angle_sr, 0.0)
    )
    one, other = (by_name(estimate(photo, [toy_library()])[0]) for photo in (wide, low))
    assert other["aerosol"].standard_error > 1.2 * one["aerosol"].standard_error
    assert other["albedo"].relative_width > one["albedo"].relative_width


def test_the_sun_is_found_with_the_air():
    truth = {**TRUTH, "sun": 23.3}
    library = toy_library(suns=(20.0, 22.0, 24.0, 26.0, 28.0))
    found = by_name(estimate(seen(latlong(), truth), [library])[0])
    assert found["sun"].value == pytest.approx(23.3, abs=0.7)
    assert found["aerosol"].value == pytest.approx(0.22, rel=0.15)


@pytest.mark.slow
def test_the_type_that_fits_comes_first():
    others = [toy_library("grey", steepness=-1.0), toy_library("true"), toy_library("blue", steepness=3.0)]
    made = estimate(seen(latlong(), TRUTH), others)
    assert made[0].aerosol_type == "true" and made[0].chi2_above_best == 0.0
    assert all(e.chi2_above_best > 0 for e in made[1:])


def test_white_balance_is_free_on_request():
    photo = seen(latlong(), TRUTH, change=lambda rgb: rgb * np.array([1.2, 1.0, 0.8]))
    bound, free = (estimate(photo, [toy_library()], white_balance=w)[0] for w in (False, True))
    assert free.misfit < 0.1 * bound.misfit
    assert by_name(free)["aerosol"].value == pytest.approx(0.22, rel=0.1)


def test_the_library_s_error_enters_the_uncertainties():
    photo, library = seen(latlong(), TRUTH), toy_library()
    one, other = (by_name(estimate(photo, [replace(library, luminance_error=error)])[0]) for error in (0.0, 0.05))
    for name in TRUTH:
        assert other[name].standard_error > 1.3 * one[name].standard_error


# Files and errors -----------------------------------------------------------------------------------------------

TINY = {"sun.elevation_deg": 20.0, "solver.name": "preetham"}
FIVE_NM = [430.0, 490.0, 550.0, 610.0, 670.0]
"""Enough for a colour; skies and photograph have the same."""


def test_settings_replace_what_the_scene_says():
    base = load("continental-average", TINY)
    data = base.model_dump(mode="json", exclude_unset=True)
    data["climate"]["gases"] = {"ozone": {"day_of_year": 40}}
    made = with_settings(load(data), {"gases.ozone.column_du": 300.0, "aerosol.type": "desert"})
    assert made.climate.gases.ozone.column_du == 300.0 and made.climate.gases.ozone.day_of_year is None
    assert made.climate.aerosol.type == "desert"


@pytest.mark.slow
def test_a_library_is_computed_once(tmp_path, monkeypatch):
    base, design, file = load("continental-average", TINY), Design(()), tmp_path / "skies.npz"
    one = make_library(base, design, "continental_average", [10.0, 20.0], 6.0, file=file)
    assert one.xyz.shape == (5, 2, 15, 60, 3)

    def never(*_):
        raise AssertionError("computed again")

    monkeypatch.setattr(emulator, "compute", never)
    two = make_library(base, design, "continental_average", [10.0, 20.0], 6.0, file=file)
    assert (two.xyz == one.xyz).all()
    assert two.luminance_error == one.luminance_error > 0.0
    with pytest.raises(AssertionError):  # another question is not answered from the file
        make_library(base, design, "desert", [10.0, 20.0], 6.0, file=file)
    file.write_bytes(file.read_bytes()[:2000])
    with pytest.raises(TwilightError, match=r"skies\.npz"):
        make_library(base, design, "continental_average", [10.0, 20.0], 6.0, file=file)


def analytic_photograph(tmp_path):
    """Words of the command for a photograph rendered with aerosol 0.25, by the analytic solver."""
    truth = run(
        resolve(load("continental-average", {**TINY, "aerosol.optical_depth_550nm": 0.25, "texture.resolution_deg": 6}))
    )
    camera = latlong(180)
    write_exr(tmp_path / "photo.exr", take(truth, camera, 0.0))
    write_camera(tmp_path / "camera.yaml", camera)
    (tmp_path / "scene.yaml").write_text(
        "version: 1\nclimate: continental-average\nsun: {elevation_deg: 20}\nsolver: {name: preetham}\n"
    )
    words = ["validate", "estimate", str(tmp_path / "photo.exr"), "--camera", str(tmp_path / "camera.yaml")]
    words += ["--config", str(tmp_path / "scene.yaml"), "--types", "continental_average", "--parameters", "none"]
    words += ["--resolution", "6", "--output", str(tmp_path / "out")]
    return words


def test_the_command(tmp_path):
    """The analytic solver's turbidity follows the aerosol: a rendered photograph gives its optical depth back."""
    words = [*analytic_photograph(tmp_path), "--library", str(tmp_path / "skies")]
    done = CliRunner().invoke(app, words)
    assert done.exit_code == 0, done.output
    made = json.loads((tmp_path / "out" / "estimate.json").read_text())["estimates"][0]["parameters"]["aerosol"]
    assert made["value"] == pytest.approx(0.25, rel=0.1)
    assert "as given" not in done.output and "sun azimuth" in done.output  # none was
    assert load(tmp_path / "out" / "climate.yaml").climate.aerosol.optical_depth_550nm == made["value"]
    assert (tmp_path / "out" / "comparison.png").is_file()
    assert [p.name for p in (tmp_path / "skies").iterdir()] == ["continental-average_continental_average.npz"]
    for more, said in ((["--types", "urbn"], "urbn"), (["--parameters", "ozon"], "ozon")):
        done = CliRunner().invoke(app, [*words, *more])
        assert done.exit_code == 2 and said in done.stderr and len(done.stderr.splitlines()) == 1


def test_skies_are_cached_for_the_next_photograph_and_interrupted_ones_are_fitted(tmp_path, monkeypatch):
    words = analytic_photograph(tmp_path)
    monkeypatch.setenv("TWILIGHT_CACHE_DIR", str(tmp_path / "cache"))
    monkeypatch.setenv("TWILIGHT_CACHE_GB", "1")
    assert CliRunner().invoke(app, words).exit_code == 0
    first = json.loads((tmp_path / "out" / "estimate.json").read_text())["estimates"]
    shown = CliRunner().invoke(app, ["cache"]).output
    assert "skies of studies\t7\t" in shown  # two of them are held out

    computed = []

    def interrupted(config, *_):
        computed.append(config)
        raise KeyboardInterrupt

    monkeypatch.setattr(emulator, "compute", interrupted)
    words[words.index("continental_average")] = "continental_average,desert,urban"
    done = CliRunner().invoke(app, words)
    assert done.exit_code == 130 and "interrupted; fits continental_average, not desert, urban" in done.stderr
    assert len(computed) == 1  # the first of desert: those of continental_average were there
    made = json.loads((tmp_path / "out" / "estimate.json").read_text())
    assert made["estimates"] == first
    assert "aerosol type: desert, urban was not tried: interrupted" in made["remarks"]
    for path in (tmp_path / "cache" / "skies").iterdir():
        path.write_bytes(path.read_bytes()[:100])
    assert CliRunner().invoke(app, words).exit_code == 130 and len(computed) == 2
    cleared = CliRunner().invoke(app, ["cache", "--clear"])
    assert cleared.exit_code == 0 and not (tmp_path / "cache" / "skies").exists()


@pytest.mark.slow
def test_the_solver_s_own_skies_are_recovered():
    """Zones at draft, climates between the nodes: aerosol, ozone and albedo from a fisheye photograph in 8 bits."""
    settings = {
        "sun.elevation_deg": 8.0,
        "solver": {"name": "zones", "quality": "draft"},
        "texture.resolution_deg": 3,
        "wavelengths.list_nm": FIVE_NM,
    }
    base = load("continental-average", settings)
    library = make_library(base, Design((OZONE, ALBEDO)), "continental_average", [8.0], 3.0)
    truth = {"aerosol.optical_depth_550nm": 0.21, "gases.ozone.column_du": 290.0, "ground.albedo": 0.35}
    sky = run(resolve(with_settings(base, truth)))
    camera = fisheye(500)
    shot = Photograph(
        eight_bit(take(sky, camera, 40.0, noise=0.01)), camera, 3.0, min_elevation_deg=3.0, glare_deg=10.0
    )

    def compute(name, values):
        return colour.sky_to_xyz(
            run(resolve(with_settings(base, climate_settings(library.design, values, name)))), observer=OBSERVER
        )

    found = by_name(estimate(shot.seen(40.0, 8.0).sky, [library], refine=compute)[0])
    for name, value in zip(("aerosol", "ozone", "albedo"), truth.values(), strict=True):
        p = found[name]
        assert abs(p.value - value) < 3 * p.standard_error, (name, p)
    assert found["aerosol"].value == pytest.approx(0.21, rel=0.1)
    assert AEROSOL.nodes[0] < found["aerosol"].low < found["aerosol"].high < AEROSOL.nodes[-1]


def test_the_screen_beyond_the_horizon_is_a_parameter_of_the_scene():
    """Fails if the fitted clouds were not those that are computed, or took the place of the scene's own height."""
    design = Design((HORIZON,))
    settings = climate_settings(design, {"aerosol": 0.1, "horizon": 0.4}, "continental_average")
    plain = load("continental-average", {"sun.elevation_deg": -4.0})
    assert screen_of(with_settings(plain, settings).horizon) == Screen.of_clouds(0.4, 9.0, 1.5, 150.0)
    high = load("continental-average", {"sun.elevation_deg": -4.0, "horizon.screen": {"clouds": {"top_km": 11.0}}})
    assert screen_of(with_settings(high, settings).horizon) == Screen.of_clouds(0.4, 11.0, 1.5, 150.0)


def test_wavelengths_that_are_not_constrained_are_named():
    """A free white balance takes the colour of the whole sky, and luminance alone has none."""
    assert "cannot tell how much red, green or blue" in unconstrained_wavelengths(True, True)
    assert "luminance alone" in unconstrained_wavelengths(False, False)
    assert "above 650 nm" in unconstrained_wavelengths(False, True)


@pytest.mark.slow
def test_what_lay_beyond_the_horizon_is_recovered():
    """From a rendered dusk, by emulated ones: fails if the cover left no mark or its sky were interpolated wrongly."""
    base = load(
        "continental-average",
        {
            "sun.elevation_deg": -3.0,
            "solver": {"name": "zones", "quality": "draft"},
            "texture.resolution_deg": 6,
            "wavelengths.list_nm": FIVE_NM,
        },
    )
    design = Design((HORIZON,))
    truth = {"aerosol": 0.15, "horizon": 0.7}
    scene = with_settings(base, climate_settings(design, truth, "continental_average"))
    camera = latlong(180)
    seen_by_it = picture(take(run(resolve(scene)), camera, 40.0, sun=False))
    shot = Photograph(seen_by_it, camera, 6.0, min_elevation_deg=3.0)
    library = make_library(base, design, "continental_average", [-3.0], 6.0)
    found = by_name(estimate(shot.seen(40.0, -3.0).sky, [library])[0])
    assert found["horizon"].constrained
    assert found["horizon"].value == pytest.approx(0.7, abs=0.15)
