"""The air from a photograph: known parameters recovered from rendered and degraded photographs."""

import json
import time
from dataclasses import replace

import numpy as np
import pytest
import yaml
from photographs import eight_bit, fisheye, latlong, perspective, picture, preetham, take
from toy_sky import texture_grid
from typer.testing import CliRunner

import twilight
from twilight.base.errors import TwilightError, TwilightWarning
from twilight.cli.app import app
from twilight.config import load
from twilight.engine import run
from twilight.io.stored_image import write_exr
from twilight.numerics import spectrum
from twilight.numerics.directions import azimuth_elevation, camera_axes
from twilight.scene import resolve
from twilight.scene.usual import completed
from twilight.sky import colour
from twilight.sky.sky import Sky
from twilight.studies.camera import CameraModel, write_camera
from twilight.studies.camera.exif import Stated
from twilight.studies.validate.photographs.air import OTHERS, SUN, Airs, Design, aerosol_above, with_settings
from twilight.studies.validate.photographs.estimate import Options, find_air
from twilight.studies.validate.photographs.fit import Freedom
from twilight.studies.validate.photographs.intervals import AirEstimate, Estimated
from twilight.studies.validate.photographs.options import EstimateOptions
from twilight.studies.validate.photographs.picture import Photograph, read_photograph
from twilight.studies.validate.photographs.picture_sky import OBSERVER, Frame
from twilight.studies.validate.photographs.report import sentence_of
from twilight.studies.validate.photographs.series import sun_range

DESIGN = Design(OTHERS)
ELEVATION, AZIMUTH = texture_grid(3.0)
TO_XYZ = np.linalg.inv(spectrum.xyz_to_rgb_matrix("cie1931_2deg"))
GRID = Sky(np.array([550.0]), ELEVATION, AZIMUTH, np.zeros((ELEVATION.size, AZIMUTH.size, 1)), 25.0)
STEEPNESS = {"toy": 1.0, "grey": -1.0, "blue": 3.0, "alike": 1.01 * 1.0}
"""Power of the wavelength in the optical depth of each type of the toy."""


def toy(elevation, azimuth, aerosol, ozone=320.0, albedo=0.25, sun=25.0, steepness=1.0):
    """XYZ of a sky of single scattering in plane layers, in three colours: a closed form in which every parameter
    leaves its mark."""
    e, a, s = np.radians(elevation)[..., None], np.radians(azimuth)[..., None], np.radians(sun)
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


class ToyAirs(Airs):
    """Airs whose skies are the toy's, and how many were asked for."""

    error = 0.0

    def __init__(self, error=0.0):
        self.design, self.error, self.asked, self._splines = DESIGN, error, set(), {}

    def log_xyz(self, aerosol_type, values, sun, elevation, azimuth):
        self.asked.add((aerosol_type, *(values[p.name] for p in DESIGN.parameters)))
        known = {p.name: values[p.name] for p in DESIGN.parameters}
        seen = toy(np.clip(elevation, 0.0, 90.0), azimuth, **known, sun=sun, steepness=STEEPNESS[aerosol_type])
        return np.log(seen)


def seen(camera, truth, *, through=picture, cell_deg=6.0, change=lambda rgb: rgb, **more):
    xyz = toy(*np.meshgrid(ELEVATION, AZIMUTH, indexing="ij"), **truth)
    rgb = change(take(GRID, camera, 40.0, xyz=xyz, sun=False, **more))
    shot = Photograph(through(rgb), camera, cell_deg, min_elevation_deg=3.0)
    return Frame.of(shot.seen(40.0, truth.get("sun", 25.0)), 240)


def part_of(cells, chosen):
    names = ("elevation_deg", "azimuth_deg", "xyz", "solid_angle_sr")
    return replace(
        cells, spread_deg=cells.spread_deg[:, chosen], **{name: getattr(cells, name)[chosen] for name in names}
    )


def framed(cells, low=25.0, high=25.0, camera=(0.0, 0.0, 0.0)):
    return [replace(cells, camera_deg=camera, sun_deg=low if low == high else None)]


TRUTH = {"aerosol": 0.22, "ozone": 380.0, "albedo": 0.1}


def found_in(cells, types=("toy",), low=25.0, high=25.0, error=0.0, **free):
    return find_air(ToyAirs(error), framed(cells, low, high), Options(types, None, low, high, Freedom(**free)))


def by_name(found):
    return {p.name: p for p in found.parameters}


@pytest.mark.parametrize("camera", [latlong(), fisheye(), perspective()], ids=["latlong", "fisheye", "perspective"])
def test_known_air_is_recovered(camera):
    """Fails if the skies between the airs, a photograph's cells or the fit were wrong, or took over a dozen airs."""
    airs = ToyAirs()
    made = find_air(airs, framed(seen(camera, TRUTH, cell_deg=3.0)), Options(["toy"], None, 25.0, 25.0))[0]
    assert made.fits and made.misfit < 0.02 and len(airs.asked) <= 12
    for name, truth in TRUTH.items():
        p = by_name(made)[name]
        assert abs(p.value - truth) < 2.5 * p.standard_error, (name, p)
        assert p.low_95 <= p.low <= p.value <= p.high <= p.high_95
    assert by_name(made)["aerosol"].value == pytest.approx(0.22, rel=0.05)
    assert by_name(made)["aerosol"].constrained


def test_a_value_at_its_bound_is_not_told():
    """Clearer air than any that was tried fits best with the least aerosol of all, which says little of its amount."""
    made = found_in(seen(latlong(), TRUTH | {"aerosol": 0.005}))[0]
    aerosol = by_name(made)["aerosol"]
    assert aerosol.value == pytest.approx(aerosol.bounds[0]) and not aerosol.constrained


def test_what_no_air_of_the_fit_has_widens_the_intervals():
    """A sky that is fainter on one side, as haze and stitching make it, would tell its haze to a per cent."""

    def one_sided(rgb):
        beside = np.linspace(-np.pi, np.pi, rgb.shape[1], endpoint=False) - np.radians(40.0)
        return rgb * (1.0 + 0.12 * np.sin(beside))[None, :, None]

    even, uneven = (by_name(found_in(seen(latlong(), TRUTH, change=c))[0]) for c in (lambda rgb: rgb, one_sided))
    for name, truth in TRUTH.items():
        assert uneven[name].low_95 <= truth <= uneven[name].high_95
    widths = [np.log(p["aerosol"].high_95 / p["aerosol"].low_95) for p in (even, uneven)]
    assert widths[1] > 2.0 * widths[0] and widths[1] > 0.1


def test_a_value_at_the_end_of_what_was_tried_says_what_it_stands_for():
    """An albedo of 0 of a lawn would be read as a dark lawn."""
    at_zero = Estimated("albedo", "1", 0.0, 0.03, 0.0, 0.03, 0.0, 0.06, (0.0, 0.6), 0.1, False)
    said = sentence_of(at_zero)
    assert "less than 0.06" in said and "the best is the end of what was tried, 0" in said and "darker beside" in said
    assert "the end" not in sentence_of(replace(at_zero, value=0.02))
    assert "brighter beside" in sentence_of(replace(at_zero, value=0.6))


def test_what_a_picture_does_not_tell_is_as_usual():
    """Colours that nobody balanced say nothing of ozone: it would be found at an end of what was tried, and called
    told, or its interval would be narrower than nature's spread."""
    usual = tuple(
        replace(p, usual=u, source="as here") for p, u in zip(DESIGN.others, ((300.0, 30.0), (0.2, 0.1)), strict=True)
    )
    airs = ToyAirs()
    airs.design = Design(usual)
    cells = seen(latlong(), TRUTH)
    part = part_of(cells, cells.elevation_deg > 75.0)
    free = Freedom(white_balance=True, contrast=0.15, saturation=0.25)
    ozone = by_name(find_air(airs, framed(part), Options(("toy",), None, 25.0, 25.0, free))[0])["ozone"]
    assert not ozone.constrained and abs(ozone.value - 300.0) < 15.0
    assert ozone.high - ozone.low == pytest.approx(60.0, rel=0.2)
    assert "the picture does not tell it; 300 +- 30 DU is usual: as here" in sentence_of(ozone)


def vignetted(rgb):
    """A lens that darkens its corners by 6 %, which the camera file does not know."""
    y, x = np.indices(rgb.shape[:2]) / np.array(rgb.shape[:2])[:, None, None] - 0.5
    return rgb * (1 - 0.06 * (x**2 + y**2) / 0.25)[..., None]


@pytest.mark.parametrize(
    "degraded", [{"noise": 0.03}, {"through": eight_bit, "noise": 0.02, "change": vignetted}], ids=["noise", "all"]
)
def test_degraded_photographs_are_as_uncertain_as_they_say(degraded):
    """Noise, 8 bits or an unknown vignetting would move the air by more than its stated errors."""
    made = by_name(found_in(seen(fisheye(), TRUTH, **degraded))[0])
    for name, truth in TRUTH.items():
        assert abs(made[name].value - truth) < 3 * made[name].standard_error, (name, made[name])
    assert made["aerosol"].value == pytest.approx(0.22, rel=0.1)


def test_a_part_of_the_sky_says_less():
    """A quarter of the sky would promise the errors of the whole."""
    wide = seen(latlong(), TRUTH)
    few = part_of(wide, (wide.azimuth_deg > 90) & (wide.azimuth_deg < 180))
    one, other = (by_name(found_in(cells)[0]) for cells in (wide, few))
    assert other["aerosol"].standard_error > 1.2 * one["aerosol"].standard_error


@pytest.mark.parametrize("sun", [23.3, pytest.param(7.1, marks=pytest.mark.slow)])
def test_the_sun_is_sought_over_all_elevations(sun):
    """Fails if the search stopped at a wrong minimum, or the fit between two suns of it were wrong."""
    made = by_name(found_in(seen(latlong(), {**TRUTH, "sun": sun}), low=0.0, high=90.0)[0])
    assert made["sun"].value == pytest.approx(sun, abs=0.7) and made["sun"].constrained
    assert made["aerosol"].value == pytest.approx(0.22, rel=0.15)


def test_the_type_that_fits_comes_first_and_one_s_own_is_taken_where_it_cannot_be_told():
    """The estimate would name a wrong aerosol, or drop the user's for one as good."""
    made = found_in(seen(latlong(), TRUTH), ("grey", "toy", "blue"))
    assert made[0].aerosol_type == "toy" and made[0].chi2_above_best == 0.0
    assert all(e.chi2_above_best > 4.0 and not e.parameters for e in made[1:])
    alike = find_air(ToyAirs(0.05), framed(seen(latlong(), TRUTH)), Options(["alike", "toy"], "alike", 25.0, 25.0))
    assert [bool(e.parameters) for e in alike if e.aerosol_type == "alike"] == [True]


@pytest.mark.slow
def test_white_balance_is_free_on_request():
    """The camera's white balance would be read as another air though it was to be fitted."""
    cells = seen(latlong(), TRUTH, change=lambda rgb: rgb * np.array([1.2, 1.0, 0.8]))
    bound, free = (found_in(cells, white_balance=w)[0] for w in (False, True))
    assert free.misfit < 0.1 * bound.misfit
    assert by_name(free)["aerosol"].value == pytest.approx(0.22, rel=0.1)


def test_a_picture_s_own_contrasts_are_not_read_as_air():
    """A panorama that somebody gave 1.2 times the contrast and the saturation would have an albedo of 0: its low sky is
    darker beside the zenith than above any ground."""

    def developed(rgb):
        green = np.maximum(rgb[..., 1:2], 1e-9)
        return green**1.2 * (np.maximum(rgb, 1e-9) / green) ** 1.2

    cells = seen(latlong(), TRUTH | {"albedo": 0.3}, change=developed)
    bound, free = (by_name(found_in(cells, white_balance=True, contrast=c, saturation=c)[0]) for c in (0.0, 0.2))
    assert bound["albedo"].value < 0.1 and free["albedo"].value == pytest.approx(0.3, abs=0.12)
    assert free["contrast"].value == pytest.approx(0.2, abs=0.05)
    assert free["saturation"].value == pytest.approx(0.2, abs=0.05)
    assert free["aerosol"].value == pytest.approx(0.22, rel=0.15)
    assert "saturation" not in by_name(found_in(cells, contrast=0.2, with_colour=False)[0])
    grey = seen(latlong(), TRUTH, change=lambda rgb: rgb.mean(axis=-1, keepdims=True) * np.ones(3))
    assert not found_in(grey, white_balance=True, contrast=0.15, saturation=0.25)[0].fits


def test_a_sky_without_sunlight_or_of_any_contrast_is_no_fit():
    """A grey cloud would be fitted as a sky at -18 deg, or by seven times its contrast."""
    fits = AirEstimate("urban", 0.1, 0.0, {"aerosol": 0.1, SUN: -9.0, "contrast": 0.2})
    assert fits.fits
    assert not replace(fits, values=fits.values | {SUN: -18.0}).fits
    assert not replace(fits, values=fits.values | {"contrast": 0.6}).fits


def test_what_does_not_fit_tells_nothing():
    """A sky of another colour and shape: no parameter counts as told, however narrow its interval."""
    cells = seen(latlong(), TRUTH, change=lambda rgb: rgb ** np.array([2.2, 2.0, 1.8]))
    made = found_in(cells)[0]
    assert not made.fits and not any(p.constrained for p in made.parameters)


@pytest.mark.slow
def test_the_solver_s_error_enters_the_uncertainties():
    """Intervals would claim that the solver is exact."""
    cells = seen(latlong(), TRUTH)
    one, other = (by_name(found_in(cells, error=error)[0]) for error in (0.0, 0.1))
    for name in TRUTH:
        assert other[name].standard_error > 1.3 * one[name].standard_error


# The function and the command ------------------------------------------------------------------------------------

DUSK = {"sun.elevation_deg": -3.0, "solver.name": "compact", "ground.albedo": 0.3, "horizon": "typical"}


def drawn(tmp_path, **settings):
    """A photograph of the model's own sky, through 8 bits of noise, and the air that made it."""
    sky = run(resolve(load("continental-average", {**DUSK, "aerosol.optical_depth_550nm": 0.2, **settings})))
    camera = latlong(180)
    return Photograph(eight_bit(take(sky, camera, 40.0, noise=0.01, sun=False)), camera, 3.0, min_elevation_deg=3.0)


def test_the_air_of_a_drawn_picture(tmp_path):
    """End to end, the sun sought: the sun within 1 deg, the depth within 10 %, the climate can be rendered and holds
    what was told alone; of air clearer than any tried it, and the comparison, would have the scene's haze."""
    begin = time.process_time()
    found = twilight.estimate(drawn(tmp_path), types=["continental_average"], name="dusk.jpg", white_balance=True)
    assert time.process_time() - begin < 60.0
    assert found.fits and any("horizon: typical" in line for line in found.sentences())
    assert found.sun_elevation_deg == pytest.approx(-3.0, abs=1.0)
    aerosol = found.parameters["aerosol"]
    assert aerosol.value == pytest.approx(0.2, rel=0.1)
    assert found.comparison.figures["luminance_rms_percent"] < 5.0
    untold = [p for p in found.best.parameters if not p.constrained and p.name in ("aerosol", "ozone", "albedo")]
    for p in untold:
        section, key = next(q.key for q in OTHERS if q.name == p.name).split(".", 1)
        assert found.climate.get(section) == completed(load("continental-average")).climate.model_dump(
            mode="json", exclude_none=True, exclude_defaults=True
        ).get(section), (p.name, key)
    text = found.climate_yaml()
    assert yaml.safe_load(text) == found.climate and "dusk.jpg" in found.climate["description"]
    assert ("# from the photograph" in text) == aerosol.constrained and aerosol.high_95 / aerosol.low_95 < 2.0
    assert json.loads(json.dumps(found.facts()))["fits"] is True
    assert load(found.climate).climate.name == "continental-average-dusk"
    assert repr(found).startswith("<Estimate of dusk.jpg: continental_average")
    clear = drawn(None, **{"sun.elevation_deg": 3.0, "aerosol.optical_depth_550nm": 0.012})
    found = twilight.estimate(clear, types=["continental_average"], sun_elevation_deg=3.0, sun_azimuth_deg=40.0)
    assert found.fits and found.comparison.figures["luminance_rms_percent"] < 4.0
    assert found.climate["aerosol"]["optical_depth_550nm"] == pytest.approx(0.02)


def test_the_camera_stands_at_its_altitude():
    """Haze above a camera at 500 m would be taken for that of the sea's level, a third too little."""
    scene = {**DUSK, "sun.elevation_deg": 15.0, "aerosol.optical_depth_550nm": 0.2, "observer.altitude_km": 0.5}
    camera = latlong(180)
    rgb = take(run(resolve(load("continental-average", scene))), camera, 40.0, sun=False)
    at = Stated(altitude_m=500.0)
    shot = Photograph(picture(rgb), camera, 3.0, min_elevation_deg=3.0, stated=at)
    given = {"types": ["continental_average"], "parameters": [], "sun_elevation_deg": 15.0, "sun_azimuth_deg": 40.0}
    given |= {"settings": {"ground.albedo": 0.3}}
    by_exif = twilight.estimate(shot, **given)
    assert by_exif.parameters["aerosol"].value == pytest.approx(0.2, rel=0.05)
    assert any("500 m above the sea, by Exif" in line for line in by_exif.sentences())
    above = float(aerosol_above(by_exif.scene, 0.5))
    assert 0.68 < above < 0.78
    said = f"from the sea's level up, {above * by_exif.parameters['aerosol'].value:.3g} of it above the camera"
    assert said in by_exif.climate_yaml() and any(said in line for line in by_exif.sentences())
    by_scene = twilight.estimate(replace(shot, stated=Stated()), **given | {"settings": scene})
    assert by_scene.parameters["aerosol"].value == pytest.approx(by_exif.parameters["aerosol"].value, rel=1e-3)
    unknown = twilight.estimate(replace(shot, stated=Stated()), **given).parameters["aerosol"]
    assert unknown.value < 0.17 and unknown.high_95 > 0.2 and unknown.high - unknown.value > 0.01
    with pytest.raises(TwilightError, match="observers up to 15 km"):
        twilight.estimate(shot, **given | {"settings": scene | {"observer.altitude_km": 30.0}})


def test_a_daylight_formula_s_sky_says_so(tmp_path):
    """The formula of daylight in a panorama is no sky of compact's at -10 deg: said first, as a warning too."""
    camera = latlong(180)
    shot = Photograph(picture(take(preetham(12.0), camera, 40.0, sun=False)), camera, 6.0, min_elevation_deg=3.0)
    with pytest.warns(TwilightWarning, match="DOES NOT FIT"):
        found = twilight.estimate(shot, sun_elevation_deg=-10.0, sun_azimuth_deg=40.0, types=["urban"], parameters=[])
    assert not found.fits and found.settings == {} and found.sentences()[0].startswith("THE FIT DOES NOT FIT")
    assert not any("of 100 such pictures" in line for line in found.sentences())


def test_the_command(tmp_path):
    """`validate estimate` would not bring back the air of a sky that it rendered, or leave a file out."""
    sky = run(resolve(load("continental-average", {**DUSK, "sun.elevation_deg": 15.0, "ground.albedo": 0.15})))
    camera = latlong(180)
    write_exr(tmp_path / "photo.exr", take(sky, camera, 0.0, sun=False))
    write_camera(tmp_path / "camera.yaml", camera)
    words = ["validate", "estimate", str(tmp_path / "photo.exr"), "--camera", str(tmp_path / "camera.yaml")]
    words += ["--sun-elevation", "15", "--types", "continental_average", "--parameters", "none"]
    words += ["--output", str(tmp_path / "out")]
    done = CliRunner().invoke(app, words)
    assert done.exit_code == 0, done.output
    made = json.loads((tmp_path / "out" / "estimate.json").read_text())
    depth = made["estimates"][0]["parameters"]["aerosol"]["value"]
    assert load(tmp_path / "out" / "climate.yaml").climate.aerosol.optical_depth_550nm == pytest.approx(depth)
    assert depth == pytest.approx(load("continental-average").climate.aerosol.optical_depth_550nm or depth, rel=0.2)
    assert sorted(p.name for p in (tmp_path / "out").iterdir()) == [
        "climate.yaml", "comparison.h5", "comparison.png", "estimate.json", "figures.json",
    ]  # fmt: skip
    for more, said in ((["--types", "urbn"], "urbn"), (["--parameters", "ozon"], "ozon")):
        done = CliRunner().invoke(app, [*words, *more])
        assert done.exit_code == 2 and said in done.stderr and len(done.stderr.splitlines()) == 1


def test_a_perspective_picture_is_not_taken_as_level(tmp_path):
    """A camera's file without the angle above the horizontal: that is found by the horizon, or free in the fit."""
    write_exr(tmp_path / "flat.exr", np.full((60, 90, 3), 0.5))
    data = perspective(90, 60).model_dump(exclude_none=True) | {"orientation": {"azimuth_deg": 70.0}}
    free = read_photograph(tmp_path / "flat.exr", EstimateOptions(camera=CameraModel.model_validate(data)))
    assert free.errors_deg[1] > 5.0 and "fitted with the air" in free.remarks[0]
    sky, camera = preetham(12.0), perspective(240, 160, elevation_deg=14.0)
    write_exr(tmp_path / "sky.exr", take(sky, camera, 75.0, sun=False))
    data = camera.model_dump(exclude_none=True) | {"orientation": {"azimuth_deg": 70.0}}
    seen = read_photograph(tmp_path / "sky.exr", EstimateOptions(camera=CameraModel.model_validate(data)))
    held = seen.camera.orientation
    assert held.elevation_deg == pytest.approx(14.0, abs=0.5) and held.roll_deg == pytest.approx(4.0, abs=0.5)
    assert read_photograph(tmp_path / "sky.exr", EstimateOptions(camera=camera)).errors_deg == (0.0, 0.0, 0.0)


def test_the_camera_s_angles_are_fitted():
    """A camera that was told 2 deg too low and 2 deg to the side is put right by the sky, and the air with it."""
    camera, truth = perspective(300, 200, elevation_deg=22.0), TRUTH | {"sun": 12.0}
    cells = seen(camera, truth, cell_deg=3.0)
    told = (70.0 - 40.0 + 2.0, 20.0, 4.0)
    frame = replace(cells, camera_deg=(30.0, 22.0, 4.0), sun_deg=12.0)
    azimuth, elevation = azimuth_elevation(frame.own @ camera_axes(*told))
    wrong = replace(cells, elevation_deg=elevation, azimuth_deg=azimuth)
    free = Freedom(heading=5.0, pitch=2.0, roll=1.0)
    frames = [replace(wrong, camera_deg=told, sun_deg=12.0)]
    made = find_air(ToyAirs(), frames, Options(["toy"], None, 12.0, 12.0, free))[0]
    assert made.values["pitch"] == pytest.approx(2.0, abs=0.6)
    assert made.values["heading"] == pytest.approx(-2.0, abs=1.0)
    assert made.values["aerosol"] == pytest.approx(0.22, rel=0.2)


@pytest.mark.slow
def test_a_tone_curve_is_undone():
    """A picture with 1.3 times the contrast: the air comes out right with the curve free, and wrong without."""
    cells = seen(latlong(), TRUTH, change=lambda rgb: rgb**1.3)
    bound, free = (found_in(cells, curve=curve, white_balance=True)[0] for curve in (False, True))
    assert by_name(free)["aerosol"].value == pytest.approx(0.22, rel=0.2) and free.misfit < 0.3 * bound.misfit
    assert free.curve.contrast == pytest.approx(1.3, abs=0.12)
    assert free.costs["curve"] > 1.0


@pytest.mark.slow
def test_a_series_tells_more_than_one_picture():
    """Two suns of one air: the same camera and air for both, and smaller errors."""
    two = [replace(seen(latlong(), TRUTH | {"sun": sun}, cell_deg=3.0), sun_deg=sun) for sun in (25.0, 6.0)]
    options = Options(["toy"], None, 25.0, 25.0, Freedom(white_balance=True))
    one, both = (by_name(find_air(ToyAirs(0.02), frames, options)[0]) for frames in (two[:1], two))
    for name in TRUTH:
        assert both[name].standard_error < one[name].standard_error
    assert both["aerosol"].value == pytest.approx(TRUTH["aerosol"], rel=0.1)


def test_the_sun_counts_where_it_is_given():
    """The estimate would search suns that time and place rule out."""
    assert sun_range(load("continental-average"))[:2] == (-18.0, 90.0)
    assert sun_range(load("continental-average", {"sun.elevation_deg": -4.0}))[:2] == (-4.0, -4.0)
    assert sun_range(load("continental-average", {"sun": {"elevations_deg": [-9, 2, 5]}}))[:2] == (-9.0, 5.0)
    at = {"at": "2024-06-21T12:00Z", "latitude_deg": 50.0, "longitude_deg": 0.0}
    low, high, position = sun_range(load("continental-average", {"sun": at}))
    assert low == high == pytest.approx(63.4, abs=0.2) and position.azimuth_deg == pytest.approx(179, abs=2)
    with pytest.raises(TwilightError, match="with suns from -18 to 90"):
        sun_range(load("continental-average", {"sun.elevation_deg": -30.0}))


def test_settings_replace_what_the_scene_says():
    """An estimated ozone column would stand beside the day that it replaces."""
    base = load("continental-average", {"sun.elevation_deg": 20.0})
    data = base.model_dump(mode="json", exclude_unset=True)
    data["climate"]["gases"] = {"ozone": {"day_of_year": 40}}
    made = with_settings(load(data), {"gases.ozone.column_du": 300.0, "aerosol.type": "desert"})
    assert made.climate.gases.ozone.column_du == 300.0 and made.climate.gases.ozone.day_of_year is None
    assert made.climate.aerosol.type == "desert"
    with pytest.raises(TwilightError, match="no aerosol to estimate"):
        Airs(load("bruneton2008", {"sun.elevation_deg": 5.0}), DESIGN)


# A photograph as a sky -------------------------------------------------------------------------------------------


def test_a_photograph_is_a_sky(tmp_path):
    """The colours and luminances of the rendered sky are read back by what every Sky has: sample, luminance, plot,
    ratio, files."""
    truth, camera = preetham(12.0), latlong(720)
    level = float(truth.luminance_at(60.0, 30.0))
    write_exr(tmp_path / "photo.exr", take(truth, camera, 55.0, sun=False, exposure=1.0 / level))
    sky = twilight.read_sky(tmp_path / "photo.exr", sun_elevation_deg=12.0, sun_azimuth_deg=55.0, cd_per_m2=level)
    e, a = np.array([10.0, 35.0, 60.0, 80.0]), np.array([30.0, 100.0, 180.0, 300.0])
    assert sky.luminance_at(e, a) == pytest.approx(truth.luminance_at(e, a), rel=0.02)
    xyz = [colour.factor_to_xyz(s.sample(e, a), s.wavelength_nm, observer=OBSERVER) for s in (sky, truth)]
    assert np.abs(colour.uv_of_xyz(xyz[0]) - colour.uv_of_xyz(xyz[1])).max() < 0.002
    assert sky.illuminance_lux() == pytest.approx(truth.illuminance_lux(), rel=0.03)
    assert (sky / sky).luminance().max() == pytest.approx(1.0)
    assert sky.plot("fisheye", width=64).axes
    assert sky.to_xarray().sizes["elevation"] == sky.elevation_deg.size
    with pytest.raises(TwilightError, match="shows no disc of the sun; give sun_elevation_deg"):
        twilight.read_sky(tmp_path / "photo.exr")
